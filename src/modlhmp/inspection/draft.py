"""A draft of the dataset file of a recording, to be edited: it loads, and says in comments what a human must decide."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import yaml

from modlhmp.file_format import Split
from modlhmp.inspection.facts import Facts
from modlhmp.inspection.guess import Guess
from modlhmp.splits import in_split
from modlhmp.tracks import usual_step

HORIZONS_S = (60, 30, 20, 10, 5)
SHORT_S = (0.25, 0.8)  # between rows that are worth a step each, as of ETH/UCY and THOR
LEAST_PER_SPLIT = 5  # tracks; and a tenth of them
_KEYS = (
    *("reader", "file_is", "columns", "header", "separator", "decimal", "thousands", "comment", "skip_lines"),
    *("only", "without", "missing", "units", "frame_rate", "scale", "origin_m"),
)


class Listed(NamedTuple):
    """Files as a dataset file lists them: their path or glob under the data root, the first day and how many."""

    files: str
    day: str = ""
    days: int = 1


def time_step(step_s: float) -> float:
    """The time step for rows so far apart [s]: 1 s, or theirs if they are farther apart."""
    return 1.0 if not step_s > 1.25 else float(f"{step_s:.2g}")


def draft(title: str, listed: Sequence[Listed], guess: Guess, facts: Facts, remark: str = "") -> str:
    """The text of the dataset file; `listed` are the files, of which `facts` are one's; `remark` is said of them."""
    keys, step = guess.keys, facts.form.time_step_s
    lines = [
        "# Drafted by `modlhmp inspect`. What says `decide` could not be read from the file.",
        _line("title", title, "decide: the name in tables and figures"),
        _line("timezone", facts.form.timezone, "decide: that of the place, such as Europe/Stockholm"
              + ("; then correct `day` below" if guess.clock else "")),
    ]  # fmt: skip
    if not guess.clock:
        lines.append(_line("clock", "unknown", 'decide: if day and hour are known, leave this out and add `day: '
                           '2026-03-02, start: "09:00"` below'))  # fmt: skip
    lines += ["recordings:" + (f"  # {remark}" if remark else "")]
    tested = max(-(-len(listed) // 4), 1)  # of several files the last quarter
    for number, one in enumerate(listed):
        entry: dict[str, Any] = {"files": one.files}
        if guess.clock:
            entry |= {"day": one.day} | ({"days": one.days} if one.days > 1 else {})
        side = "test" if number >= len(listed) - tested else "train"
        entry["split"] = side if len(listed) > 1 else _split(facts)
        asked = "which are tested on?" if len(listed) > 1 else "other files as well? Then whole days or files as test"
        lines.append(f"  - {_flow(entry)}" + (f"  # decide: {asked}" if not number else ""))
    lines += [_line(key, keys[key], f"decide: {guess.asks[key]}" if key in guess.asks else "")
              for key in _KEYS if key in keys]  # fmt: skip
    lines += [f"# {note}" for note in guess.notes]
    rate = usual_step(facts.raw)
    if SHORT_S[0] < rate < SHORT_S[1] and not facts.form.has_velocity:
        lines.append(
            f"# A row every {rate:.2g} s: for steps as short, `time_step_s: {rate:.2g}` and `observed_rows: 8`"
        )
    if step != 1.0:
        lines.append(_line("time_step_s", step, "the file has rows so far apart"))
    lines += [
        _line("horizon_s", _horizon(facts), "decide: a tenth of the tracks last so long or longer"),
        _line("velocity", "as_recorded" if facts.form.has_velocity else "differences"),
        _line("citation", "...", "decide: whom to cite"),
        _line("terms", "...", "decide: the terms of use"),
    ]
    told = [f"# looks wrong: {line}" for one in facts.findings for line in str(one).splitlines()]
    return "\n".join([*lines, *told]) + "\n"


def _line(key: str, value: Any, remark: str = "") -> str:
    return f"{key}: {_flow(value)}" + (f"  # {remark}" if remark else "")


def _flow(value: Any) -> str:
    """A value as YAML in one line."""
    text = yaml.safe_dump(value, default_flow_style=True, sort_keys=False, width=10_000, allow_unicode=True)
    return text.strip().removesuffix("...").strip()


def _horizon(facts: Facts) -> float | int:
    """The longest horizon that a tenth of the tracks reach, in whole time steps."""
    bounds, step = facts.clean.bounds(), facts.form.time_step_s
    if len(bounds) == 1:
        return 10
    lasting = float(np.quantile(facts.clean.t[bounds[1:] - 1] - facts.clean.t[bounds[:-1]], 0.9)) - 3 * step
    wanted = next((one for one in HORIZONS_S if one <= lasting), min(HORIZONS_S))
    found = max(round(wanted / step), 1) * step
    return int(found) if found == int(found) else round(found, 6)


def _split(facts: Facts) -> dict[str, Any]:
    """By time, so that the test comes after the training, unless that leaves too few on one side."""
    for by in ("time", "person"):
        chosen = Split(by=by)  # type: ignore[arg-type]
        sides = [in_split(facts.clean, replace(facts.recording, chosen=chosen, side=one)) for one in ("train", "test")]
        counts = [int(side.sum()) for side in sides]
        if min(counts) >= max(LEAST_PER_SPLIT, 0.1 * sum(counts)):
            break
    return {"by": by, "test": 0.25}
