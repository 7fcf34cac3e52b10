"""The configuration of a run: `config/config.yaml` and its overlays, as typed settings, and what follows from them."""

import dataclasses
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

from annotated_types import MaxLen, MinLen

from modlhmp import kinds, options
from modlhmp.datasets import Dataset, load_dataset, validation_part
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


@dataclass(frozen=True, kw_only=True)
class MethodEntry:
    """An entry of `methods`; what is left out is that of the kind of the same name."""

    kind: str = option("", "one of the kinds below")
    title: str = option("", "name in tables and figures")
    options: dict[str, Any] = option({}, "what differs from the section of its kind, or from the budget")


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
    horizons_s: Annotated[tuple[Seconds, ...], MinLen(1)] = option((5, 10, 20, 60), "horizons of its tables [s]")


@dataclass(frozen=True, kw_only=True)
class TrainingShares:
    """Maps from less training data."""

    methods: tuple[str, ...] = option(("cliff", "snippets", "episodes"), "methods whose maps are built from less")
    shares: tuple[Share, ...] = option((0.1, 0.3, 1.0), "shares of the training tracks; an empty list leaves it out")


@dataclass(frozen=True, kw_only=True)
class Studies:
    """One parameter of a method varied, the others as they are."""

    method: str = option("tc_cliff", "the studied method; its map must be one that is sampled")
    beta: tuple[From0, ...] = option((0.1, 0.5, 1, 2, 5, 10), "values of beta; an empty list leaves it out")
    sampling_radius_m: tuple[Positive, ...] = option(
        (0.5, 1, 1.5, 2, 3), "values of r_s [m]; an empty list leaves it out"
    )
    training: TrainingShares = option(TrainingShares(), "maps from less training data")
    max_tracks: WholeFrom1 = option(10_000, "at most so many test tracks, always the same ones")


@dataclass(frozen=True, kw_only=True)
class Uncertainty:
    """How good forecasts are as distributions."""

    methods: tuple[str, ...] = option(
        ("tc_cliff", "episodes", "snippets"), "methods with samples, scored if they are compared; an empty list: none"
    )
    samples: WholeFrom2 = option(200, "samples drawn from each forecast for the scores; episodes have k")


@dataclass(frozen=True, kw_only=True)
class Demo:
    """The generated recordings."""

    seed: WholeFrom0 = option(1, "of everything made up")
    scale: Positive = option(1.0, "factor on the number of people")


