"""Weights on disk, in the form of safetensors (names, shapes and numbers, and no code), sealed like all files of ours.

The form, https://github.com/huggingface/safetensors: the length of a header in 8 bytes, the header in JSON, all numbers
one after the other, little-endian. Any program that knows it reads these files; what they were built from is the text
`settings` of their metadata.
"""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch

from modlhmp.storage import DataError, atomic_path, read_sealed, sealed, unsealed

_TYPES: dict[str, Any] = {
    "F32": np.dtype("<f4"),
    "F64": np.dtype("<f8"),
    "I32": np.dtype("<i4"),
    "I64": np.dtype("<i8"),
}
_NAMES = {of: name for name, of in _TYPES.items()}
_ALIGNED = 8


def write_weights(path: str | Path, weights: Mapping[str, torch.Tensor], settings: Mapping[str, Any]) -> None:
    """Write a network's weights (its `state_dict`) and what it was built from; the same ones are the same bytes."""
    about = {**unsealed(), "settings": json.dumps(settings, sort_keys=True)}
    header: dict[str, Any] = {"__metadata__": about}
    parts, end = [], 0
    for name, value in weights.items():
        numbers = value.numpy(force=True)
        numbers = numbers.astype(numbers.dtype.newbyteorder("<"))
        header[name] = {"dtype": _NAMES[numbers.dtype], "shape": list(numbers.shape),
                        "data_offsets": [end, end + numbers.nbytes]}  # fmt: skip
        parts.append(numbers.tobytes())
        end += numbers.nbytes
    text = json.dumps(header).encode()
    text += b" " * (-len(text) % _ALIGNED)
    with atomic_path(path) as temporary:
        temporary.write_bytes(sealed(b"".join([len(text).to_bytes(8, "little"), text, *parts])))


def read_weights(path: str | Path) -> tuple[dict[str, torch.Tensor], dict[str, Any]]:
    """(weights, settings) of a file; `DataError` where it is damaged, is of another form, or holds NaN or infinity."""
    content = read_sealed(path)
    start = 8 + int.from_bytes(content[:8], "little")
    try:
        header = json.loads(content[8:start])
        settings = json.loads(header.pop("__metadata__")["settings"])
    except (ValueError, KeyError, RecursionError):
        raise DataError(f"{path}: cannot be read as weights; delete it and run again") from None
    weights = {}
    for name, one in header.items():
        first, last = one["data_offsets"]
        numbers = np.frombuffer(content[start + first : start + last], _TYPES[one["dtype"]]).reshape(one["shape"])
        if not np.isfinite(numbers).all():
            raise DataError(f"{path}: {name} holds NaN or infinity, which no forecast can use; delete it and run again")
        weights[name] = torch.from_numpy(numbers.copy())
    return weights, settings
