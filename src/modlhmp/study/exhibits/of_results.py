"""Records of the exhibits that are tables, curves and studies: what is made from errors and trainings."""

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from modlhmp.datasets import Dataset
from modlhmp.kinds import find
from modlhmp.study import lacks
from modlhmp.study.exhibits.record import MODULES, Exhibit, days_of
from modlhmp.study.exhibits.words import SEED_MEANS
from modlhmp.study.plan import Plan
from modlhmp.study.published import AHEAD_S, STEP_S

ROLL_OUT = ("sampling_radius_m", "beta", "k")  # what the parameter table tells of it

# --- what they need ---------------------------------------------------------------------------------------------------


def _scores(plan: Plan, datasets: list[Dataset]) -> list[str]:
    return [plan.layout.scores]


def _tracks(plan: Plan, datasets: list[Dataset]) -> list[str]:
    return [file for dataset in datasets for file in plan.tracks(dataset.name, "test")]


def _trainings(plan: Plan, datasets: list[Dataset]) -> list[str]:
    return [plan.layout.training(dataset.name, method) for dataset in datasets for method in plan.trained]


def _studies(plan: Plan, datasets: list[Dataset], parameters: Iterable[str]) -> list[str]:
    return [plan.layout.study(dataset.name, parameter) for dataset in datasets for parameter in parameters]


def _claims(plan: Plan, datasets: list[Dataset]) -> list[str]:
    return [
        *_tracks(plan, datasets),
        *(plan.layout.errors(dataset.name, method) for dataset in datasets for method in plan.run.compare),
        *(plan.layout.ttests(dataset.name) for dataset in datasets),
        *_studies(plan, datasets, _claimed_studies(plan)),
        *(plan.layout.runtime(name) for name in _measured(plan, datasets)),
    ]


def _short_errors(plan: Plan, datasets: list[Dataset]) -> list[str]:
    return [
        file
        for name in _short(plan)
        for file in (
            *(plan.layout.errors(name, method) for method in plan.run.compare),
            *(plan.layout.uncertainty(name, method) for method in plan.measured),
        )
    ]


# --- what they ask for ------------------------------------------------------------------------------------------------


def _recordings(datasets: list[Dataset]) -> dict[str, list[str]]:
    """Names of the test recordings by dataset."""
    return {dataset.name: [one.name for one in dataset.of_split("test")] for dataset in datasets}


def _values(plan: Plan, parameters: Iterable[str]) -> dict[str, list[float]]:
    """Values tried of each parameter."""
    return {parameter: list(getattr(plan.run.studies, parameter)) for parameter in parameters}


def _claimed_studies(plan: Plan) -> list[str]:
    """Parameters whose study the claims look at: they are about TC-CLiFF."""
    return plan.studied if plan.run.studies.method == "tc_cliff" else []


def _measured(plan: Plan, datasets: list[Dataset]) -> list[str]:
    """Datasets that the runtime study has been run on: the claims do not wait for timings."""
    return [dataset.name for dataset in datasets if Path(plan.layout.runtime(dataset.name)).exists()]


def _methods(plan: Plan, datasets: list[Dataset]) -> dict[str, Any]:
    return {"methods": plan.titles}


def _drawn(plan: Plan, datasets: list[Dataset]) -> dict[str, Any]:
    return {"methods": plan.drawn}


def _and_variants(caption: str) -> Callable[[Plan], str]:
    """The caption of a figure of curves, which says what is not drawn."""
    return lambda plan: (
        caption
        + ("" if plan.drawn == plan.titles else " Variants of methods that are drawn stand in the tables alone.")
    )


def _networks(plan: Plan, datasets: list[Dataset]) -> dict[str, Any]:
    return {"methods": plan.run.titles(plan.trained)}


def _constants(plan: Plan, datasets: list[Dataset]) -> dict[str, Any]:
    constants = {f"{kind}_resolution_m": plan.run.building(find(kind)).resolution_m for kind in ("cliff", "stef")}
    sampled = {one.name: {key: plan.paper_option(one.name, key) for key in ROLL_OUT} for one in datasets}
    return {"recordings": _recordings(datasets), "constants": constants, "sampled": sampled}


def _claims_asks(plan: Plan, datasets: list[Dataset]) -> dict[str, Any]:
    return {
        "recordings": _recordings(datasets),
        "titles": plan.titles,
        "kinds": {name: plan.run.kind(name).name for name in plan.run.compare},
        "studies": _values(plan, _claimed_studies(plan)),
        "horizons": plan.horizons,
        "measured": _measured(plan, datasets),
        "days": days_of(datasets),
    }


def _parameter_asks(plan: Plan, datasets: list[Dataset]) -> dict[str, Any]:
    (dataset,) = datasets
    studied = plan.method(dataset.name, plan.run.studies.method)
    return {
        "method": plan.run.title(studied.name),
        "values": _values(plan, plan.studied),
        "chosen": {parameter: getattr(studied.options, parameter) for parameter in plan.studied},
        "horizons": plan.horizons[dataset.name],
    }


