"""Many sites: a list of sites as one configuration for each, all checked before anything runs.

A site is what its configuration has beyond what all have: a dataset, or days of one. It is a run like any other, called
`<sweep>-<site>`, so everything that works on a run works on it.
"""

import os
import re
from collections.abc import Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, NamedTuple

from annotated_types import MinLen
from snakemake.utils import update_config

from modlhmp.datasets import Dataset
from modlhmp.exchange.maps import map_files
from modlhmp.file_format import Recording
from modlhmp.origins import file_state
from modlhmp.settings import check, option
from modlhmp.storage import DataError
from modlhmp.study.configuration import dataset_files, load_datasets, load_run
from modlhmp.study.layout import Layout
from modlhmp.study.plan import Plan
from modlhmp.yaml_file import dates_as_text, read_yaml

EXAMPLE = """A list of sites is such a file, sites.yaml:

    sweep: plazas                      # tables go to paper_figures/sweeps/plazas, each site's run is plazas-<site>
    configfiles: [config/own.yaml]     # as of `snakemake --configfile`
    reference: cvm                     # every other method is compared with it
    sites:
      north: {}                        # config/datasets/north.yaml
      south: {data_root: /data/south}  # whatever a configuration may say
      atc_may: {datasets: [atc_archive], test_days: [2013-05-01, 2013-05-31]}

    .venv/bin/snakemake --snakefile workflow/sweep.smk --configfile sites.yaml --cores 2 --keep-going"""


@dataclass(frozen=True, kw_only=True)
class SweepSettings:
    """A list of sites."""

    sweep: str = option(meaning="name of the sweep: tables go to `paper_figures/sweeps/<sweep>`")
    reference: str = option(meaning="the compared method that every other one is compared with")
    sites: Annotated[dict[str, dict[str, Any]], MinLen(1)] = option(
        meaning="what each site's configuration has beyond the others'; `datasets` is the site's name where it has none"
    )
    configfiles: tuple[str, ...] = option((), "overlays that all sites have, as of `--configfile`")
    shared: dict[str, Any] = option({}, "what else all sites' configurations have")
    targets: tuple[str, ...] = option(
        ("all",), "what each site's run makes besides the numbers of the table; an empty list: nothing"
    )


class Site(NamedTuple):
    """A site: its configuration beyond the default one, and the run that comes of it."""

    configuration: dict[str, Any]
    plan: Plan
    dataset: Dataset
    missing: list[str]  # files of recordings that are not there and cannot be fetched
    data_root: str


