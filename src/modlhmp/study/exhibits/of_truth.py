"""Records of the exhibits that ask which map is true."""

from typing import Any

from modlhmp.datasets import Dataset
from modlhmp.study import lacks
from modlhmp.study.comparisons import LEAST_DAYS
from modlhmp.study.exhibits.record import MODULES, Exhibit
from modlhmp.study.plan import Plan


def _likelihood(*tables: str) -> dict[str, Any]:
    """The fields of an exhibit of how likely maps make what people did."""

    def needs(plan: Plan, datasets: list[Dataset]) -> list[str]:
        return [plan.layout.likelihood(one.name, table) for one in datasets for table in tables]

    return {"needs": needs, "wanted": lambda plan: bool(plan.mapped)}


def _clusters(plan: Plan) -> str:
    """What intervals of a run's test rows are over."""
    days = {name: len(set(one.days("test").values())) for name, one in plan.datasets.items()}
    over = {name: "days" if number >= LEAST_DAYS else "persons" for name, number in days.items()}
    if len(set(over.values())) == 1:
        return next(iter(over.values()))
    return " and ".join(f"{one} ({plan.datasets[name].title})" for name, one in over.items())


EXHIBITS: tuple[Exhibit, ...] = (
    Exhibit(
        name="tab_likelihood",
        form="table",
        module=f"{MODULES}.likelihood_table",
        title="which map is true",
        category="Tables",
        section="truth",
        caption="How likely each map makes the velocities of people whom it has not seen, by place and time only: "
        "negative log density beside that without a map, in four accountings of what a map does not cover, for "
        "headings with speeds and for headings alone; then by hour, and paired differences.",
        asks=lambda plan, datasets: {"titles": plan.run.titles(plan.mapped), "over": _clusters(plan)},
        **_likelihood("scores", "pairs"),
        lacks=(lacks.NO_CLOCK,),
    ),
    Exhibit(
        name="likelihood",
        form="figure",
        module=f"{MODULES}.likelihood_figure",
        title="which map is true, by hour",
        category="Maps",
        section="truth",
        caption="How much a map tells of how people walk, hour by hour: gain in log density of test persons' "
        "velocities over what is known without a map, each map with the background chosen on persons held out of the "
        "training data. Below 0 a map is worse than none.",
        asks=lambda plan, datasets: {"titles": plan.run.titles(plan.mapped)},
        **_likelihood("scores"),
        lacks=(lacks.NO_CLOCK,),
    ),
    Exhibit(
        name="tab_likelihood_given",
        form="table",
        module=f"{MODULES}.likelihood_given_table",
        title="likelihood of the next velocity",
        category="Tables",
        section="truth",
        caption="How likely each method makes a walker's next velocity, given the last ones: negative log density of "
        "its samples, made a density by one kernel, and paired differences.",
        asks=lambda plan, datasets: {"titles": plan.run.titles(plan.given), "over": _clusters(plan)},
        needs=_likelihood("given", "given_pairs")["needs"],
        wanted=lambda plan: bool(plan.given),
    ),
    Exhibit(
        name="prequential",
        form="figure",
        module=f"{MODULES}.prequential_hours",
        title="maps that are updated",
        category="Maps",
        section="truth",
        caption="Negative log density of the velocities of each hour's people under maps of what was known before it, "
        "mixed with 5 % of no map: lower is better. Left: the training recordings, hour by hour. Middle and right: the "
        "same rows made one-way streets, of which half of the place turns round at the dotted line: how fast each map "
        "follows there, and what it forgets of the half that stays.",
        needs=lambda plan, datasets: [file for dataset in datasets for file in plan.tracks(dataset.name, "train")],
        asks=lambda plan, datasets: {
            "recordings": {dataset.name: [one.name for one in dataset.of_split("train")] for dataset in datasets}
        },
        lacks=(lacks.NO_CLOCK, lacks.ONE_HOUR),
        minutes=30,
    ),
)