def _short(plan: Plan) -> list[str]:
    """Datasets with forecasts that the field's short table has: at its steps and horizon."""
    return [name for name, one in plan.datasets.items() if one.time_step_s == STEP_S and AHEAD_S in plan.horizons[name]]


def _straight(plan: Plan) -> str | None:
    """The first compared method of constant velocity; None without one."""
    return next((name for name in plan.run.compare if plan.run.kind(name).name == "cvm"), None)


def _short_asks(plan: Plan, datasets: list[Dataset]) -> dict[str, Any]:
    return {
        "methods": plan.titles, "measured": plan.measured, "reference": _straight(plan), "short": _short(plan),
        "days": days_of(datasets),
    }  # fmt: skip


def _training_asks(plan: Plan, datasets: list[Dataset]) -> dict[str, Any]:
    return {
        "titles": plan.run.titles(plan.from_less),
        "shares": list(plan.run.studies.training.shares),
        "horizons": plan.ladder_horizons,
    }


# --- what they say ----------------------------------------------------------------------------------------------------


def _results_caption(plan: Plan) -> str:
    return (
        "ADE / FDE in metres at each dataset's longest horizon under both protocols, with scored and eligible tracks; "
        "each track at its own length; how many forecasts, and true paths, come 0.3 m inside a wall of the floor plan; "
        f"below, the other table horizons. Errors are {SEED_MEANS}, over {len(plan.run.seeds)} seeds."
    )


def _parameter_caption(plan: Plan) -> str:
    studies = plan.run.studies
    return (
        f"ADE of {plan.run.title(studies.method)} at several horizons against the kernel parameter β (left) and the "
        "sampling radius r_s (right), the other options as in the parameter table; mean, one standard deviation over "
        f"tracks (thin bars) and over seeds (thick bars), under both protocols. At most {studies.max_tracks} test "
        "tracks, always the same ones. Under the paper protocol each value scores other tracks: the legend gives "
        "the lowest and highest number."
    )


def _short_caption(plan: Plan) -> str:
    beside = "with constant velocity beside them, and" if _straight(plan) else "and"
    return (
        f"Expected errors 2.0 s ahead at ten positions per second: the mean over each forecast's samples, {beside} "
        "published numbers of this task, which are of another split."
    )


def _has_networks(plan: Plan) -> bool:
    return bool(plan.trained)


