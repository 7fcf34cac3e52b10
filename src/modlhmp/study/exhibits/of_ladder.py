"""Records of the ladder's exhibits and of the table of folds: differences between pairs of methods."""

from typing import Any

from modlhmp.datasets import Dataset
from modlhmp.study import lacks
from modlhmp.study.exhibits.record import MODULES, Exhibit
from modlhmp.study.exhibits.words import OVER
from modlhmp.study.plan import Plan


def _ladder_files(plan: Plan, datasets: list[Dataset]) -> list[str]:
    (dataset,) = datasets
    parts = [plan.layout.ladder(dataset.name, part) for part in ("scores", "differences")]
    return [*parts, plan.layout.costs(dataset.name)]


def _rungs(plan: Plan) -> list[str]:
    return [method for method, _ in plan.run.rungs]


def _knows_the_place(plan: Plan, name: str) -> bool:
    """A network without grids does not know where it is."""
    return bool(getattr(plan.run.method(name).options, "grids", True))


def _ladder_asks(plan: Plan, datasets: list[Dataset]) -> dict[str, Any]:
    rungs = _rungs(plan)
    beyond = [name for name in rungs if not plan.run.kind(name).published]
    return {
        "rungs": rungs,
        "reference": plan.run.ladder.reference,
        "titles": plan.run.titles(rungs),
        "with_memory": [name for name in beyond if _knows_the_place(plan, name)],
    }


def _ladder_table_asks(plan: Plan, datasets: list[Dataset]) -> dict[str, Any]:
    (dataset,) = datasets
    return {
        "rows": [list(row) for row in plan.run.rungs],
        "reference": plan.run.ladder.reference,
        "beside": [list(pair) for pair in plan.run.ladder.beside],
        "titles": plan.run.titles(plan.run.ladder_methods),
        "days": sorted(set(dataset.days("test").values())),
    }


def _folds_asks(plan: Plan, datasets: list[Dataset]) -> dict[str, Any]:
    reference = plan.run.ladder.reference
    return {
        "methods": plan.titles,
        "reference": reference if reference in plan.run.compare else plan.run.compare[0],
        "horizons": plan.horizons,
        # The parts that a recording of no known day is cut into are of one.
        "days": {
            dataset.name: {one.name: one.day or one.path for one in dataset.of_split("test")} for dataset in datasets
        },
    }


def _caption(plan: Plan) -> str:
    blind = [name for name in _rungs(plan) if not _knows_the_place(plan, name)]
    floor = "knows only the last seconds and the compass: a map helps only where it is better than this."
    return (
        "One change per row, from the paper's configuration to the best one, under the complete protocol: every method "
        "forecasts every eligible track, and no method is told how long a track is. Options were chosen on a part of "
        f"the training recordings kept for validation. Intervals are 95 % intervals {OVER}; the table adds the paired "
        "differences, the cost of a forecast, and the paper protocol."
        + "".join(f' "{plan.run.title(name)}" {floor}' for name in blind)
    )


def _has_rungs(plan: Plan) -> bool:
    return bool(plan.run.rungs)


EXHIBITS: tuple[Exhibit, ...] = (
    Exhibit(
        name="folds",
        form="table",
        module=f"{MODULES}.folds_table",
        title="folds",
        category="Tables",
        section="errors",
        caption="Every test track forecast from other days, or other times of its day, than its own: the test "
        "recordings are dealt into five folds, and maps and networks are made for each from all people but those "
        "recorded within ten minutes of it.",
        needs=lambda plan, datasets: [
            plan.layout.errors(dataset.name, method) for dataset in datasets for method in plan.run.compare
        ],
        asks=_folds_asks,
        of_folds=True,
    ),
    Exhibit(
        name="ladder-{label}",
        form="table",
        module=f"{MODULES}.ladder_table",
        title="ladder",
        category="Tables",
        section="changes",
        caption=_caption,
        needs=_ladder_files,
        asks=_ladder_table_asks,
        wanted=_has_rungs,
    ),
    Exhibit(
        name="ladder",
        form="figure",
        module=f"{MODULES}.ladder_figure",
        title="ladder",
        category="Studies",
        section="changes",
        caption=_caption,
        needs=lambda plan, datasets: [plan.layout.ladder(dataset.name, "scores") for dataset in datasets],
        asks=_ladder_asks,
        wanted=_has_rungs,
        lacks=(lacks.NO_TRACK,),
    ),
)
