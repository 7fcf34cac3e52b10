"""Likelihood on the real ATC day (skipped where it is absent): numbers that were measured with another program."""

import numpy as np
import pytest

from modlhmp.exchange.maps import read_tables
from modlhmp.maps import density
from modlhmp.maps.histogram import Level, histogram
from modlhmp.readers import read_recording
from modlhmp.scoring.likelihood import as_printed, charged, is_charged, with_background

pytestmark = pytest.mark.real

NEAR = 0.005  # that program kept covariances that ours raises, and speeds below 0
EIGHT = Level(8.0)


@pytest.fixture(scope="module")
def day(real_data, load_shipped):
    """The dataset, and its training and test rows of people who walk."""
    dataset = load_shipped("atc_1day", real_data)
    if missing := [one.path for one in dataset.recordings if not one.exists]:
        pytest.skip(f"{', '.join(missing)}: not there")
    tracks = {one.split: read_recording(one.path, dataset, one.day, one.start)[0] for one in dataset.recordings}
    return dataset, *(tracks[split].take(tracks[split].moves()) for split in ("train", "test"))


def asked(one, rows):
    """Log densities of rows: of headings with speeds, of headings alone."""
    where = rows.x, rows.y, rows.t
    return one.log_density(*where, rows.heading, rows.speed), one.log_heading(*where, rows.heading)


def test_a_published_map_and_none(real_data, day):
    dataset, train, test = day
    file = real_data / "maps/atc-20121024-cliff.csv"
    if not file.is_file():
        pytest.skip(f"{file} is not there")
    no_map = density.NoMap(train.speed)
    none, of_headings = asked(no_map, test)
    assert -none.mean() == pytest.approx(2.184, abs=NEAR)
    kind, table, _ = read_tables(file, site=dataset)
    joint, heading = asked(density.load(kind, table, dataset), test)
    assert -charged(joint).mean() == pytest.approx(1.417, abs=NEAR)
    assert -with_background(joint, none, 0.05).mean() == pytest.approx(1.375, abs=NEAR)
    assert -charged(heading).mean() == pytest.approx(1.333, abs=NEAR)
    assert -with_background(heading, of_headings, 0.02).mean() == pytest.approx(1.316, abs=NEAR)
    assert is_charged(joint).mean() < 0.001
    # With the windings that count three times 0.356 was measured; ln 3 is the most that it can be.
    assert 0.28 < -as_printed(joint).mean() < 0.356


def test_histograms_of_eight_directions(day):
    dataset, train, test = day
    no_map = density.NoMap(train.speed)
    joint, heading = asked(histogram(train, dataset, no_map, 1.0, [EIGHT]), test)
    assert -joint.mean() == pytest.approx(1.706, abs=NEAR)
    assert -heading.mean() == pytest.approx(1.360, abs=NEAR)
    for weight, expected in ((2.0, 1.398), (8.0, 1.361), (32.0, 1.341)):
        _, heading = asked(histogram(train, dataset, no_map, 1.0, [EIGHT, Level(weight, hourly=True)]), test)
        assert -charged(heading).mean() == pytest.approx(expected, abs=NEAR), weight
    assert np.isfinite(heading).mean() > 0.999
