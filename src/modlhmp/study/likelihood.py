"""Which map is true? How likely maps make the velocities of people whom they have not seen, by place and time only.

Everything that is chosen (the weight of the background, how far an hour is shrunk to the day, how histograms are
smoothed) is chosen on persons held out of the training data, with maps built without them; the test rows only confirm.
"""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import pyarrow as pa

from modlhmp.kinds import find
from modlhmp.logs import progress
from modlhmp.maps.base import day_file, hour_files
from modlhmp.maps.density import Density, NoMap, Source, load
from modlhmp.maps.histogram import PLAIN, Bins, Counts, Level, histogram
from modlhmp.methods import build_map
from modlhmp.scoring.likelihood import (
    DIFFERENCE,
    PRINTED,
    SUMMARY,
    accounted,
    as_printed,
    choose_weight,
    differences,
    is_charged,
    summarise,
    with_background,
)  # fmt: skip
from modlhmp.site import Site
from modlhmp.storage import DataError
from modlhmp.study.comparisons import LEAST_DAYS
from modlhmp.tracks import Tracks, clock_hours

HELD_OUT = 0.15  # of the persons of the training data
SPACES = ("joint", "heading")  # of headings and speeds, or of headings alone
# In brackets, which no name of a method has.
NO_MAP, DAY_BINS, HOUR_BINS, SMOOTHED = "<no map>", "<day>", "<hours>", "<smoothed>"
TITLES = {
    NO_MAP: "no map",
    DAY_BINS: "histogram, day",
    HOUR_BINS: "histogram, hours shrunk to the day",
    SMOOTHED: "smoothed histogram",
}
ALL_HOURS = -1
COARSE_M = 3.0  # cells of the histogram that is asked where a map of a family and its broader ones say nothing
EIGHT = 8.0  # rows: one added to each of eight directions


class Mapped(NamedTuple):
    """A map that is measured: its method and kind, where it lies, and how it is built (None: it is given)."""

    name: str
    kind: str
    path: str
    building: Any


class Way(NamedTuple):
    """A way to make a histogram, of which the best on the persons held out is taken."""

    about: str
    cell_m: float
    levels: tuple[Level, ...]
    bins: Bins = PLAIN

    @property
    def hourly(self) -> bool:
        """Whether it asks for the hour of the day."""
        return any(level.hourly for level in self.levels)


def shrunk(weight: float) -> Way:
    """Eight directions by the hour, shrunk to those of the day as if that were so many rows."""
    return Way(f"k {weight:g}", 1.0, (Level(EIGHT), Level(weight, hourly=True)))


def smoothed(weight: float, spread_m: float, day: float | None) -> Way:
    """Fine bins, from what is known of 2 m around to `spread_m`; and to the hour, as if the day were so many rows."""
    levels = [Level(weight, 2.0), Level(weight, spread_m)]
    about = f"k {weight:g}, {spread_m:g} m"
    if day is not None:
        levels.append(Level(day, spread_m, hourly=True))
        about += f", day {day:g}"
    return Way(about, 0.5, tuple(levels), Bins(36, 0.1, 0.15, 0.08))


WAYS = {
    DAY_BINS: (Way("", 1.0, (Level(EIGHT),)),),
    HOUR_BINS: tuple(shrunk(weight) for weight in (2.0, 8.0, 32.0)),
    SMOOTHED: (
        smoothed(20.0, 0.4, None),
        smoothed(20.0, 0.4, 64.0),
        smoothed(20.0, 0.6, 64.0),
        smoothed(50.0, 1.0, None),
    ),
}


class Asked(NamedTuple):
    """A density, and the broader ones of its family that are asked where it says nothing."""

    density: Density
    broader: tuple[Density, ...] = ()


class Answers(NamedTuple):
    """Log densities [n] of rows: of each map, of its broader ones, and without a map, for one of `SPACES`."""

    log_p: dict[str, np.ndarray]
    broader: dict[str, list[np.ndarray]]
    without_map: np.ndarray


