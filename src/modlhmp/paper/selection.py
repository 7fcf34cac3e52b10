"""Picking and printing rows of `results.csv`."""

from modlhmp.scoring.summary import main_output


def main_rows(results):
    """Rows of each method's main output."""
    main = results.groupby(["dataset", "method"])["output"].transform(lambda outputs: main_output(set(outputs)))
    return results[results["output"] == main]


def scored_of(row):
    """`n/eligible` of a row; n is a mean over seeds, so it may have a decimal."""
    return f"{row['n']:.1f}".removesuffix(".0") + f"/{row['eligible']:.0f}"
