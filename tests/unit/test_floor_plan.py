"""Floor plans: map_server's rules by hand, every form of image, the demo's plan against its people, bad files."""

import logging
import math
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from modlhmp import floor_plan
from modlhmp.floor_plan import FREE, OCCUPIED, UNKNOWN, FloorPlan, load_floor_plan, occupied_depth, value_at
from modlhmp.readers import read_recording
from modlhmp.storage import DataError
from modlhmp.study.demo import RECORDINGS, write_recording
from modlhmp.study.demo.hall import write_floor_plan

YAML = (
    "image: plan.pgm\nresolution: 0.5\norigin: [-1.0, 2.0, 0.0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
)


def plan_of(folder, grey, text=YAML):
    """A plan whose image has these grey values, top row first."""
    Image.fromarray(np.array(grey, np.uint8)).save(folder / "plan.pgm")
    (folder / "plan.yaml").write_text(text)
    return load_floor_plan(folder / "plan.yaml")


def test_thresholds_and_orientation(tmp_path):
    """Black is occupied, white free, grey unknown; the image's last row lies at the origin."""
    plan = plan_of(tmp_path, [[0, 127], [255, 254]])
    assert plan.cells.tolist() == [[FREE, FREE], [OCCUPIED, UNKNOWN]]
    assert value_at(plan, plan.cells, [-0.9, -0.9, -0.1], [2.6, 2.1, 2.9]).tolist() == [OCCUPIED, FREE, UNKNOWN]


def test_negate(tmp_path):
    """With `negate`, white is occupied."""
    plan = plan_of(tmp_path, [[0, 255]], YAML.replace("negate: 0", "negate: 1"))
    assert plan.cells.tolist() == [[FREE, OCCUPIED]]


def test_beyond_the_plan_nothing_is_occupied(tmp_path):
    """Nor where a position is not known."""
    plan = plan_of(tmp_path, [[0, 0], [0, 0]])
    x, y = np.array([-1.001, 0.001, np.nan, -0.5]), np.array([2.5, 2.5, 2.5, 3.001])
    assert value_at(plan, plan.cells, x, y).tolist() == [0, 0, 0, 0]


def test_a_turned_plan():
    """A quarter turn about the origin: the grid's first row runs up."""
    plan = FloorPlan(np.array([[OCCUPIED, FREE, UNKNOWN]], np.uint8), 1.0, (5.0, 5.0), np.pi / 2)
    assert value_at(plan, plan.cells, [4.5, 4.5, 4.5, 5.5], [5.5, 6.5, 7.5, 5.5]).tolist() == [2, 0, 1, 0]


def test_depth_of_a_wall():
    """Three cells of 1 m: their centres lie 0.5, 1.5 and 0.5 m deep."""
    cells = np.full((9, 5), FREE, np.uint8)
    cells[:, 1:4] = OCCUPIED
    depth = occupied_depth(FloorPlan(cells, 1.0, (0.0, 0.0), 0.0))
    np.testing.assert_allclose(depth[4], [0, 0.5, 1.5, 0.5, 0])
    np.testing.assert_allclose(depth[0], [0, 0.5, 0.5, 0.5, 0])  # beyond the plan is not occupied


def test_nobody_of_the_demo_walks_into_a_wall(tmp_path, load_shipped):
    """The demo hall's plan fits its people: all clean rows lie in free area."""
    write_floor_plan(tmp_path / "hall/hall.yaml")
    plan = load_floor_plan(tmp_path / "hall/hall.yaml")
    assert 0.3 < (plan.cells == FREE).mean() < 0.6
    assert set(np.unique(plan.cells)) == {FREE, OCCUPIED}
    made = RECORDINGS[0]
    write_recording(tmp_path / made.file, made.site, made.day, seed=1, scale=0.2)
    dataset = load_shipped("demo_hall", tmp_path)
    tracks, _account = read_recording(tmp_path / made.file, dataset, made.day)
    inside = (np.abs(tracks.x) < 36) & (np.abs(tracks.y) < 15)  # not the absurd rows
    assert inside.mean() > 0.99
    assert (value_at(plan, plan.cells, tracks.x, tracks.y)[inside] == FREE).mean() > 0.9999


# --- map_server's rules ---------------------------------------------------------------------------------------------


def published(pixel, alpha, mode, negate, occupied, free):
    """The value of map_server's grid, -1 or 0 to 100, for a pixel: colours and alpha from 0 to 1."""
    channels = [*pixel, alpha] if mode == "trinary" and alpha is not None else pixel
    shade = sum(channels) / len(channels)
    if mode == "raw":
        value = math.floor(shade * 255 + 0.5)
        return value if value <= 100 else -1
    p = shade if negate else 1 - shade
    if mode == "scale" and alpha is not None and alpha < 1:
        return -1
    if p > occupied or p < free:
        return 100 if p > occupied else 0
    return -1 if mode == "trinary" else 1 + 98 * (p - free) / (occupied - free)


