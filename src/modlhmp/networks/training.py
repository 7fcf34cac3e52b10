"""One training loop for all networks: seeded, resumable, stopped early by a validation split, its curve kept."""

import hashlib
import json
import time
from pathlib import Path

import numpy as np
import torch

from modlhmp.networks import network_class
from modlhmp.networks.data import Scenes, training_data
from modlhmp.networks.network import cosine, rotated
from modlhmp.storage import DataError, atomic_path

CURVE = ("epoch", "train_loss", "validation_ade_m", "learning_rate", "seconds")
DRAWING = ("validation", "another_every")  # options of `training_data`, where they are given
TRAINING = ("epochs", "batch_size", "learning_rate", "schedule", "patience", "rotate", *DRAWING)  # others build it
LEAST_TRACKS = 20
VALIDATION_SHARE = 0.1
LENGTH_JITTER = 0.15  # of a track's length, so that batches of like lengths differ from epoch to epoch
BATCH = 512  # tracks validated or forecast at once


def choose_device(wanted):
    """The torch device of `auto`, `cpu` or `cuda`."""
    available = torch.cuda.is_available()
    if wanted == "cuda" and not available:
        raise DataError(
            "configuration, learned.device: cuda was asked for, but PyTorch sees no GPU here (the locked build is for "
            "the CPU; install a CUDA build of the same version); use `auto` or `cpu`"
        )
    torch.backends.cudnn.allow_tf32 = False  # so that a GPU's forecasts are those of the CPU but for rounding
    return torch.device("cuda" if wanted != "cpu" and available else "cpu")


def build_network(kind, options, steps, observed_rows, step_s):
    """A network of a kind from a method's options."""
    sizes = {name: value for name, value in options.items() if name not in {*TRAINING, "k"}}
    try:
        return network_class(kind)(steps, observed_rows, step_s, **sizes)
    except TypeError as error:
        raise DataError(f"configuration: {kind} cannot be built with the options {sizes} ({error})") from None


