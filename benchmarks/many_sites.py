"""Write made-up small sites and their list, to measure a sweep (docs/sweeps.md).

    python benchmarks/many_sites.py FOLDER --sites 50
    cd FOLDER && snakemake --snakefile PROJECT/workflow/sweep.smk --configfile sites.yaml --cores 2 --keep-going

A site is a plaza that 25 to 79 people cross on each of two days, the second one tested. Every seventh site's horizon is
12 s, the others' 20 s. The last site's test recording has two rows, so its run fails.
"""

import argparse
import shutil
from pathlib import Path

import numpy as np
import pandas as pd

ROOT = Path(__file__).parents[1]
DATASET = """title: Site {name}
reader: delimited
timezone: Europe/Zurich
recordings:
  - {{files: "{name}/2031-*.csv", day: in_name, split: {{by: day, test: 0.5}}}}
columns: {{track_id: person, t: time, x: x, y: y}}
header: true
horizon_s: {horizon}
velocity: differences
citation: made up
terms: free
"""
SITES = """sweep: plazas
configfiles: [config/own.yaml]
reference: cvm
targets: []
shared: {data_root: data, seeds: [0], compare: [cvm, cliff]}
sites:
"""


def main() -> None:
    """Write everything into the folder."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--sites", type=int, default=50)
    options = parser.parse_args()
    (options.folder / "config/datasets").mkdir(parents=True)
    shutil.copy(ROOT / "config/own.yaml", options.folder / "config")
    names = [f"s{number:02d}" for number in range(options.sites)]
    for number, name in enumerate(names):
        text = DATASET.format(name=name, horizon=12 if number % 7 == 3 else 20)
        (options.folder / f"config/datasets/{name}.yaml").write_text(text)
        (options.folder / f"data/{name}").mkdir(parents=True)
        for day in (3, 4):
            rows = people(number, day)
            last = name == names[-1] and day == 4
            path = options.folder / f"data/{name}/2031-03-0{day}.csv"
            rows.head(2 if last else len(rows)).to_csv(path, index=False, float_format="%.3f")
    (options.folder / "sites.yaml").write_text(SITES + "".join(f"  {name}:\n" for name in names))


def people(site: int, day: int) -> pd.DataFrame:
    """A day's rows, one a second: people who cross the plaza on bent ways, in both directions."""
    rng, pieces = np.random.default_rng([site, day]), []
    start = pd.Timestamp(f"2031-03-0{day} 10:00", tz="Europe/Zurich").timestamp()
    for person in range(int(np.random.default_rng(site).integers(25, 80))):
        t = np.arange(float(rng.integers(14, 30)))
        way, walked = (1.0 if person % 2 else -1.0), rng.normal(1.2, 0.15) * t
        x = way * (walked - 12) + rng.normal(0, 0.02, len(t))
        y = way + 2.5 * np.sin(walked / 6) + rng.normal(0, 0.3) + rng.normal(0, 0.02, len(t))
        pieces.append(pd.DataFrame({"time": start + t + rng.uniform(0, 900), "person": person, "x": x, "y": y}))
    return pd.concat(pieces)


if __name__ == "__main__":
    main()
