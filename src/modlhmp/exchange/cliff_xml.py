"""CLiFF-maps as XML: the form of CLiFF-map-matlab that the ROS tools read.

Their readers are strict: every node of the grid in MATLAB's order, whole ids from 1, one p and one q a location, tags
in one order, no comment and no attribute below `map`. What we write keeps to that; what others write (p and q empty,
twice, or not there) is read.
"""

from xml.etree.ElementTree import Element, TreeBuilder
from xml.parsers import expat

import numpy as np
import pyarrow as pa

from modlhmp.exchange.cliff_csv import parts_of
from modlhmp.exchange.components import Components, moved
from modlhmp.exchange.repair import cliff_table
from modlhmp.exchange.rows import Source, check_content, finite
from modlhmp.maps import swgmm
from modlhmp.storage import DataError, refused

LIMITS = ("x_min", "x_max", "y_min", "y_max")
COMPONENT = ("P", "M/th", "M/r", "Cov/e_11", "Cov/e_12", "Cov/e_21", "Cov/e_22")
MOST_DEEP = 30  # tags within tags; a map has 6
MOST_TAGS = 1_000_000  # in all, of about 60,000 locations; more would fill memory


def parse(source: Source) -> Element:
    """The tree of an XML file, each element's `line` among its attributes; entities are refused, not expanded."""
    check_content(source)
    where = source.name
    parser, builder, depth, tags = expat.ParserCreate(), TreeBuilder(), 0, 0
    parser.buffer_text = parser.ordered_attributes = True  # attributes are not looked at: a list is smallest

    def start(tag: str, _attributes: list[str]) -> None:
        nonlocal depth, tags
        depth, tags = depth + 1, tags + 1
        if tags > MOST_TAGS:
            raise DataError(f"{where}: more than {MOST_TAGS:,} tags: give so large a map as CSV or Parquet")
        if depth > MOST_DEEP:
            raise DataError(f"{where}: line {parser.CurrentLineNumber}: tags within tags, deeper than any map")
        builder.start(tag, {"line": str(parser.CurrentLineNumber)})

    def end(tag: str) -> None:
        nonlocal depth
        depth -= 1
        builder.end(tag)

    def entity(*_: object) -> None:
        raise DataError(f"{where}: line {parser.CurrentLineNumber}: it declares an entity, which no map needs")

    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.CharacterDataHandler, parser.EntityDeclHandler = builder.data, entity
    try:
        # A name that is no encoding's, or that of one of several bytes a letter.
        with refused(f"{where}: cannot be decoded", LookupError, ValueError, remedy="save it as UTF-8"):
            parser.Parse(source.data, True)
    except expat.ExpatError as error:
        raise DataError(f"{where}: line {error.lineno}: not XML ({expat.ErrorString(error.code)})") from None
    return builder.close()


def read(source: Source) -> tuple[pa.Table, dict[str, int]]:
    """The table of a CLiFF-map, and what was repaired; `DataError` names the line."""
    root, where = parse(source), source.name
    if root.tag != "map" or root.find("locations") is None or root.find("parameters") is None:
        raise DataError(f"{where}: {_other(root)}")
    parameters = root.find("parameters")
    assert parameters is not None
    step, radius = (_number(parameters, name, where) for name in ("step", "radious"))
    if not (step > 0 and radius > 0):
        raise DataError(f"{where}: step {step:g} and radious {radius:g} must be above 0")
    limits = dict(zip(LIMITS, (_number(parameters, name, where) for name in LIMITS), strict=True))
    rows: list[list[float]] = []
    for location in root.iterfind("locations/location"):
        x, y = (_number(location, f"pose/{name}", where) for name in ("x", "y"))
        extra = [_last(location, name, where) for name in ("p", "q")]
        head = [x, y, *extra]
        for one in location.iterfind("distribution"):
            rows.append([float(one.attrib["line"]), *head, *(_number(one, name, where) for name in COMPONENT)])
            _within(limits, step, x, y, f"{where}: line {location.attrib['line']}")
    if not rows:
        raise DataError(f"{where}: no location has a distribution: the map is empty")
    line, x, y, p, q, weight, heading, speed, *covariance = np.array(rows).T
    found = Components(
        where, "line", line.astype(int), *moved(x, y, source), heading, speed, np.column_stack(covariance), weight,
        np.column_stack([p, q]),
    )  # fmt: skip
    return cliff_table(found, step, radius)


