"""Typed settings: dataclasses are the one source of defaults, checks, messages, JSON schemas and tables.

A settings class is a frozen dataclass whose fields are made by `option`; its `ELSEWHERE` may say, of keys that are
looked for in it, where they belong. Using settings costs nothing else: pydantic is imported only where a user's
settings are checked.
"""

import dataclasses
import difflib
import functools
import types
import typing
from collections.abc import Iterable, Mapping
from typing import Annotated, Any, TypeVar

from annotated_types import Ge, Gt, Le, MultipleOf

from modlhmp.storage import DataError

WholeFrom0 = Annotated[int, Ge(0)]
WholeFrom1 = Annotated[int, Ge(1)]
WholeFrom2 = Annotated[int, Ge(2)]
WholeFrom3 = Annotated[int, Ge(3)]
Width = Annotated[int, Ge(4), MultipleOf(4)]
From0 = Annotated[float, Ge(0)]
Positive = Annotated[float, Gt(0)]
Share = Annotated[float, Ge(0), Le(1)]
Metres = Annotated[float, Ge(0.01), Le(1000)]  # of a grid or a radius
Seconds = Annotated[int, Gt(0)] | Annotated[float, Gt(0)]  # whole ones stay whole: tables show 5 for 5

T = TypeVar("T")
TOP = "top level"
# Names of old: key -> key, and (key, value) -> values, of which the one that the key takes where it stands is told.
RENAMED_KEYS = {"kernel_m": "bandwidth_m", "k": "persons", "validation": "held_out", "epochs": "windows"}
RENAMED_VALUES = {("velocity", "columns"): ("as_recorded", "dataset")}


def option(default: Any = dataclasses.MISSING, meaning: str = "") -> Any:
    """A field of a settings class: its default (without one the key is required) and what it means, in one line."""
    about = {"description": meaning}
    if isinstance(default, dict | list) or dataclasses.is_dataclass(default):
        copied = functools.partial(dataclasses.replace, default) if dataclasses.is_dataclass(default) else default.copy  # type: ignore[type-var]
        return dataclasses.field(default_factory=copied, metadata=about)
    return dataclasses.field(default=default, metadata=about)


def check(cls: type[T], plain: Any, source: object, required: Iterable[str] = (), within: str = "") -> T:
    """An instance of a settings class from a mapping as YAML gives it; `required` are keys that it must have as well.

    `within` are the keys, such as `maps.cliff`, under which the mapping stands in `source`.
    Numbers may be text, as in `1e-3`, which YAML takes for text, or in `--config`. `DataError` names `source`, every
    key that is wrong, its value and the remedy.
    """
    from pydantic import ValidationError  # noqa: PLC0415 - 0.15 s that only a check needs

    told = dict(_mistaken(cls, plain))
    try:
        found = _adapter(cls).validate_python(plain)  # type: ignore[arg-type]
    except ValidationError as error:
        told |= _explained(cls, error.errors(), told)
    missing = [key for key in required if key not in plain] if isinstance(plain, Mapping) else []
    told |= {(key,): f"{TOP}: the key {key!r} is required" for key in missing}
    if told:
        lines = [_within(within, text) for text in dict.fromkeys(told.values())]
        raise DataError(f"{source}:\n  " + "\n  ".join(lines))
    return found


def build(cls: type[T], plain: Mapping[str, Any]) -> T:
    """An instance of a settings class from what `as_plain` made of one; nothing is checked, other keys are ignored."""
    hints = typing.get_type_hints(cls)
    names = [field.name for field in dataclasses.fields(cls) if field.name in plain]  # type: ignore[arg-type]
    return cls(**{name: _built(hints[name], plain[name]) for name in names})


def as_plain(settings: Any) -> Any:
    """Settings as mappings, lists and scalars: what JSON and YAML can hold."""
    if dataclasses.is_dataclass(settings):
        return {f.name: as_plain(getattr(settings, f.name)) for f in dataclasses.fields(settings)}
    if isinstance(settings, Mapping):
        return {key: as_plain(value) for key, value in settings.items()}
    if hasattr(settings, "tolist"):  # numpy's numbers and arrays
        return settings.tolist()
    return [as_plain(value) for value in settings] if isinstance(settings, list | tuple) else settings


def json_schema(cls: type, required: Iterable[str] = ()) -> dict[str, Any]:
    """JSON schema of a settings class, for editors; `required` as in `check`."""
    schema = _adapter(cls).json_schema()
    both = list(dict.fromkeys([*schema.get("required", []), *required]))
    return {**schema, "required": both} if both else schema


