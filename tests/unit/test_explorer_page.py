"""The explorer in headless Chromium: no error, no network, and slider, click, keys, picker and a second run work.

Without a Chromium (Debian: apt install chromium) these tests are skipped.
"""

import base64
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from explored_run import HALL, LONE_Y, YARD, crowd, draw_page, forecasts, make_page, make_run

from modlhmp.forecasting.files import write_forecasts
from modlhmp.study.explorer.look import page
from modlhmp.study.explorer.pack import packed, unpacked
from modlhmp.study.layout import Layout

browser = pytest.importorskip("browser", reason="websocket-client is not installed")
pytestmark = pytest.mark.skipif(not browser.CHROMIUM, reason="no Chromium (Debian: apt install chromium)")
MAP, OVER, CHART, CYLINDER = ".base", "#map0", "#chart", "#cylinder"


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    """The page of a run with a hall of made-up and a yard of recorded people."""
    return make_page(Layout("small", str(tmp_path_factory.mktemp("explored"))))


@pytest.fixture(scope="module")
def opened(path):
    """The page in a browser; tests leave it as they found it."""
    with browser.Page(path) as one:
        ready(one)
        yield one


@pytest.fixture
def shown(opened):
    """The page, which must not have said an error nor asked a network once a test is done."""
    opened.ask("document.activeElement.blur()")
    opened.press("Escape", "Escape", "1")
    yield opened
    assert not opened.faults
    assert all(one.startswith(("file:", "data:")) for one in opened.asked)


def ready(one):
    one.until("document.documentElement?.dataset.ready === 'yes'")
    one.drawn()


def state(one, name):
    return one.ask(f"explorer.state.{name}")


def where(one, x, y, number=0):
    """Where a position of a dataset is on its map, as shares of the map's width and height."""
    return one.ask(f"(({{ view: v }}) => [v.px({x}) / v.width, v.py({y}) / v.height])(explorer.sets[{number}])")


def choose(one, number):
    """The person at a place of the list."""
    one.set("#list", one.ask(f"document.querySelector('#list').options[{number}].value"))


def test_the_page_reads_what_python_packed(shown, path):
    """Every array of the page is that of the data."""
    text = shown.ask(f"JSON.stringify(explorer.sets.map((one) => one.set), {PLAIN})")
    held = Path(path).read_text().split('id="data">')[1].split("<")[0]

    def same(found, wanted):
        if hasattr(wanted, "tolist"):
            assert len(found) == len(wanted)
            np.testing.assert_allclose([float(one) for one in found], wanted, rtol=1e-6, atol=1e-6)
        elif isinstance(wanted, dict):
            assert set(found) == set(wanted)
            for key, one in wanted.items():
                same(found[key], one)
        elif isinstance(wanted, list):
            assert len(found) == len(wanted)
            for one, other in zip(found, wanted, strict=True):
                same(one, other)
        else:
            assert found == wanted

    same(json.loads(text), unpacked(base64.b64decode(held))["sets"])


@pytest.mark.parametrize("layer", ["cliff", "stef", "flow", "exits"])
def test_every_layer_has_a_picture_of_its_own(shown, layer):
    shown.set("#hour", 1, "input")
    before = shown.pixels(MAP)
    shown.click(f"[value={layer}]")
    assert state(shown, "layer") == layer
    if layer != "cliff":
        assert shown.pixels(MAP) != before
    assert "there is no map" not in shown.text(".panel figcaption")
    shown.set("#hour", 0, "input")


def test_the_slider_changes_the_picture(shown):
    """And says which hour it is."""
    seen = []
    for value in (0, 1, 2):
        shown.set("#hour", value, "input")
        seen.append((shown.pixels(MAP), shown.text("#hourname")))
    assert len({pixels for pixels, _ in seen}) == 3
    assert [name for _, name in seen] == ["whole day", "09:00–10:00", "10:00–11:00"]
    shown.set("#hour", 0, "input")


def test_pointing_shows_a_location_and_a_click_keeps_it(shown):
    """Its mixture, its components and its counts."""
    shown.point(OVER, 0.5, 0.6, press=False)
    hovered = state(shown, "place")
    shown.ask("explorer.sets[0].view.fit()")
    shown.point(OVER, *where(shown, 14, 0))
    assert state(shown, "place") == {"x": 14, "y": 0}
    assert state(shown, "pinned")
    here = shown.pixels(CYLINDER)
    assert shown.ask("document.querySelectorAll('#components tbody tr').length") >= 1
    assert "people within" in shown.text("#counts")
    shown.point(OVER, 0.9, 0.2, press=False)
    assert state(shown, "place") == {"x": 14, "y": 0}  # pointing elsewhere changes nothing
    shown.ask(f"document.querySelector('{OVER}').focus()")
    shown.press("ArrowRight")
    assert state(shown, "place") == {"x": 15, "y": 0}
    assert shown.pixels(CYLINDER) != here
    shown.press("Escape")
    assert state(shown, "place") is None
    assert hovered is None or hovered != {"x": 14, "y": 0}


