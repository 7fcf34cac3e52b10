"""Is a network's training long enough? It is trained anew with twice the windows until that is no longer much better.

Every training is one of its own, from first weights on and with a checkpoint of its own, since a schedule of the
learning rate fits one length only; its patience is doubled, too, or it would stop before the rate has fallen. Which
one is used may depend on the machine, as far as its time is what ends it.
"""

import logging
from dataclasses import replace
from pathlib import Path
from typing import Any

from modlhmp.kinds import Kind
from modlhmp.networks.data import Day
from modlhmp.networks.training import Trained, train
from modlhmp.options import Learning, Training
from modlhmp.site import Site

GAIN = 0.03  # of the validation ADE, that makes a longer training worth its time
KEPT = (
    "windows", "planned_windows", "iterations", "epochs", "best_epoch", "validation_ade_m", "last_validation_ade_m",
    "minutes", "core_minutes",
)  # fmt: skip


def train_long_enough(
    kind: Kind,
    options: Training,
    days: list[Day],
    site: Site,
    learning: Learning,
    weights: str | Path,
    log: logging.Logger,
    threads: int = 1,
    code: str | None = None,
) -> Trained:
    """`train`, and with `learning.doubling` anew with twice the windows as long as that gains more than 3 %.

    Checkpoints lie beside the file `weights` (`checkpoints`) until `forget`, so that an interrupted job finds those
    trainings again that it has finished. The summary is that of the training used; its `trainings` are all, and
    `convergence` says why no other followed: `outcome` is "not asked", "converged" or "no time", `fall_per_doubling`
    the share by which the last doubling lowered the validation ADE (None before any), `next_core_minutes` what one more
    would take at most.
    """

    def trained(times, windows):
        longer = replace(options, windows=windows, patience=times * options.patience)
        return train(kind, longer, days, site, learning, _checkpoint(weights, times), log, threads, code)

    used, times, fall = trained(1, options.windows), 1, None
    outcome = "converged" if learning.doubling else "not asked"
    trainings = [used.summary]
    while learning.doubling and (fall is None or fall > GAIN):
        spent = sum(one["core_minutes"] for one in trainings)
        if spent + minutes_of_twice(trainings[-1]) > learning.most_minutes:
            outcome = "no time"
            break
        times *= 2
        longer = trained(times, 2 * trainings[-1]["planned_windows"])  # of whole passes over the tracks
        trainings.append(longer.summary)
        fall = 1 - longer.summary["validation_ade_m"] / used.summary["validation_ade_m"]
        log.info("%s: %d times the windows lower the validation ADE by %.1f %%", kind.name, times, 100 * fall)
        used = longer if fall > GAIN else used
    convergence = {
        "outcome": outcome, "fall_per_doubling": fall, "most_core_minutes": learning.most_minutes,
        "next_core_minutes": minutes_of_twice(trainings[-1]),
    }  # fmt: skip
    listed = [{key: one[key] for key in KEPT} for one in trainings]
    return used._replace(summary={**used.summary, "trainings": listed, "convergence": convergence})


def minutes_of_twice(summary: dict[str, Any]) -> float:
    """The most processor minutes that a training with twice the windows of this one will take."""
    return 2 * summary["planned_windows"] * summary["core_minutes"] / summary["windows"]


def checkpoints(weights: str | Path) -> list[Path]:
    """The checkpoints beside a file of weights, one for each of a network's trainings."""
    weights = Path(weights)
    return sorted(weights.parent.glob(f"{weights.stem}.*checkpoint"))


def forget(weights: str | Path) -> None:
    """Delete the checkpoints, once weights and summary are written."""
    for path in checkpoints(weights):
        path.unlink()


def _checkpoint(weights, times):
    """The checkpoint of the training with so many times the windows."""
    return Path(weights).with_suffix(f".{times}.checkpoint" if times > 1 else ".checkpoint")