def _other(root: Element) -> str:
    """What an XML file is that is no CLiFF-map."""
    tags = {root.tag, *(child.tag for child in root)}
    if {"Metadata", "Components"} & tags:
        return "cliffpy's own XML, without covariances: no density can be made of it, and no ROS tool reads it"
    known = {"clusters": "a GMMT-map", "cells": "an intensity map", "no_clusters": "a WHyTe-map"}
    for tag, name in known.items():
        if tag in tags:
            return f"{name}, not a CLiFF-map; it cannot be read here"
    return f"no CLiFF-map: its root is <{root.tag}>, and not <map> with <parameters> and <locations>"


def _number(element: Element, path: str, where: str) -> float:
    found = element.find(path)
    line = element.attrib["line"]
    text = "" if found is None else (found.text or "").strip()
    if found is None or not text:
        raise DataError(f"{where}: line {line}: <{element.tag}> has no <{path}>, or it is empty")
    return finite(text, f"{where}: line {found.attrib['line']}, <{path}>")


def _last(location: Element, name: str, where: str) -> float:
    """The p or q of a location, 1 where it is empty or not there; it may stand there twice."""
    given = [one for one in location.iterfind(name) if (one.text or "").strip()]
    return finite(str(given[-1].text).strip(), f"{where}: line {given[-1].attrib['line']}, <{name}>") if given else 1.0


def _within(limits: dict[str, float], step: float, x: float, y: float, where: str) -> None:
    reach = 0.5 * step
    if not (
        limits["x_min"] - reach <= x <= limits["x_max"] + reach
        and limits["y_min"] - reach <= y <= limits["y_max"] + reach
    ):
        raise DataError(f"{where}: location ({x:g}, {y:g}) is outside the limits that <parameters> gives")


def write(table: pa.Table) -> str:
    """A CLiFF-map's table as XML; p is 1 and q our p, as in public files with numbers in them."""
    x, y, heading, speed, vtt, vtr, vrr, weight, p, _ = parts_of(table)
    if not len(x):
        raise DataError("an empty map has no grid, which this form needs; build it from more data")
    metadata = table.schema.metadata
    step = float(metadata[b"resolution"])
    radius = float(metadata.get(b"radius", metadata[b"resolution"]))
    ends = ((x.min(), x.max()), (y.min(), y.max()))
    grid = [low + step * np.arange(np.rint((high - low) / step) + 1) for low, high in ends]
    limits = zip(LIMITS, (grid[0][0], grid[0][-1], grid[1][0], grid[1][-1]), strict=True)
    lines = ['<?xml version="1.0" encoding="utf-8"?>', '<map version="0.1">', "<parameters>"]
    lines += [f"<{name}>{value:.9g}</{name}>" for name, value in limits]
    lines += [f"<step>{step:.9g}</step>", f"<radious>{radius:.9g}</radious>", f"<wind>{swgmm.WINDINGS}</wind>"]
    lines += ["</parameters>", "<locations>"]
    node = np.rint((x - x.min()) / step) * len(grid[1]) + np.rint((y - y.min()) / step)
    rows_of: dict[int, list[int]] = {}
    for row, number in enumerate(node.astype(int).tolist()):
        rows_of.setdefault(number, []).append(row)
    numbers = np.column_stack([weight, heading, speed, vtt, vtr, vtr, vrr]).tolist()
    for number in range(len(grid[0]) * len(grid[1])):
        i, j = divmod(number, len(grid[1]))
        rows = rows_of.get(number, [])
        # Where there are components, to the digits of the table; the lattice may have lost some.
        at = (x[rows[0]], y[rows[0]]) if rows else (grid[0][i], grid[1][j])
        q = p[rows[0]] if rows else 0.0
        lines.append(f"<location><id>{number + 1}</id><p>1</p><q>{q:.9g}</q>")
        lines.append(f"<pose><x>{at[0]:.9g}</x><y>{at[1]:.9g}</y></pose>")
        lines += [_distribution(*numbers[row]) for row in rows]
        lines.append("</location>")
    return "\n".join([*lines, "</locations>", "<locations_sparse/>", "</map>", ""])


def _distribution(weight, th, r, e_11, e_12, e_21, e_22):
    covariance = {"e_11": e_11, "e_12": e_12, "e_21": e_21, "e_22": e_22}
    cov = "".join(f"<{name}>{value:.9g}</{name}>" for name, value in covariance.items())
    return (
        f"<distribution><Cluster>-1</Cluster><P>{weight:.9g}</P><M><th>{th:.9g}</th><r>{r:.9g}</r></M>"
        f"<Cov>{cov}</Cov></distribution>"
    )
