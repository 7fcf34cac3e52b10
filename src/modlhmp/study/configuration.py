"""Load the configuration of a run and its datasets, with all checks that types cannot say."""

import dataclasses
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from modlhmp import kinds, options
from modlhmp.datasets import Dataset, folds, load_dataset, tested_between, validation_part
from modlhmp.exchange.forms import FORMS
from modlhmp.exchange.hand_in import hand_in_files, read_sheet
from modlhmp.exchange.maps import kind_in, map_files, read_tables
from modlhmp.exchange.parquet import PARQUET, is_parquet
from modlhmp.scoring.horizons import scored_horizons
from modlhmp.settings import check, unknown
from modlhmp.storage import DataError
from modlhmp.study import lacks
from modlhmp.study.settings import RunSettings
from modlhmp.yaml_file import dates_as_text

FORMS_OF_TABLES = [form.name for form in FORMS if form.read is not None]  # a histogram needs more to be said
MOST_NAME_BYTES = 200  # of a recording: file systems allow 255, and results have suffixes
_UNFIT = re.compile(r"[{}<>\x00-\x1f\x7f-\x9f\u2028\u2029\ud800-\udfff]")  # wildcards, ends of lines, undecodable bytes


Folders = str | Path | Sequence[str | Path]


def dataset_files(folders: Folders) -> dict[str, Path]:
    """The dataset files of a folder, or of several, by name; those of an earlier folder come first."""
    each = [folders] if isinstance(folders, str | Path) else folders
    return {file.stem: file for folder in reversed(each) for file in Path(folder).glob("*.yaml")}


def load_run(config: Mapping[str, Any], folders: Folders) -> RunSettings:
    """The run that a configuration describes; `DataError` that names every key that is wrong, and the remedy.

    `folders` are those that dataset files lie in.
    """
    run = check(RunSettings, dates_as_text(dict(config)), "configuration")
    if not re.fullmatch("[A-Za-z0-9_-]+", run.run):
        raise DataError(f"configuration, run: {run.run!r}: a name of letters, digits, _ and - only")
    studies = run.studies
    lists: dict[str, tuple[Any, ...]] = {
        "datasets": run.datasets, "compare": run.compare, "seeds": run.seeds, "studies.beta": studies.beta,
        "studies.sampling_radius_m": studies.sampling_radius_m, "studies.training.shares": studies.training.shares,
        "uncertainty.methods": run.uncertainty.methods, "studies.occupied.methods": studies.occupied.methods,
        "likelihood.methods": run.likelihood.methods, "likelihood.given": run.likelihood.given,
    }  # fmt: skip
    for key, values in lists.items():
        if len(set(values)) < len(values):
            raise DataError(f"configuration, {key}: {list(values)} has non-unique elements")
    for number, (one, other) in enumerate(run.comparisons):
        if one == other:
            raise DataError(f"configuration, comparisons: {one} is compared with itself; name two methods")
        if {(one, other), (other, one)} & set(run.comparisons[:number]):
            raise DataError(
                f"configuration, comparisons: {one} and {other} stand there twice; name a pair once, in one order: "
                "both sides are tested"
            )
    if 0 in run.studies.training.shares:
        raise DataError("configuration, studies.training.shares: 0: a share is above 0")
    _check_sections(run)
    _check_entries(run)
    _check_names(run)
    _check_uses(run)
    _check_titles(run)
    known = sorted(dataset_files(folders))
    for name in run.datasets:
        if name not in known:
            where = f"a file config/datasets/{name}.yaml would be one"
            raise DataError(unknown("configuration, datasets", "dataset", name, known, where))
    return run


def _check_titles(run: RunSettings) -> None:
    """Whether no two methods that a run has are called alike where they are shown."""
    titles = run.titles(dict.fromkeys([*run.compare, *run.ladder_methods]))
    for name, title in titles.items():
        if alike := [other for other, one in titles.items() if one == title and other != name]:
            raise DataError(
                f"configuration, methods: {name} and {', '.join(alike)} have one `title`, {title}; give one another"
            )


