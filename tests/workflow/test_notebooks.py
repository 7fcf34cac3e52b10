"""The notebooks run from top to bottom on the demo, and are stored without outputs."""

import json
import os
import shutil
import subprocess
import sys

import pytest
from project import ROOT

pytestmark = pytest.mark.xdist_group("tiny")
NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))
FACTS = {  # what each must have printed
    "01": ("bad rows planted", "longest gap inside a track"),
    "02": ("rebuilt exactly as stored", "integral over the cylinder"),
    "03": ("spectra are rebuilt exactly as stored", "hours checked against the stored maps"),
    "04": ("the same to the last bit",),
    "05": ("A = tiny, B = other",),
}


def test_they_are_stored_without_outputs():
    """Nor execution counts: a notebook in the repository shows nobody's data."""
    assert [notebook.name[:2] for notebook in NOTEBOOKS] == list(FACTS)
    for notebook in NOTEBOOKS:
        content = json.loads(notebook.read_text())
        assert content["metadata"]["kernelspec"]["name"] == "python3"
        for cell in content["cells"]:
            assert not cell.get("outputs"), notebook
            assert cell.get("execution_count") is None, notebook


def test_they_run_on_the_demo(tiny_run):
    """On the tiny run, and a second one of another seed for the comparison; every picture drawn, no error shown."""
    (tiny_run.folder / "other.yaml").write_text("run: other\nseeds: [7]\n")
    overlays = ("--configfile", "config/tiny.yaml", "other.yaml")
    tiny_run.snakemake("--cores", 2, *overlays, "--", "paper_figures/other/results.csv")
    copies = shutil.copytree(ROOT / "notebooks", tiny_run.folder / "notebooks", dirs_exist_ok=True)
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "--nbmake", "--overwrite", "-p", "no:cacheprovider", "--rootdir", ".", "-q",
         *(copies / notebook.name for notebook in NOTEBOOKS)],
        cwd=tiny_run.folder,
        env={**os.environ, "MODLHMP_RUN": "tiny", "MODLHMP_RUN_B": "other"},
        capture_output=True, text=True, timeout=900, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout[-5000:]
    for number, facts in FACTS.items():
        (notebook,) = copies.glob(f"{number}-*.ipynb")
        outputs = [o for cell in json.loads(notebook.read_text())["cells"] for o in cell.get("outputs", [])]
        assert not [o for o in outputs if o["output_type"] == "error"], notebook
        pictures = sum("image/png" in o.get("data", {}) for o in outputs)
        sources = "".join("".join(cell["source"]) for cell in json.loads(notebook.read_text())["cells"])
        assert pictures == sources.count("plt.show()") >= 2, notebook
        printed = "".join("".join(o.get("text", "")) for o in outputs)
        assert all(fact in printed for fact in facts), printed
        assert "Demo data" in printed or number == "05", notebook
