"""The ladder's table and figure: a row per rung, what each is compared with, dashes for what there is not."""

import re
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pytest
from matplotlib import image

from modlhmp.datasets import Dataset
from modlhmp.scoring.protocols import PROTOCOLS
from modlhmp.storage import write_json, write_parquet
from modlhmp.study.csv_cells import original
from modlhmp.study.exhibits import ladder_figure, ladder_table, style
from modlhmp.study.ladder import DIFFERENCES, SCORES
from modlhmp.study.layout import Layout

HALL = Dataset(name="hall", title="My hall", label="hall", reader="atc", demo=True)
YARD = Dataset(name="yard", title="Yard", label="yard", reader="atc")
TITLES = {"cvm": "CVM", "tc": "TC-CLiFF", "snippets": "Snippets", "hybrid": "Both", "hour": "Snippets, hour"}
LADDER = {
    "reference": "tc",
    "rows": [["cvm", "no map"], ["tc", "a map"], ["snippets", "memory"], ["hybrid", "a mean"]],
    "beside": [["hour", "snippets", "time of day on"]],
}
RUNGS = [method for method, _ in LADDER["rows"]]
COSTS = {"cvm": 0.0123, "tc": 3.14159, "snippets": 12.3}
HORIZONS = (5.0, 10.0, 20.0)
DAYS = ["2030-01-01"]
ABOVE, LESS, FDE = "ADE less the row above", "less TC-CLiFF", "FDE, the same"


def scored(dataset="hall", horizons=HORIZONS, **changes):
    """As of `study.ladder.scores`: rung n errs by n + horizon / 10 m; `changes` {column: value} of the last."""
    rows = []
    for protocol in PROTOCOLS:
        for n, method in enumerate(TITLES, 1):
            for horizon in horizons:
                ade, seen = n + horizon / 10, 40 - (protocol == "paper")
                row = (dataset, protocol, horizon, method, ade, ade - 0.25, ade + 0.25, 2 * ade, seen, 40)
                row = dict(zip(SCORES, row, strict=True))
                rows.append(row | (changes if horizon == max(horizons) else {}))
    return pd.DataFrame(rows, columns=SCORES)


def compared(horizons=HORIZONS, **changes):
    """As of `study.ladder.differences`, of the pairs of `LADDER`, in ADE and, twice as much, FDE."""
    pairs = [*zip(RUNGS[1:], RUNGS, strict=False), *((rung, "tc") for rung in RUNGS), ("hour", "snippets")]
    place = {method: n for n, method in enumerate(TITLES, 1)}
    rows = []
    for protocol in PROTOCOLS:
        for method, against in dict.fromkeys(pairs):
            for metric in ("ade", "fde"):
                for horizon in horizons:
                    less = float(place[method] - place[against]) * (1 + (metric == "fde"))
                    share = 100 * less / (place[against] + horizon / 10)
                    row = (
                        "hall",
                        protocol,
                        horizon,
                        metric,
                        method,
                        against,
                        38,
                        less,
                        less - 0.125,
                        less + 0.25,
                        share,
                        0,
                    )
                    row = dict(zip(DIFFERENCES, row, strict=True))
                    rows.append(row | (changes if horizon == max(horizons) else {}))
    return pd.DataFrame(rows, columns=DIFFERENCES)


def store(layout, dataset, part, table):
    """A part of a dataset's ladder where the exhibits look for it."""
    Path(layout.ladder(dataset.name, part)).parent.mkdir(parents=True, exist_ok=True)
    write_parquet(pa.Table.from_pandas(table, preserve_index=False), layout.ladder(dataset.name, part))


def write(folder, scores=None, differences=None, dataset=HALL, rungs=LADDER, days=DAYS, costs=COSTS):
    """Write the table; returns its CSV."""
    layout = Layout("try", str(folder))
    store(layout, dataset, "scores", scored() if scores is None else scores)
    store(layout, dataset, "differences", compared() if differences is None else differences)
    write_json(layout.costs(dataset.name), costs)
    ladder_table.draw(layout, dataset, str(folder / "t"), **rungs, titles=TITLES, days=days)
    return pd.read_csv(folder / "t.csv", dtype=str, keep_default_na=False).map(original)


