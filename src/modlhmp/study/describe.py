"""What is generated from settings and records: JSON schemas for editors, the tables of options and of exhibits.

`make settings` writes them anew; a test fails when they are stale.
"""

import dataclasses
import json
import re
from pathlib import Path
from typing import Any

from modlhmp import datasets, file_format, kinds, options, site
from modlhmp.exchange.forms import FORMS
from modlhmp.maps.columns import METADATA, TABLES
from modlhmp.plausibility import CHECKS
from modlhmp.settings import fields_of, json_schema
from modlhmp.storage import write_text
from modlhmp.study import lacks, settings
from modlhmp.study.exhibits import EXHIBITS

ROOT = Path(__file__).parents[3]
SCHEMAS = Path(__file__).parents[1] / "schemas"
READMES = tuple(ROOT / name for name in ("config/README.md", "docs/code.md", "docs/maps.md", "paper_figures/README.md"))
# What the paper calls it, our file, and the text by which its line is found there.
PLACES = (
    ("Sec. III-A, observed velocity", "forecasting/observe.py", "def current_velocity"),
    ("Alg. 1, MoD-LHMP", "forecasting/rollout.py", "def roll_out"),
    ("Alg. 1 line 6, Eq. 1: the next position", "forecasting/rollout.py", "# Eq. 1"),
    ("Alg. 1 line 7: what any map offers", "maps/base.py", "def sample"),
    ("Alg. 1 line 8, Eq. 2: K and β", "forecasting/rollout.py", "# Eq. 2"),
    ("Alg. 2, sampling from CLiFF", "maps/cliff.py", "def _sample"),
    ("Alg. 2, which SWGMM: the largest p within r_s", "maps/cliff.py", "def _locate("),
    ("Alg. 3, sampling from STeF", "maps/stef.py", "def _sample"),
    ("Sec. III-C.1, density of a semi-wrapped Gaussian mixture", "maps/swgmm.py", "def log_density_one"),
    ("Sec. III-C.1, mean shift", "maps/mean_shift.py", "def mean_shift"),
    ("Sec. III-C.1, expectation maximisation", "maps/swgmm.py", "def _em"),
    ("Sec. III-C.2, time-conditioned CLiFF-map", "maps/tc_cliff.py", "def build_hours"),
    ("Sec. III-C.3, STeF: counts by direction and interval", "maps/stef.py", "def _signals"),
    ("Sec. III-C.3, FreMEn", "maps/fremen.py", "def analyse"),
    ("Sec. III-D, ranking", "forecasting/ranking.py", "def most_likely"),
    ("Sec. IV-B, which tracks are usable", "tracks.py", "def usable_tracks"),
    ("Sec. IV-C, what a network offers", "networks/network.py", "class Base"),
    ("Sec. IV-C, training of every network", "networks/training.py", "def train("),
    ("Sec. IV-D, ADE and FDE", "scoring/errors.py", "def displacement_errors"),
    ("both protocols", "scoring/protocols.py", "def score("),
    ("paper protocol: idle tracks", "scoring/errors.py", "def is_idle"),
    ("complete protocol: the longest-lived are ranked", "forecasting/ranking.py", "def longest_lived"),
    ("which seconds of truth count", "scoring/errors.py", "def ground_truth"),
    ("paired one-sided t-tests", "scoring/ttests.py", "def paired_test"),
    ("Holm's correction", "scoring/ttests.py", "def holm"),
)
_LEARNING = "A method may also choose its own " + ", ".join(
    f"`{field.name}`" for field in dataclasses.fields(options.Learning)
)
SECTIONS = {
    "rollout": options.RollOut, "episodes": options.Episodes, "snippets": options.Snippets, "pooled": options.Pooled,
    "learned": settings.Networks, "ladder": settings.Ladder, "studies": settings.Studies,
    "studies.training": settings.TrainingShares, "uncertainty": settings.Uncertainty,
    "likelihood": settings.Likelihood, "demo": settings.Demo, "explorer": settings.Explorer, "tables": settings.Tables,
}  # fmt: skip
DATASET_SECTIONS = {
    "recordings": datasets.Files, "columns": file_format.Columns, "units": file_format.Units,
    "paper_protocol.idle_filter": site.IdleFilter, "areas": datasets.Area, "sources": datasets.Source,
}  # fmt: skip