def test_keys_do_all_that_hands_do(shown):
    """Hours, layers, side by side, seconds."""
    first = shown.pixels(MAP)
    shown.press("]")
    assert state(shown, "period") == 1
    shown.press("[", "2")
    assert state(shown, "layer") == "stef"
    shown.press("1", "c")
    assert shown.ask("!document.querySelector('[data-panel=\"1\"]').hidden")
    shown.press("c")
    assert shown.pixels(MAP) == first
    shown.press(".", ".", ",")
    assert state(shown, "step") == 1
    shown.press(",", "/")
    assert shown.ask("document.activeElement.id") == "search"


def test_two_hours_side_by_side_are_two_pictures(shown):
    shown.press("c")
    shown.set("#hour", 1, "input")
    shown.set("#otherhour", 2)
    left, right = shown.pixels(MAP), shown.pixels("[data-panel='1'] .base")
    assert left != right
    shown.set("#otherhour", 1)
    assert shown.pixels("[data-panel='1'] .base") != right
    shown.press("c")
    shown.set("#hour", 0, "input")


@pytest.fixture
def second(shown):
    """The hall, and beside it the yard from 10 to 11, which has nobody who walks alone; as it was, once it is done."""
    shown.press("c")
    shown.set("#other", "1")
    shown.set("#otherhour", 2)
    for number in (0, 1):
        shown.ask(f"explorer.sets[{number}].view.fit()")
    yield shown
    shown.set("#other", "0")
    shown.set("#otherhour", 2)
    shown.ask("document.activeElement.blur()")
    shown.press("Escape", "c")
    assert state(shown, "place") is None
    assert shown.ask("document.querySelector('[data-panel=\"1\"]').hidden")


def card(one):
    """What a location's card says: where and when, and its counts."""
    return one.text("#where"), dict(zip(*(one.ask(
        f"[...document.querySelectorAll('#counts {name}')].map((each) => each.textContent)") for name in ("dt", "dd")
    ), strict=True))  # fmt: skip


def test_a_tap_on_the_second_map_shows_what_is_there(second):
    """Its dataset at its hour, as the first map would have shown it; the card says which of the two it is of."""
    second.point("#map1", *where(second, 14, 0, 1))
    title, counts = card(second)
    assert title.startswith("Yard")
    assert title.endswith("(14.0, 0.0) m, 10:00–11:00")
    ring = second.pixels(OVER)  # the other place has no such location
    second.set("#otherhour", 1)  # the card follows its map
    assert card(second) == (title.replace("10:00–11:00", "09:00–10:00"), card(second)[1])
    assert card(second)[1] != counts
    second.ask("document.querySelector('#byhour').dispatchEvent(new MouseEvent('click', { clientX: 1e4 }))")
    second.drawn()
    assert (state(second, "otherPeriod"), state(second, "period")) == (2, 0)
    assert card(second) == (title, counts)
    second.point(OVER, *where(second, 14, 0))
    assert card(second)[0] == "Hall, (14.0, 0.0) m, whole day"
    assert second.pixels(OVER) != ring
    second.press("c")
    assert card(second)[0] == "(14.0, 0.0) m, whole day"
    second.set("#set", 1)
    second.set("#hour", 2, "input")
    second.point(OVER, *where(second, 14, 0, 1))
    assert card(second)[1] == counts
    second.set("#set", 0)
    second.set("#hour", 0, "input")
    second.press("c")


def test_keys_on_the_second_map_are_its_own(second):
    """Its locations, its hours, its scale; and a place of the one is no place of the other."""
    second.ask("document.querySelector('#map1').focus()")
    second.press("ArrowUp")
    assert state(second, "panel") == 1
    for _ in range(30):
        second.press("ArrowUp")
    assert state(second, "place.y") < LONE_Y - 2  # where one person alone walks in the hall
    second.press("[")
    assert (state(second, "otherPeriod"), state(second, "period")) == (1, 0)
    second.press("]")
    assert second.text("#where").endswith("10:00–11:00")
    second.ask("document.querySelector('#map0').focus()")
    for _ in range(30):
        second.press("ArrowUp")
    assert (state(second, "panel"), state(second, "place.y")) == (0, LONE_Y)
    second.set("#otherhour", 1)
    second.ask("document.querySelector('#map1').focus()")
    second.press("ArrowRight")
    second.set("#other", "0")
    assert state(second, "place") is None  # which was of the yard


