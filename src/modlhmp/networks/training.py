"""One training loop for all networks: seeded, resumable, stopped early by held-out persons, its curve kept."""

import dataclasses
import hashlib
import io
import json
import logging
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch

from modlhmp.kinds import Kind
from modlhmp.networks.data import Day, Scenes, TrainingData, training_data
from modlhmp.networks.network import Base, cosine, rotated
from modlhmp.networks.weights import read_weights, write_weights
from modlhmp.options import Learning, Training
from modlhmp.settings import as_plain
from modlhmp.site import Site
from modlhmp.storage import DataError, atomic_path

CURVE = ("epoch", "windows", "train_loss", "validation_ade_m", "learning_rate", "seconds", "core_seconds")
NOT_SIZES = {*(field.name for field in dataclasses.fields(Training)), "k"}  # other options build the network
LEAST_TRACKS = 20
VALIDATION_SHARE = 0.1
LENGTH_JITTER = 0.15  # of a track's length, so that batches of like lengths differ from epoch to epoch
_DIGEST_BYTES = hashlib.sha256().digest_size
BATCH = 512  # tracks validated or forecast at once


class Trained(NamedTuple):
    """A network with the weights of its best epoch, its learning curve, how it went, and its last epoch's weights."""

    network: Base
    curve: list[dict[str, float]]
    summary: dict[str, Any]
    last: dict[str, torch.Tensor]


class Length(NamedTuple):
    """How long a training goes on: at most so many epochs, so many without a gain, each of so many iterations."""

    epochs: int
    patience: int
    iterations: int


def choose_device(wanted: str) -> torch.device:
    """The torch device of `auto`, `cpu` or `cuda`."""
    available = torch.cuda.is_available()
    if wanted == "cuda" and not available:
        raise DataError(
            "configuration, learned.device: cuda was asked for, but PyTorch sees no GPU here (the locked build is for "
            "the CPU; install a CUDA build of the same version); use `auto` or `cpu`"
        )
    torch.backends.cudnn.allow_tf32 = False  # so that a GPU's forecasts are those of the CPU but for rounding
    return torch.device("cuda" if wanted != "cpu" and available else "cpu")


def build_network(kind: Kind, options: Training, site: Site) -> Base:
    """A network of a kind, of the sizes that a method's options say."""
    sizes = {f.name: getattr(options, f.name) for f in dataclasses.fields(options) if f.name not in NOT_SIZES}
    return kind.implementation().Network(*_shape(site), **sizes)


@contextmanager
def flushing() -> Iterator[None]:
    """Numbers below 1e-38 are zero: weight decay drives unused weights there, where products take 30 times longer."""
    before = torch.tensor(1e-40).mul(1.0).item() == 0  # torch does not tell otherwise
    torch.set_flush_denormal(True)
    try:
        yield
    finally:
        torch.set_flush_denormal(before)


@flushing()
def train(
    kind: Kind,
    options: Training,
    days: list[Day],
    site: Site,
    learning: Learning,
    checkpoint: str | Path,
    log: logging.Logger,
    threads: int = 1,
    code: str | None = None,
) -> Trained:
    """Train a network on `days` (`data.Day`s).

    An epoch is one pass over the tracks, which looks at one window of each (`TrainingData.draw`) and ends with a
    validation; there are as many as the options' `windows` need.
    `code` is the hash of the code, where it is known. After every epoch all that is needed to go on is in the file
    `checkpoint`; one of the same settings, code and positions is taken up, and gives the same weights as an undisturbed
    training. `DataError` if there are too few tracks, or the loss is not finite.
    """
    torch.set_num_threads(threads)
    device, shape = choose_device(learning.device), _shape(site)
    data = _data(kind, options, learning, days, shape)
    torch.manual_seed(learning.seed)
    network = build_network(kind, options, site)
    length = _length(options, data.drawn)
    network.planned_iterations = length.epochs * length.iterations
    fingerprint = _fingerprint(kind, options, learning, code, days, shape)
    state = load_checkpoint(checkpoint, fingerprint, log)
    curve, best = _first_epochs(network, data, learning.seed, state)
    if state is not None:
        log.info("%s: continues after epoch %d", kind.name, len(curve))
    network.to(device)
    optimiser = network.optimiser(options.learning_rate)
    if state is not None:
        optimiser.load_state_dict(state["optimiser"])
    sizes = _sizes(network, data)
    log.info("%s: %d parameters, %d tracks, %d held out", kind.name, *sizes.values())
    while len(curve) < length.epochs and len(curve) - best["epoch"] < length.patience:
        began, worked, epoch = time.perf_counter(), time.process_time(), len(curve) + 1
        loss, rate = _one_epoch(network, optimiser, data, options, learning.seed, epoch, device)
        if not np.isfinite(loss):
            raise DataError(f"{kind.name}: the loss of epoch {epoch} is not finite; lower learning_rate (now {rate:g})")
        error = validate(network, data.validation, device)
        taken = (time.perf_counter() - began, time.process_time() - worked)
        curve.append(dict(zip(CURVE, (epoch, epoch * data.drawn, loss, error, rate, *taken), strict=True)))
        if error < best["validation_ade_m"]:
            best = {"validation_ade_m": error, "epoch": epoch, "weights": _weights(network)}
        state = {"fingerprint": fingerprint, "weights": network.state_dict(), "curve": curve, "best": best}
        save_checkpoint(checkpoint, {**state, "optimiser": optimiser.state_dict()})
        left = (length.epochs - epoch) * np.mean([one["seconds"] for one in curve])
        log.info("%s: epoch %d of %d, loss %.4g, validation ADE %.3f m, %.1f s, at most %s left",
                 kind.name, epoch, length.epochs, loss, error, taken[0], _minutes(left))  # fmt: skip
    last = _weights(network)
    network.load_state_dict(best["weights"])
    summary = {**sizes, **_course(curve, best, length), "device": device.type, "threads": threads,
               "futures": learning.futures, "seed": learning.seed}  # fmt: skip
    return Trained(network, curve, summary, last)


