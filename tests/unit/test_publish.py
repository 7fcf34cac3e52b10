"""The published numbers: what is collected from a run, what a template may ask for, and that the pages are fresh."""

import json
import re
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pytest

from modlhmp.scoring.protocols import PROTOCOLS
from modlhmp.storage import DataError, write_parquet
from modlhmp.study import publish
from modlhmp.study.ladder import DIFFERENCES
from modlhmp.study.layout import Layout
from modlhmp.study.summary import COLUMNS

# A decimal in prose that is no constant of the study has to come from the numbers.
DECIMAL = re.compile(r"(?<![\w.`/-])[+-]?\d+\.\d+(?![\w`/])")
MADE = re.compile(
    r"\{\{.*?\}\}|\{%.*?%\}|\{#.*?#\}|```.*?```|`[^`\n]*`|\]\([^)]*\)|^    .*?$", re.DOTALL | re.MULTILINE
)
CONSTANTS = re.compile(r"\{#\s*constants:(.*?)#\}", re.DOTALL)
TWO_RUNS = (
    "{{ errors('demo', 'hall', 'complete', 5, 'cliff') }} at {{ commit('demo') }}, "
    "{{ errors('real', 'hall', 'complete', 5, 'cliff') }} at {{ commit('real') }}\n"
)


@pytest.fixture
def numbers(tmp_path):
    """Of a run with two methods, a pair and a table."""
    layout = Layout("real", str(tmp_path))
    rows = [
        dict.fromkeys(COLUMNS, float("nan"))
        | {"dataset": "hall", "method": method, "output": output, "protocol": protocol, "horizon_s": horizon}
        | {"ade_m": ade + horizon / 10, "fde_m": 2 * ade, "n": 861.4, "eligible": 1378, "ade_seed_sd_m": 0.0312345678}
        for method, output, ade in (("cliff", "ranked", 1.0), ("cliff", "mean", 9.0), ("cvm", "single", 2.0))
        for protocol in PROTOCOLS
        for horizon in (1.0, 5.0, 60.0)
    ]
    Path(layout.scores).parent.mkdir(parents=True)
    pd.DataFrame(rows, columns=COLUMNS).to_csv(layout.scores, index=False)
    pair = ("hall", "complete", 5.0, "ade", "cliff", "cvm", 100.0, -0.3612, -0.551, -0.18, -26.4, 3)
    Path(layout.ladder("hall", "differences")).parent.mkdir(parents=True)
    same = ("hall", "complete", 5.0, "ade", "cvm", "cvm", 100.0, 0.0, np.nan, np.nan, 0.0, 0)
    pairs = [dict(zip(DIFFERENCES, values, strict=True)) for values in (pair, same)]
    write_parquet(pa.Table.from_pylist(pairs), layout.ladder("hall", "differences"))
    rung = {"dataset": "hall", "protocol": "complete", "horizon_s": 5.0, "ade_m": 7.0, "fde_m": 8.0, "n": 100.0,
            "eligible": 100}  # fmt: skip
    write_parquet(pa.Table.from_pylist([rung | {"method": method} for method in ("tc_clean", "cvm")]),
                  layout.ladder("hall", "scores"))  # fmt: skip
    table = pd.DataFrame({"claim": ["a", "b"], "dataset": ["Hall", "Forum"], "verdict": ["supported", "–"]})
    table.to_csv(f"{layout.exhibit('claims')}.csv", index=False)
    return publish.collect(["real"], "abc123", str(tmp_path))


def test_a_template_gets_what_it_asks_for(numbers):
    numbers = json.loads(json.dumps(numbers))
    page = publish.render(
        "{{ errors('real', 'hall', 'complete', 5, 'cliff') }} ({{ scored('real', 'hall', 'paper', 60, 'cvm') }}), "
        "{{ less('real', 'hall', 'complete', 5, 'ade', 'cliff', 'cvm') }}, "
        "{{ percent('real', 'hall', 'complete', 5, 'ade', 'cliff', 'cvm') }} at {{ commit('real') }}\n"
        "{{ table('real', 'claims', ['claim', 'verdict'], dataset='Hall') }}\n",
        numbers,
    )
    assert page == (
        "1.50 / 2.00 (861.4 of 1,378), -0.36 m (-0.55 to -0.18, 3 not forecast), -26 % at abc123\n"
        "| claim | verdict |\n| --- | --- |\n| a | supported |\n"
    )


def test_a_bar_in_a_cell_ends_none(numbers):
    numbers["runs"]["real"]["tables"]["claims"]["rows"][0][0] = "a|b"
    page = publish.render("{{ table('real', 'claims', ['claim', 'verdict'], dataset='Hall') }}", numbers)
    assert page.splitlines()[-1] == r"| a\|b | supported |"


def test_methods_that_only_the_ladder_compares_have_scores(numbers):
    page = publish.render("{{ results('real', 'hall', 'complete', [5], 'tc_clean', 'cvm') }}", numbers)
    assert page.splitlines()[2:] == [
        "| TC-CLiFF, positions | 7.000 / 8.000 (100 of 100) |",
        "| CVM | 2.500 ±0.03 / 4.000 (861.4 of 1,378) |",
    ]


