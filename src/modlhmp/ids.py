"""Ids of people: whatever text the owner of a recording uses, as whole numbers that random streams can be keyed by.

A plain whole number stands for itself. Any other text - `P01`, `007`, `1_23`, a hash, a number of more than 18 digits -
gets a number of its own that depends on the text alone, so rows that are added or shuffled change nobody's. Two texts
that differ in any character are two people.
"""

import hashlib
import re
from collections.abc import Iterable, Mapping

from modlhmp.storage import DataError

MOST_PEOPLE = 1_000_000  # of a file: their names are held one by one
LARGEST = 2**62  # whole numbers below stand for themselves, numbers of texts are from here to 2^63
NOBODYS = -1  # the id that trackers write where they follow nobody; others below 0 are somebody's
_MISSING = frozenset({"", "nan", "na", "n/a", "#n/a", "<na>", "null", "none", "-", r"\n"})
_NOBODYS = re.compile(r"-0*1(?:\.0*)?(?:[eE][+-]?0+)?")
_PLAIN = re.compile(r"-?[1-9][0-9]{0,18}|0")


def id_of(text: str, piece: int = 1) -> int:
    """The track id of an owner's id; of the second, third ... `piece` of a track that was cut, another one.

    A plain whole number between -2^62 and 2^62 is its own id, as the first piece.
    """
    if piece == 1 and _PLAIN.fullmatch(text) and -LARGEST < int(text) < LARGEST:
        return int(text)
    whose = text if piece == 1 else f"{text}\0{piece}"
    digest = hashlib.blake2b(whose.encode("utf-8", "surrogateescape"), digest_size=8).digest()
    return LARGEST + int.from_bytes(digest, "big") % LARGEST


def is_missing(text: str) -> bool:
    """Whether a text without blanks around it is how tables write, in any case, that there is no id, or no number."""
    return text.casefold() in _MISSING


def is_nobodys(text: str) -> bool:
    """Whether an id is -1 in any digits: pandas has -1.0 where a column has gaps, NumPy's savetxt an exponent."""
    return _NOBODYS.fullmatch(text) is not None


def as_written(text: str, known: Iterable[str]) -> str:
    """The remedy for an id that is one of the `known` in other digits, as 003 and 3.0 are 3; "" where there is none."""

    def digits(one: str) -> str:
        return found[1] if (found := re.fullmatch(r"0*([0-9]+?)(?:\.0*)?", one)) else one

    wanted = digits(text)
    return next((f"; write {one}, as there" for one in known if digits(one) == wanted), "")


class Owners:
    """The owner's ids behind track ids: {track id: (owner's id, piece)} of all that are not plain numbers."""

    def __init__(self, known: Mapping[int, tuple[str, int]] | None = None) -> None:
        self.known = dict(known or {})

    def number(self, text: str, piece: int = 1) -> int:
        """The track id of an owner's id, which is remembered; `DataError` where two would share one."""
        found = id_of(text, piece)
        if piece > 1 or str(found) != text:
            other = self.known.setdefault(found, (text, piece))
            if other != (text, piece):
                raise DataError(f"ids {other[0]!r} and {text!r} have the same number {found}: rename one of them")
        return found

    def check(self) -> None:
        """`DataError` where a file has more people than can be held."""
        if len(self.known) > MOST_PEOPLE:
            raise DataError(f"more than {MOST_PEOPLE:,} ids that are texts: divide the file by people")

    def text(self, track_id: int) -> str:
        """The owner's id of a track."""
        return self.known.get(track_id, (str(track_id), 1))[0]

    def of(self, track_ids: Iterable[int]) -> dict[str, tuple[str, int]]:
        """As JSON data: {track id: [owner's id, piece]} of those among `track_ids` that are no plain numbers."""
        return {str(one): self.known[one] for one in map(int, track_ids) if one in self.known}
