"""The published numbers: one small committed file that runs make, and the pages that are rendered from it.

`make results` runs the study on the real recordings, writes `docs/numbers.json` (scores, differences and tables, with
each run's command and commit beside them) and renders every template of `docs/templates` into `docs`. A number in a
template is asked for by what it is of, so one that no run makes cannot be rendered.

    python -m modlhmp.study.publish               # the numbers of all runs, and the pages
    python -m modlhmp.study.publish likelihood    # of these runs alone; the others keep theirs, and their commit
    python -m modlhmp.study.publish pages         # only the pages
"""

import json
import re
import subprocess
import sys
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from jinja2 import Environment, StrictUndefined
from snakemake.utils import update_config

from modlhmp.storage import DataError, read_parquet, write_text
from modlhmp.study.configuration import load_run
from modlhmp.study.csv_cells import original
from modlhmp.study.exhibits.selection import main_rows
from modlhmp.study.exhibits.table_forms import markdown
from modlhmp.study.layout import Layout
from modlhmp.study.summary import read_scores
from modlhmp.yaml_file import read_yaml

ROOT = Path(__file__).parents[3]
NUMBERS, TEMPLATES, PAGES = ROOT / "docs/numbers.json", ROOT / "docs/templates", ROOT / "docs"
# The runs, by name, and the configuration of each.
RUNS = {
    "demo": "",
    "real": "config/real.yaml",
    "ladder": "config/real.yaml config/lab/ladder.yaml",
    "folds": "config/real.yaml config/lab/folds.yaml",
    "networks": "config/real.yaml config/lab/networks.yaml",
    "likelihood": "config/real.yaml config/lab/likelihood.yaml",
    "likelihood_edinburgh": "config/real.yaml config/lab/likelihood.yaml config/lab/likelihood_edinburgh.yaml",
    "short": "config/real.yaml config/lab/short.yaml",
}
HORIZONS_S = (5.0, 10.0, 20.0, 30.0, 60.0)
KINDS = ("scores", "differences", "tables")
SCORE = ("ade_m", "fde_m", "ade_seed_sd_m", "n", "eligible", "infeasible", "truth_infeasible", "all_ade_m", "all_n")
DIFFERENCE = ("difference_m", "low_m", "high_m", "percent", "n", "n_unknown")
TABLES = (
    "tab_expres",
    "claims",
    "tab_models",
    "tab_uncertainty",
    "tab_encounters",
    "tab_occupied",
    "tab_likelihood",
    "tab_likelihood_given",
    "tab_short",
    "folds",
    "readings-atc",
    "readings-edin",
    "ladder-atc",
    "ladder-edin",
)
_LIST = re.compile(r"\[[^\[\]{}]*\]")


def command(run: str) -> str:
    """What makes a run."""
    if not RUNS[run]:
        return ".venv/bin/snakemake --cores 2"
    return f"MODLHMP_DATA=/path/to/recordings .venv/bin/snakemake --cores 2 --configfile {RUNS[run]}"


def titles(run: str) -> dict[str, str]:
    """The titles of a run's methods, compared ones first."""
    config: dict[str, Any] = {}
    for file in ("config/budgets.yaml", "config/config.yaml", *RUNS[run].split()):
        update_config(config, read_yaml(ROOT / file, "a configuration"))
    settings = load_run(config, ROOT / "config/datasets")
    return settings.titles(dict.fromkeys([*settings.compare, *settings.methods_run]))


def collect(runs: Iterable[str], commit: str, root: str = ".") -> dict[str, Any]:
    """The numbers of runs that have been made under `root`, as JSON data."""
    about = {run: {"commit": commit, "command": command(run), "titles": titles(run)} for run in runs}
    return {"runs": {run: about[run] | _of_run(Layout(run, root)) for run in about}}


def _of_run(layout: Layout) -> dict[str, Any]:
    """Scores, differences and tables of a run."""
    if not Path(layout.scores).exists():
        raise DataError(f"{layout.scores}: no such file; make the run first: {command(layout.run)}")
    results = main_rows(read_scores(layout.scores))
    results = results[results["horizon_s"].isin(HORIZONS_S)]
    found: dict[str, Any] = {kind: {} for kind in KINDS}
    for row in results.to_dict("records"):
        key = _key(row["dataset"], row["protocol"], row["horizon_s"], row["method"])
        found["scores"][key] = [_short(row[name]) for name in SCORE]
    for dataset in sorted(results["dataset"].unique()):
        for row in _rows(layout.ladder(dataset, "scores")):  # also of methods that are only compared in it
            key = _key(dataset, row["protocol"], row["horizon_s"], row["method"])
            found["scores"].setdefault(key, [_short(row.get(name, np.nan)) for name in SCORE])
        for row in _rows(layout.ladder(dataset, "differences")):
            key = _key(dataset, row["protocol"], row["horizon_s"], row["metric"], row["method"], row["against"])
            found["differences"][key] = [_short(row[name]) for name in DIFFERENCE]
    for name in TABLES:
        path = Path(f"{layout.exhibit(name)}.csv")
        if path.exists():
            table = pd.read_csv(path, dtype=str, keep_default_na=False).map(original)
            found["tables"][name] = {"columns": list(table.columns), "rows": table.to_numpy().tolist()}
    return found