def test_a_table_of_results_has_titles_spread_and_n(numbers):
    page = publish.render("{{ results('real', 'hall', 'paper', [5, 60], 'cliff', 'cvm') }}", numbers)
    assert page.splitlines() == [
        "| method | 5 s | 60 s |",
        "| --- | --- | --- |",
        "| CLiFF | 1.500 ±0.03 / 2.000 (861.4 of 1,378) | 7.000 ±0.03 / 2.000 (861.4 of 1,378) |",
        "| CVM | 2.500 ±0.03 / 4.000 (861.4 of 1,378) | 8.000 ±0.03 / 4.000 (861.4 of 1,378) |",
    ]
    assert publish.render("{{ walls('real', 'hall', 'paper', 5, 'cvm') }}", numbers) == "no plan"
    everyone = publish.render("{{ results('real', 'hall', 'complete', [5]) }}", numbers)
    assert [line.split("|")[1].strip() for line in everyone.splitlines()[2:]] == ["TC-CLiFF, positions", "CLiFF", "CVM"]
    assert publish.render("{{ less('real', 'hall', 'complete', 5, 'ade', 'cvm', 'cvm') }}", numbers) == (
        "+0.00 m (no interval)"
    )


def test_only_what_templates_ask_for_is_kept(numbers):
    template = (
        "{{ errors('real', 'hall', 'complete', 5, 'cliff') }} {{ results('real', 'hall', 'paper', [60], 'cvm') }}"
    )
    kept = publish.asked_for([template], numbers)
    assert list(kept["runs"]["real"]["scores"]) == ["hall/complete/5/cliff", "hall/paper/60/cvm"]
    assert not kept["runs"]["real"]["tables"]
    assert publish.render(template, kept) == publish.render(template, numbers)


@pytest.mark.parametrize(
    ("asked", "message"),
    [
        ("errors('real', 'hall', 'complete', 7, 'cliff')", "no number hall/complete/7/cliff among the scores"),
        ("errors('reel', 'hall', 'complete', 5, 'cliff')", "no run 'reel' among the numbers; there are real"),
        ("less('real', 'hall', 'complete', 5, 'ade', 'cvm', 'cliff')", "no number hall/complete/5/ade/cvm/cliff"),
        ("table('real', 'tab_expres')", "no number tab_expres among the tables"),
        ("table('real', 'claims', ['p'])", "has no column 'p'"),
        ("table('real', 'claims', dataset='Yard')", "has no row with"),
    ],
)
def test_a_number_that_no_run_makes_fails(numbers, asked, message):
    with pytest.raises(DataError, match=message):
        publish.render("{{ " + asked + " }}", numbers)


def test_a_run_that_was_not_made_is_named(tmp_path):
    with pytest.raises(DataError, match=r"make the run first: .*config/lab/ladder\.yaml"):
        publish.collect(["ladder"], "abc123", str(tmp_path))


def test_a_run_that_is_made_anew_leaves_the_others_and_their_commits(numbers, tmp_path, monkeypatch):
    old = json.loads(json.dumps(numbers))
    old["runs"]["demo"] = {**old["runs"]["real"], "commit": "older"}
    monkeypatch.setattr(publish, "ROOT", tmp_path)  # where the fixture's run lies
    monkeypatch.setattr(publish, "NUMBERS", tmp_path / "numbers.json")
    monkeypatch.setattr(publish, "templates", lambda: {tmp_path / "page.md": TWO_RUNS})
    monkeypatch.setattr(publish, "_commit", lambda: "newer")
    monkeypatch.setattr(publish, "titles", lambda run: {})
    monkeypatch.setattr(publish.sys, "argv", ["publish", "real"])
    publish.NUMBERS.write_text(json.dumps(old))
    publish.main()
    assert (tmp_path / "page.md").read_text() == "1.50 / 2.00 at older, 1.50 / 2.00 at newer\n"
    monkeypatch.setattr(publish.sys, "argv", ["publish", "reel"])
    with pytest.raises(DataError, match="no published run 'reel'; there are demo, real"):
        publish.main()


def unmade(template: str) -> list[str]:
    """Decimals in a template's prose that no run makes: all but those of its comment `{# constants: 0.3 0.05 #}`."""
    constants = {word for text in CONSTANTS.findall(template) for word in text.split()}
    return [found for found in DECIMAL.findall(MADE.sub(" ", template)) if found.lstrip("+-") not in constants]


def test_decimals_in_prose_are_found():
    text = (
        "{# constants: 0.3 #}\nTC-CLiFF has {{ errors(0) }} m, LSTM -1.07 m; walls from 0.3 m on, version `1.2.3`.\n"
        "    scores 9.99\nSee [it](https://a.b/1.5/) and {% if 2.5 %}3 of 4{% endif %}; 8.64 m.\n"
    )
    assert unmade(text) == ["-1.07", "8.64"]


@pytest.mark.parametrize("template", sorted(publish.TEMPLATES.glob("*.md")), ids=lambda file: file.name)
def test_every_published_number_is_made_by_a_run(template):
    """And the page is what the committed numbers give."""
    text, numbers = template.read_text(encoding="utf-8"), json.loads(publish.NUMBERS.read_text(encoding="utf-8"))
    assert unmade(text) == []
    assert publish.page_of(template).read_text(encoding="utf-8") == publish.render(text, numbers)
