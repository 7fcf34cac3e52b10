"""Components of a foreign CLiFF-map as its file has them, and how a row of them is refused."""

from dataclasses import dataclass

import numpy as np

from modlhmp.exchange.rows import Source
from modlhmp.storage import DataError


@dataclass
class Components:
    """Components as a file has them, one entry of each array [n] a component; those of a location stand together.

    `row` is where each stands in the file, `unit` what rows are called there; headings in rad, speeds in m/s.
    `extra` [n, m] are further numbers of the location (`intensity`).
    """

    where: str
    unit: str
    row: np.ndarray
    x: np.ndarray
    y: np.ndarray
    heading: np.ndarray
    speed: np.ndarray
    covariance: np.ndarray  # [n, 4]: heading by heading, by speed, speed by heading, by speed
    weight: np.ndarray
    extra: np.ndarray

    def take(self, kept: np.ndarray) -> "Components":
        """Those of a mask."""
        arrays = ("row", "x", "y", "heading", "speed", "covariance", "weight", "extra")
        return Components(self.where, self.unit, *(getattr(self, name)[kept] for name in arrays))

    def refuse(self, bad: np.ndarray, what: str) -> None:
        """`DataError` that names the first row that is `bad`; {x}, {y} ... in `what` are its values."""
        if not bad.any():
            return
        at = int(np.argmax(bad))
        values = {name: f"{getattr(self, name)[at]:.10g}" for name in ("x", "y", "heading", "speed", "weight")}
        raise DataError(f"{self.where}: {self.unit} {self.row[at]}: {what.format(**values)}")


def moved(x: np.ndarray, y: np.ndarray, source: Source) -> tuple[np.ndarray, np.ndarray]:
    """Positions of a file in the frame whose origin the source has in it."""
    return x - source.origin[0], y - source.origin[1]
