# modlhmp: `make reproduce` and `make test` are all a newcomer needs. `make help` lists the rest.
SHELL := /bin/bash
PYTHON ?= python3.11
CORES ?= 2
RUN ?= demo
BIN := .venv/bin
PIP := $(BIN)/python -m pip install --quiet --disable-pip-version-check
# Everything a run writes outside the project stays in it: kernels are compiled once, here.
export MODLHMP_CACHE_DIR ?= $(CURDIR)/.cache/kernels
export MPLCONFIGDIR ?= $(CURDIR)/.cache/matplotlib
export PYTHONHASHSEED ?= 0

.PHONY: help environment reproduce test test-full torture lint lock bench paper-size results certify verify \
    settings docs licences unlock clean

help:                     ## this list
	@grep -E '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:.*## /\t/' | expand -t 14

environment: .venv/ready  ## .venv from environment.lock (hash-checked) and this package

.venv/ready: environment.lock
	@python=$$(command -v $(PYTHON) || command -v python3 || true); \
	if [ -z "$$python" ] || ! "$$python" -c 'import sys; sys.exit(sys.version_info[:2] != (3, 11))'; then \
	    echo "modlhmp needs Python 3.11 and found $$([ -n "$$python" ] && "$$python" --version || echo none)." >&2; \
	    echo "Install it (Debian: apt install python3.11 python3.11-venv) or name it: make PYTHON=/path/to/python3.11" >&2; \
	    exit 1; fi; \
	"$$python" -m venv --clear .venv || { \
	    echo "Could not make .venv: the venv module is missing (Debian: apt install python3.11-venv)." >&2; exit 1; }
	@# PyTorch's CPU wheel comes first and from its own index, which nothing else then has to be looked up in.
	sed -n '/^# torch: the CPU wheel/,$$p' environment.lock > .venv/torch.lock
	$(PIP) --require-hashes --no-deps --extra-index-url https://download.pytorch.org/whl/cpu -r .venv/torch.lock
	$(PIP) --require-hashes -r environment.lock
	$(PIP) --no-deps --no-build-isolation -e .
	@touch $@

reproduce: environment    ## demo recordings -> every table and figure
	$(BIN)/snakemake --cores $(CORES)

test: environment lint    ## lint, unit, reference, fault and workflow tests
	$(BIN)/python -m pytest -n $(CORES) -m "not full and not torture"

test-full: environment lint  ## the same and the long checks
	$(BIN)/python -m pytest -n $(CORES) -m "not torture"

torture: environment      ## hours of faults: 50 kills, many damaged inputs, the same run on other terms (docs/trust.md)
	$(BIN)/python -m pytest -m torture
	$(BIN)/python tests/torture/determinism.py

lint: environment         ## ruff, mypy, snakefmt, snakemake --lint
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/snakefmt --check Snakefile workflow
	$(BIN)/snakemake --lint

results: environment     ## the real runs (MODLHMP_DATA) -> docs/numbers.json and the pages made from it
	$(BIN)/snakemake --cores $(CORES)
	$(BIN)/snakemake --cores $(CORES) --configfile config/real.yaml
	$(BIN)/snakemake --cores $(CORES) --configfile config/real.yaml config/lab/ladder.yaml
	$(BIN)/snakemake --cores $(CORES) --configfile config/real.yaml config/lab/folds.yaml
	$(BIN)/snakemake --cores $(CORES) --configfile config/real.yaml config/lab/networks.yaml
	$(BIN)/snakemake --cores $(CORES) --configfile config/real.yaml config/lab/likelihood.yaml
	$(BIN)/snakemake --cores $(CORES) --configfile config/real.yaml config/lab/likelihood.yaml \
	    config/lab/likelihood_edinburgh.yaml
	$(BIN)/snakemake --cores $(CORES) --configfile config/real.yaml config/lab/short.yaml
	$(BIN)/python -m modlhmp.study.publish