def clusters_of(person: np.ndarray, recording: np.ndarray, days: Sequence[str]) -> np.ndarray:
    """What intervals are over, [n]: the `days` of the recordings where there are enough, else persons."""
    names, day = np.unique(list(days), return_inverse=True)
    return day[recording] if len(names) >= LEAST_DAYS else person


def held_out(person: np.ndarray) -> np.ndarray:
    """Whether rows are of the persons held out, bool [n]; `person` [n] numbers them."""
    people = np.unique(person)
    if len(people) < 2:
        raise DataError(
            "likelihood of maps: fewer than two persons walk in the training recordings, so none can be held out; give "
            "more, or leave it out with `likelihood: {methods: []}`"
        )
    number = max(round(HELD_OUT * len(people)), 1)
    return np.isin(person, np.random.default_rng(0).permutation(people)[:number])


def measure(
    training: Tracks,
    person: np.ndarray,
    test: Tracks,
    cluster: np.ndarray,
    site: Site,
    maps: Sequence[Mapped],
    clock: bool = True,
) -> dict[str, pd.DataFrame]:
    """Tables {`scores`, `pairs`} of maps on the rows of people who walk; `person`, `cluster` [n] number whose rows are.

    `scores`: of each of `SPACES`, map and accounting (`scoring.likelihood`) over all rows, and with the background also
    of each clock hour: the `SUMMARY`, shares of rows that the map `covered` and that were `charged`, the `weight` of
    the background and what was `chosen`, both on the persons held out. `pairs`: paired differences of all maps with
    their backgrounds. Intervals are over `cluster`, which are persons or days. Without a `clock` nothing is by hours.
    """
    known, wanted = training.moves(), test.moves()
    training, person, test, cluster = training.take(known), person[known], test.take(wanted), cluster[wanted]
    held = held_out(person)
    fit, tried = training.take(~held), training.take(held)
    no_map = NoMap(fit.speed)
    tables = {
        one.path: build_map(one.kind, fit, site, one.building, person[~held])
        for one in maps
        if one.building is not None
    }
    able = {name: [way for way in ways if clock or not way.hourly] for name, ways in WAYS.items()}
    chosen = {name: _best(ways, fit, tried, site, no_map) for name, ways in able.items() if ways}
    asked = _densities(fit, site, no_map, maps, tables, chosen)
    weights = {
        space: {name: choose_weight(one, answers.without_map) for name, one in answers.log_p.items()}
        for space, answers in _ask(asked, no_map, tried).items()
    }
    no_map = NoMap(training.speed)
    found = _ask(_densities(training, site, no_map, maps, {}, chosen), no_map, test)
    hours = clock_hours(test.t, site.timezone) if clock else None
    scores = [_scores(space, found[space], weights[space], hours, cluster) for space in SPACES]
    pairs = []
    for space in SPACES:
        log_p = {
            name: with_background(one, found[space].without_map, weights[space][name])
            for name, one in found[space].log_p.items()
        }
        pairs.append(pd.DataFrame(differences(log_p, cluster), columns=list(DIFFERENCE)).assign(space=space))
    table = pd.concat(scores, ignore_index=True)
    table["chosen"] = table["map"].map({name: way.about for name, way in chosen.items()}).fillna("")
    return {"scores": table, "pairs": pd.concat(pairs, ignore_index=True)}


def _best(ways: Sequence[Way], fit: Tracks, tried: Tracks, site: Site, no_map: NoMap) -> Way:
    """The way of a histogram with the best likelihood of the rows tried, itself with the background that suits it."""
    if len(ways) == 1:
        return ways[0]
    without = no_map.log_density(tried.x, tried.y, tried.t, tried.heading, tried.speed)
    means: list[float] = []
    counts: dict[tuple[float, Bins], Counts] = {}
    for way in ways:
        key = way.cell_m, way.bins
        counts[key] = counts.get(key) or Counts(fit, site, no_map, *key)
        log_p = counts[key].density(way.levels).log_density(tried.x, tried.y, tried.t, tried.heading, tried.speed)
        means.append(with_background(log_p, without, choose_weight(log_p, without)).mean())
    return ways[int(np.argmax(means))]


