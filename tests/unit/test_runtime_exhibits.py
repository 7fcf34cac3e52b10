"""What becomes of the runtime study's numbers: the figure, and the claims about time, memory and sizes."""

import dataclasses

import numpy as np
import pandas as pd

from modlhmp.datasets import Dataset
from modlhmp.storage import write_json
from modlhmp.study import claims
from modlhmp.study.exhibits.runtime_figure import draw
from modlhmp.study.layout import Layout

HALL = Dataset(name="hall", title="Hall", label="atc", horizon_s=12.0, demo=True)


def made_up(**changes):
    """A result of the study."""
    growth = {"N": [[1, 1e-3], [2, 2e-3], [4, 4e-3]], "T": [[1, 1e-3, 5], [2, 2e-3, 9]], "M": [[9, 1e-3], [18, 1e-3]]}
    return {
        "tracks": 7, "k": 5, "horizon_s": 60, "repetitions": 5, "seconds_per_track": 1e-4, "latency_s": 2e-3,
        "latency_90th_s": 3e-3, "seconds_per_track_range": [1e-4, 2e-4], "memory_mb": 200.0,
        "memory_of_imports_mb": 150.0, "map_kb": 160.0, "maps": 11, "growth": growth,
        "exponents": {"N": [1.0, 0.9, 1.1], "T": [0.5, 0.4, 0.6], "M": [0.0, -0.1, 0.1]},
        "machine": {"cpu": "a CPU", "cores": 2, "python": "3.11", "numba": "0.60", "numpy": "2.0"}, **changes,
    }  # fmt: skip


def test_figure_holds_the_numbers(tmp_path):
    layout, nothing = Layout("demo", str(tmp_path)), [float("nan")] * 3
    other = made_up(exponents={"N": nothing, "T": nothing, "M": nothing})
    own = dataclasses.replace(HALL, name="own", label="own")
    for dataset, measured in ((HALL, made_up()), (own, other)):
        write_json(layout.runtime(dataset.name), measured)
    draw(layout, [HALL, own], str(tmp_path / "f"), "TC-CLiFF")
    table = pd.read_csv(tmp_path / "f.csv").set_index(["dataset", "quantity"])
    assert table.loc[("hall", "memory_mb"), "value"].item() == 200
    assert table.loc[("own", "seconds against N"), "value"].tolist() == [1e-3, 2e-3, 4e-3]


def test_claims_about_the_runtime():
    """Verdicts by hand: faster, linear in N, slower growth in T and M, less memory, a larger map."""
    one = claims.Evidence(HALL, [12.0], pd.DataFrame(), {}, {}, np.empty(0), frozenset(), {}, made_up())
    table = claims.test_claims([one], {}, {}).set_index("our test")["verdict"]
    assert table["at most 0.11 s per track, k = 5, 60 s (another machine)"] == "supported"
    assert table["the exponent of time in N is 1"] == "not contradicted"
    assert table["the exponent of time in T is 1"] == table["the exponent of time in M is 1"] == "grows more slowly"
    assert (table["273 MB"], table["152 kB"]) == ("ours is smaller", "ours is larger")


def test_the_rate_is_that_of_a_track_alone():
    """What the paper gives; many at once are faster, which is no answer to it."""
    slow = made_up(latency_s=0.2, seconds_per_track=1e-4)
    one = claims.Evidence(HALL, [12.0], pd.DataFrame(), {}, {}, np.empty(0), frozenset(), {}, slow)
    row = (
        claims.test_claims([one], {}, {})
        .set_index("our test")
        .loc["at most 0.11 s per track, k = 5, 60 s (another machine)"]
    )
    assert (row["verdict"], row["measured"]) == ("contradicted", "200 ms")


def test_growth_of_fewer_than_three_sizes_is_not_tested():
    unknown = made_up(exponents={"N": [float("nan")] * 3, "T": [0.5, 0.4, 0.6], "M": [1.2, 1.1, 1.3]})
    one = claims.Evidence(HALL, [12.0], pd.DataFrame(), {}, {}, np.empty(0), frozenset(), {}, unknown)
    table = claims.test_claims([one], {}, {}).set_index("our test")["verdict"]
    verdicts = [table[f"the exponent of time in {name} is 1"] for name in "NTM"]
    assert verdicts == ["not tested", "grows more slowly", "grows faster"]