@pytest.mark.parametrize(("nearer", "farther", "all_of_it"), [("+", "-", "0"), ("in", "out", "fit")])
@pytest.mark.parametrize("panel", [0, 1])
def test_each_map_has_a_scale_of_its_own(second, panel, nearer, farther, all_of_it):
    """By keys and by buttons."""

    def act(what):
        if len(what) == 1:
            second.press(what)
        else:
            second.click(f"#{what}{panel}")
        return second.ask("explorer.sets.map(({ view }) => view.scale)")

    second.ask(f"document.querySelector('#map{panel}').focus()")
    before = second.ask("explorer.sets.map(({ view }) => view.scale)")
    scales = [act(what) for what in (nearer, farther, farther, all_of_it)]
    own, other = ([one[at] for one in scales] for at in (panel, 1 - panel))
    assert other == [before[1 - panel]] * 4
    assert own[0] > own[1] > own[2]
    assert own[3] == before[panel]


def test_who_starts_on_a_second_map_of_the_same_place_is_chosen_there(second):
    second.set("#other", "0")
    x, y = start_of_the_first(second)
    second.point("#map1", x, y)
    assert state(second, "person") is not None
    second.press("Escape")


def test_a_person_is_found_and_followed(shown):
    """By the list, second by second, and by every method."""
    shown.ask("document.querySelector('#search').focus()")
    shown.type("10:")
    found = shown.ask("document.querySelectorAll('#list option').length")
    assert 0 < found < 25
    before, chart = shown.pixels(OVER), shown.pixels(CHART)
    choose(shown, 0)
    assert shown.pixels(OVER) != before
    assert shown.pixels(CHART) != chart
    at_t0 = shown.pixels(OVER)
    shown.set("#second", 6, "input")
    at_six = shown.pixels(OVER)
    assert at_six != at_t0
    told = shown.text("#now")
    assert told.startswith("After 6 s. This person is there.")
    for method, words in {
        "snippets": "chance of having left 0 % (0 of 14",
        "tc_cliff": "ranks at 12 s",
        "cvm": "one path",
    }.items():
        shown.set("#method", method)
        shown.drawn()
        assert words in shown.text("#now")
    shown.set("#second", 12, "input")
    shown.set("#method", "snippets")
    shown.drawn()
    assert "chance of having left 50 % (7 of 14" in shown.text("#now")
    with_density = shown.pixels(OVER)
    shown.click("#density")
    assert shown.pixels(OVER) != with_density
    without_modes = shown.pixels(OVER)
    shown.click("#modes")
    assert shown.pixels(OVER) != without_modes
    shown.ask("for (const id of ['modes', 'density']) document.querySelector('#' + id).click()")
    shown.set("#search", "", "input")


def test_samples_with_probabilities_have_no_chances(tmp_path):
    """The page would count each as often as the others; their paths are drawn."""
    layout = Layout("theirs", str(tmp_path))
    make_run(layout, (HALL,), ["cliff"])
    ids, theirs = forecasts(crowd(seed=1), "snippets")
    write_forecasts(layout.forecast("hall", "snippets", "tuesday"), [(0, ids, theirs)], alike=False)
    with browser.Page(draw_page(layout, (HALL,), maps=["cliff"])) as one:
        ready(one)
        choose(one, 0)
        one.set("#method", "snippets")
        one.drawn()
        told = one.text("#now")
        assert "no modes, density or chances" in told and "%" not in told
        plain = one.pixels(OVER)
        for part in ("modes", "density"):
            one.click(f"#{part}")
        assert one.pixels(OVER) == plain
        one.click("#futures")
        assert one.pixels(OVER) != plain
        assert not one.faults


def start_of_the_first(one):
    """Where the first person starts, as shares of the hall's map."""
    people = "explorer.sets[0].set.people"
    rows = one.ask(f"{people}.rows")
    return where(one, one.ask(f"{people}.observed[{rows - 1}]"), one.ask(f"{people}.observed[{2 * rows - 1}]"))


def test_a_click_on_a_start_chooses_that_person(shown):
    shown.point(OVER, *start_of_the_first(shown))
    assert state(shown, "person") is not None


def test_the_chart_moves_the_person(shown):
    """The two are one: a click on a horizon is that second."""
    choose(shown, 3)
    before = shown.pixels(OVER)
    shown.point(CHART, 0.6, 0.5)
    assert 4 <= state(shown, "step") <= 9
    assert shown.pixels(OVER) != before
    assert shown.text("#legend .value").endswith(" m")


