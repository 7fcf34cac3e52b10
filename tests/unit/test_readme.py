"""The README's lines run as they stand, and what it leads to is there."""

import re
from pathlib import Path

import numpy as np
import pytest
import tomllib

from modlhmp.contract import crowd

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md")), ROOT / "config/README.md",
         ROOT / "paper_figures/README.md", ROOT / "notebooks/README.md"]  # fmt: skip

TEMPLATES = sorted((ROOT / "docs/templates").glob("*.md"))
MADE = {"licences.md", *(one.name for one in TEMPLATES)}
WRITTEN = [ROOT / "CHANGELOG.md", *TEMPLATES, *(one for one in PAGES if one.name not in MADE or one.parent.name in
           {"config", "paper_figures", "notebooks"})]  # fmt: skip


@pytest.fixture
def monday(tmp_path, monkeypatch):
    """A folder with the README's recording: people in a corridor who come from 985 s to 1001 s on, times in ms."""
    people = crowd(people=40)
    came = np.repeat(people.t[people.bounds()[:-1]], np.diff(people.bounds()))
    people = people._replace(t=people.t - came + 985 + people.track_id % 17)
    lines = [f"{p},{1000 * t:.0f},{x:.3f},{y:.3f}" for p, t, x, y, *_ in zip(*people, strict=True)]
    (tmp_path / "monday.csv").write_text("\n".join(["person,time,x,y", *lines]))
    monkeypatch.chdir(tmp_path)
    return people


def test_the_lines_of_the_library_run(monday, capsys):
    (short,) = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(), re.DOTALL)
    assert len([line for line in short.splitlines() if line]) == 10
    code, stream = re.findall(r"```python\n(.*?)```", (ROOT / "docs/library.md").read_text(), re.DOTALL)
    names, ten = {}, {}
    exec(code, names)
    exec(short, ten)
    np.testing.assert_array_equal(ten["futures"].best, names["futures"].best)
    tracks, futures = names["tracks"], names["futures"]
    assert len(np.unique(tracks.track_id)) == 40
    assert futures.best.shape == (len(futures.track_id), 10, 2)
    assert futures.density(at_s=5, cell_m=0.5).probabilities.sum() == pytest.approx(1)
    scored = names["modlhmp"].score(futures, tracks).at(5)
    assert scored["n"] > 0 and scored["ade_m"] < 0.5
    assert str(scored) in capsys.readouterr().out
    exec(stream, names)
    assert names["futures"].t0.tolist() == [names["live"].now] * len(names["futures"].t0)
    assert names["p"].ndim == 3
    assert 0 < names["p"][0].sum() <= len(names["futures"].t0) + 1e-3


def test_the_readme_is_one_screen_with_one_picture_and_one_result():
    """Nothing is loaded from elsewhere; the picture has words for those who do not see it, and its own ground."""
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    assert len(text.splitlines()) <= 70 and len(text.encode()) <= 4096
    ((words, picture),) = re.findall(r"!\[(.*?)\]\((.*?)\)", text)
    assert len(words) > 40 and not re.search(r"]\(https?:", text)
    drawn = (ROOT / picture).read_text(encoding="utf-8")
    assert "<title" in drawn and re.search(r'<rect width="\d+" height="\d+" rx="8" fill="#ffffff"/>', drawn)
    assert text.count(" of 344 |") == 3 and "our split" in text


def test_the_outside_package_of_the_docs_is_laid_out_like_the_one_that_is_tested():
    """Its pyproject.toml, but for names; and its module is Python."""
    python, toml = re.findall(r"```(?:python|toml)\n(.*?)```", (ROOT / "docs/extending.md").read_text(), re.DOTALL)[:2]
    shown = tomllib.loads(toml)
    tested = tomllib.loads((ROOT / "tests/outside/walking/pyproject.toml").read_text())
    tested["project"]["name"], tested["tool"]["setuptools"]["py-modules"] = "mymaps", ["mymaps"]
    tested["project"]["entry-points"]["modlhmp.kinds"] = {"mine": "mymaps:KIND"}
    assert shown == tested
    names = {"__name__": "mymaps"}
    exec(python, names)
    assert names["KIND"].name == "mine" and names["KIND"].sampled


@pytest.mark.parametrize("page", WRITTEN, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_lines_of_prose_have_at_most_120_characters(page):
    """Tables, pictures, code, formulas and what asks for numbers are as long as they are."""
    text = page.read_text(encoding="utf-8")
    for block in (r"^( *)```.*?^\1```", r"^\$\$.*?\$\$$"):
        text = re.sub(block, "", text, flags=re.DOTALL | re.MULTILINE)
    assert [one for one in text.splitlines() if len(one) > 120 and not re.match(r" *[|!#<{]|.*\{\{", one)] == []


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_links_and_files_exist(page):
    """Relative links, and every path of the repository that stands in backticks."""
    text = page.read_text(encoding="utf-8")
    for link in re.findall(r"\]\(([^)#]+?)(?:#[^)]*)?\)", text):
        assert link.startswith("http") or (page.parent / link).exists(), link
    for path in re.findall(r"`((?:src|tests|workflow|config|docs|benchmarks)/[\w./-]+\.\w+)(?::\d+)?`", text):
        assert (ROOT / path).exists(), path
    for module in re.findall(r"`(modlhmp(?:\.[a-z_]+)+)(?:\.[A-Z_]\w*|\(\))?`", text):
        parts = module.split(".")
        homes = [ROOT.joinpath("src", *parts[:end]) for end in range(len(parts), 0, -1)]
        assert any(home.with_suffix(".py").exists() or (home / "__init__.py").exists() for home in homes[:2]), module