certify: environment     ## results/RUN/certificate.json of all that went in and came out (CONFIG="config/real.yaml ...")
	$(BIN)/snakemake --cores $(CORES) --forcerun certify $(if $(CONFIG),--configfile $(CONFIG)) -- certify

verify: environment      ## whether RUN's files are still those, and those of AGAINST=another certificate
	$(BIN)/python -m modlhmp.study.certificate $(RUN) $(AGAINST)

settings: environment    ## schemas and the tables of config/README.md, from the typed settings
	$(BIN)/python -m modlhmp.study.describe

docs: environment         ## the documentation as a site: docs/_build/html/index.html; a broken link is an error
	rm -rf docs/_build/source docs/_build/html && mkdir -p docs/_build/source
	$(BIN)/python -m sphinx --quiet --fail-on-warning --keep-going -c docs docs/_build/source docs/_build/html
	@echo "docs/_build/html/index.html; links that leave it: docs/_build/html/external-links.txt"

licences: environment    ## docs/licences.md of all locked packages, and sbom.json (CycloneDX 1.6) for a release
	$(BIN)/python -m modlhmp.study.licences

unlock: environment      ## remove the lock that a killed run has left, if no run is at work
	$(BIN)/python -m modlhmp.study.running

bench: environment        ## speed and memory, as ratios in one run -> results/bench.json
	$(BIN)/python benchmarks/run.py

paper-size: environment   ## the workflow at the paper's volume, and its growth -> results/paper-size.* (CLUSTER=slurm: queued, too)
	$(BIN)/python benchmarks/paper_size.py --cores $(CORES) $(if $(CLUSTER),--profile profiles/$(CLUSTER))

# uv resolves everything but one wheel: on Linux x86_64 torch's plain wheel draws 20 GPU packages, so the CPU wheel is
# appended by hash. Versions stay as they are in environment.lock unless pyproject.toml rules them out or UPGRADE names
# them: make lock UPGRADE="--upgrade-package ruff".
TORCH := torch==2.13.0
TORCH_CPU := sys_platform == "linux" and platform_machine == "x86_64" and python_version == "3.11"
TORCH_PLAIN := (sys_platform == "linux" and platform_machine == "aarch64") or \
    (sys_platform == "darwin" and platform_machine == "arm64")
TORCH_HASH := 6746dbcbeb526eb61330b76b41ff1b4eb848951103a892eeb080dfa2b264667b
TORCH_NEEDS := filelock fsspec jinja2 networkx safetensors sympy typing-extensions
LOCKED := --extra docs --extra hdf5 --extra plans --extra ros --extra study --extra cluster --extra notebooks --extra dev
UPGRADE ?=

lock:                     ## environment.lock anew from pyproject.toml (needs uv)
	@command -v uv >/dev/null || { echo "make lock needs uv: pip install uv" >&2; exit 1; }
	sed '/^# torch: the CPU wheel/,$$d; 1,/^$$/d' environment.lock > environment.lock.new
	printf '%s\n' $(TORCH_NEEDS) '$(TORCH) ; $(TORCH_PLAIN)' | uv pip compile --quiet --generate-hashes --universal \
	    --python-version 3.11 --no-header --emit-build-options $(LOCKED) $(UPGRADE) pyproject.toml - \
	    -o environment.lock.new
	{ printf '%s\n' '# Made by `make lock` from pyproject.toml for CPython 3.11; every package is checked by hash.' \
	      '# Linux on x86_64 is tested. Linux on aarch64 and macOS 14 on arm64 resolve too, with the plain wheels of' \
	      '# torch, but are untried.' ''; \
	  cat environment.lock.new; \
	  printf '%s\n' '# torch: the CPU wheel of https://download.pytorch.org/whl/cpu'; \
	  printf '%s ; %s \\\n    --hash=sha256:%s\n' '$(TORCH)' '$(TORCH_CPU)' '$(TORCH_HASH)'; } > environment.lock
	rm environment.lock.new

clean:                    ## remove all that runs have written (not .venv, not recordings of yours)
	rm -rf results/* resources/demo .snakemake .cache paper_figures/*/
