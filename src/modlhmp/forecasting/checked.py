"""Another package's kind in use: it is given copies, which it may change, and the form of what it returns is checked.

The library's own kinds keep the contract by their tests, and are asked without this.
"""

from collections.abc import Iterator
from typing import Any

import numpy as np

from modlhmp.forecasting.base import OUTPUTS, RESULTS, Forecast, Forecaster
from modlhmp.forecasting.observe import Observed
from modlhmp.maps.base import Mod, Sampled, parts
from modlhmp.storage import DataError

TYPES = {  # of a `Forecast`'s arrays
    "xy": (np.float32, "float32 is stored"),
    "log_fitness": (np.floating, "floats (float32) are needed"),
    "steps_alive": (np.integer, "whole numbers (int32) are needed"),
}


def checked(ask: Forecaster, name: str) -> Forecaster:
    """The forecaster of the kind `name`, whose forecasts are a `DataError` where they break the contract."""

    def forecast(observed: Observed, steps: int, keys: np.ndarray) -> Forecast:
        found = ask(Observed(*(part.copy() for part in observed)), steps, keys.copy())
        if why := fault(found, len(keys), steps):
            raise DataError(f"kind {name}: {why}")
        return found

    return forecast


def fault(found: Any, n: int, steps: int) -> str:
    """What is wrong with the form of a forecast of n tracks (`base.Forecast`), and what is expected; "" if nothing."""
    if not isinstance(found, Forecast):
        return f"the forecast is {type(found).__name__}; return a modlhmp.forecasting.base.Forecast"
    for name, part in zip(TYPES, found[:3], strict=True):
        kind, wanted = TYPES[name]
        if not isinstance(part, np.ndarray):
            return f"{name} is {type(part).__name__}, an array of {kind.__name__} is needed"
        if not np.issubdtype(part.dtype, kind):
            return f"{name} is {part.dtype}, {wanted}"
    xy, log_fitness, lived, output = found
    if not isinstance(output, str) or output not in OUTPUTS:
        return f"output {output!r} is none of {', '.join(OUTPUTS)}"
    k = xy.shape[1] if xy.ndim == 4 else 1
    for name, part, shape in (
        ("xy", xy, (steps, 2)),
        ("log_fitness", log_fitness, (steps,)),
        ("steps_alive", lived, ()),
    ):
        if part.shape != (n, k, *shape):
            sizes = ", ".join(map(str, (n, "k", *shape)))
            return (
                f"{name} has the shape {part.shape}, [{sizes}] is needed: k futures of each of the {n} tracks asked for"
            )
    least = 1 + RESULTS.get(output, 0)
    if k < least or (output == "single" and k > 1):
        return f"output {output} of {k} futures, {'1 is' if output == 'single' else f'{least} or more are'} needed"
    if not np.isfinite(xy).all():
        return "a position is not a number; hold a future that stops at its last one"
    if not (log_fitness < np.inf).all():
        return "log_fitness is NaN or infinite; the log of a fitness is needed, which is -inf at the least"
    if not ((lived >= 0) & (lived <= steps)).all():
        return f"steps_alive runs from {lived.min()} to {lived.max()} of {steps}"
    return ""


class CheckedMap:
    """The MoD (contract: `maps.base`) of the kind `name`, whose samples are a `DataError` where they break it."""

    def __init__(self, mod: Any, name: str) -> None:
        self.mod, self.name = mod, name

    def parts(self, t: np.ndarray) -> Iterator[tuple["CheckedMap", np.ndarray]]:
        """See `maps.base`."""
        for mod, rows in parts(self.mod, t.copy()):
            yield CheckedMap(mod, self.name), rows

    @property
    def draws(self) -> int:
        """The MoD's."""
        return self.mod.draws

    def sample(
        self, x: np.ndarray, y: np.ndarray, speed: np.ndarray, heading: np.ndarray, t: np.ndarray, uniforms: np.ndarray
    ) -> Sampled:
        """See `maps.base`."""
        mod: Mod = self.mod
        given = mod.sample(x.copy(), y.copy(), speed.copy(), heading.copy(), t.copy(), uniforms.copy())
        if not isinstance(given, tuple | list) or len(given) != 4:
            raise self._error(
                f"returned {type(given).__name__}, four arrays are needed: speed, heading, log fitness, found"
            )
        sampled = [np.asarray(part) for part in given]
        for what, part in zip(("speed", "heading", "log fitness", "found"), sampled, strict=True):
            wanted, kinds = ("true or false", "bui") if what == "found" else ("numbers", "fui")
            if part.shape != x.shape or part.dtype.kind not in kinds:
                raise self._error(
                    f"{what} is {part.dtype} of the shape {part.shape}, {wanted} of the shape {x.shape} needed"
                )
        found = sampled[3].astype(bool)
        speeds, headings, fitness = (np.ascontiguousarray(part, np.float64) for part in sampled[:3])
        if not np.isfinite(headings[found]).all():
            raise self._error("the heading is not a number where it found dynamics")
        if not (fitness[found] < np.inf).all():
            raise self._error("the log fitness is not a number where it found dynamics")
        return speeds, headings, fitness, found

    def _error(self, why: str) -> DataError:
        return DataError(f"kind {self.name}: sample: {why}")
