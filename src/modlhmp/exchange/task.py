"""A forecasting task to give away: what is seen of each walker up to t0, and nothing of what came after.

Ids are renewed: the tasks of a dataset are numbered in the order of a hash of each whole track, its future included.
So the order tells nothing about who came when, whoever has the recording finds it again without anything being kept,
and whoever has not cannot: the hashed part that decides it is not in the file. A seed would have to be kept, and a
small one could be guessed. Times are in s before t0.
"""

import hashlib
import json
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa

from modlhmp.exchange.columns import write_columns
from modlhmp.exchange.tracks import tracks_table
from modlhmp.exchange.trajnet import scene_line, track_lines, tracks_as_lines, write_lines
from modlhmp.forecasting.neighbours import find_neighbours
from modlhmp.forecasting.observe import Observed, at_whole_steps, observe
from modlhmp.forecasting.windows import windows
from modlhmp.scenes import Scenes
from modlhmp.settings import as_plain
from modlhmp.site import Site
from modlhmp.storage import VERSION, DataError, write_text
from modlhmp.tracks import Tracks, together
from modlhmp.version import __version__

FORMS = ("csv", "parquet", "ndjson")
STEPS_PER_UNIT = 1e6  # hashed are whole micrometres and microseconds, so that a last bit decides nothing
COLUMNS = {
    "track_id": "number of the task",
    "t": "s after t0, so 0 for the last row",
    "x": "m, in the recording's frame",
    "y": "m, in the recording's frame",
    "speed": "m/s as recorded, empty where unknown",
    "heading": "rad from the x-axis towards the y-axis, as recorded, empty where unknown",
    "neighbour": "of the task, 0 the nearest at t0; somebody has another number in every task",
}
NEIGHBOUR_LEAK = (
    "neighbours.{form}: a neighbour's rows are part of what another task asks for, or of what it observes: whoever "
    "matches positions learns futures and which tasks are of one moment. Say so where results made with it are shown."
)
LATER_LEAK = "A person is forecast {when}: what a later task of somebody observes is the future of an earlier one."


class Task(NamedTuple):
    """The tasks of a dataset: `about` is what `task.json` says, its key `task` the hash that tells this from others.

    `ids` and `track_id` {recording: [n]} are the numbers of the tasks and whose they are, in the order of the
    recording's windows; `observed` has all tasks in the order of their numbers, with `t` in s after t0.
    """

    about: dict[str, Any]
    ids: dict[str, np.ndarray]
    track_id: dict[str, np.ndarray]
    observed: Observed

    @property
    def start(self) -> np.ndarray:
        """Positions at t0 [n, 2] in m, in the order of the numbers."""
        return np.column_stack([self.observed.x[:, -1], self.observed.y[:, -1]])


def make_task(
    recordings: Iterable[tuple[str, Tracks, Scenes | None, Sequence[Tracks] | None]], site: Site, dataset: str
) -> Task:
    """The task of the recordings of a split: (name, tracks, scenes if it has some, neighbours).

    Neighbours: None, or the tracks of that day's other recordings.
    """
    salt = json.dumps([dataset, float(site.time_step_s), site.observed_rows, float(site.horizon_s)]).encode()
    names, parts, digests, whose, by_scenes = [], [], [], {}, False
    for name, tracks, scenes, others in recordings:
        wanted = windows(tracks, site, scenes)
        by_scenes |= scenes is not None and site.forecast_every_s is None
        first = wanted.row - site.observed_rows + 1
        seen = observe(tracks, first[:, None], site.observed_rows)
        if site.velocity != "as_recorded":  # what was derived from positions tells nothing more
            seen = seen._replace(speed=np.full_like(seen.speed, np.nan), heading=np.full_like(seen.heading, np.nan))
        if others is not None:
            everyone = together([tracks, *others])
            found = find_neighbours(everyone, wanted.row, site.observed_rows, site.time_step_s)
            seen = seen._replace(neighbours=found.xy)
        whose[name] = seen.track_id
        last = wanted.tracks[wanted.of, 1]
        digests += [_digest(salt, tracks, *rows) for rows in zip(first.tolist(), last.tolist(), wanted.t0, strict=True)]
        parts.append(seen._replace(t=seen.t - wanted.t0[:, None]))
        names.append(name)
    if not digests:
        raise DataError(
            f"{dataset}: no track (or scene) has {site.observed_rows + 1} rows without a gap, so there is no task"
        )
    order = np.argsort(np.array(digests), kind="stable")
    number = np.empty(len(order), np.int64)
    number[order] = np.arange(len(order))
    cuts = np.cumsum([len(one.track_id) for one in parts])[:-1]
    observed = Observed(*(np.concatenate(part)[order] for part in zip(*parts, strict=True)))
    observed = observed._replace(track_id=np.arange(len(order)))
    about = {
        "task": _hash(salt, observed),
        "dataset": dataset,
        "tasks": len(order),
        "observed_rows": site.observed_rows,
        "time_step_s": site.time_step_s,
        "horizon_s": site.horizon_s,
        "steps": site.steps,
        "forecast_every_s": site.forecast_every_s,
        "forecast_scenes": by_scenes,
    }
    return Task(about, dict(zip(names, np.split(number, cuts), strict=True)), whose, observed)


