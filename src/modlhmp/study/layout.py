"""Where everything of a run lies: every path of `results/` and `paper_figures/`, for rules and for readers.

Paths are relative to the project's folder. Names may be Snakemake's wildcards, such as `{dataset}`.
"""

from dataclasses import dataclass
from typing import Any

from modlhmp.kinds import find

SUMS = "resources/SHA256SUMS"  # of fetched recordings, as they were first seen
TABLE_FORMS = ("csv", "tex", "md", "html")
FIGURE_FORMS = ("csv", "pdf", "png")
PAGE_FORMS = ("html",)


@dataclass(frozen=True)
class Layout:
    """Paths of one run, from the folder `root` on (default: the one that the work is done in)."""

    run: str
    root: str = "."

    @classmethod
    def around(cls, run: str, file: str) -> "Layout":
        """The layout in which a job's file of `results/{run}` or `paper_figures/{run}` lies.

        Snakemake keeps a job's files elsewhere than in the project's folder where a storage provider brings and
        fetches them: below a folder of its own, under the same names.
        """
        for folder in ("results", "paper_figures"):
            root, found, _ = str(file).rpartition(f"{folder}/{run}/")
            if found:
                return cls(run, root.rstrip("/") or ".")
        raise ValueError(f"{file} is no file of run {run}")

    def here(self, path: str) -> str:
        """A path of the project's folder, where it lies in this layout."""
        return path if self.root == "." else f"{self.root}/{path}"

    def _under(self, folder: str) -> str:
        return f"{folder}/{self.run}" if self.root == "." else f"{self.root}/{folder}/{self.run}"

    @property
    def results(self) -> str:
        """Folder of its data."""
        return self._under("results")

    @property
    def exhibits(self) -> str:
        """Folder of its tables and figures."""
        return self._under("paper_figures")

    @property
    def demo(self) -> str:
        """Folder of its generated recordings."""
        return self._under("resources/demo")

    # --- what every job leaves ----------------------------------------------------------------------------------------

    def log(self, rule: str, *names: str) -> str:
        """Log of a job."""
        return f"{'/'.join([self.results, 'logs', rule, *names])}.log"

    def benchmark(self, rule: str, *names: str) -> str:
        """Time and memory of a job."""
        return f"{'/'.join([self.results, 'benchmarks', rule, *names])}.tsv"

    @property
    def certificate(self) -> str:
        """What went into the run and what came out of it, by SHA-256."""
        return f"{self.results}/certificate.json"

    # --- data of a dataset --------------------------------------------------------------------------------------------

    def tracks(self, dataset: str, recording: str) -> str:
        """Clean tracks of a recording."""
        return f"{self.results}/{dataset}/tracks/{recording}.parquet"

    def account(self, dataset: str, recording: str) -> str:
        """What became of every row and track of a recording."""
        return f"{self.results}/{dataset}/tracks/{recording}.account.json"

    def checks(self, dataset: str) -> str:
        """What checks of all recordings of a dataset together warn of."""
        return f"{self.results}/{dataset}/tracks/checks.json"

    def map(self, dataset: str, kind: str) -> str:
        """A kind's map: a file, or the folder of its hours."""
        return f"{self.results}/{dataset}/maps/{find(kind).map_file}"

    def published_map(self, dataset: str, method: str, kind: str) -> str:
        """The map that a method has from a file, instead of one that is built."""
        return f"{self.results}/{dataset}/maps/published/{method}{'' if find(kind).hourly else '.parquet'}"

    def map_of(self, dataset: str, method: Any) -> str:
        """The map that a `methods.Method` forecasts with; a path must not depend on that module's code."""
        kind = method.kind
        return self.published_map(dataset, method.published, kind) if method.published else self.map(dataset, kind)

    def map_hour(self, dataset: str, kind: str, hour: int) -> str:
        """One hour of a kind's map."""
        return f"{self.map(dataset, kind)}/{hour:02d}.parquet"

    def weights(self, dataset: str, method: str, epoch: str = "best") -> str:
        """Weights of a trained network: those of its `best` epoch, or of its `last`."""
        return f"{self.results}/{dataset}/models/{method}{'.last' if epoch == 'last' else ''}.safetensors"

    def training(self, dataset: str, method: str) -> str:
        """How a network was trained."""
        return f"{self.results}/{dataset}/models/{method}.json"

    def forecasts(self, dataset: str, method: str) -> str:
        """Folder of a method's forecasts."""
        return f"{self.results}/{dataset}/forecasts/{method}"

    def forecast(self, dataset: str, method: str, recording: str) -> str:
        """A method's forecasts of one recording."""
        return f"{self.forecasts(dataset, method)}/{recording}.parquet"

    def errors(self, dataset: str, method: str) -> str:
        """Errors of a method's forecasts."""
        return f"{self.results}/{dataset}/errors/{method}.parquet"

    def readings(self, dataset: str, method: str) -> str:
        """Errors of a method under every reading of the scoring rules."""
        return f"{self.results}/{dataset}/readings/{method}.parquet"

    def encounters(self, dataset: str, method: str) -> str:
        """How often a method's forecasts run into others' true paths."""
        return f"{self.results}/{dataset}/encounters/{method}.parquet"

    def ttests(self, dataset: str) -> str:
        """Paired tests between methods."""
        return f"{self.results}/{dataset}/ttests.parquet"

    def study(self, dataset: str, parameter: str) -> str:
        """Folder of a parameter's study."""
        return f"{self.results}/{dataset}/studies/{parameter}"

    def study_value(self, dataset: str, parameter: str, value: float) -> str:
        """Errors with one value of a parameter."""
        return f"{self.study(dataset, parameter)}/{value:g}.parquet"

    def training_share(self, dataset: str, method: str, share: float) -> str:
        """Errors of a method whose map was built from a share of the training tracks."""
        return f"{self.study(dataset, 'training')}/{method}/{share:g}.parquet"

    def occupied(self, dataset: str, table: str) -> str:
        """`bins`, `scores` or `film` of which cells were occupied."""
        return f"{self.results}/{dataset}/occupied/{table}.parquet"

    def likelihood(self, dataset: str, table: str) -> str:
        """`scores` or `pairs` of how likely maps make what people did; `given` and `given_pairs` of methods."""
        return f"{self.results}/{dataset}/likelihood/{table}.parquet"

    def uncertainty(self, dataset: str, method: str) -> str:
        """Scores of a method's forecasts as distributions."""
        return f"{self.results}/{dataset}/uncertainty/{method}.parquet"

    def runtime(self, dataset: str) -> str:
        """Time, memory and map size of the studied method."""
        return f"{self.results}/{dataset}/runtime.json"

    def costs(self, dataset: str) -> str:
        """Time of a forecast by each rung of the ladder."""
        return f"{self.results}/{dataset}/costs.json"

    def ladder(self, dataset: str, part: str) -> str:
        """`scores` or `differences` of the ladder."""
        return f"{self.results}/{dataset}/ladder/{part}.parquet"

    # --- exhibits -----------------------------------------------------------------------------------------------------

    @property
    def scores(self) -> str:
        """Every score of the run in long form."""
        return f"{self.exhibits}/results.csv"

    @property
    def report(self) -> str:
        """The run as a paper."""
        return f"{self.exhibits}/report.html"

    def exhibit(self, name: str) -> str:
        """An exhibit's path without its suffix."""
        return f"{self.exhibits}/{name}"
