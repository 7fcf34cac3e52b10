"""Figures within a page: small enough for one file, sharp enough to read their letters."""

import base64
import io
from pathlib import Path
from typing import NamedTuple

from PIL import Image

WIDEST = 1600  # pixels that are kept of a figure's width
QUALITY = 85
SHOWN = 1.5 * 96 / 300  # px of the page for a pixel of a figure of 300 dpi: half as large again as in print


class Picture(NamedTuple):
    """A picture's data as a URI, and the width and height [px] that the page shows it at."""

    source: str
    width: int
    height: int


def inline(path: str | Path) -> Picture:
    """A PNG as WebP within a page; one that is wider than `WIDEST` is made smaller."""
    with Image.open(path) as file:
        whole = file.convert("RGB")
    shown = [round(size * SHOWN) for size in whole.size]
    if whole.width > WIDEST:
        whole = whole.resize((WIDEST, round(whole.height * WIDEST / whole.width)), Image.Resampling.LANCZOS)
    held = io.BytesIO()
    whole.save(held, "WEBP", quality=QUALITY, method=4)
    return Picture(f"data:image/webp;base64,{base64.b64encode(held.getvalue()).decode()}", *shown)
