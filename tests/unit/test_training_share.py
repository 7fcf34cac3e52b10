"""Figure of errors against the share of training tracks."""

import numpy as np
import pandas as pd
from matplotlib import image
from walking_hall import HALL, METHODS, STEPS, YARD, walkers

from modlhmp.forecasting.base import Forecast
from modlhmp.scoring.recording import score_recording
from modlhmp.storage import write_parquet
from modlhmp.study.exhibits import training_share
from modlhmp.tracks import empty_tracks

SHARES = (0.1, 0.25, 1.0)


def errors_of(dataset, aside, rows=4 + STEPS, output="median"):
    """Errors of five people; one method's forecasts lie `aside` metres off, more for those with a larger id."""
    tracks = walkers(rows)
    steps = dataset.steps
    ids = np.arange(1, 6)
    xy = np.zeros((5, 1, steps, 2), np.float32)
    xy[..., 0], xy[..., 1] = 6.0 + 2.0 * np.arange(1, steps + 1), (ids * (1 + aside))[:, None, None]
    forecast = Forecast(xy, np.zeros((5, 1, steps), np.float32), np.full((5, 1), steps, np.int32), output)
    return score_recording(tracks, [(seed, ids, forecast) for seed in (0, 1)], "day", dataset)


def study(layout, dataset, errors):
    """Errors files of both methods; with share s and method m: m / s."""
    for m, method in enumerate(METHODS, 1):
        for share in SHARES:
            write_parquet(errors(dataset, m / share), layout.training_share(dataset.name, method, share))


def draw(layout, datasets, **horizons):
    """The plotted numbers."""
    training_share.draw(layout, datasets, layout.exhibit("f"), METHODS, SHARES, horizons)
    return pd.read_csv(f"{layout.exhibit('f')}.csv")


def test_the_curves_are_the_mean_errors_of_each_share(layout, figures):
    """On average the third person's: 3 m / s for the first method, twice as much for the second."""
    study(layout, HALL, errors_of)
    table = draw(layout, [HALL], hall=[4, 12])
    assert set(table["protocol"]) == {"complete"}
    assert set(table["output"]) == {"median"}
    for m, method in enumerate(METHODS, 1):
        for share in (0.1, 0.25, 1.0):
            one = table[(table["method"] == method) & (table["share"] == share)]
            assert one["horizon_s"].tolist() == [2, 4, 6, 8, 10, 12]
            np.testing.assert_allclose(one["ade_m"], 3 * m / share, rtol=1e-5)
    panels = [ax for ax in figures[0].axes if ax.axison]
    assert [ax.get_title(loc="left") for ax in panels] == ["Hall\n4 s (n = 5)", "Hall\n12 s (n = 5)"]
    for panel in panels:
        curves = [line.get_xydata() for line in panel.lines]
        np.testing.assert_allclose(curves[0], [[10, 30], [25, 12], [100, 3]], rtol=1e-5)
        np.testing.assert_allclose(curves[1], [[10, 60], [25, 24], [100, 6]], rtol=1e-5)
    assert image.imread(f"{layout.exhibit('f')}.png").std() > 0


def test_datasets_have_a_row_each_with_their_own_horizons(layout, figures):
    for dataset in (HALL, YARD):
        study(layout, dataset, errors_of)
    draw(layout, [HALL, YARD], hall=[2, 4, 8, 12], yard=[4])
    titles = [ax.get_title(loc="left") for ax in figures[0].axes if ax.axison]
    assert titles == ["Hall\n4 s (n = 5)", "Hall\n8 s (n = 5)", "Hall\n12 s (n = 5)", "Yard\n4 s (n = 5)"]
    assert figures[0]._suptitle.get_text().startswith("Demo data")


def test_a_share_study_of_nobody_is_drawn_empty(layout, figures):
    """No test track is usable: the file has no rows."""
    study(layout, HALL, lambda dataset, _: score_recording(empty_tracks(), [], "day", dataset))
    assert len(draw(layout, [HALL], hall=[4, 12])) == 0
    titles = [ax.get_title(loc="left") for ax in figures[0].axes if ax.axison]
    assert titles == ["Hall\n4 s (n = 0)", "Hall\n12 s (n = 0)"]


def test_a_horizon_that_no_track_reaches_has_no_curve(layout, figures):
    study(layout, HALL, lambda dataset, aside: errors_of(dataset, aside, rows=4 + 3))
    draw(layout, [HALL], hall=[4, 12])
    titles = [ax.get_title(loc="left") for ax in figures[0].axes if ax.axison]
    assert titles == ["Hall\n4 s (n = 5)", "Hall\n12 s (n = 0)"]