def _densities(
    tracks: Tracks,
    site: Site,
    no_map: NoMap,
    maps: Sequence[Mapped],
    tables: Mapping[str, tuple[pa.Table | None, dict[int, pa.Table]]],
    chosen: Mapping[str, Way],
) -> dict[str, Asked]:
    """Every map by name; `tables` are those that were built here, others are read."""
    ways = {name: histogram(tracks, site, no_map, way.cell_m, way.levels, way.bins) for name, way in chosen.items()}
    coarse = histogram(tracks, site, no_map, COARSE_M, (Level(EIGHT),))
    found = {NO_MAP: Asked(no_map)}
    for one in maps:
        whole, hours = tables[one.path] if one.path in tables else _files(one)
        hourly = find(one.kind).hourly
        density = load(one.kind, hours if hourly else whole, site, no_map)
        day = [load(one.kind, whole, site, no_map)] if hourly and whole is not None else []
        found[one.name] = Asked(density, (*day, coarse))
    broader = {HOUR_BINS: (ways[DAY_BINS], coarse), SMOOTHED: (coarse,), DAY_BINS: (coarse,)}
    return found | {name: Asked(one, broader[name]) for name, one in ways.items()}


def _files(one: Mapped) -> tuple[Source | None, Mapping[int, Source]]:
    """The files of a map: that of the whole day, if there is one, and {hour: file}."""
    if not find(one.kind).hourly:
        return one.path, {}
    return day_file(one.path), hour_files(one.path)


def _ask(asked: Mapping[str, Asked], no_map: NoMap, rows: Tracks) -> dict[str, Answers]:
    """{space: what every map says of rows}."""
    where, found = (rows.x, rows.y, rows.t), {}
    questions = {"joint": ("log_density", (rows.heading, rows.speed)), "heading": ("log_heading", (rows.heading,))}
    for space, (question, velocity) in questions.items():
        log_p, broader = {}, {}
        for name, one in progress(asked.items(), desc=f"maps, {space}"):
            log_p[name] = getattr(one.density, question)(*where, *velocity)
            broader[name] = [getattr(other, question)(*where, *velocity) for other in one.broader]
        found[space] = Answers(log_p, broader, getattr(no_map, question)(*where, *velocity))
    return found


def _scores(
    space: str, answers: Answers, weights: Mapping[str, float], hours: np.ndarray | None, cluster: np.ndarray
) -> pd.DataFrame:
    """Rows of `measure`'s `scores` for one space; `hours` [n] are None without a clock."""
    rows: list[tuple[Any, ...]] = []

    def add(name, accounting, hour, log_p, which):
        covered, paid = ~np.isnan(answers.log_p[name]), is_charged(answers.log_p[name])
        summary = summarise(log_p[which], answers.without_map[which], cluster[which])
        shares = float(covered[which].mean()), float(paid[which].mean())
        rows.append((space, name, accounting, hour, *summary, *shares, weights[name]))

    everything = np.ones(len(cluster), bool)
    for (name, accounting), log_p in accounted(answers.log_p, answers.without_map, weights, answers.broader).items():
        add(name, accounting, ALL_HOURS, log_p, everything)
        if accounting == "background" and hours is not None:
            for hour in np.unique(hours).tolist():
                add(name, accounting, hour, log_p, hours == hour)
    for name, one in answers.log_p.items():
        add(name, PRINTED, ALL_HOURS, as_printed(one), everything)
    columns = ["space", "map", "accounting", "hour", *SUMMARY, "covered", "charged", "weight"]
    return pd.DataFrame(rows, columns=columns)
