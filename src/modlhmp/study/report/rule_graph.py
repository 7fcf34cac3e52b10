"""Which rule of a run needs which: found as Snakemake finds its jobs, drawn as a picture that a page can hold."""

import graphlib
import html
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from typing import Any, NamedTuple

LETTER, ROW, BOX, GAP, PAD = 6.7, 27.0, 21.0, 46.0, 8.0  # px: of a letter, between boxes, of a box, between columns
SWEEPS = 8  # of placing each box beside those that it is joined to


class RuleGraph(NamedTuple):
    """`needs` {rule: the rules whose files it needs}, and how many `jobs` each has."""

    needs: dict[str, list[str]]
    jobs: dict[str, int]


def rule_graph(rules: Iterable[Any], targets: Iterable[str]) -> RuleGraph:
    """The rules that make the files `targets`, of Snakemake's `rules`, and all that they need.

    Snakemake draws the same (`--rulegraph`), but only before a run, and for a program that a machine may lack.
    """
    rules = sorted(rules, key=lambda rule: rule.name)
    needs: dict[str, set[str]] = {}
    jobs: Counter[str] = Counter()
    makers: dict[str, str | None] = {}  # file -> rule, None for a file that was there
    seen: set[tuple[str, tuple[Any, ...]]] = set()
    waiting = [("", str(file)) for file in targets]  # for which rule, which file
    while waiting:
        wanted, file = waiting.pop()
        if file not in makers:
            rule = next((one for one in rules if one.is_producer(file)), None)
            makers[file] = rule and rule.name
            if rule is not None:
                wildcards = rule.get_wildcards(file)
                job = rule.name, tuple(sorted(wildcards.items()))
                if job not in seen:
                    seen.add(job)
                    jobs[rule.name] += 1
                    needs.setdefault(rule.name, set())
                    waiting += [(rule.name, str(one)) for one in rule.expand_input(wildcards)[0]]
        if wanted and (maker := makers[file]) is not None:
            needs[wanted].add(maker)
    return RuleGraph({name: sorted(found) for name, found in sorted(needs.items())}, dict(sorted(jobs.items())))


def grouped(graph: RuleGraph, group: Callable[[str], str]) -> RuleGraph:
    """The graph with all rules of one `group` as one."""
    needs: dict[str, set[str]] = {}
    jobs: Counter[str] = Counter()
    for name, found in graph.needs.items():
        needs.setdefault(group(name), set()).update(map(group, found))
        jobs[group(name)] += graph.jobs[name]
    return RuleGraph({name: sorted(found - {name}) for name, found in needs.items()}, dict(jobs))


def without_shortcuts(needs: Mapping[str, Iterable[str]]) -> dict[str, set[str]]:
    """What each rule needs, less what it needs through another that it needs."""
    behind: dict[str, set[str]] = {}  # everything that a rule needs, directly or not
    for name in graphlib.TopologicalSorter(needs).static_order():
        behind[name] = set(needs[name]).union(*(behind[one] for one in needs[name]))
    return {name: set(found) - set().union(*(behind[one] for one in found)) for name, found in needs.items()}


def columns_of(needs: Mapping[str, Iterable[str]]) -> list[list[str]]:
    """The rules by how many must have run before, each column in an order with few crossing lines."""
    column: dict[str, int] = {}
    for name in graphlib.TopologicalSorter(needs).static_order():
        column[name] = 1 + max((column[one] for one in needs[name]), default=-1)
    columns: list[list[str]] = [[] for _ in range(1 + max(column.values(), default=-1))]
    for name in sorted(column):
        columns[column[name]].append(name)
    joined = {name: set(needs[name]) | {one for one in needs if name in needs[one]} for name in needs}
    for sweep in range(SWEEPS):
        place = {name: (at + 0.5) / len(names) for names in columns for at, name in enumerate(names)}
        for names in columns[:: -1 if sweep % 2 else 1]:
            middle = {name: sum(place[one] for one in joined[name]) / max(len(joined[name]), 1) for name in names}
            names.sort(key=lambda name: (middle[name], name))
            place |= {name: (at + 0.5) / len(names) for at, name in enumerate(names)}
    return columns


def picture(graph: RuleGraph, title: str) -> str:
    """The graph as SVG, from left to right; the page's style sheet gives `.box` and `.line` their colours."""
    needs = without_shortcuts(graph.needs)
    columns = columns_of(needs)
    labels = {name: f"{name} ×{count}" if count > 1 else name for name, count in graph.jobs.items()}
    height = ROW * max(map(len, columns), default=1)
    widths = [LETTER * max(len(labels[name]) for name in names) + 2 * PAD for names in columns]
    lefts = [sum(widths[:at]) + GAP * at for at in range(len(widths))]
    place = {
        name: (left, height * (row + 0.5) / len(names), LETTER * len(labels[name]) + 2 * PAD)
        for left, names in zip(lefts, columns, strict=True)
        for row, name in enumerate(names)
    }
    parts = [_line(place[one], place[name]) for name in sorted(needs) for one in sorted(needs[name])]
    for name, (x, y, width) in sorted(place.items()):
        parts.append(f'<rect class="box" x="{x:.0f}" y="{y - BOX / 2:.0f}" width="{width:.0f}" height="{BOX}" rx="3"/>')
        parts.append(f'<text x="{x + PAD:.0f}" y="{y + 4:.0f}">{html.escape(labels[name])}</text>')
    width = sum(widths) + GAP * (len(widths) - 1)
    view = f'viewBox="-2 -2 {width + 4:.0f} {height + 4:.0f}" width="{width + 4:.0f}" height="{height + 4:.0f}"'
    return "\n".join([f'<svg {view} role="img" aria-label="{html.escape(title)}">', *parts, "</svg>"])


def _line(start, end):
    """A line from the right of one box to the left of another."""
    (x0, y0, width), (x1, y1, _) = start, end
    left, right = x0 + width, x1
    bend = max((right - left) / 2, GAP / 2)
    path = f"M{left:.0f} {y0:.0f}C{left + bend:.0f} {y0:.0f} {right - bend:.0f} {y1:.0f} {right:.0f} {y1:.0f}"
    return f'<path class="line" d="{path}"/>'