def nobody():
    """What `study.ladder` gives where nobody walks as long as the longest horizon."""
    nan = np.nan
    return (
        scored(ade_m=nan, ade_low_m=nan, ade_high_m=nan, fde_m=nan, n=0, eligible=0),
        compared(difference_m=nan, low_m=nan, high_m=nan, percent=nan, n=0),
    )


# --- the table ----------------------------------------------------------------------------------------------


def test_every_form_holds_every_rung(tmp_path):
    """In the ladder's order, with its change, at each horizon where there is more than one table."""
    table = write(tmp_path)
    assert table["method"].tolist() == [TITLES[rung] for rung in RUNGS]
    assert table["what changes"].tolist() == [change for _, change in LADDER["rows"]]
    for kind, tables in (("md", 3), ("html", 3), ("tex", 1)):
        text = (tmp_path / f"t.{kind}").read_text()
        for _, change in LADDER["rows"]:
            assert text.count(change) == tables


def test_the_longest_horizon_comes_first(tmp_path):
    write(tmp_path)
    text = (tmp_path / "t.md").read_text()
    assert re.findall(r"^#+ (.*)$", text, re.MULTILINE) == [
        "From the paper's configuration to the best one: My hall, 20 s",
        "10 s",
        "5 s",
        "Beside the ladder: one thing changed",
    ]
    assert "My hall, 20 s" in (tmp_path / "t.tex").read_text()


def test_the_cells_by_hand(tmp_path):
    """Snippets at 20 s: n = 3, so 3 + 2 m; one less than the rung above, which is the reference, of 4 m."""
    row = write(tmp_path).set_index("method").loc["Snippets"]
    assert (row["ADE / FDE [m]"], row["n"]) == ("5.00 / 10.00", "40")
    assert row[ABOVE] == row[LESS] == "+1.00 (+0.88 to +1.25), +25 %"
    assert row[FDE] == "+2.00 (+1.88 to +2.25), +50 %"
    assert row["ms per track"] == "12"
    assert (row["paper protocol"], row["paper protocol: n"]) == ("5.00 / 10.00", "39/40")


def test_every_rung_is_compared_with_the_one_above_and_with_the_reference(tmp_path):
    """A dash for the first, which has none above, and for the reference itself."""
    table = write(tmp_path)
    assert table[ABOVE].str.split(" ").str[0].tolist() == ["–", "+1.00", "+1.00", "+1.00"]
    assert table[LESS].str.split(" ").str[0].tolist() == ["-1.00", "–", "+1.00", "+2.00"]
    assert table[FDE].str.split(" ").str[0].tolist() == ["-2.00", "–", "+2.00", "+4.00"]


def test_a_rung_without_a_cost_has_a_dash(tmp_path):
    """Not timed, or there was nobody to time it with."""
    costs = {**COSTS, "tc": np.nan}
    assert write(tmp_path, costs=costs)["ms per track"].tolist() == ["0.012", "–", "12", "–"]


def test_pairs_beside_the_ladder_have_a_column_per_horizon(tmp_path):
    """Their own error, and what one has over the other; left out where there are none."""
    write(tmp_path)
    beside = (tmp_path / "t.md").read_text().split("## Beside the ladder: one thing changed")[1]
    header, _, row = beside.partition("<!--")[0].strip().splitlines()
    assert header == "| what changes | method | against | 5 s | 10 s | 20 s |"
    assert row.startswith(
        "| time of day on | Snippets, hour | Snippets | 5.50 / 11.00; +2.00 (+1.88 to +2.25), +57 % |"
    )
    write(tmp_path, rungs={**LADDER, "beside": []})
    for kind in ("md", "html"):
        assert "Beside the ladder" not in (tmp_path / f"t.{kind}").read_text()


