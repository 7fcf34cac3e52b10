"""Ids of people: numbers as they are, every other text apart from every other, whoever else is there."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from modlhmp.ids import LARGEST, Owners, id_of
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
