"""Tables tab_scenarios (parameters), tab_expres (results) and tab_ttests, as CSV, Markdown and LaTeX booktabs."""

import numpy as np
import pandas as pd

from modlhmp.paper.selection import main_rows, scored_of
from modlhmp.scoring.summary import scored_horizons
from modlhmp.storage import write_text

# ADE / FDE [m] of the paper's results table, and the horizons [s] that they are at.
PUBLISHED_AT = {"atc": 60, "edinburgh": 20}
PUBLISHED = {
    "atc": {
        "tc_cliff": (5.332, 11.215), "cliff": (5.557, 11.736), "stef": (6.026, 12.633),
        "trajectronpp": (11.844, 27.399), "mid": (21.124, 44.373), "tutr": (12.127, 26.739),
        "social_lstm": (12.704, 28.086), "lstm": (12.975, 28.773), "cvm": (16.191, 35.108),
    },
    "edinburgh": {
        "tc_cliff": (3.035, 5.787), "cliff": (3.094, 5.830), "stef": (3.064, 5.847),
        "trajectronpp": (3.810, 4.897), "mid": (5.621, 7.031), "tutr": (3.375, 4.432),
        "social_lstm": (3.835, 5.195), "lstm": (3.835, 5.201), "cvm": (7.919, 17.112),
    },
}  # fmt: skip
DEMO_NOTE = "Demo data (made-up people): not comparable with the paper."


def write_parameters(datasets, rollout, cliff, stef, lengths, stem):
    """Parameter table; `lengths` maps a dataset to the seconds after t0 of its usable test tracks."""
    rows = {
        "observation horizon O_s [s]": lambda d: (d["observed_rows"] - 1) * d["time_step_s"],
        "max prediction horizon T_s [s]": lambda d: d["horizon_s"],
        "prediction time step Δt [s]": lambda d: d["time_step_s"],
        "CLiFF-map resolution [m]": lambda d: cliff["resolution_m"],
        "STeF-map resolution [m]": lambda d: stef["resolution_m"],
        "sampling radius r_s [m]": lambda d: rollout["sampling_radius_m"],
        "kernel parameter β": lambda d: rollout["beta"],
        "futures a track k": lambda d: rollout["k"],
        "usable test tracks": lambda d: len(lengths[d["name"]]),
        "90th percentile of their length after t0 [s]": lambda d: (
            float(np.percentile(lengths[d["name"]], 90)) if len(lengths[d["name"]]) else float("nan")
        ),
    }
    table = pd.DataFrame({"parameter": list(rows)})
    for dataset in datasets:
        table[dataset["title"]] = [f"{value(dataset):g}" for value in rows.values()]
    _write(table, stem, "Parameters", any(d["demo"] for d in datasets))


def write_results(results, datasets, methods, horizons, stem):
    """Results table: ADE/FDE of every method at each dataset's longest horizon, both protocols, best in bold.

    The Markdown file adds all table horizons; `methods` maps names to titles in table order.
    """
    results = main_rows(results)
    main = pd.DataFrame({"method": list(methods.values())})
    for dataset in datasets:
        rows = results[results["dataset"] == dataset["name"]]
        for protocol in ("paper", "complete"):
            head = f"{dataset['title']}, {dataset['horizon_s']:g} s, {protocol} protocol"
            main = main.join(_cells(rows, methods, protocol, dataset["horizon_s"], head))
        if dataset["paper_results"] and PUBLISHED_AT[dataset["paper_results"]] == dataset["horizon_s"]:
            published = PUBLISHED[dataset["paper_results"]]
            cells = ["{:.3f} / {:.3f}".format(*published[m]) if m in published else "–" for m in methods]
            main[f"the paper, {dataset['horizon_s']:g} s (another experiment, see docs/results.md)"] = cells
    demo = any(d["demo"] for d in datasets)
    _write(main, stem, "ADE / FDE [m] (n scored / eligible)", demo)
    text = ["", "## Every table horizon", ""]
    for dataset in datasets:
        rows = results[results["dataset"] == dataset["name"]]
        for protocol in ("paper", "complete"):
            table = pd.DataFrame({"method": list(methods.values())})
            for horizon in scored_horizons(horizons, dataset):
                table = table.join(_cells(rows, methods, protocol, horizon, f"{horizon:g} s"))
            text += [f"{dataset['title']}, {protocol} protocol", "", _markdown(table), ""]
    with open(f"{stem}.md", "a", encoding="utf-8") as file:
        file.write("\n".join(text))


