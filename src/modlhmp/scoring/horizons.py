"""Which horizons can be scored."""

from collections.abc import Sequence

import numpy as np

from modlhmp.site import Site


def scored_horizons(horizons_s: Sequence[float], site: Site) -> list[float]:
    """Those of the horizons [s] that a site has: whole time steps, up to its longest."""
    steps = np.asarray(horizons_s) / site.time_step_s
    whole = np.isclose(steps, np.rint(steps)) & (steps > 0.5) & (np.asarray(horizons_s) <= site.horizon_s)
    return np.asarray(horizons_s)[whole].tolist()