def fields_of(cls: type) -> list[tuple[str, str, Any, str]]:
    """Name, type, default (`MISSING`: required) and meaning of every option of a settings class, for tables."""
    hints, rows = typing.get_type_hints(cls, include_extras=True), []
    for field in dataclasses.fields(cls):
        default = field.default
        if field.default_factory is not dataclasses.MISSING:
            default = field.default_factory()
        rows.append((field.name, type_name(hints[field.name]), default, field.metadata.get("description", "")))
    return rows


def type_name(hint: Any) -> str:
    """How a type is called in tables and messages."""
    origin, inner = typing.get_origin(hint), typing.get_args(hint)
    if origin is Annotated:
        return type_name(inner[0]) + "".join(filter(None, map(_limit, inner[1:])))
    if origin is typing.Literal:
        return " or ".join(f"`{value}`" for value in inner)
    if origin in {typing.Union, types.UnionType}:
        names = [type_name(one) for one in inner]
        every = [name for name in names if name.startswith("whole ") and name.removeprefix("whole ") in names]
        return " or ".join(name for name in names if name not in every)
    if origin in {tuple, list}:
        return f"list of {type_name(inner[0])}"
    if origin is dict:
        return "mapping"
    plain = {int: "whole number", float: "number", str: "text", bool: "true or false", type(None): "null", Any: "any"}
    return plain.get(hint, "mapping")


def unknown(where: str, what: str, name: object, known: Iterable[str], otherwise: str = "") -> str:
    """The message that there is no such thing, with the nearest of those that there are.

    Where none is near all are named, and `otherwise`, another reason that there may be.
    """
    known = list(known)
    small = {one.lower(): one for one in known}
    close = difflib.get_close_matches(str(name).lower(), small, 1)
    hint = (
        f"did you mean {small[close[0]]!r}?"
        if close
        else "; ".join(filter(None, [f"known: {', '.join(known)}", otherwise]))
    )
    if RENAMED_KEYS.get(str(name)) in known:
        hint = f"it is now called {RENAMED_KEYS[str(name)]!r}"
    return f"{where}: no {what} named {name!r}; {hint}"


@functools.cache
def _adapter(cls: type) -> Any:
    from pydantic import ConfigDict, TypeAdapter  # noqa: PLC0415 - see `check`

    for one in _settings_classes(cls):
        one.__pydantic_config__ = ConfigDict(extra="forbid", allow_inf_nan=False)
    return TypeAdapter(cls)


def _settings_classes(hint: Any) -> Iterable[Any]:
    """A settings class and all that its fields hold."""
    if dataclasses.is_dataclass(hint):
        yield hint
        for inner in typing.get_type_hints(hint).values():
            yield from _settings_classes(inner)
    for inner in typing.get_args(hint):
        yield from _settings_classes(inner)


def _built(hint: Any, value: Any) -> Any:
    """A value of a type from its plain form."""
    hint = _branch(hint, value)
    inner = typing.get_args(hint)
    if dataclasses.is_dataclass(hint) and isinstance(value, Mapping):
        return build(hint, value)  # type: ignore[arg-type]
    if typing.get_origin(hint) is dict and isinstance(value, Mapping):
        return {key: _built(inner[1], one) for key, one in value.items()}
    if typing.get_origin(hint) is tuple and isinstance(value, list | tuple):
        return tuple(_built(one, part) for one, part in zip(_parts(hint, value), value, strict=True))
    return value


def _branch(hint: Any, value: Any) -> Any:
    """A type without its bounds; of several that may be, the one of the value's form, as it is if there is none."""
    if typing.get_origin(hint) is Annotated:
        return _branch(typing.get_args(hint)[0], value)
    if typing.get_origin(hint) not in {typing.Union, types.UnionType}:
        return hint
    branches = [_branch(one, value) for one in typing.get_args(hint) if one is not type(None)]
    if len(branches) == 1:
        return branches[0]
    forms = [_form(one) for one in branches]
    form = Mapping if isinstance(value, Mapping) else tuple if isinstance(value, list | tuple) else type(value)
    return branches[forms.index(form)] if form in forms else hint


def _form(hint: Any) -> Any:
    """What a plain value of a type is."""
    if dataclasses.is_dataclass(hint):
        return Mapping
    origin = typing.get_origin(hint)
    return {dict: Mapping, list: tuple}.get(origin, origin) or hint


def _parts(hint: Any, value: Any) -> list[Any]:
    """Types of the entries of a list."""
    inner = typing.get_args(hint)
    given = list(inner) if typing.get_origin(hint) is tuple and Ellipsis not in inner else []
    return (given + [inner[0] if inner else Any] * len(value))[: len(value)]


def _dotted(path: Iterable[Any]) -> str:
    return ".".join(map(str, path)) or TOP


