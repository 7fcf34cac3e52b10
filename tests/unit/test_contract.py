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
from modlhmp.live import Live
from modlhmp.maps.base import read_map
from modlhmp.options import RollOut
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


@pytest.mark.parametrize("name", ["lstm", "neural_map", "cvm", "cliff"])
def test_it_is_kept_whatever_the_time_step(name):
    """Rows 6 s apart are no gaps where that is the site's step; whoever wrote the kind is not to blame for any."""
    walked = contract.crowd()
    slow = walked._replace(t=6 * walked.t, speed=walked.speed / 6)
    site = dataclasses.replace(contract.SITE, hours=None, time_step_s=6.0, horizon_s=6.0 * contract.STEPS)
    check_kind(kinds.find(name), slow, site, **SMALL.get(name, {}))


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


# --- a kind that is used: its faults are told by its name -------------------------------------------------------------


def changing_what_it_is_given(observed, steps, keys):
    whole = straight(observed, steps)
    for part in (*observed, keys):
        part[:] = 0
    return whole


def one_too_few(observed, steps, keys):
    return Forecast(*(part[1:] for part in straight(observed, steps)[:3]), "single")


def of_other_types(observed, steps, keys):
    whole = straight(observed, steps)
    return whole._replace(steps_alive=whole.steps_alive.astype(float))


def a_list(observed, steps, keys):
    return straight(observed, steps)._replace(xy=[[0.0, 0.0]])


def without_fitness(observed, steps, keys):
    whole = straight(observed, steps)
    return whole._replace(log_fitness=np.full_like(whole.log_fitness, np.nan))


def impossible(observed, steps, keys):
    whole = straight(observed, steps)
    return whole._replace(log_fitness=np.full_like(whole.log_fitness, -np.inf))


def several_as_one(observed, steps, keys):
    whole = straight(observed, steps)
    return Forecast(*(np.repeat(part, 2, axis=1) for part in whole[:3]), "single")


def median_of_none(observed, steps, keys):
    return straight(observed, steps)._replace(output="median")


def moving_on_alone(observed, steps, keys):
    return moving_on(observed, steps, keys)._replace(output="single")


FAULTS = [
    (lambda observed, steps, keys: None, "the forecast is NoneType; return a modlhmp.forecasting.base.Forecast"),
    (lambda observed, steps, keys: tuple(straight(observed, steps)), "the forecast is tuple"),
    (a_list, "xy is list, an array of float32 is needed"),
    (in_float64, "xy is float64, float32 is stored"),
    (one_too_few, r"xy has the shape \(\d+, 1, \d+, 2\), \[(\d+), k, \d+, 2\] is needed"),
    (lambda observed, steps, keys: straight(observed, steps)._replace(xy=np.zeros(3, np.float32)), "xy has the shape"),
    (of_other_types, "steps_alive is float64, whole numbers"),
    (without_a_number, "a position is not a number"),
    (without_fitness, "log_fitness is NaN"),
    (several_as_one, "output single of 2 futures"),
    (median_of_none, "output median of 1 futures"),
    (of_no_output, "output 'best' is none of"),
    (alive_for_too_long, "steps_alive runs from"),
]


@pytest.mark.parametrize(("forecast", "message"), FAULTS)
def test_a_forecast_of_another_form_is_refused_by_the_kinds_name(registered, forecast, message):
    """Where it is used, as a `DataError`, and where it is checked."""
    kind = made(forecast)
    registered(mine=kind)
    with pytest.raises(kinds.DataError, match=f"kind mine: {message}"):
        api.forecast("mine", contract.crowd(people=3), 8)
    with pytest.raises(AssertionError, match=message):
        check_kind(kind)


@pytest.mark.parametrize(
    ("forecast", "message"),
    [(impossible, "log_fitness is -inf of all futures"), (moving_on_alone, "a future that has stopped moves")],
)
def test_what_only_the_check_finds(registered, forecast, message):
    registered(mine=made(forecast))
    with pytest.raises(AssertionError, match=message):
        check_kind(made(forecast))


def test_what_a_predictor_does_to_its_arguments_changes_nothing(registered):
    registered(mine=made(changing_what_it_is_given))
    crowd = contract.crowd(people=3)
    futures = api.forecast("mine", crowd, 8)
    np.testing.assert_array_equal(futures.start, api.forecast("cvm", crowd, 8).start)
    check_kind(made(changing_what_it_is_given))


