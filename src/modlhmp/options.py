"""The options of every kind of method and map that comes with the library, with their defaults and meanings.

What they say reaches a result through the parameters of the job that makes it.
"""

from dataclasses import dataclass
from typing import Annotated, Literal

from annotated_types import Ge, Gt, Le

from modlhmp.settings import (
    From0,
    Metres,
    Positive,
    Share,
    WholeFrom0,
    WholeFrom1,
    WholeFrom2,
    WholeFrom3,
    Width,
    option,
)

Velocity = Literal["dataset", "differences"]


# --- how maps are built -----------------------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class CliffBuilding:
    """Of CLiFF-maps, whole-day and hourly."""

    resolution_m: Metres = option(1.0, "distance of neighbouring locations [m]")
    radius_m: Metres = option(1.0, "a location takes the observations within this distance, border included [m]")
    min_observations: WholeFrom3 = option(5, "locations with fewer observations have no dynamics")
    intensity: Literal["count", "time"] = option(
        "count", "motion intensity: `count` of observations by the largest, or share of the `time` with motion (paper)"
    )
    bandwidth: Literal["isotropic", "kucner"] = option(
        "isotropic", "rule for the bandwidth of mean shift; `kucner` is the reference builder's"
    )


@dataclass(frozen=True, kw_only=True)
class SmoothedBuilding:
    """Of smoothed CLiFF-maps."""

    resolution_m: Metres = option(1.0, "distance of neighbouring locations [m]")
    radius_m: Metres = option(1.0, "a location takes the observations within this distance, border included [m]")
    min_observations: WholeFrom3 = option(5, "locations with fewer observations have no dynamics")
    bandwidth: Literal["isotropic", "kucner"] = option("isotropic", "as of CLiFF-maps")
    day_rows: Positive = option(
        20.0, "an hour's weights are drawn to the day's as if so many rows of the day were that hour's"
    )


@dataclass(frozen=True, kw_only=True)
class StefBuilding:
    """Of STeF-maps."""

    resolution_m: Metres = option(1.0, "size of a cell [m]")
    orientations: Annotated[int, Ge(2), Le(360)] = option(8, "directions per cell (k_stef)")
    interval_s: Annotated[float, Ge(1), Le(86400)] = option(
        600.0, "detections are counted in intervals of this length [s] (t_stef)"
    )
    order: Annotated[int, Ge(1), Le(24)] = option(2, "periodic parts kept per direction (m_stef)")


@dataclass(frozen=True, kw_only=True)
class NeuralVelocityBuilding:
    """Of neural velocity maps."""

    resolution_m: Metres = option(
        0.25, "distance of the locations that it is written to [m]: a location says what is so there, not around it"
    )
    radius_m: Metres = option(0.5, "a location is written where people walked within this distance [m]")
    min_observations: WholeFrom3 = option(5, "and with so many observations at least")
    cell_m: Metres = option(1.0, "distance of the nodes that hold what the network learns of places [m]")
    features: Annotated[int, Ge(1), Le(256)] = option(8, "numbers per node")
    width: Annotated[int, Ge(1), Le(1024)] = option(64, "units of each of the two layers")
    components: Annotated[int, Ge(1), Le(16)] = option(3, "components of a mixture, the background apart")
    epochs: Annotated[int, Ge(1), Le(1000)] = option(20, "passes over the training rows")
    seed: WholeFrom0 = option(0, "of the first weights, the batches and the choice of held-out persons")


@dataclass(frozen=True, kw_only=True)
class NoBuilding:
    """Of maps that are built in one way only."""


@dataclass(frozen=True, kw_only=True)
class SnippetBuilding:
    """Of snippet flow maps."""

    cell_m: Metres = option(1.0, "size of a cell [m]")
    length_s: Annotated[float, Gt(0), Le(3600)] = option(10.0, "length of what is stored [s]; forecasts may use less")
    most: Annotated[int, Ge(1), Le(100000)] = option(
        50, "snippets stored per cell and heading bin; the others are counted"
    )


