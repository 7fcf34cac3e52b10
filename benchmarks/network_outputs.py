"""Would another way to read a trained network's output change its errors? On test tracks of one recording.

    .venv/bin/python benchmarks/network_outputs.py results/real/atc_1day atc-20121024-1hz-test atc-20121024-1hz-train

The arguments are a dataset's folder of a run, a test recording, and the others of its day. Compared are Trajectron++'s
most likely latent value (what we score) with the most likely velocity of its whole mixture at every step, and MID's
five DDIM steps (what we score) with all hundred of DDPM.
"""

import sys
from pathlib import Path

import numpy as np
import torch

from modlhmp.kinds import find
from modlhmp.networks import mid
from modlhmp.networks.data import Scenes, day_of, scenes_at
from modlhmp.networks.network import track_ade
from modlhmp.networks.training import build_network
from modlhmp.networks.trajectronpp import mixture_log_density, moments_of
from modlhmp.networks.weights import read_weights
from modlhmp.settings import build
from modlhmp.site import Site
from modlhmp.streams import stream_keys
from modlhmp.tracks import read_tracks

TRACKS, SAMPLES = 300, 5


def load(folder, method):
    """A trained network and the site that its scenes are of, whatever the configuration."""
    weights, settings = read_weights(folder / "models" / f"{method}.safetensors")
    kind, (steps, observed_rows, step_s) = find(settings["kind"]), settings["shape"]
    site = Site(time_step_s=step_s, horizon_s=steps * step_s, observed_rows=observed_rows)
    network = build_network(kind, build(kind.options, settings["options"]), site)
    network.load_state_dict(weights)
    return network.eval(), site


def likeliest_velocities(network, past, present):
    """At every step the mean, of all latent values, where the velocity mixture is densest; integrated."""
    context, now = network.encoder(past, present)
    log_prior = torch.log_softmax(network.prior(context), -1)
    mean, log_sigma, correlation = network.decode(context, now, torch.arange(network.modes), network.steps, False)
    moments = moments_of(log_sigma, correlation)
    density = torch.stack(
        [
            torch.logsumexp(log_prior[..., None] + mixture_log_density(mean[:, k : k + 1], mean, moments), 1)
            for k in range(network.modes)
        ],
        1,
    )
    best = density.argmax(1)[:, None, :, None].expand(-1, 1, -1, 2)
    return network.step_s * mean.gather(1, best).cumsum(2)


def all_steps(network, past, present, keys):
    """MID's paths by DDPM from the same starting noise."""
    start = torch.from_numpy(mid.noise_of(keys.ravel(), network.steps)).to(past)
    context = network.encoder(past, present)[0].repeat_interleave(keys.shape[1], 0)
    velocity = mid.ddpm(lambda x, t: network.noise(x, t, context), start, torch.Generator().manual_seed(0))
    return network.step_s * velocity.cumsum(1).view(*keys.shape, network.steps, 2)


def show(name, paths, scenes, steps):
    """Print mean ADE / FDE at some horizons, on the tracks that reach them, and ADE at the tracks' own lengths."""
    truth, there = scenes.future[:, 0], scenes.future_present[:, 0]
    cells = []
    for horizon in [h for h in (5, 10, 20, 60) if h <= steps]:
        long = there[:, horizon - 1]
        away = torch.linalg.vector_norm(paths[long] - truth[long, None], dim=-1)[..., :horizon]
        cells.append(f"{horizon} s {away.mean():.2f} / {away[..., -1].mean():.2f} (n {int(long.sum())})")
    own = torch.stack([track_ade(path, truth, there).mean() for path in paths.unbind(1)]).mean()
    print(f"{name:40s} own length {own:.3f}   " + "   ".join(cells), flush=True)


def main(folder, recording, *others):
    """Print one line per output."""
    torch.manual_seed(0)
    folder = Path(folder)
    own, *rest = (read_tracks(folder / "tracks" / f"{name}.parquet") for name in (recording, *others))
    for method in ("trajectronpp", "mid"):
        network, site = load(folder, method)
        day, steps = day_of(own, rest, site), site.steps
        rows = day.rows[np.random.default_rng(0).permutation(len(day.rows))[:TRACKS]]
        scenes = Scenes(
            *map(torch.from_numpy, scenes_at(day, rows[:, 0], rows[:, 1], steps, site.observed_rows, site.time_step_s))
        )
        scenes = scenes.take(scenes.lengths() > 0)
        seen = scenes.past, scenes.past_present
        with torch.no_grad():
            if method == "trajectronpp":
                show("Trajectron++, likeliest latent value", network.forecast(*seen, None), scenes, steps)
                show("Trajectron++, likeliest velocities", likeliest_velocities(network, *seen), scenes, steps)
            else:
                keys = stream_keys(np.arange(len(scenes.past)), SAMPLES, "outputs")
                five = network.forecast(*seen, torch.from_numpy(keys.view(np.int64)))
                show("MID, 5 steps of DDIM", five, scenes, steps)
                show("MID, 100 steps of DDPM", all_steps(network, *seen, keys), scenes, steps)


if __name__ == "__main__":
    main(*sys.argv[1:])
