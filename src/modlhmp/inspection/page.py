"""What an inspection found as one HTML page that needs no other file."""

import base64
from collections.abc import Iterable
from html import escape
from pathlib import Path

from modlhmp.version import __version__

_STYLE = (
    "body{font:15px/1.5 sans-serif;max-width:60rem;margin:2rem auto;padding:0 1rem;color:#222}"
    "table{border-collapse:collapse;width:100%}td,th{border-bottom:1px solid #ddd;padding:.3rem .6rem;text-align:left;"
    "vertical-align:top}pre{background:#f5f5f5;padding:.8rem;overflow:auto}img{max-width:100%}"
    ".stop{border-left:6px solid #c33;padding:.2rem .8rem}.warn{border-left:6px solid #da2;padding:.2rem .8rem}"
)


def page(
    title: str,
    tables: Iterable[tuple[str, Iterable[tuple[str, str]]]],
    findings: Iterable[tuple[str, str, str]],
    picture: Path | None,
    draft: str,
) -> str:
    """The page: findings as (severity, of what, text), tables of facts by heading, the picture, the draft."""
    told = [f'<p class="{severity}"><b>{escape(of)}</b>: {escape(text)}</p>' for severity, of, text in findings]
    parts = [
        f'<!DOCTYPE html><html lang="en"><head><meta charset="utf-8"><title>{escape(title)}</title>',
        f'<meta name="generator" content="modlhmp {__version__}">',
        f"<style>{_STYLE}</style></head><body><h1>{escape(title)}</h1>",
        *(told or ["<p>Nothing looks wrong.</p>"]),
    ]
    if picture is not None:
        parts.append(
            f'<img alt="tracks" src="data:image/png;base64,{base64.b64encode(picture.read_bytes()).decode()}">'
        )
    for heading, rows in tables:
        cells = "".join(f"<tr><th>{escape(name)}</th><td>{escape(text)}</td></tr>" for name, text in rows)
        parts.append(f"<h2>{escape(heading)}</h2><table>{cells}</table>")
    if draft:
        parts.append(f"<h2>Draft of a dataset file</h2><pre>{escape(draft)}</pre>")
    return "\n".join([*parts, "</body></html>"]) + "\n"
