"""The site is made without a warning, needs nothing from elsewhere, and leads nowhere that is not there."""

import importlib.util
import re
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import quote, unquote, urlsplit

import pytest
from browser import CHROMIUM
from browser import Page as Browser

import modlhmp

ROOT = Path(__file__).parents[2]
AA = 4.5  # contrast of text, WCAG 2.2
# What loads by itself when a page is opened: (element, attribute).
LOADED = {("img", "src"), ("script", "src"), ("link", "href"), ("source", "src"), ("iframe", "src"), ("video", "src")}


class Page(HTMLParser):
    """Links, anchors, images and what is loaded, of one page."""

    def __init__(self, file):
        super().__init__()
        self.links, self.anchors, self.loaded, self.without_alt, self.formulas = [], set(), [], [], 0
        self.feed(file.read_text(encoding="utf-8"))

    def handle_starttag(self, tag, attrs):
        named = dict(attrs)
        self.anchors |= {named.get("id"), named.get("name")}
        self.formulas += tag == "math"
        if tag == "a" and named.get("href"):
            self.links.append(named["href"])
        if tag == "img" and not (named.get("alt") or "").strip():
            self.without_alt.append(named.get("src"))
        if named.get("rel") not in ("index", "search", "next", "prev", "canonical"):
            self.loaded += [named[of] for of in named if (tag, of) in LOADED]


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """{path: page} of the site, its notebooks not run; any warning is an error."""
    folder = tmp_path_factory.mktemp("site")
    (folder / "source").mkdir()
    done = subprocess.run(
        [sys.executable, "-m", "sphinx", "--quiet", "--fail-on-warning", "--keep-going", "-D", "nb_execution_mode=off",
         "-c", ROOT / "docs", folder / "source", folder / "html"],
        capture_output=True, text=True, timeout=600, check=False,
    )  # fmt: skip
    assert done.returncode == 0 and not done.stderr, done.stderr
    return {file: Page(file) for file in sorted((folder / "html").rglob("*.html"))}


@pytest.fixture(scope="module")
def root(site):
    return next(file.parent for file in site if file.name == "genindex.html")


def test_every_text_has_its_page(site, root):
    names = {file.relative_to(root).as_posix() for file in site}
    for page in [*ROOT.glob("docs/*.md"), *ROOT.glob("notebooks/*.ipynb")]:
        folder = "" if page.suffix == ".md" else "notebooks/"
        assert f"{folder}{page.stem}.html" in names
    assert {"configuration.html", "exhibits.html", "notebooks/index.html", "changelog.html"} <= names
    assert {"files/src/modlhmp/maps/cliff.py.html", "files/tests/reference/twins.py.html"} <= names


def test_links_lead_to_pages_and_places_that_are_there(site):
    count = 0
    for file, page in site.items():
        for link in page.links:
            parts = urlsplit(link)
            if parts.scheme:
                assert parts.scheme in ("https", "http", "mailto"), (file, link)
                continue
            target = (file.parent / unquote(parts.path)).resolve() if parts.path else file
            assert target.exists(), (file.name, link)
            if parts.fragment and target in site:
                assert unquote(parts.fragment) in site[target].anchors, (file.name, link)
                count += 1
    assert count > 1000


def test_links_that_leave_the_site_are_listed(site, root):
    listed = {line.split()[0] for line in (root / "external-links.txt").read_text().splitlines()}
    found = {link for page in site.values() for link in page.links if link.startswith("http")}
    assert found - listed <= {"https://github.com/pradyunsg/furo"}  # which the theme links to
    assert "https://arxiv.org/abs/2606.19031" in listed