@pytest.mark.parametrize(("days", "over"), [(4, "intervals over persons"), (5, "intervals over the 5 test days")])
def test_the_note_says_what_intervals_are_over(tmp_path, days, over):
    write(tmp_path, days=[f"2030-01-0{n}" for n in range(1, days + 1)])
    for kind in ("md", "html", "tex"):
        text = (tmp_path / f"t.{kind}").read_text()
        assert over in text
        assert "with TC-CLiFF, on the same tracks" in text


@pytest.mark.parametrize(("dataset", "labelled"), [(HALL, True), (YARD, False)])
def test_demo_data_are_labelled(tmp_path, dataset, labelled):
    write(tmp_path, dataset=dataset)
    for kind in ("md", "html", "tex"):
        assert ("Demo data" in (tmp_path / f"t.{kind}").read_text()) == labelled


def test_nobody_as_long_as_a_horizon_is_a_dash(tmp_path):
    """In errors, differences and beside the ladder; the other horizons have their numbers."""
    table = write(tmp_path, *nobody())
    assert set(table["ADE / FDE [m]"]) == set(table["paper protocol"]) == {"–"}
    assert set(table[ABOVE]) == set(table[LESS]) == set(table[FDE]) == {"–"}
    assert set(table["n"]) == {"0"}
    assert set(table["paper protocol: n"]) == {"0/0"}
    text = (tmp_path / "t.md").read_text()
    assert "nan" not in text
    assert "6.00 / 12.00; +2.00 (+1.88 to +2.25), +50 % | – |" in text


def test_a_single_person_has_a_difference_without_an_interval(tmp_path):
    nan = np.nan
    table = write(tmp_path, scored(ade_low_m=nan, ade_high_m=nan, n=1), compared(low_m=nan, high_m=nan, n=1))
    assert table[ABOVE].tolist() == ["–", "+1.00, +33 %", "+1.00, +25 %", "+1.00, +20 %"]


# --- the figure ---------------------------------------------------------------------------------------------


@pytest.fixture
def drawn(tmp_path, monkeypatch):
    """Function (scores, datasets): draw them; returns the open figure and the CSV."""
    shown = []
    monkeypatch.setattr(style.plt, "close", shown.append)

    def draw(scores, datasets, with_memory=("snippets", "hybrid"), rungs=LADDER):
        layout, methods = Layout("try", str(tmp_path)), [method for method, _ in rungs["rows"]]
        for dataset in datasets:
            store(layout, dataset, "scores", scores[scores["dataset"] == dataset.name])
        ladder_figure.draw(layout, datasets, str(tmp_path / "f"), methods, rungs["reference"], TITLES, with_memory)
        assert image.imread(tmp_path / "f.png").std() > 0
        return shown[-1], pd.read_csv(tmp_path / "f.csv")

    return draw


def titles(fig):
    """Titles of the panels that are there."""
    return [ax.get_title(loc="left") for ax in fig.axes if ax.axison]


def test_the_numbers_behind_the_figure_are_the_input(drawn):
    scores = scored()
    _, table = drawn(scores, [HALL])
    pd.testing.assert_frame_equal(table, scores, check_dtype=False, rtol=1e-5)


def test_the_three_longest_horizons_are_drawn(drawn):
    fig, _ = drawn(scored(horizons=(1.0, *HORIZONS)), [HALL])
    assert titles(fig) == ["My hall: 5 s", "My hall: 10 s", "My hall: 20 s"]


def test_datasets_of_different_horizons_stand_in_one_figure(drawn):
    """A row each; the shorter one's last panel is left out."""
    fig, table = drawn(pd.concat([scored(), scored("yard", (5.0, 10.0))]), [HALL, YARD])
    assert titles(fig) == ["My hall: 5 s", "My hall: 10 s", "My hall: 20 s", "Yard: 5 s", "Yard: 10 s"]
    assert set(table["dataset"]) == {"hall", "yard"}
    assert fig._suptitle.get_text().startswith("Demo data")


