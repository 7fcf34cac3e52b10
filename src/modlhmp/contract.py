"""The contract of a kind, as checks that its author can run.

    from modlhmp.contract import check_kind
    check_kind(KIND)              # of a package that registers KIND under the entry point group `modlhmp.kinds`

Every check raises `AssertionError` with what was expected of the kind.
"""

import dataclasses
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pyarrow as pa

from modlhmp.api import build_map, load_map
from modlhmp.forecasting.base import Forecast, Forecaster
from modlhmp.forecasting.checked import fault
from modlhmp.forecasting.observe import Observed, observe
from modlhmp.forecasting.recording import forecast_recording
from modlhmp.forecasting.windows import usable, windows
from modlhmp.kinds import Kind, all_kinds
from modlhmp.methods import forecaster_of
from modlhmp.settings import check, fields_of
from modlhmp.site import Site
from modlhmp.storage import DataError
from modlhmp.streams import stream_keys
from modlhmp.tracks import Tracks

STEPS, FUTURES = 8, 3
SITE = Site(timezone="Europe/London", hours=(7, 9), horizon_s=STEPS)


def crowd(people: int = 80, seconds: int = 20, apart_s: float = 40.0) -> Tracks:
    """Made-up tracks, 1 Hz: people who walk along a corridor both ways, side by side, at two hours of a day.

    One comes `apart_s` after the other: by default nobody meets anybody.
    """
    rng, parts = np.random.default_rng(0), []
    for person in range(people):
        way, t = 1.0 if person % 2 else -1.0, np.arange(seconds, dtype=float)
        began = 1.3e9 + apart_s * person + 3600.0 * (person >= people // 2)
        x = way * (rng.normal(1.2, 0.1) * t - 10.0) + rng.normal(0, 0.03, seconds)
        y = rng.normal(0, 0.5) + rng.normal(0, 0.03, seconds)
        speed, heading = np.full(seconds, np.nan), np.full(seconds, np.nan)
        speed[1:], heading[1:] = np.hypot(np.diff(x), np.diff(y)), np.arctan2(np.diff(y), np.diff(x))
        parts.append((np.full(seconds, person), began + t, x, y, speed, heading))
    return Tracks(*map(np.concatenate, zip(*parts, strict=True)))


def check_kind(kind: Kind, tracks: Tracks | None = None, site: Site = SITE, **options: Any) -> None:
    """Check everything that the workflow and the library rely on; `options` are a method's, where defaults will not do.

    `tracks` (by default `crowd()`) are what its map is built from and whom it forecasts. A network is built, and
    trained for three steps: its loss must be a finite number on some scenes.
    """
    check_record(kind)
    meeting = crowd(apart_s=0.3) if tracks is None else tracks
    tracks = crowd() if tracks is None else tracks
    chosen: Any = check(kind.options, options, f"options of {kind.name}")
    if kind.learned:
        return check_blind(check_network(kind, chosen, tracks, site), meeting, site, getattr(chosen, "k", 1), True)
    if kind.forecasts is None:
        return None
    model = exits = a_map = None
    if kind.has_map:
        a_map = build_map(kind.name, tracks, site)
        model = a_map.model(chosen)
        exits = build_map_of_exits(tracks, site) if kind.sampled and chosen.exits else None
    forecaster = forecaster_of(kind, model, site, chosen, exits)
    try:
        check_forecaster(forecaster, tracks, site, kind.random)
        check_blind(forecaster, meeting, site, FUTURES)
    except DataError as error:  # what whoever uses it would be told
        raise AssertionError(str(error)) from None
    if a_map is None:
        return None
    with TemporaryDirectory() as folder:
        path = Path(folder) / kind.map_file
        a_map.save(path)
        again = load_map(path)
    same = again.kind == kind.name and again.hours.keys() == a_map.hours.keys()
    pairs = [(a_map.whole, again.whole), *((table, again.hours.get(hour)) for hour, table in a_map.hours.items())]
    assert same and all(_same_table(*pair) for pair in pairs), (
        f"{kind.name}: a map that is saved and loaded is another one"
    )
    return None


def check_record(kind: Kind) -> None:
    """The record itself: it is registered, its options are settings with defaults and meanings, its modules exist."""
    assert all_kinds().get(kind.name) == kind, f"{kind.name}: it is registered under no entry point of modlhmp.kinds"
    for cls in filter(None, (kind.options, kind.building)):
        assert dataclasses.is_dataclass(cls), f"{kind.name}: {cls.__name__} is no dataclass"
        check(cls, {}, f"{kind.name}: {cls.__name__}, its defaults")
        silent = [name for name, _, _, meaning in fields_of(cls) if not meaning]
        assert not silent, f"{kind.name}: options {silent} of {cls.__name__} say nothing: use modlhmp.settings.option"
    for module in kind.code:
        import_module(module)
    if kind.has_map:
        wanted = ["build_hours" if kind.hourly else "build", *(["load"] if kind.forecasts else [])]
        missing = [name for name in wanted if not hasattr(kind.implementation(), name)]
        assert not missing, f"{kind.name}: {kind.module} lacks {', '.join(missing)}"


def check_forecaster(forecaster: Forecaster, tracks: Tracks, site: Site, random: bool = True) -> None:
    """Shapes, types and the rules of random numbers: a forecast depends on its track and keys, and on nothing else."""
    observed = observe(tracks, usable(tracks, site), site.observed_rows)
    keys = stream_keys(observed.track_id, FUTURES, 0, "contract")
    whole = forecaster(observed, STEPS, keys)
    check_forecast(whole, observed, STEPS)
    _same(whole, forecaster(observed, STEPS, keys), "asked again, it forecasts something else")
    order = np.random.default_rng(1).permutation(len(keys))
    some = _take(observed, order[: len(order) // 2])
    part = forecaster(some, STEPS, keys[order[: len(order) // 2]])
    _same(_rows(whole, order[: len(order) // 2]), part, "a forecast depends on who else is forecast, or in which order")
    other = forecaster(observed, STEPS, stream_keys(observed.track_id, FUTURES, 1, "contract"))
    changed = not np.array_equal(whole.xy, other.xy)
    assert changed or random is False or whole.xy.shape[1] == 1, "the kind says `random`, but the keys change nothing"
    assert random or not changed, "the kind says that it is not `random`, but the keys change its forecasts"


def check_blind(forecaster: Forecaster, tracks: Tracks, site: Site, k: int, learned: bool = False) -> None:
    """Forecasts of a recording are the same to the bit whatever comes after t0.

    At some moments everyone's later rows, neighbours' of a network too, are made noise, then taken away but for one.
    """
    site = dataclasses.replace(site, forecast_every_s=None)
    wanted, rng = windows(tracks, site), np.random.default_rng(2)

    def asked_at(moment: float, known: Tracks) -> list[tuple[int, np.ndarray, Forecast]]:
        of = np.isin(known.track_id, wanted.track_id[wanted.t0 <= moment])
        others = [known.take(~of)] if learned else None
        return list(forecast_recording(known.take(of), forecaster, site, ("contract",), k, (0,), others))

    for moment in np.quantile(wanted.t0, (0.1, 0.5, 0.9), method="nearest"):
        late = tracks.t > moment
        noise = (np.where(late, part + rng.normal(0, 20, len(late)), part) for part in tracks[2:])
        changed = Tracks(tracks.track_id, tracks.t, *noise)
        goes_on = late & np.append(False, late[:-1] & (tracks.track_id[1:] == tracks.track_id[:-1]))
        whole = asked_at(moment, tracks)
        for other in (changed, changed.take(~goes_on)):  # without any later row it would not be forecast
            for (_, ids, ours), (_, others, theirs) in zip(whole, asked_at(moment, other), strict=True):
                assert np.array_equal(ids, others), "whom it forecasts depends on what comes after t0"
                _same(ours, theirs, "a forecast depends on what comes after t0")


def check_forecast(forecast: Forecast, observed: Observed, steps: int) -> None:
    """The form of a `Forecast` of these walkers."""
    found = fault(forecast, len(observed.track_id), steps)
    assert not found, found
    n, k, lived = *forecast.xy.shape[:2], forecast.steps_alive
    assert not np.isneginf(forecast.log_fitness).all(), "log_fitness is -inf of all futures, which ranks none"
    if forecast.output == "modes":
        total = np.exp(forecast.results.log_fitness).sum(axis=1)
        assert np.allclose(total, 1, atol=1e-4), "the log fitness of the first futures is no log of probabilities"
    start = np.column_stack([observed.x[:, -1], observed.y[:, -1]]).astype(np.float32)
    before = np.concatenate([np.broadcast_to(start[:, None, None], (n, k, 1, 2)), forecast.xy], axis=2)
    held = np.arange(steps)[None, None] >= lived[..., None]
    if forecast.output != "ranked":  # whom a map does not know, others may let walk on
        held &= lived[..., None] > 0
    moved = (before[:, :, 1:] != before[:, :, :-1]).any(axis=-1) & held
    assert not moved.any(), "a future that has stopped moves; hold it at its last alive position"


def check_network(kind: Kind, options: Any, tracks: Tracks, site: Site) -> Forecaster:
    """A network is built from its options, has a finite loss, and forecasts; returns the forecaster."""
    import torch  # noqa: PLC0415 - only networks need it

    scenes = import_module("modlhmp.networks.data")
    training = import_module("modlhmp.networks.training")
    with torch.random.fork_rng(devices=[]):
        network = training.build_network(kind, options, site)
        day = scenes.day_of(tracks, [], site)
        first = day.rows[:, 0]
        arrays = scenes.scenes_at(day, first, day.rows[:, 1], site.steps, site.observed_rows, site.time_step_s)
        batch = scenes.Scenes(*(torch.from_numpy(part) for part in arrays))
        torch.manual_seed(0)
        network.planned_iterations = 1
        network.prepare(batch)
        loss = network.loss(batch)
        assert loss.ndim == 0 and torch.isfinite(loss), f"{kind.name}: the loss is {loss}, a finite scalar is needed"
        optimiser = network.optimiser(0.01)
        for _ in range(3):  # so that weights that begin as zeros are none
            optimiser.zero_grad()
            network.loss(batch).backward()
            optimiser.step()
    forecaster = import_module(str(kind.forecasts)).forecaster(network.eval(), site, options)
    observed = observe(tracks, usable(tracks, site), site.observed_rows)
    alone = observed._replace(neighbours=np.full((len(observed.track_id), 5, site.observed_rows, 2), np.nan))
    k = getattr(options, "k", 1)
    futures = forecaster(alone, site.steps, stream_keys(observed.track_id, k, 0, "contract"))
    check_forecast(futures, observed, site.steps)
    return forecaster


def build_map_of_exits(tracks: Tracks, site: Site) -> pa.Table:
    """The ways out of these tracks."""
    from modlhmp.maps.exits import build  # noqa: PLC0415 - for methods with `exits: true` only

    return build(tracks, site)


def _same_table(ours: pa.Table | None, theirs: pa.Table | None) -> bool:
    """Whether two tables hold the same, NaN where the other has NaN, which `equals` calls a difference."""
    if ours is None or theirs is None:
        return ours is theirs
    return ours.schema.equals(theirs.schema) and all(
        one.equals(other) or repr(one.to_pylist()) == repr(other.to_pylist())
        for one, other in zip(ours.columns, theirs.columns, strict=True)
    )


def _same(ours: Forecast, theirs: Forecast, complaint: str) -> None:
    same = all(np.array_equal(a, b) for a, b in zip(ours[:3], theirs[:3], strict=True))
    assert same, complaint


def _take(observed: Observed, rows: Sequence[int] | np.ndarray) -> Observed:
    return Observed(*(part[rows] for part in observed))


def _rows(forecast: Forecast, rows: np.ndarray) -> Forecast:
    return Forecast(*(part[rows] for part in forecast[:3]), forecast.output)  # type: ignore[call-arg]
