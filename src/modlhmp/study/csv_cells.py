"""Tables as CSV in which no cell is one that a spreadsheet would run: such a text has an apostrophe before it."""

import re
from typing import Any

import pandas as pd

_FORMULAS = ("=", "+", "-", "@", "\t", "\r", "\n", "＝", "＋", "－", "＠")
_NUMBER = re.compile(r"[-+]?[0-9]+(\.[0-9]*)?([eE][-+]?[0-9]+)?")


def csv_text(table: pd.DataFrame, **options: Any) -> str:
    """A table as CSV, in which no cell is one that a spreadsheet would run; `options` are those of `to_csv`."""
    return table.rename(columns=_inert).map(_inert).to_csv(index=False, **options)


def _inert(cell: Any) -> Any:
    """A cell, with an apostrophe before what spreadsheets take for a formula; numbers are none."""
    if not isinstance(cell, str):
        return cell
    runs = cell.startswith(_FORMULAS) and not _NUMBER.fullmatch(cell)
    text = cell.replace("\r", " ")  # pandas would not quote it, and spreadsheets begin a row after it
    return f"'{text}" if runs else text


def original(cell: str) -> str:
    """A cell of such a file as it was before: without the apostrophe."""
    return cell[1:] if cell.startswith("'") and cell[1:].startswith((*_FORMULAS, " ")) else cell