@pytest.mark.parametrize("mode", ["trinary", "scale", "raw"])
@pytest.mark.parametrize("negate", [0, 1])
@pytest.mark.parametrize("bands", ["L", "LA", "RGB", "RGBA"])
def test_every_mode_is_map_servers(tmp_path, mode, negate, bands):
    """Its 100 is occupied, its 0 free, what is unknown or lies between is unknown here."""
    rng = np.random.default_rng(7)
    shape = (40, 50) if bands == "L" else (40, 50, len(bands))
    values = rng.choice(np.array([0, 1, 49, 50, 90, 100, 101, 166, 205, 254, 255], np.uint8), shape)
    Image.fromarray(values, bands).save(tmp_path / "plan.png")
    text = YAML.replace(".pgm", ".png").replace("negate: 0", f"negate: {negate}") + f"mode: {mode}\n"
    (tmp_path / "plan.yaml").write_text(text)
    cells = load_floor_plan(tmp_path / "plan.yaml").cells
    for found, row in zip(cells[::-1], values.reshape(40, 50, -1) / 255, strict=True):
        for cell, channels in zip(found, row, strict=True):
            colours, alpha = (channels[:-1], channels[-1]) if "A" in bands else (channels, None)
            colours = list(colours) * (3 if bands.startswith("L") else 1)  # map_server sees grey as three colours
            value = published(colours, alpha, mode, negate, 0.65, 0.196)
            assert cell == {100: OCCUPIED, 0: FREE}.get(value, UNKNOWN)
    assert set(np.unique(cells)) == {FREE, UNKNOWN, OCCUPIED}


@pytest.mark.parametrize(
    ("mode", "expected"),
    [("trinary", [UNKNOWN, OCCUPIED, FREE]), ("scale", [UNKNOWN, UNKNOWN, FREE]), ("raw", [UNKNOWN, FREE, UNKNOWN])],
)
def test_what_alpha_means(tmp_path, mode, expected):
    """Transparent white, transparent black, opaque white: a fourth colour, unknown, or nothing, by the mode."""
    Image.fromarray(np.array([[[255, 0], [0, 0], [255, 255]]], np.uint8), "LA").save(tmp_path / "plan.png")
    (tmp_path / "plan.yaml").write_text(YAML.replace(".pgm", ".png") + f"mode: {mode}\n")
    assert load_floor_plan(tmp_path / "plan.yaml").cells.tolist() == [expected]


def test_a_mode_may_be_written_in_capitals(tmp_path):
    assert plan_of(tmp_path, [[100, 0, 255]], YAML + "mode: Raw\n").cells.tolist() == [[OCCUPIED, FREE, UNKNOWN]]


@pytest.mark.parametrize(
    ("written", "meant"),
    [("0", 0), ("1", 1), ("true", 1), ("false", 0), ("True", 1), ("no", 0)]
    + [(f"{quote}{text}{quote}", text in "1true") for quote in "'\"" for text in ("0", "1", "true", "false")],
)
def test_negate_as_people_write_it(tmp_path, written, meant):
    plan = plan_of(tmp_path, [[0, 255]], YAML.replace("negate: 0", f"negate: {written}"))
    assert plan.cells.tolist() == [[FREE, OCCUPIED] if meant else [OCCUPIED, FREE]]


@pytest.mark.parametrize("written", ["2", "-1", "1.0", "'yes'", "maybe", "[0]", "{}", "null", "", "'0x0'", "'00'"])
def test_any_other_negate_is_refused(tmp_path, written):
    with pytest.raises(DataError, match=r"plan\.yaml: negate .* is not 0, 1, true or false"):
        plan_of(tmp_path, [[0, 255]], YAML.replace("negate: 0", f"negate: {written}"))


@pytest.mark.parametrize("written", ["5e-1", "'0.5'", "0.5", "+.5", "5E-1"])
def test_numbers_that_yaml_reads_as_text(tmp_path, written):
    """5e-1 is text to YAML, which wants 5.0e-1."""
    text = YAML.replace("0.5", written).replace("0.65", "65e-2").replace("0.196", "'0.196'").replace("-1.0", "-1e0")
    plan = plan_of(tmp_path, [[0, 127, 255]], text)
    assert (plan.resolution, plan.origin, plan.yaw) == (0.5, (-1.0, 2.0), 0.0)
    assert plan.cells.tolist() == [[OCCUPIED, UNKNOWN, FREE]]