def _digest(salt: bytes, tracks: Tracks, first: int, last: int, t0: float) -> bytes:
    """What a task's place is decided by: its person's rows, from the first that is observed to the last."""
    rows = slice(first, last + 1)
    return hashlib.blake2b(salt + _whole(tracks.t[rows] - t0, tracks.x[rows], tracks.y[rows]), digest_size=16).digest()


def _hash(salt: bytes, observed: Observed) -> str:
    return hashlib.sha256(salt + _whole(observed.t, observed.x, observed.y)).hexdigest()


def _whole(*columns: np.ndarray) -> bytes:
    return np.rint(np.stack(columns) * STEPS_PER_UNIT).astype("<i8").tobytes()


def write_task(
    task: Task, folder: str | Path, form: str = "csv", training: Iterable[Tracks] | None = None
) -> list[Path]:
    """Write `task.json`, the observations, neighbours where the task has some, and tracks to train on, if given.

    `form`: csv, parquet, or ndjson, TrajNet++'s lines, in which neighbours stand with the observations. Returns the
    files. Training tracks keep their clock, and have numbers of their own. In the folder of an earlier task its files
    are removed: what was asked for then might tell more than is asked for now.
    """
    if form not in FORMS:
        raise DataError(f"form {form!r}: there are {', '.join(FORMS)}")
    folder, site = Path(folder), task.about
    files, observed = [folder / f"observations.{form}"], task.observed
    with_neighbours = observed.neighbours.shape[1] > 0
    if form == "ndjson":
        write_lines(_scenes(task), files[0])
    else:
        write_columns([observations(task)], files[0], **task.about)
        if with_neighbours:
            files.append(folder / f"neighbours.{form}")
            write_columns([neighbours(task)], files[-1], **task.about)
    if training is not None:
        tracks = together(training)
        files.append(folder / f"training.{form}")
        if form == "ndjson":
            write_lines(tracks_as_lines(tracks, site["time_step_s"]), files[-1])
        else:
            write_columns([tracks_table(tracks)], files[-1])
    leaks = [NEIGHBOUR_LEAK.format(form=form)] if with_neighbours else []
    if task.about["forecast_every_s"] is not None:
        leaks.append(LATER_LEAK.format(when=f"every {task.about['forecast_every_s']:g} s"))
    if task.about["forecast_scenes"]:
        leaks.append(LATER_LEAK.format(when="in every scene of the recording"))
    about = {VERSION: __version__, **task.about, "neighbours": with_neighbours, "columns": COLUMNS, "leaks": leaks}
    files.append(folder / "task.json")
    if files[-1].exists():
        for old in (folder / f"{name}.{of}" for name in ("observations", "neighbours", "training") for of in FORMS):
            if old not in files:
                old.unlink(missing_ok=True)
    write_text(files[-1], json.dumps(as_plain(about), indent=1) + "\n")
    return files


def observations(task: Task) -> pa.Table:
    """What is observed, one row per task and time."""
    rows = task.observed.t.shape[1]
    columns = (part.ravel() for part in task.observed[1:6])
    return tracks_table(Tracks(np.repeat(task.observed.track_id, rows), *columns))


def neighbours(task: Task) -> pa.Table:
    """The neighbours of every task at whole time steps up to t0."""
    xy, step_s = task.observed.neighbours, task.about["time_step_s"]
    who, which, when = np.nonzero(np.isfinite(xy[..., 0]))
    at = xy[who, which, when]
    t = (when - xy.shape[2] + 1) * step_s
    return pa.table({"track_id": who, "neighbour": which, "t": t, "x": at[:, 0], "y": at[:, 1]})


def _scenes(task: Task) -> Iterator[str]:
    """Scenes with the positions of task n at whole time steps as those of person n; neighbours come after all tasks."""
    seen, step_s = task.observed, task.about["time_step_s"]
    own = at_whole_steps(seen, step_s)
    rows = seen.t.shape[1]
    length, other = rows + task.about["steps"], len(seen.track_id)
    for number in seen.track_id.tolist():
        yield scene_line(number, number, number * length, (number + 1) * length - 1, step_s)
    for number in seen.track_id.tolist():
        yield from track_lines(number, number * length, own[number])
        for xy in seen.neighbours[number]:
            if np.isfinite(xy).any():
                yield from track_lines(other, number * length, xy)
                other += 1
