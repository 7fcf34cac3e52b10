"""Docstrings as pages of the reference: they are plain text, written to be read in an editor."""

import inspect
import re
from dataclasses import fields, is_dataclass

from modlhmp.settings import fields_of


def in_markup(app, what, name, thing, options, lines):
    """Docstrings are plain text: an indented part of one is code, and a page that it names is linked."""
    lines[:] = [re.sub(r"`?\bdocs/([a-z-]+)\.md`?", r":doc:`\1`", line) for line in lines]
    for at in range(len(lines) - 1, 0, -1):
        begins = lines[at].startswith("    ") and not lines[at - 1].strip()
        before = next((line for line in reversed(lines[:at]) if line.strip()), "")
        if begins and before and not before.startswith((" ", "* ", "- ")) and not before.endswith("::"):
            lines[at:at] = ["::", ""]


def options_as_list(app, what, name, thing, options, lines):
    """A class of settings shows its options with their meanings, as the tables of the configuration do."""
    if is_settings(thing):
        for key, of, default, meaning in fields_of(thing):
            usual = "its own defaults" if is_dataclass(default) else f"default `{default}`"
            lines += ["", f"* `{key}`: {meaning} ({of}; {usual})"]


def without_types_of_options(app, what, name, thing, options, signature, returns):
    """Instead of a signature that would spell the bounds of every option."""
    return ("(**options)", returns) if is_settings(thing) else None


def is_settings(thing):
    """Whether it is a class with options that have meanings."""
    return (
        inspect.isclass(thing) and is_dataclass(thing) and any("description" in one.metadata for one in fields(thing))
    )


def without_field_numbers(app, what, name, thing, skip, options):
    """Fields of named tuples whose text is only their number; the class says what they are."""
    return True if (getattr(thing, "__doc__", "") or "").startswith("Alias for field number") else None


def setup(app):
    """Let autodoc ask."""
    app.connect("autodoc-process-docstring", in_markup)
    app.connect("autodoc-process-docstring", options_as_list)
    app.connect("autodoc-process-signature", without_types_of_options)
    app.connect("autodoc-skip-member", without_field_numbers)
    return {"parallel_read_safe": True}
