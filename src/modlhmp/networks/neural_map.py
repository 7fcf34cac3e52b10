"""Neural map: a small network that reads learned maps of the place where the walker is and of the way ahead.

A map holds learned numbers in cells of x, y and heading, and is read by interpolation: a map of dynamics like the
others, but one whose cells say whatever helps the forecast. A perceptron turns what the maps say and the observed
displacements into the whole path. Without maps (`grids: []`) it is the same network not knowing the place, though it
knows the axes of the building; what the maps are worth is what it lacks.
"""

import math

import torch
from torch import Tensor, nn

from modlhmp.forecasting.observe import observation_weights
from modlhmp.networks.data import Scenes
from modlhmp.networks.network import Base, trimmed, truth_of

LOOK_AHEAD_S = (0.0, 2.0, 5.0)  # the maps are read where the walker is, and will be at the present velocity
OUTSIDE = 0.001  # share of the training positions beyond each edge of the maps: strays cost no memory
FIRST_SD = 0.01  # of a map's numbers before training
SLOWEST, FASTEST = 0.8, 1.25  # augmentation: times the real pace
SHIFT_SD_M = 0.6  # augmentation: of the place where the maps are read
DROPOUT = 0.1  # of units and of what the maps say
DECAY, DECAY_MAP = 0.01, 0.3  # weight decay; stronger for the maps, of which a walker touches little


class Grid(nn.Module):
    """Learned numbers [channels, headings, rows, columns] at nodes every `cell_m` from `corner` (x, y) in m.

    How many rows and columns depends on the training area (`cover`); stored weights bring theirs.
    """

    corner: Tensor

    def __init__(self, cell_m, headings, channels):
        super().__init__()
        self.cell_m = cell_m
        self.register_buffer("corner", torch.zeros(2))
        self.numbers = nn.Parameter(torch.zeros(channels, headings, 2, 2))
        self.register_load_state_dict_pre_hook(_make_room)

    def cover(self, low: Tensor, high: Tensor) -> None:
        """Reach from corner `low` to corner `high` [2] in m, and a cell further on each side."""
        columns, rows = (torch.ceil((high - low) / self.cell_m).long() + 3).tolist()
        self.corner.copy_(low - self.cell_m)
        shape = (*self.numbers.shape[:2], rows, columns)
        self.numbers = nn.Parameter(FIRST_SD * torch.randn(shape, dtype=self.numbers.dtype))

    def forward(self, xy: Tensor, heading: Tensor) -> Tensor:
        """What the map says [n, channels] at `xy` [n, 2] in m and `heading` [n] in rad.

        Linear between nodes, round the circle in heading; beyond the outermost nodes it fades to 0 within a cell.
        """
        headings, rows, columns = self.numbers.shape[1:]
        turn = torch.remainder(heading / (2 * math.pi), 1.0) * headings
        node = torch.cat([(xy - self.corner) / self.cell_m, turn[:, None]], -1)
        circle = torch.cat([self.numbers, self.numbers[:, :1]], 1)  # the first heading is also the last
        last = node.new_tensor([columns - 1, rows - 1, headings])
        at = (2 * node / last - 1).clamp(-4, 4)  # from -1 to 1 over the nodes; nothing is known beyond 3
        read = nn.functional.grid_sample(circle[None], at[None, :, None, None], align_corners=True)
        return read[0, :, :, 0, 0].T


