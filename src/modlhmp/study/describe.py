"""What is generated from settings and records: JSON schemas for editors, the tables of options and of exhibits.

`make settings` writes them anew; a test fails when they are stale.
"""

import ast
import dataclasses
import json
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import typer

from modlhmp import datasets, file_format, kinds, options, site
from modlhmp.cleaning import RULE_EXAMPLES, RULE_NEEDS, RULES
from modlhmp.cli import app
from modlhmp.exchange.forms import FORMS
from modlhmp.maps.columns import METADATA, TABLES
from modlhmp.plausibility import CHECKS
from modlhmp.settings import fields_of, json_schema
from modlhmp.storage import write_text
from modlhmp.study import lacks, settings
from modlhmp.study.exhibits import EXHIBITS
from modlhmp.yaml_file import read_yaml

ROOT = Path(__file__).parents[3]
LONG = 50  # characters of a value; a longer one is not repeated in a table
SCHEMAS = Path(__file__).parents[1] / "schemas"
READMES = (
    ROOT / "config/README.md",
    ROOT / "paper_figures/README.md",
    *(ROOT / "docs" / f"{name}.md" for name in ("command-line", "maps", "method", "protocols", "start")),
)
_PLACE = re.compile(r"(\[`([\w.]+)`\]\()(\.\./[\w/.-]+\.py)#L\d+\)")
_LEARNING = "A method may also choose its own " + ", ".join(
    f"`{field.name}`" for field in dataclasses.fields(options.Learning)
)
SECTIONS = {
    "rollout": options.RollOut, "episodes": options.Episodes, "snippets": options.Snippets, "pooled": options.Pooled,
    "learned": settings.Networks, "ladder": settings.Ladder, "studies": settings.Studies,
    "studies.training": settings.TrainingShares, "studies.occupied": settings.OccupiedCells,
    "uncertainty": settings.Uncertainty, "likelihood": settings.Likelihood, "demo": settings.Demo,
    "explorer": settings.Explorer, "tables": settings.Tables,
}  # fmt: skip
DATASET_SECTIONS = {
    "recordings": datasets.Files, "columns": file_format.Columns, "units": file_format.Units,
    "paper_protocol": site.PaperProtocol, "paper_protocol.idle_filter": site.IdleFilter, "areas": datasets.Area,
    "sources": datasets.Source,
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
    base = read_yaml(ROOT / "config/config.yaml", "a configuration")  # that every overlay lies over
    sections = [f"#### `{name}`\n\n{table(cls, base=_section(base, name))}" for name, cls in SECTIONS.items()]
    return {
        "run": table(settings.RunSettings, base=base),
        "sections": "\n\n".join(sections),
        "kinds": "\n\n".join(["\n".join(lines), *own]),
        "maps": "\n\n".join(built),
        "dataset": table(datasets.DatasetFile, required=datasets.REQUIRED),
        "rules": rules(),
        "checks": checks(),
        "exhibits": exhibits(),
        "lacks": lacking(),
        "commands": commands(),
        "lines": ten_lines(),
        "forms": forms(),
        "columns": columns(),
        "dataset sections": "\n\n".join(f"#### `{name}`\n\n{table(cls)}" for name, cls in DATASET_SECTIONS.items()),
    }


def table(
    cls: type,
    note: str = "",
    required: tuple[str, ...] = (),
    beyond: type | None = None,
    base: Mapping[str, Any] | None = None,
) -> str:
    """The options of a settings class as a Markdown table; those that `beyond` has in the same way are left out.

    Where `base`, which a user's file lies over, has another value than the default, it stands beside it.
    """
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
        value = (base or {}).get(name)
        said = list(default) if isinstance(default, tuple) else default
        if value is not None and not isinstance(value, dict) and value != said:
            shown += "; base: " + (f"`{_yaml(value)}`" if len(_yaml(value)) < LONG else "its own")
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


def rules() -> str:
    """Every cleaning rule: how it is written, and which tracks it drops."""
    lines = ["| rule | tracks that it drops |", "|---|---|"]
    for name, rule in RULES.items():
        needs = RULE_NEEDS.get(name)
        written = f"{{{name}: {{{needs}: {RULE_EXAMPLES[needs]}}}}}" if needs else name
        lines.append(f"| `{written}` | {(rule.__doc__ or '').removeprefix('Tracks ').strip().removesuffix('.')} |")
    return "\n".join(lines)


def checks() -> str:
    """Every check of a recording: what it compares, when it stops or warns, and what answers it."""
    lines = ["| check | what it compares | stops or warns | answered by |", "|---|---|---|---|"]
    lines += [f"| `{one.name}` | {one.compares} | {one.severity} | {one.remedy} |" for one in CHECKS]
    return "\n".join(lines)


def ten_lines() -> str:
    """The README's ten lines of Python."""
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    return readme[readme.index("```python\n") :].partition("\n```\n")[0] + "\n```"


def commands() -> str:
    """Every verb of the command line with its help, as `--help` prints it."""
    parts = []
    for name, command in _verbs("modlhmp", typer.main.get_command(app)):
        context = command.make_context(name, [], resilient_parsing=True, terminal_width=100, max_content_width=100)
        parts.append(f"### {name}\n\n```text\n{command.get_help(context).rstrip()}\n```")
    return "\n\n".join(parts)


def _verbs(name: str, command: Any) -> Iterator[tuple[str, Any]]:
    """(name, command) of a group's verbs, those of its groups after them."""
    for verb, one in command.commands.items():
        yield from _verbs(f"{name} {verb}", one) if hasattr(one, "commands") else [(f"{name} {verb}", one)]


def with_lines(text: str) -> str:
    """A page whose links to functions and classes, [`maps.cliff.build`](../src/.../cliff.py#L1), have their lines.

    `ValueError` for one that is not there.
    """
    return _PLACE.sub(lambda found: f"{found[1]}{_line(found[3], found[2])})", text)


def _line(path: str, name: str) -> str:
    """`path#L12`, where the function, class or method begins whose dotted name ends `name`."""
    tree = ast.parse((ROOT / path.removeprefix("../")).read_text(encoding="utf-8"))
    found = [(len(names), line) for names, line in _defined(tree) if name.split(".")[-len(names) :] == names]
    if not found:
        raise ValueError(f"{path}: no function or class {name!r}; a page links to it")
    return f"{path}#L{max(found)[1]}"


def _defined(tree: ast.AST, within: tuple[str, ...] = ()) -> Iterator[tuple[list[str], int]]:
    """(names, line) of every function, class and method."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            yield [*within, node.name], node.lineno
            yield from _defined(node, (*within, node.name))


def made_anew(text: str) -> str:
    """The text of a README with its tables made anew."""
    text = with_lines(text)
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


def _section(base: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    """What a configuration says in a section, such as `studies.occupied`."""
    for part in name.split("."):
        base = base.get(part, {})
    return base


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