EXHIBITS: tuple[Exhibit, ...] = (
    Exhibit(
        name="tab_scenarios",
        form="table",
        module=f"{MODULES}.tables",
        function="draw_parameters",
        title="parameters",
        category="Tables",
        section="data",
        paper="tab:scenarios",
        caption="Parameters of the maps and of the roll-out of the paper's methods, and the 90th percentile of the "
        "length of the test tracks after the last observation, which according to the paper sets its longest horizons.",
        needs=_tracks,
        asks=_constants,
    ),
    Exhibit(
        name="tab_expres",
        form="table",
        module=f"{MODULES}.tables",
        function="draw_results",
        title="results",
        category="Tables",
        section="errors",
        paper="tab:expres",
        caption=_results_caption,
        needs=_scores,
        asks=lambda plan, datasets: {"methods": plan.titles, "horizons": plan.horizons},
        lacks=(lacks.NO_PLAN,),
    ),
    Exhibit(
        name="{label}_final",
        form="figure",
        module=f"{MODULES}.horizon_errors",
        title="errors against horizon",
        category="Figures",
        section="errors",
        paper="fig:atc_final, fig:edin_final",
        caption=_and_variants(
            "ADE and FDE against the prediction horizon, mean and one standard deviation over tracks, under the "
            "paper protocol (upper row) and the complete protocol (lower row). The legend gives scored and eligible "
            "tracks at the longest horizon."
        ),
        needs=_scores,
        asks=_drawn,
    ),
    Exhibit(
        name="coverage",
        form="figure",
        module=f"{MODULES}.coverage",
        title="coverage",
        category="Figures",
        section="errors",
        caption=_and_variants(
            "Share of the eligible tracks that each method scores at each horizon under the paper protocol "
            "(above), and how many are eligible under either protocol (below). A method's error under the paper "
            "protocol is that of the tracks on which at least one of its futures stayed on the map, so methods are "
            "compared on different tracks; under the complete protocol all score every eligible track."
        ),
        needs=_scores,
        asks=_drawn,
    ),
    Exhibit(
        name="rank-metrics",
        form="figure",
        module=f"{MODULES}.ranking_gain",
        title="with and without ranking",
        category="Figures",
        section="errors",
        paper="fig:rank-metrics",
        caption=lambda plan: (
            f"ADE of {plan.run.title('tc_cliff')} with ranking (the most likely of the k futures) and without (mean "
            "error of the k), both protocols."
        ),
        needs=_scores,
        asks=lambda plan, datasets: {"method": "tc_cliff", "title": plan.run.title("tc_cliff")},
        wanted=lambda plan: "tc_cliff" in plan.run.compare,
        lacks=(lacks.NO_CLOCK, lacks.NO_FORECASTS),
    ),
    Exhibit(
        name="tab_ttests",
        form="table",
        module=f"{MODULES}.tables",
        function="draw_ttests",
        title="t-tests",
        category="Tables",
        section="errors",
        caption="Every paired one-sided t-test of the configuration, on the tracks that both methods scored: mean "
        "difference, its 95 % interval, effect size (Cohen's d_z), p and p after Holm's correction over all tests of a "
        "dataset and protocol.",
        needs=lambda plan, datasets: [plan.layout.ttests(dataset.name) for dataset in datasets],
        asks=_methods,
    ),
    Exhibit(
        name="readings-{label}",
        form="table",
        module=f"{MODULES}.readings_table",
        title="readings of the scoring rules",
        category="Tables",
        section="errors",
        caption="The results table under every reading of the rules that the paper does not state: idle tracks kept or "
        "dropped, tracks whose forecasts left the map held or dropped, and which tracks a mean over seeds is of; "
        "methods with velocities from positions beside those with the file's. The paper's numbers stand beside them.",
        needs=lambda plan, datasets: [
            plan.layout.readings(dataset.name, method) for dataset in datasets for method in plan.read_anew
        ],
        asks=lambda plan, datasets: {
            "methods": plan.run.titles(plan.read_anew),
            "kinds": {name: plan.run.kind(name).name for name in plan.read_anew},
        },
        wanted=lambda plan: bool(plan.read_anew),
    ),
    Exhibit(
        name="tab_short",
        form="table",
        module=f"{MODULES}.short_table",
        title="2.0 s at ten positions per second",
        category="Tables",
        section="errors",
        caption=_short_caption,
        needs=_short_errors,
        asks=_short_asks,
        wanted=lambda plan: bool(_short(plan)),
        lacks=(lacks.NOT_SHORT, lacks.NOT_AS_LONG),
    ),
    Exhibit(
        name="tab_encounters",
        form="table",
        module=f"{MODULES}.encounters_table",
        title="forecasts that run into others",
        category="Tables",
        section="errors",
        caption="How often forecasts come less than 0.2 m near to where another person really was at that time, up to "
        "each horizon, beside the same of people's own paths.",
        needs=lambda plan, datasets: [
            plan.layout.encounters(dataset.name, method) for dataset in datasets for method in plan.run.compare
        ],
        asks=_methods,
    ),
    Exhibit(
        name="claims",
        form="table",
        module=f"{MODULES}.claims_table",
        title="the paper's claims, tested",
        category="Tables",
        section="claims",
        caption="Every claim of the paper's results section, its place and p there, beside our test of it: "
        "hypothesis, both values, n, mean difference, 95 % interval, p, p after Holm's correction, and a verdict, "
        "under each protocol. Claims that need learned methods or the runtime study are marked where these have not "
        "been run.",
        needs=_claims,
        asks=_claims_asks,
        minutes=30,
        lacks=(lacks.ESTIMATED_CLOCK, lacks.NEEDS_PLAN, lacks.NEEDS_LONGER, lacks.NEEDS_NUMBER, lacks.TOO_FEW),
    ),
    Exhibit(
        name="tab_models",
        form="table",
        module=f"{MODULES}.trainings",
        title="trained networks",
        category="Tables",
        section="networks",
        caption="The learned baselines as they were trained: budget, seed, number of parameters, tracks, windows run "
        "of those planned, iterations, the validation error of held-out training persons at the best and the last "
        "epoch, how much it still changed at the end, and whether twice the windows were better.",
        needs=_trainings,
        asks=_networks,
        wanted=_has_networks,
    ),
    Exhibit(
        name="learning-curves",
        form="figure",
        module=f"{MODULES}.learning_curves",
        title="learning curves",
        category="Studies",
        section="networks",
        caption="Learning curves of the networks: the validation error of held-out training persons (above) and the "
        "training loss (below). A curve that still falls at its end means that longer training would give a better "
        "baseline.",
        needs=_trainings,
        asks=_networks,
        wanted=_has_networks,
    ),
    Exhibit(
        name="parameter-{label}",
        form="figure",
        module=f"{MODULES}.parameter_study",
        title="ADE against beta and r_s",
        category="Studies",
        section="parameters",
        paper="fig:parameter",
        caption=_parameter_caption,
        needs=lambda plan, datasets: _studies(plan, datasets, plan.studied),
        asks=_parameter_asks,
        wanted=lambda plan: bool(plan.studied),
    ),
    Exhibit(
        name="training-share",
        form="figure",
        module=f"{MODULES}.training_share",
        title="amount of training data",
        category="Studies",
        section="parameters",
        caption="ADE under the complete protocol with maps built from a share of the training tracks, drawn by a hash "
        "of their ids, so that a larger share contains every smaller one. Where a line still falls at its right end, "
        "more recordings would help.",
        needs=lambda plan, datasets: _studies(plan, datasets, ["training"]),
        asks=_training_asks,
        wanted=lambda plan: bool(plan.from_less),
    ),
)
