"""The report: one page per run that reads as a paper, with every exhibit in its place."""

from pathlib import Path

ASSETS = Path(__file__).parent / "assets"  # the page's template and style
