"""The report: every exhibit once and in its place, sentences from the run's numbers, one file that asks no network."""

import base64
import re
from collections import Counter
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from explored_run import HALL, MAPS, METHODS, RECORDINGS, YARD
from reported_run import ACCOUNT, DAYS, GRAPH, NOTE, make_report

from modlhmp import __version__
from modlhmp.file_format import Recording
from modlhmp.storage import DataError, write_json
from modlhmp.study import publish
from modlhmp.study.exhibits import coverage, horizon_errors, ranking_gain, tables
from modlhmp.study.exhibits.table_forms import tables_of
from modlhmp.study.explorer import page as explorer
from modlhmp.study.explorer.pack import unpacked
from modlhmp.study.layout import Layout
from modlhmp.study.report import ASSETS, about, facts
from modlhmp.study.report.rule_graph import RuleGraph, columns_of, grouped, picture, without_shortcuts

VOID = {"meta", "link", "img", "br", "input", "hr"}


class Reader(HTMLParser):
    """What a page holds: its elements, its words, the ids it defines; and that every element is closed."""

    def __init__(self, text):
        super().__init__()
        self.elements, self.words, self.open = [], [], []
        self.feed(text)
        assert not self.open

    def handle_starttag(self, tag, attrs):
        self.elements.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.elements.append((tag, dict(attrs)))

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if self.open[-1:] != ["style"]:
            self.words.append(data)

    @property
    def said(self):
        """Its words, with single blanks."""
        return " ".join("".join(self.words).split())

    def all(self, tag):
        return [attrs for name, attrs in self.elements if name == tag]


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Path and exhibits of a report."""
    return make_report(Layout("small", str(tmp_path_factory.mktemp("reported"))))


@pytest.fixture(scope="module")
def page(made):
    return Reader(Path(made[0]).read_text(encoding="utf-8"))


def test_every_exhibit_stands_in_it_once(page, made):
    shown = Counter(attrs["data-exhibit"] for _, attrs in page.elements if "data-exhibit" in attrs)
    assert shown == Counter(one["stem"] for one in made[1])
    assert len(page.all("img")) == 2
    assert [attrs["id"] for attrs in page.all("figure")] == ["table-1", "figure-1", "figure-2", "table-2"]


def test_it_is_one_file_without_a_script(page):
    """No address of a network, nothing that runs; links lead within the page or to files beside it."""
    assert not page.all("script")
    for _, attrs in page.elements:
        assert not any(name.startswith("on") for name in attrs)
        for name in ("src", "href"):
            if name in attrs:
                assert re.match(r"data:|#|[\w.-]+$", attrs[name]), attrs[name][:80]
    ids = {attrs["id"] for _, attrs in page.elements if "id" in attrs}
    assert {attrs["href"][1:] for attrs in page.all("a") if attrs["href"].startswith("#")} <= ids


def test_every_file_that_it_links_lies_beside_it(page, made):
    linked = {attrs["href"] for attrs in page.all("a") if not attrs["href"].startswith("#")}
    assert {"explorer.html", "results.csv", "hall_final.pdf", "tab_expres.tex"} <= linked
    assert all((Path(made[0]).parent / name).exists() for name in linked)


def test_pictures_and_scrolled_parts_have_names(page):
    assert all(len(attrs["alt"]) > 20 for attrs in page.all("img"))
    for _, attrs in page.elements:
        if attrs.get("tabindex") == "0" or attrs.get("role") in {"img", "region"}:
            assert attrs["aria-label"]


def test_what_a_configuration_says_stays_text(page):
    assert NOTE in page.said
    assert "B <i>" in page.said
    assert not page.all("i") or all("script" not in str(attrs) for attrs in page.all("i"))


def test_made_up_people_are_called_so(page, made, tmp_path):
    assert "demo data" in page.said[:200] and "Demo data." in page.said
    path, _ = make_report(Layout("own", str(tmp_path)), (YARD,), claims=False)
    own = Reader(Path(path).read_text(encoding="utf-8")).said
    assert "emo data" not in own and "?." not in own
    assert "aper's claims" not in own and "reproduction" not in own and "etwork" not in own.replace("-", "")


def test_sentences_have_the_run_s_numbers(page, made):
    scores = pd.read_csv(Path(made[0]).parent / "results.csv")
    at = scores[(scores["dataset"] == "hall") & (scores["protocol"] == "complete") & (scores["horizon_s"] == 12)]
    shown = at[at["output"].isin(["ranked", "median", "single"])]
    best = shown.loc[shown["ade_m"].idxmin()]
    assert (
        f"ADE {best['ade_m']:.2f} m (FDE {best['fde_m']:.2f} m; {best['n']:.0f} of {best['eligible']:.0f}" in page.said
    )
    assert "1 support a claim, 0 contradict one and 1 show neither" in page.said
    assert f"modlhmp {__version__}" in page.said
    assert {"name": "generator", "content": f"modlhmp {__version__}"} in page.all("meta")


def test_a_table_of_another_make_is_refused():
    with pytest.raises(DataError, match="not a table of this version"):
        tables_of("<!DOCTYPE html><h1>Results</h1><table></table>")


def test_cleaning_adds_up(tmp_path):
    layout = Layout("small", str(tmp_path))
    for name in ("monday", "tuesday"):
        write_json(layout.account("hall", name), ACCOUNT)
    rows = dict(facts.cleaning(layout, HALL, {"train": ["monday", "tuesday"], "test": ["monday"]}))
    assert list(rows) == ["read", "gap over 5s", "zero velocity", "kept"]
    assert rows["read"] == [200, 18, 100, 9]
    total = np.array(rows["kept"]) + rows["gap over 5s"] + rows["zero velocity"]
    assert total.tolist() == rows["read"]


def test_verdicts_count_every_test():
    told = [("complete", "supported"), ("complete", "supported only by tracks that one side could not forecast"),
            ("paper", "contradicted"), ("", "counted, not tested"), ("", "ours is smaller")]  # fmt: skip
    found = facts.verdicts(pd.DataFrame(told, columns=["protocol", "verdict"]))
    assert found["supported"] == found[told[1][1]] == {"complete": 1, "paper": 0, "": 0}
    assert found["contradicted"]["paper"] == 1 and found["another"][""] == 2
    assert sum(sum(one.values()) for one in found.values()) == len(told)


def test_nothing_scored_is_said():
    columns = ["dataset", "method", "output", "protocol", "horizon_s", "ade_m", "n", "eligible"]
    none = facts.best(pd.DataFrame(columns=columns), YARD, [])
    assert none == {"horizon": 0.0}
    said = facts.limits(YARD, DAYS, none, {"evaluate_on": "test"})
    assert any("No test track is long enough" in one for one in said)
    assert any("same day (2020-01-06)" in one for one in said)


def test_parts_of_a_file_are_of_one_day_though_nobody_knows_which():
    """No day is made up of the recording's name."""
    parts = tuple(Recording(name=f"a-{split}", path="/data/a.txt", split=split) for split in ("train", "test"))
    found = about.recordings(replace(YARD, recordings=parts, clock="unknown"))
    assert found["days"] == {"train": [""], "test": [""]}
    said = facts.limits(YARD, found, {"horizon": 12.0}, {"evaluate_on": "test"})
    assert any("same day (a.txt)" in one for one in said)
    assert any("With test days unknown, tests and intervals are over persons" in one for one in said)
    assert not any("1 test day" in one for one in said)


