"""A hall and a yard with people who walk along x, for tests of figures."""

import dataclasses

import numpy as np

from modlhmp.datasets import Dataset
from modlhmp.tracks import Tracks

HALL = Dataset(name="hall", title="Hall", label="atc", reader="atc", time_step_s=2.0, horizon_s=12.0, demo=True)
YARD = dataclasses.replace(HALL, name="yard", title="Yard", label="yard", horizon_s=4.0, demo=False)
METHODS = {"episodes": "Episodes", "snippets": "Snippets"}
STEPS = 6


def walkers(rows, number=5, steps_m=2.0):
    """People who walk along x, a row each 2 s; person n walks at y = n."""
    ids = np.repeat(np.arange(1, number + 1), rows)
    x, t = np.tile(steps_m * np.arange(rows), number), np.tile(1.9e9 + 2.0 * np.arange(rows), number)
    return Tracks(ids, t, x, ids.astype(float), np.ones(len(ids)), np.zeros(len(ids)))
