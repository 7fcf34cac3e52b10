"""Typed settings: what is mistyped is told with file, key, value and remedy; what is right comes back as it went in."""

import dataclasses
import json
from dataclasses import dataclass
from typing import Annotated, Any, Literal

import jsonschema
import pytest
import yaml
from annotated_types import MaxLen, MinLen
from hypothesis import given
from hypothesis import strategies as st

from modlhmp.options import Average, Episodes, NeuralMap, RollOut, Snippets, Training
from modlhmp.settings import (
    Positive,
    Share,
    Width,
    as_plain,
    build,
    check,
    fields_of,
    json_schema,
    option,
    type_name,
    unknown,
)
from modlhmp.storage import DataError


@dataclass(frozen=True, kw_only=True)
class Door:
    """A settings class of somebody else's."""

    width_m: Positive = option(meaning="between the posts [m]")
    title: str = option("door", "what it is called")
    open: bool = option(True, "whether people can pass")


@dataclass(frozen=True, kw_only=True)
class House:
    """One that holds others."""

    front: Door = option(Door(width_m=1.0), "where people come in")
    back: Door | None = option(None, "if there is one")
    doors: dict[str, Door] = option({}, "the others, by name")
    row: tuple[Door, ...] = option((), "those side by side")
    floors: int = option(1, "how many")
    steps: Width = option(8, "of the stairs")
    share: Share = option(0.5, "of the ground")
    size: tuple[float, float] = option((1.0, 2.0), "width and depth [m]")
    codes: Annotated[tuple[int, ...], MinLen(1), MaxLen(3)] = option((1,), "of the locks")
    key: Annotated[str, MaxLen(3)] = option("abc", "to the door")
    colour: Literal["red", "blue"] = option("red", "of the walls")
    column: int | str = option(0, "by position or name")
    limit: float | None = option(None, "null: none")
    rules: tuple[str | dict[str, dict[str, Any]], ...] = option((), "of the house")
    free: dict[str, Any] = option({}, "whatever")


def house(**changes):
    return check(House, changes, "my.yaml")


def told(changes, cls=House):
    """The lines of a refusal, without the file, which is named first."""
    with pytest.raises(DataError) as error:
        check(cls, changes, "my.yaml")
    first, *lines = str(error.value).split("\n  ")
    assert first == "my.yaml:"
    return lines


# --- what is right ------------------------------------------------------------------------------------------


def test_what_is_not_said_has_its_default():
    assert house() == House()
    assert house(front={"width_m": 2}).front == Door(width_m=2.0)


def test_settings_of_others_are_nested_to_any_depth():
    found = house(back={"width_m": 1}, doors={"left": {"width_m": 2}}, row=[{"width_m": 3}, {"width_m": 4}])
    assert (found.back, found.doors["left"]) == (Door(width_m=1.0), Door(width_m=2.0))
    assert [door.width_m for door in found.row] == [3.0, 4.0]


@pytest.mark.parametrize("text", ["1e-3", "1E-3", "0.001", "'0.001'", "1.0e-3"])
def test_numbers_may_be_text(text):
    """YAML takes 1e-3 for text, and Snakemake hands on text from inside lists and mappings of --config."""
    found = check(Training, yaml.safe_load(f"learning_rate: {text}"), "my.yaml").learning_rate
    assert found == 0.001
    assert type(found) is float


def test_numbers_in_lists_and_mappings_may_be_text():
    found = house(size=["1", "2.5"], codes=["7"], doors={"left": {"width_m": "2", "open": "false"}}, floors="9")
    assert (found.size, found.codes, found.floors) == ((1.0, 2.5), (7,), 9)
    assert found.doors["left"] == Door(width_m=2.0, open=False)


def test_text_that_may_be_text_stays_text():
    assert house(column="3").column == "3"
    assert house(column=3).column == 3
    assert house(key="7").key == "7"


def test_defaults_are_nobody_else_s():
    one, other = House(), House()
    one.free["a"] = 1
    assert other.free == {}


# --- keys that are wrong ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("changes", "line"),
    [
        ({"flors": 1}, "top level: unknown key 'flors', did you mean 'floors'?"),
        ({"front": {"width_m": 1, "titel": "x"}}, "front: unknown key 'titel', did you mean 'title'?"),
        ({"back": {"width_m": 1, "titel": "x"}}, "back: unknown key 'titel', did you mean 'title'?"),
        ({"doors": {"title": {"width_m": 1, "opn": 0}}}, "doors.title: unknown key 'opn', did you mean 'open'?"),
        ({"row": [{"width_m": 1}, {"width_m": 1, "zzz": 0}]}, "row.1: unknown key 'zzz' (known: width_m, title, open)"),
        ({"front": {}}, "front: the key 'width_m' is required"),
        ({"doors": {"left": {}}}, "doors.left: the key 'width_m' is required"),
    ],
)
def test_a_wrong_key_is_told_with_its_place(changes, line):
    """Also in settings that others hold, by name or in a row: nothing is silently left out."""
    assert told(changes) == [line]