def test_who_scores_nobody_scores_fewest():
    rows = [(YARD.name, method, "single", protocol, 5.0, ade, ade, n, 10)
            for protocol in ("paper", "complete")
            for method, ade, n in (("a", 1.0, 9), ("b", 2.0, 10), ("c", np.nan, 0))]  # fmt: skip
    columns = ["dataset", "method", "output", "protocol", "horizon_s", "ade_m", "fde_m", "n", "eligible"]
    longer = [(*row[:4], 10.0, np.nan, np.nan, 0, 0) for row in rows]
    methods = [{"name": name, "title": name.upper(), "kind": "cvm"} for name in "abc"]
    found = facts.best(pd.DataFrame(rows + longer, columns=columns), YARD, methods)
    assert found["horizon"] == 5
    assert [found["paper"][what]["title"] for what in ("best", "constant", "fewest")] == ["A", "A", "C"]
    said = facts.limits(YARD, DAYS, found, {"evaluate_on": "test"})
    assert any("the paper protocol scores as few as 0 tracks (C)" in one for one in said)


def test_the_graph_has_every_rule_and_no_shortcut():
    assert without_shortcuts(GRAPH.needs)["table_expres"] == {"build"}
    assert columns_of(GRAPH.needs)[0] == ["clean"] and len(columns_of(GRAPH.needs)) == 3
    both = grouped(GRAPH, lambda rule: "exhibits" if "_" in rule else rule)
    assert both == RuleGraph({"clean": [], "build": ["clean"], "exhibits": ["build", "clean"]},
                             {"clean": 4, "build": 2, "exhibits": 3})  # fmt: skip
    drawn = picture(both, "Rules")
    assert re.findall(r">([^<>]+)</text>", drawn) == ["build ×2", "clean ×4", "exhibits ×3"]
    assert drawn.count('class="line"') == 2


def contrast(one, other):
    """Contrast of two colours #rrggbb by WCAG 2."""

    def light(colour):
        parts = [int(colour[at : at + 2], 16) / 255 for at in (1, 3, 5)]
        return np.dot(
            [0.2126, 0.7152, 0.0722], [p / 12.92 if p <= 0.04045 else ((p + 0.055) / 1.055) ** 2.4 for p in parts]
        )

    high, low = sorted((light(one), light(other)), reverse=True)
    return (high + 0.05) / (low + 0.05)