def test_nothing_is_loaded_from_elsewhere(site, root):
    for file, page in site.items():
        for loaded in page.loaded:
            assert not urlsplit(loaded).scheme or loaded.startswith("data:"), (file, loaded)
            assert not loaded.startswith("//"), (file, loaded)
            assert loaded.startswith("data:") or (file.parent / urlsplit(loaded).path).exists(), (file, loaded)
    for sheet in root.rglob("*.css"):
        assert not re.findall(r"(?:@import|url\()\s*[\"']?(?:https?:)?//", sheet.read_text()), sheet


def test_every_image_says_what_it_shows(site):
    assert {file.name: page.without_alt for file, page in site.items() if page.without_alt} == {}


def test_formulas_are_mathml(site, root):
    method = (root / "method.html").read_text()
    assert site[root / "method.html"].formulas > 40
    assert "\\frac" not in method and "MathJax" not in method and "merror" not in method
    # The kernel of Eq. 2, as browsers get it.
    assert re.search(r"<mi>K</mi>\s*<mo[^>]*>\(</mo>\s*<mi>x</mi>", method)


def test_every_public_name_is_in_the_reference(root):
    """With its signature's types."""
    text = (root / "api.html").read_text()
    for name in modlhmp.__all__:
        assert f'id="modlhmp.{name}"' in text, name
    assert "horizon_s" in text and "float" in text


def test_pages_that_are_not_run_say_so(site, root):
    notebooks = [file for file in site if re.match(r"\d\d-", file.name)]
    assert len(notebooks) >= 8
    for file in notebooks:
        assert "Shown without outputs" in file.read_text()


# --- colours ---------------------------------------------------------------------------------------------------------


def luminance(colour):
    """Relative luminance of #rrggbb, as WCAG 2.2 defines it."""
    channels = (int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5))
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in channels]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def contrast(one, other):
    """Contrast ratio of two colours, 1 to 21."""
    low, high = sorted((luminance(one), luminance(other)))
    return (high + 0.05) / (low + 0.05)


def test_contrast_by_hand():
    assert contrast("#000000", "#ffffff") == pytest.approx(21)
    assert contrast("#777777", "#ffffff") == pytest.approx(4.48, abs=0.01)


@pytest.mark.parametrize("mode", ["LIGHT", "DARK"])
def test_text_can_be_read(mode, root):
    """Every colour of text on every colour behind it; and they are those that the pages have."""
    text = (ROOT / "docs/conf.py").read_text()
    block = re.search(rf"^{mode} = \{{(.*?)^\}}", text, re.DOTALL | re.MULTILINE)[1]
    colours = dict(re.findall(r'"color-([\w-]+)": "(#[0-9a-f]{6})"', block))
    backgrounds = [value for name, value in colours.items() if name.startswith("background")]
    texts = {name: value for name, value in colours.items() if not name.startswith("background")}
    assert len(backgrounds) >= 2 and len(texts) >= 6
    for name, value in texts.items():
        assert min(contrast(value, behind) for behind in backgrounds) >= AA, name
    page = (root / "index.html").read_text()
    assert all(f"--color-{name}: {value}" in page for name, value in colours.items())


# --- in a browser ---------------------------------------------------------------------------------------------------

PHONE = 390  # px wide
SEEN = ("index", "method", "api", "results-claims", "notebooks/02-a-cliff-location", "files/src/modlhmp/maps/cliff.py")
# [contrast, colours, words] of the text that is hardest to read.
HARDEST = """(() => {
  const parse = (said) => { const n = said.match(/[\\d.]+/g).map(Number); return n.length < 4 ? [...n, 1] : n; };
  const over = (top, below) => below.map((c, i) => i < 3 ? top[i] * top[3] + c * (1 - top[3]) : 1);
  const behind = (one) => one === null ? [255, 255, 255, 1] : (() => {
    const own = parse(getComputedStyle(one).backgroundColor);
    return own[3] === 1 ? own : over(own, behind(one.parentElement));
  })();
  const light = (c) => c.slice(0, 3).map((v) => v / 255)
    .map((v) => v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4)
    .reduce((sum, v, i) => sum + v * [0.2126, 0.7152, 0.0722][i], 0);
  let hardest = [21, "", ""];
  for (const one of document.body.querySelectorAll("*")) {
    const words = [...one.childNodes].filter((n) => n.nodeType === 3).map((n) => n.data.trim()).join("");
    if (!words || !one.checkVisibility({visibilityProperty: true})) continue;
    if (one.closest("svg, .headerlink, script, style")) continue;
    const below = behind(one), colour = over(parse(getComputedStyle(one).color), below);
    const [low, high] = [light(below), light(colour)].sort((a, b) => a - b);
    const found = (high + 0.05) / (low + 0.05);
    if (found < hardest[0]) hardest = [found, `${colour} on ${below}`, words.slice(0, 60)];
  }
  return hardest;
})()"""


