"""What a reader looks for by its name, as entries of the index, which the search asks first.

Sphinx's search knows pages and whole headings alone: asked for an option, it named a page of three hundred of them.
Here the names in the first column of tables (options, columns, words of the glossary), and the beginning of a heading
such as `Equation 2: the next velocity`, lead to their row and place.
"""

import re

from docutils import nodes
from sphinx import addnodes
from sphinx.transforms import SphinxTransform

WORDS = {"glossary"}  # pages whose tables begin with words in plain text
NOT_ASKED = ("changelog", "files/", "licences", "results")  # pages whose tables hold no names


class NamesInTheIndex(SphinxTransform):
    """An entry of the index for every name of a page, before Sphinx collects them."""

    default_priority = 700

    def apply(self, **_):
        page = self.env.docname
        if page.startswith(NOT_ASKED):
            return
        for table in list(self.document.findall(nodes.table)):
            for body in table.findall(nodes.tbody):
                for row in body.findall(nodes.row):
                    self._enter(row, names_of(row[0], page in WORDS))
        for section in list(self.document.findall(nodes.section)):
            begins, colon, _ = section[0].astext().partition(": ")
            if colon and section.parent is not self.document:
                section.insert(1, entries([begins], section["ids"][0]))

    def _enter(self, row, names):
        """Let the row have a place of its own, and its names lead to it."""
        if names:
            section = row
            while not isinstance(section, nodes.section):
                section = section.parent
            within = "" if section.parent is self.document else f"{section['ids'][0]}."
            place = re.sub(r"[^\w.-]+", "-", f"row-{within}{names[0]}")
            while place in self.document.ids:
                place += "-"
            row["ids"].append(place)
            self.document.set_id(row)
            row[0].insert(0, entries(names, place))


def entries(names, place):
    """The index's entries of a place."""
    return addnodes.index(entries=[("single", name, place, "main", None) for name in names], inline=False)


def names_of(cell, in_words):
    """The names that a cell consists of: code such as `t`, `x` alone, or, `in_words`, plain words."""
    if in_words:
        return [name for name in re.split(r"[,()] ?", cell.astext().replace(" (", "(")) if name]
    literals = [one.astext() for one in cell.findall(nodes.literal)]
    rest = cell.astext()
    for one in literals:
        rest = rest.replace(one, "", 1)
    names = [one.rstrip("/") for one in literals if re.fullmatch(r"[\w./-]+", one)]
    return names if not re.sub(r"\[.*?\]|[\s,:]|\band\b|\bor\b", "", rest) else []


def setup(app):
    """Let Sphinx ask."""
    app.add_transform(NamesInTheIndex)
    return {"parallel_read_safe": True}