def test_an_exception_of_its_own_code_comes_through_and_leaves_live_as_it_was(registered):
    fails = []

    def forecast(observed, steps, keys):
        return straight(observed, steps) if not fails else fails[0]["cell"]

    registered(mine=made(forecast))
    one, other = (walked_by("mine") for _ in range(2))
    fails.append({})
    with pytest.raises(KeyError, match="cell"):
        one.forecast()
    fails.clear()
    np.testing.assert_array_equal(one.forecast().paths, other.forecast().paths)
    assert (one.counts, one.present, one.who) == (other.counts, other.present, other.who)


def walked_by(kind):
    """A `Live` that somebody walks before."""
    live = Live(kind, 5, site=contract.SITE)
    for t in range(5):
        live.see(1.3e9 + t, "ann", 1.2 * t, 0.0)
    return live


def sampled_kind(sample, draws=1):
    """A kind of the name `mine` whose map is sampled by this function."""
    module = types.ModuleType("made_sampled_kind")
    of_map = types.SimpleNamespace(draws=draws, sample=sample)
    module.build = lambda tracks, site, building: pa.table({"speed": tracks.speed})
    module.load = lambda path, site, options: of_map
    sys.modules[module.__name__] = module
    return Kind(
        name="mine", title="Mine", options=RollOut, module=module.__name__, building=Far,
        forecasts="modlhmp.forecasting.rollout", section="rollout",
    )  # fmt: skip


def turned(x, y, speed, heading, t, uniforms):
    return speed, heading + uniforms[:, 0], np.zeros(len(x)), np.ones(len(x), bool)


def turned_in_place(x, y, speed, heading, t, uniforms):
    heading += uniforms[:, 0]
    uniforms[:], t[:], y[:] = 0, 0, 0
    x += 1
    return speed, heading, np.zeros(len(x)), np.ones(len(x), bool)


def of_map(registered, sample, **options):
    kind = sampled_kind(sample)
    registered(mine=kind)
    crowd = contract.crowd()
    return api.forecast(api.build_map("mine", crowd, contract.SITE), crowd, 8, k=3, **options)


@pytest.mark.parametrize("exits", [None, True])
def test_what_a_map_does_to_its_arguments_changes_nothing(registered, exits):
    ways_out = exits and api.build_map("exits", contract.crowd(), contract.SITE)
    ours, theirs = (of_map(registered, sample, exits=ways_out) for sample in (turned, turned_in_place))
    np.testing.assert_array_equal(ours.paths, theirs.paths)
    check_kind(sampled_kind(turned_in_place))


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({0: lambda speed: speed[:, None]}, r"speed is float64 of the shape \(\d+, 1\), numbers of the shape \(\d+,\)"),
        ({1: lambda heading: heading[1:]}, "heading is float64 of the shape"),
        ({1: lambda heading: heading * np.nan}, "the heading is not a number where it found dynamics"),
        ({2: lambda fitness: fitness * np.nan}, "the log fitness is not a number where it found dynamics"),
        ({3: lambda found: found * 1.0}, "found is float64 of the shape .* true or false"),
        ({2: lambda fitness: None}, "log fitness is object"),
    ],
)
def test_a_sample_of_another_form_is_refused_by_the_kinds_name(registered, changed, message):
    def sample(*given):
        return tuple(changed.get(place, lambda part: part)(part) for place, part in enumerate(turned(*given)))

    with pytest.raises(kinds.DataError, match=f"kind mine: sample: {message}"):
        of_map(registered, sample)
    with pytest.raises(AssertionError, match=message):
        check_kind(sampled_kind(sample))


def test_a_sample_that_is_none_is_refused(registered):
    for sample in (lambda *given: None, lambda *given: turned(*given)[:3]):
        with pytest.raises(kinds.DataError, match=r"kind mine: sample: returned .*, four arrays are needed"):
            of_map(registered, sample)


def test_a_map_may_return_whole_numbers_lists_and_what_is_not_known_where_it_found_nothing(registered):
    def sample(x, y, speed, heading, t, uniforms):
        odd = np.arange(len(x)) % 2
        return [1] * len(x), np.where(odd, heading, np.nan), np.zeros(len(x), int), 3 * odd

    assert 0 < of_map(registered, sample).alive[:, :, 0].mean() < 1