class Network(Base):
    """`grids`: the maps' cell sizes in m; `headings`, `channels`: of a map; `width`: of the perceptron's two layers.

    `time_of_day` shows it the clock.
    """

    looks_at_neighbours = False
    weights: Tensor

    def __init__(
        self, steps, observed_rows, step_s,
        grids=(1.0, 2.5, 6.0), headings=8, channels=4, width=256, time_of_day=False,
    ):  # fmt: skip
        super().__init__(steps, observed_rows, step_s)
        self.time_of_day = time_of_day
        self.maps = nn.ModuleList(Grid(cell_m, headings, channels) for cell_m in grids)
        inputs = 2 * (observed_rows - 1) + 3 + 2 * time_of_day + channels * len(grids) * len(LOOK_AHEAD_S)
        self.drop = nn.Dropout(DROPOUT)
        self.layers = nn.Sequential(
            nn.Linear(inputs, width), nn.SiLU(), nn.Dropout(DROPOUT),
            nn.Linear(width, width), nn.SiLU(), nn.Dropout(DROPOUT),
            nn.Linear(width, 2 * steps),
        )  # fmt: skip
        newest_last = observation_weights(observed_rows - 1)[::-1].copy()
        self.register_buffer("weights", torch.from_numpy(newest_last).float(), persistent=False)

    def prepare(self, scenes: Scenes) -> None:
        """Let the maps cover where people walk."""
        xy = torch.cat([scenes.past[:, 0], scenes.future[:, 0]], 1) + scenes.where[:, None, :2]
        there = torch.cat([scenes.past_present[:, 0], scenes.future_present[:, 0]], 1)
        by_size = xy[there].sort(0).values
        low, high = (by_size[round(share * (len(by_size) - 1))] for share in (OUTSIDE, 1 - OUTSIDE))
        for grid in self.maps:
            grid.cover(low, high)  # type: ignore[operator]

    def paths(self, past: Tensor, where: Tensor) -> Tensor:
        """Positions [n, steps, 2] of walkers from what they did, `past` [n, O, 2], and `where` [n, 3].

        Up to every step they go on at the present velocity, a weighted mean, plus what the network changes of it [m/s].
        So what it says of the next seconds is small by itself.
        """
        velocity = past.diff(dim=1) / self.step_s
        now = (self.weights[:, None] * velocity).sum(1)
        speed, heading = torch.linalg.vector_norm(now, dim=-1), torch.atan2(now[:, 1], now[:, 0])
        seen = [velocity.flatten(1), torch.stack([speed, torch.sin(heading), torch.cos(heading)], -1)]
        if self.time_of_day:
            angle = where[:, 2:] * (2 * math.pi / 24)
            seen += [torch.sin(angle), torch.cos(angle)]
        for grid in self.maps:
            seen += [self.drop(grid(where[:, :2] + ahead * now, heading)) for ahead in LOOK_AHEAD_S]
        change = self.layers(torch.cat(seen, -1)).view(len(past), self.steps, 2)
        seconds = self.step_s * torch.arange(1, self.steps + 1, dtype=past.dtype, device=past.device)
        return seconds[:, None] * (now[:, None] + change)

    def loss(self, scenes: Scenes) -> Tensor:
        """Mean distance of the batch's valid steps, over one step [m/s], of walkers at other paces and a little beside.

        Step k has the weight 1 / k, and the sum of the weights of all valid steps is divided by: as distances grow
        with time, their plain mean would be about the last steps only. It is least at the spatial median of where
        people are who are still there.
        """
        truth, mask = truth_of(scenes, trimmed(scenes))
        scale = torch.empty_like(truth[:, 0, 0]).uniform_(SLOWEST, FASTEST)
        past, truth, mask = at_pace(scale, scenes.past[:, 0], truth, mask)
        beside = SHIFT_SD_M * torch.randn_like(scenes.where[:, :2])
        where = torch.cat([scenes.where[:, :2] + beside, scenes.where[:, 2:]], 1)
        away = self.paths(past, where)[:, : truth.shape[1]] - truth
        distance = torch.linalg.vector_norm(torch.where(mask[..., None], away, 1.0), dim=-1)
        weight = mask / torch.arange(1, truth.shape[1] + 1, dtype=truth.dtype, device=truth.device)
        return (weight * distance).sum() / (weight.sum() * self.step_s)

    def forecast(self, past: Tensor, present: Tensor, keys: Tensor, where: Tensor | None = None) -> Tensor:
        """The one path."""
        assert where is not None
        return self.paths(past[:, 0], where)[:, None]

    def optimiser(self, lr: float) -> torch.optim.Optimizer:
        """Adam with decoupled weight decay."""
        parts = [(self.layers.parameters(), DECAY), (self.maps.parameters(), DECAY_MAP)]
        return torch.optim.AdamW([{"params": list(part), "weight_decay": decay} for part, decay in parts], lr=lr)


def at_pace(scale: Tensor, past: Tensor, truth: Tensor, mask: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Walkers [n, O, 2], their truth [n, T, 2] and where it is there [n, T], had they walked `scale` [n] times as fast.

    Linear between steps; before the first one the first displacement goes on. One step of truth stays at least.
    """
    observed, path, length = past.shape[1], torch.cat([past, truth], 1), mask.sum(1, keepdim=True)
    step = torch.arange(1 - observed, truth.shape[1] + 1, dtype=past.dtype, device=past.device)
    at = torch.minimum(scale[:, None], length) * step
    low = torch.minimum(torch.floor(at).long().clamp(min=1 - observed), length - 1)
    before, after = (path.gather(1, (low + n)[..., None].expand(-1, -1, 2)) for n in (observed - 1, observed))
    new = before + (at - low)[..., None] * (after - before)
    there = at[:, observed:] <= length
    return new[:, :observed], torch.where(there[..., None], new[:, observed:], 0.0), there


def _make_room(grid, state_dict, prefix, *_):
    """Give a grid, before its numbers are loaded, as many as are stored."""
    grid.numbers = nn.Parameter(grid.numbers.new_zeros(state_dict[f"{prefix}numbers"].shape))
