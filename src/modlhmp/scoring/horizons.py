"""At which horizons forecasts are scored, where tables, tests and figures show some of them."""

from collections.abc import Sequence

import numpy as np

from modlhmp.site import Site

TABLES_S = (5, 10, 20, 30, 60)  # those of the paper and between
LADDER_S = (5, 10, 20, 60)
FEWEST = 3  # of the usual horizons; where a dataset has fewer, it gets quarters of its longest


def scored_horizons(horizons_s: Sequence[float] | None, site: Site, usual_s: Sequence[float] = TABLES_S) -> list[float]:
    """Those of the horizons [s] that a site has: whole time steps, up to its longest. Empty where it has none.

    Where nobody chose any (`None`): the `usual_s` that the site has, and its longest; or, where these are fewer than
    `FEWEST`, the quarters of its longest, as whole time steps: 1.2, 2.4, 3.6, 4.8 s of twelve steps of 0.4 s.
    """
    asked = np.asarray(usual_s if horizons_s is None else horizons_s)
    steps = asked / site.time_step_s
    whole = np.isclose(steps, np.rint(steps)) & (steps > 0.5) & (asked <= site.horizon_s + 1e-9)
    found = asked[whole].tolist()
    if horizons_s is not None:
        return found
    found = [one for one in found if one < site.horizon_s - 1e-9] + [site.horizon_s]
    if len(found) >= FEWEST:
        return found
    quarters = sorted({max(round(site.steps * part / 4), 1) for part in (1, 2, 3)} - {site.steps})
    return [*(round(step * site.time_step_s, 9) for step in quarters), site.horizon_s]
