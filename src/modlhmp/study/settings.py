"""The configuration of a run: `config/config.yaml` and its overlays, as typed settings, and what follows from them."""

import dataclasses
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Any, ClassVar, Literal

from annotated_types import Ge, Le, MaxLen, MinLen

from modlhmp import kinds, options
from modlhmp.methods import Method
from modlhmp.settings import (
    From0,
    Positive,
    Seconds,
    Share,
    WholeFrom0,
    WholeFrom1,
    WholeFrom2,
    as_plain,
    check,
    option,
    unknown,
)
from modlhmp.storage import DataError

Pair = Annotated[tuple[str, ...], MinLen(2), MaxLen(2)]
Pairs = tuple[Pair, ...]
Horizons = Annotated[tuple[Seconds, ...], MinLen(1)] | None


@dataclass(frozen=True, kw_only=True)
class MethodEntry:
    """An entry of `methods`; what is left out is that of the kind of the same name."""

    kind: str = option("", "one of the kinds below")
    title: str = option("", "name in tables and figures; left out: the title of a kind, the name of a variant")
    folder: str = option("", "of kind `forecasts`: their folder under `data_root` (docs/your-predictor.md)")
    inherits: str = option("", "method whose options it starts from: all that its kind has, too")
    options: dict[str, Any] = option({}, "what differs from the section of its kind, or from the budget")
    file: str = option(
        "", "a map to forecast with, instead of one that is built: a file or a folder of hours under `data_root`"
    )
    form: str = option("", "the form of `file` (docs/maps.md), where its content does not tell")


@dataclass(frozen=True, kw_only=True)
class Networks(options.Learning):
    """Of every network; a method's own `options` override them."""

    ELSEWHERE: ClassVar = dict.fromkeys(
        (field.name for field in dataclasses.fields(options.Training)),
        "to a kind of network: `budgets` in config/budgets.yaml, or a method's `options`",
    )
    threads: WholeFrom1 = option(1, "threads of a training or forecast")


@dataclass(frozen=True, kw_only=True)
class Ladder:
    """From the paper's configuration to the best one."""

    reference: str = option("tc_cliff", "the method that every row is compared with, as well as with the row above it")
    rows: Pairs = option((), "[method, what changes]; the ladder is left out unless the last row's method is compared")
    beside: tuple[Annotated[tuple[str, ...], MinLen(3), MaxLen(3)], ...] = option(
        (), "[method, against, what differs]: pairs compared beside the rungs"
    )
    horizons_s: Horizons = option(
        None, "horizons of its tables and of the training study [s]; null: 5, 10, 20, 60, by the rule of `tables`"
    )


@dataclass(frozen=True, kw_only=True)
class TrainingShares:
    """Maps from less training data."""

    methods: tuple[str, ...] = option(("cliff", "snippets", "episodes"), "methods whose maps are built from less")
    shares: tuple[Share, ...] = option((0.1, 0.3, 1.0), "shares of the training tracks; an empty list leaves it out")


@dataclass(frozen=True, kw_only=True)
class OccupiedCells:
    """Which cells will be occupied, forecast at moments of whole days without contemporaries."""

    methods: tuple[str, ...] = option(
        ("episodes", "snippets"), "methods with a map and samples, the first one filmed; an empty list leaves it out"
    )
    every_s: Annotated[float, Ge(1), Le(3600)] = option(60.0, "everyone present is forecast every so many seconds [s]")


@dataclass(frozen=True, kw_only=True)
class Studies:
    """One parameter of a method varied, the others as they are."""

    method: str = option("tc_cliff", "the studied method; its map must be one that is sampled")
    beta: tuple[From0, ...] = option((0.1, 0.5, 1, 2, 5, 10), "values of beta; an empty list leaves it out")
    sampling_radius_m: tuple[Positive, ...] = option(
        (0.5, 1, 1.5, 2, 3), "values of r_s [m]; an empty list leaves it out"
    )
    training: TrainingShares = option(TrainingShares(), "maps from less training data")
    occupied: OccupiedCells = option(OccupiedCells(), "which cells will be occupied")
    max_tracks: WholeFrom1 = option(10_000, "at most so many test tracks, always the same ones")