def _rows(table: str) -> list[dict[str, Any]]:
    """Rows of a table of the ladder; none where a run has no ladder."""
    return read_parquet(table).to_pandas().to_dict("records") if Path(table).exists() else []


def render(template: str, numbers: Mapping[str, Any]) -> str:
    """A page of its template; `DataError` for a number that no run made."""
    return _filled(template, _Asked(numbers))


def asked_for(templates: Iterable[str], numbers: Mapping[str, Any]) -> dict[str, Any]:
    """The numbers that templates ask for, alone: what nobody reads is not kept."""
    asked = _Asked(numbers)
    for template in templates:
        _filled(template, asked)
    return {**numbers, "runs": {run: {**parts, **asked.found[run]} for run, parts in numbers["runs"].items()}}


def _filled(template: str, asked: "_Asked") -> str:
    page = Environment(undefined=StrictUndefined, keep_trailing_newline=True, trim_blocks=True)
    names = ("errors", "scored", "score", "walls", "less", "percent", "table", "results", "command", "commit")
    return page.from_string(template).render({name: getattr(asked, name) for name in names})


class _Asked:
    """What a template may ask for."""

    def __init__(self, numbers: Mapping[str, Any]) -> None:
        self.runs = numbers["runs"]
        self.found: dict[str, dict[str, Any]] = {run: {kind: {} for kind in KINDS} for run in self.runs}

    def _run(self, run: str) -> dict[str, Any]:
        if run not in self.runs:
            raise DataError(f"no run {run!r} among the numbers; there are {', '.join(self.runs)}")
        return self.runs[run]

    def _find(self, kind: str, run: str, *key: Any) -> Any:
        if (name := _key(*key)) not in self._run(run)[kind]:
            raise DataError(f"no number {name} among the {kind} of run {run!r}")
        return self.found[run][kind].setdefault(name, self.runs[run][kind][name])

    def score(self, what: str, *place: Any) -> float:
        """One of `SCORE` of (run, dataset, protocol, horizon, method)."""
        return self._find("scores", *place)[SCORE.index(what)]

    def errors(self, *place: Any, digits: int = 2) -> str:
        """`1.66 / 2.93` of (run, dataset, protocol, horizon, method)."""
        return " / ".join(f"{self.score(what, *place):.{digits}f}" for what in ("ade_m", "fde_m"))

    def scored(self, *place: Any) -> str:
        """`861.4 of 883`: how many tracks were scored, of those eligible."""
        n = f"{self.score('n', *place):,.1f}".removesuffix(".0")
        return f"{n} of {self.score('eligible', *place):,}"

    def walls(self, *place: Any) -> str:
        """`0.9 %`: share of the forecasts that have been inside a wall."""
        share = self.score("infeasible", *place)
        return "no plan" if share is None else f"{100 * share:.1f} %"

    def less(self, *place: Any, digits: int = 2) -> str:
        """`-0.36 m (-0.55 to -0.18)` of (run, dataset, protocol, horizon, metric, method, against)."""
        values = dict(zip(DIFFERENCE, self._find("differences", *place), strict=True))
        mean, low, high = (values[name] for name in DIFFERENCE[:3])
        interval = "no interval" if low is None else f"{low:+.{digits}f} to {high:+.{digits}f}"  # the same for everyone
        unknown = f", {values['n_unknown']} not forecast" if values["n_unknown"] else ""
        return f"{mean:+.{digits}f} m ({interval}{unknown})"

    def percent(self, *place: Any) -> str:
        """`-26 %`, as of `less`."""
        return f"{self._find('differences', *place)[DIFFERENCE.index('percent')]:+.0f} %"

    def results(self, run: str, dataset: str, protocol: str, horizons: Sequence[float], *methods: str) -> str:
        """Errors of some methods, or of all, with their SD over seeds and n, as Markdown; a column per horizon [s]."""
        shown = methods or [name for name in self.runs[run]["titles"] if self._has(run, dataset, name)]
        lines = []
        for method in shown:
            cells = [self._cell(run, dataset, protocol, horizon, method) for horizon in horizons]
            lines.append([self.runs[run]["titles"][method], *cells])
        return markdown(["method", *(f"{horizon:g} s" for horizon in horizons)], lines)

    def _has(self, run: str, dataset: str, method: str) -> bool:
        return any(key.startswith(f"{dataset}/") and key.endswith(f"/{method}") for key in self.runs[run]["scores"])

    def _cell(self, *place: Any) -> str:
        ade, fde, spread = (self.score(what, *place) for what in ("ade_m", "fde_m", "ade_seed_sd_m"))
        if ade is None:
            return f"– ({self.scored(*place)})"
        deviation = f" ±{spread:.2f}" if spread is not None else ""
        return f"{ade:.3f}{deviation} / {fde:.3f} ({self.scored(*place)})"

    def command(self, run: str) -> str:
        """What made a run."""
        return self._run(run)["command"]

    def commit(self, run: str) -> str:
        """The commit of the code that made a run."""
        return self._run(run)["commit"]

    def table(self, run: str, name: str, columns: Sequence[str] = (), **where: str) -> str:
        """A table of a run as Markdown: some of its columns, of the rows where other columns hold these cells."""
        found = self._find("tables", run, name)
        wanted = list(columns) or [one for one in found["columns"] if one not in where]
        if missing := [one for one in [*wanted, *where] if one not in found["columns"]]:
            raise DataError(f"table {name} of run {run!r} has no column {missing[0]!r}; it has {found['columns']}")
        rows = [dict(zip(found["columns"], row, strict=True)) for row in found["rows"]]
        chosen = [row for row in rows if all(row[column] == cell for column, cell in where.items())]
        if not chosen:
            raise DataError(f"table {name} of run {run!r} has no row with {where}")
        return markdown(wanted, ([row[column] for column in wanted] for row in chosen))


