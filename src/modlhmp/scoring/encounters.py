"""How often a forecast runs into other people where they really were: collisions with others' true paths.

The measure of P. Kothari, S. Kreiss, A. Alahi, Human trajectory forecasting in crowds, IEEE T-ITS 2022 ("Col-II"): two
persons of 0.1 m radius touch. People's own paths do so now and then, so their rate stands beside it.
"""

from collections.abc import Iterable

import numpy as np

from modlhmp.forecasting.base import Forecast
from modlhmp.forecasting.windows import in_order, windows
from modlhmp.kernels import kernel
from modlhmp.scenes import Scenes
from modlhmp.scoring.errors import truth_of
from modlhmp.scoring.protocols import score
from modlhmp.site import Site
from modlhmp.tracks import Tracks, gap_limit

TOUCH_M = 0.2


def encounters(
    tracks: Tracks,
    forecasts: Iterable[tuple[int, np.ndarray, Forecast]],
    everyone: Tracks,
    site: Site,
    scenes: Scenes | None = None,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Whether each forecast of a recording has touched somebody by each step, complete protocol.

    `forecasts` as of `files.read_forecasts`; `everyone` is all who were there, the recording's own tracks first, with
    ids of their own (`tracks.together`). Returns ([seeds, n, T] shares of the method's result, [n, T] whether the
    person's own path has, steps of truth [n]); NaN beyond the truth.
    """
    wanted = windows(tracks, site, scenes)
    truth, length = truth_of(tracks, wanted, site)
    t0, own = wanted.t0, everyone.track_id[wanted.row]
    order = np.argsort(everyone.t, kind="stable")
    others = (everyone.t[order], order, *everyone[:4], site.time_step_s, gap_limit(site.time_step_s))
    known = np.arange(1, site.steps + 1) <= length[:, None]
    own_meets = np.where(known, touches(truth[:, None], t0, own, *others)[:, 0], np.nan)
    by_seed: dict[int, list[np.ndarray]] = {}
    for seed, mine, forecast in in_order(forecasts, wanted):
        result = forecast.results
        met = touches(result.xy.astype(np.float64), t0[mine], own[mine], *others)
        found = score(result, truth[mine], {"paper": length[mine], "complete": length[mine]}, met)
        main = found[forecast.output, "complete"]
        by_seed.setdefault(seed, []).append(main["infeasible"])
    shares = [np.concatenate(some) for some in by_seed.values()] or [np.empty((0, site.steps))]
    return np.stack(shares), own_meets, length


@kernel
def touches(xy, t0, own, t_sorted, order, track_id, t, x, y, step_s, gap_s):
    """Whether futures `xy` [n, k, T, 2] of walkers `own` [n] have been `TOUCH_M` from somebody by each step, [n, k, T].

    `t0` [n] s; the rest are everyone's rows, `order` [m] those by time, `t_sorted` [m]. Others are interpolated between
    two rows of a track that are at most `gap_s` apart.
    """
    n, k, steps, _ = xy.shape
    met = np.zeros((n, k, steps), np.bool_)
    for i in range(n):
        for step in range(steps):
            if step:
                met[i, :, step] = met[i, :, step - 1]
            now = t0[i] + (step + 1) * step_s
            last = np.searchsorted(t_sorted, now, side="right")
            for place in range(np.searchsorted(t_sorted, now - gap_s), last):
                row = order[place]
                after = row + 1
                if track_id[row] == own[i] or after == len(t) or track_id[after] != track_id[row]:
                    continue
                if t[after] <= now or t[after] - t[row] > gap_s:
                    continue
                part = (now - t[row]) / (t[after] - t[row])
                other_x, other_y = x[row] + part * (x[after] - x[row]), y[row] + part * (y[after] - y[row])
                for j in range(k):
                    if (xy[i, j, step, 0] - other_x) ** 2 + (xy[i, j, step, 1] - other_y) ** 2 < TOUCH_M**2:
                        met[i, j, step] = True
    return met
