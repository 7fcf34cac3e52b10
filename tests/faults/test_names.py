"""Names that would do something where they are used: in paths of Snakemake's, in YAML and in a spreadsheet."""

import csv
import io
import math

import pandas as pd
import pytest

from modlhmp.datasets import Dataset
from modlhmp.file_format import Recording
from modlhmp.storage import DataError
from modlhmp.study.configuration import _check_paths
from modlhmp.study.csv_cells import csv_text, original
from modlhmp.study.exhibits.table_forms import write_table
from modlhmp.yaml_file import read_yaml

RUN = [
    "=1+1",
    "=cmd|' /C calc'!A0",
    "+1+1",
    "-2+3",
    "-1.2 / 3.4",
    "@SUM(1)",
    "\t=1",
    "\r=1",
    "\n=1",
    "＝1",
    "-x",
    "-inf",
]
INERT = ["-1.5", "+3", "-2e-05", "1=1", "– ", "a@b", "'=1", "", " - ", "not run", "12 +- 3"]


def cells_of(text):
    return list(csv.reader(io.StringIO(text, newline="")))


def test_no_cell_is_one_that_a_spreadsheet_would_run():
    table = pd.DataFrame({"=title": RUN, "n": range(len(RUN))})
    header, *rows = cells_of(csv_text(table))
    assert header == ["'=title", "n"]
    assert [cell for cell, _ in rows] == [f"'{cell}".replace("\r", " ") for cell in RUN]


def test_a_reader_gets_the_text_back():
    texts = [*RUN, *(text for text in INERT if text and not text.startswith("'"))]
    _, *rows = cells_of(csv_text(pd.DataFrame({"text": texts})))
    assert [original(cell) for (cell,) in rows] == [text.replace("\r", " ") for text in texts]


def test_no_cell_begins_within_another():
    assert csv_text(pd.DataFrame({"a": ["b\r=1"], "c": ["d\n=1"]})) == 'a,c\nb =1,"d\n=1"\n'


def test_numbers_and_other_texts_stay(tmp_path):
    values = [-1.5, -2e-9, -math.inf, 0.25, math.nan, 3.0, -7.0, 1e300, -0.0, 12.0, 5.5]
    table = pd.DataFrame({"text": INERT, "value": values, "count": range(-5, len(INERT) - 5)})
    assert csv_text(table, float_format="%.6g") == table.to_csv(index=False, float_format="%.6g")


def test_a_table_is_written_without_formulas(tmp_path):
    write_table(pd.DataFrame({"method": ["**=1+1**"], "error": ["-0.1"]}), tmp_path / "t", "Table", False)
    assert cells_of((tmp_path / "t.csv").read_text()) == [["method", "error"], ["'=1+1", "-0.1"]]


@pytest.mark.parametrize(
    ("name", "recording"),
    [
        ("{x}", {}),
        ("a\n", {}),
        ("own", {"stored": "data/{x}.csv"}),
        ("own", {"stored": "{root}/a.csv"}),
        ("own", {"stored": "a.zip", "name": "{x}"}),
        ("own", {"stored": "a.csv", "people": ("a.csv", "b<c>.csv")}),
    ],
)
def test_what_snakemake_would_take_for_a_wildcard_is_refused(tmp_path, name, recording):
    dataset = Dataset(
        title="Own", name=name, recordings=(Recording(**recording),), horizon_s=4.0, velocity="differences"
    )
    with pytest.raises(DataError, match=r"own\.yaml: .*Snakemake cannot take the character .* in a path"):
        _check_paths(dataset, tmp_path / "own.yaml")


@pytest.mark.parametrize(
    ("text", "place"),
    [
        ("a: 1\nb: 2\na: 3\n", "line 3: the key 'a' stands in line 1 already"),
        ("a:\n  b: 1\n  'b': 2\n", "line 3: the key 'b' stands in line 2 already"),
        ("a: {b: 1, b: 1}\n", "line 1: the key 'b' stands in line 1 already"),
        ("- {a: 1}\n- {a: 1,\n   a: 1}\n", "line 3: the key 'a' stands in line 2 already"),
        ("a: 1\n? {b: 1, b: 2}\n: 2\n", "line 2: the key 'b' stands in line 2 already"),
    ],
)
def test_a_key_that_stands_twice_is_named_with_both_lines(tmp_path, text, place):
    (tmp_path / "a.yaml").write_text(text)
    with pytest.raises(DataError, match=rf"a\.yaml, {place}; keep one of the two"):
        read_yaml(tmp_path / "a.yaml", "a dataset file")


def test_keys_of_different_mappings_may_be_the_same(tmp_path):
    text = "a: &a {b: 1}\nc: {b: 1, a: 1}\nd: *a\ne: {<<: *a, <<: *a, f: 1}\n1: 1\n'1': 2\n"
    (tmp_path / "a.yaml").write_text(text)
    assert read_yaml(tmp_path / "a.yaml", "a dataset file")["e"] == {"b": 1, "f": 1}
