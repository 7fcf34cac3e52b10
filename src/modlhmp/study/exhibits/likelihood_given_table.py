"""Table tab_likelihood_given: which method knows best how a walker goes on in the next seconds? (not in the paper)."""

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd

from modlhmp.datasets import Dataset
from modlhmp.storage import read_parquet
from modlhmp.study.exhibits.likelihood_table import LN2, interval
from modlhmp.study.exhibits.table_forms import write_table
from modlhmp.study.layout import Layout
from modlhmp.study.likelihood import NO_MAP

NOTE = (
    "Mean negative log density (NLL) of the velocity of the second time step after t0, given what is observed of the "
    "walker until then; lower is better. (The first step of a roll-out is constant velocity, whatever the map says.) "
    "Samples of each method become a density by a kernel, normal in heading and in speed, mixed with what is known of "
    "nobody (speeds of the others, any heading); kernel and weight are those that suit one half of the persons best, "
    "for the other half. Gain: over that background alone, with its 95 % interval over {over}. A row of one path is a "
    "kernel around it. Not to be compared with densities by place and time only: who knows the last velocity knows "
    "most of the next. Rows of those who stand in that second do not count."
)


def draw(layout: Layout, datasets: Sequence[Dataset], stem: str, titles: Mapping[str, str], over: str) -> None:
    """One row per dataset and method; `titles` are theirs by name, `over` what intervals are over."""
    titles = {NO_MAP: "nothing of the walker", **titles}
    rows, pairs = [], []
    for dataset in datasets:
        table, paired = (
            read_parquet(layout.likelihood(dataset.name, one)).to_pandas() for one in ("given", "given_pairs")
        )
        found = [_row(dataset.title, titles, one) for one in table.itertuples()]
        if table["nll"].notna().any():
            best = found[int(np.nanargmin(table["nll"]))]
            best["NLL"] = f"**{best['NLL']}**"
        rows += found
        pairs += [
            {
                "dataset": dataset.title, "method": titles[one.map], "against": titles[one.against],
                "NLL less [nat]": interval(one.difference, one.low, one.high),
            }
            for one in paired.itertuples()
        ]  # fmt: skip
    others = [("Differences of NLL", pd.DataFrame(pairs))]
    demo = any(one.demo for one in datasets)
    write_table(pd.DataFrame(rows), stem, "Likelihood of the next velocity", demo, NOTE.format(over=over), others)


def _row(dataset, titles, one):
    """The cells of a method's row."""
    bare = one.method == NO_MAP
    kernels = [
        f"{one.heading_rad_0:g} rad, {one.speed_m_s_0:g} m/s",
        f"{one.heading_rad_1:g} rad, {one.speed_m_s_1:g} m/s",
    ]
    return {
        "dataset": dataset, "method": titles[one.method], "NLL": f"{one.nll:.3f}",
        "gain [nat]": "–" if bare else interval(one.gain, one.gain_low, one.gain_high),
        "gain [bit]": "–" if bare else f"{one.gain / LN2:.3f}",
        "kernels": "–" if bare else "; ".join(dict.fromkeys(kernels)),
        "weight": "–" if bare else "; ".join(dict.fromkeys(f"{each:g}" for each in (one.weight_0, one.weight_1))),
        "covered": "–" if bare else f"{one.covered:.2%}", "n": f"{one.n:.0f}",
    }  # fmt: skip