# --- forms of images ------------------------------------------------------------------------------------------------

GREY = np.array([[0, 50, 127, 204], [205, 206, 254, 255]], np.uint8)
WIDE = GREY.astype(np.uint16) * 257
FORMS = {
    "8 bit.png": lambda file: Image.fromarray(GREY).save(file),
    "8 bit.bmp": lambda file: Image.fromarray(GREY).save(file),
    "8 bit.tiff": lambda file: Image.fromarray(GREY).save(file),
    "16 bit.png": lambda file: Image.fromarray(WIDE).save(file),
    "16 bit.tiff": lambda file: Image.fromarray(WIDE).save(file),
    "16 bit, from white.tiff": lambda file: Image.fromarray(65535 - WIDE).save(file, tiffinfo={262: 0}),
    "float, from white.tiff": lambda file: Image.fromarray(1 - GREY.astype(np.float32) / 255).save(
        file, tiffinfo={262: 0}
    ),
    "8 bit, from white.tiff": lambda file: Image.fromarray(GREY).save(file, tiffinfo={262: 0}),
    "16 bit.pgm": lambda file: file.write_bytes(b"P5\n4 2\n65535\n" + WIDE.astype(">u2").tobytes()),
    "16 bit, as text.pgm": lambda file: file.write_text("P2\n4 2\n65535\n" + " ".join(map(str, WIDE.ravel()))),
    "8 bit, as text.pgm": lambda file: file.write_text("P2\n# by hand\n4 2\n255\n" + " ".join(map(str, GREY.ravel()))),
    "palette.png": lambda file: Image.fromarray(GREY).convert("P").save(file),
    "palette.gif": lambda file: Image.fromarray(GREY).convert("P").save(file),
    "colours.png": lambda file: Image.fromarray(GREY).convert("RGB").save(file),
    "colours.ppm": lambda file: Image.fromarray(GREY).convert("RGB").save(file),
    "float.tiff": lambda file: Image.fromarray(GREY.astype(np.float32) / 255).save(file),
    "float.pfm": lambda file: Image.fromarray(GREY.astype(np.float32) / 255).save(file, "PPM"),
}  # fmt: skip


@pytest.mark.parametrize("mode", ["trinary", "scale", "raw"])
@pytest.mark.parametrize("form", FORMS)
def test_every_form_of_image_gives_the_same_plan(tmp_path, form, mode):
    text = YAML.replace("0.65", "0.6") + f"mode: {mode}\n"
    expected = plan_of(tmp_path, GREY, text).cells
    FORMS[form](tmp_path / form)
    (tmp_path / "plan.yaml").write_text(text.replace("plan.pgm", form))
    assert load_floor_plan(tmp_path / "plan.yaml").cells.tolist() == expected.tolist()


def test_one_bit(tmp_path):
    for form in ("plan.png", "plan.pbm", "plan.tiff"):
        Image.fromarray(np.array([[0, 255]], np.uint8)).convert("1").save(tmp_path / form)
        (tmp_path / "plan.yaml").write_text(YAML.replace("plan.pgm", form))
        assert load_floor_plan(tmp_path / "plan.yaml").cells.tolist() == [[OCCUPIED, FREE]]


@pytest.mark.parametrize(
    ("image", "key"),
    [
        (Image.fromarray(GREY), 254),
        (Image.fromarray(WIDE), 254 * 257),
        (Image.fromarray(GREY).convert("RGB"), (254, 254, 254)),
        (Image.fromarray(GREY).convert("P"), 254),
    ],
    ids=["grey", "16 bit", "colours", "palette"],
)
def test_a_transparent_colour_is_alpha(tmp_path, image, key):
    """A PNG may name one instead of having a channel."""
    image.save(tmp_path / "plan.png", transparency=key)
    (tmp_path / "plan.yaml").write_text(YAML.replace(".pgm", ".png") + "mode: scale\n")
    assert load_floor_plan(tmp_path / "plan.yaml").cells[0].tolist() == [UNKNOWN, FREE, UNKNOWN, FREE]


def test_not_a_number_is_unknown(tmp_path):
    Image.fromarray(np.array([[0, np.nan, 1]], np.float32)).save(tmp_path / "plan.tiff")
    for mode in ("trinary", "scale"):
        (tmp_path / "plan.yaml").write_text(YAML.replace(".pgm", ".tiff") + f"mode: {mode}\n")
        assert load_floor_plan(tmp_path / "plan.yaml").cells.tolist() == [[OCCUPIED, UNKNOWN, FREE]]


