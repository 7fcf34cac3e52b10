"""Every block of code in the pages runs as it stands, or is of a kind that says why it cannot.

`python` and `sh` run, those of a page one after the other in one folder; `yaml`, `toml` and `json` are read; `console`
is a transcript of what takes hours, a machine's own folders or somebody's recordings: what its commands name exists.
"""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import matplotlib as mpl
import numpy as np
import pytest
import tomllib
import yaml
from markdown_it import MarkdownIt

import modlhmp
from modlhmp import Site
from modlhmp.contract import crowd
from modlhmp.study.describe import commands
from modlhmp.tracks import write_tracks
from modlhmp.updates import UpdatedMap

ROOT = Path(__file__).parents[2]
PAGES = {
    page.relative_to(ROOT).as_posix(): page.read_text(encoding="utf-8")
    for page in [*sorted(ROOT.glob("docs/*.md")), *ROOT.glob("*/README.md")]
}
ELSEWHERE = {  # pages whose blocks run in a test of their own
    "docs/extending.md": "tests/unit/test_contract.py",
    "docs/library.md": "tests/unit/test_readme.py",
    "docs/your-predictor.md": "tests/workflow/test_hand_in.py",
}
KINDS = {"python", "sh", "yaml", "toml", "json", "console", "text", "{eval-rst}", "{toctree}"}
BLOCKS = {
    name: [(one.info, one.content) for one in MarkdownIt().parse(text) if one.type in ("fence", "code_block")]
    for name, text in PAGES.items()
}
RUNS = [name for name, found in BLOCKS.items() if name not in ELSEWHERE and {"python", "sh"} & {k for k, _ in found}]
T0 = 1351040400.0  # 10 h in Tokyo, 24 October 2012
TOKYO = Site(timezone="Asia/Tokyo", horizon_s=10)


@pytest.mark.parametrize("name", PAGES)
def test_every_block_has_a_kind(name):
    """Blocks by indentation alone have none."""
    assert {kind for kind, _ in BLOCKS[name]} <= KINDS


@pytest.mark.parametrize("name", PAGES)
def test_data_in_the_pages_is_well_formed(name):
    for kind, code in BLOCKS[name]:
        if kind in ("yaml", "json", "toml"):
            assert {"yaml": yaml.safe_load, "json": json.loads, "toml": tomllib.loads}[kind](code)


@pytest.mark.parametrize("name", PAGES)
def test_commands_are_blocks(name):
    """In a paragraph their dashes and line ends are lost."""
    prose = [one.content for one in MarkdownIt().parse(PAGES[name]) if one.type == "inline"]
    assert not [text for text in prose if re.search(r" --\w", re.sub(r"`[^`]*`", "", text))]


@pytest.mark.parametrize("name", ELSEWHERE)
def test_the_other_tests_are_there(name):
    assert name in (ROOT / ELSEWHERE[name]).read_text()


@pytest.fixture(autouse=True)
def no_recordings(monkeypatch):
    """Pages speak to somebody whose recordings lie where the page says."""
    monkeypatch.delenv("MODLHMP_DATA", raising=False)


# --- what runs ------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def world(tmp_path_factory):
    """A folder with what pages take for granted: two days of people in a corridor, and maps of them."""
    folder = tmp_path_factory.mktemp("world")
    people = crowd(people=40, apart_s=4)
    monday = people._replace(t=people.t - people.t[0] + T0 - 60)
    tuesday = monday._replace(t=monday.t + 86400, y=monday.y + 0.1)
    write_tracks(monday, folder / "monday.parquet")
    write_tracks(tuesday, folder / "tuesday.parquet")
    rows = "".join(f"{n},{t:.0f},{x:.3f},{y:.3f}\n" for n, t, x, y, *_ in zip(*monday, strict=True))
    (folder / "monday.csv").write_text("track_id,t,x,y\n" + rows)
    made = {kind: modlhmp.build_map(kind, monday, TOKYO) for kind in ("cliff", "tc_cliff", "episodes")}
    made["cliff"].save(folder / "atc-20121024-cliff.csv", form="matlab")
    made["episodes"].save(folder / "hall.parquet")
    made["episodes"].save(folder / "episodes.parquet")
    maps = folder / "results/demo/demo_hall/maps"
    made["episodes"].save(maps / "episodes.parquet")
    made["tc_cliff"].save(maps / "tc_cliff")
    (folder / "atc.pgm").write_bytes(b"P5 40 8 255\n" + bytes([254]) * 320)
    plan = "image: atc.pgm\nresolution: 1.0\norigin: [-20, -4, 0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.2\n"
    (folder / "atc.yaml").write_text(plan)
    other = UpdatedMap("cliff", TOKYO)
    other.add(tuesday, "tuesday")
    other.save(folder / "robot-2.state.parquet")
    return SimpleNamespace(folder=folder, monday=monday, tuesday=tuesday, maps=made)


