"""The documentation as a site: `make docs` (docs/decisions.md says why Sphinx, MyST and furo)."""

import importlib
import inspect
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent / "_ext"))
import repository
from jupyter_client.manager import KernelManager

import modlhmp

ROOT = repository.ROOT
project, author, release = "modlhmp", "The modlhmp developers", modlhmp.__version__
copyright = author
extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.linkcode", "docstrings", "finding", "mathml", "repository"]
nitpicky = True

# Markdown as forges read it, with formulas, images by tag where they have a width, and anchors of headings.
myst_enable_extensions = ["dollarmath", "html_image"]
myst_heading_anchors = 4
myst_url_schemes = ["http", "https", "mailto", "repository"]
html_math_renderer = "mathml"
suppress_warnings = ["myst.header"]  # tables that `make settings` writes begin at their own level

# Notebooks are run where there is a run to look into; else they are shown as they are.
nb_execution_mode = "force" if any((ROOT / "results/demo").glob("*/tracks")) else "off"
nb_execution_timeout = 300
nb_execution_raise_on_error = True
nb_merge_streams = True
KernelManager.transport_encryption.default_value = "auto"  # kernels warn of what is not encrypted, on the loopback, too
nb_render_image_options = {"alt": "What the lines above draw"}

# Docstrings are prose whose single backticks are code.
default_role = "code"
autodoc_typehints = "signature"
autodoc_member_order = "bysource"
autodoc_default_options = {"members": True}
python_maximum_signature_line_length = 80
# Types of other packages, whose pages are elsewhere, and two that no caller meets.
nitpick_ignore_regex = [("py:.*", r"(?!modlhmp).*"), ("py:.*", r"modlhmp\.(settings\.T|maps\.updated\.slots\.Update)")]

html_theme = "furo"
html_title = "modlhmp"
html_static_path = [str(ROOT / "docs/_static")]
html_css_files = ["site.css"]
html_copy_source = False
html_show_sourcelink = False
html_show_sphinx = False
html_search_scorer = str(ROOT / "docs/_ext/scorer.js")
pygments_style, pygments_dark_style = "a11y-high-contrast-light", "a11y-high-contrast-dark"
LIGHT = {
    "color-brand-primary": "#0b5c7a",
    "color-brand-content": "#0b5c7a",
    "color-brand-visited": "#6a3d8f",
    "color-api-name": "#0b5c7a",
    "color-api-pre-name": "#43525f",
    "color-foreground-primary": "#16202a",
    "color-foreground-secondary": "#43525f",
    "color-foreground-muted": "#55636f",
    "color-background-primary": "#ffffff",
    "color-background-secondary": "#f5f7f8",
}
DARK = {
    "color-brand-primary": "#7cc7e8",
    "color-brand-content": "#7cc7e8",
    "color-brand-visited": "#c9a7ea",
    "color-api-name": "#7cc7e8",
    "color-api-pre-name": "#b3bfc8",
    "color-foreground-primary": "#e6ebee",
    "color-foreground-secondary": "#b3bfc8",
    "color-foreground-muted": "#9fadb7",
    "color-background-primary": "#12181d",
    "color-background-secondary": "#1a2127",
}
html_theme_options = {"light_css_variables": LIGHT, "dark_css_variables": DARK, "top_of_page_buttons": []}


def linkcode_resolve(domain, info):
    """The page of the file, and the line in it, where something of the library is written."""
    thing = importlib.import_module(info["module"])
    for part in info["fullname"].split("."):
        thing = inspect.getattr_static(thing, part, None) if inspect.isclass(thing) else getattr(thing, part, None)
    thing = getattr(thing, "fget", None) or getattr(thing, "__func__", thing)
    try:
        file, line = inspect.getsourcefile(thing), inspect.getsourcelines(thing)[1]
    except (TypeError, OSError):
        return None  # a constant or a field
    path = Path(file).relative_to(ROOT).as_posix()
    repository.shown.add(path)
    return f"files/{path}.html#L-{line}"
