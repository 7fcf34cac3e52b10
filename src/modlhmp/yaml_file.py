"""YAML files that people write: what is wrong in one is told with its file and line."""

import itertools
import re
from datetime import date
from pathlib import Path
from typing import Any

import yaml

from modlhmp.storage import DataError, no_folder, refused

_INT, _FLOAT = "tag:yaml.org,2002:int", "tag:yaml.org,2002:float"
# Numbers that mean to everyone what they mean to YAML 1.1, for which 012 is ten, 1:30 ninety and 1_0 ten.
_GROUPS = r"[1-9][0-9]{0,2}(_[0-9]{3})+"
_PLAIN_INT = re.compile(rf"[-+]?(0|[1-9][0-9]*|{_GROUPS})")
_PLAIN_FLOAT = re.compile(rf"[^:_]+|[-+]?{_GROUPS}\.[0-9]*([eE][-+][0-9]+)?")
_MERGE = "tag:yaml.org,2002:merge"  # <<, of which there may be several
MOST_CHARACTERS, MOST_VALUES, MOST_DEEP = 250_000, 100_000, 50


class _Loader(yaml.SafeLoader):
    """With a bound on values within values, so that whoever walks through them has one as well."""

    deep = 0

    def compose_node(self, parent: yaml.Node | None, index: Any) -> yaml.Node | None:
        """A value and what it holds."""
        self.deep += 1
        if self.deep > MOST_DEEP:
            line = self.peek_event().start_mark.line + 1
            raise DataError(
                f"{self.name}, line {line}: nested too deep: at most {MOST_DEEP} values within values are read"
            )
        node = super().compose_node(parent, index)
        self.deep -= 1
        return node


def read_yaml(path: str | Path, what: str) -> dict[str, Any]:
    """The mapping that a YAML file holds, dates as text; `DataError` where it is none, as `what` must be."""
    no_folder(path)
    try:
        with open(path, encoding="utf-8") as file:
            text = file.read(MOST_CHARACTERS + 1)
    except OSError as error:
        raise DataError(f"{path}: cannot be read ({error.strerror})") from None
    except UnicodeDecodeError as error:
        line = error.object[: error.start].count(b"\n") + 1
        raise DataError(f"{path}, line {line}: not valid YAML: not UTF-8; save the file in that encoding") from None
    if len(text) > MOST_CHARACTERS:
        raise DataError(f"{path}: more than {MOST_CHARACTERS} characters, which {what} does not need; divide it")
    try:
        # The last two: a date that does not exist.
        with refused(f"{path}: not valid YAML", yaml.reader.ReaderError, ValueError, OverflowError):
            listed = _values(path, text)
    except yaml.MarkedYAMLError as error:
        raise DataError(f"{path}{_explained(error)}") from None
    except RecursionError:
        raise DataError(f"{path}: not valid YAML: an alias (*) within what it stands for") from None
    if not isinstance(listed, dict):
        raise DataError(f"{path}: {what} is a mapping of keys, see config/README.md")
    return listed


def _values(path: str | Path, text: str) -> Any:
    """What a text of YAML stands for."""
    loader = _Loader(text)
    loader.name = str(path)
    written = loader.get_single_node()
    if (values := _values_in(written, {})) > MOST_VALUES:
        raise DataError(f"{path}: stands for {values:.3g} values, by aliases (*) of aliases; write fewer of them")
    _check_nodes(path, written, set())
    return dates_as_text(None if written is None else loader.construct_document(written))


def _values_in(node: yaml.Node | None, known: dict[int, int]) -> int:
    """How many values a node stands for, each alias counted as what it stands for; each node is looked at once."""
    if id(node) not in known:
        parts = node.value if isinstance(node, yaml.CollectionNode) else []
        parts = itertools.chain.from_iterable(parts) if isinstance(node, yaml.MappingNode) else parts
        known[id(node)] = 1 + sum(_values_in(part, known) for part in parts)
    return known[id(node)]


def _check_nodes(path: str | Path, node: yaml.Node | None, seen: set[int]) -> None:
    """Whether numbers mean what they say, and no mapping has a key twice, of which YAML would keep the last one.

    Each node is looked at once.
    """
    if isinstance(node, yaml.ScalarNode) and node.style is None:
        _check_number(path, node)
    if not isinstance(node, yaml.CollectionNode) or id(node) in seen:
        return
    seen.add(id(node))
    lines: dict[tuple[str, str], int] = {}
    for part in node.value:
        for one in part if isinstance(part, tuple) else (part,):
            _check_nodes(path, one, seen)
        if isinstance(part, tuple) and isinstance(key := part[0], yaml.ScalarNode) and key.tag != _MERGE:
            line = key.start_mark.line + 1
            if before := lines.get((key.tag, key.value)):
                raise DataError(
                    f"{path}, line {line}: the key {key.value!r} stands in line {before} already; keep one of the two"
                )
            lines[key.tag, key.value] = line


def _check_number(path: str | Path, node: yaml.ScalarNode) -> None:
    """Whether a plain number is written as all read it."""
    plain = {_INT: _PLAIN_INT, _FLOAT: _PLAIN_FLOAT}.get(node.tag)
    if plain and not plain.fullmatch(node.value):
        meant = yaml.SafeLoader("").construct_object(node)
        raise DataError(
            f"{path}, line {node.start_mark.line + 1}: {node.value} is {meant} to YAML: quote it if it is text or a "
            "time, or write the number in decimal digits without leading zeros, colons or underscores (1_000 may stay)"
        )


def _explained(error: yaml.MarkedYAMLError) -> str:
    """Where YAML's parser stopped, why, and where that began which it was reading."""
    stopped, began = error.problem_mark, error.context_mark
    place = f", line {stopped.line + 1}, column {stopped.column + 1}" if stopped else ""
    since = f", in what begins in line {began.line + 1}" if began else ""
    return f"{place}: not valid YAML: {error.problem}{since}; look for brackets, quotes, colons and tabs"


def dates_as_text(value: Any) -> Any:
    """YAML turns 2012-10-24 into a date; settings and JSON want text."""
    if isinstance(value, dict):
        return {key: dates_as_text(entry) for key, entry in value.items()}
    if isinstance(value, list):
        return [dates_as_text(entry) for entry in value]
    return value.isoformat() if isinstance(value, date) else value