def schemas() -> dict[str, dict[str, Any]]:
    """{file name: JSON schema} of the configuration and of a dataset file."""
    run = json_schema(settings.RunSettings)
    by_kind = []
    for kind in kinds.BUILT_IN:
        if not kind.is_method:
            continue
        chosen = [kind.options, *([options.Learning] if kind.learned else [])]
        parts = [json_schema(cls)["properties"] for cls in chosen]
        allowed = {
            "properties": {name: one for part in parts for name, one in part.items()},
            "additionalProperties": False,
        }
        of_kind = {"properties": {"kind": {"const": kind.name}}, "required": ["kind"]}
        by_kind.append({"if": of_kind, "then": {"properties": {"options": {"type": "object", **allowed}}}})
    run["$defs"]["MethodEntry"]["allOf"] = by_kind
    # An overlay says only what differs.
    run.pop("required", None)
    dataset = json_schema(datasets.DatasetFile)
    dataset["required"] = list(datasets.REQUIRED)
    return {"config.schema.json": run, "dataset.schema.json": dataset}


def tables() -> dict[str, str]:
    """{name of the place in a README: Markdown} of every table."""
    shown = [kind for kind in kinds.BUILT_IN if kind.is_method]
    lines = [
        "| kind | method | options |",
        "|---|---|---|",
        *(f"| `{k.name}` | {k.title} | {_options(k)} |" for k in shown),
    ]
    own = [f"#### `{kind.name}`\n\n{table(kind.options)}" for kind in shown if not (kind.section or kind.learned)]
    own += [f"#### Every network\n\n{table(options.Training, _LEARNING)}"]
    own += [f"#### `{kind.name}`\n\n{table(kind.options, beyond=options.Training)}" for kind in shown if kind.learned]
    built = [
        f"#### `maps.{kind.name}`\n\n{table(kind.building)}"
        for kind in kinds.BUILT_IN
        if kind.building is not None and not kind.built_like and dataclasses.fields(kind.building)
    ]
    return {
        "run": table(settings.RunSettings),
        "sections": "\n\n".join(f"#### `{name}`\n\n{table(cls)}" for name, cls in SECTIONS.items()),
        "kinds": "\n\n".join(["\n".join(lines), *own]),
        "maps": "\n\n".join(built),
        "dataset": table(datasets.DatasetFile, required=datasets.REQUIRED),
        "checks": checks(),
        "exhibits": exhibits(),
        "lacks": lacking(),
        "equations": places(),
        "forms": forms(),
        "columns": columns(),
        "dataset sections": "\n\n".join(f"#### `{name}`\n\n{table(cls)}" for name, cls in DATASET_SECTIONS.items()),
    }


def table(cls: type, note: str = "", required: tuple[str, ...] = (), beyond: type | None = None) -> str:
    """The options of a settings class as a Markdown table; those that `beyond` has in the same way are left out."""
    lines = ["| key | what | default | meaning |", "|---|---|---|---|"]
    known = fields_of(beyond) if beyond else []
    for row in fields_of(cls):
        name, of, default, meaning = row
        if row in known:
            continue
        if default is dataclasses.MISSING or name in required:
            shown = "required"
        else:
            shown = "see below" if dataclasses.is_dataclass(default) else f"`{_yaml(default)}`"
        lines.append(f"| `{name}` | {of} | {shown} | {meaning} |")
    return "\n".join([*lines, *(["", note] if note else [])])


def forms() -> str:
    """Every form of maps: its kinds, what it carries and loses, who reads it, and its options with their meanings."""
    lines = ["| form | kinds | carries | loses | read by | options |", "|---|---|---|---|---|---|"]
    lines.append("| `parquet`: ours | every kind | everything | nothing | this library; any reader of Parquet | |")
    meanings: dict[str, str] = {}
    for one in FORMS:
        told = [(name, meaning) for cls in (one.reading, one.writing) for name, _, _, meaning in fields_of(cls)]
        meanings |= {name: meanings.get(name, meaning) for name, meaning in told}
        of, named = (", ".join(f"`{text}`" for text in texts) for texts in (one.kinds, [name for name, _ in told]))
        lines.append(f"| `{one.name}`: {one.title} | {of} | {one.carries} | {one.loses} | {one.read_by} | {named} |")
    return "\n".join([*lines, "", *(f"* `{name}`: {meaning}" for name, meaning in meanings.items())])


