"""One factory for all kinds: build a map, load it, and make the forecaster of a method."""

from collections.abc import Mapping
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from modlhmp.forecasting.base import Forecaster
from modlhmp.forecasting.checked import CheckedMap, checked
from modlhmp.kinds import BUILT_IN, ROLL_OUT, Kind, find
from modlhmp.maps.base import DAY, HourlyMod, hour_files
from modlhmp.maps.exits import with_exits
from modlhmp.options import Learning
from modlhmp.settings import as_plain, build
from modlhmp.site import Site
from modlhmp.storage import DataError
from modlhmp.tracks import Tracks, whole_persons


@dataclass(frozen=True, kw_only=True)
class Method:
    """A method: its name, which enters the random numbers, its kind, and all its options."""

    name: str
    kind: str
    options: Any
    learning: Learning | None = None  # of a network
    published: str = ""  # the method whose published map it uses; without one, its kind's map

    @property
    def futures(self) -> int:
        """How many futures it makes per track."""
        return getattr(self.options, "k", 1)

    def plain(self) -> dict[str, Any]:
        """As mappings and scalars, for the parameters of a job."""
        return as_plain(self)

    @classmethod
    def of(cls, plain: Mapping[str, Any]) -> "Method":
        """From what `plain` gave."""
        learning = build(Learning, plain["learning"]) if plain.get("learning") else None
        chosen: Any = build(find(plain["kind"]).options, plain["options"])
        return cls(
            name=plain["name"], kind=plain["kind"], options=chosen, learning=learning,
            published=plain.get("published", ""),
        )  # fmt: skip


def build_map(
    kind: str, tracks: Tracks, site: Site, building: Any, person: np.ndarray | None = None
) -> tuple[pa.Table | None, dict[int, pa.Table]]:
    """The tables of a kind's map: (of the whole day, {hour: of that hour}); one of the two may be missing.

    `person` [rows] numbers whose each row of the tracks is; without it every track is a person of its own.
    """
    record = find(kind)
    if record.of_persons and person is not None:
        tracks = whole_persons(tracks, person)
    module = record.implementation()
    if record.hourly:
        return module.build_hours(tracks, site, building)
    return module.build(tracks, site, building), {}


def load_map(kind: str, path: str | Path, site: Site, options: Any) -> Any:
    """A kind's map from its file, or its folder of hours, ready to be asked; `DataError` where it is not one."""
    if not find(kind).hourly:
        return model_of(kind, path, {}, site, options)
    return model_of(kind, Path(path) / DAY, hour_files(path), site, options)


def model_of(
    kind: str, whole: str | Path | pa.Table | None, hours: Mapping[int, Path | pa.Table], site: Site, options: Any
) -> Any:
    """The tables of a kind's map (`build_map`), or their files, ready to be asked."""
    record = find(kind)
    module = record.implementation()
    if not record.hourly:
        return module.load(whole, site, options)
    return by_hours(
        record, {hour: module.load(one, site, options) for hour, one in hours.items()}, whole, site, options
    )


def by_hours(
    record: Kind, hours: Mapping[int, Any], whole: str | Path | pa.Table | None, site: Site, options: Any
) -> HourlyMod:
    """The loaded maps {hour: map} of a kind as one; with `without_map: whole_day` also that of the whole day."""
    if getattr(options, "without_map", "stop") == "stop":
        return HourlyMod(hours, site.timezone)
    if not hasattr(record.implementation(), "load_whole") or whole is None:
        raise DataError(f"{record.name} has no map of the whole day: use `without_map: stop`")
    return HourlyMod(hours, site.timezone, record.implementation().load_whole(whole, site, options))


def make_forecaster(
    kind: str,
    options: Any,
    site: Site,
    path: str | Path | None = None,
    exits: str | Path | None = None,
    device: str = "auto",
    threads: int = 1,
) -> Forecaster:
    """The forecaster of a method: a function (observed, steps, keys) -> Forecast (contract: `forecasting.base`).

    `options` are of the kind's settings class, `path` leads to its map or weights, `exits` to the ways out for a map
    that is sampled with `exits: true`. `device` and `threads` are for networks.
    """
    record, model = find(kind), None
    if record.learned:
        model = import_module(str(record.forecasts)).load(path, record, options, site, device, threads)
    elif record.has_map:
        model = load_map(kind, str(path), site, options)
    return forecaster_of(record, model, site, options, exits)


def forecaster_of(
    record: Kind, model: Any, site: Site, options: Any, exits: str | Path | pa.Table | None = None
) -> Forecaster:
    """The forecaster of a kind with its loaded map or network, None for a kind that has neither.

    What another package's kind returns is checked whenever it is asked.
    """
    ours = record in BUILT_IN
    if not ours and record.forecasts == ROLL_OUT:
        model = CheckedMap(model, record.name)
    if record.sampled and options.exits:
        if exits is None:
            raise DataError(
                f"{record.name} with exits: true needs the ways out: give a map of kind `exits`, exits=..., or "
                "--exits FILE"
            )
        model = with_exits(model, exits, site)
    ask = import_module(str(record.forecasts)).forecaster(model, site, options)
    return ask if ours else checked(ask, record.name)
