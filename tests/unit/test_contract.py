"""The contract of a kind: every built-in one and an outside package's keep it, broken ones are told what they broke."""

import dataclasses
import re
import sys
import types
from dataclasses import dataclass
from importlib.metadata import EntryPoint
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest

from modlhmp import api, contract, kinds
from modlhmp.contract import check_kind
from modlhmp.forecasting.base import Forecast
from modlhmp.kinds import BUILT_IN, Kind
from modlhmp.maps.base import read_map
from modlhmp.settings import option

OUTSIDE = Path(__file__).parents[1] / "outside/walking/src"
SMALL = {  # networks of a size that is built at once
    "lstm": {"hidden": 8},
    "social_lstm": {"hidden": 8},
    "trajectronpp": {"decoder": 8},
    "tutr": {"modes": 4, "width": 16},
    "mid": {"context": 8},
    "neural_map": {},
}


@pytest.fixture
def registered(monkeypatch):
    """Function (kinds by name): the registry with these beside its own."""

    def register(**others):
        monkeypatch.setattr(kinds, "all_kinds", lambda: {**{kind.name: kind for kind in BUILT_IN}, **others})
        monkeypatch.setattr(contract, "all_kinds", kinds.all_kinds)

    return register


@pytest.mark.parametrize("kind", BUILT_IN, ids=lambda kind: kind.name)
def test_built_in_kinds_keep_it(kind, monkeypatch):
    """And are asked whether they are blind to the future, those without a forecaster elsewhere (`test_blind.py`)."""
    blind, asked = contract.check_blind, []
    monkeypatch.setattr(contract, "check_blind", lambda *given: asked.append(kind) or blind(*given))
    check_kind(kind, **SMALL.get(kind.name, {}))
    assert bool(asked) == (kind.name not in {"exits", "average", "forecasts"})


@pytest.mark.parametrize("output", ["medoid", "modes"])
@pytest.mark.parametrize("name", ["cliff", "episodes", "snippets", "pooled"])
def test_every_output_keeps_it(name, output):
    check_kind(kinds.find(name), output=output)


@pytest.mark.parametrize("observed_rows", [2, 8])
@pytest.mark.parametrize("name", ["cvm", "cliff", "episodes", "snippets", "pooled"])
def test_it_is_kept_whatever_the_number_of_observed_rows(name, observed_rows):
    """Two rows give one velocity, eight seven: more than there are weights."""
    check_kind(kinds.find(name), site=dataclasses.replace(contract.SITE, observed_rows=observed_rows))


@pytest.mark.parametrize("name", ["MEAN_FLOW", "STANDING", "LINE"])
def test_an_outside_package_keeps_it(monkeypatch, registered, name):
    """The three that `tests/outside/walking` registers by entry points."""
    monkeypatch.syspath_prepend(OUTSIDE)
    kind = getattr(__import__("walking"), name)
    registered(**{kind.name: kind})
    check_kind(kind)


def test_the_check_of_the_docs_runs(monkeypatch, registered):
    """As docs/extending.md has it, on the map of that package."""
    page = (Path(__file__).parents[2] / "docs/extending.md").read_text()
    check = re.findall(r"```python\n(.*?)```", page, re.DOTALL)[-1]
    monkeypatch.syspath_prepend(OUTSIDE)
    kind = __import__("walking").MEAN_FLOW
    registered(**{kind.name: kind})
    monkeypatch.setitem(sys.modules, "mymaps", types.SimpleNamespace(KIND=kind))
    assert "check_kind(KIND)" in check
    exec(check, {})


# --- what is registered -------------------------------------------------------------------------------------


def test_entry_points_are_found(monkeypatch):
    monkeypatch.syspath_prepend(OUTSIDE)
    points = [EntryPoint(name, f"walking:{name.upper()}", kinds.GROUP) for name in ("standing", "line", "mean_flow")]
    monkeypatch.setattr(kinds, "entry_points", lambda group: points)
    kinds.all_kinds.cache_clear()
    try:
        assert list(kinds.all_kinds())[-3:] == ["line", "mean_flow", "standing"]
        assert kinds.find("line").title == "Learned line"
    finally:
        kinds.all_kinds.cache_clear()


@pytest.mark.parametrize(
    ("value", "message"),
    [
        ("modlhmp.options:RollOut", r"entry point mine = modlhmp.options:RollOut .*: it names no modlhmp.kinds.Kind"),
        ("modlhmp.kinds:BUILT_IN", "it names no modlhmp.kinds.Kind"),
        ("broken_kinds:SAME", "a kind cvm exists already"),
    ],
)
def test_an_entry_point_that_is_no_kind_is_refused(monkeypatch, value, message):
    module = types.ModuleType("broken_kinds")
    module.SAME = kinds.find("cvm")
    monkeypatch.setitem(sys.modules, "broken_kinds", module)
    monkeypatch.setattr(kinds, "entry_points", lambda group: [EntryPoint("mine", value, kinds.GROUP)])
    kinds.all_kinds.cache_clear()
    try:
        with pytest.raises(kinds.DataError, match=message):
            kinds.all_kinds()
    finally:
        kinds.all_kinds.cache_clear()


# --- kinds that break it ------------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class Far:
    """Options of a kind."""

    metres: float = option(1.0, "how far")


@dataclass(frozen=True, kw_only=True)
class Silent:
    """Options that say nothing."""

    metres: float = 1.0


class Plain:
    """Not even a dataclass."""


