"""The clean tracks of a dataset's recordings, as the workflow has them, and whose they are."""

from pathlib import Path
from typing import Any

import numpy as np

from modlhmp.cleaning import clean_recording, tell_of_faults
from modlhmp.datasets import Dataset
from modlhmp.file_format import Recording
from modlhmp.scenes import Scenes, scenes_of
from modlhmp.storage import DataError
from modlhmp.tracks import Tracks, concatenate, owner_texts, together


def clean(dataset: Dataset, recording: Recording) -> Tracks:
    """The clean tracks of a recording, as the workflow has them; `DataError` where it cannot be read."""
    return _cleaned(dataset, recording)[0]


def clean_with_scenes(dataset: Dataset, recording: Recording) -> tuple[Tracks, Scenes | None]:
    """The clean tracks of a recording and its scenes, None where its files have none; `DataError` as of `clean`."""
    tracks, account = _cleaned(dataset, recording)
    return tracks, scenes_of(account)


def clean_all(dataset: Dataset, split: str | None = None) -> tuple[Tracks, dict[int, str]]:
    """The clean tracks of all recordings, or of a split, and {track id: the owner's id} where that is another text.

    Tracks keep their ids. Where two recordings share one, which may be two people, all get ids of their own, and the
    owner's stand behind the recording's name: `monday/12`.
    """
    recordings = dataset.of_split(split)
    tables, accounts = zip(*(_cleaned(dataset, one) for one in recordings), strict=True)
    known = [owner_texts(account.get("owners", {})) for account in accounts]
    ids = np.concatenate([one.track_id[one.bounds()[:-1]] for one in tables])
    if len(np.unique(ids)) == len(ids):
        tracks = concatenate(tables)
        return tracks.take(np.argsort(tracks.track_id, kind="stable")), {
            i: text for one in known for i, text in one.items()
        }
    tracks, texts = together(tables), []
    for one, table, owners in zip(recordings, tables, known, strict=True):
        texts += [f"{one.name}/{owners.get(i, i)}" for i in table.track_id[table.bounds()[:-1]].tolist()]
    return tracks, dict(zip(tracks.track_id[tracks.bounds()[:-1]].tolist(), texts, strict=True))


def _cleaned(dataset: Dataset, recording: Recording) -> tuple[Tracks, dict[str, Any]]:
    """The clean tracks of a recording and their account (`cleaning.clean_recording`)."""
    if not recording.exists:
        raise DataError(
            f"{recording.path}: no such file; put it there, or correct `files` in {dataset.name}.yaml, or `data_root`"
        )
    path = Path(recording.stored, recording.member) if recording.member else Path(recording.path)
    tracks, account = clean_recording(path, dataset, recording)
    tell_of_faults(recording.path, account)
    return tracks, account
