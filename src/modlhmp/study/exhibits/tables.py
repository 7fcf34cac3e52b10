"""Tables tab_scenarios (parameters), tab_expres (results) and tab_ttests."""

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd

from modlhmp.datasets import Dataset
from modlhmp.scoring.errors import lengths_counted
from modlhmp.scoring.protocols import PROTOCOLS
from modlhmp.site import Site
from modlhmp.storage import read_parquet
from modlhmp.study import lacks
from modlhmp.study.exhibits.selection import main_rows, scored_of
from modlhmp.study.exhibits.table_forms import write_table
from modlhmp.study.exhibits.words import SEED_MEANS
from modlhmp.study.layout import Layout
from modlhmp.study.published import RESULTS, RESULTS_AT_S
from modlhmp.study.summary import read_scores
from modlhmp.tracks import read_tracks


def draw_parameters(
    layout: Layout,
    datasets: Sequence[Dataset],
    stem: str,
    recordings: Mapping[str, Sequence[str]],
    constants: Mapping[str, float],
    sampled: Mapping[str, Mapping[str, str]],
) -> None:
    """Parameters of the experiment, with the 90th percentile of the length of each dataset's test tracks.

    `recordings` are the test recordings of each dataset by its name; `constants` are `cliff_resolution_m`
    and `stef_resolution_m`, the same for all; `sampled` has `sampling_radius_m`, `beta` and `k` by dataset, as text.
    """
    lengths = {}
    for dataset in datasets:
        tracks = [read_tracks(layout.tracks(dataset.name, one)) for one in recordings[dataset.name]]
        for protocol in PROTOCOLS:
            lengths[dataset.name, protocol] = lengths_counted(tracks, dataset, protocol)
    rows = {
        "observation horizon O_s [s]": lambda d: (d.observed_rows - 1) * d.time_step_s,
        "max prediction horizon T_s [s]": lambda d: d.horizon_s,
        "prediction time step Δt [s]": lambda d: d.time_step_s,
        "CLiFF-map resolution [m]": lambda d: constants["cliff_resolution_m"],
        "STeF-map resolution [m]": lambda d: constants["stef_resolution_m"],
        "sampling radius r_s [m]": lambda d: sampled[d.name]["sampling_radius_m"],
        "kernel parameter β": lambda d: sampled[d.name]["beta"],
        "futures per track k": lambda d: sampled[d.name]["k"],
        **_rarer_rows(datasets),
        "usable test tracks": lambda d: len(lengths[d.name, "complete"]),
        "90th percentile of their length after t0 [s]": lambda d: _percentile(lengths[d.name, "complete"]),
        "test tracks that the paper protocol counts": lambda d: len(lengths[d.name, "paper"]),
        "90th percentile of theirs [s]": lambda d: _percentile(lengths[d.name, "paper"]),
    }
    table = pd.DataFrame({"parameter": list(rows)})
    for dataset in datasets:
        values = [value(dataset) for value in rows.values()]
        table[dataset.title] = [one if isinstance(one, str) else f"{one:g}".replace("nan", "–") for one in values]
    write_table(table, stem, "Parameters", any(dataset.demo for dataset in datasets))


def _rarer_rows(datasets):
    """Rows of what is the same in all of the paper, where a dataset has it otherwise."""
    rows = {}
    if any(one.observed_rows != Site.observed_rows for one in datasets):
        rows["observed rows, the last at t0"] = lambda d: d.observed_rows
    if any(one.forecast_every_s for one in datasets):
        rows["a forecast of a track every [s]"] = lambda d: d.forecast_every_s or np.nan
    return rows


def draw_results(
    layout: Layout,
    datasets: Sequence[Dataset],
    stem: str,
    methods: Mapping[str, str],
    horizons: Mapping[str, Sequence[float]],
) -> None:
    """Results table at each dataset's longest horizon: both protocols, own lengths, walls; best errors in bold.

    The Markdown and HTML files add the table `horizons` [s] of each dataset by its name; `methods` maps names to
    titles in table order.
    """
    results = main_rows(read_scores(layout.scores))
    blocks, others = [], []
    for dataset in datasets:
        rows = results[results["dataset"] == dataset.name]
        blocks.append(_longest(rows, dataset, methods))
        for protocol in ("paper", "complete"):
            table = pd.DataFrame({"method": list(methods.values())})
            for horizon in horizons[dataset.name]:
                at = _at(rows, methods, protocol, horizon)
                cells = zip(_errors(at), (_count(row) for _, row in at.iterrows()), strict=True)
                table[f"{horizon:g} s"] = [f"{errors} (n {count})" for errors, count in cells]
            others.append((f"{dataset.title}, {protocol} protocol: ADE / FDE [m]", table))
    spread = results["ade_seed_sd_m"].max()
    note = (
        f"ADE / FDE in m: {SEED_MEANS}; n: tracks scored (mean over seeds) / eligible. The columns "
        "of own lengths (a track counts at its own length, or at the horizon if it is longer) and of the share of "
        "forecasts that come 0.3 m inside a wall are under the complete protocol."
    )
    if np.isfinite(spread):
        note += f" {results['seeds'].max():.0f} seeds; the SD of the mean ADE over seeds is at most {spread:.3f} m."
        several = set(results.loc[results["seeds"] > 1, "method"])
        if single := [title for name, title in methods.items() if name not in several]:
            note += f" {', '.join(single)}: no SD over seeds, since there is one forecast of each track."
    note += _several(datasets)
    write_table(pd.concat(blocks), stem, "Results", any(dataset.demo for dataset in datasets), note, others)


