# The run: its settings, its datasets, its paths, and the version of the code. Nothing here makes a file.
#
# INPUTS   config/budgets.yaml, config/config.yaml and overlays, config/datasets/<name>.yaml
# OUTPUTS  RUN, DATASETS, LAYOUT, PLAN and the small functions below
# STEPS    check the configuration, load the datasets, constrain the wildcards
import os
import re
import sys
from pathlib import Path

from snakemake.exceptions import WorkflowError

from modlhmp.exchange.maps import map_files
from modlhmp.kinds import all_kinds, find
from modlhmp.settings import as_plain
from modlhmp.origins import file_sha256
from modlhmp.storage import DataError
from modlhmp.study.claims import claim_horizons
from modlhmp.study.exhibits import EXHIBITS
from modlhmp.study import running
from modlhmp.study.killed import killed_jobs
from modlhmp.study.layout import SUMS, Layout
from modlhmp.study.report.about import about, files as report_files
from modlhmp.study.report import ASSETS as REPORT_ASSETS
from modlhmp.study.report.rule_graph import rule_graph
from modlhmp.study.queue_errors import check_queue, check_status_command, remedies
from modlhmp.study.plan import (
    CLEANING_KEYS,
    FORECAST_KEYS,
    SCORE_KEYS,
    SITE_KEYS,
    TRAINING_KEYS,
    Plan,
)
from modlhmp.study.configuration import check_maps, load_datasets, load_run
from modlhmp.study.versions import assets_version, code_version
from modlhmp.temporary import remove_leftovers

# For the jobs, read when PyTorch loads OpenMP: threads that wait by spinning stall other processes.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")

try:
    # The working folder's come first.
    DATASET_FOLDERS = "config/datasets", ROOT / "config/datasets"
    RUN = load_run(config, DATASET_FOLDERS)
    LAYOUT = Layout(RUN.run)
    DATA_ROOT = os.path.expanduser(os.environ.get("MODLHMP_DATA") or RUN.data_root)
    DATASETS = load_datasets(RUN, DATASET_FOLDERS, DATA_ROOT, LAYOUT.demo)
    if workflow.is_main_process:  # jobs read their own
        check_maps(RUN, DATASETS, DATA_ROOT)
except DataError as error:
    raise WorkflowError(f"\n{error}") from None
PLAN = Plan(RUN, LAYOUT, DATASETS)
config.update(as_plain(RUN))  # with the defaults, for the report's pages

# Held by every process of a run until it ends, so that `make unlock` knows whether one is at work.
LOCKED = running.join(os.getcwd())
if LOCKED and workflow.is_main_process and "--unlock" not in sys.argv:
    print(LOCKED, file=sys.stderr)


onstart:
    if hasattr(workflow.executor_settings, "status_command"):  # Slurm
        try:
            check_status_command(workflow.executor_settings.status_command)
            planned = workflow.dag.needrun_jobs()
            queued = {workflow.dag.get_job_group(job) or job for job in planned}
            check_queue(
                dict(job.resources.items()) for job in queued if not job.is_local
            )
        except DataError as error:
            raise WorkflowError(f"\n{error}") from None
    remove_leftovers(LAYOUT.results, LAYOUT.exhibits, LAYOUT.demo)
    # Its limit of jobs per second lets Snakemake look at all ready jobs again one second after every look, and once
    # more for every job that ends: hundreds of looks a second in the end. Cores limit local jobs already.
    if workflow.local_exec:
        workflow.scheduler.job_rate_limiter = None


onerror:
    for text in killed_jobs(log) + remedies(log):
        print(text, file=sys.stderr)


SEEDS = {name: RUN.kind(name).seeds(RUN.seeds) for name in RUN.methods_run}
NO_METHOD = "(?!)"  # a wildcard constraint that nothing matches


wildcard_constraints:
    dataset="|".join(map(re.escape, DATASETS)),
    method="|".join(map(re.escape, RUN.methods_run)),
    recording="[^/]+",
    label="[A-Za-z0-9_-]+",


def code_of(script, *modules):
    """Hash of the code that a script's result depends on: an edit reruns exactly the rules that use it."""
    return code_version(ROOT / f"workflow/scripts/{script}.py", *modules)


def method_code(script, *names):
    """The same for a script that uses these methods' maps, networks and forecasters."""
    return code_of(
        script, *sorted({code for name in names for code in RUN.kind(name).code})
    )


def tracks_of(split):
    """Input function: the clean recordings of a split."""
    return lambda wildcards: PLAN.tracks(wildcards.dataset, split)


def tracks_of_people(split):
    """Input function: a split's clean recordings, and those of everyone else who was there on their days."""
    return lambda wildcards: [
        LAYOUT.tracks(wildcards.dataset, name)
        for name in DATASETS[wildcards.dataset].people(split)
    ]


def names_of(split):
    """Parameter function: names of the recordings of a split."""
    return lambda wildcards: [
        one.name for one in DATASETS[wildcards.dataset].of_split(split)
    ]


def neighbours_of(split):
    """Parameter function: {recording of a split: the other recordings of its day}."""
    return lambda wildcards: {
        one.name: DATASETS[wildcards.dataset].same_day(one.name)
        for one in DATASETS[wildcards.dataset].of_split(split)
    }


def settings_of(*keys):
    """Parameter function: a dataset's settings of these keys."""
    return lambda wildcards: PLAN.settings_of(wildcards.dataset, keys)


def method_of(wildcards):
    """Parameter function: the method that the wildcards name, with what is tuned for the dataset."""
    return PLAN.method(wildcards.dataset, wildcards.method).plain()


def method_map(wildcards):
    """Input function: its map, if it has one."""
    return PLAN.map_of(wildcards.dataset, wildcards.method)


def method_exits(wildcards):
    """Input function: the ways out, if it uses them."""
    return PLAN.exits_of(wildcards.dataset, wildcards.method)


def files_of_recording(wildcards):
    """The file of a recording, or those of its people."""
    recording = DATASETS[wildcards.dataset].recording(wildcards.recording)
    return list(recording.people) or recording.stored


def shown_in(exhibit, wildcards):
    """The datasets that an exhibit shows."""
    return exhibit.shown(PLAN, wildcards.label if exhibit.per_dataset else None)


def flat(paths):
    """The paths of methods, of which some have none, each once."""
    return list(dict.fromkeys(path for path in paths if path))


def files_of(wanted):
    """All files of the exhibits that a run makes and a function (exhibit) wants."""
    return [
        file
        for exhibit in EXHIBITS
        if exhibit.made_in(PLAN) and wanted(exhibit)
        for file in exhibit.files(PLAN)
    ]
