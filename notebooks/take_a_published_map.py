"""Take a published map: what it is, what is wrong in it, what it forecasts, what a path costs, and on to the ROS tools.

    python notebooks/take_a_published_map.py theirs.csv

Without a file it makes one of made-up people, rounded to five digits as most published maps are.
"""

import sys
from pathlib import Path

import numpy as np

import modlhmp
from modlhmp.contract import crowd
from modlhmp.exchange.maps import imported

# 1. The map. `form="online"` where nothing in the file tells which order its columns have.
published = Path(sys.argv[1] if len(sys.argv) > 1 else "published.csv")
if len(sys.argv) == 1:
    modlhmp.build_map("cliff", crowd()).save(published, form="matlab")
    np.savetxt(published, np.loadtxt(published, delimiter=","), fmt="%.5g", delimiter=",")
theirs = modlhmp.load_map(published, site=modlhmp.Site(timezone="Asia/Tokyo"))
about = imported(theirs.whole)
print(
    f"{published}: {theirs.whole.num_rows} components, form {about['form']}, repaired: {about['repaired'] or 'nothing'}"
)

# 2. A forecast: four positions of a walker, a second apart, at a place of the map (t, x, y).
start = np.array([theirs.whole["x"][0].as_py(), theirs.whole["y"][0].as_py()])
middle = np.array([np.mean(theirs.whole[name].to_pylist()) for name in ("x", "y")])
step = (middle - start) / np.hypot(*(middle - start))  # 1 m/s, towards the middle
history = np.column_stack([1.3e9 + np.arange(4.0), start + np.arange(4)[:, None] * step])
futures = modlhmp.forecast(theirs, history, horizon_s=10, k=20, seed=0)
x, y = futures.best[0][-1]
print(f"in 10 s: ({x:.1f}, {y:.1f}); {np.mean(futures.left(10)):.0%} of 20 futures have left the map by then")

# 3. A robot's path through it, there and back; a file does not say how many people there are, so say it.
path = np.stack([start, middle])
for name, way in (("there", path), ("back", path[::-1])):
    cost = modlhmp.path_cost(theirs, way, speed_m_s=0.8, people=0.5)
    print(f"{name}: {cost.length_m:.1f} m, upstream cost {cost.total('upstream'):.2f}, {cost.time_s:.1f} s")

# 4. On to others: XML for the ROS tools, Parquet for us.
theirs.save(published.with_suffix(".xml"), form="xml")
theirs.save(published.with_suffix(".parquet"))
print(f"written: {published.with_suffix('.xml')}, {published.with_suffix('.parquet')}")
