"""What the report says of a run's plan, as plain data: a job is given it, and a change of it makes the page anew."""

from pathlib import Path
from typing import Any, get_args

from modlhmp.datasets import Dataset
from modlhmp.study.comparisons import LEAST_DAYS
from modlhmp.study.exhibits import EXHIBITS
from modlhmp.study.exhibits.record import Section
from modlhmp.study.plan import Plan


def about(plan: Plan) -> dict[str, Any]:
    """Its exhibits, recordings, methods and settings, for `page.write`."""
    rollout = plan.run.rollout
    return {
        "exhibits": exhibits(plan),
        "recordings": {name: recordings(dataset) for name, dataset in plan.datasets.items()},
        "methods": [_method(plan, name) for name in plan.run.compare],
        "settings": {
            "seeds": len(plan.run.seeds),
            "evaluate_on": plan.run.evaluate_on,
            "k": rollout.k,
            "beta": rollout.beta,
            "sampling_radius_m": rollout.sampling_radius_m,
            "kinds": sorted(plan.compared_kinds),
            "budget": plan.run.learned.budget if plan.trained else "",
        },
    }


def exhibits(plan: Plan) -> list[dict[str, str]]:
    """Every exhibit that the run makes, in the report's order: section, form, file without suffix, title, caption."""
    found = []
    for one in sorted(EXHIBITS, key=lambda one: get_args(Section).index(one.section)):
        if not one.made_in(plan):
            continue
        shown = {"section": one.section, "form": one.form, "title": one.title, "paper": one.paper,
                 "caption": one.caption_in(plan)}  # fmt: skip
        if not one.per_dataset:
            found.append({**shown, "stem": plan.layout.exhibit(one.name), "of": ""})
        for dataset in plan.datasets.values() if one.per_dataset else ():
            stem = plan.layout.exhibit(one.name.format(label=dataset.label))
            found.append({**shown, "stem": stem, "of": dataset.title})
    return found


def files(plan: Plan) -> list[str]:
    """All that the page is made of: the form of each exhibit that it shows, scores, and the accounts of cleaning."""
    shown = [
        file for one in EXHIBITS if one.made_in(plan) for file in one.files(plan) if file.endswith(one.suffixes[-1])
    ]
    accounts = [plan.layout.account(name, one.name) for name, of in plan.datasets.items() for one in of.recordings]
    claims = (
        [f"{plan.layout.exhibit('claims')}.csv"] if any(one["section"] == "claims" for one in exhibits(plan)) else []
    )
    return [*shown, *claims, *accounts, plan.layout.scores]


def recordings(dataset: Dataset) -> dict[str, Any]:
    """Names and days of the recordings of each split ("" for an unknown day), and whether its tests can be over days.

    `shared` are the days that are of both splits, and the files of unknown days of which parts are.
    """
    of = {split: dataset.of_split(split) for split in ("train", "test")}
    moments = {split: {one.day or one.path for one in found} for split, found in of.items()}
    return {
        "names": {split: [one.name for one in found] for split, found in of.items()},
        "days": {split: sorted({one.day for one in found}) for split, found in of.items()},
        "shared": sorted(Path(one).name for one in moments["train"] & moments["test"]),
        "over": "days" if len(set(dataset.days("test").values())) >= LEAST_DAYS else "persons",
    }


def _method(plan, name):
    kind = plan.run.kind(name)
    return {
        "name": name, "title": plan.run.title(name), "kind": kind.name, "of": kind.title,
        "published": kind.published and name == kind.name, "seeds": len(kind.seeds(plan.run.seeds)),
    }  # fmt: skip
