"""Numbers as text, read strictly: what Python takes beyond them, such as 1_000 or other scripts' digits, is none."""

import re

from modlhmp.ids import is_missing

_NUMBER = re.compile(r"[+-]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")
ALSO = {" ": "\u00a0\u202f", "'": "\u2019"}  # marks of thousands, and what else is written for them
_SPECIAL = frozenset({"nan", "inf", "infinity"})


def number(text: str, decimal: str = ".", thousands: str = "") -> float | None:
    """The number that a text is, NaN for an empty one or a word such as NA, None for any other text.

    `decimal` is its decimal mark; `thousands`, where there is one, stands between groups of three digits.
    """
    text = text.strip(" \t\r\f\v")
    if is_missing(text):
        return float("nan")
    if text.removeprefix("+" if text[0] == "+" else "-").lower() in _SPECIAL:
        return float(text)
    for other in ALSO.get(thousands, ""):
        text = text.replace(other, thousands)
    if thousands and thousands in text:
        whole, mark, rest = text.partition(decimal)
        first, *groups = whole.lstrip("+-").split(thousands)
        if not 1 <= len(first) <= 3 or any(len(group) != 3 for group in groups):
            return None
        text = whole.replace(thousands, "") + mark + rest
    if decimal != ".":
        if "." in text:
            return None
        text = text.replace(decimal, ".")
    return float(text) if _NUMBER.fullmatch(text) else None