@dataclass(frozen=True)
class Sweep:
    """The sites of a list; `configs` are the default configuration's files, `folders` those of dataset files."""

    settings: SweepSettings
    configs: Sequence[str | Path]
    folders: Sequence[str | Path]

    @property
    def names(self) -> list[str]:
        """Names of the sites."""
        return list(self.settings.sites)

    @property
    def results(self) -> str:
        """Folder of its data."""
        return f"results/sweeps/{self.settings.sweep}"

    @property
    def exhibits(self) -> str:
        """Folder of its tables."""
        return f"paper_figures/sweeps/{self.settings.sweep}"

    def numbers(self, site: str) -> str:
        """What a site adds to the table."""
        return f"{self.results}/{site}.parquet"

    def configuration(self, site: str) -> str:
        """The configuration that a site's run had, beyond the default one."""
        return f"{self.results}/{site}.yaml"

    def log(self, site: str) -> str:
        """Everything that a site's run printed."""
        return f"{self.results}/logs/{site}.log"

    @cached_property
    def _shared(self) -> tuple[dict[str, Any], dict[str, Any]]:
        """The default configuration, and what all sites have beyond it."""
        default: dict[str, Any] = {}
        for file in self.configs:
            update_config(default, read_yaml(file, "a configuration"))
        shared: dict[str, Any] = {}
        for file in self.settings.configfiles:
            update_config(shared, read_yaml(file, "a configuration"))
        update_config(shared, dict(self.settings.shared))
        return default, shared

    @cached_property
    def _found(self) -> dict[str, Site]:
        return {}

    def site(self, name: str) -> Site:
        """One site; `DataError` where its configuration or dataset is wrong, or its dataset is not one."""
        if name not in self._found:
            self._found[name] = self._site(name)
        return self._found[name]

    def _site(self, name):
        default, shared = self._shared
        own: dict[str, Any] = {}
        for part in (shared, self.settings.sites[name]):
            update_config(own, part)
        own["run"] = f"{self.settings.sweep}-{name}"
        own["datasets"] = self.settings.sites[name].get("datasets", [name])
        whole: dict[str, Any] = {}
        for part in (default, own):
            update_config(whole, part)
        compare, pairs = whole.get("compare", ()), [list(pair) for pair in whole.get("comparisons", ())]
        if self.settings.reference not in compare:
            raise DataError(
                f"reference: {self.settings.reference} is not compared there, but {', '.join(map(str, compare))}; add "
                "it to `compare`, or name another reference"
            )
        wanted = [[one, self.settings.reference] for one in compare if one != self.settings.reference]
        turned = [pair[::-1] if pair[::-1] in wanted else pair for pair in pairs]  # no pair stands there in both orders
        own["comparisons"] = whole["comparisons"] = turned + [pair for pair in wanted if pair not in turned]
        run = load_run(whole, self.folders)
        layout = Layout(run.run)
        root = os.path.expanduser(os.environ.get("MODLHMP_DATA") or run.data_root)
        found = load_datasets(run, self.folders, root, layout.demo)
        if len(found) != 1:
            raise DataError(
                f"a site is one dataset, and this is {len(found)} ({', '.join(found)}): make a site of each"
            )
        (dataset,) = found.values()
        fetched = {source.file for source in dataset.sources}
        absent = [one for one in dataset.recordings if not (dataset.demo or one.exists or one.file in fetched)]
        return Site(own, Plan(run, layout, found), dataset, list(dict.fromkeys(one.stored for one in absent)), root)

    def files(self, name: str) -> list[str]:
        """The files that a site's run reads and does not make, of those that are there.

        Its dataset file, recordings and floor plan, published maps, and forecasts from outside.
        """
        site = self.site(name)
        plan, (file,) = site.plan, site.plan.run.datasets
        found = [str(dataset_files(self.folders)[file])]
        if not site.dataset.demo:
            found += [*(path for one in site.dataset.recordings for path in _files(one)), *site.dataset.floor_plan]
        for method in plan.published:
            found += map(str, map_files(Path(site.data_root) / plan.run.entries[method].file))
        for method in plan.handed_in:
            found += plan.hand_in_files(site.dataset.name, method, site.data_root)
        return [path for path in dict.fromkeys(found) if Path(path).exists()]

    def check(self) -> None:
        """`DataError` that names every site that cannot run, and why, and those that are not two."""
        wrong: list[str] = []
        tested: dict[Hashable, str] = {}
        for name in self.names:
            try:
                site = self.site(name)
            except DataError as error:
                wrong.append(f"site {name}: {error}")
                continue
            if site.missing:
                more = f" and {len(site.missing) - 1} more" if site.missing[1:] else ""
                wrong.append(
                    f"site {name}: {site.missing[0]}{more}: no such file; put it there, or correct `data_root`"
                )
            if Path(site.plan.layout.results).exists() and not Path(self.configuration(name)).exists():
                wrong.append(
                    f"site {name}: {site.plan.layout.results} is there already and not of this sweep, whose run would "
                    "overwrite it: rename the site or the sweep, or remove that folder"
                )
            for one, key in _tested(site):
                other = tested.setdefault(key, name)
                if other != name:
                    wrong.append(
                        f"sites {other} and {name}: both test {one.path}, which would count twice in tests by site: "
                        "keep one of them, or give them other `test_days`"
                    )
                    break
        if wrong:
            raise DataError("\n".join([*wrong[:20], *([f"... and {len(wrong) - 20} more"] if wrong[20:] else [])]))


def _files(recording: Recording) -> list[str]:
    return list(recording.people) or [recording.stored]


def _tested(site: Site) -> Iterator[tuple[Recording, Hashable]]:
    """A site's test recordings, each with what every file of it is known by, whatever it is called."""
    for one in site.dataset.of_split("test"):
        for file in _files(one):
            # Of generated recordings every run has its own.
            made = (file.removeprefix(site.plan.layout.demo), site.plan.run.demo) if site.dataset.demo else None
            yield one, (made or file_state(file) or os.path.realpath(file), one.member, one.part)


def load_sweep(config: Mapping[str, Any], configs: Sequence[str | Path], folders: Sequence[str | Path]) -> Sweep:
    """The sweep that a list of sites describes; `DataError` for keys and names that are wrong.

    The sites themselves are read when they are asked for, and all by `Sweep.check`. Arguments as of `Sweep`.
    """
    if not config:
        raise DataError(f"there are no sites: name their list, `--configfile sites.yaml`. {EXAMPLE}")
    given = dates_as_text(dict(config))
    if isinstance(given.get("sites"), dict):
        given["sites"] = {name: {} if one is None else one for name, one in given["sites"].items()}
    try:
        found = check(SweepSettings, given, "list of sites")
    except DataError as error:
        raise DataError(f"{error}\n{EXAMPLE}") from None
    if not re.fullmatch("[A-Za-z0-9_]+", found.sweep):
        raise DataError(f"list of sites, sweep: {found.sweep!r}: a name of letters, digits and _ only")
    known: dict[str, str] = {}
    for name in found.sites:
        if not re.fullmatch("[A-Za-z0-9_-]+", name):
            raise DataError(f"list of sites, sites: {name!r}: a name of letters, digits, _ and - only")
        if name.casefold() in known:
            raise DataError(
                f"list of sites, sites: {known[name.casefold()]} and {name} are one name where a disk does not tell "
                "capitals: their results would overwrite each other; rename one"
            )
        known[name.casefold()] = name
    for section in (found.shared, *found.sites.values()):
        if "run" in section:
            raise DataError(f"list of sites: run: {section['run']}: runs are called <sweep>-<site>; leave the key out")
    return Sweep(found, configs, folders)