def test_playing_moves_and_can_be_stopped(shown):
    shown.press(" ")
    assert state(shown, "playing") == "hours"
    one = shown.pixels(OVER)
    shown.until("explorer.state.period === 2")
    assert shown.pixels(OVER) != one
    shown.press(" ")
    assert state(shown, "playing") is None
    shown.set("#hour", 0, "input")


def test_recorded_people_are_not_offered(shown):
    shown.set("#set", 1)
    shown.drawn()
    assert shown.ask("document.querySelector('#somebody').hidden")
    assert "Aggregates only" in shown.text("#kind")
    shown.set("#set", 0)


def test_grey_and_theme_change_the_picture(shown):
    shown.set("#hour", 1, "input")
    coloured = shown.pixels(MAP)
    shown.click("#grey")
    grey = shown.pixels(MAP)
    assert grey != coloured
    colours = shown.ask(COLOURFULNESS)
    assert colours < 30  # no hue is left
    shown.click("#grey")
    for _ in range(2):
        shown.click("#theme")
    assert shown.ask("document.documentElement.hasAttribute('data-dark')")
    assert shown.pixels(MAP) != coloured
    shown.click("#theme")
    shown.set("#hour", 0, "input")


def test_a_second_run_is_added_from_its_page(shown, tmp_path):
    """Its maps stand beside; what is no page of ours is refused with its name."""
    bad = tmp_path / "bad.html"
    bad.write_text("<html>nothing</html>")
    shown.choose_file("#file", bad)
    shown.until("document.querySelector('#dropped').textContent.includes('bad.html cannot be added')")
    tree = {"form": 99, "sets": []}
    bad.write_text(page("bad", packed(tree)))
    shown.choose_file("#file", bad)
    shown.until("document.querySelector('#dropped').textContent.includes('form 99')")
    shown.choose_file("#file", make_page(Layout("other", str(tmp_path)), (HALL,)))
    shown.until("document.querySelector('#dropped').textContent === 'Run other is added.'")
    assert shown.ask("!document.querySelector('[data-panel=\"1\"]').hidden")
    assert "Hall (other)" in shown.text("#set")
    shown.press("c")


def of_plan(folder, image, run):
    """The page of a run whose hall has a floor plan of these rows of grey, 10 m a pixel."""
    rows = "\n".join(" ".join(map(str, row)) for row in image)
    (folder / f"{run}.pgm").write_text(f"P2 {len(image[0])} {len(image)} 255\n{rows}\n")
    (folder / f"{run}.yaml").write_text(
        f"image: {run}.pgm\nresolution: 10\norigin: [-8, 2, 0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.2\n"
    )
    return make_page(Layout(run, str(folder)), (replace(HALL, floor_plan=(str(folder / f"{run}.yaml"),)),))


@pytest.mark.parametrize("dark", [False, True])
def test_two_runs_of_one_name_have_floor_plans_of_their_own(tmp_path, dark):
    """A dropped run is drawn as its own page draws it."""
    images = {"one": [[0, 255], [0, 255]], "two": [[255, 0], [0, 0]]}
    paths = [of_plan(tmp_path, image, run) for run, image in images.items()]
    grounds = []
    for path in paths:
        with browser.Page(path, dark=dark) as page:
            ready(page)
            grounds.append(page.ask(GROUND.replace("NUMBER", "0")))
    assert grounds[0] != grounds[1]
    with browser.Page(paths[0], dark=dark) as page:
        ready(page)
        page.choose_file("#file", paths[1])
        page.until("document.querySelector('#dropped').textContent === 'Run two is added.'")
        page.drawn()
        assert [page.ask(GROUND.replace("NUMBER", str(number))) for number in (0, 1)] == grounds


@pytest.mark.parametrize(("width", "dark"), [(390, False), (390, True), (1280, True)])
def test_it_fits_small_and_dark_screens(path, width, dark):
    """Nothing is wider than the screen, whatever can be pressed is large enough for a finger, and a tap works."""
    with browser.Page(path, width=width, height=844, dark=dark, phone=width < 500) as one:
        ready(one)
        assert one.ask("document.documentElement.scrollWidth") <= width
        assert one.ask("document.documentElement.hasAttribute('data-dark')") is dark
        assert not one.ask(SMALL)
        if width < 500:
            before = one.pixels(OVER)
            one.tap(OVER, *where(one, 14, 0))
            assert one.pixels(OVER) != before
        assert not one.faults


