"""What an exhibit is: one record, from which its rule, its report entry and the list of what a run makes follow."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from modlhmp.datasets import Dataset
from modlhmp.study.lacks import Lack
from modlhmp.study.layout import FIGURE_FORMS, PAGE_FORMS, TABLE_FORMS
from modlhmp.study.plan import Plan

MODULES = "modlhmp.study.exhibits"  # where the modules that draw exhibits are

# Where the run's report shows it, in this order.
Section = Literal[
    "explorer", "data", "maps", "forecasts", "errors", "certainty", "truth", "changes", "parameters", "networks",
    "cost", "claims",
]  # fmt: skip
Needs = Callable[[Plan, list[Dataset]], list[str]]
Asks = Callable[[Plan, list[Dataset]], dict[str, Any]]


@dataclass(frozen=True, kw_only=True)
class Exhibit:
    """A table, figure or page: what it is called, drawn from, and drawn by.

    `name` is its file name, with `{label}` where there is one per dataset. `draw(layout, datasets, stem, **asks)` (one
    per dataset: `draw(layout, dataset, stem, **asks)`) of `module` writes `stem` with every suffix of its form. It
    reads only the files that `needs` lists, and depends only on its dataset's settings and on what `asks` names.
    """

    name: str
    form: Literal["table", "figure", "page"]
    module: str
    function: str = "draw"
    title: str  # what the report calls it
    category: Literal["Tables", "Figures", "Maps", "Forecasts", "Studies", "Explorer"]
    section: Section  # of the report that reads as a paper
    paper: str = ""  # the paper's labels; empty if it is not in the paper
    caption: str | Callable[[Plan], str]
    needs: Needs
    asks: Asks = lambda plan, datasets: {}
    forecasts: Callable[[Plan], str | None] = lambda plan: None  # the method that it forecasts with itself
    wanted: Callable[[Plan], bool] = lambda plan: True
    lacks: tuple[Lack, ...] = ()  # what a dataset may not have of it, and what is shown instead
    of_folds: bool = False  # where a run is evaluated on folds, those exhibits are made that pool them, else the others
    minutes: int = 10

    @property
    def per_dataset(self) -> bool:
        """Whether there is one per dataset."""
        return "{label}" in self.name

    @property
    def rule(self) -> str:
        """Name of its rule."""
        words = self.name.replace("{label}", "").removeprefix("tab_").replace("-", "_").split("_")
        return "_".join([self.form, *filter(None, words)])

    def made_in(self, plan: Plan) -> bool:
        """Whether a run makes it."""
        return self.of_folds == (plan.run.evaluate_on == "folds") and self.wanted(plan)

    def code(self, plan: Plan) -> list[str]:
        """Modules that it is drawn with: its own, and those of the method that it forecasts with."""
        method = self.forecasts(plan)
        return [self.module, *(plan.run.kind(method).code if method else ())]

    def caption_in(self, plan: Plan) -> str:
        """Its caption in a run."""
        return self.caption if isinstance(self.caption, str) else self.caption(plan)

    def shown(self, plan: Plan, label: str | None = None) -> list[Dataset]:
        """The datasets that it shows: all of a run, or the one of the label."""
        return list(plan.datasets.values()) if label is None else [plan.labelled(label)]

    def files(self, plan: Plan) -> list[str]:
        """Every file of it in a run."""
        labels = [dataset.label for dataset in plan.datasets.values()] if self.per_dataset else [""]
        stems = [plan.layout.exhibit(self.name.format(label=label)) for label in labels]
        return [f"{stem}.{suffix}" for stem in stems for suffix in self.suffixes]

    @property
    def suffixes(self) -> tuple[str, ...]:
        """Suffixes of its files; the last one's file is shown in the report."""
        return {"table": TABLE_FORMS, "figure": FIGURE_FORMS, "page": PAGE_FORMS}[self.form]


def days_of(datasets: Sequence[Dataset]) -> dict[str, dict[str, str]]:
    """{dataset: {test recording: its day}}, by which tests and intervals know what goes together."""
    return {dataset.name: dataset.days("test") for dataset in datasets}