def train(kind, options, days, dataset, learned, checkpoint, log):
    """Train a network on `days` (`data.Day`s); returns (network with its best weights, curve, summary).

    `options` are the method's for this budget, `learned` the configuration's section (and `code`, the hash of the code,
    where it is known), `dataset` needs `observed_rows`, `horizon_s` and `time_step_s`. After every epoch all that is
    needed to go on is in the file `checkpoint`; one of the same settings, code and positions is taken up, and gives the
    same weights as an undisturbed training.
    """
    torch.set_num_threads(learned["threads"])
    device, shape = choose_device(learned["device"]), _shape(dataset)
    drawing = {name: options[name] for name in DRAWING if name in options}
    data = training_data(days, learned["futures"], VALIDATION_SHARE, learned["seed"], *shape, **drawing,
                         neighbours=network_class(kind).looks_at_neighbours)  # fmt: skip
    if data.tracks < LEAST_TRACKS or not len(data.validation.past):
        raise DataError(
            f"{kind}: {data.tracks} training and {len(data.validation.past)} validation tracks are too few to train on "
            f"(at least {LEAST_TRACKS} and 1); name more training recordings, or leave the method out of `compare`"
        )
    torch.manual_seed(learned["seed"])
    network = build_network(kind, options, *shape)
    network.planned_iterations = options["epochs"] * -(-data.drawn // options["batch_size"])
    fingerprint = _fingerprint(kind, options, learned, days, shape)
    state = load_checkpoint(checkpoint, fingerprint, log)
    if state is None:
        network.prepare(_tensors(data.draw(np.random.default_rng([learned["seed"], 0])), torch.device("cpu")))
        curve, best = [], {"validation_ade_m": np.inf, "epoch": 0, "weights": None}
    else:
        network.load_state_dict(state["weights"])
        curve, best = state["curve"], state["best"]
        log.info("%s: taken up after epoch %d", kind, len(curve))
    network.to(device)
    optimiser = network.optimiser(options["learning_rate"])
    if state is not None:
        optimiser.load_state_dict(state["optimiser"])
    log.info("%s: %d parameters, %d tracks, %d held out", kind, network.parameter_count(), data.tracks,
             len(data.validation.past))  # fmt: skip
    while len(curve) < options["epochs"] and len(curve) - best["epoch"] < options["patience"]:
        began, epoch = time.perf_counter(), len(curve) + 1
        loss, rate = _one_epoch(network, optimiser, data, options, learned["seed"], epoch, device)
        if not np.isfinite(loss):
            raise DataError(f"{kind}: the loss of epoch {epoch} is not finite; lower learning_rate (now {rate:g})")
        error = validate(network, data.validation, device)
        row = (epoch, loss, error, rate, time.perf_counter() - began)
        curve.append(dict(zip(CURVE, row, strict=True)))
        if error < best["validation_ade_m"]:
            weights = {name: value.detach().cpu().clone() for name, value in network.state_dict().items()}
            best = {"validation_ade_m": error, "epoch": epoch, "weights": weights}
        _save(checkpoint, {"fingerprint": fingerprint, "weights": network.state_dict(), "curve": curve, "best": best,
                           "optimiser": optimiser.state_dict()})  # fmt: skip
        left = (options["epochs"] - epoch) * np.mean([one["seconds"] for one in curve])
        log.info("%s: epoch %d of %d, loss %.4g, validation ADE %.3f m, %.1f s, at most %s left",
                 kind, epoch, options["epochs"], loss, error, row[-1], _minutes(left))  # fmt: skip
    network.load_state_dict(best["weights"])
    summary = {
        "parameters": network.parameter_count(), "tracks": data.tracks, "validation_tracks": len(data.validation.past),
        "epochs": len(curve), "planned_epochs": options["epochs"], "best_epoch": best["epoch"],
        "validation_ade_m": best["validation_ade_m"], "device": device.type, "threads": learned["threads"],
        "minutes": sum(row["seconds"] for row in curve) / 60, "futures": learned["futures"],
    }  # fmt: skip
    return network, curve, summary


def batches(scenes, size, rng):
    """Scenes in batches of like length of truth, in random order."""
    lengths = scenes.lengths()
    order = np.argsort(lengths * (1 + LENGTH_JITTER * rng.standard_normal(len(lengths))), kind="stable")
    parts = [order[start : start + size] for start in range(0, len(order), size)]
    for part in rng.permutation(len(parts)):
        yield scenes.take(parts[part])


def validate(network, scenes, device):
    """Mean ADE in m over tracks, each up to its own length."""
    network.eval()
    errors = []
    with torch.no_grad():
        for start in range(0, len(scenes.past), BATCH):
            batch = _tensors(scenes.take(slice(start, start + BATCH)), device)
            errors.append(network.validation_error(batch).cpu())
    return float(torch.cat(errors).mean())


def load_checkpoint(path, fingerprint, log):
    """The state of an interrupted training of the same settings, None if there is none."""
    if not Path(path).exists():
        return None
    try:
        state = torch.load(path, weights_only=True, map_location="cpu")
    except Exception as error:  # whatever is wrong with it, training starts anew
        log.warning("%s cannot be read (%s); training starts anew", path, _reason(error))
        return None
    if not isinstance(state, dict) or state.get("fingerprint") != fingerprint:
        log.warning("%s is of another configuration; training starts anew", path)
        return None
    return state


def save_network(path, kind, options, dataset, network):
    """Write the weights and what the network was built from."""
    settings = {"kind": kind, "options": options, "shape": _shape(dataset)}
    _save(path, {"settings": json.dumps(settings, sort_keys=True), "weights": network.state_dict()})


def load_network(path, kind, options, dataset):
    """The trained network of a method; `DataError` if the file is of another configuration."""
    try:
        stored = torch.load(path, weights_only=True, map_location="cpu")
        settings = json.loads(stored["settings"])
    except Exception as error:
        raise DataError(f"{path}: cannot be read as weights ({_reason(error)}); delete it and run again") from None
    for key, value in {"kind": kind, "options": options, "shape": list(_shape(dataset))}.items():
        if settings.get(key) != value:
            raise DataError(
                f"{path}: trained with {key} {settings.get(key)}, but the configuration says {value}; "
                "delete it and run again"
            )
    network = build_network(kind, options, *_shape(dataset))
    network.load_state_dict(stored["weights"])
    return network.eval()


def _one_epoch(network, optimiser, data, options, seed, epoch, device):
    """Train for one epoch, whose random numbers are its own; returns the mean loss and the last learning rate."""
    torch.manual_seed(int.from_bytes(hashlib.blake2b(f"{seed} {epoch}".encode(), digest_size=7).digest(), "little"))
    rng = np.random.default_rng([seed, epoch])
    factor = cosine if options["schedule"] == "cosine" else network.decay
    first = (epoch - 1) * network.planned_iterations // options["epochs"]
    losses = []
    network.train()
    for number, batch in enumerate(batches(data.draw(rng), options["batch_size"], rng)):
        rate = options["learning_rate"] * factor((first + number) / network.planned_iterations)
        for group in optimiser.param_groups:
            group["lr"] = rate
        tensors = _tensors(batch, device)
        if options["rotate"] and network.turns is not None:
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


def _shape(dataset):
    """Steps to the horizon, observed rows and time step [s]."""
    return round(dataset["horizon_s"] / dataset["time_step_s"]), dataset["observed_rows"], dataset["time_step_s"]


def _fingerprint(kind, options, learned, days, shape):
    """A hash of all that decides the weights: settings, code where it is known, and everyone's positions."""
    settings = [kind, options, learned["futures"], learned["seed"], learned.get("code"), shape]
    digest = hashlib.sha256(json.dumps(settings, sort_keys=True).encode())
    for day in days:
        digest.update(day.timezone.encode())
        for part in (*day.tracks[:4], day.rows):
            digest.update(np.ascontiguousarray(part))
    return digest.hexdigest()


def _reason(error):
    """First line of an error's text, its name if it has none."""
    return next(iter(str(error).splitlines()), type(error).__name__)


def _save(path, content):
    with atomic_path(path) as temporary:
        torch.save(content, temporary)


def _minutes(seconds):
    return f"{seconds / 60:.1f} min" if seconds >= 60 else f"{seconds:.0f} s"
