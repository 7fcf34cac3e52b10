"""Numbers for a page, packed: whole multiples of a step, bytes sorted by place, all of it gzip; `data.js` reads it."""

import gzip
import json
from dataclasses import dataclass
from typing import Any

import numpy as np

FORM = 1  # of the packed data; a page refuses others
_TYPES = (np.int8, np.int16, np.int32)


@dataclass(frozen=True)
class Digits:
    """Numbers as they are packed: rounded to multiples of `step`, NaN kept.

    `row` > 0: as differences within rows of that many, which must be finite; a path's are small.
    """

    values: Any
    step: float = 1.0
    row: int = 0


def packed(tree: Any) -> bytes:
    """A tree of mappings, lists, scalars, arrays and `Digits` as bytes; plain arrays are whole numbers or a fault."""
    body: list[bytes] = []
    head = json.dumps(_referred(tree, body), ensure_ascii=False, separators=(",", ":"), allow_nan=False).encode()
    return gzip.compress(len(head).to_bytes(4, "little") + head + b"".join(body), 6, mtime=0)


def unpacked(data: bytes) -> Any:
    """The tree again, arrays flat and float64: the twin of what `data.js` does."""
    plain = gzip.decompress(data)
    size = int.from_bytes(plain[:4], "little")
    return _revived(json.loads(plain[4 : 4 + size]), plain[4 + size :])


def _referred(tree, body):
    """The tree with [offset, number, bytes each, step, row] in place of arrays, which are added to `body`."""
    if isinstance(tree, np.ndarray):
        tree = Digits(tree)
    if isinstance(tree, Digits):
        whole = _whole(tree)
        content = np.ascontiguousarray(whole).view(np.uint8).reshape(len(whole), whole.itemsize).T.tobytes()
        at = sum(map(len, body))
        body.append(content)
        return {"$": [at, len(whole), whole.dtype.itemsize, tree.step, tree.row]}
    if isinstance(tree, dict):
        return {key: _referred(value, body) for key, value in tree.items()}
    return [_referred(value, body) for value in tree] if isinstance(tree, list | tuple) else tree


def _whole(digits):
    """Whole numbers of the narrowest type that holds them, whose lowest value stands for NaN."""
    values = np.asarray(digits.values, float).ravel()
    known = np.isfinite(values)
    if np.isinf(values).any() or (digits.row and not known.all()):
        raise ValueError("infinite numbers cannot be packed, and paths need all of theirs")
    whole = np.rint(np.where(known, values, 0) / digits.step)
    if digits.row:
        rows = whole.reshape(-1, digits.row)
        whole = np.diff(rows, axis=1, prepend=0).ravel()
    most = np.abs(whole).max(initial=0)
    kind = next((kind for kind in _TYPES if most <= np.iinfo(kind).max), None)
    if kind is None:
        raise ValueError(f"{most:g} steps of {digits.step:g} are more than 32 bits hold")
    return np.where(known, whole, np.iinfo(kind).min).astype(f"<i{np.dtype(kind).itemsize}")


def _revived(tree, body):
    if isinstance(tree, dict) and "$" in tree:
        at, number, width, step, row = tree["$"]
        planes = np.frombuffer(body, np.uint8, number * width, at).reshape(width, number)
        whole = np.ascontiguousarray(planes.T).view(f"<i{width}").ravel()
        values = np.where(whole == np.iinfo(f"i{width}").min, np.nan, whole.astype(float))
        return step * (np.cumsum(values.reshape(-1, row), axis=1).ravel() if row else values)
    if isinstance(tree, dict):
        return {key: _revived(value, body) for key, value in tree.items()}
    return [_revived(value, body) for value in tree] if isinstance(tree, list) else tree
