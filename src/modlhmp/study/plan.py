"""What a run consists of, as rules and exhibits ask for it: its settings, its datasets, and where everything lies."""

import dataclasses
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from modlhmp.datasets import Dataset
from modlhmp.exchange.hand_in import hand_in_files
from modlhmp.file_format import FileFormat
from modlhmp.methods import Method
from modlhmp.scoring.horizons import LADDER_S, scored_horizons
from modlhmp.settings import as_plain
from modlhmp.study.claim_tests import of_the_paper
from modlhmp.study.claims import claimed_pairs
from modlhmp.study.layout import Layout
from modlhmp.study.settings import RunSettings

# The settings of a dataset that decide a stage's result; the others only affect names and drawings.
CLEANING_KEYS = tuple(field.name for field in dataclasses.fields(FileFormat))
TRAINING_KEYS = ("timezone", "time_step_s", "observed_rows", "horizon_s", "velocity", "difference_weights")
FORECAST_KEYS = (*TRAINING_KEYS, "forecast_every_s")
SCORE_KEYS = (*FORECAST_KEYS, "paper_protocol")
SITE_KEYS = (*TRAINING_KEYS, "paper_protocol", "hours")  # of the `Site` that a map carries
MOST_CURVES = 12  # in one panel, before they hide each other
NOT_SHOWN = ("recordings", "sources")  # lists of files, which exhibits do not depend on
PLACES = ("floor_plan", "path", "stored", "file", "exists", "people")  # of a dataset or recording: where files lie


