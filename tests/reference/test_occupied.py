"""Occupied cells: sums against a plain count of what `Live` says, and what the reliability of bins means."""

import numpy as np
import pandas as pd
import pytest

import modlhmp
from modlhmp.contract import SITE, crowd
from modlhmp.methods import Method
from modlhmp.options import Episodes, NoBuilding, SnippetBuilding, Snippets
from modlhmp.splits import BLOCK_S, FOLDS, in_part
from modlhmp.study.occupied import BINS, CLOSE, ENOUGH, grid_of, measure, reliability_of, steps_of

EVERY_S, HORIZONS = 30.0, [4, 8]
METHODS = [
    Method(name="now", kind="episodes", options=Episodes(samples="pieces", persons=3)),
    Method(name="chained", kind="snippets", options=Snippets(k=9)),
]
BUILDINGS = {"episodes": NoBuilding(), "snippets": SnippetBuilding()}


def half_hours():
    """People of `crowd` in five half-hours, twelve in each, in its middle: others' half-hours are far enough away."""
    people, began = crowd(60, 20), BLOCK_S * np.ceil(1.3e9 / BLOCK_S)
    rows = np.diff(people.bounds())
    number = np.arange(60)
    start = began + BLOCK_S * (number % FOLDS) + 880.0 + 4.0 * (number // FOLDS % 4)
    first = people.t[people.bounds()[:-1]]
    return people._replace(t=people.t - np.repeat(first - start, rows))


PEOPLE = half_hours()


@pytest.fixture(scope="module")
def tables():
    return measure(PEOPLE, SITE, METHODS, BUILDINGS, EVERY_S, HORIZONS, (3, "hall"))


def told(method):
    """(half-hour, moment, {(i, j): p} and the set of occupied cells, per step) of every moment, as `Live` has them."""
    bounds = PEOPLE.bounds()
    for fold in range(1, FOLDS + 1):
        training = PEOPLE.take(np.repeat(in_part(PEOPLE, f"without-{fold}"), np.diff(bounds)))
        a_map = modlhmp.build_map(method.kind, training, SITE)
        given = {"persons": 3} if method.kind == "episodes" else {"k": 9}
        for t0 in np.arange(np.ceil(PEOPLE.t.min() / EVERY_S), PEOPLE.t.max() / EVERY_S) * EVERY_S:
            if (t0 // BLOCK_S) % FOLDS != fold - 1:
                continue
            live = modlhmp.Live(a_map, 8, seed=3, key=("hall", method.name, "occupancy"), **given)
            past = PEOPLE.take(PEOPLE.t <= t0)
            for row in np.argsort(past.t, kind="stable"):
                live.see(past.t[row], int(past.track_id[row]), past.x[row], past.y[row])
            futures = live.forecast(t0)
            if not len(futures.t0):
                continue
            p = futures.occupancy()
            low = [round(one) for one in p.origin]
            chances, occupied = [], []
            for step in steps_of(SITE, HORIZONS):
                rows, columns = np.nonzero(p.probabilities[step - 1])
                chances.append({
                    (low[0] + int(i), low[1] + int(j)): float(p.probabilities[step - 1, j, i])
                    for j, i in zip(rows, columns, strict=True)
                })  # fmt: skip
                cells = set()
                for who in futures.track_id:
                    own = PEOPLE.take(PEOPLE.track_id == who)
                    if t0 + step <= own.t[-1] + 0.05:
                        x, y = (np.interp(t0 + step, own.t, part) for part in (own.x, own.y))
                        cells.add((int(np.floor(x)), int(np.floor(y))))
                occupied.append(cells)
            yield int(t0 // BLOCK_S), len(futures.t0), chances, occupied


@pytest.mark.parametrize("method", METHODS, ids=lambda one: one.name)
def test_the_sums_are_those_of_live_forecasts(tables, method):
    moments = list(told(method))
    grid = grid_of(PEOPLE)
    seen = {(int(i + grid.low[0]), int(j + grid.low[1])) for j, i in np.argwhere(grid.seen)}
    assert seen == {(int(np.floor(x)), int(np.floor(y))) for x, y in zip(PEOPLE.x, PEOPLE.y, strict=True)}
    scores = tables["scores"][tables["scores"]["method"] == method.name].reset_index()
    bins = tables["bins"][tables["bins"]["method"] == method.name]
    assert len(moments) == scores["moments"][0] >= FOLDS
    assert scores["people"][0] == sum(people for _, people, *_ in moments)
    assert scores["cells"][0] == len(moments) * len(seen)
    for place, step in enumerate(steps_of(SITE, HORIZONS)):
        row = scores.iloc[place]
        assert row["horizon_s"] == step
        p = [{cell: one for cell, one in chances[place].items() if cell in seen} for *_, chances, _ in moments]
        occupied = [cells[place] for *_, cells in moments]
        assert row["p"] == pytest.approx(sum(sum(one.values()) for one in p), rel=1e-5)
        assert row["occupied"] == sum(map(len, occupied))
        assert row["unforeseen"] == sum(
            cell not in one for one, cells in zip(p, occupied, strict=True) for cell in cells
        )
        errors = [
            (one.get(cell, 0) - (cell in cells)) ** 2 for one, cells in zip(p, occupied, strict=True) for cell in seen
        ]
        assert row["brier"] == pytest.approx(np.mean(errors), rel=1e-5)
        mine = bins[bins["horizon_s"] == step]
        assert mine["n"].sum() == sum(map(len, p))
        assert mine["p"].sum() == pytest.approx(row["p"], rel=1e-5)
        assert mine["occupied"].sum() == row["occupied"] - row["unforeseen"]
        assert (mine["bin"] == np.minimum((mine["p"] / mine["n"] * BINS + 1e-6).astype(int), BINS - 1)).all()
        by_block = mine.groupby("block")["n"].sum().to_dict()
        for block in by_block:
            assert by_block[block] == sum(len(one) for one, (b, *_) in zip(p, moments, strict=True) if b == block)
        no_skill(row, moments, occupied, seen)
    assert 0 < scores["brier"].iloc[0] < scores["brier_cells"].iloc[0]


def no_skill(row, moments, occupied, seen):
    """Brier scores of the other folds' shares, by every cell and moment."""
    by_cell, flat = [], []
    fold = [block % FOLDS for block, *_ in moments]
    for mine in range(FOLDS):
        others = [cells for own, cells in zip(fold, occupied, strict=True) if own != mine]
        share = {cell: np.mean([cell in cells for cells in others]) for cell in seen}
        mean = np.mean(list(share.values()))
        for own, cells in zip(fold, occupied, strict=True):
            if own == mine:
                by_cell += [(share[cell] - (cell in cells)) ** 2 for cell in seen]
                flat += [(mean - (cell in cells)) ** 2 for cell in seen]
    assert row["brier_cells"] == pytest.approx(np.mean(by_cell))
    assert row["brier_flat"] == pytest.approx(np.mean(flat))


def test_the_film_is_of_the_moment_with_most_people(tables):
    film, moments = tables["film"], list(told(METHODS[0]))
    most = max(moments, key=lambda one: one[1])
    now = film[(film["what"] == "person") & (film["at_s"] == 0)]
    assert len(now) == most[1]
    for place, step in enumerate(steps_of(SITE, HORIZONS)):
        then = film[film["at_s"] == step]
        assert len(then[then["what"] == "person"]) >= len(most[3][place]) > 0
        cells = then[then["what"] == "cell"]
        seen = {(round(x - 0.5), round(y - 0.5)): p for x, y, p in cells[["x", "y", "p"]].itertuples(index=False)}
        assert seen == pytest.approx({cell: p for cell, p in most[2][place].items() if cell in seen}, rel=1e-5)


# --- the reliability of bins -----------------------------------------------------------------------------------------


def bins_of(p, occupied, block=None, cell=None):
    """Rows of one cell each, of one method, horizon and bin."""
    n = len(occupied)
    return pd.DataFrame({
        "method": "m", "horizon_s": 5.0, "bin": 4, "n": 1, "p": p, "occupied": occupied,
        "block": np.arange(n) if block is None else block, "cell": np.arange(n) if cell is None else cell,
    })  # fmt: skip


def test_a_bin_is_judged_by_its_distance_or_its_interval():
    for share, calibrated in ((0.45, True), (0.49, True), (0.56, False)):
        occupied = (np.arange(5000) < share * 5000).astype(int)
        (row,) = reliability_of(bins_of(0.45, occupied)).itertuples()
        assert (row.n, row.calibrated) == (5000, calibrated)
        assert (row.forecast, row.outcome) == (pytest.approx(0.45), pytest.approx(share, abs=1e-3))
        assert row.half == pytest.approx(1.96 * np.sqrt(share * (1 - share) / 5000), rel=2e-3)
    (few,) = reliability_of(bins_of(0.45, np.zeros(ENOUGH - 1, int))).itertuples()
    assert few.calibrated is None
    (wide,) = reliability_of(bins_of(0.45, (np.arange(ENOUGH) < 0.51 * ENOUGH).astype(int))).itertuples()
    assert wide.outcome - wide.forecast > CLOSE
    assert wide.calibrated, "its interval holds it"


@pytest.mark.parametrize("of", ["block", "cell"])
def test_cells_that_go_together_count_as_one(of):
    """Ten in each of fifty clusters, all ten alike: the interval is that of fifty."""
    outcome = np.arange(50) % 2
    together = bins_of(0.45, np.repeat(outcome, 10), **{of: np.repeat(np.arange(50), 10)})
    alone = bins_of(0.45, outcome)
    ours, theirs = (reliability_of(one)["half"].iloc[0] for one in (together, alone))
    assert ours == pytest.approx(theirs, rel=0.02)


def test_the_interval_is_that_of_both_kinds_of_clusters():
    rng = np.random.default_rng(4)
    block, cell = rng.integers(0, 12, 400), rng.integers(0, 30, 400)
    rows = bins_of(0.45, rng.integers(0, 2, 400), block, cell)
    rest = rows["occupied"] - rows["occupied"].mean()

    def variance(keys):
        sums = np.array([rest[[one == key for one in keys]].sum() for key in set(keys)])
        return (sums**2).sum(), len(sums)

    by_block, by_cell = variance(list(block)), variance(list(cell))
    both = by_block[0] * 12 / 11 + by_cell[0] * 30 / 29 - variance(list(zip(block, cell, strict=True)))[0]
    expected = np.sqrt(max(both, by_block[0] * 12 / 11, by_cell[0] * 30 / 29)) / 400 * 2.201  # t of 11
    grouped = rows.groupby(["method", "horizon_s", "bin", "block", "cell"], as_index=False).sum()
    assert reliability_of(grouped)["half"].iloc[0] == pytest.approx(expected, rel=1e-3)