@pytest.mark.parametrize("scheme", [0, 1], ids=["light", "dark"])
def test_colours_of_words_can_be_read(scheme):
    """WCAG AA, on both grounds, in both schemes."""
    block = re.findall(r":root \{(.*?)\}", (ASSETS / "report.css").read_text(encoding="utf-8"), re.DOTALL)[scheme]
    colours = dict(re.findall(r"--(\w+): (#\w{6})", block))
    for ground in ("ground", "card"):
        for words in ("ink", "faint", "strong", "mark"):
            assert contrast(colours[words], colours[ground]) >= 4.5, (words, ground)
        assert contrast(colours["focus"], colours[ground]) >= 3


def test_a_browser_shows_it_without_an_error(made):
    """No fault and no network; nothing but framed pictures and tables is wider than a phone."""
    browser = pytest.importorskip("browser", reason="websocket-client is not installed")
    if not browser.CHROMIUM:
        pytest.skip("no Chromium (Debian: apt install chromium)")
    with browser.Page(Path(made[0]), width=390, height=844, phone=True) as shown:
        shown.until("document.readyState === 'complete'")
        assert shown.ask("document.documentElement.scrollWidth") <= 390
        assert shown.ask("[...document.images].every((one) => one.complete && one.naturalWidth > 0)")
        assert not shown.faults
        assert all(one.startswith(("file:", "data:")) for one in shown.asked)


WIDTHS = {False: 673, True: 1002}  # px between the margins of A4, upright and on its side
TABLE = """(columns, rows) => {
  const cells = (tag, text) => Array.from({length: columns}, (_, i) => `<${tag}>${text(i)}</${tag}>`).join("");
  document.querySelector("main").insertAdjacentHTML("beforeend", `<figure class="table" data-exhibit="tab_long">
    <figcaption>Long</figcaption><div class="scroll"><table><thead><tr>${cells("th", (i) => "mean_" + i)}</tr></thead>
    <tbody>${Array.from({length: rows}, () => `<tr>${cells("td", () => "-0.1234")}</tr>`).join("")}</tbody></table>
    </div></figure>`);
}"""
PRINTED = """[...document.querySelectorAll("figure.table")].map((figure) => ({
  wide: getComputedStyle(figure).page === "wide", note: getComputedStyle(figure, "::after").content,
  right: Math.max(...[...figure.querySelectorAll("table")].map((one) => one.getBoundingClientRect().right)),
  hidden: [...figure.querySelectorAll("tbody tr")].filter((row) => !row.getClientRects().length).length,
}))"""


def test_it_prints(made):
    """No table is wider than its sheet, which would shrink every page; of a long one the first rows, and it says so."""
    browser = pytest.importorskip("browser", reason="websocket-client is not installed")
    if not browser.CHROMIUM:
        pytest.skip("no Chromium (Debian: apt install chromium)")
    seen = {}
    for wide, width in WIDTHS.items():
        with browser.Page(Path(made[0]), width=width) as shown:
            shown.until("document.readyState === 'complete'")
            for columns, rows in ((5, 32), (5, 33), (13, 4), (14, 4), (23, 4)):
                shown.ask(f"({TABLE})({columns}, {rows})")
            shown.send("Emulation.setEmulatedMedia", media="print")
            seen[wide] = shown.ask(PRINTED)
    for wide, width in WIDTHS.items():
        on_such_sheets = [one for one in seen[wide] if one["wide"] is wide]
        assert on_such_sheets and all(one["right"] <= width for one in on_such_sheets), wide
    short, long, *others = seen[False][-5:]
    assert (short["hidden"], long["hidden"]) == (0, 1)
    assert short["note"] == "none" and "first 32 rows" in long["note"] and "tab_long" in long["note"]
    assert [one["wide"] for one in others] == [False, True, True]


def shown_of(layout, name):
    """What all that reads `results.csv` says of a run whose dataset has this name, the name taken out."""
    dataset = replace(HALL, name=name)
    report, _ = make_report(layout, (dataset,))
    stems = [layout.exhibit(one) for one in "abcd"]
    tables.draw_results(layout, [dataset], stems[0], METHODS, {name: [6.0, 12.0]})
    coverage.draw(layout, [dataset], stems[1], METHODS)
    horizon_errors.draw(layout, dataset, stems[2], METHODS)
    ranking_gain.draw(layout, [dataset], stems[3], "tc_cliff", "TC-CLiFF")
    explorer.draw(layout, [dataset], layout.exhibit("e"), METHODS, MAPS, [], {name: RECORDINGS}, "")
    data = Path(f"{layout.exhibit('e')}.html").read_text().split('id="data">')[1].split("<")[0]
    return [
        Reader(Path(report).read_text(encoding="utf-8")).said,
        *(re.sub(f"^'?{re.escape(name)},", "", Path(f"{stem}.csv").read_text(), flags=re.M) for stem in stems),
        repr(unpacked(base64.b64decode(data))["sets"][0]["methods"]),
        [*publish._of_run(layout)["scores"].values()],
    ]


def test_a_dataset_may_have_any_name(tmp_path):
    """A number, or what tables write for nothing: all is as under a plain name."""
    plain, *others = (shown_of(Layout("small", str(tmp_path / one)), one) for one in ("hall", "20121024", "NA"))
    assert "not run" not in plain[1]
    for other in others:
        assert other == plain