@dataclass(frozen=True, kw_only=True)
class Tables:
    """What tables and tests show."""

    horizons_s: Annotated[tuple[Seconds, ...], MinLen(1)] = option(
        (5, 10, 20, 30, 60),
        "horizons of the results table and the t-tests [s]; those beyond a dataset's longest are left out",
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
    evaluate_on: Literal["test", "validation"] = option(
        "test", "`validation`: a part of the training recordings stands in for the test recordings, which are not read"
    )
    compare: Annotated[tuple[str, ...], MinLen(1)] = option(meaning="methods to run, in the order of the tables")
    methods: dict[str, MethodEntry] = option(
        {}, "variants: `name: {kind, title, options}`; every kind is also a method by itself"
    )
    comparisons: Pairs = option((), "pairs [method, against] of the one-sided t-tests, the first expected to be better")
    seeds: Annotated[tuple[WholeFrom0, ...], MinLen(1)] = option((0, 1, 2, 3, 4), "random seeds; results are means")
    rollout: options.RollOut = option(
        options.RollOut(), "for every map that is sampled; a method's own options override them"
    )
    episodes: options.Episodes = option(options.Episodes(), "for forecasts with an episode map; likewise")
    snippets: options.Snippets = option(options.Snippets(), "for forecasts with a snippet flow map; likewise")
    learned: Networks = option(Networks(), "for every network; likewise")
    budgets: dict[str, dict[str, dict[str, Any]]] = option(
        {}, "`config/budgets.yaml`: epochs and sizes of each kind of network, by the name of the budget"
    )
    ladder: Ladder = option(Ladder(), "from the paper's configuration to the best one, one change per row")
    studies: Studies = option(Studies(), "one parameter of a method varied, or the amount of training data")
    uncertainty: Uncertainty = option(Uncertainty(), "how good forecasts are as distributions")
    maps: dict[str, dict[str, Any]] = option({}, "`kind: options`: how maps are built")
    demo: Demo = option(Demo(), "the generated recordings")
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
            kind = entry.kind or (name if name in by_kind else "")
            own[name] = dataclasses.replace(
                entry, kind=kind, title=entry.title or getattr(by_kind.get(kind), "title", "")
            )
        return {**by_kind, **own}

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
        for networks), then from what a dataset file has `tuned` for the kind; the method's own `options`
        override these, and what is `tuned` for the method itself overrides both.
        """
        entry, tuned = self.entries[name], tuned or {}
        kind, within = kinds.find(entry.kind), f"methods.{name}.options"
        own = {**tuned.get(kind.name, {}), **entry.options, **tuned.get(name, {})}
        if kind.learned:
            chosen = {f.name: own.pop(f.name) for f in dataclasses.fields(options.Learning) if f.name in own}
            shared = {f.name: getattr(self.learned, f.name) for f in dataclasses.fields(options.Learning)}
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
        return Method(name=name, kind=kind.name, options=found)


def load_run(config: Mapping[str, Any], datasets_folder: str | Path) -> RunSettings:
    """The run that a configuration describes; `DataError` that names every key that is wrong, and the remedy."""
    run = check(RunSettings, dict(config), "configuration")
    if not re.fullmatch("[A-Za-z0-9_-]+", run.run):
        raise DataError(f"configuration, run: {run.run!r}: a name of letters, digits, _ and - only")
    studies = run.studies
    lists: dict[str, tuple[Any, ...]] = {
        "datasets": run.datasets, "compare": run.compare, "seeds": run.seeds, "studies.beta": studies.beta,
        "studies.sampling_radius_m": studies.sampling_radius_m, "studies.training.shares": studies.training.shares,
        "uncertainty.methods": run.uncertainty.methods,
    }  # fmt: skip
    for key, values in lists.items():
        if len(set(values)) < len(values):
            raise DataError(f"configuration, {key}: {list(values)} has non-unique elements")
    if 0 in run.studies.training.shares:
        raise DataError("configuration, studies.training.shares: 0: a share is above 0")
    _check_sections(run)
    _check_entries(run)
    _check_names(run)
    known = sorted(file.stem for file in Path(datasets_folder).glob("*.yaml"))
    for name in run.datasets:
        if name not in known:
            raise DataError(unknown("configuration, datasets", "dataset", name, known))
    return run


def _check_entries(run: RunSettings) -> None:
    """Kinds, options and members of every method."""
    for name, entry in run.entries.items():
        if not re.fullmatch("[A-Za-z0-9_-]+", name):
            raise DataError(f"configuration, methods: {name!r}: a name of letters, digits, _ and - only")
        known = [
            kind.name for kind in kinds.all_kinds().values() if kind.forecasts is not None or kind.name == "average"
        ]
        if not entry.kind:
            raise DataError(f"configuration, methods.{name}: say of which `kind` it is: {', '.join(known)}")
        if entry.kind not in known:
            raise DataError(
                unknown(f"configuration, methods.{name}.kind", "kind", entry.kind, known, kinds.NOT_INSTALLED)
            )
        for member in run.members(name):
            if member not in run.entries:
                raise DataError(unknown(f"configuration, methods.{name}.options.of", "method", member, run.entries))
            if not run.kind(member).one_path:
                paths = [kind.name for kind in kinds.all_kinds().values() if kind.one_path]
                raise DataError(
                    f"configuration, methods.{name}.options.of: {member} has no single path to be averaged; "
                    f"kinds that have one are {', '.join(sorted(paths))}"
                )
        if entry.kind == "average" and len(run.members(name)) < 2:
            raise DataError(f"configuration, methods.{name}.options.of: name at least two methods to be averaged")
        run.averaged_parts(name)
        run.method(name)


def _check_sections(run: RunSettings) -> None:
    """What maps are built with, and the budgets of networks."""
    for section, given in run.maps.items():
        built = {k.name: k for k in kinds.all_kinds().values() if k.building is not None and not k.built_like}
        if section not in built:
            raise DataError(unknown("configuration, maps", "map", section, built))
        check(built[section].building, given, "configuration", within=f"maps.{section}")  # type: ignore[arg-type]
    for budget, networks in run.budgets.items():
        learned = {k.name: k for k in kinds.all_kinds().values() if k.learned}
        for network, given in networks.items():
            if network not in learned:
                raise DataError(unknown(f"configuration, budgets.{budget}", "network", network, learned))
            check(learned[network].options, given, "configuration", within=f"budgets.{budget}.{network}")


def _check_names(run: RunSettings) -> None:
    """Every method that a section names exists, and can do what is asked of it."""
    named = {
        "compare": run.compare,
        "studies.method": [run.studies.method],
        "studies.training.methods": run.studies.training.methods,
        "uncertainty.methods": run.uncertainty.methods,
        "comparisons": [name for pair in run.comparisons for name in pair],
        "ladder.reference": [run.ladder.reference],
        "ladder.rows": [method for method, _ in run.ladder.rows],
        "ladder.beside": [name for *pair, _ in run.ladder.beside for name in pair],
    }
    for key, names in named.items():
        for name in names:
            if name not in run.entries:
                raise DataError(unknown(f"configuration, {key}", "method", name, run.entries, kinds.NOT_INSTALLED))
    for name in run.studies.training.methods:
        if not run.kind(name).from_share:
            able = [kind.name for kind in kinds.all_kinds().values() if kind.from_share and kind.forecasts]
            raise DataError(f"configuration, studies.training: {name} is of none of the kinds {', '.join(able)}")
    if not run.kind(run.studies.method).sampled:
        raise DataError(
            f"configuration, studies.method: {run.studies.method} has no map to sample, so neither beta nor r_s"
        )
    for name in run.uncertainty.methods:
        if not run.kind(name).has_map:
            able = [kind.name for kind in kinds.all_kinds().values() if kind.has_map and kind.forecasts]
            raise DataError(
                f"configuration, uncertainty.methods: {name} has no samples to score; methods that have some are of "
                f"the kinds {', '.join(able)}"
            )


def load_datasets(
    run: RunSettings, folder: str | Path, data_root: str | Path, demo_root: str | Path
) -> dict[str, Dataset]:
    """The datasets of a run by name, each checked, and together.

    Exhibits of two must not overwrite each other, nor pass for the demo's; options that a file has `tuned` must be of a
    kind or method that exists, and ones that it takes.
    """
    found = {name: load_dataset(Path(folder) / f"{name}.yaml", data_root, demo_root) for name in run.datasets}
    labels = [dataset.label for dataset in found.values()]
    if twice := {label for label in labels if labels.count(label) > 1}:
        names = [name for name, dataset in found.items() if dataset.label in twice]
        raise DataError(f"datasets {', '.join(names)}: their exhibits carry the same `label`; change one")
    if run.run == "demo" and not all(dataset.demo for dataset in found.values()):
        raise DataError("configuration, run: `demo` is for the demo's recordings; give your run another name")
    for dataset in found.values():
        _check_tuned(run, dataset, Path(folder) / f"{dataset.name}.yaml")
    if run.evaluate_on == "validation":
        return {name: validation_part(dataset) for name, dataset in found.items()}
    return found


def _check_tuned(run: RunSettings, dataset: Dataset, file: Path) -> None:
    tunable = {name: entry for name, entry in run.entries.items() if entry.kind != "average"}
    for name, given in dataset.tuned.items():
        source = f"{file}, tuned"
        if name not in tunable:
            raise DataError(unknown(source, "kind or method", name, tunable))
        allowed = [run.kind(name).options, *([options.Learning] if run.kind(name).learned else [])]
        known = {f.name for cls in allowed for f in dataclasses.fields(cls)}
        for key in given:
            if key not in known:
                raise DataError(unknown(f"{source}.{name}", "option", key, known))
        try:
            run.method(name, dataset.tuned)
        except DataError as error:
            raise DataError(f"{source}: {error}") from None
