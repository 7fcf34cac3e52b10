"""Ids of people: numbers as they are, every other text apart from every other, whoever else is there."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from modlhmp.ids import LARGEST, Owners, id_of, is_missing, is_nobodys
from modlhmp.readers.numerals import number
from modlhmp.storage import DataError

TEXTS = [
    *("1_23", "12_3", "007", "7", "+7", "7.0", "1e2", "100", "-7", "-0", "0", "P01", "p01", "Müller", " x", "0x10"),
    *(str(2**60), str(2**62), str(2**63), "20121024093000124", "ab" * 40, "1 2"),
]


@given(st.integers(-LARGEST + 1, LARGEST - 1))
def test_a_plain_whole_number_stands_for_itself(number):
    assert id_of(str(number)) == number


def test_texts_that_differ_are_different_people():
    found = {id_of(text, piece) for text in TEXTS for piece in (1, 2, 3)}
    assert len(found) == 3 * len(TEXTS)
    assert all(-(2**63) < one < 2**63 for one in found)


def test_a_text_s_number_is_known_to_the_last_bit():
    """It keys the random numbers: no version, process or machine may change it."""
    assert id_of("P01") == 7172454095563560309
    assert id_of("007") % 1000 == 117


def test_owners_remember_what_is_no_plain_number():
    owners = Owners()
    numbers = {text: owners.number(text) for text in TEXTS}
    assert {text: owners.text(number) for text, number in numbers.items()} == {text: text for text in TEXTS}
    second = owners.number("7", 2)
    assert owners.text(second) == "7"
    assert owners.of([numbers["7"], second, numbers["P01"]]) == {str(second): ("7", 2), str(numbers["P01"]): ("P01", 1)}


def test_two_texts_of_one_number_are_refused(monkeypatch):
    monkeypatch.setattr("modlhmp.ids.id_of", lambda text, piece=1: LARGEST)
    owners = Owners()
    owners.number("a")
    with pytest.raises(DataError, match="'a' and 'b' have the same number"):
        owners.number("b")


def test_a_word_for_no_id_is_one_for_no_number():
    """Whoever wrote it: pandas, R, a database, a spreadsheet; and only where it is all of the text."""
    words = ["", "nan", "NaN", "NAN", "NA", "n/a", "#N/A", "<NA>", "NULL", "null", "None", "none", "-", r"\N"]
    assert all(is_missing(word) and number(word) != number(word) for word in words)
    assert not any(is_missing(text) for text in ("0", "-1", "--", "anna", "NA7", "N"))


def test_nobody_s_id_is_minus_one_however_it_is_written():
    """Pandas has 1.0 where a column has gaps, NumPy's savetxt writes exponents, others pad with zeros."""
    assert all(map(is_nobodys, ["-1", "-1.0", "-1.", "-1.000000000000000000e+00", "-01"]))
    assert not any(map(is_nobodys, ["1", "-10", "-1.5", "-1e1", "-0", "-2", "-1a", ""]))
