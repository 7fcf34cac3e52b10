"""What a file looks like where it is not what was declared: the option that would read it, for messages."""

import re
from collections.abc import Mapping
from typing import Any

_ISO = re.compile(r"\d{4}-\d\d-\d\d[T ]\d\d:\d\d")
_DECIMAL_COMMA = re.compile(r"[+-]?\d+,\d+")


def hint(block: bytes, layout: Mapping[str, Any]) -> str:
    """What the first lines of a file look like, and the option to set; empty where nothing is known."""
    lines = [line.strip() for line in block[:4096].decode("utf-8", "replace").splitlines()]
    lines = [line for line in lines if line]
    if not lines:
        return ""
    first, separator = lines[0], layout.get("separator", ",")
    if first.startswith("{"):
        return "looks like JSON lines: use `reader: trajnet`"
    if first.startswith(("#", "%")):
        return f"begins with comments: use `reader: text`, or `comment: {first[0]!r}`"
    if separator is not None and separator not in first:
        other = next((one for one in (";", "\t", ",", "|") if one in first), None)
        if other:
            return f"has columns separated by {other!r}: set `separator: {other!r}`"
        if " " in first:
            return "has columns separated by blanks: use `reader: text`"
    if separator is not None and not layout.get("skip_lines"):
        widths = [line.count(separator) for line in lines]
        begins = next((n for n, width in enumerate(widths) if width >= 2 and width == max(widths)), 0)
        if begins:
            before = block.decode("utf-8", "replace").splitlines()
            number = next(n for n, line in enumerate(before) if line.strip() == lines[begins])
            return f"has {number} lines before its table: set `skip_lines: {number}`"
    fields = [field.strip(' "') for line in lines[1:4] for field in line.split(separator)]
    if any(_ISO.match(field) for field in fields) and layout.get("units", {}).get("time") != "iso":
        return "has times such as 2026-03-02T09:00: set `units: {time: iso}`"
    if separator != "," and layout.get("decimal", ".") != "," and any(map(_DECIMAL_COMMA.fullmatch, fields)):
        return 'has numbers such as 1,25: set `decimal: ","`'
    return ""
