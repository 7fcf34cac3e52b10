"""Records of the exhibits that are maps, forecasts and distributions: what shows a place and its people."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from modlhmp.datasets import Dataset
from modlhmp.study import lacks
from modlhmp.study.exhibits.record import MODULES, Exhibit, days_of
from modlhmp.study.exhibits.words import OVER
from modlhmp.study.explorer.look import ASSETS
from modlhmp.study.plan import Plan
from modlhmp.study.versions import assets_version


def _floor_plans(datasets: Iterable[Dataset]) -> list[str]:
    return [file for dataset in datasets for file in dataset.floor_plan]


def _maps(*kinds: str, floor_plan: bool = True) -> dict[str, Any]:
    """The fields of a figure that shows maps of these kinds, made where the compared methods build them all."""

    def needs(plan: Plan, datasets: list[Dataset]) -> list[str]:
        maps = [plan.layout.map(dataset.name, kind) for dataset in datasets for kind in kinds]
        return [*maps, *(_floor_plans(datasets) if floor_plan else [])]

    return {"needs": needs, "wanted": lambda plan: plan.compared_kinds.issuperset(kinds)}


def _examples(plan: Plan, datasets: list[Dataset]) -> list[str]:
    """All that a figure of an example track may show: tracks, errors and forecasts of every compared method."""
    files = []
    for dataset in datasets:
        files += plan.tracks(dataset.name, "test")
        files += [plan.layout.errors(dataset.name, method) for method in plan.titles]
        files += [plan.layout.forecasts(dataset.name, method) for method in plan.titles]
    return [*files, *_floor_plans(datasets)]


def _uncertainty(plan: Plan, datasets: list[Dataset]) -> list[str]:
    return [plan.layout.uncertainty(dataset.name, method) for dataset in datasets for method in plan.measured]


def _of_kind(plan: Plan, names: Iterable[str], kind: str) -> str | None:
    """The method of a kind among these: the one with the kind's name if it is there, else the first."""
    found = [name for name in names if plan.run.kind(name).name == kind]
    return min(found, key=lambda name: name != kind, default=None)


def _with_memory(plan: Plan) -> dict[str, str]:
    """Titles of an episode and a snippet method by name, if such are compared."""
    found = [_of_kind(plan, plan.titles, kind) for kind in ("episodes", "snippets")]
    return plan.run.titles(name for name in found if name)


def _memory_caption(plan: Plan) -> str:
    outputs = {plan.method(dataset, name).options.output for dataset in plan.datasets for name in _with_memory(plan)}
    median = (
        " The result is the geometric median, at each second, of those who are still there; where people part ways it "
        "may lie where nobody walks."
    )
    return (
        "The two maps with memory. Left: snippets of a few seconds that start near the walker, coloured by direction. "
        "Middle and right: a forecast with the episode map, which replays the most similar persons from here, and with "
        "the snippet flow map, whose particles string snippets together. Crosses: persons who left through an exit."
        + (median if outputs == {"geometric_median"} else "")
    )


def _memory_maps(plan: Plan, datasets: list[Dataset]) -> list[str]:
    return [*_examples(plan, datasets), *(plan.layout.map(dataset.name, "snippets") for dataset in datasets)]


def _sampled(plan: Plan) -> str | None:
    """The method whose samples are shown: that with a snippet flow map, or the first measured; None without one."""
    return _of_kind(plan, plan.measured, "snippets") or next(iter(plan.measured), None)


def _density(plan: Plan, datasets: list[Dataset]) -> list[str]:
    files, shown = [], _sampled(plan)
    for dataset in datasets:
        files += [*plan.tracks(dataset.name, "test"), plan.layout.errors(dataset.name, next(iter(plan.titles)))]
        for found in (plan.map_of(dataset.name, shown), plan.exits_of(dataset.name, shown)) if shown else ():
            files += [found] if isinstance(found, str) else found
        if shown and not plan.run.kind(shown).has_map:
            files.append(plan.layout.forecasts(dataset.name, shown))
    return [*files, *_floor_plans(datasets)]


def _density_asks(plan: Plan, datasets: list[Dataset]) -> dict[str, Any]:
    shown = _sampled(plan)
    return {
        "methods": plan.titles,
        "shown": {dataset.name: plan.method(dataset.name, shown).plain() for dataset in datasets if shown},
        "samples": plan.run.uncertainty.samples,
        "seed": plan.run.seeds[0],
    }