@pytest.mark.parametrize("name", ["r8", "a8", "h", "l-sci", "k-negstr", "t", "r16"])
def test_plans_as_they_are_met(name):
    """8 and 16 bit, 1 bit, a resolution of 5e-2, a quoted negate; t's alpha lightens its unknown, as in map_server."""
    folder = Path(__file__).parent / "floor_plans"
    cells, like = (load_floor_plan(folder / f"{one}.yaml").cells for one in (name, "r8"))
    assert np.bincount(cells.ravel(), minlength=3).tolist() == {
        "h": [6600, 0, 1400], "t": [6600, 0, 1400],
    }.get(name, [5600, 1000, 1400])  # fmt: skip
    if name not in {"h", "t"}:
        assert np.array_equal(cells, like)


# --- what may be right ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("grey", "changes", "warned"),
    [
        ([[0, 205, 254]], ("", ""), ""),
        ([[0, 205, 254]], ("free_thresh: 0.196", "free_thresh: 0.25"), "map_saver's unknown, are free"),
        ([[254, 205]], ("", ""), "no cell is occupied"),
        ([[255, 0]], ("negate: 0", "negate: 0\nmode: raw"), "no cell is occupied"),
    ],
)
def test_a_plan_that_looks_wrong_is_warned_of(tmp_path, caplog, grey, changes, warned):
    with caplog.at_level(logging.WARNING):
        plan_of(tmp_path, grey, YAML.replace(*changes))
    assert (warned in caplog.text) if warned else not caplog.text
    assert "plan.yaml" in caplog.text or not warned


# --- what is wrong --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("just words", "mapping of keys"),
        ("image: [", "plan.yaml, line 1, column 9: not valid YAML"),
        (YAML.replace("resolution: 0.5\n", ""), "lacks resolution"),
        (YAML.replace("0.5", "0"), "resolution 0 is not"),
        (YAML.replace("0.5", "wide"), "resolution 'wide' is not"),
        (YAML.replace("0.5", "true"), "resolution True is not"),
        (YAML.replace("0.5", "9" * 400), r"resolution 9+\.\.\.9+ is not"),
        (YAML.replace("0.5", "1e400"), "resolution '1e400' is not"),
        (YAML.replace("0.5", ".inf"), "resolution inf is not"),
        (YAML.replace("[-1.0, 2.0, 0.0]", "[-1.0, 2.0]"), r"origin \[-1.0, 2.0\] is not"),
        (YAML.replace("[-1.0, 2.0, 0.0]", "here"), "origin 'here' is not"),
        (YAML.replace("-1.0", ".nan"), "origin"),
        (YAML.replace("0.0]", "90]"), r"origin .*90.*: a yaw of 90 rad is more than a whole turn; write 1.5708 if"),
        (YAML.replace("-1.0", "010"), r"plan\.yaml, line 3: 010 is 8 to YAML"),
        (YAML.replace("0.65", "0.1"), "thresholds must obey"),
        (YAML.replace("0.65", "1.1"), "thresholds must obey"),
        (YAML.replace("0.65", "much"), "thresholds must obey"),
        (YAML + "mode: bool\n", "mode 'bool' is not trinary, scale or raw"),
        (YAML + "mode: 1\n", "mode 1 is not trinary, scale or raw"),
        (YAML.replace("plan.pgm", "7"), "image 7 is not the name of a file"),
        (YAML.replace("plan.pgm", ""), "image None is not the name of a file"),
        (YAML.replace("plan.pgm", "''"), "image '' is not the name of a file"),
        (YAML.replace("plan.pgm", '"a\\0b"'), "is not the name of a file"),
        (YAML.replace("plan.pgm", '"\\ud800"'), "is not the name of a file"),
        (YAML.replace("plan.pgm", "nowhere.pgm"), "nowhere.pgm cannot be read .*put it there, or correct `image`"),
        (YAML.replace("plan.pgm", "."), "cannot be read .*[Dd]irectory.*correct `image`"),
        (YAML.replace("plan.pgm", "plan.yaml"), "plan.yaml cannot be read .*save it again as PNG or PGM"),
    ],
)
def test_a_bad_plan_is_named(tmp_path, text, message):
    """File, key and value."""
    with pytest.raises(DataError, match=message) as error:
        plan_of(tmp_path, [[0]], text)
    assert "plan.yaml" in str(error.value)
    assert len(str(error.value)) < 800


def refused(folder, content):
    """The message with which an image of these bytes is refused: it names both files."""
    (folder / "plan.yaml").write_text(YAML)
    (folder / "plan.pgm").write_bytes(content)
    with pytest.raises(DataError, match=r"plan\.yaml: image .*plan\.pgm") as error:
        load_floor_plan(folder / "plan.yaml")
    return str(error.value)


