"""Neural velocity map: a small network that says of every place and time of day how people walk there.

An independent small version of a published idea (NeMo, a neural map of dynamics from place and time to a mixture of
velocities, arXiv 2510.14827), with a background inside and the local day's harmonics; its numbers are not that work's.
It is built from tracks and written on a lattice in the form of a CLiFF-map, so that whatever reads CLiFF-maps reads it,
without PyTorch; one column more says how little the map knows of a place.
"""

import logging
from pathlib import Path

import numpy as np
import pyarrow as pa

from modlhmp.angles import wrap_angle
from modlhmp.maps import cliff, every_hour
from modlhmp.maps.density import NoMap
from modlhmp.options import NeuralVelocityBuilding, RollOut
from modlhmp.site import Site
from modlhmp.storage import DataError
from modlhmp.tracks import Tracks, clock_time

LEAST_PERSONS = 10


def build_hours(
    tracks: Tracks, site: Site, building: NeuralVelocityBuilding | None = None
) -> tuple[pa.Table | None, dict[int, pa.Table]]:
    """(the map of the whole day, {hour with data: its map in the middle of that hour}), in the form of CLiFF-maps.

    Locations are those of a CLiFF-map of the whole day: the network answers everywhere, but there is no reason to
    believe it where nobody walked. `DataError` with fewer than 10 persons who move.
    """
    building = building or NeuralVelocityBuilding()
    of = every_hour.walked(tracks, site, building)
    if (persons := len(np.unique(of.tracks.track_id))) < LEAST_PERSONS:
        raise DataError(
            f"a neural velocity map needs {LEAST_PERSONS} persons who move, of whom some are held out; the training "
            f"recordings have {persons}"
        )
    said = _said(of, site, building)
    tables = {hour: every_hour.table(of, building, hour, *mixtures) for hour, mixtures in said.items()}
    return tables.pop(None), tables


def _said(of, site, building):
    """{hour, None for the day: (components [m, J, 6], background [m])} of the locations, by a trained network."""
    import torch  # noqa: PLC0415 - only building needs it

    from modlhmp.networks import velocity_net as net  # noqa: PLC0415 - likewise

    tracks, places = of.tracks, of.places
    background = NoMap(tracks.speed).log_density(tracks.x, tracks.y, tracks.t, tracks.heading, tracks.speed)
    nodes, parts = _corners(np.concatenate([np.column_stack([tracks.x, tracks.y]), places]), building.cell_m)
    number, n = nodes.max() + 1, len(tracks.t)
    clock = net.clock_of(clock_time(tracks.t, site.timezone))
    columns = (parts[:n], clock, tracks.heading, tracks.speed, background)
    rows = net.Rows(torch.from_numpy(nodes[:n]), *(torch.from_numpy(one.astype(np.float32)) for one in columns))
    sizes = {"features": building.features, "width": building.width, "components": building.components}
    network = net.train(rows, tracks.track_id, number, sizes, building.epochs, building.seed)
    logging.getLogger("modlhmp").info(
        "neural velocity map: %d parameters, %d rows", sum(one.numel() for one in network.parameters()), n
    )
    at = torch.from_numpy(nodes[n:]), torch.from_numpy(parts[n:].astype(np.float32))
    said = {}
    for when in (None, *of.wanted):
        clock = net.clock_of(np.full(len(places), 12.0 if when is None else when + 0.5))
        with torch.no_grad(), net.one_thread():
            mixture = network(*at, torch.from_numpy(clock * (when is not None)))
        said[when] = _components(*(part.double().numpy() for part in mixture))
    return said


def _corners(xy, cell_m):
    """The four nodes [n, 4] of a grid around each place [n, 2], numbered over all places, and their shares [n, 4]."""
    low = np.floor(xy / cell_m).astype(np.int64)
    part = xy / cell_m - low
    corners = np.array([[0, 0], [0, 1], [1, 0], [1, 1]])
    shares = np.prod(np.where(corners, part[:, None], 1 - part[:, None]), axis=2)
    nodes = (low[:, None] + corners).reshape(-1, 2)
    return np.unique(nodes, axis=0, return_inverse=True)[1].reshape(-1, 4), shares


def _components(log_weight, heading, speed, wide, fast, correlation, background):
    """Components [n, J, 6] and the weight of the background [n]."""
    found = np.stack(
        [np.exp(log_weight), wrap_angle(heading), speed, wide**2, correlation * wide * fast, fast**2], axis=2
    )
    return found, 1 / (1 + np.exp(-background))


def load(path: str | Path | pa.Table, site: Site, options: RollOut) -> cliff.CliffMap:
    """Read an hour's map, which has the form of a CLiFF-map."""
    return cliff.load(path, site, options)


load_whole = load  # as has that of the whole day
