"""The registry: one record per kind of method. Whatever treats kinds differently asks the record.

Another package adds a kind by an entry point of the group `modlhmp.kinds` that names its record, `Kind(...)`; the
contract that its module must keep is in `docs/extending.md`, and `modlhmp.contract` tests it.
"""

import functools
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import import_module
from importlib.metadata import entry_points
from types import ModuleType

from modlhmp import options
from modlhmp.settings import unknown
from modlhmp.storage import DataError

GROUP = "modlhmp.kinds"
NOT_INSTALLED = "is the package that adds it installed?"
NETWORK_FORECASTS = "modlhmp.networks.forecaster"
ROLL_OUT = "modlhmp.forecasting.rollout"


@dataclass(frozen=True, kw_only=True)
class Kind:
    """A kind of method: its name, options, how its map is built and loaded, and how it is asked.

    `module` holds `build(tracks, site, building) -> pyarrow.Table` (hourly kinds: `build_hours(...) -> (whole,
    {hour: table})`) and `load(path, site, options) -> model`, for a network its class `Network`; `forecasts` names the
    module with `forecaster(model, site, options) -> forecast`. Both are imported when they are needed.
    """

    name: str
    title: str
    options: type  # settings class of a method's options
    module: str | None = None
    forecasts: str | None = None  # None: a map that other methods use, or forecasts that are made of files
    building: type | None = None  # settings class of the map's building; None: there is no map
    built_like: str = ""  # the kind whose building options it shares
    form: str = ""  # the kind whose form its map's tables have, where it is another's
    hourly: bool = False  # one map per clock hour, each a file of a folder
    random: bool = True  # whether forecasts depend on the seed
    outside: bool = False  # forecasts are files that others made
    one_path: bool = False  # whether its forecast is one path, which can be averaged with others'
    from_share: bool = False  # whether its map can be built again from a share of the training tracks
    of_persons: bool = False  # whether building its map holds persons out, so that all of each is to be one track
    learned: bool = False  # a network
    density: bool = False  # whether its map is a density of velocities by place and time (`maps.density`)
    published: bool = False  # one of the paper's methods
    section: str = ""  # the configuration's section with the defaults of its options

    @property
    def has_map(self) -> bool:
        """Whether a map is built for it."""
        return self.building is not None

    @property
    def sampled(self) -> bool:
        """Whether its map is sampled at every step of a roll-out, so that it has beta, r_s and ways out."""
        return self.options is not None and issubclass(self.options, options.RollOut)

    @property
    def map_file(self) -> str:
        """Name of its map under a `maps` folder: a file, or the folder of the hours' files."""
        return self.name if self.hourly else f"{self.name}.parquet"

    @property
    def tables(self) -> str:
        """The kind whose form its map's tables have."""
        return self.form or self.name

    @property
    def has_flows(self) -> bool:
        """Whether its map says of places which ways people go there (`maps.comparison`)."""
        return self.has_map and self.tables in {"cliff", "tc_cliff", "stef"}

    @property
    def has_samples(self) -> bool:
        """Whether a forecast is several futures, which are a distribution; of files from outside it may be."""
        several = self.forecasts is not None and (self.has_map or (self.learned and not self.one_path))
        return several or self.outside

    @property
    def is_method(self) -> bool:
        """Whether a run can compare it: it forecasts, is a mean of others' forecasts, or has some from outside."""
        return self.forecasts is not None or self.name == "average" or self.outside

    def seeds(self, seeds: Sequence[int]) -> list[int]:
        """Those of the seeds with which it is run: without randomness the first is enough."""
        return list(seeds) if self.random else list(seeds[:1])

    @property
    def code(self) -> tuple[str, ...]:
        """Modules that its forecasts depend on."""
        return tuple(name for name in (self.module, self.forecasts) if name)

    def implementation(self) -> ModuleType:
        """The module that builds and loads it."""
        if self.module is None:
            raise DataError(f"kind {self.name}: has nothing to build or load")
        return import_module(self.module)


def _sampled(name: str, title: str, module: str, building: type, **rest: object) -> Kind:
    return Kind(
        name=name, title=title, module=module, building=building, options=options.RollOut,
        forecasts=ROLL_OUT, section="rollout", density=True,
        **{"published": True, **rest},  # type: ignore[arg-type]
    )  # fmt: skip