def straight(observed, steps):
    """A forecast that keeps the contract: straight on along x."""
    n = len(observed.track_id)
    xy = np.repeat(np.stack([observed.x[:, -1:], observed.y[:, -1:]], axis=-1)[:, :, None], steps, axis=2)
    xy[..., 0] += np.arange(1, steps + 1)
    return Forecast(
        xy.astype(np.float32), np.zeros((n, 1, steps), np.float32), np.full((n, 1), steps, np.int32), "ranked"
    )


def by_order(observed, steps, keys):
    whole = straight(observed, steps)
    return whole._replace(xy=whole.xy + np.arange(len(whole.xy), dtype=np.float32)[:, None, None, None])


def moving_on(observed, steps, keys):
    whole = straight(observed, steps)
    return whole._replace(steps_alive=whole.steps_alive - 3)


def in_float64(observed, steps, keys):
    whole = straight(observed, steps)
    return whole._replace(xy=whole.xy.astype(np.float64))


def without_a_number(observed, steps, keys):
    whole = straight(observed, steps)
    whole.xy[0, 0, -1] = np.nan
    return whole


def too_long(observed, steps, keys):
    return straight(observed, steps + 1)


def of_no_output(observed, steps, keys):
    return straight(observed, steps)._replace(output="best")


def alive_for_too_long(observed, steps, keys):
    whole = straight(observed, steps)
    return whole._replace(steps_alive=whole.steps_alive + 1)


def by_keys(observed, steps, keys):
    whole = straight(observed, steps)
    return whole._replace(xy=whole.xy + (keys[:, :1, None, None] % 7).astype(np.float32))


def made(forecast=lambda observed, steps, keys: straight(observed, steps), **changes):
    """A kind of the name `mine` whose forecaster is this function."""
    module = types.ModuleType(f"made_kind_{forecast.__name__.strip('<>')}")
    module.forecaster = lambda model, site, options: forecast
    sys.modules[module.__name__] = module
    record = {"name": "mine", "title": "Mine", "options": Far, "forecasts": module.__name__, "random": False}
    return Kind(**{**record, **changes})


def test_a_kind_as_small_as_that_keeps_it(registered):
    registered(mine=made())
    check_kind(made())


def map_of_speeds(**changes):
    """A kind whose map holds every row's speed, those that are not known too; what it is loaded from is checked."""
    kind = made(building=Far, module="made_map_of_speeds", **changes)
    module = types.ModuleType(kind.module)

    def build(tracks, site, building):
        pairs = pa.FixedSizeListArray.from_arrays(np.repeat(tracks.speed, 2), 2)
        return pa.table({"speed": tracks.speed, "pair": pairs}).replace_schema_metadata({"far": "1.0"})

    def load(path, site, options):
        return read_map(path, "a map of speeds", (), ("far",))  # its numbers may be NaN

    module.build, module.load = build, load
    sys.modules[module.__name__] = module
    return kind


def test_a_map_may_hold_what_is_not_known(registered):
    """A track's first row has no speed, and NaN is not equal to itself."""
    registered(mine=map_of_speeds())
    assert np.isnan(contract.crowd().speed).any()
    check_kind(map_of_speeds())


@pytest.mark.parametrize("lost", ["a row", "a speed", "a column"])
def test_a_map_that_comes_back_as_another_one_is_found(registered, monkeypatch, lost):
    registered(mine=map_of_speeds())

    def load_another(path):
        found = api.load_map(path)
        speed = found.whole["speed"].to_numpy().copy()
        speed[1] = np.nan
        column = found.whole.column_names.index("speed")
        others = {
            "a row": found.whole.slice(1),
            "a speed": found.whole.set_column(column, "speed", pa.array(speed)),
            "a column": found.whole.drop_columns("pair"),
        }
        return dataclasses.replace(found, whole=others[lost])

    monkeypatch.setattr(contract, "load_map", load_another)
    with pytest.raises(AssertionError, match="mine: a map that is saved and loaded is another one"):
        check_kind(map_of_speeds())


@pytest.mark.parametrize(
    ("kind", "message"),
    [
        (made(by_order), "a forecast depends on who else is forecast, or in which order"),
        (made(moving_on), "a future that has stopped moves; hold it at its last alive position"),
        (made(in_float64), "xy is float64, float32 is stored"),
        (made(without_a_number), "a position is not a number; hold a future that stops at its last one"),
        (made(too_long), "log_fitness has the shape|xy has the shape"),
        (made(of_no_output), "output 'best' is none of ranked, median, medoid, modes, mean, single"),
        (made(alive_for_too_long), "steps_alive runs from 9 to 9 of 8"),
        (made(by_keys), "it is not `random`, but the keys change its forecasts"),
        (made(options=Silent), r"options \['metres'\] of Silent say nothing: use modlhmp.settings.option"),
        (made(options=Plain), "Plain is no dataclass"),
        (made(module="modlhmp.streams", building=Far), "modlhmp.streams lacks build, load"),
        (made(module="modlhmp.streams", building=Far, hourly=True), "modlhmp.streams lacks build_hours, load"),
    ],
)
def test_a_broken_kind_is_told_what_it_broke(registered, kind, message):
    registered(mine=kind)
    with pytest.raises(AssertionError, match=message):
        check_kind(kind)


def test_a_kind_that_nobody_registers_is_told_so():
    with pytest.raises(AssertionError, match="mine: it is registered under no entry point"):
        check_kind(made())
