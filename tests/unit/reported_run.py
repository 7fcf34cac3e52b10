"""A small run of which a report can be made: a hall of made-up and a yard of recorded people, a few exhibits."""

import pandas as pd
from explored_run import HALL, METHODS, RECORDINGS, YARD, make_run

from modlhmp.storage import write_json, write_text
from modlhmp.study.exhibits import style
from modlhmp.study.exhibits.table_forms import write_table
from modlhmp.study.layout import Layout
from modlhmp.study.report import page
from modlhmp.study.report.rule_graph import RuleGraph

GRAPH = RuleGraph({"clean": [], "build": ["clean"], "table_expres": ["build", "clean"], "figure_final": ["build"]},
                  {"clean": 4, "build": 2, "table_expres": 1, "figure_final": 2})  # fmt: skip
RULES = {"table_expres": "table", "figure_final": "figure"}
ACCOUNT = {
    "rows": {"read": 100, "kept": 90, "dropped": {"zero_velocity": 10}},
    "tracks": {"read": 9, "kept": 7, "dropped": {"gap_over_5s": 2}},
}
SETTINGS = {"seeds": 5, "evaluate_on": "test", "k": 5, "beta": 1.0, "sampling_radius_m": 1.0,
            "kinds": ["tc_cliff", "snippets"], "budget": ""}  # fmt: skip
DAYS = {"days": {"train": ["2020-01-06"], "test": ["2020-01-06"]}, "names": RECORDINGS, "over": "persons",
        "shared": ["2020-01-06"]}  # fmt: skip
NOTE = "<script>no</script> & **bold**"  # a configuration may say anything


def exhibits(layout, datasets):
    """Figures of errors for each dataset, a table, and the explorer, which nothing has made.

    A job is told paths of the project's folder, wherever the files lie.
    """
    told = Layout(layout.run)
    shared = {"paper": "", "caption": f"What it shows. {NOTE}"}
    found = [
        {**shared, "section": "errors", "form": "table", "title": "results", "of": "",
         "stem": told.exhibit("tab_expres")},
        *({**shared, "section": "errors", "form": "figure", "title": "errors against horizon", "of": one.title,
           "stem": told.exhibit(f"{one.label}_final")} for one in datasets),
        {**shared, "section": "explorer", "form": "page", "title": "explorer", "of": "",
         "stem": told.exhibit("explorer")},
    ]  # fmt: skip
    for one in found:
        if one["form"] == "figure":
            fig, axes = style.figure(1, 1, style.PAGE_MM)
            axes[0, 0].plot([0, 1], [0, 1])
            style.save(fig, layout.here(one["stem"]), pd.DataFrame({"x": [0, 1]}), False)
        elif one["form"] == "table":
            table = pd.DataFrame({"method": ["**A**", "B <i>"], "ADE": ["1.00", "2.00"]})
            write_table(table, layout.here(one["stem"]), "Results", False, "A note.", [("Others", table)])
    return found


def make_report(layout, datasets=(HALL, YARD), **changes):
    """The report of such a run; returns its path and the exhibits that it was given."""
    make_run(layout, datasets)
    for dataset in datasets:
        for name in ("monday", "tuesday"):
            write_json(layout.account(dataset.name, name), ACCOUNT)
    shown = exhibits(layout, datasets)
    if changes.pop("claims", True):
        rows = [("complete", "supported"), ("complete", "not shown"), ("paper", "contradicted"), ("", "not tested")]
        told = pd.DataFrame(rows, columns=["protocol", "verdict"])
        stem = Layout(layout.run).exhibit("claims")
        write_table(told, layout.here(stem), "Claims", False)
        shown.append({"section": "claims", "form": "table", "title": "claims", "of": "", "stem": stem, "paper": "",
                      "caption": "Every claim."})  # fmt: skip
    methods = [{"name": name, "title": title, "kind": name, "of": title, "published": name != "snippets", "seeds": 1}
               for name, title in METHODS.items()]  # fmt: skip
    page.write(
        layout, list(datasets), layout.report, shown, {one.name: DAYS for one in datasets}, methods,
        SETTINGS | changes, GRAPH, RULES,
    )  # fmt: skip
    write_text(f"{layout.exhibit('explorer')}.html", "<!DOCTYPE html><title>made up</title>")
    return layout.report, shown
