"""The repository's texts as the sources of a site.

The texts are read on a forge as well, where they lie and link to each other and to code as files do. Here they are
staged: pages that lie elsewhere get a name of the site, links follow them, and code that is linked gets a page of its
own, with numbered lines, so that nothing of the site leaves it.
"""

import json
import os
import re
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from docutils import nodes
from pygments import highlight
from pygments.formatters import HtmlFormatter
from pygments.lexers import TextLexer, get_lexer_for_filename
from pygments.util import ClassNotFound
from sphinx.application import Sphinx
from sphinx.config import Config
from sphinx.errors import ExtensionError

ROOT = Path(__file__).parents[2]
ELSEWHERE = {
    "configuration.md": "config/README.md",
    "exhibits.md": "paper_figures/README.md",
    "notebooks/index.md": "notebooks/README.md",
    "changelog.md": "CHANGELOG.md",
}
FENCE = re.compile(r"(^```.*?^```$|`[^`\n]*`)", re.DOTALL | re.MULTILINE)
LINK = re.compile(r"(\]\()([^)\s]+)(\))")
# A link that is called as its file is, on a forge, is called as its page is, on the site.
NAMED_AS_FILE = re.compile(r"\[[\w./-]+\.md\]\((?!repository:)")
NOT_RUN = (
    "```{note}\nShown without outputs, since there was no run to look into when this page was made: `make reproduce`, "
    "then `make docs`.\n```"
)
shown: set[str] = set()  # files that get a page
outside: dict[str, set[str]] = {}  # links that leave the site, and the pages that have them; nobody follows them here


def pages() -> dict[str, str]:
    """{name in the site's sources: file of the repository}."""
    own = {file.name: f"docs/{file.name}" for file in sorted((ROOT / "docs").glob("*.md"))}
    notebooks = {f"notebooks/{file.name}": f"notebooks/{file.name}" for file in (ROOT / "notebooks").glob("*.ipynb")}
    return own | ELSEWHERE | notebooks


def moved(link: str, home: str, name: str) -> str:
    """A link of the file `home` as the page `name` has it; `ExtensionError` where it leads nowhere."""
    target, mark, place = link.partition("#")
    if not target or ":" in target:
        return link
    file = os.path.normpath(os.path.join(os.path.dirname(home), target))
    names = {of: page for page, of in pages().items()} | {"README.md": "index.md"}
    here = os.path.dirname(name) or "."
    if file in names:
        return os.path.relpath(names[file], here) + mark + place
    if not (ROOT / file).exists() or file.startswith(".."):
        raise ExtensionError(f"{home}: a link to {link}, which is not there")
    if file.startswith("docs/images/"):
        return os.path.relpath(file.removeprefix("docs/"), here)
    shown.add(file)
    return f"repository:{file}{mark}{place}"


def with_links_moved(text: str, home: str, name: str) -> str:
    """A page's text, its code left alone."""
    parts = FENCE.split(text)
    for at in range(0, len(parts), 2):
        linked = LINK.sub(lambda found: found[1] + moved(found[2], home, name) + found[3], parts[at])
        parts[at] = NAMED_AS_FILE.sub("[](", linked)
    return "".join(parts)


def stage(app: Sphinx, config: Config) -> None:
    """Write the sources of the site."""
    source = Path(app.srcdir)
    for name, home in pages().items():
        text = (ROOT / home).read_text(encoding="utf-8")
        if home.endswith(".ipynb"):
            text = _notebook(text, home, name, run=config.nb_execution_mode != "off")
        else:
            text = with_links_moved(text, home, name)
        (source / name).parent.mkdir(exist_ok=True)
        (source / name).write_text(text, encoding="utf-8")
    shutil.copytree(ROOT / "docs/images", source / "images", dirs_exist_ok=True)


def _notebook(text: str, home: str, name: str, run: bool) -> str:
    """A notebook with its links moved; one that is not run says so."""
    content = json.loads(text)
    for cell in content["cells"]:
        if cell["cell_type"] == "markdown":
            cell["source"] = with_links_moved("".join(cell["source"]), home, name)
    if not run:
        note = {"cell_type": "markdown", "id": "not-run", "metadata": {}, "source": NOT_RUN}
        content["cells"].insert(1, note)
    return json.dumps(content)


def resolve(app: Sphinx, doctree: nodes.document, docname: str) -> None:
    """Lead links to files of the repository to their pages."""
    for node in doctree.findall(nodes.reference):
        if (uri := node.get("refuri", "")).startswith("repository:"):
            file, _, line = uri.removeprefix("repository:").partition("#")
            page = app.builder.get_relative_uri(docname, _page(file))
            node["refuri"] = page + (f"#L-{line.removeprefix('L')}" if line else "")
            node["internal"] = True
        elif uri.startswith("http"):
            outside.setdefault(uri, set()).add(docname)


def _page(file: str) -> str:
    return f"files/{file}"


def file_pages(app: Sphinx) -> Iterator[tuple[str, dict[str, Any], str]]:
    """A page of each file, and of each folder with its files, that something links to."""
    queue = sorted(shown)
    for file in queue:
        path = ROOT / file
        if path.is_dir():
            inside = sorted(one.name for one in path.iterdir() if one.is_file())
            queue += [one for one in (f"{file}/{name}" for name in inside) if one not in queue]
            here = _page(file)
            links = (f'<a href="{app.builder.get_relative_uri(here, _page(f"{file}/{n}"))}">{n}</a>' for n in inside)
            body = "<ul>" + "".join(f"<li>{link}</li>" for link in links) + "</ul>"
        else:
            body = _code(path)
        yield _page(file), {"title": file, "body": f"<h1><code>{file}</code></h1>{body}"}, "page.html"


def _code(path: Path) -> str:
    """A file, coloured, each line with its number and an anchor."""
    try:
        lexer = get_lexer_for_filename(path.name)
    except ClassNotFound:
        lexer = TextLexer()
    form = HtmlFormatter(linenos="inline", linespans="L", cssclass="highlight source")
    return highlight(path.read_text(encoding="utf-8"), lexer, form)


def list_outside(app: Sphinx, error: Exception | None) -> None:
    """Write the links that leave the site, for whoever checks them with a network."""
    if error is None:
        lines = [f"{uri}  {', '.join(sorted(names))}\n" for uri, names in sorted(outside.items())]
        Path(app.outdir, "external-links.txt").write_text("".join(lines), encoding="utf-8")


def setup(app: Sphinx) -> dict[str, bool]:
    """Stage the sources when the configuration is known."""
    app.connect("config-inited", stage)
    app.connect("doctree-resolved", resolve)
    app.connect("html-collect-pages", file_pages)
    app.connect("build-finished", list_outside)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