@pytest.mark.parametrize(
    ("cls", "old", "new"),
    [
        (Snippets, "kernel_m", "bandwidth_m"),
        (NeuralMap, "validation", "held_out"),
        (Training, "validation", "held_out"),
        (Training, "epochs", "windows"),
    ],
)
def test_a_key_that_had_another_name_is_told_the_new_one(cls, old, new):
    """And what it means, which may differ."""
    means = next(field.metadata["description"] for field in dataclasses.fields(cls) if field.name == new)
    assert told({old: 1}, cls) == [f"top level: unknown key '{old}': it is now called '{new}' ({means})"]


def test_a_key_of_old_is_not_told_where_the_new_one_is_not_known():
    assert told({"kernel_m": 1}, Average) == ["top level: unknown key 'kernel_m' (known: of)"]


def test_a_value_that_had_another_name_is_told_the_new_one():
    assert told({"velocity": "columns"}, RollOut)[0].startswith("velocity: 'columns' is now called 'dataset' (")
    assert check(RollOut, {"output": "geometric_median"}, "my.yaml").output == "geometric_median"


def test_keys_that_must_be_there_though_they_have_a_default():
    assert check(House, {"floors": 2}, "my.yaml", ["floors"]).floors == 2
    with pytest.raises(DataError, match=r"my\.yaml:\n  top level: the key 'floors' is required"):
        check(House, {}, "my.yaml", ["floors"])


# --- values that are wrong ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("key", "value", "text"),
    [
        ("floors", 2.5, "2.5 is not a whole number (how many)"),
        ("floors", "two", "'two' is not a whole number (how many)"),
        ("floors", "2.5", "'2.5' is not a whole number (how many)"),
        ("floors", None, "None is not a whole number (how many)"),
        ("floors", [1], "[1] is not a whole number (how many)"),
        ("floors", True, "True is not a number (how many)"),
        ("limit", False, "False is not a number (null: none)"),
        ("limit", float("nan"), "nan is not a finite number (null: none)"),
        ("limit", "wide", "'wide' is not a number (null: none)"),
        (
            "column",
            True,
            "True is not text: YAML reads on, no and yes as true or false; quote it (by position or name)",
        ),
        ("key", False, "False is not text: YAML reads on, no and yes as true or false; quote it (to the door)"),
        ("column", [1], "[1] is not a whole number or text (by position or name)"),
        ("steps", 6, "6 is not a multiple of 4 (of the stairs)"),
        ("steps", 0, "0 is not at least 4 (of the stairs)"),
        ("share", 1.5, "1.5 is not at most 1 (of the ground)"),
        ("share", "-1", "'-1' is not at least 0 (of the ground)"),
        ("colour", "green", "'green' is not one of 'red' or 'blue' (of the walls)"),
        ("colour", None, "None is not one of 'red' or 'blue' (of the walls)"),
        ("key", 123, "123 is a number, not text; quote it (YAML reads 10:30 and 2024_01 as numbers) (to the door)"),
        ("key", "abcd", "'abcd' is too long, at most 3 allowed (to the door)"),
        ("size", [1], "[1] is too short (width and depth [m])"),
        ("size", [1, 2, 3], "[1, 2, 3] is too long, at most 2 allowed (width and depth [m])"),
        ("size", 3, "3 is not a list (width and depth [m])"),
        ("codes", [], "[] is too short, at least 1 needed (of the locks)"),
        ("codes", "123", "'123' is not a list (of the locks)"),
        ("front", None, "None is not a mapping (where people come in)"),
        ("doors", [1], "[1] is not a mapping (the others, by name)"),
        ("rules", [5], "rules.0: 5 is not text or a mapping (of the house)"),
        ("rules", ["a", {"b": 5}], "rules.1.b: 5 is not a mapping (of the house)"),
    ],
)
def test_a_wrong_value_is_told_with_its_key_and_meaning(key, value, text):
    assert told({key: value}) == [text if text.startswith(key) else f"{key}: {text}"]


@pytest.mark.parametrize(
    ("changes", "line"),
    [
        ({"front": {"width_m": 0}}, "front.width_m: 0 is not above 0 (between the posts [m])"),
        ({"doors": {"title": {"width_m": "x"}}}, "doors.title.width_m: 'x' is not a number (between the posts [m])"),
        ({"doors": {"a": {"width_m": True}}}, "doors.a.width_m: True is not a number (between the posts [m])"),
        ({"row": [{"width_m": 1, "open": 1}]}, "row.0.open: 1 is not true or false (whether people can pass)"),
        ({"back": {"width_m": 1, "open": "ajar"}}, "back.open: 'ajar' is not true or false (whether people can pass)"),
        ({"codes": [1, False]}, "codes.1: False is not a number (of the locks)"),
        ({"codes": [1, "x"]}, "codes.1: 'x' is not a whole number (of the locks)"),
        ({"size": [True, 1]}, "size.0: True is not a number (width and depth [m])"),
    ],
)  # fmt: skip
def test_a_wrong_value_deep_inside_is_told_with_its_whole_path(changes, line):
    assert told(changes) == [line]


def test_what_may_be_anything_is_not_looked_into():
    assert house(free={"a": True, "b": [1, True]}).free == {"a": True, "b": [1, True]}