@dataclass(frozen=True)
class Plan:
    """A run: settings, paths, datasets by name."""

    run: RunSettings
    layout: Layout
    datasets: dict[str, Dataset]

    def settings_of(self, dataset: str, keys: Iterable[str] | None = None) -> dict[str, Any]:
        """A dataset's settings for these keys, or all but the lists of files, as mappings and scalars."""
        plain = as_plain(self.datasets[dataset])
        return {key: plain[key] for key in (keys or sorted(plain.keys() - set(NOT_SHOWN)))}

    @property
    def configuration(self) -> dict[str, Any]:
        """All settings that decide the run: every section, and of every dataset, as `datasets/<name>`.

        Not where files lie, which is elsewhere on another machine: what they hold is known by their hashes.
        """
        found = {key: value for key, value in as_plain(self.run).items() if key != "data_root"}
        for name, dataset in self.datasets.items():
            settings = {key: value for key, value in self.settings_of(name).items() if key not in PLACES}
            recordings = [
                {key: value for key, value in as_plain(one).items() if key not in PLACES} for one in dataset.recordings
            ]
            found[f"datasets/{name}"] = settings | {"recordings": recordings}
        return found

    @property
    def horizons(self) -> dict[str, list[float]]:
        """Horizons [s] of every dataset's tables, tests and figures."""
        return {name: scored_horizons(self.run.tables.horizons_s, one) for name, one in self.datasets.items()}

    @property
    def ladder_horizons(self) -> dict[str, list[float]]:
        """Horizons [s] of every dataset's ladder."""
        return {name: scored_horizons(self.run.ladder.horizons_s, one, LADDER_S) for name, one in self.datasets.items()}

    def method(self, dataset: str, name: str) -> Method:
        """A method, with what has been tuned for a dataset."""
        return self.run.method(name, self.datasets[dataset].tuned)

    def paper_option(self, dataset: str, key: str) -> str:
        """An option of the compared maps of the paper, of each where they differ; – where none is compared."""
        kinds = {name: self.run.kind(name).name for name in self.run.compare}
        names = [name for name in kinds if self.run.kind(name).sampled and of_the_paper(name, kinds)]
        values = {name: f"{getattr(self.method(dataset, name).options, key):g}" for name in names}
        if len(set(values.values())) < 2:
            return next(iter(values.values()), "–")
        return ", ".join(f"{self.run.title(name)} {value}" for name, value in values.items())

    def map_of(self, dataset: str, name: str) -> str | list[str]:
        """The map that a method needs, nothing for one without."""
        has_map = self.run.kind(name).has_map
        return self.layout.map_of(dataset, self.method(dataset, name)) if has_map else []

    def exits_of(self, dataset: str, name: str) -> str | list[str]:
        """The ways out, for a method that samples its map and uses them."""
        uses = self.run.kind(name).sampled and self.method(dataset, name).options.exits
        return self.layout.map(dataset, "exits") if uses else []

    def tracks(self, dataset: str, split: str) -> list[str]:
        """The clean recordings of a split."""
        return [self.layout.tracks(dataset, one.name) for one in self.datasets[dataset].of_split(split)]

    def labelled(self, label: str) -> Dataset:
        """The dataset whose exhibits carry a label."""
        return next(dataset for dataset in self.datasets.values() if dataset.label == label)

    @property
    def titles(self) -> dict[str, str]:
        """Titles of the compared methods by name, in the order of the tables."""
        return self.run.titles(self.run.compare)

    @property
    def drawn(self) -> dict[str, str]:
        """Titles of the methods that curves are drawn of: of many, those that inherit from no other compared one."""
        names = self.run.compare
        if len(names) > MOST_CURVES:
            names = tuple(name for name in names if not set(self.run.ancestors(name)) & set(names))
        return self.run.titles(names)

    @property
    def compared_kinds(self) -> set[str]:
        """Kinds of the compared methods, but for those whose map is a file: figures show the maps that are built."""
        return {self.run.kind(name).name for name in self.run.compare if not self.run.published(name)}

    @property
    def published(self) -> list[str]:
        """Methods whose `file` is the map of one that the run needs."""
        names = [*self.run.methods_run, self.run.studies.method]
        return list(dict.fromkeys(filter(None, map(self.run.published, names))))

    @property
    def tested_pairs(self) -> list[list[str]]:
        """Pairs of the t-tests: those of the run, and those of the paper's claims that are not among them."""
        pairs = [pair for pair in self.run.comparisons if set(pair) <= set(self.run.compare)]
        claimed = claimed_pairs({name: self.run.kind(name).name for name in self.run.compare})
        pairs += [pair for pair in claimed if not {pair, pair[::-1]} & set(pairs)]
        return [list(pair) for pair in pairs]

    @property
    def learned(self) -> list[str]:
        """Networks among the methods that the run needs."""
        return [name for name in self.run.methods_run if self.run.kind(name).learned]

    @property
    def trained(self) -> list[str]:
        """Networks that are trained: others use the weights of one of these."""
        return list(dict.fromkeys(map(self.run.trained_as, self.learned)))

    def weights_of(self, dataset: str, name: str) -> str:
        """The weights that a network forecasts with."""
        learning = self.method(dataset, name).learning
        assert learning is not None
        return self.layout.weights(dataset, self.run.trained_as(name), learning.epoch)

    @property
    def averages(self) -> list[str]:
        """Methods that are the mean of others."""
        return [name for name in self.run.methods_run if self.run.kind(name).name == "average"]

    @property
    def handed_in(self) -> list[str]:
        """Methods whose forecasts come from outside."""
        return [name for name in self.run.methods_run if self.run.kind(name).outside]

    def hand_in_files(self, dataset: str, name: str, data_root: str | Path) -> list[str]:
        """The file of such forecasts of a dataset, and the JSON file beside it; `DataError` where there is none."""
        folder = Path(data_root) / self.method(dataset, name).options.folder
        return [str(file) for file in hand_in_files(folder, dataset)]

    @property
    def read_anew(self) -> list[str]:
        """Compared methods of the paper's kinds, scored under every reading of the rules."""
        return [name for name in self.run.compare if self.run.kind(name).published]

    @property
    def measured(self) -> list[str]:
        """Compared methods whose distributions are scored."""
        return [name for name in self.run.compare if name in self.run.uncertainty.methods]

    @property
    def mapped(self) -> list[str]:
        """Methods whose maps' likelihood is measured: compared ones, the first of those that share a map."""
        names = [name for name in self.run.compare if name in self.run.likelihood.methods]
        maps = {(self.run.kind(name).name, self.run.published(name)): name for name in reversed(names)}
        return [name for name in names if name in maps.values()]

    @property
    def given(self) -> list[str]:
        """Compared methods whose next velocity is measured."""
        return [name for name in self.run.compare if name in self.run.likelihood.given]

    @property
    def unmeasured(self) -> dict[str, str]:
        """The other compared methods, and why they are not."""
        others = [name for name in self.run.compare if name not in self.measured]
        return {
            name: "not measured (uncertainty.methods)" if self.run.kind(name).has_samples else "one path, no samples"
            for name in others
        }

    @property
    def studied(self) -> list[str]:
        """Parameters that are studied."""
        return [name for name in ("beta", "sampling_radius_m") if getattr(self.run.studies, name)]

    @property
    def from_less(self) -> list[str]:
        """Compared methods whose maps are also built from less data."""
        training = self.run.studies.training
        return [name for name in training.methods if name in self.run.compare] if training.shares else []

    @property
    def foretold(self) -> dict[str, Dataset]:
        """Datasets of which it is studied which cells will be occupied: those with a clock, without which days mix."""
        known = {name: one for name, one in self.datasets.items() if one.clock != "unknown"}
        return known if self.run.studies.occupied.methods else {}
