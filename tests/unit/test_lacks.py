"""What a dataset cannot have is said in one place, which the docs list: the words of the run are those of the table."""

import ast
from pathlib import Path

import pytest

from modlhmp import study
from modlhmp.study import describe, lacks
from modlhmp.study.exhibits import EXHIBITS

STUDY = Path(study.__file__).parent
SOURCES = {path: path.read_text(encoding="utf-8") for path in STUDY.rglob("*.py") if path.name != "lacks.py"}
NAMES = {value: name for name, value in vars(lacks).items() if isinstance(value, lacks.Lack)}


def test_all_are_listed_and_of_some_exhibit():
    assert set(lacks.ALL) == set(NAMES)
    assert {one for exhibit in EXHIBITS for one in exhibit.lacks} == set(lacks.ALL)


@pytest.mark.parametrize("lack", lacks.ALL, ids=NAMES.get)
def test_a_reason_has_one_home(lack):
    """Its words are nowhere else, and it is shown by something that is not a record."""
    begins = lack.text.partition("{")[0].strip()
    assert [path.name for path, source in SOURCES.items() if begins in source and len(begins) > len("no")] == []
    shown = [path for path, source in SOURCES.items() if f"lacks.{NAMES[lack]}" in source]
    assert [path for path in shown if not path.name.startswith("of_")]


def test_an_empty_panel_says_nothing_else():
    said = []
    for path, source in SOURCES.items():
        for node in ast.walk(ast.parse(source)):
            name = getattr(getattr(node, "func", None), "attr", getattr(getattr(node, "func", None), "id", ""))
            if name == "empty_panel":
                texts = [
                    one.value for one in ast.walk(node) if isinstance(one, ast.Constant) and isinstance(one.value, str)
                ]
                said += [(path.name, text) for text in texts if any(letter.isalpha() for letter in text)]
    assert said == []


def test_the_table_names_every_exhibit_that_lacks_something():
    made = describe.tables()["lacks"]
    for exhibit in EXHIBITS:
        for lack in exhibit.lacks:
            row = next(line for line in made.splitlines() if f"| {lack.where} | {lack.text.partition('{')[0]}" in line)
            assert f"`{exhibit.name.replace('{label}', '<label>')}`" in row
