"""The page's look and script, and how they become one file with its data, which asks no network."""

import base64
import html
from pathlib import Path

from modlhmp.version import __version__

ASSETS = Path(__file__).parent / "assets"
SCRIPTS = ("data", "view", "layers", "place", "people", "errors", "state", "app", "controls")


def page(run: str, data: bytes) -> str:
    """The page of a run with its packed data (`pack.packed`)."""
    parts = {
        "version": __version__,
        "title": html.escape(f"Explorer of run {run}"),
        "style": _asset("explorer.css"),
        "script": "\n".join(_asset(f"{name}.js") for name in SCRIPTS),
        "data": base64.b64encode(data).decode(),
    }
    text = _asset("explorer.html")
    for name, part in parts.items():
        text = text.replace(f"@@{name}@@", part)
    return text


def _asset(name):
    return (ASSETS / name).read_text(encoding="utf-8")
