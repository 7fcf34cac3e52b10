"""Weights on disk, as safetensors (names, shapes and numbers, and no code), sealed like all files of ours."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save

from modlhmp.storage import VERSION, DataError, atomic_path, read_sealed, sealed, unsealed
from modlhmp.version import __version__


def write_weights(path: str | Path, weights: Mapping[str, torch.Tensor], settings: Mapping[str, Any]) -> None:
    """Write a network's weights (its `state_dict`) and what it was built from; the same ones are the same bytes."""
    ((seal, zeros),) = unsealed().items()
    # One entry of metadata, the settings behind the seal: several would stand in an order of chance.
    about = {seal: zeros + json.dumps({VERSION: __version__, **settings}, sort_keys=True)}
    own = {name: value.detach().cpu().clone(memory_format=torch.contiguous_format) for name, value in weights.items()}
    content = save(own, about)
    with atomic_path(path) as temporary:
        temporary.write_bytes(sealed(content))


def read_weights(path: str | Path) -> tuple[dict[str, torch.Tensor], dict[str, Any]]:
    """(weights, settings) of a file; `DataError` where it is damaged, is of another form, or holds NaN or infinity."""
    read_sealed(path)
    ((seal, zeros),) = unsealed().items()
    try:
        with safe_open(path, "pt") as file:
            settings = json.loads(file.metadata()[seal][len(zeros) :])
            weights = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118 - it is no mapping
        infinite = [name for name, numbers in weights.items() if not torch.isfinite(numbers).all()]
        if not isinstance(settings, dict):
            raise TypeError
        settings.pop(VERSION, None)
    except (
        SafetensorError,
        OSError,
        TypeError,
        KeyError,
        ValueError,
        RuntimeError,
    ):  # the last: of types, of recursion
        raise DataError(f"{path}: cannot be read as weights; delete it and run again") from None
    if infinite:
        raise DataError(
            f"{path}: {infinite[0]} holds NaN or infinity, which no forecast can use; delete it and run again"
        )
    return weights, settings
