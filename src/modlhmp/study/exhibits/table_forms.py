"""The forms of a table: CSV, Markdown, HTML (for the report) and LaTeX booktabs, demo data labelled in each."""

import html
import re
from collections.abc import Iterable, Sequence

import pandas as pd

from modlhmp.storage import DataError, write_text
from modlhmp.study.csv_cells import csv_text
from modlhmp.version import __version__

_BEGIN, _END = "<main>", "</main>"  # of what a table's HTML form holds beside its heading
DEMO_NOTE = "Demo data (made-up people): not comparable with the paper."


def write_table(
    table: pd.DataFrame,
    stem: str,
    heading: str,
    demo: bool,
    note: str = "",
    others: Sequence[tuple[str, pd.DataFrame]] = (),
) -> None:
    """Write `table` in its four forms; `others` [(title, DataFrame)] follow it in Markdown and HTML.

    A cell that is `**` all around is bold; other asterisks are only that.
    """
    notes = [*([DEMO_NOTE] if demo else []), *([note] if note else [])]
    plain = table.map(lambda cell: _bold(cell)[1] if isinstance(cell, str) else cell)
    write_text(f"{stem}.csv", csv_text(plain))
    parts = [f"# {heading}", *notes, _markdown(table)]
    parts += [part for title, other in others for part in (f"## {title}", _markdown(other))]
    write_text(f"{stem}.md", "\n\n".join([*parts, f"<!-- modlhmp {__version__} -->"]) + "\n")
    write_text(f"{stem}.html", _html(heading, notes, [("", table), *others]))
    write_text(f"{stem}.tex", _latex(table, " ".join([heading + ".", *notes])))


def _markdown(table):
    return markdown(table.columns, table.astype(str).to_numpy().tolist())


def markdown(header: Iterable[str], rows: Iterable[Sequence[str]]) -> str:
    """A GitHub table, in which no text is taken for the end of a cell or, but for whole cells, for bold."""
    first, *others = [[_markdown_cell(cell) for cell in row] for row in [list(header), *rows]]
    return "\n".join("| " + " | ".join(line) + " |" for line in [first, ["---"] * len(first), *others])


def _markdown_cell(text):
    bold, text = _bold(text)
    text = text.replace("|", r"\|").replace("*", r"\*")
    return f"**{text}**" if bold else text


def _bold(text):
    """Whether a cell is bold, and its text without what says so."""
    found = re.fullmatch(r"\*\*(.+)\*\*", text, re.DOTALL)
    return (True, found[1]) if found else (False, text)


def _latex(table, note):
    """Booktabs of a DataFrame; **bold** becomes textbf."""
    escape = {
        "\\": r"\textbackslash{}",
        "{": r"\{",
        "}": r"\}",
        "$": r"\$",
        "^": r"\^{}",
        "~": r"\~{}",
        "&": r"\&",
        "%": r"\%",
        "_": r"\_",
        "#": r"\#",
        "Δ": r"$\Delta$",
        "β": r"$\beta$",
        "–": "--",
        "<": "$<$",
        ">": "$>$",
        "±": r"$\pm$",
    }

    def cell(text):
        bold, text = _bold(str(text))
        text = "".join(escape.get(c, c) for c in text)
        return rf"\textbf{{{text}}}" if bold else text

    body = [" & ".join(map(cell, row)) + r" \\" for row in [list(table.columns), *table.to_numpy().tolist()]]
    width = len(table.columns)
    label = [rf"\multicolumn{{{width}}}{{l}}{{\footnotesize {cell(DEMO_NOTE)}}} \\"] if DEMO_NOTE in note else []
    return "\n".join(
        [f"% {' '.join(note.split())} modlhmp {__version__}", rf"\begin{{tabular}}{{{'l' * width}}}", r"\toprule",
         body[0], r"\midrule", *body[1:], r"\bottomrule", *label, r"\end{tabular}", ""]
    )  # fmt: skip


def _html(heading, notes, tables):
    """A page of tables [(title, DataFrame)], which the report takes up (`tables_of`)."""
    style = (
        "body{font:14px sans-serif;margin:1.5em}.scroll{overflow-x:auto}table{border-collapse:collapse;margin:1em 0}"
        "caption{text-align:left;font-weight:bold;padding:.5em 0}"
        "th,td{padding:.25em .7em;text-align:left;border-bottom:1px solid #ddd}th{border-bottom:2px solid #000}"
    )

    def inner(text):
        bold, text = _bold(str(text))
        return f"<b>{html.escape(text)}</b>" if bold else html.escape(text)

    page = ["<!DOCTYPE html>", '<html lang="en">', '<meta charset="utf-8">',
            f'<meta name="generator" content="modlhmp {__version__}">',
            f"<title>{html.escape(heading)}</title>", f"<style>{style}</style>", f"<h1>{inner(heading)}</h1>",
            _BEGIN, *(f"<p>{inner(note)}</p>" for note in notes)]  # fmt: skip
    for title, table in tables:
        page += [
            f'<div class="scroll" role="region" tabindex="0" aria-label="{html.escape(title or heading)}"><table>',
            f"<caption>{inner(title)}</caption>" if title else "",
            "<thead>", _row(f'<th scope="col">{inner(name)}</th>' for name in table.columns), "</thead>", "<tbody>",
            *(_row(f"<td>{inner(value)}</td>" for value in row) for row in table.to_numpy().tolist()),
            "</tbody></table></div>",
        ]  # fmt: skip
    return "\n".join(filter(None, [*page, _END])) + "\n"


def _row(cells):
    return f"<tr>{''.join(cells)}</tr>"


def tables_of(page: str) -> str:
    """The notes and tables of a table's HTML form, without its heading; `DataError` for a page of another make."""
    begin, end = page.find(_BEGIN), page.find(_END)
    if min(begin, end) < 0:
        raise DataError(f"{page[:60]!r}...: not a table of this version; delete the file and run the workflow again")
    return page[begin + len(_BEGIN) : end].strip()
