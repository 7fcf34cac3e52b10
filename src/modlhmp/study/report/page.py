"""Page report: the run as a paper, with every exhibit in its place; one file without a script that asks no network."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas as pd
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup

from modlhmp.datasets import Dataset
from modlhmp.storage import write_text
from modlhmp.study.exhibits.table_forms import tables_of
from modlhmp.study.layout import FIGURE_FORMS, TABLE_FORMS, Layout
from modlhmp.study.report import ASSETS, facts
from modlhmp.study.report.pictures import inline
from modlhmp.study.report.rule_graph import RuleGraph, grouped, picture
from modlhmp.study.summary import read_scores
from modlhmp.version import __version__

MANY = {"figure": "figures", "table": "tables", "page": "pages"}


def write(
    layout: Layout,
    datasets: Sequence[Dataset],
    path: str,
    exhibits: Sequence[Mapping[str, str]],
    recordings: Mapping[str, Any],
    methods: Sequence[Mapping[str, Any]],
    settings: Mapping[str, Any],
    graph: RuleGraph,
    rules: Mapping[str, str],
) -> None:
    """Write the page. What it says of the run is `about.about`; `rules` {rule: form} are those of exhibits.

    Exhibits' `stem`s are paths of the project's folder, and read where they lie in the layout.
    """
    scores = read_scores(layout.scores)
    reached = {one.name: facts.best(scores, one, methods) for one in datasets}
    claims = next((one["stem"] for one in exhibits if one["section"] == "claims"), None)
    told = pd.read_csv(f"{layout.here(claims)}.csv", dtype=str, keep_default_na=False) if claims else None
    drawn = grouped(graph, lambda rule: MANY[rules[rule]] if rule in rules else rule)
    text = _template().render(
        run=layout.run,
        version=__version__,
        demo=any(one.demo for one in datasets),
        datasets=datasets,
        recordings=recordings,
        cleaned={one.name: facts.cleaning(layout, one, recordings[one.name]["names"]) for one in datasets},
        methods=methods,
        settings=settings,
        reached=reached,
        verdicts={} if told is None else facts.verdicts(told),
        limits={one.name: facts.limits(one, recordings[one.name], reached[one.name], settings) for one in datasets},
        sections=_numbered(layout, exhibits),
        graph=Markup(picture(drawn, "Which rule of the run needs which")),
        rules=len(graph.needs),
        jobs=sum(graph.jobs.values()),
    )
    write_text(path, text)


def _template():
    # What datasets and configurations say is text; only what is marked is HTML.
    made = Environment(
        loader=FileSystemLoader(ASSETS),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    made.filters["count"] = facts.count
    made.globals["style"] = Markup((ASSETS / "report.css").read_text(encoding="utf-8"))
    return made.get_template("report.html.jinja")


def _numbered(layout, exhibits):
    """The exhibits by section, in order, each with what the page shows: {section: [exhibit]}."""
    found: dict[str, list[dict[str, Any]]] = {}
    numbers: dict[str, int] = {}
    for one in exhibits:
        numbers[one["form"]] = numbers.get(one["form"], 0) + 1
        found.setdefault(one["section"], []).append(
            {**one, **_content(one, layout.here(one["stem"])), "number": numbers[one["form"]]}
        )
    return found


def _content(one, stem):
    """What is shown of an exhibit whose files are `stem` and suffixes, and the files that lie beside the page."""
    name = Path(stem).name
    if one["form"] == "figure":
        return {"picture": inline(f"{stem}.png"), "files": [f"{name}.{suffix}" for suffix in FIGURE_FORMS]}
    if one["form"] == "table":
        return {
            "tables": Markup(tables_of(Path(f"{stem}.html").read_text(encoding="utf-8"))),
            "files": [f"{name}.{suffix}" for suffix in TABLE_FORMS],
        }
    return {"files": [f"{name}.html"]}