def _check_entries(run: RunSettings) -> None:
    """Kinds, options and members of every method."""
    for name, entry in run.entries.items():
        if not re.fullmatch("[A-Za-z0-9_-]+", name) or name.startswith("-"):
            raise DataError(
                f"configuration, methods: {name!r}: a name of letters, digits, _ and - only, and no - before them"
            )
        known = [kind.name for kind in kinds.all_kinds().values() if kind.is_method]
        if not entry.kind:
            raise DataError(f"configuration, methods.{name}: say of which `kind` it is: {', '.join(known)}")
        if entry.kind in run.methods and entry.kind not in known:
            raise DataError(
                f"configuration, methods.{name}.kind: {entry.kind} is a method, no kind: write "
                f"`inherits: {entry.kind}` to start from its options"
            )
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
        if entry.file and not run.kind(name).has_map:
            raise DataError(f"configuration, methods.{name}.file: kind {entry.kind} has no map; leave it out")
        if entry.form and not entry.file:
            raise DataError(f"configuration, methods.{name}.form: there is no `file` whose form it could be")
        if entry.form not in {"", PARQUET, *FORMS_OF_TABLES}:
            raise DataError(unknown(f"configuration, methods.{name}.form", "form", entry.form, FORMS_OF_TABLES))
        outside, folder = kinds.find(entry.kind).outside, f"configuration, methods.{name}.folder"
        if entry.folder and not outside:
            raise DataError(f"{folder}: {entry.folder!r}: a method of kind {entry.kind} has none; leave it out")
        method = run.method(name)
        if outside and not method.options.folder:
            raise DataError(f"{folder}: name the folder of the forecasts")


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
    """Every method that a section names exists."""
    named = {
        "compare": run.compare,
        "studies.method": [run.studies.method],
        "studies.training.methods": run.studies.training.methods,
        "studies.occupied.methods": run.studies.occupied.methods,
        "uncertainty.methods": run.uncertainty.methods,
        "likelihood.methods": run.likelihood.methods,
        "likelihood.given": run.likelihood.given,
        "comparisons": [name for pair in run.comparisons for name in pair],
        "ladder.reference": [run.ladder.reference],
        "ladder.rows": [method for method, _ in run.ladder.rows],
        "ladder.beside": [name for *pair, _ in run.ladder.beside for name in pair],
    }
    for key, names in named.items():
        for name in names:
            if name not in run.entries:
                raise DataError(unknown(f"configuration, {key}", "method", name, run.entries, kinds.NOT_INSTALLED))


def _check_uses(run: RunSettings) -> None:
    """Every method can do what the section that names it asks."""
    for name in run.studies.training.methods:
        if not run.kind(name).from_share:
            able = [kind.name for kind in kinds.all_kinds().values() if kind.from_share and kind.forecasts]
            raise DataError(f"configuration, studies.training: {name} is of none of the kinds {', '.join(able)}")
        if run.published(name):
            raise DataError(
                f"configuration, studies.training: the map of {name} is a file, so it cannot be built from less data"
            )
    if (run.studies.beta or run.studies.sampling_radius_m) and not run.kind(run.studies.method).sampled:
        raise DataError(
            f"configuration, studies.method: {run.studies.method} has no map to sample, so neither beta nor r_s; name "
            "another, or leave both lists empty"
        )
    for name, _ in run.ladder.rows:
        if outside := [part for part in run.averaged_parts(name) if run.kind(part).outside]:
            raise DataError(
                f"configuration, ladder.rows: {name}: the forecasts of {outside[0]} are not made here, so a rung of it "
                "has no cost; name it in `compare` instead"
            )
    for name in run.studies.occupied.methods:
        if not (run.kind(name).has_map and run.kind(name).has_samples):
            able = [kind.name for kind in kinds.all_kinds().values() if kind.has_map and kind.has_samples]
            raise DataError(
                f"configuration, studies.occupied.methods: {name} has no map with samples; methods that have one are "
                f"of the kinds {', '.join(able)}"
            )
        if run.published(name):
            raise DataError(
                f"configuration, studies.occupied.methods: the map of {name} is a file, so it cannot be built of some "
                "people only"
            )
    for name in run.uncertainty.methods:
        if not run.kind(name).has_samples:
            able = [kind.name for kind in kinds.all_kinds().values() if kind.has_samples]
            raise DataError(
                f"configuration, uncertainty.methods: {name} has no samples to score; methods that have some are of "
                f"the kinds {', '.join(able)}"
            )
    for name in run.likelihood.methods:
        if not run.kind(name).density:
            able = [kind.name for kind in kinds.all_kinds().values() if kind.density]
            raise DataError(
                f"configuration, likelihood.methods: the map of {name} is no density of velocities; methods whose map "
                f"is one are of the kinds {', '.join(able)}"
            )


def load_datasets(
    run: RunSettings, folders: Folders, data_root: str | Path, demo_root: str | Path
) -> dict[str, Dataset]:
    """The datasets of a run by name, each checked, and together.

    Exhibits and columns of two must not overwrite each other, nor pass for the demo's; options that a file has `tuned`
    must be of a kind or method that exists, and ones that it takes.
    """
    files = dataset_files(folders)
    found = {name: load_dataset(files[name], data_root, demo_root) for name in run.datasets}
    for key, carry in (("label", "exhibits carry"), ("title", "rows and columns of tables carry")):
        given = {name: getattr(dataset, key) for name, dataset in found.items()}
        if twice := [name for name, one in given.items() if list(given.values()).count(one) > 1]:
            raise DataError(
                f"datasets {', '.join(twice)}: their {carry} the same `{key}`; change one in its dataset file"
            )
    if run.run == "demo" and not all(dataset.demo for dataset in found.values()):
        raise DataError("configuration, run: `demo` is for the demo's recordings; give your run another name")
    for dataset in found.values():
        _check_tuned(run, dataset, files[dataset.name])
        _check_clock(run, dataset, files[dataset.name])
        _check_paths(dataset, files[dataset.name])
        _check_horizons(run, dataset)
    _check_files(run, data_root)
    if run.strict:
        found = {name: dataclasses.replace(dataset, strict=True) for name, dataset in found.items()}
    if run.test_days:
        found = {name: tested_between(dataset, *run.test_days) for name, dataset in found.items()}
    if run.evaluate_on == "validation":
        found = {name: validation_part(dataset) for name, dataset in found.items()}
    if run.evaluate_on == "folds":
        found = {fold.name: fold for dataset in found.values() for fold in folds(dataset)}
    _check_hand_ins(run, found, data_root)
    return found