@pytest.mark.parametrize(("maps", "number", "caption"), [([], 24, "Flow"), (["cliff"], 2, "there is no map")])
def test_a_run_with_little_to_show_says_so(tmp_path, maps, number, caption):
    """One that compares no map has its flow; one of too few recorded people nothing, without an error."""
    path = make_page(Layout("little", str(tmp_path)), (YARD,), (), maps, number)
    with browser.Page(path) as one:
        ready(one)
        assert caption in one.text(".panel figcaption")
        assert one.ask("document.querySelector('[value=stef]').disabled")
        one.press("]", "c", "2", ".")
        one.point(OVER, 0.5, 0.5)
        assert not one.faults


def test_the_keyboard_reaches_everything(shown):
    """Tab by tab, from the first choice to the last, wherever the page was left before."""
    reached = []
    for _ in range(90):
        shown.press("Tab")
        reached.append(shown.ask("document.activeElement.id || document.activeElement.value || ''"))
    wanted = ["set", "cliff", "grey", "theme", "map0", "in0", "play", "hour", "compare", "file", "search", "list"]
    first = reached.index("set")
    order = [reached.index(one, first) for one in wanted]
    assert order == sorted(order)
    assert {"chart", "metric", "protocol"} <= set(reached)


def test_every_picture_and_field_has_a_name(shown):
    """For those who hear the page: canvases, fields and buttons; what only repeats them is hidden from them."""
    nameless = shown.ask(NAMELESS)
    assert not nameless


def test_words_can_be_read(path):
    """Contrast of every text with its ground is at least 4.5, as WCAG's AA asks, light and dark."""
    for dark in (False, True):
        with browser.Page(path, dark=dark) as one:
            ready(one)
            choose(one, 0)
            assert not one.ask(CONTRAST)


PLAIN = """(key, value) => {
  if (value instanceof Float64Array) return Array.from(value, (one) => (Number.isNaN(one) ? "nan" : one));
  return key === "errors" && !value.complete ? undefined : value; // what the page has computed
}"""

COLOURFULNESS = """(() => {
  const canvas = document.querySelector(".base"), image = canvas.getContext("2d");
  const { data } = image.getImageData(0, 0, canvas.width, canvas.height);
  let most = 0;
  for (let i = 0; i < data.length; i += 4)
    if (data[i + 3] > 100) most = Math.max(most, Math.abs(data[i] - data[i + 1]), Math.abs(data[i] - data[i + 2]));
  return most;
})()"""

# Colours of the floor at the same places, where nobody walks and nothing is written.
GROUND = """[[-3, 7], [4, 7], [-3, 17], [4, 16]].map(([x, y]) => {
  const { view } = explorer.sets[0], canvas = document.querySelectorAll(".base")[NUMBER];
  return [...canvas.getContext("2d").getImageData(view.px(x), view.py(y), 1, 1).data];
})"""

NAMELESS = """[...document.querySelectorAll("canvas, input, select, button")]
  .filter((one) => one.ariaHidden !== "true" && !one.getAttribute("aria-label")
    && !one.labels?.[0]?.textContent.trim() && !(one.tagName === "BUTTON" && one.textContent.trim()))
  .map((one) => one.outerHTML.slice(0, 80))"""

SMALL = """[...document.querySelectorAll("button, select, .choice span")]
  .filter((one) => one.offsetParent && one.offsetHeight < 30)
  .map((one) => [one.id || one.textContent, one.offsetHeight])"""

CONTRAST = """(() => {
  const parse = (colour) => colour.match(/[\\d.]+/g).map(Number);
  const linear = (one) => (one <= 0.03928 ? one / 12.92 : ((one + 0.055) / 1.055) ** 2.4);
  const light = (colour) => [0.2126, 0.7152, 0.0722].reduce((sum, part, i) => sum + part * linear(colour[i] / 255), 0);
  const ground = (one) => {
    for (; one; one = one.parentElement) {
      const colour = parse(getComputedStyle(one).backgroundColor);
      if (colour[3] !== 0) return colour;
    }
    return [255, 255, 255];
  };
  const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT), bad = [];
  for (let node = walker.nextNode(); node; node = walker.nextNode()) {
    const one = node.parentElement, text = node.textContent.trim();
    if (!text || !one.offsetParent || one.closest("script, style, noscript, .hidden, input:disabled + span")) continue;
    const [more, less] = [light(parse(getComputedStyle(one).color)), light(ground(one))].sort((a, b) => b - a);
    if ((more + 0.05) / (less + 0.05) < 4.5) bad.push([text.slice(0, 40), (more + 0.05) / (less + 0.05)]);
  }
  return bad;
})()"""
