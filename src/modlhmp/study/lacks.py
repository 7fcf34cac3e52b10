"""What a dataset cannot have in an exhibit, and why: the words that a run shows there instead."""

from typing import NamedTuple


class Lack(NamedTuple):
    """`where` says of which datasets it is, `text` is what is shown, with `{names}` of what differs."""

    where: str
    text: str

    def __str__(self) -> str:
        return self.text


NO_CLOCK = Lack("its `clock` is `unknown`", "its `clock` is unknown, so there are no maps by hours")
ESTIMATED_CLOCK = Lack("its `clock` is `estimated`", "needs recordings with a clock: hours here are estimates")
NO_MAP = Lack("a map of that hour has no location", "no map: too few training data")
NO_CELL = Lack("no cell of that hour's map has a direction", "no cell with dynamics")
NOT_HERE = Lack("that hour's map has nothing at the location", "no map here")
NO_LOCATION = Lack("no location has dynamics in any hour", "no location with dynamics")
NO_TRACK = Lack("no test track that counts lasts so long after what is observed", "no test track of {horizon:g} s")
NOT_AS_LONG = Lack("no test track lasts so long after what is observed", "no test track is as long")
NO_FORECASTS = Lack("no test track is forecast", "no {method} forecasts of {dataset}")
NO_RANKS = Lack("no compared method ranks its futures", "no method ranks its forecasts")
NO_PLAN = Lack("it has no `floor_plan`", "no floor plan")
NEEDS_PLAN = Lack("it has no `floor_plan`", "needs a floor plan")
NEEDS_LONGER = Lack("its `horizon_s` is 30 or less", "needs a horizon over 30 s")
NEEDS_NUMBER = Lack("it is not the paper's, or has under two test tracks", "needs test tracks and the paper's number")
TOO_FEW = Lack("fewer than two test tracks, persons or days are in a comparison", "too few tracks")
NOBODY = Lack("nobody is forecast at a moment of the study", "nobody was there")
ONE_HOUR = Lack("its training recordings have under two hours with 100 rows", "needs two hours of training data")
NOT_SHORT = Lack(
    "its `time_step_s` is not 0.1, or 2 s is not among its horizons (`horizon_s`, `tables.horizons_s`)",
    "needs steps of 0.1 s and a horizon of 2 s",
)
ALL = (
    NO_CLOCK, ESTIMATED_CLOCK, NO_MAP, NO_CELL, NOT_HERE, NO_LOCATION, NO_TRACK, NOT_AS_LONG, NO_FORECASTS, NO_RANKS,
    NO_PLAN, NEEDS_PLAN, NEEDS_LONGER, NEEDS_NUMBER, TOO_FEW, NOBODY, ONE_HOUR, NOT_SHORT,
)  # fmt: skip