def _length(options: Training, drawn: int) -> Length:
    """How long a training goes on that looks at `drawn` windows per pass over its tracks."""
    epochs, patience = (-(-windows // drawn) for windows in (options.windows, options.patience))
    return Length(epochs, patience, -(-drawn // options.batch_size))


def _course(curve: list[dict[str, float]], best: dict[str, Any], length: Length) -> dict[str, Any]:
    """How a training went: what was run of what was planned, its best and its last epoch, and what it took."""
    per_epoch = int(curve[0]["windows"])
    return {
        "windows": len(curve) * per_epoch, "planned_windows": length.epochs * per_epoch,
        "iterations": len(curve) * length.iterations, "planned_iterations": length.epochs * length.iterations,
        "epochs": len(curve), "planned_epochs": length.epochs, "best_epoch": best["epoch"],
        "validation_ade_m": best["validation_ade_m"], "last_validation_ade_m": curve[-1]["validation_ade_m"],
        "minutes": sum(row["seconds"] for row in curve) / 60,
        "core_minutes": sum(row["core_seconds"] for row in curve) / 60,
    }  # fmt: skip


def _data(
    kind: Kind, options: Training, learning: Learning, days: list[Day], shape: tuple[int, int, float]
) -> TrainingData:
    """Who is trained on and who is held out; `DataError` if there are too few of either."""
    data = training_data(
        days, learning.futures, VALIDATION_SHARE, learning.seed, *shape, held_out=options.held_out,
        neighbours=kind.implementation().Network.looks_at_neighbours, another_every=options.another_every,
    )  # fmt: skip
    if data.tracks < LEAST_TRACKS or not len(data.validation.past):
        raise DataError(
            f"{kind.name}: {data.tracks} training and {len(data.validation.past)} validation tracks are too few to "
            f"train on (at least {LEAST_TRACKS} and 1); name more training recordings, or leave the method out of "
            "`compare`"
        )
    return data


def _first_epochs(
    network: Base, data: TrainingData, seed: int, state: dict[str, Any] | None
) -> tuple[list[dict[str, float]], dict[str, Any]]:
    """Prepare a network for its first epoch, or take up a checkpoint's `state`; the curve and the best epoch so far."""
    if state is not None:
        network.load_state_dict(state["weights"])
        return state["curve"], state["best"]
    network.prepare(_tensors(data.draw(np.random.default_rng([seed, 0])), torch.device("cpu")))
    return [], {"validation_ade_m": np.inf, "epoch": 0, "weights": None}


def _sizes(network: Base, data: TrainingData) -> dict[str, int]:
    """How large a network is, and how many tracks are trained on and held out."""
    return {
        "parameters": network.parameter_count(),
        "tracks": data.tracks,
        "validation_tracks": len(data.validation.past),
    }


def batches(scenes: Scenes, size: int, rng: np.random.Generator) -> Iterator[Scenes]:
    """Scenes in batches of like length of truth, in random order."""
    lengths = scenes.lengths()
    order = np.argsort(lengths * (1 + LENGTH_JITTER * rng.standard_normal(len(lengths))), kind="stable")
    parts = [order[start : start + size] for start in range(0, len(order), size)]
    for part in rng.permutation(len(parts)):
        yield scenes.take(parts[part])


def validate(network: Base, scenes: Scenes, device: torch.device) -> float:
    """Mean ADE in m over tracks, each up to its own length."""
    network.eval()
    errors = []
    with torch.no_grad():
        for start in range(0, len(scenes.past), BATCH):
            batch = _tensors(scenes.take(slice(start, start + BATCH)), device)
            errors.append(network.validation_error(batch).cpu())
    return float(torch.cat(errors).mean())


def save_checkpoint(path: str | Path, state: dict[str, Any]) -> None:
    """Write a checkpoint behind its digest: torch would read damaged numbers."""
    torch.save(state, content := io.BytesIO())
    with atomic_path(path) as temporary:
        temporary.write_bytes(hashlib.sha256(content.getvalue()).digest() + content.getvalue())


def load_checkpoint(path: str | Path, fingerprint: str, log: logging.Logger) -> dict[str, Any] | None:
    """The state of an interrupted training of the same settings, None if there is none."""
    if not Path(path).exists():
        return None
    try:
        digest, content = (whole := Path(path).read_bytes())[:_DIGEST_BYTES], whole[_DIGEST_BYTES:]
        if hashlib.sha256(content).digest() != digest:
            raise ValueError("it is not as it was written")
        state = torch.load(io.BytesIO(content), weights_only=True, map_location="cpu")
    except Exception as error:  # whatever is wrong with it, training starts anew
        log.warning("%s cannot be read (%s); training starts anew", path, _reason(error))
        return None
    if not isinstance(state, dict) or state.get("fingerprint") != fingerprint:
        log.warning("%s is of another configuration; training starts anew", path)
        return None
    return state


def save_network(
    path: str | Path, kind: Kind, options: Training, site: Site, weights: Mapping[str, torch.Tensor]
) -> None:
    """Write a network's weights (its `state_dict`) and what it was built from."""
    write_weights(path, weights, {"kind": kind.name, "options": as_plain(options), "shape": _shape(site)})


def load_network(path: str | Path, kind: Kind, options: Training, site: Site) -> Base:
    """The trained network of a method; `DataError` if the file is damaged, or of another configuration."""
    weights, settings = read_weights(path)
    for key, value in {"kind": kind.name, "options": as_plain(options), "shape": list(_shape(site))}.items():
        if settings.get(key) != value:
            raise DataError(
                f"{path}: trained with {key} {settings.get(key)}, but the configuration says {value}; "
                "delete it and run again"
            )
    network = build_network(kind, options, site)
    try:
        network.load_state_dict(weights)
    except RuntimeError as error:
        raise DataError(f"{path}: of another network ({_reason(error)}); delete it and run again") from None
    return network.eval()


def _weights(network):
    """A copy of a network's weights on the CPU."""
    return {name: value.detach().cpu().clone() for name, value in network.state_dict().items()}


def _one_epoch(network, optimiser, data, options, seed, epoch, device):
    """Train for one epoch, whose random numbers are its own; returns the mean loss and the last learning rate."""
    torch.manual_seed(int.from_bytes(hashlib.blake2b(f"{seed} {epoch}".encode(), digest_size=7).digest(), "little"))
    rng = np.random.default_rng([seed, epoch])
    factor = cosine if options.schedule == "cosine" else network.decay
    first = (epoch - 1) * _length(options, data.drawn).iterations
    losses = []
    network.train()
    for number, batch in enumerate(batches(data.draw(rng), options.batch_size, rng)):
        rate = options.learning_rate * factor((first + number) / network.planned_iterations)
        for group in optimiser.param_groups:
            group["lr"] = rate
        tensors = _tensors(batch, device)
        if options.rotate and network.turns is not None:
            tensors = rotated(tensors, _angles(len(batch.past), network.turns).to(device))
        optimiser.zero_grad()
        loss = network.loss(tensors)
        loss.backward()
        network.clip()
        optimiser.step()
        losses.append(float(loss.detach()))
    return float(np.mean(losses)), rate


def _angles(n, turns):
    """Random angles [n] in rad, multiples of a circle's part where `turns` is not 0."""
    share = torch.randint(turns, (n,)) / turns if turns else torch.rand(n)
    return 2 * np.pi * share


def _tensors(scenes, device):
    return Scenes(*(torch.from_numpy(part).to(device) for part in scenes))


def _shape(site):
    """Steps to the horizon, observed rows and time step [s]."""
    return site.steps, site.observed_rows, site.time_step_s


def _fingerprint(kind, options, learning, code, days, shape):
    """A hash of all that decides the weights: settings, code where it is known, and everyone's positions."""
    settings = [kind.name, as_plain(options), learning.futures, learning.seed, code, shape]
    digest = hashlib.sha256(json.dumps(settings, sort_keys=True).encode())
    for day in days:
        digest.update(day.timezone.encode())
        for part in (*day.tracks[:4], day.rows, day.persons()):
            digest.update(np.ascontiguousarray(part))  # type: ignore[arg-type]
    return digest.hexdigest()


def _reason(error):
    """First line of an error's text, its name if it has none."""
    return next(iter(str(error).splitlines()), type(error).__name__)


def _minutes(seconds):
    return f"{seconds / 60:.1f} min" if seconds >= 60 else f"{seconds:.0f} s"
