"""Formulas as MathML, which browsers draw themselves: no script, no font and no network, now or when somebody reads.

docutils has the converter; Sphinx asks a renderer for each formula, and this is one.
"""

from docutils import nodes
from docutils.utils.math.latex2mathml import tex2mathml
from sphinx.application import Sphinx


def _write(writer: object, node: nodes.Element, as_block: bool) -> None:
    formula = tex2mathml(node.astext(), as_block=as_block)
    # A wide formula scrolls by itself on a telephone, and with the keyboard.
    shown = f'<div class="formula" tabindex="0" role="group">{formula}</div>' if as_block else formula
    writer.body.append(shown)  # type: ignore[attr-defined]
    raise nodes.SkipNode


def setup(app: Sphinx) -> dict[str, bool]:
    """Make `html_math_renderer = "mathml"` known."""
    inline, block = ((lambda writer, node, of=of: _write(writer, node, of)) for of in (False, True))
    app.add_html_math_renderer("mathml", (inline, None), (block, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
