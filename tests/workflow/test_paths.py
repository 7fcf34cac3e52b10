"""Recordings and configurations wherever they lie, and whatever they are called: found, or refused by name."""

import os
import zlib

import pytest
import yaml

DATASET = {
    "title": "Own", "reader": "delimited", "timezone": "Europe/London", "horizon_s": 10, "velocity": "differences",
    "columns": {"t": 0, "track_id": 1, "x": 2, "y": 3}, "citation": "made up", "terms": "free",
}  # fmt: skip
RUN = {
    "run": "own", "datasets": ["own"], "data_root": "recordings", "seeds": [0], "compare": ["cvm"], "comparisons": [],
    "studies": {"beta": [], "sampling_radius_m": []},
}  # fmt: skip
ERRORS = ("--configfile", "own.yaml", "--", "results/own/own/errors/cvm.parquet")
PLAN = ("-n", "--quiet", "rules", *ERRORS)


def walks(folder, *files):
    """Write recordings of three people who walk straight on, at a pace that depends on the file's name."""
    for file in files:
        pace = 1 + zlib.crc32(os.fsencode(file)) % 1000 / 1000
        lines = [f"{k + person},{person},{pace * k:.3f},{person}\n" for person in range(3) for k in range(30)]
        (folder / file).parent.mkdir(parents=True, exist_ok=True)
        (folder / file).write_text("".join(lines))


def describe(project, *files, **run):
    """Write a run whose dataset trains with the first file and tests with the others."""
    entries = [
        {"files": file, "day": f"2010-07-{day + 1:02}", "start": "09:00", "split": "test" if day else "train"}
        for day, file in enumerate(files)
    ]
    dataset = project.folder / "config/datasets/own.yaml"
    dataset.write_text(yaml.safe_dump({**DATASET, "recordings": entries}))
    (project.folder / "own.yaml").write_text(yaml.safe_dump({**RUN, **run}))


@pytest.fixture
def own(project):
    """A project with two recordings."""
    walks(project.folder / "recordings", "a.csv", "b.csv")
    describe(project, "a.csv", "b.csv")
    return project


NAMES = [
    "a b, día $(touch PWNED).csv", "-rf;&|`x`.csv", "star*[1]?.csv", "100% back\\slash#=:@~.csv", ".q'u\"o.csv",
    "日曜.csv",
]  # fmt: skip


def test_names_that_shells_would_not_like(project):
    """From the recordings to their errors; two days of one name live together."""
    folder = "my recordings, 100%/día"
    walks(project.folder / folder, "a.csv", *NAMES)
    walks(project.folder / folder, "1/tracks.csv", "2/tracks.csv")
    describe(project, "a.csv", *NAMES, "[12]/tracks.csv", data_root=folder)
    project.snakemake("--cores", 2, *ERRORS)
    made = {file.name for file in (project.folder / "results/own/own/tracks").glob("*.parquet")}
    stems = [*(name.removesuffix(".csv") for name in NAMES), "1.tracks", "2.tracks"]
    assert made == {f"{stem}.parquet" for stem in stems}
    assert not list(project.folder.rglob("PWNED"))


def test_a_name_that_snakemake_cannot_take_is_refused(own):
    """By name; `test_run_settings` has the others."""
    walks(own.folder / "recordings", "{x}.csv")
    describe(own, "a.csv", "{x}.csv")
    output = own.snakemake(*PLAN, fails=True)
    assert "own.yaml: 'recordings/{x}.csv': Snakemake cannot take the character '{' in a path; rename" in output
    assert "Traceback" not in output


def test_a_copy_is_refused(own):
    (own.folder / "recordings/b.csv").write_bytes((own.folder / "recordings/a.csv").read_bytes())
    output = own.snakemake(*PLAN, fails=True)
    assert "own.yaml: recordings: a.csv and b.csv hold the same bytes" in output
    assert "Traceback" not in output


@pytest.mark.parametrize("by", ["data_root", "MODLHMP_DATA"])
def test_a_tilde_is_the_home_folder(own, by):
    home = own.folder / "home"
    walks(home / "walks", "a.csv", "b.csv")
    describe(own, "a.csv", "b.csv", data_root="~/walks" if by == "data_root" else "nowhere")
    environment = {"HOME": str(home), **({"MODLHMP_DATA": "~/walks"} if by == "MODLHMP_DATA" else {})}
    output = own.snakemake(*PLAN, **environment)
    assert "clean_recording" in output
    assert "fetch_recording" not in output


@pytest.mark.parametrize("way", ["-d", "-s"])
def test_the_configuration_goes_with_the_project(own, way):
    """In another folder, which gets the results, as well: paths are of that folder, as is a configuration in it."""
    other = own.folder / "other"
    walks(other / "recordings", "a.csv", "b.csv")
    (own.folder / "own.yaml").rename(other / "own.yaml")
    where = {"-d": ("-d", "other", "--configfile", "other/own.yaml"), "-s": ("-s", "../Snakefile", *ERRORS[:2])}[way]
    if way == "-s":
        own.folder = other
    arguments = ("--cores", 1, *where, "--", "results/own/own/tracks/b.parquet")
    # Without the project's configuration there would be no methods but kinds.
    (other / "own.yaml").write_text(yaml.safe_dump({**RUN, "compare": ["cvm_clean"]}))
    own.snakemake(*arguments)
    assert (other / "results/own/own/tracks/b.parquet").exists()
    (other / "config/datasets").mkdir(parents=True)
    (other / "config/datasets/own.yaml").write_text("reader: none\n")  # before the project's file of this name
    assert "config/datasets/own.yaml:\n  reader: 'none'" in own.snakemake(*arguments, fails=True)
    (other / "config/datasets/own.yaml").unlink()
    (other / "config/config.yaml").write_text("methods: {mine: {kind: cvm}}\n")
    output = own.snakemake(*arguments, fails=True)
    assert "no method named 'cvm_clean'" in output


def test_a_configuration_that_is_gone_is_named(own):
    """Not silently done without, as Snakemake does where `--configfile` is given."""
    (own.folder / "config/config.yaml").unlink()
    output = own.snakemake(*PLAN, fails=True)
    assert "config/config.yaml: cannot be read (No such file or directory)" in output