@pytest.fixture(scope="module", params=["light", "dark", "phone"])
def opened(request, root):
    """(name, function that opens a page of the site) in a browser that likes it light, dark, or is a telephone."""
    if CHROMIUM is None:
        pytest.skip("no Chromium")
    how = {"dark": request.param == "dark"} | ({"phone": True, "width": PHONE} if request.param == "phone" else {})
    with Browser(root / "index.html", **how) as page:

        def opens(name):
            page.send("Page.navigate", url=(root / f"{name}.html").as_uri())
            page.until(f"document.readyState === 'complete' && location.pathname.endsWith('{name}.html')")
            return page

        yield request.param, opens


@pytest.mark.parametrize("name", SEEN)
def test_a_page_can_be_read_and_asks_nobody(opened, name):
    """Every text against what is behind it, as the browser draws it."""
    how, opens = opened
    page = opens(name)
    ratio, colours, words = page.ask(HARDEST)
    assert ratio >= AA, (how, colours, words)
    assert page.faults == []
    assert {address.partition(":")[0] for address in page.asked} <= {"file", "data", "about"}


def test_a_browser_leaves_nothing_behind(root):
    """Neither its profile nor its socket, which would lie in /tmp, nor a process that goes on writing."""
    if CHROMIUM is None:
        pytest.skip("no Chromium")
    with Browser(root / "index.html") as page:
        page.until("document.readyState === 'complete'")
        home = page.home
        assert {"profile"} < {file.name.partition(".")[0] for file in home.iterdir()}
    assert not home.exists()
    left = [file for file in Path("/proc").glob("[0-9]*/cmdline") if str(home).encode() in _read(file)]
    assert left == []


def _read(file):
    try:
        return file.read_bytes()
    except OSError:  # it has ended
        return b""


def test_no_page_is_wider_than_a_telephone(root):
    """Wide tables, code and formulas scroll in boxes of their own. A telephone's `innerWidth` grows with the page."""
    if CHROMIUM is None:
        pytest.skip("no Chromium")
    names = [file.relative_to(root).as_posix() for file in root.rglob("*.html")]
    names = [name for name in names if not name.startswith("files/")] + ["files/src/modlhmp/maps/cliff.py.html"]
    (root / "wide.html").write_text('<meta name="viewport" content="width=device-width"><p style="width: 500px">wide')
    with Browser(root / "index.html", phone=True, width=PHONE) as page:
        wide = {}
        for name in [*names, "wide.html"]:
            page.send("Page.navigate", url=(root / name).as_uri())
            page.until(f"document.readyState === 'complete' && location.pathname.endsWith('/{name}')")
            wide[name] = page.ask("document.documentElement.scrollWidth")
    (root / "wide.html").unlink()
    assert wide.pop("wide.html") > PHONE and len(wide) > 40  # what is too wide is seen
    assert {name: width for name, width in wide.items() if width > PHONE} == {}