@pytest.mark.parametrize(
    "content",
    [
        b"", b"\x00" * 50, b"%PDF-1.5\n", b"<svg/>", b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 9 9\n",
        b"P5\n0 0\n255\n", b"P5\n4 0\n255\n", b"P5\n-4 4\n255\n", b"P5\n4 4\n255\n\x00\x00", b"P5\n4 4\n0\n\x00",
        b"P2\n4 2\n255\n1 2 3\n", b"P2\n4 2\n255\n-9223372036854775809 1 2 3\n4 5 6 7\n", b"P2\n2 1\n255\n1 300\n",
        b"P2\n2 1\n255\none two\n", b"\x89PNG\r\n\x1a\n", b"GIF89a", b"BM", b"II*\x00\x08\x00\x00\x00",
    ],
)  # fmt: skip
def test_a_damaged_image_is_named(tmp_path, content):
    assert "save it again as PNG or PGM" in refused(tmp_path, content)


@pytest.mark.parametrize("size", ["10000 8001", "100000 100000"])
def test_an_image_of_too_many_pixels_is_refused_unread(tmp_path, size):
    """A few bytes can stand for gigabytes; the limit is told."""
    message = refused(tmp_path, f"P5\n{size}\n255\n".encode())
    assert "80 million pixels" in message
    assert "`resolution`" in message


def test_the_limit_itself_is_fine(tmp_path, monkeypatch):
    monkeypatch.setattr(floor_plan, "MOST_PIXELS", 4)
    assert plan_of(tmp_path, [[0, 0], [0, 0]]).cells.size == 4
    with pytest.raises(DataError, match="pixels"):
        plan_of(tmp_path, [[0, 0, 0, 0, 0]])


def test_whole_numbers_of_unknown_depth_are_refused(tmp_path):
    """32 bit TIFF: what is white is not said."""
    Image.fromarray(np.array([[0, 70000]], np.int32)).save(tmp_path / "plan.tiff")
    (tmp_path / "plan.yaml").write_text(YAML.replace(".pgm", ".tiff"))
    with pytest.raises(DataError, match=r"plan\.tiff has 32 bit whole numbers.*8 or 16 bit"):
        load_floor_plan(tmp_path / "plan.yaml")


@pytest.mark.parametrize("value", [255.0, -0.5, np.inf])
def test_floats_go_from_0_to_1(tmp_path, value):
    Image.fromarray(np.array([[0, value]], np.float32)).save(tmp_path / "plan.tiff")
    (tmp_path / "plan.yaml").write_text(YAML.replace(".pgm", ".tiff"))
    with pytest.raises(DataError, match=rf"plan\.tiff holds {value}.*from 0, black, to 1, white"):
        load_floor_plan(tmp_path / "plan.yaml")


def test_an_image_that_may_not_be_read_is_named(tmp_path, monkeypatch):
    """As the system says it; nobody who runs tests as root is refused."""
    plan_of(tmp_path, [[0]])

    def forbidden(*_, **__):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Image, "open", forbidden)
    with pytest.raises(DataError, match=r"plan\.pgm cannot be read \(Permission denied\); .*may be read"):
        load_floor_plan(tmp_path / "plan.yaml")


def test_without_pillow_the_extra_is_named(tmp_path, monkeypatch):
    """The library alone has no Pillow; a plan then says what to install."""
    monkeypatch.setitem(sys.modules, "PIL", None)
    with pytest.raises(DataError, match=r'plan\.yaml: .*pip install "modlhmp\[plans\]"'):
        load_floor_plan(tmp_path / "plan.yaml")


def test_the_real_plan(real_data):
    """ATC's plan is imperfect: 30 % of the real tracks touch an occupied cell, fewer come 0.3 m inside."""
    plan = load_floor_plan(real_data / "maps/atc.yaml")
    assert plan.cells.shape == (1200, 2800)
    rows = np.loadtxt(real_data / "atc/atc-20121024-1hz-test.csv", delimiter=",", usecols=(1, 2, 3))
    touches = value_at(plan, plan.cells, rows[:, 1], rows[:, 2]) == OCCUPIED
    deep = value_at(plan, occupied_depth(plan), rows[:, 1], rows[:, 2]) >= 0.3
    people, person = np.unique(rows[:, 0], return_inverse=True)
    shares = [(np.bincount(person, one) > 0).sum() / len(people) for one in (touches, deep)]
    assert shares[0] == pytest.approx(0.30, abs=0.01)
    assert 0 < shares[1] < 0.1