@dataclass(frozen=True, kw_only=True)
class ExitBuilding:
    """Of the ways out."""

    cell_m: Metres = option(1.0, "size of a cell [m]")


# --- how forecasts are made -------------------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class RollOut:
    """Of every map of dynamics that is sampled step by step (paper Alg. 1)."""

    k: WholeFrom1 = option(5, "futures per track")
    beta: From0 = option(1.0, "width parameter of the kernel K in Eq. 2; larger: more like constant velocity")
    sampling_radius_m: Metres = option(1.0, "r_s: dynamics are looked for within this distance [m]")
    speed: Literal["constant", "kernel"] = option(
        "constant", "`constant`: the observed speed stays; `kernel`: updated like the heading, as the paper writes"
    )
    velocity: Velocity = option(
        "dataset", "`dataset`: what the dataset says, averaged as in the paper; `differences`: of positions, as vectors"
    )
    output: Literal["ranked", "geometric_median", "medoid", "modes"] = option(
        "ranked", "the result: the likeliest future, or what `episodes` has, of all futures that are still on the map"
    )
    exits: bool = option(False, "whether futures may leave by the ways out that people took")
    without_map: Literal["stop", "whole_day"] = option(
        "stop", "of maps by hours, in an hour that has none: `stop` at once, or use the map of the `whole_day`"
    )


@dataclass(frozen=True, kw_only=True)
class ConstantVelocity:
    """Of the constant velocity model."""

    velocity: Velocity = option("dataset", "as for maps that are sampled")


@dataclass(frozen=True, kw_only=True)
class Alike:
    """How similarity to a walker is measured, and how the walks of similar persons are followed."""

    heading_m: From0 = option(8.0, "weight of heading: metres of distance that equal one unit of heading")
    speed_m: From0 = option(6.0, "weight of speed: metres of distance that equal 1 m/s")
    change_m: From0 = option(2.0, "weight of change in velocity: metres of distance that equal 1 m/s")
    hour_m: From0 = option(0.0, "weight of the time of day: metres of distance that equal one hour")
    pace: Share = option(1.0, "1: walks are followed at the walker's speed, 0: at that of the person who made them")
    exclude_s: From0 = option(0.0, "leave out what was recorded within this many seconds of t0 (no contemporaries)")
    output: Literal["geometric_median", "medoid", "modes"] = option(
        "geometric_median",
        "the result: the samples' `geometric_median`, least mean error; their `medoid`, one that somebody could walk; "
        "or up to five `modes` with probabilities",
    )


@dataclass(frozen=True, kw_only=True)
class Episodes(Alike):
    """Of forecasts with an episode map."""

    persons: WholeFrom1 = option(25, "persons replayed: those still under way at each second")
    samples: Literal["persons", "pieces"] = option(
        "persons",
        "`persons`: one replay of each of the nearest persons; `pieces`: replays of the nearest pieces, several of one "
        "person if need be, to forecast everyone who is there at a moment, as `Live` does",
    )
    reach_m: Metres = option(10.0, "persons farther from the walker in this metric are not replayed [m]")


@dataclass(frozen=True, kw_only=True)
class Snippets(Alike):
    """Of forecasts with a snippet flow map."""

    k: WholeFrom1 = option(200, "particles per track")
    length_s: Annotated[float, Gt(0), Le(3600)] = option(5.0, "length of a snippet [s], at most the map's")
    most: Annotated[int, Ge(1), Le(100000)] = option(
        50, "snippets used per bin, at most the map's; 10 make a compact map"
    )
    bandwidth_m: Metres = option(
        1.2, "how similar a snippet must be to the particle that draws it: a Gaussian's SD [m]"
    )
    exits: bool = option(True, "whether a snippet whose person left takes its particle with it")


@dataclass(frozen=True, kw_only=True)
class Pooled(Snippets, Episodes):
    """Of forecasts with the walks of an episode map and snippets of the same walks together."""

    k: WholeFrom1 = option(100, "replays per track, and as many particles")


@dataclass(frozen=True, kw_only=True)
class Average:
    """Of a method that is the mean path of others."""

    of: tuple[str, ...] = option((), "names of the methods whose paths are averaged (at least two)")