def _within(keys: str, text: str) -> str:
    """A message about a mapping as one about that which it stands in, under these keys."""
    if not keys:
        return text
    return f"{keys}{text.removeprefix(TOP)}" if text.startswith(f"{TOP}:") else f"{keys}.{text}"


def _mistaken(hint: Any, value: Any, path: tuple[Any, ...] = (), meaning: str = "") -> Iterable[Any]:
    """Where true or false stands for a number, or a number for these, or one has no end: paths and messages.

    Pydantic takes them all.
    """
    hint = _branch(hint, value)
    several = typing.get_args(hint) if typing.get_origin(hint) in {typing.Union, types.UnionType} else ()
    types_of = {hint, *(_branch(one, value) for one in several)}
    about = f" ({meaning})" if meaning else ""
    if isinstance(value, bool) and str in types_of:
        yield path, f"{_dotted(path)}: {value} is not text: YAML reads on, no and yes as true or false; quote it{about}"
    elif isinstance(value, bool) and types_of & {int, float}:
        yield path, f"{_dotted(path)}: {value} is not a number{about}"
    elif int in types_of and str not in types_of and _is_too_long(value):
        yield path, f"{_dotted(path)}: a whole number of more than 18 digits; give a smaller one{about}"
    elif hint is bool and isinstance(value, int | float) and not isinstance(value, bool):
        yield path, f"{_dotted(path)}: {value!r} is not true or false{about}"
    elif isinstance(value, Mapping) and dataclasses.is_dataclass(hint):
        hints = typing.get_type_hints(hint, include_extras=True)
        for field in (field for field in dataclasses.fields(hint) if field.name in value):
            meant, name = field.metadata.get("description", ""), field.name
            yield from _mistaken(hints[name], value[name], (*path, name), meant)
    elif isinstance(value, Mapping) and typing.get_origin(hint) is dict:
        for key, one in value.items():
            yield from _mistaken(typing.get_args(hint)[1], one, (*path, key), meaning)
    elif isinstance(value, list | tuple) and typing.get_origin(hint) in {tuple, list}:
        for number, one in enumerate(_parts(hint, value)):
            yield from _mistaken(one, value[number], (*path, number), meaning)


def _is_too_long(value: Any) -> bool:
    """Whether a whole number, or the text of one, may not fit 64 bits."""
    if isinstance(value, str):
        return len(value) > 18 and value.lstrip("+-").isdigit()
    return isinstance(value, int) and abs(value) >= 10**18


def _explained(cls: type, errors: Iterable[Any], known: Iterable[Any]) -> dict[tuple[Any, ...], str]:
    """Pydantic's errors in the project's words, by the path of keys to each; none at the paths that are `known`."""
    told: dict[tuple[Any, ...], str] = {}
    for error in errors:
        path, owner, hint, meaning = _walk(cls, error["loc"])
        place = (*path, *(part for part in error["loc"][-1:] if part == "[key]"))  # a key may be wrong, and its value
        if place not in told and place not in known:
            told[place] = _explain(path, owner, hint, meaning, error)
    # Where a value may be of several types, or a list has too few good entries, what lies deeper says more.
    return {path: text for path, text in told.items() if not any(_above(path, other) for other in told)}


def _above(path: tuple[Any, ...], other: tuple[Any, ...]) -> bool:
    return len(other) > len(path) and other[: len(path)] == path


def _walk(cls: type, loc: Iterable[Any]) -> tuple[tuple[Any, ...], Any, Any, str]:
    """Where pydantic's location of an error leads: the keys, the class of the last one, its type and meaning.

    The location also names types, where a value may be of several, which no user wrote.
    """
    path: list[Any] = []
    owner: Any = cls
    hint, meaning = typing.cast(Any, cls), ""
    for part in loc:
        if typing.get_origin(hint) is Annotated:
            hint = typing.get_args(hint)[0]
        branches = [one for one in typing.get_args(hint) if one is not type(None)]
        if typing.get_origin(hint) in {typing.Union, types.UnionType}:
            if len(branches) > 1:  # `part` is a type
                named = [one for one in branches if str(part).startswith((_tag(one), f"function-after[{_tag(one)}"))]
                hint = named[0] if named and _form(named[0]) in {Mapping, tuple} else hint
                continue
            hint = typing.get_args(branches[0])[0] if typing.get_origin(branches[0]) is Annotated else branches[0]
        if part == "[key]":
            hint = str
            continue
        path.append(part)
        if dataclasses.is_dataclass(hint):
            owner = hint
            field = next((field for field in dataclasses.fields(hint) if field.name == part), None)
            meaning = field.metadata.get("description", "") if field else ""
            hint = typing.get_type_hints(hint, include_extras=True).get(part, Any)
        elif typing.get_origin(hint) is dict:
            hint = typing.get_args(hint)[1]
        elif typing.get_origin(hint) in {tuple, list} and isinstance(part, int):
            hint = _parts(hint, range(part + 1))[part]
    return tuple(path), owner, hint, meaning