def _occupied(*tables: str) -> dict[str, Any]:
    """The fields of an exhibit of which cells were occupied, of every dataset with a clock."""

    def needs(plan: Plan, datasets: list[Dataset]) -> list[str]:
        return [plan.layout.occupied(one.name, table) for one in datasets for table in tables]

    return {"needs": needs, "wanted": lambda plan: bool(plan.foretold) and len(plan.foretold) == len(plan.datasets)}


def _filmed(plan: Plan) -> str:
    """Title of the method that is filmed; empty where there is none."""
    return "".join(plan.run.titles(plan.run.studies.occupied.methods[:1]).values())


def _occupied_asks(plan: Plan, datasets: list[Dataset]) -> dict[str, Any]:
    return {"titles": plan.run.titles(plan.run.studies.occupied.methods), "horizons": plan.horizons}


def _one_by_one(plan: Plan, datasets: list[Dataset]) -> list[str]:
    """Names of the datasets whose people the explorer shows: made-up ones, or as the run's owner says."""
    said = plan.run.explorer.tracks
    return [dataset.name for dataset in datasets if (dataset.demo if said is None else said)]


def _explored_maps(plan: Plan) -> list[str]:
    return [kind for kind in ("cliff", "tc_cliff", "stef") if kind in plan.compared_kinds]


def _explored(plan: Plan, datasets: list[Dataset]) -> list[str]:
    files, shown = [plan.layout.scores, *_floor_plans(datasets)], _one_by_one(plan, datasets)
    for dataset in datasets:
        files += [plan.layout.map(dataset.name, kind) for kind in _explored_maps(plan)]
        files += plan.tracks(dataset.name, "train")
        if dataset.name in shown:
            files += plan.tracks(dataset.name, "test")
            files += [plan.layout.forecasts(dataset.name, method) for method in plan.titles]
    return files


def _explorer_asks(plan: Plan, datasets: list[Dataset]) -> dict[str, Any]:
    return {
        "methods": plan.titles,
        "maps": _explored_maps(plan),
        "tracks": _one_by_one(plan, datasets),
        "recordings": {
            dataset.name: {split: [one.name for one in dataset.of_split(split)] for split in ("train", "test")}
            for dataset in datasets
        },
        "look": assets_version(ASSETS),
    }


def _runtimes(plan: Plan, datasets: list[Dataset]) -> list[str]:
    return [plan.layout.runtime(dataset.name) for dataset in datasets]


def _runtimes_exist(plan: Plan) -> bool:
    """Whether all have been measured; the figure does not start that itself, since nothing else may run meanwhile."""
    return all(Path(file).exists() for file in _runtimes(plan, list(plan.datasets.values())))


def _titles(plan: Plan, datasets: list[Dataset]) -> dict[str, Any]:
    return {"methods": plan.titles}


def _measures(plan: Plan) -> bool:
    return bool(plan.measured)


