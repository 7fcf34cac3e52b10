"""STeF-map that is updated: counts by cell, direction and interval, and the sums that FreMEn needs of them.

FreMEn's periods all divide a day, so of a signal over many days it needs the sum by interval of the day and no more
(`sums`): mean and Fourier coefficients are ratios of such sums. Forgetting makes them weighted sums, merging adds them.
The counts of an interval are kept, because its shares are no sums: a late row changes the busiest direction.
"""

import numpy as np
import pyarrow as pa

from modlhmp.maps import fremen, stef
from modlhmp.maps.updated.counted import BIN_BITS, Counted, packed, unpacked
from modlhmp.maps.updated.slots import DAY_S
from modlhmp.tracks import Tracks

SPAN = 2.9  # half-lives: a window without weights of the same mean age is so long


class CountedStef(Counted):
    """A STeF-map of counts; its slots are its intervals, which divide an hour."""

    kinds = ("stef",)

    @property
    def slot_s(self) -> float:  # type: ignore[override]
        """Length of an interval [s]."""
        return self.building.interval_s

    @staticmethod
    def used(tracks: Tracks) -> np.ndarray:
        """See `Counted`: all that have a heading and are not known to stand."""
        return stef.used(tracks)

    def code(self, tracks: Tracks) -> tuple[np.ndarray, np.ndarray]:
        """See `Counted`: the cell and the direction."""
        i, j = (np.floor(axis / self.building.resolution_m).astype(np.int64) for axis in (tracks.x, tracks.y))
        return np.arange(len(i)), packed(i, j, stef.orientation_bin(tracks.heading, self.building.orientations))

    def tables(self) -> tuple[pa.Table | None, dict[int, pa.Table]]:
        """See `Counted`; equal to `stef.build_hours` of the same rows to rounding."""
        if not self.slots:
            return None, {}
        cells, signals, weights = self.sums()
        per_day, days = self.per_day, sorted({number // self.per_day for number in self.slots})
        times = (np.arange(per_day) + 0.5) * self.slot_s
        covered = (days[-1] - days[0]) * DAY_S + times[-1] - times[0]
        if self.half_life_h is not None:
            covered = min(covered, SPAN * 3600.0 * self.half_life_h)
        parts = fremen.from_sums(times, signals, weights, covered, self.building.order)
        i, j, _ = unpacked(cells << BIN_BITS)
        whole = stef.table_of(np.column_stack([i, j]), parts, self.building)
        hours = self.site.listed_hours or sorted({number % per_day * 24 // per_day for number in self.slots})
        return whole, {hour: stef.evaluate(whole, stef.middle_of_hour(hour)) for hour in hours}

    def sums(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Cells [n]; sums of each direction's shares by interval of the day [n * directions, per_day]; and of weights.

        Every interval of a day with rows counts, those without rows as 0.
        """
        numbers, per_day, directions = sorted(self.slots), self.per_day, self.building.orientations
        days = sorted({number // per_day for number in numbers})
        cells = np.unique(np.concatenate([self.slots[number].codes >> BIN_BITS for number in numbers]))
        signals, weights = np.zeros((len(cells) * directions, per_day)), np.zeros(per_day)
        of_day = np.arange(per_day)
        for day in days:
            weights += self._weight(day * per_day + of_day)
        for number in numbers:  # in the order of time, whatever the order of updates
            slot = self.slots[number]
            first = np.flatnonzero(np.diff(slot.codes >> BIN_BITS, prepend=-1))
            busiest = np.maximum.reduceat(slot.counts, first)
            share = slot.counts / np.repeat(busiest, np.diff(np.append(first, len(slot.codes))))
            row = np.searchsorted(cells, slot.codes >> BIN_BITS) * directions + unpacked(slot.codes)[2]
            signals[row, number % per_day] += share * self._weight(np.array([number]))
        return cells, signals, weights

    def _weight(self, slots):
        """What intervals count now: halved by their age."""
        return 1.0 if self.half_life_h is None else 0.5 ** (self.age_h(slots, self.newest) / self.half_life_h)