def _check_clock(run: RunSettings, dataset: Dataset, file: Path) -> None:
    """Whether nothing needs maps by hours of a dataset without a clock, of which `Plan.foretold` asks none."""
    if dataset.clock != "unknown":
        return
    remedies, studied = [], run.studies.method
    if hourly := [name for name in run.methods_run if run.kind(name).hourly]:
        remedies.append(f"leave {', '.join(hourly)} out of `compare` and the ladder")
    if (run.studies.beta or run.studies.sampling_radius_m) and run.kind(studied).hourly:
        remedies.append(
            f"name another `studies.method` than {studied}, or leave `studies.beta` and `studies.sampling_radius_m` "
            "empty"
        )
    if remedies:
        raise DataError(f"{file}: {lacks.NO_CLOCK}: {'; '.join(remedies)}")


def _check_hand_ins(run: RunSettings, datasets: Mapping[str, Dataset], data_root: str | Path) -> None:
    """Whether the forecasts from outside that a run needs are there, of every dataset, with a JSON file that is one."""
    for method in (name for name in run.methods_run if run.kind(name).outside):
        where = f"configuration, methods.{method}.folder"
        for name, dataset in datasets.items():
            try:
                files = hand_in_files(Path(data_root) / run.method(method, dataset.tuned).options.folder, name)
            except DataError as error:
                raise DataError(f"{where}: {error} (`data_root` is {data_root})") from None
            read_sheet(files[1])
            for file in files:
                _check_path(where, str(file))


def _check_files(run: RunSettings, data_root: str | Path) -> None:
    """Whether the map files of the methods that a run needs are there, and of a form that carries their kinds."""
    for name in dict.fromkeys(map(run.published, [*run.methods_run, run.studies.method])):
        if not name:
            continue
        where, entry = f"configuration, methods.{name}.file", run.entries[name]
        try:
            kind = kind_in(path := Path(data_root) / entry.file, entry.form or None)
        except DataError as error:
            raise DataError(f"{where}: {error} (`data_root` is {data_root})") from None
        if kind != entry.kind:
            raise DataError(f"{where}: {path} holds a map of kind {kind}, but the method is of kind {entry.kind}")
        for file in map_files(path):
            _check_path(where, str(file))


def check_maps(run: RunSettings, datasets: Mapping[str, Dataset], data_root: str | Path) -> None:
    """Read the map files of others that a run needs as its jobs will: what is wrong in them stops it before these."""
    for name in dict.fromkeys(filter(None, map(run.published, [*run.methods_run, run.studies.method]))):
        path, form = Path(data_root) / run.entries[name].file, run.entries[name].form or None
        if is_parquet(path, form):
            continue
        for origin_m, site in {dataset.origin_m: dataset for dataset in datasets.values()}.items():
            try:
                read_tables(path, form, site, origin_m)
            except DataError as error:
                raise DataError(f"configuration, methods.{name}.file: {error}") from None


def _check_horizons(run: RunSettings, dataset: Dataset) -> None:
    """Whether a dataset has any of the horizons that were chosen."""
    for key, chosen in (("tables", run.tables.horizons_s), ("ladder", run.ladder.horizons_s)):
        if not scored_horizons(chosen, dataset):
            raise DataError(
                f"configuration, {key}.horizons_s: dataset {dataset.name} has none of {list(chosen or ())} s; name "
                f"multiples of its time step, {dataset.time_step_s:g} s, up to {dataset.horizon_s:g} s, or leave the "
                "key out"
            )


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


def _check_path(where: str, path: str) -> None:
    """Whether Snakemake can take a path."""
    if unfit := _UNFIT.search(path):
        raise DataError(
            f"{where}: {path!r}: Snakemake cannot take the character {unfit[0]!r} in a path; rename the file or "
            "folder, or link to it under another name"
        )


def _check_paths(dataset: Dataset, file: Path) -> None:
    """Whether Snakemake can take the paths of recordings, and ours their names."""
    _check_path(str(file), dataset.name)
    for path in dataset.floor_plan:
        _check_path(str(file), path)
    for one in dataset.recordings:
        for path in (one.stored, *one.people, one.name):
            _check_path(str(file), path)
        if len(one.name.encode()) > MOST_NAME_BYTES:
            raise DataError(
                f"{file}: recording {one.name!r}: the names of its results would be too long; rename {one.path!r} to "
                f"at most {MOST_NAME_BYTES} bytes"
            )
