"""Demo data: seeded raw recordings of two made-up sites, in the true formats of ATC and Edinburgh.

What is known exactly is what was planted: the flows (`sites.planted_flows`) and every defect (`write_recording`).
"""

from datetime import date
from pathlib import Path
from typing import NamedTuple
from zlib import crc32

import numpy as np

from modlhmp.storage import atomic_path
from modlhmp.study.demo.forum import write_forum
from modlhmp.study.demo.hall import write_hall
from modlhmp.study.demo.sites import SITES


class Recording(NamedTuple):
    """One raw file of the demo; `file` is relative to the folder given to `write_all`."""

    site: str
    file: str
    day: str
    split: str


RECORDINGS = (
    Recording("hall", "hall/atc-20301002.csv", "2030-10-02", "train"),
    Recording("hall", "hall/atc-20301006.csv", "2030-10-06", "train"),
    Recording("hall", "hall/atc-20301009.csv", "2030-10-09", "test"),
    Recording("hall", "hall/atc-20301013.csv", "2030-10-13", "test"),
    Recording("forum", "forum/tracks.07Oct.txt", "2030-10-07", "train"),  # summer time
    Recording("forum", "forum/tracks.08Oct.txt", "2030-10-08", "train"),
    Recording("forum", "forum/tracks.04Nov.txt", "2030-11-04", "test"),  # winter time
    Recording("forum", "forum/tracks.05Nov.txt", "2030-11-05", "test"),
)


def write_recording(path: str | Path, site: str, day: str, seed: int, scale: float = 1.0) -> dict[str, int]:
    """Write the raw file of one day of `site` ("hall" or "forum"); its bytes depend on the arguments only.

    `day` is an ISO date, `seed` an integer >= 0, `scale` multiplies the number of people. Returns what was
    planted: {defect: tracks for names that end in _track, else rows}, each row and track under one name at
    most, plus "tracks" and "rows" of the whole file (defects included; person -1 is no track, the two people
    of other days are). `unsorted` rows are good rows in a wrong line; the other rows of a track with defect
    rows are good. Raises `ValueError` for an unknown site, a bad date or a scale that is not positive.
    """
    if site not in SITES:
        raise ValueError(f"no demo site {site!r}; there are {', '.join(SITES)}")
    if not (np.isfinite(scale) and scale > 0):
        raise ValueError(f"scale is {scale}; it must be a number above 0")
    when = date.fromisoformat(day)
    rng = np.random.default_rng(np.random.SeedSequence([seed, crc32(site.encode()), when.toordinal()]))
    write = {"hall": write_hall, "forum": write_forum}[site]
    with atomic_path(path) as temporary, open(temporary, "wb") as file:
        return write(file, rng, SITES[site], when, scale)


def write_all(folder: str | Path, seed: int, scale: float = 1.0) -> dict[str, dict[str, int]]:
    """Write all `RECORDINGS` below `folder`; returns {file: what `write_recording` returned}."""
    return {r.file: write_recording(Path(folder) / r.file, r.site, r.day, seed, scale) for r in RECORDINGS}