def test_all_problems_are_told_at_once():
    """Also those that pydantic would not see, and those of keys that must be there."""
    changes = {"floors": "two", "sahre": 1, "share": True, "front": {}, "doors": {"a": {"width_m": -1}}}
    with pytest.raises(DataError) as error:
        check(House, changes, "my.yaml", ["limit"])
    parts = ["floors: 'two'", "unknown key 'sahre', did you mean 'share'", "share: True is not a number",
             "front: the key 'width_m' is required", "doors.a.width_m: -1", "the key 'limit' is required"]  # fmt: skip
    for part in parts:
        assert part in str(error.value)
    assert len(str(error.value).splitlines()) == 1 + len(parts)


def test_problems_under_numbers_and_names_are_told_side_by_side():
    """YAML reads a door called 1 as a number."""
    lines = told({"doors": {1: {"width_m": 0}, "a": {"width_m": 0}}, 2: 0})
    assert sorted(line.split(" (")[0] for line in lines) == [
        "doors.1.width_m: 0 is not above 0",
        "doors.1: 1 is a number, not text; quote it",
        "doors.a.width_m: 0 is not above 0",
        "top level: unknown key 2",
    ]


@pytest.mark.parametrize("plain", [None, 5, "text", ["floors"]])
def test_settings_are_a_mapping(plain):
    assert told(plain) == [f"top level: {plain!r} is not a mapping"]


@given(
    st.recursive(
        st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=3),
        lambda inner: (
            st.lists(inner, max_size=3)
            | st.dictionaries(
                st.sampled_from([*(field.name for field in dataclasses.fields(House)), "width_m", "open", "x", 1]),
                inner,
            )
        ),
        max_leaves=12,
    )
)
def test_whatever_is_given_is_settings_or_a_told_problem(plain):
    try:
        found = check(House, plain, "my.yaml")
    except DataError as error:
        assert str(error).startswith("my.yaml:\n  ")
        assert "function-" not in str(error)
    else:
        assert isinstance(found, House)


# --- plain forms --------------------------------------------------------------------------------------------


HOUSES = [
    {},
    {"back": {"width_m": 1, "open": False}, "limit": 3, "column": "x"},
    {"doors": {"a": {"width_m": 1}, "b": {"width_m": 2, "title": "b"}}, "row": [{"width_m": 3}]},
    {"rules": ["a", {"b": {"points": [[1, 2], [3, 4]]}}], "free": {"a": [1, {"b": None}]}, "codes": [1, 2]},
]


@pytest.mark.parametrize("changes", HOUSES)
def test_settings_come_back_from_their_plain_form(changes):
    """Through JSON, as they reach the workflow's jobs, and through YAML."""
    settings = house(**changes)
    plain = as_plain(settings)
    assert build(House, json.loads(json.dumps(plain))) == settings
    assert check(House, yaml.safe_load(yaml.safe_dump(plain)), "my.yaml") == settings


def test_building_leaves_out_what_the_class_does_not_know():
    assert build(Door, {"width_m": 2.0, "kind": "door"}) == Door(width_m=2.0)


def test_the_json_schema_forbids_what_the_check_forbids():
    schema = json_schema(House, ["floors"])
    valid = jsonschema.Draft202012Validator(schema).is_valid
    assert valid({"floors": 1, "doors": {"a": {"width_m": 1}}})
    assert not valid({})
    for wrong in ({"flors": 1}, {"front": {}}, {"doors": {"a": {"width_m": 1, "x": 1}}}, {"steps": 6}, {"share": 2}):
        assert not valid({"floors": 1, **wrong})
    assert schema["properties"]["floors"]["description"] == "how many"


# --- tables and messages ------------------------------------------------------------------------------------


def test_fields_are_listed_with_type_default_and_meaning():
    rows = {name: rest for name, *rest in fields_of(House)}
    assert rows["steps"] == ["whole number, at least 4, a multiple of 4", 8, "of the stairs"]
    assert rows["colour"] == ["`red` or `blue`", "red", "of the walls"]
    assert rows["limit"] == ["number or null", None, "null: none"]
    assert rows["doors"] == ["mapping", {}, "the others, by name"]
    assert rows["front"][1] == Door(width_m=1.0)
    assert fields_of(Door)[0] == ("width_m", "number, above 0", dataclasses.MISSING, "between the posts [m]")
    assert type_name(tuple[int, ...]) == "list of whole number"


@pytest.mark.parametrize("cls", [RollOut, Episodes, Snippets, NeuralMap, Training])
def test_every_shipped_option_has_a_meaning_and_a_default_that_passes(cls):
    assert all(meaning for *_, meaning in fields_of(cls))
    assert check(cls, as_plain(cls()), "defaults") == cls()


def test_the_nearest_name_is_told():
    assert unknown("compare", "method", "clif", ["stef", "cliff"]) == (
        "compare: no method named 'clif'; did you mean 'cliff'?"
    )
    assert unknown("compare", "method", "zzz", ["stef", "cliff"]) == (
        "compare: no method named 'zzz'; known: stef, cliff"
    )
