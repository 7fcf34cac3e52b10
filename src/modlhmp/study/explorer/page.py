"""Page explorer: a run's maps by hour, its errors, and, where they may be shown, its people and their forecasts."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from modlhmp.datasets import Dataset
from modlhmp.floor_plan import coarser, load_floor_plan, moved
from modlhmp.pictures import ORIENTATION_COLOURS
from modlhmp.storage import write_text
from modlhmp.study.exhibits import style
from modlhmp.study.exhibits.selection import main_rows
from modlhmp.study.explorer.look import page
from modlhmp.study.explorer.pack import FORM, Digits, packed
from modlhmp.study.explorer.people import people
from modlhmp.study.explorer.places import CELL_M, LEAST_PEOPLE, places, read_crowd
from modlhmp.study.layout import Layout
from modlhmp.study.summary import read_scores
from modlhmp.version import __version__

PLAN_PIXELS = 400  # of a floor plan's shorter side, at least
SHOWN_AT_FIRST = 3  # methods, beside the run's first and constant velocity


def draw(
    layout: Layout,
    datasets: Sequence[Dataset],
    stem: str,
    methods: Mapping[str, str],
    maps: Sequence[str],
    tracks: Sequence[str],
    recordings: Mapping[str, Mapping[str, Sequence[str]]],
    look: str,
) -> None:
    """Write `stem`.html.

    `methods` maps names to titles in table order, `maps` are the kinds of maps that the run builds, `tracks` the names
    of the datasets whose people may be shown, `recordings` each one's by split. `look` is the
    `versions.assets_version` of the page's files, and there so that another look makes it anew.
    """
    del look
    tree = {
        "form": FORM,
        "run": layout.run,
        "version": __version__,
        "colours": ORIENTATION_COLOURS,
        "sets": [_dataset(layout, one, methods, maps, one.name in tracks, recordings[one.name]) for one in datasets],
    }
    write_text(f"{stem}.html", page(layout.run, packed(tree)))


def _dataset(layout, dataset, methods, maps, shown, recordings) -> dict[str, Any]:
    """All of one dataset; its people only where they may be shown."""
    files = {kind: layout.map(dataset.name, kind) for kind in maps}
    crowd = read_crowd(layout.tracks(dataset.name, name) for name in recordings["train"])
    least = 1 if shown else LEAST_PEOPLE
    return {
        "name": dataset.name,
        "title": dataset.title,
        "demo": dataset.demo,
        "flip": style.image_coordinates(dataset),
        "estimated": dataset.clock == "estimated",
        "step": dataset.time_step_s,
        "horizon": dataset.horizon_s,
        "least": least,
        "cell": CELL_M,
        "citation": dataset.citation,
        "terms": dataset.terms,
        "plan": _plan(dataset),
        **places(crowd, dataset, files, dataset.clock != "unknown", least),
        "methods": _methods(read_scores(layout.scores), dataset, methods),
        "people": people(layout, dataset, recordings["test"], methods) if shown else None,
    }


def _plan(dataset):
    """The floor plan, a wall within a coarser pixel kept; None without one."""
    if not dataset.floor_plan:
        return None
    plan = moved(load_floor_plan(dataset.floor_plan[0]), dataset.origin_m)
    cells, width = coarser(plan, PLAN_PIXELS)
    x, y = plan.origin
    return {
        "cells": cells.astype(int),
        "columns": cells.shape[1],
        "size": plan.resolution * width,
        "x": float(x),
        "y": float(y),
        "yaw": float(plan.yaw),
    }


def _methods(scores, dataset, methods):
    """Every method: name, title, look, whether it is shown at first, and its mean errors at every horizon."""
    rows = main_rows(scores[scores["dataset"] == dataset.name])
    found = []
    for position, (name, title) in enumerate(methods.items()):
        mine = rows[rows["method"] == name].sort_values("horizon_s")
        errors = {protocol: _errors(mine[mine["protocol"] == protocol]) for protocol in ("complete", "paper")}
        look = style.method_style(position)
        found.append({
            "name": name, "title": title, "colour": look["color"], "dash": _dash(look["linestyle"]), "errors": errors,
        })  # fmt: skip
    last = {one["name"]: one["errors"]["complete"]["ade"].values for one in found}
    best = sorted((name for name in last if len(last[name])), key=lambda name: last[name][-1])[:SHOWN_AT_FIRST]
    for one in found:
        one["shown"] = one["name"] in {*best, "cvm", next(iter(methods))}
    return found


def _errors(rows):
    numbers = {name: rows[f"{name}_m"].to_numpy(float) for name in ("ade", "fde")}
    return {
        "horizon": Digits(rows["horizon_s"].to_numpy(float), 0.01),
        **{name: Digits(values, 0.001) for name, values in numbers.items()},
        "n": Digits(np.asarray(rows["n"], float), 0.1),
    }


def _dash(line) -> list[float]:
    """Lengths of dashes and gaps of a line of matplotlib, in line widths."""
    named = {"-": [], "--": [3.7, 1.6], "-.": [6.4, 1.6, 1, 1.6], ":": [1, 1.65]}
    return named[line] if isinstance(line, str) else list(line[1])