def templates() -> dict[Path, str]:
    """{page: its template}."""
    return {page_of(file): file.read_text(encoding="utf-8") for file in sorted(TEMPLATES.glob("*.md"))}


def page_of(template: Path) -> Path:
    """Where the page of a template lies."""
    return (ROOT if template.name == "README.md" else PAGES) / template.name


def pages(numbers: Mapping[str, Any]) -> dict[Path, str]:
    """{page: its text} of every template."""
    return {page: render(template, numbers) for page, template in templates().items()}


def _key(*parts: Any) -> str:
    return "/".join(f"{part:g}" if isinstance(part, float | int) else str(part) for part in parts)


def _short(value: float) -> float | int | None:
    """A number to six digits, None for none."""
    if pd.isna(value):
        return None
    return int(value) if float(value).is_integer() else float(f"{value:.6g}")


def _commit() -> str:
    """The commit that the runs are of; `DataError` where the code has changes that are in none."""
    asked = ["git", "status", "--porcelain", "--", "src", "config", "workflow"]
    if subprocess.run(asked, cwd=ROOT, capture_output=True, text=True, check=True).stdout.strip():
        raise DataError("src, config or workflow have changes that are not committed: commit, then make the results")
    head = ["git", "rev-parse", "--short=10", "HEAD"]
    return subprocess.run(head, cwd=ROOT, capture_output=True, text=True, check=True).stdout.strip()


def main() -> None:
    """Write the numbers of all runs, or of those that are named, or with `pages` the pages only."""
    named = sys.argv[1:]
    if unknown := [run for run in named if run not in RUNS and named != ["pages"]]:
        raise DataError(f"no published run {unknown[0]!r}; there are {', '.join(RUNS)}")
    if named != ["pages"]:
        made = collect(named or RUNS, _commit(), str(ROOT))["runs"]
        kept = json.loads(NUMBERS.read_text(encoding="utf-8"))["runs"] if named else {}
        runs = {run: {**kept, **made}[run] for run in RUNS if run in kept or run in made}
        numbers = asked_for(templates().values(), {"runs": runs})
        text = json.dumps(numbers, indent=1, ensure_ascii=False)
        write_text(NUMBERS, _LIST.sub(lambda found: " ".join(found[0].split()), text) + "\n")  # a list per line
    for page, text in pages(json.loads(NUMBERS.read_text(encoding="utf-8"))).items():
        write_text(page, text)


if __name__ == "__main__":
    try:
        main()
    except DataError as error:
        sys.exit(str(error))