def test_no_demo_note_without_demo_data(drawn):
    fig, _ = drawn(scored("yard"), [YARD])
    assert fig._suptitle is None


def test_rungs_stand_from_top_to_bottom_at_their_complete_errors(drawn):
    """The first rung is the highest; a point at its ADE, a bar from end to end of its interval."""
    scores = scored()
    scores.loc[scores["protocol"] == "paper", "ade_m"] = 99.0
    fig, _ = drawn(scores, [HALL])
    panel = fig.axes[2]
    points = [line.get_xydata()[0].tolist() for line in panel.lines if line.get_marker() == "o"]
    assert points == [[3, 3], [4, 2], [5, 1], [6, 0]]
    bars = [line.get_xydata().tolist() for line in panel.lines if line.get_alpha()]
    assert bars == [[[x - 0.25, y], [x + 0.25, y]] for x, y in points]
    assert [text.get_text() for text in fig.axes[0].get_yticklabels()] == ["CVM", "TC-CLiFF", "Snippets", "Both"]
    assert panel.get_xlabel() == "ADE [m], n = 40"


def test_colours_tell_the_reference_and_the_maps_with_memory(drawn):
    fig, _ = drawn(scored(), [HALL])
    colours = [line.get_color() for line in fig.axes[0].lines if line.get_marker() == "o"]
    assert colours == [ladder_figure.COLOURS[kind] for kind in ("before", "reference", "ours", "ours")]


def test_a_reference_that_is_no_rung_is_a_line(tmp_path, drawn):
    """It is scored all the same; in the table every rung is compared with it."""
    rungs = {**LADDER, "rows": [row for row in LADDER["rows"] if row[0] != "tc"]}
    fig, _ = drawn(scored(), [HALL], rungs=rungs)
    panel = fig.axes[2]
    assert [line.get_xydata()[0].tolist() for line in panel.lines if line.get_marker() == "o"] == [
        [3, 2],
        [5, 1],
        [6, 0],
    ]
    assert [line.get_xdata()[0] for line in panel.lines if line.get_linestyle() == ":"] == [4]
    both = compared().replace({"against": {"cvm": "none"}})
    above = both[(both["method"] == "snippets") & (both["against"] == "tc")].assign(against="cvm")
    table = write(tmp_path, differences=pd.concat([both, above]), rungs=rungs)
    assert table[LESS].str.split(" ").str[0].tolist() == ["-1.00", "+1.00", "+2.00"]


def test_all_is_inside_the_panel(drawn):
    fig, _ = drawn(scored(), [HALL])
    for panel in fig.axes:
        low, high = panel.get_xlim()
        assert low == 0
        assert max(np.max(line.get_xdata()) for line in panel.lines) < high


def test_rungs_without_an_interval_are_points(drawn):
    """One person, or one day: the rung's number still stands at its point."""
    fig, _ = drawn(scored(ade_low_m=np.nan, ade_high_m=np.nan), [HALL])
    texts = [text for text in fig.axes[2].texts if text.get_text()]
    assert [(text.get_text(), text.xy[0]) for text in texts] == [("3.00", 3), ("4.00", 4), ("5.00", 5), ("6.00", 6)]


def test_a_horizon_that_nobody_reaches_is_an_empty_panel(drawn):
    fig, table = drawn(nobody()[0], [HALL])
    assert titles(fig) == ["My hall: 5 s", "My hall: 10 s"]
    assert "no test track of 20 s" in fig.axes[2].texts[0].get_text()
    assert table["ade_m"].isna().any()


def test_a_dataset_in_which_nobody_reaches_any_is_said_too(drawn):
    """The other one is drawn."""
    nothing = scored("yard", (5.0,), ade_m=np.nan, ade_low_m=np.nan, ade_high_m=np.nan, fde_m=np.nan, n=0, eligible=0)
    fig, _ = drawn(pd.concat([scored(), nothing]), [HALL, YARD])
    assert len(titles(fig)) == 3
    assert fig.axes[3].texts[0].get_text() == "Yard: no test track of 5 s"