def _network(name: str, title: str, sizes: type, **rest: object) -> Kind:
    return Kind(
        name=name, title=title, module=f"modlhmp.networks.{name}", options=sizes, learned=True,
        forecasts=NETWORK_FORECASTS, **{"published": True, "one_path": True, "random": False, **rest},  # type: ignore[arg-type]
    )  # fmt: skip


BUILT_IN = (
    _sampled("cliff", "CLiFF", "modlhmp.maps.cliff", options.CliffBuilding, from_share=True),
    _sampled("tc_cliff", "TC-CLiFF", "modlhmp.maps.tc_cliff", options.CliffBuilding, built_like="cliff", hourly=True),
    _sampled(
        "smoothed_cliff", "Smoothed CLiFF", "modlhmp.maps.smoothed_cliff", options.SmoothedBuilding, hourly=True,
        form="tc_cliff", published=False,
    ),
    _sampled("stef", "STeF", "modlhmp.maps.stef", options.StefBuilding, hourly=True),
    _sampled(
        "neural_velocity", "Neural velocity map", "modlhmp.networks.neural_velocity", options.NeuralVelocityBuilding,
        hourly=True, form="tc_cliff", published=False, of_persons=True,
    ),
    Kind(
        name="episodes", title="Episodes", options=options.Episodes, module="modlhmp.maps.episodes",
        forecasts="modlhmp.forecasting.replay", building=options.NoBuilding, random=False, one_path=True,
        from_share=True, section="episodes",
    ),
    Kind(
        name="snippets", title="Snippets", options=options.Snippets, module="modlhmp.maps.snippets",
        forecasts="modlhmp.forecasting.chain", building=options.SnippetBuilding, one_path=True, from_share=True,
        section="snippets",
    ),
    Kind(
        name="pooled", title="Episodes and snippets", options=options.Pooled, module="modlhmp.maps.pooled",
        forecasts="modlhmp.forecasting.pool", building=options.NoBuilding, one_path=True, from_share=True,
        section="pooled",
    ),
    Kind(
        name="exits", title="Ways out", options=options.NoBuilding, module="modlhmp.maps.exits",
        building=options.ExitBuilding, from_share=True,
    ),
    Kind(
        name="cvm", title="CVM", options=options.ConstantVelocity, forecasts="modlhmp.forecasting.cvm", random=False,
        one_path=True, published=True,
    ),
    Kind(name="average", title="Average", options=options.Average, random=False, one_path=True),
    Kind(
        name="forecasts", title="Forecasts from outside", options=options.HandedIn, random=False, one_path=True,
        outside=True,
    ),
    _network("lstm", "LSTM", options.Lstm),
    _network("social_lstm", "Social LSTM", options.Lstm),
    _network("trajectronpp", "Trajectron++", options.Trajectronpp),
    _network("tutr", "TUTR", options.Tutr),
    _network("mid", "MID", options.Mid, one_path=False, random=True),
    _network("neural_map", "Neural map", options.NeuralMap, published=False),
)  # fmt: skip


@functools.cache
def all_kinds() -> dict[str, Kind]:
    """Every kind by name: the library's own, then those of other packages in the order of their names."""
    known = {kind.name: kind for kind in BUILT_IN}
    for point in sorted(entry_points(group=GROUP), key=lambda one: one.name):
        try:
            kind = point.load()
        except Exception as error:  # whatever a package's own module raises
            raise DataError(
                f"entry point {point.name} = {point.value} of {GROUP}: it cannot be loaded ({type(error).__name__}: "
                f"{error}); mend or uninstall that package"
            ) from error
        if not isinstance(kind, Kind):
            raise DataError(f"entry point {point.name} = {point.value} of {GROUP}: it names no modlhmp.kinds.Kind")
        if kind.name in known:
            raise DataError(f"entry point {point.name} = {point.value} of {GROUP}: a kind {kind.name} exists already")
        known[kind.name] = kind
    return known


def find(name: str, *, maps_only: bool = False) -> Kind:
    """The record of a kind; `DataError` with the nearest name, or `maps_only` that of a map, where there is none."""
    if not isinstance(name, str):
        raise DataError(f"kind {name!r}: give the name of a kind, such as 'cliff'")
    for kind in BUILT_IN:  # without a look at what is installed
        if kind.name == name:
            return kind
    if name not in all_kinds():
        known = [kind.name for kind in all_kinds().values() if kind.has_map or not maps_only]
        raise DataError(unknown("kind", "kind of map" if maps_only else "kind", name, known, NOT_INSTALLED))
    return all_kinds()[name]
