"""Script time of a frame while the explorer plays: median, and the share of frames over 8 ms, of each layer.

    .venv/bin/python benchmarks/explorer.py paper_figures/real/explorer.html

Needs a Chromium. The time is what the page's own script takes; what the browser does after it is not in it.
"""

import sys
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from browser import Page

GOAL_MS, SECONDS = 8.0, 20.0


def main(path: str) -> int:
    """Play each layer, one map and two; 1 if a median misses the goal."""
    missed = 0
    with Page(path) as page:
        page.until("document.documentElement?.dataset.ready === 'yes'")
        for two in (False, True):
            if two:
                page.press("c")
            for layer in ("cliff", "stef", "flow", "exits"):
                if page.ask(f"document.querySelector('[value={layer}]').disabled"):
                    continue
                page.click(f"[value={layer}]")
                page.ask("explorer.frames.length = 0")
                page.click("#play")
                time.sleep(SECONDS)
                page.click("#play")
                frames = np.array(page.ask("explorer.frames"))
                median = np.median(frames)
                missed += median > GOAL_MS
                maps, late = "two maps" if two else "one map", (frames > GOAL_MS).mean()
                print(
                    f"{layer}, {maps}: median {median:.1f} ms of {len(frames)} frames, {late:.0%} over {GOAL_MS:g} ms"
                )
    return int(missed > 0)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