def draw_ttests(layout: Layout, datasets: Sequence[Dataset], stem: str, methods: Mapping[str, str]) -> None:
    """All paired tests: is the first method's error smaller on the tracks that both scored?

    `methods` maps names to titles.
    """
    files = [layout.ttests(dataset.name) for dataset in datasets]
    tests = pd.concat([read_parquet(file).to_pandas() for file in files], ignore_index=True)
    tests = tests.assign(
        method=tests["method"].map(methods),
        against=tests["against"].map(methods),
        metric=tests["metric"].str.upper(),
        dataset=tests["dataset"].map({dataset.name: dataset.title for dataset in datasets}),
    )
    shown = tests.drop(columns=["output", "output_against"])
    for name in (
        "mean_m",
        "mean_against_m",
        "mean_difference_m",
        "ci_low_m",
        "ci_high_m",
        "effect_size",
        "t",
        "detectable_m",
    ):
        shown[name] = shown[name].map("{:.3f}".format)
    for name in ("p", "p_greater", "p_known", "p_greater_known", *(one for one in shown if one.endswith("_holm"))):
        shown[name] = shown[name].map("{:.2g}".format)
    note = (
        "H1: the error of `method` is smaller than that of `against` (`p`; `p_greater`: larger); Holm-corrected per "
        "dataset and protocol. Standard errors are over `clusters`: test days where there are five, else persons. "
        "`n_unknown` tracks could not be forecast by one of the two; `p_known` is without them, and `p_known_holm` "
        "that p corrected. `detectable_m`: the difference that such a test, uncorrected, finds in four of five tries."
    )
    note += _several(datasets)
    write_table(shown, stem, "Paired one-sided t-tests", any(dataset.demo for dataset in datasets), note)


def _several(datasets):
    """What n counts where a track is forecast several times, for notes."""
    of = {one.title: f"track every {one.forecast_every_s:g} s" for one in datasets if one.forecast_every_s}
    scenes = [one for one in datasets if one.reader == "trajnet" and not one.forecast_every_s]
    of |= {one.title: "scene of its files, where they have scenes" for one in scenes}
    rest = ", and n counts these; tests and intervals are over days or persons."
    return "".join(f" {title}: a forecast of each {what}{rest}" for title, what in of.items())


def _percentile(lengths):
    return float(np.percentile(lengths, 90)) if len(lengths) else float("nan")


def _longest(rows, dataset, methods):
    """One row per method at the dataset's longest horizon."""
    last = dataset.horizon_s
    paper, complete = (_at(rows, methods, protocol, last) for protocol in ("paper", "complete"))
    block = pd.DataFrame({"dataset": f"{dataset.title}, {last:g} s", "method": list(methods.values())})
    for name, at in (("paper protocol", paper), ("complete protocol", complete)):
        block[f"{name}: ADE / FDE"] = _errors(at)
        block[f"{name}: n"] = [_count(row) for _, row in at.iterrows()]
    block["each track at its own length: ADE / FDE"] = _errors(complete, "own_ade_m", "own_fde_m")
    block["own length: n"] = [f"{n:.0f}" if np.isfinite(n) else "not run" for n in complete["own_n"]]
    block["into walls (truth) [%]"] = [_walls(row) for _, row in complete.iterrows()]
    published = {}
    if dataset.paper_results and RESULTS_AT_S[dataset.paper_results] == last:
        published = RESULTS[dataset.paper_results]
    cells = ["{:.3f} / {:.3f}".format(*published[m]) if m in published else "–" for m in methods]
    block["the paper (another experiment)"] = cells
    return block


def _at(rows, methods, protocol, horizon):
    """Rows of a protocol and horizon in the order of `methods`, NaN for one that was not run."""
    at = rows[(rows["protocol"] == protocol) & np.isclose(rows["horizon_s"], horizon)].set_index("method")
    return at.reindex(list(methods))


def _errors(at, *names):
    """`ADE / FDE` of each row, the best of each in bold."""
    names = names or ("ade_m", "fde_m")
    shown = [at[name].map("{:.3f}".format).astype(float) for name in names]  # all that print like the best are best
    return [" / ".join(_bold(one[m], one[m] == one.min()) for one in shown) for m in at.index]


def _count(row):
    """N of eligible and the coverage."""
    if not np.isfinite(row["n"]):
        return "not run"
    return scored_of(row) + (f", {100 * row['n'] / row['eligible']:.0f} %" if row["eligible"] else "")


def _walls(row):
    """Share [%] of the forecasts that come inside a wall, and of the true paths."""
    if not np.isfinite(row["infeasible"]):
        return str(lacks.NO_PLAN) if np.isfinite(row["n"]) else "not run"
    return f"{100 * row['infeasible']:.1f} ({100 * row['truth_infeasible']:.1f})"


def _bold(value, bold):
    text = f"{value:.3f}" if np.isfinite(value) else "–"
    return f"**{text}**" if bold else text