def write_ttests(tests, datasets, methods, stem):
    """All paired tests: is the first method's error smaller on the tracks that both scored?"""
    tests = tests.assign(
        method=tests["method"].map(methods),
        against=tests["against"].map(methods),
        metric=tests["metric"].str.upper(),
        dataset=tests["dataset"].map({d["name"]: d["title"] for d in datasets}),
    )
    shown = tests.drop(columns=["output", "output_against"])
    for name in ("mean_difference_m", "ci_low_m", "ci_high_m", "effect_size", "t"):
        shown[name] = shown[name].map("{:.3f}".format)
    for name in ("p", "p_holm"):
        shown[name] = shown[name].map("{:.2g}".format)
    _write(shown, stem, "Paired one-sided t-tests (H1: method < against), Holm-corrected per dataset and protocol",
           any(d["demo"] for d in datasets))  # fmt: skip


def _cells(rows, methods, protocol, horizon, head):
    """Columns `head` (ADE / FDE) and its n, the best of each in bold."""
    at = rows[(rows["protocol"] == protocol) & np.isclose(rows["horizon_s"], horizon)].set_index("method")
    at = at.reindex(list(methods))
    best = [at[name].idxmin() if at[name].notna().any() else None for name in ("ade_m", "fde_m")]
    errors = [
        " / ".join(_bold(at.loc[m, name], m == b) for name, b in zip(("ade_m", "fde_m"), best, strict=True))
        for m in methods
    ]
    counts = [_count(at.loc[m]) for m in methods]
    return pd.DataFrame({head: [f"{e} ({c})" for e, c in zip(errors, counts, strict=True)]})


def _count(row):
    """N of eligible and the coverage."""
    if not np.isfinite(row["n"]):
        return "not run"
    share = f", {100 * row['n'] / row['eligible']:.0f} %" if row["eligible"] else ""
    return f"n {scored_of(row)}{share}"


def _bold(value, bold):
    text = f"{value:.3f}" if np.isfinite(value) else "–"
    return f"**{text}**" if bold else text


def _markdown(table):
    """A GitHub table of a DataFrame."""
    lines = [list(table.columns), ["---"] * len(table.columns), *table.astype(str).to_numpy().tolist()]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def _latex(table, note):
    """Booktabs of a DataFrame; **bold** becomes textbf."""
    escape = {"&": r"\&", "%": r"\%", "_": r"\_", "#": r"\#", "Δ": r"$\Delta$", "β": r"$\beta$", "–": "--"}

    def cell(text):
        parts = "".join(escape.get(c, c) for c in str(text)).split("**")
        return "".join(rf"\textbf{{{part}}}" if i % 2 else part for i, part in enumerate(parts))

    body = [" & ".join(map(cell, row)) + r" \\" for row in [list(table.columns), *table.to_numpy().tolist()]]
    return "\n".join(
        [f"% {note}", rf"\begin{{tabular}}{{{'l' * len(table.columns)}}}", r"\toprule",
         body[0], r"\midrule", *body[1:], r"\bottomrule", r"\end{tabular}", ""]
    )  # fmt: skip


def _write(table, stem, title, demo):
    note = DEMO_NOTE if demo else ""
    plain = table.map(lambda cell: cell.replace("**", "") if isinstance(cell, str) else cell)
    write_text(f"{stem}.csv", plain.to_csv(index=False))
    write_text(f"{stem}.md", "\n\n".join(filter(None, [f"# {title}", note, _markdown(table)])) + "\n")
    write_text(f"{stem}.tex", _latex(table, f"{title}. {note}"))