@dataclass(frozen=True, kw_only=True)
class Uncertainty:
    """How good forecasts are as distributions."""

    methods: tuple[str, ...] = option(
        ("tc_cliff", "episodes", "snippets"), "methods with samples, scored if they are compared; an empty list: none"
    )
    samples: WholeFrom2 = option(
        200, "samples drawn from each forecast for the scores; episodes and networks have their own number"
    )


@dataclass(frozen=True, kw_only=True)
class Likelihood:
    """How likely maps make the velocities of people whom they have not seen."""

    methods: tuple[str, ...] = option(
        ("cliff", "tc_cliff", "stef"),
        "methods whose maps are measured, if they are compared, each map once; an empty list: none",
    )
    given: tuple[str, ...] = option(
        ("cvm", "cliff", "tc_cliff", "stef", "episodes", "snippets"),
        "methods whose next velocity is measured given the last ones, if they are compared; an empty list: none",
    )


@dataclass(frozen=True, kw_only=True)
class Demo:
    """The generated recordings."""

    seed: WholeFrom0 = option(1, "of everything made up")
    scale: Positive = option(1.0, "factor on the number of people")


@dataclass(frozen=True, kw_only=True)
class Explorer:
    """The page to look at a run in a browser."""

    tracks: bool | None = option(
        None,
        "whether test tracks and their forecasts can be looked at one by one, of every dataset; null: only where all "
        "people are made up; without them the page has nothing that fewer than 5 people made",
    )


@dataclass(frozen=True, kw_only=True)
class Tables:
    """What tables and tests show."""

    horizons_s: Horizons = option(
        None,
        "horizons of tables, t-tests and figures [s]; those that a dataset has not are left out; null: 5, 10, 20, 30, "
        "60 and its longest, or quarters of its longest where these are under three",
    )