def given(name, world):
    """The names that a page uses and does not make."""
    history, track = world.monday.seen_by(T0, rows=4), world.monday.take(world.monday.track_id == 3)
    some = np.flatnonzero(np.isfinite(world.monday.speed))[:50]
    x, y, t, heading, speed = (getattr(world.monday, one)[some] for one in ("x", "y", "t", "heading", "speed"))
    tracker = sorted((t, int(n), x, y) for n, t, x, y, *_ in zip(*history, strict=True))
    return {
        "docs/live.md": {"tracker": tracker, "a_map": world.maps["episodes"], "track": track},
        "docs/maps.md": {"history": history, "a_map": world.maps["cliff"]},
        "docs/maps-with-memory.md": {"modlhmp": modlhmp, "history": history, "a_map": world.maps["episodes"]},
        "docs/updated-maps.md": {"monday": world.monday, "tuesday_morning": world.tuesday, "history": history},
        "docs/which-map-is-true.md": {
            "training": world.monday, "site": TOKYO, "x": x, "y": y, "t": t, "heading": heading, "speed": speed
        },
    }.get(name, {})  # fmt: skip


@pytest.mark.parametrize("name", RUNS)
def test_the_blocks_run(name, world, tmp_path, monkeypatch):
    shutil.copytree(world.folder, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    if name == "docs/live.md":
        held = UpdatedMap("episodes", TOKYO)
        held.add(world.monday, "monday")
        held.save("hall.state.parquet")
    names = {"__name__": "page", **given(name, world)}
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    with mpl.rc_context({"backend": "agg"}):
        for kind, code in BLOCKS[name]:
            if kind == "python":
                exec(compile(code, name, "exec"), names)
            elif kind == "sh":
                done = subprocess.run(
                    ["bash", "-euo", "pipefail", "-c", code], env={**os.environ, "PATH": path},
                    capture_output=True, text=True, timeout=300, check=False,
                )  # fmt: skip
                assert done.returncode == 0, f"{code}\n{done.stderr}"


# --- what does not --------------------------------------------------------------------------------------------------


def not_run():
    """(page, command) of every line of a transcript, those that go on put together."""
    for name in PAGES:
        for kind, code in BLOCKS[name]:
            if kind == "console":
                lines = code.replace("\\\n", " ").splitlines()
                yield from ((name, line.removeprefix("$ ")) for line in lines if line.startswith("$ "))


def test_transcripts_begin_their_commands_with_a_dollar():
    for name in PAGES:
        for kind, code in BLOCKS[name]:
            assert kind != "console" or code.startswith("$ "), (name, code)


def test_what_transcripts_name_exists():
    """Targets of make, verbs of the command, files of the configuration, of the tests and of the benchmarks."""
    targets = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE))
    verbs = set(re.findall(r"^### (modlhmp .+)$", commands(), re.MULTILINE))
    seen = set()
    for name, command in not_run():
        for file in re.findall(r"(?<![\w/.])(?:config|tests|benchmarks|notebooks)/[\w./-]+\.\w+", command):
            assert (ROOT / file).exists() or file == "config/datasets/monday.yaml", (name, command)
        if made := re.search(r"(?:^|[|] )make ([a-z-]+)", command):
            assert made[1] in targets, (name, command)
        if verb := re.search(r"(?:^|[|] )(modlhmp (?:map )?[a-z-]+)", command):
            assert verb[1] in verbs, (name, command)
        seen.add(command.split()[0])
    assert {"make", "modlhmp", "snakemake"} <= seen


def test_the_study_of_the_tutorial_is_planned(tmp_path, monkeypatch):
    """Its last commands, of the draft as it stands there; its jobs are those of any recording."""
    (draft,) = (code for kind, code in BLOCKS["docs/tutorial.md"] if kind == "yaml")
    make, *_ = (code for kind, code in BLOCKS["docs/tutorial.md"] if kind == "python")
    for name in ("workflow", "profiles", "Snakefile"):
        (tmp_path / name).symlink_to(ROOT / name)
    shutil.copytree(ROOT / "config", tmp_path / "config")
    monkeypatch.chdir(tmp_path)
    exec(make, {})
    Path("monday.yaml").write_text(draft)
    (lines,) = (code for kind, code in BLOCKS["docs/tutorial.md"] if kind == "console")
    copy, run = (line.removeprefix("$ ") for line in lines.splitlines())
    assert run.startswith(".venv/bin/snakemake ")
    code = f"{copy}\n{sys.executable} -m {run.removeprefix('.venv/bin/')} -n"
    done = subprocess.run(["bash", "-ec", code], capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "Clean monday" in done.stdout and "paper_figures/mine" in done.stdout


def test_the_draft_of_the_tutorial_is_what_inspect_writes(tmp_path, monkeypatch):
    (draft,) = (code for kind, code in BLOCKS["docs/tutorial.md"] if kind == "yaml")
    make, *_ = (code for kind, code in BLOCKS["docs/tutorial.md"] if kind == "python")
    monkeypatch.chdir(tmp_path)
    exec(make, {})
    done = subprocess.run(
        [sys.executable, "-m", "modlhmp.cli", "inspect", "data/monday.csv"], capture_output=True, text=True, check=True
    )
    assert yaml.safe_load(done.stdout) == yaml.safe_load(draft)
