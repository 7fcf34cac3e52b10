"""The fields of a line of delimited text."""

import csv
import re


def single_blanks(block: bytes) -> bytes:
    """Lines whose fields are separated by runs of blanks and tabs, one blank between fields and none around them."""
    block = re.sub(rb"[ \t]+", b" ", block)
    return re.sub(rb"(?m)^ | (?=\r?$)", b"", block)


def fields_of(line: str, separator: str | None) -> list[str]:
    """Fields of a line, quotes and blanks around them removed; a line of unbalanced quotes is one field."""
    line = line.strip("\r\n")
    if '"' in line:
        try:
            return [field.strip() for field in next(csv.reader([line], delimiter=separator or " ", strict=True))]
        except (csv.Error, StopIteration):
            return [line]
    return [field.strip() for field in line.split(separator or " ")]