@dataclass(frozen=True, kw_only=True)
class RunSettings:
    """A run."""

    run: str = option(
        meaning="name of the run: data go to `results/<run>`, exhibits to `paper_figures/<run>`; a number is quoted, "
        "`run: \"2024_01\"`, but `--config` drops quotes and takes `'run=!!str 2024_01'`"
    )
    data_root: str = option("data", "folder of the recordings; the environment variable `MODLHMP_DATA` overrides it")
    datasets: Annotated[tuple[str, ...], MinLen(1)] = option(meaning="files of `config/datasets/`, without .yaml")
    evaluate_on: Literal["test", "validation", "folds"] = option(
        "test",
        "`validation`: a part of the training recordings stands in for the test recordings, which are not "
        "read; `folds`: the test recordings by turns, days or blocks of time, forecast from all else but what was "
        "recorded within ten minutes of them",
    )
    test_days: Annotated[tuple[str, ...], MinLen(2), MaxLen(2)] | None = option(
        None, "the first and the last day whose test recordings are forecast, such as [2012-10-28, 2012-11-04]"
    )
    strict: bool = option(False, "whether what checks of the recordings only warn of stops the run as well")
    compare: Annotated[tuple[str, ...], MinLen(1)] = option(meaning="methods to run, in the order of the tables")
    methods: dict[str, MethodEntry] = option(
        {}, "variants: `name: {kind, title, options, ...}`, see Methods; every kind is also a method by itself"
    )
    comparisons: Pairs = option((), "pairs [method, against] of the one-sided t-tests, the first expected to be better")
    seeds: Annotated[tuple[WholeFrom0, ...], MinLen(1)] = option((0, 1, 2, 3, 4), "random seeds; results are means")
    rollout: options.RollOut = option(
        options.RollOut(), "for every map that is sampled; a method's own options override them"
    )
    episodes: options.Episodes = option(options.Episodes(), "for forecasts with an episode map; likewise")
    snippets: options.Snippets = option(options.Snippets(), "for forecasts with a snippet flow map; likewise")
    pooled: options.Pooled = option(options.Pooled(), "for forecasts with whole walks and snippets of them; likewise")
    learned: Networks = option(Networks(), "for every network; likewise")
    budgets: dict[str, dict[str, dict[str, Any]]] = option(
        {}, "`config/budgets.yaml`: windows and sizes of each kind of network, by the name of the budget"
    )
    ladder: Ladder = option(Ladder(), "from the paper's configuration to the best one, one change per row")
    studies: Studies = option(Studies(), "one parameter of a method varied, or the amount of training data")
    uncertainty: Uncertainty = option(Uncertainty(), "how good forecasts are as distributions")
    likelihood: Likelihood = option(Likelihood(), "how likely maps make what people did")
    maps: dict[str, dict[str, Any]] = option({}, "`kind: options`: how maps are built")
    demo: Demo = option(Demo(), "the generated recordings")
    explorer: Explorer = option(Explorer(), "the page to look at a run in a browser")
    tables: Tables = option(Tables(), "horizons of the tables and the t-tests")

    # --- what follows -------------------------------------------------------------------------------------------------

    @cached_property
    def entries(self) -> dict[str, MethodEntry]:
        """Every method that can be named: those of `methods`, and each kind under its own name."""
        by_kind = {
            name: MethodEntry(kind=name, title=kind.title)
            for name, kind in kinds.all_kinds().items()
            if kind.forecasts is not None
        }
        own = {}
        for name, entry in self.methods.items():
            kind = self._kind_of(name)
            own[name] = dataclasses.replace(
                entry, kind=kind, title=entry.title or (by_kind[name].title if name in by_kind else name)
            )
        return {**by_kind, **own}

    def _kind_of(self, name: str) -> str:
        """The kind of a method: its own, that of the same name, or that of the method it inherits from; else none."""
        seen: list[str] = []
        while name not in seen:
            entry = self.methods.get(name, MethodEntry())
            if entry.kind or name in kinds.all_kinds():
                return entry.kind or name
            seen.append(name)
            name = entry.inherits
        return ""

    def ancestors(self, name: str, within: tuple[str, ...] = ()) -> tuple[str, ...]:
        """The methods that a method inherits from, the nearest first; `DataError` for one that there is not."""
        base = self.entries[name].inherits
        if not base:
            return ()
        if base not in self.entries:
            raise DataError(unknown(f"configuration, methods.{name}.inherits", "method", base, self.entries))
        if base in (name, *within):
            raise DataError(f"configuration, methods.{name}.inherits: {base} inherits from {name}, too")
        return (base, *self.ancestors(base, (name, *within)))

    def kind(self, name: str) -> kinds.Kind:
        """The kind of a method."""
        return kinds.find(self.entries[name].kind)

    def title(self, name: str) -> str:
        """A method's name in tables and figures."""
        return self.entries[name].title

    def titles(self, names: Iterable[str]) -> dict[str, str]:
        """Titles of methods by name."""
        return {name: self.title(name) for name in names}

    def members(self, name: str) -> tuple[str, ...]:
        """The methods whose forecasts a method averages; none for most."""
        entry = self.entries[name]
        return tuple(entry.options.get("of", ())) if entry.kind == "average" else ()

    def averaged_parts(self, name: str, within: tuple[str, ...] = ()) -> list[str]:
        """The methods that make their own forecasts of those that a method averages, itself if it averages none."""
        if name in within:
            raise DataError(f"configuration, methods.{name}.options.of: {' of '.join((*within, name))} averages itself")
        parts = [part for one in self.members(name) for part in self.averaged_parts(one, (*within, name))]
        return list(dict.fromkeys(parts)) or [name]

    def published(self, name: str) -> str:
        """The method whose `file` is a method's map: itself, or the nearest it inherits from of its kind; or none."""
        line = [one for one in (name, *self.ancestors(name)) if self.entries[one].kind == self.entries[name].kind]
        return next((one for one in line if self.entries[one].file), "")

    def trained_as(self, name: str) -> str:
        """The method whose training a network uses: the one it inherits from where only the epoch may differ."""
        entry = self.entries[name]
        shared = entry.inherits and self.kind(entry.inherits) is self.kind(name) and entry.options.keys() <= {"epoch"}
        return self.trained_as(entry.inherits) if shared else name

    @cached_property
    def rungs(self) -> Pairs:
        """Rows of the ladder; none unless the last row's method is compared."""
        rows = self.ladder.rows
        return rows if rows and rows[-1][0] in self.compare else ()

    @cached_property
    def ladder_methods(self) -> list[str]:
        """Methods of the ladder: its rungs, what they are compared with, the pairs beside them; none without rungs."""
        beside = [name for *pair, _ in self.ladder.beside for name in pair]
        rungs = [method for method, _ in self.rungs]
        return list(dict.fromkeys([*rungs, self.ladder.reference, *beside])) if rungs else []

    @cached_property
    def methods_run(self) -> list[str]:
        """Names of all methods that a run needs: those compared, those of the ladder, and those that others average."""
        names = [*self.compare, *self.ladder_methods]
        for name in names:  # grows while it is read
            names += [member for member in self.members(name) if member not in names]
        return list(dict.fromkeys(names))

    def building(self, kind: kinds.Kind) -> Any:
        """How a kind's map is built."""
        assert kind.building is not None
        section = kind.built_like or kind.name
        return check(kind.building, self.maps.get(section, {}), "configuration", within=f"maps.{section}")

    def method(self, name: str, tuned: Mapping[str, Mapping[str, Any]] | None = None) -> Method:
        """All that a method's forecasts depend on.

        Options come from the configuration's section for its kind (`rollout` for maps that are sampled, the budget's
        for networks), then from what a dataset file has `tuned` for the kind, or all together from the method that it
        `inherits` from; the method's own `options` override these, and what is `tuned` for the method itself overrides
        both.
        """
        entry, tuned = self.entries[name], tuned or {}
        kind, within = kinds.find(entry.kind), f"methods.{name}.options"
        base = self.method(entry.inherits, tuned) if self.ancestors(name) else None
        start = tuned.get(kind.name, {}) if base is None else _both_have(kind.options, base.options)
        of_entry = {"folder": entry.folder} if entry.folder else {}
        own = {**start, **of_entry, **entry.options, **tuned.get(name, {})}
        if kind.learned:
            shared = {f.name: getattr(self.learned, f.name) for f in dataclasses.fields(options.Learning)}
            if base is not None and base.learning is not None:
                shared = as_plain(base.learning)
            chosen = {f.name: own.pop(f.name) for f in dataclasses.fields(options.Learning) if f.name in own}
            learning = check(options.Learning, {**shared, **chosen}, "configuration", within=within)
            if learning.budget not in self.budgets:
                section = within if "budget" in chosen else "learned"
                raise DataError(unknown(f"configuration, {section}.budget", "budget", learning.budget, self.budgets))
            budget = self.budgets[learning.budget].get(kind.name, {})
            found: Any = check(kind.options, {**budget, **own}, "configuration", within=within)
            return Method(name=name, kind=kind.name, options=found, learning=learning)
        defaults = as_plain(getattr(self, kind.section)) if kind.section else {}
        if kind.options is options.ConstantVelocity:
            defaults = {"velocity": self.rollout.velocity}
        found = check(kind.options, {**defaults, **own}, "configuration", within=within)
        return Method(name=name, kind=kind.name, options=found, published=self.published(name))


def _both_have(cls: type, found: Any) -> dict[str, Any]:
    """The options of one kind that another kind has as well."""
    plain = as_plain(found)
    return {field.name: plain[field.name] for field in dataclasses.fields(cls) if field.name in plain}
