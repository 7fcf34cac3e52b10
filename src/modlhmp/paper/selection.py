"""Picking rows of `results.csv`."""

_RANK = {"ranked": 0, "median": 1, "mean": 2, "single": 3}


def main_rows(results):
    """Rows of each method's main output: ranked where there is one, then median, mean, single."""
    rank = results["output"].map(_RANK)
    best = rank.groupby([results["dataset"], results["method"]]).transform("min")
    return results[rank == best]