def _tag(hint: Any) -> str:
    """How pydantic begins the name of a type."""
    return getattr(typing.get_origin(hint) or hint, "__name__", str(hint))


def _explain(path: tuple[Any, ...], owner: Any, hint: Any, meaning: str, error: Any) -> str:
    """One of pydantic's errors in the project's words."""
    kind, value, bounds = error["type"], error["input"], error.get("ctx", {})
    if kind in {"unexpected_keyword_argument", "extra_forbidden", "invalid_key"}:
        known, now = [field.name for field in dataclasses.fields(owner)], RENAMED_KEYS.get(path[-1], path[-1])
        renamed, elsewhere = now != path[-1], getattr(owner, "ELSEWHERE", {})
        if now in elsewhere:
            remedy = (f": it is now called {now!r}; it belongs" if renamed else ": it belongs") + f" {elsewhere[now]}"
        elif renamed and now in known:
            means = next(field for field in dataclasses.fields(owner) if field.name == now).metadata["description"]
            remedy = f": it is now called {now!r} ({means})"
        else:
            close = difflib.get_close_matches(str(path[-1]), known, 1)
            remedy = f", did you mean {close[0]!r}?" if close else f" (known: {', '.join(known)})"
        return f"{_dotted(path[:-1])}: unknown key {path[-1]!r}{remedy}"
    if kind.startswith("missing") and not isinstance(path[-1], int):
        return f"{_dotted(path[:-1])}: the key {path[-1]!r} is required"
    if kind == "missing":  # of a list of a fixed length
        path, text = path[:-1], f"{value!r} is too short"
    elif renamed := [new for new in RENAMED_VALUES.get(_key_and_value(path, value), ()) if new in _choices(hint)]:
        text = f"{value!r} is now called {renamed[0]!r}"
    elif kind == "literal_error":
        text = f"{value!r} is not one of {bounds['expected']}"
    elif kind == "string_type" and isinstance(value, int | float) and _branch(hint, value) is str:
        text = f"{value!r} is a number, not text; quote it (YAML reads 10:30 and 2024_01 as numbers)"
    elif kind == "finite_number":
        text = f"{value!r} is not a finite number"
    elif kind.endswith(("_type", "_parsing", "_parsing_size", "int_from_float")):
        text = f"{value!r} is not {_noun(hint)}"
    elif kind.startswith(("greater_than", "less_than", "multiple_of")):
        words = {"ge": "at least", "gt": "above", "le": "at most", "lt": "below", "multiple_of": "a multiple of"}
        text = f"{value!r} is not " + " and ".join(f"{words[name]} {bound:g}" for name, bound in bounds.items())
    elif kind.endswith(("too_short", "too_long")):
        short = f"short, at least {bounds.get('min_length')} needed"
        text = f"{value!r} is too " + (
            short if kind.endswith("short") else f"long, at most {bounds['max_length']} allowed"
        )
    else:
        text = f"{value!r}: {error['msg'][0].lower()}{error['msg'][1:]}"
    return f"{_dotted(path)}: {text}" + (f" ({meaning})" if meaning else "")


def _key_and_value(path: tuple[Any, ...], value: Any) -> tuple[str, str]:
    return (str(path[-1]) if path else "", value if isinstance(value, str) else "")


def _choices(hint: Any) -> list[Any]:
    """All that a type lists literally."""
    inner = typing.get_args(hint)
    return list(inner) if typing.get_origin(hint) is typing.Literal else [x for one in inner for x in _choices(one)]


def _noun(hint: Any) -> str:
    """A type as a noun."""
    if typing.get_origin(hint) is Annotated:
        return _noun(typing.get_args(hint)[0])
    if typing.get_origin(hint) in {typing.Union, types.UnionType}:
        nouns = [_noun(one) for one in typing.get_args(hint) if one is not type(None)]
        return " or ".join(noun for noun in nouns if noun != "a whole number" or "a number" not in nouns)
    known = {str: "text", bool: "true or false", list: "a list", tuple: "a list"}
    return known.get(typing.get_origin(hint) or hint) or f"a {type_name(hint)}"


def _limit(constraint: Any) -> str:
    """A bound in words."""
    bounds = {"ge": "at least", "gt": "above", "le": "at most", "multiple_of": "a multiple of"}
    for name, words in bounds.items():
        if (value := getattr(constraint, name, None)) is not None:
            return f", {words} {value:g}"
    return ""