def columns() -> str:
    """Every column of every map's tables, with its unit; and what their metadata hold."""
    parts = []
    for title, of in TABLES.items():
        rows = [f"| `{name}` | {unit} | {meaning} |" for name, (unit, meaning) in of.items()]
        parts.append("\n".join([f"**{title}**\n", "| column | unit | what |", "|---|---|---|", *rows]))
    rows = [f"| `{name}` | {meaning} |" for name, meaning in METADATA.items()]
    parts.append("\n".join(["**Metadata of the file**\n", "| key | what |", "|---|---|", *rows]))
    return "\n\n".join(parts)


def exhibits() -> str:
    """Every exhibit: its file, what it shows, its label in the paper, its rule and module."""
    lines = ["| file | what | the paper's label | rule | module |", "|---|---|---|---|---|"]
    for one in EXHIBITS:
        name, paper = one.name.replace("{label}", "<label>"), one.paper or "not in the paper"
        lines.append(f"| `{name}` | {one.title} | {paper} | `{one.rule}` | `{one.module}` |")
    return "\n".join(lines)


def lacking() -> str:
    """What a dataset cannot have: where, what a run shows there, and in which exhibits."""
    lines = ["| where | the run shows | exhibits |", "|---|---|---|"]
    for lack in lacks.ALL:
        names = [f"`{one.name}`".replace("{label}", "<label>") for one in EXHIBITS if lack in one.lacks]
        shown = re.sub(r"\{.*?\}", "...", lack.text)
        lines.append(f"| {lack.where} | {shown} | {', '.join(names)} |")
    return "\n".join(lines)


def checks() -> str:
    """Every check of a recording: what it compares, when it stops or warns, and what answers it."""
    lines = ["| check | what it compares | stops or warns | answered by |", "|---|---|---|---|"]
    lines += [f"| `{one.name}` | {one.compares} | {one.severity} | {one.remedy} |" for one in CHECKS]
    return "\n".join(lines)


def places() -> str:
    """Where each equation, algorithm and rule stands, with its line."""
    lines = ["| the paper | code |", "|---|---|"]
    for what, name, text in PLACES:
        path = Path("src/modlhmp", name)
        numbers = [
            n for n, line in enumerate((ROOT / path).read_text(encoding="utf-8").splitlines(), 1) if text in line
        ]
        if not numbers:
            raise ValueError(f"{path}: no line with {text!r}, which is {what}")
        called = text.removeprefix("def ").removeprefix("class ").removeprefix("# ").rstrip("(")
        lines.append(f"| {what} | [`{name}`, `{called}`](../{path.as_posix()}#L{numbers[0]}) |")
    return "\n".join(lines)


def made_anew(text: str) -> str:
    """The text of a README with its tables made anew."""
    for name, made in tables().items():
        place = rf"(<!-- {name}: made by `make settings` -->\n).*?(<!-- end of {name} -->)"
        text = re.sub(place, rf"\g<1>{_literal(made)}\n\g<2>", text, flags=re.DOTALL)
    return text


def _literal(text: str) -> str:
    """Text to put in by `re.sub` as it is."""
    return text.replace("\\", r"\\")


def _options(kind: kinds.Kind) -> str:
    """Where a kind's options are listed."""
    if kind.learned:
        return "those of every network, and its own below"
    return f"as `{kind.section}`" if kind.section else "below"


def _yaml(value: Any) -> str:
    """A default as YAML would have it."""
    return json.dumps(list(value) if isinstance(value, tuple) else value, ensure_ascii=False).strip('"')


def main() -> None:
    """Write the schemas and the tables."""
    for name, schema in schemas().items():
        write_text(SCHEMAS / name, json.dumps(schema, indent=1, ensure_ascii=False) + "\n")
    for file in READMES:
        write_text(file, made_anew(file.read_text(encoding="utf-8")))


if __name__ == "__main__":
    main()