@pytest.mark.parametrize(
    ("asked", "page", "told"),
    [
        ("without_map", "configuration", "of maps by hours, in an hour that has none"),
        ("sampling_radius_m", "configuration", "[m]"),
        ("observed_rows", "configuration", "rows that a forecaster sees"),
        ("homography", "configuration", "three rows of three numbers"),
        ("half_life_h", "api", "half"),
        ("Equation 2", "method", "K"),
        ("Algorithm 1", "method", "MoD-LHMP"),
        ("mean_heading", "maps", "rad"),
        ("FDE", "glossary", "final displacement error"),
        ("FreMEn", "glossary", "periodic parts"),
    ],
)
def test_a_name_is_found_by_the_search_at_once(searched, asked, page, told):
    """An option, an equation, a column, a word: the first that is found is the place that says what it is."""
    searched.send("Page.navigate", url=f"{searched.site}/search.html?q={quote(asked)}")
    searched.until("document.querySelector('#search-results li a') !== null")
    searched.until("/finished|found/.test(document.querySelector('.search-summary').textContent)")
    first = searched.ask("document.querySelector('#search-results li a').href")
    called = searched.ask("document.querySelector('#search-results li a').textContent")
    assert asked.lower().replace(" ", "-") in called.lower(), called  # not as the page is that it is on
    assert re.search(rf"/({page})\.html#.", first), first
    searched.send("Page.navigate", url=first.partition("#")[0])
    searched.until("document.readyState === 'complete' && location.href.includes('.html') && !/search/.test(location)")
    place = first.partition("#")[2]
    assert told in searched.ask(f"document.getElementById({place!r}).textContent")


@pytest.fixture(scope="module")
def searched(root):
    if CHROMIUM is None:
        pytest.skip("no Chromium")
    with Browser(root / "search.html") as page:
        page.site = root.as_uri()
        yield page


# --- links of the sources --------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def repository():
    spec = importlib.util.spec_from_file_location("repository", ROOT / "docs/_ext/repository.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize(
    ("link", "home", "name", "becomes"),
    [
        ("method.md#ranking", "docs/start.md", "start.md", "method.md#ranking"),
        ("../config/README.md#a-run", "docs/start.md", "start.md", "configuration.md#a-run"),
        ("../docs/maps.md", "config/README.md", "configuration.md", "maps.md"),
        ("../docs/live.md", "notebooks/08-forecast-in-a-loop.ipynb", "notebooks/08.ipynb", "../live.md"),
        ("images/explorer.png", "docs/explorer.md", "explorer.md", "images/explorer.png"),
        ("../src/modlhmp/api.py#L50", "docs/start.md", "start.md", "repository:src/modlhmp/api.py#L50"),
        ("https://arxiv.org/abs/1", "docs/start.md", "start.md", "https://arxiv.org/abs/1"),
        ("#here", "docs/start.md", "start.md", "#here"),
    ],
)
def test_links_follow_the_pages(repository, link, home, name, becomes):
    assert repository.moved(link, home, name) == becomes


@pytest.mark.parametrize("link", ["nothing.md", "../src/modlhmp/nothing.py#L1", "../../outside.md"])
def test_a_link_to_nothing_is_an_error(repository, link):
    with pytest.raises(repository.ExtensionError, match=re.escape(f"docs/start.md: a link to {link}")):
        repository.moved(link, "docs/start.md", "start.md")


def test_links_in_code_are_left_alone(repository):
    text = "`[a](b.md)` and\n```python\nx = [1](2)\n```\n[c](method.md)\n"
    assert repository.with_links_moved(text, "docs/start.md", "start.md") == text


def test_links_that_are_called_as_their_file_are_called_as_their_page(repository, root):
    text = "see [maps.md](maps.md#forms), [here](maps.md) and [config/README.md](../config/README.md)"
    moved = "see [](maps.md#forms), [here](maps.md) and [](configuration.md)"
    assert repository.with_links_moved(text, "docs/start.md", "start.md") == moved
    assert 'href="maps.html"><span class="std std-doc">Maps in and out' in (root / "command-line.html").read_text()