EXHIBITS: tuple[Exhibit, ...] = (
    Exhibit(
        name="cliff-{label}-time",
        form="figure",
        module=f"{MODULES}.cliff_hours",
        title="hourly TC-CLiFF-maps",
        category="Maps",
        section="maps",
        paper="fig:cliff-atc-time",
        caption="Time-conditioned CLiFF-map at a few hours: mean of the heaviest component of each location. Colour "
        "encodes orientation, length encodes speed. The number of locations is above each panel.",
        **_maps("tc_cliff"),
        lacks=(lacks.NO_CLOCK, lacks.NO_MAP),
    ),
    Exhibit(
        name="stef-{label}-time",
        form="figure",
        module=f"{MODULES}.stef_hours",
        title="hourly STeF-maps",
        category="Maps",
        section="maps",
        paper="fig:stef-atc-time",
        caption="STeF-map in the middle of a few hours: the dominant orientation of each cell that has dynamics then. "
        "Colour encodes orientation; the map has no speed, so all arrows are equally long. The number of cells is "
        "above each panel.",
        **_maps("stef"),
        lacks=(lacks.NO_CLOCK, lacks.NO_CELL),
    ),
    Exhibit(
        name="cliff-{label}-time-one-location",
        form="figure",
        module=f"{MODULES}.one_location",
        title="CLiFF at one location",
        category="Maps",
        section="maps",
        paper="fig:cliff-atc-time-one-location",
        caption="CLiFF-map at one location for every clock hour and for the whole day: the mean of each component. "
        "Colour encodes orientation, length speed (the circle is 1 m/s), transparency the weight; n is the number of "
        "observations. The location is the one whose quietest hour is the busiest.",
        **_maps("tc_cliff", "cliff", floor_plan=False),
        lacks=(lacks.NO_CLOCK, lacks.NOT_HERE, lacks.NO_LOCATION),
    ),
    Exhibit(
        name="{label}_mod",
        form="figure",
        module=f"{MODULES}.mod_comparison",
        title="TC-CLiFF and STeF",
        category="Maps",
        section="maps",
        paper="fig:edin_mod",
        caption="Time-conditioned CLiFF-map (left) and STeF-map (right) at a few hours: all components of each "
        "location and all orientations of each cell. Colour encodes orientation, transparency the component's weight "
        "or the orientation's probability, length the speed, which STeF does not have.",
        **_maps("tc_cliff", "stef"),
        lacks=(lacks.NO_CLOCK, lacks.NO_MAP),
    ),
    Exhibit(
        name="rank",
        form="figure",
        module=f"{MODULES}.ranked_forecasts",
        title="ranked forecasts",
        category="Forecasts",
        section="forecasts",
        paper="fig:rank",
        caption="The futures of the method that each key names, for one person of each dataset, to its longest "
        "horizon: truth red, observation green, futures blue, darker the better they rank; a cross where a future left "
        "the map. Ranks are those of the complete protocol. The person is chosen by rule: of the tracks eligible at "
        "the horizon under the paper protocol, that of the median ADE of the first compared method. Marked areas come "
        "from the dataset file.",
        needs=_examples,
        asks=_titles,
        lacks=(lacks.NO_TRACK, lacks.NO_RANKS),
    ),
    Exhibit(
        name="prediction_example",
        form="figure",
        module=f"{MODULES}.example_forecasts",
        title="forecasts of all methods",
        category="Forecasts",
        section="forecasts",
        paper="fig:prediction_example",
        caption="What each method forecast for one person of each dataset, over the floor plan, to its longest horizon "
        "or, of one under 60 s, half of it. Methods with ranked futures show the best ranked one. The person is "
        "chosen by rule: of the tracks eligible at the horizon under the paper protocol, that of the median ADE of "
        "the first compared method.",
        needs=_examples,
        asks=_titles,
        lacks=(lacks.NO_TRACK,),
    ),
    Exhibit(
        name="memory-maps",
        form="figure",
        module=f"{MODULES}.memory_maps",
        title="maps with memory",
        category="Maps",
        section="maps",
        caption=_memory_caption,
        needs=_memory_maps,
        asks=lambda plan, datasets: {"methods": _with_memory(plan)},
        wanted=lambda plan: len(_with_memory(plan)) == 2,
        lacks=(lacks.NO_TRACK,),
    ),
    Exhibit(
        name="density",
        form="figure",
        module=f"{MODULES}.density_maps",
        title="density of a forecast",
        category="Forecasts",
        section="forecasts",
        caption="Where one person of each dataset may be after a sixth, a third and the whole of the longest horizon, "
        "given that they are still there: samples of the forecast, spread by a Gaussian. The lines enclose the "
        "smallest areas of 50 % and 90 %. The person is chosen by rule: of the tracks eligible at the horizon under "
        "the paper protocol, that of the median ADE of the first compared method.",
        needs=_density,
        asks=_density_asks,
        forecasts=_sampled,
        wanted=_measures,
        lacks=(lacks.NO_TRACK,),
    ),
    Exhibit(
        name="calibration",
        form="figure",
        module=f"{MODULES}.calibration",
        title="calibration",
        category="Figures",
        section="certainty",
        caption="Left: the error that a method expects of its own output against the real one, in ten bins of equally "
        "many tracks; above the diagonal a method is too sure of itself. Right: the probability that a person has left "
        "by then against the share of people that had. A robot that must keep its distance needs both on the "
        f"diagonal. Bars are 95 % intervals of the mean, {OVER}; the CSV has all horizons, and n of each bin.",
        needs=_uncertainty,
        asks=lambda plan, datasets: {"methods": plan.titles, "measured": plan.measured, "days": days_of(datasets)},
        wanted=_measures,
        lacks=(lacks.NOT_AS_LONG,),
    ),
    Exhibit(
        name="tab_uncertainty",
        form="table",
        module=f"{MODULES}.uncertainty_table",
        title="distributions",
        category="Tables",
        section="certainty",
        caption=lambda plan: (
            "How good each method's forecasts are as distributions, at each horizon: energy score and KDE-NLL (lower "
            "is better), best of five futures and how often that misses by 2 m, the error that a method expects of its "
            "own output beside the real one, and the Brier score of its probability that the person has left, beside "
            "that of always forecasting the base rate. "
            f"Complete protocol; means over {len(plan.run.seeds)} seeds per track, then over tracks."
        ),
        needs=_uncertainty,
        asks=lambda plan, datasets: {
            "methods": plan.run.titles(plan.measured),
            "others": {plan.run.title(name): reason for name, reason in plan.unmeasured.items()},
        },
        wanted=_measures,
    ),
    Exhibit(
        name="occupied",
        form="figure",
        module=f"{MODULES}.occupied_figure",
        title="occupied cells",
        category="Figures",
        section="certainty",
        caption="Cells of 1 m by the probability that somebody who is there now will be in them, against the share "
        "that was occupied. Everyone is forecast at moments of whole days, with maps of people who were not recorded "
        "within ten minutes of them. Above the diagonal more cells were occupied than announced.",
        asks=_occupied_asks,
        lacks=(lacks.NOBODY,),
        **_occupied("bins"),
    ),
    Exhibit(
        name="occupied-{label}-film",
        form="figure",
        module=f"{MODULES}.occupied_film",
        title="occupied cells, a film",
        category="Forecasts",
        section="certainty",
        caption=lambda plan: (
            "The moment at which most people were there: the probability that each cell of 1 m is occupied a sixth, a "
            f"third and two thirds of the longest horizon later, by {_filmed(plan)}, and where these people were then. "
            "Who comes later is not shown."
        ),
        asks=lambda plan, datasets: {"title": _filmed(plan)},
        lacks=(lacks.NOBODY,),
        needs=lambda plan, datasets: [*_occupied("film")["needs"](plan, datasets), *_floor_plans(datasets)],
        wanted=_occupied("film")["wanted"],
    ),
    Exhibit(
        name="tab_occupied",
        form="table",
        module=f"{MODULES}.occupied_table",
        title="occupied cells",
        category="Tables",
        section="certainty",
        caption="How good the probabilities of occupied cells are: Brier score beside those of rules that know nobody, "
        "how many cells were foretold and occupied, and in how many bins they were calibrated.",
        asks=lambda plan, datasets: {**_occupied_asks(plan, datasets), "every_s": plan.run.studies.occupied.every_s},
        **_occupied("scores", "bins"),
    ),
    Exhibit(
        name="explorer",
        form="page",
        module="modlhmp.study.explorer.page",
        title="explorer",
        category="Explorer",
        section="explorer",
        caption="Maps by hour, flow and exits on the floor plan, each location's mixture and counts, and error against "
        "horizon, to look at in a browser. Where people are made up, or the run's owner says so, any of them can be "
        "followed second by second with what each method forecast; else the page has aggregates alone.",
        needs=_explored,
        asks=_explorer_asks,
    ),
    Exhibit(
        name="runtime",
        form="figure",
        module=f"{MODULES}.runtime_figure",
        title="runtime",
        category="Studies",
        section="cost",
        caption=lambda plan: (
            f"Runtime of {plan.run.title(plan.run.studies.method)}, measured alone on the machine in a separate "
            "process. Above: time per track for all k futures to the longest horizon, largest resident memory while "
            "forecasting, and size of an hour's map, beside the paper's figures (another machine: a laptop with an "
            "Intel Core i7-1185G7). Below: growth of the time with the number of tracks N, the horizon T and the "
            "number of locations M, with the exponent of each; for M, copies of the map were placed out of "
            "reach, so the forecasts stay the same."
        ),
        needs=_runtimes,
        asks=lambda plan, datasets: {"method": plan.run.title(plan.run.studies.method)},
        wanted=_runtimes_exist,
    ),
)