@dataclass(frozen=True, kw_only=True)
class HandedIn:
    """Of a method whose forecasts come from outside (docs/your-predictor.md)."""

    folder: str = option("", "folder of the forecasts under `data_root`, or of a folder for each dataset, of its name")


@dataclass(frozen=True, kw_only=True)
class Learning:
    """Of the training of every network: what a method may choose for itself."""

    budget: str = option("demo", "which of the budgets: demo (seconds), economical (at most 20 minutes), full (paper)")
    futures: Literal["masked", "full"] = option(
        "masked", "`masked`: train on every track as far as it goes; `full`: only on those of the whole horizon"
    )
    device: Literal["auto", "cpu", "cuda"] = option("auto", "`auto`: a GPU if there is one")
    seed: WholeFrom0 = option(0, "of the first weights, the batches and the choice of held-out persons")
    epoch: Literal["best", "last"] = option(
        "best",
        "the weights that forecast are of this epoch: the `best` on the held-out persons, or the `last`; a method that "
        "inherits all else has no training of its own",
    )
    doubling: bool = option(
        False, "train anew with twice the windows as long as that is more than 3 % better on the held-out persons"
    )
    most_minutes: Positive = option(
        60.0, "of one processor core for all trainings of a network together [min]: `doubling` begins none beyond them"
    )


@dataclass(frozen=True, kw_only=True)
class Training:
    """Of every network; the budgets give them."""

    windows: WholeFrom1 = option(
        1_000_000, "futures looked at in all, at most; a pass over the tracks (an epoch) looks at one of every track"
    )
    batch_size: WholeFrom1 = option(128, "windows per step")
    learning_rate: Positive = option(0.001, "of the optimiser")
    schedule: Literal["cosine", "original"] = option(
        "cosine", "`cosine`: the rate falls to a tenth; `original`: as published"
    )
    patience: WholeFrom1 = option(1_000_000, "windows without a better validation error before training stops")
    rotate: bool = option(True, "turn scenes at random in training, as the originals do (not TUTR)")
    held_out: Literal["persons", "blocks"] = option(
        "persons",
        "whose the validation error is: some persons' of each recording (who is in two may be trained on in the "
        "other); or everyone's on the last days, or in half-hours of one day",
    )
    another_every: WholeFrom1 | None = option(None, "one more window for every so many windows in a track; null: none")


@dataclass(frozen=True, kw_only=True)
class Lstm(Training):
    """Of the LSTM and of Social LSTM."""

    hidden: WholeFrom1 = option(128, "units")
    sigma_scale: Positive = option(1.0, "factor on the standard deviations, which were chosen for steps of 0.4 s")


@dataclass(frozen=True, kw_only=True)
class Trajectronpp(Training):
    """Of Trajectron++."""

    decoder: WholeFrom1 = option(128, "units of the decoder")
    modes: WholeFrom2 = option(25, "latent values")


@dataclass(frozen=True, kw_only=True)
class Tutr(Training):
    """Of TUTR."""

    width: Width = option(128, "width of a token")
    modes: WholeFrom2 = option(50, "motion modes")


@dataclass(frozen=True, kw_only=True)
class Mid(Training):
    """Of MID."""

    context: Width = option(256, "width of the encoding")
    k: WholeFrom1 = option(5, "futures per track, whose errors are averaged")


@dataclass(frozen=True, kw_only=True)
class NeuralMap(Training):
    """Of the neural map."""

    rotate: Literal[False] = option(False, "a map knows its place: scenes that it learns are never turned")
    held_out: Literal["persons", "blocks"] = option("blocks", "as for every network")
    another_every: WholeFrom1 | None = option(10, "one more window for every so many windows in a track; null: none")
    grids: tuple[Positive, ...] = option((1.0, 2.5, 6.0), "cell sizes of the maps [m]; none: the network without a map")
    headings: WholeFrom2 = option(8, "bins of the circle")
    channels: WholeFrom1 = option(4, "numbers per cell and heading")
    width: Width = option(256, "width of a layer")
    time_of_day: bool = option(False, "whether the time of day is an input")
