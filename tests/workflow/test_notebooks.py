"""The notebooks run from top to bottom on the demo, and are stored without outputs."""

import json
import os
import shutil
import subprocess
import sys

import matplotlib as mpl
import pytest
from project import ROOT

NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))
FACTS = {  # what each must have printed
    "01": ("bad tracks planted in tiny were found, and no others",),
    "02": ("the location is rebuilt exactly as stored", "integral over the cylinder: 1.0"),
    "03": ("spectra are rebuilt exactly as stored", "hours checked against the stored maps"),
    "04": (
        "steps by hand are those of the stored forecast",
        "the roll-out is the stored forecast, the same to the last bit",
        "these errors are those of the errors file, under both protocols",
    ),
    "05": ("A = tiny, B = other", "demo_hall: the same raw recordings", "40 differences of 1 datasets"),
    "06": ("the order was found: matlab", "walks are forecast with it", "one way and"),
    "07": ("72 of 72 tracks have a forecast", "rows of CVM, handed in, are those of the run to the bit"),
    "05-itself": (
        "A = tiny, B = tiny",
        "480 differences of 2 datasets",
        "snakemake --cores 2 --configfile",
        "all differences are 0 by construction",
    ),
    "08": (
        "the batch forecast is the live one, the same to the last bit",
        "the cells are read back as they were written",
    ),
}


def code_of(notebook):
    """Sources of the code cells."""
    cells = json.loads(notebook.read_text())["cells"]
    return ["".join(cell["source"]) for cell in cells if cell["cell_type"] == "code"]


def test_they_are_stored_without_outputs():
    """Nor execution counts: a notebook in the repository shows nobody's data."""
    assert [notebook.name[:2] for notebook in NOTEBOOKS] == [name for name in FACTS if len(name) == 2]
    for notebook in NOTEBOOKS:
        content = json.loads(notebook.read_text())
        assert content["metadata"]["kernelspec"]["name"] == "python3"
        for cell in content["cells"]:
            assert not cell.get("outputs"), notebook
            assert cell.get("execution_count") is None, notebook


@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda notebook: notebook.stem[:2])
def test_a_run_that_is_not_there(notebook, tmp_path, monkeypatch):
    """The first cell names the folder and the command that makes it."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MODLHMP_RUN", "nowhere")
    setup = code_of(notebook)[0].replace("%matplotlib inline", "")
    with mpl.rc_context(), pytest.raises(FileNotFoundError) as error:
        exec(setup, {})
    assert "results/nowhere" in str(error.value)
    assert "snakemake --cores 2 --configfile config/nowhere.yaml" in str(error.value)


def test_the_loop_as_a_script(tiny_run):
    """A robot waits for somebody and goes on, in the busiest minutes of a recording."""
    hall = tiny_run.folder / "results/tiny/demo_hall"
    done = subprocess.run(
        [sys.executable, ROOT / "notebooks/forecast_in_a_loop.py", hall / "maps/episodes.parquet",
         sorted(hall.glob("tracks/*.parquet"))[-1]],
        cwd=tiny_run.folder, capture_output=True, text=True, timeout=300, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    *events, last = done.stdout.splitlines()
    assert [line.rpartition(": ")[2] for line in events[:2]] == ["wait", "go on"]
    assert "moments" in last


def test_they_run_on_the_demo(tiny_run):
    """On the tiny run, and a small one of another seed for the comparison; the pictures drawn, the facts printed."""
    (tiny_run.folder / "other.yaml").write_text(
        "run: other\nseeds: [7]\ndatasets: [demo_hall]\ncompare: [tc_cliff, cvm]\ncomparisons: []\n"
    )
    overlays = ("--configfile", "config/tiny.yaml", "other.yaml")
    tiny_run.snakemake("--cores", 2, *overlays, "--", "paper_figures/other/results.csv")
    copies = tiny_run.folder / "notebooks"
    shutil.copytree(ROOT / "notebooks", copies, dirs_exist_ok=True)
    (comparison,) = copies.glob("05-*.ipynb")
    with_itself = json.loads(comparison.read_text())
    choice = 'import os\n\nos.environ["MODLHMP_RUN_B"] = "tiny"'
    cell = {"cell_type": "code", "execution_count": None, "id": "choice", "metadata": {}, "outputs": []}
    with_itself["cells"].insert(0, {**cell, "source": [choice]})
    (copies / "05-itself.ipynb").write_text(json.dumps(with_itself))

    environment = {name: value for name, value in os.environ.items() if not name.startswith("PYTEST_")}
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "--nbmake", "--overwrite", "-n", "2", "-p", "no:cacheprovider",
         "--rootdir", ".", "-q", "notebooks"],
        cwd=tiny_run.folder,
        env={**environment, "MODLHMP_RUN": "tiny", "MODLHMP_RUN_B": "other"},
        capture_output=True, text=True, timeout=900, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout[-5000:]
    for name, facts in FACTS.items():
        notebook = next(file for file in sorted(copies.glob("*.ipynb")) if file.stem.startswith(name))
        outputs = [o for cell in json.loads(notebook.read_text())["cells"] for o in cell.get("outputs", [])]
        assert not [o for o in outputs if o["output_type"] == "error"], notebook
        pictures = sum("image/png" in o.get("data", {}) for o in outputs)
        assert pictures >= sum(code.count("plt.show()") for code in code_of(notebook)) >= 3, notebook
        printed = "".join("".join(o.get("text", "")) for o in outputs)
        assert "Demo data" in printed, notebook
        assert all(fact in printed for fact in facts), printed
