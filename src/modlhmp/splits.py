"""Who of a recording is of which split: by person, by time or by what the file says; and parts of a split."""

from dataclasses import replace

import numpy as np

from modlhmp.file_format import FileFormat, Recording, Split
from modlhmp.ids import Owners, id_of
from modlhmp.storage import DataError
from modlhmp.streams import stream_keys
from modlhmp.tracks import Tracks

VALIDATION_SHARE = 0.15
BLOCK_S = 1800.0
FOLDS = 5
CONTEMPORARIES_S = 600.0  # people recorded within so long of each other may be companions
_IS_TEST = {"train": False, "test": True}  # a divided file's recording without a `side` is an error here, not a guess


def only_of(form: FileFormat, recording: Recording) -> FileFormat:
    """The form that reads the rows of a recording's side alone, where a column of the file says which is which.

    What the form leaves out by itself is of neither side; its `only` has the texts of `test` (`check_column`).
    """
    chosen = recording.chosen
    if chosen is None or chosen.by != "column" or chosen.column is None or not isinstance(chosen.test, tuple):
        return form
    key, texts = str(chosen.column), tuple(chosen.test)
    if _IS_TEST[recording.side]:
        return replace(form, only={**form.only, key: texts})
    return replace(form, without={**form.without, key: (*form.without.get(key, ()), *texts)})


def check_column(where: str, split: Split, form: FileFormat) -> None:
    """`DataError` where the form's `only` or `without` leaves out rows that a split by column would test on."""
    key, tested = str(split.column), split.test if isinstance(split.test, tuple) else ()
    for name, chosen in (("only", form.only.get(key)), ("without", form.without.get(key))):
        texts = set(map(str, chosen or ()))
        out = [text for text in map(str, tested) if chosen is not None and (text in texts) == (name == "without")]
        if out:
            raise DataError(
                f"{where}: test [{', '.join(out)}]: `{name}: {{{key}: ...}}` leaves these rows out: correct one of them"
            )


def in_split(tracks: Tracks, recording: Recording, owners: Owners | None = None) -> np.ndarray:
    """Whether tracks are of the recording's side of its file, which takes a share of them by person or by time.

    By person the choice depends on the seed and each person's own id, so nobody's changes with others. By time those
    are tested who come after a moment, and those train who have left by then: who is there at that moment is in
    neither. `owners` are given where the pieces of a track are one person, who is there from the first to the last.
    """
    bounds, chosen = tracks.bounds(), recording.chosen
    if chosen is None or not isinstance(chosen.test, float) or len(bounds) == 1:
        return np.ones(len(bounds) - 1, bool)
    test = _IS_TEST[recording.side]
    ids = tracks.track_id[bounds[:-1]]
    if owners is not None:
        ids = np.array([id_of(owners.text(int(one))) for one in ids], np.int64)
    if chosen.by == "time":
        first, last = tracks.t[bounds[:-1]], tracks.t[bounds[1:] - 1]
        moment = first.min() + (1 - chosen.test) * (last.max() - first.min())
        _, whose = np.unique(ids, return_inverse=True)
        other = first <= moment if test else last > moment
        return np.bincount(whose, other)[whose] == 0  # with nobody whose other piece is of the other side
    share = stream_keys(ids, 1, "split", chosen.seed)[:, 0].astype(np.float64) / 2.0**64
    return (share < chosen.test) == test


def in_part(tracks: Tracks, part: str, person: np.ndarray | None = None) -> np.ndarray:
    """Whether tracks belong to a part of their recording: `validation`, `fit`, `fold-2`, `without-2`.

    `fold-2` are those that begin in every `FOLDS`th half-hour from the second on, `without-2` those of which nothing is
    within `CONTEMPORARIES_S` of these half-hours: whose contemporaries are all in the one are not in the other. `fit`
    are those that are not in `validation`. Where `person` [tracks] says whose each is, `fit` and `without-2` have
    nothing of anybody whose other tracks are not in them.
    """
    kind, _, fold = part.partition("-")
    if kind in ("fit", "validation"):
        held = in_validation_blocks(tracks)
    else:
        bounds = tracks.bounds()
        first, last = tracks.t[bounds[:-1]], tracks.t[bounds[1:] - 1]
        margin = CONTEMPORARIES_S if kind == "without" else 0.0
        begin = (first - margin) // BLOCK_S
        end = (last + margin) // BLOCK_S if kind == "without" else begin
        held = begin + (int(fold) - 1 - begin) % FOLDS <= end
    if kind in ("fold", "validation"):
        return held
    if person is None:
        return ~held
    _, whose = np.unique(person, return_inverse=True)
    return np.bincount(whose, held)[whose] == 0


def in_validation_blocks(tracks: Tracks, seed: int = 0) -> np.ndarray:
    """Whether tracks belong to the validation part of their recording: those that begin in some blocks of time.

    About `VALIDATION_SHARE` of the recording's half-hours with people, drawn with `seed`, at least one. Companions stay
    together, so a forecast of the one cannot be taken from the other. Where a half-hour is more than that share of the
    recording, blocks are that share of it, so that of people who come at different times some are in either part.
    """
    start = tracks.t[tracks.bounds()[:-1]]
    block_s = min(BLOCK_S, VALIDATION_SHARE * float(np.ptp(start))) if len(start) else 0.0
    block = (start // (block_s or BLOCK_S)).astype(np.int64)
    blocks = np.unique(block)
    number = max(round(VALIDATION_SHARE * len(blocks)), 1)
    return np.isin(block, np.random.default_rng(seed).permutation(blocks)[:number])
