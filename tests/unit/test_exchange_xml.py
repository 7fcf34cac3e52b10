"""CLiFF-maps as XML: what we write is what the ROS tools' strict reader takes, what others write is read."""

import re

import numpy as np
import pytest

import modlhmp
from modlhmp import DataError, Site
from modlhmp.arguments import site_of
from modlhmp.cleaning import clean_recording
from modlhmp.contract import SITE, crowd
from modlhmp.exchange.maps import imported
from modlhmp.forecasting.windows import usable
from modlhmp.settings import as_plain, build
from modlhmp.storage import column
from modlhmp.tracks import together

NUMBER = re.compile(r"\s*[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?\s*")
WHOLE = re.compile(r"\s*\d+\s*")
PARAMETERS = ("x_min", "x_max", "y_min", "y_max", "step", "radious", "wind")


def tree(text):
    """A property tree of XML, as [tag, text, children]: attributes and comments below the root are children, too."""
    root = ["", "", []]
    stack = [root]
    for found in re.finditer(r"<\?.*?\?>|<!--.*?-->|<(/?)([\w.]+)([^>]*?)(/?)>|[^<]+", text, re.S):
        piece, closing, tag, attributes, empty = found[0], *found.groups()
        if piece.startswith("<?"):
            continue
        if piece.startswith("<!--"):
            stack[-1][2].append(["<xmlcomment>", piece, []])
        elif tag is None:
            stack[-1][1] += piece
        elif closing:
            assert stack.pop()[0] == tag
        else:
            node = [tag, "", [["<xmlattr>", "", []]] if attributes.strip() else []]
            stack[-1][2].append(node)
            if not empty:
                stack.append(node)
    assert stack == [root]
    return root


class Strict:
    """What the ROS tools read: the first child of each name, whose text is a number; every child of `locations`."""

    def __init__(self, text):
        self.map = self.child(tree(text), "map")
        parameters = self.child(self.map, "parameters")
        self.limits = {name: self.number(parameters, name) for name in PARAMETERS}
        self.locations = [self.location(one) for one in self.child(self.map, "locations")[2]]

    @staticmethod
    def child(node, name):
        return next(one for one in node[2] if one[0] == name)

    def number(self, node, *names, pattern=NUMBER):
        for name in names:
            node = self.child(node, name)
        assert pattern.fullmatch(node[1]), (names, node[1])
        return float(node[1])

    def location(self, node):
        assert node[0] == "location", f"a child of <locations> without an id: {node[0]}"
        assert [one[0] for one in node[2]].count("p") == [one[0] for one in node[2]].count("q") == 1
        components = [
            [self.number(one, "P"), *(self.number(one, "M", name) for name in ("th", "r")),
             *(self.number(one, "Cov", name) for name in ("e_11", "e_12", "e_21", "e_22"))]
            for one in node[2] if one[0] == "distribution"
        ]  # fmt: skip
        place = [self.number(node, "pose", name) for name in ("x", "y")]
        return (
            int(self.number(node, "id", pattern=WHOLE)),
            self.number(node, "p"),
            self.number(node, "q"),
            place,
            components,
        )


@pytest.fixture(scope="module")
def cliff():
    return modlhmp.build_map("cliff", crowd(), SITE)


def refused(message, call, *arguments, **named):
    with pytest.raises(DataError, match=message):
        call(*arguments, **named)


def test_the_strict_reader_is_strict():
    """What makes the ROS readers lose a map makes this one fail, too."""
    good = GOOD.format("", BODY)
    assert len(Strict(good).locations) == 1
    broken = (
        good.replace("<locations>", "<locations><!-- a comment -->"),
        good.replace("<locations>", '<locations n="1">'),
        good.replace("<id>1</id>", "<id>1.0</id>"),
        good.replace("<P>1</P>", "<P>nan</P>"),
        good.replace("<P>1</P>", "<P>0,5</P>"),
        good.replace("<P>1</P>", ""),
        good.replace("<step>1</step>", ""),
        good.replace("<p>1</p>", "<p/>"),
    )
    for text in broken:
        with pytest.raises((AssertionError, StopIteration)):
            Strict(text)


@pytest.mark.parametrize("resolution", [1.0, 0.5, 0.3])
def test_the_ros_tools_read_what_we_write(tmp_path, resolution):
    ours = modlhmp.build_map("cliff", crowd(), SITE, resolution_m=resolution, radius_m=1.5)
    ours.save(tmp_path / "map.xml", form="xml")
    text = (tmp_path / "map.xml").read_text()
    assert "<!--" not in text
    read = Strict(text)
    step, limits = read.limits["step"], read.limits
    assert (step, limits["radious"], limits["wind"]) == (resolution, 1.5, 1)
    size = [round((limits[f"{axis}_max"] - limits[f"{axis}_min"]) / step) + 1 for axis in "xy"]
    assert len(read.locations) == size[0] * size[1], "every node of the grid"
    assert [number for number, *_ in read.locations] == list(range(1, len(read.locations) + 1))
    places = np.array([place for *_, place, _ in read.locations])
    wanted = [(limits["x_min"] + step * i, limits["y_min"] + step * j) for i in range(size[0]) for j in range(size[1])]
    np.testing.assert_allclose(places, wanted, atol=1e-6, err_msg="y runs fastest")
    full = [(q, place, components) for _, p, q, place, components in read.locations if components]
    assert len(full) == len(set(ours.whole["location"].to_pylist()))
    np.testing.assert_allclose(sum(len(components) for *_, components in full), ours.whole.num_rows)
    for q, place, components in full:
        weight, heading, _, e_11, e_12, e_21, e_22 = np.array(components).T
        assert weight.sum() == pytest.approx(1, abs=1e-6)
        assert ((heading >= 0) & (heading < 2 * np.pi)).all()
        assert (e_12 == e_21).all()
        assert (e_11 * e_22 - e_12 * e_21 > 0).all()
        here = np.hypot(column(ours.whole, "x") - place[0], column(ours.whole, "y") - place[1]) < 1e-6
        np.testing.assert_allclose(q, column(ours.whole, "p")[here], rtol=1e-8)


GOOD = """<?xml version="1.0"?>{}
<map version="0.1"><parameters><x_min>4</x_min><x_max>4</x_max><y_min>-2</y_min><y_max>-2</y_max><step>1</step>
<radious>1</radious><wind>1</wind></parameters>
<locations>{}</locations><locations_sparse/></map>"""
BODY = """<location><id>1</id><p>1</p><q>0.25</q><pose><x>4</x><y>-2</y></pose>
<distribution><Cluster>-1</Cluster><P>1</P><M><th>4.31</th><r>1.1</r></M>
<Cov><e_11>0.02</e_11><e_12>-0.004</e_12><e_21>-0.004</e_21><e_22>0.05</e_22></Cov></distribution></location>
"""


def read(write, declared="", body=BODY):
    return modlhmp.load_map(write(GOOD.format(declared, body), "theirs.xml"))


@pytest.mark.parametrize(
    "body",
    [
        BODY,
        "\n" + BODY.replace("<P>1</P>", "<P>\n 1.0e0 </P>"),
        BODY.replace("<id>1</id>", "").replace("<p>1</p><q>0.25</q>", "<p/><q/>").replace("</pose>", "</pose><p/>"),
        BODY.replace("<id>1</id>", "<!-- a node --><id unit='none'>1</id><other>x</other>"),
    ],
)
def test_what_others_write_is_read(write, body):
    found = read(write, body=body)
    assert (found.kind, found.whole.num_rows) == ("cliff", 1)
    values = [column(found.whole, name)[0] for name in ("x", "y", "weight", "mean_speed", "cov_heading_speed")]
    np.testing.assert_allclose(values, [4, -2, 1, 1.1, -0.004], rtol=1e-6)
    assert column(found.whole, "mean_heading")[0] == pytest.approx(4.31 - 2 * np.pi)
    assert column(found.whole, "p")[0] == (0.25 if "0.25" in body else 1)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (GOOD.format("", BODY.replace("<P>1</P>", "")), "line 5: <distribution> has no <P>"),
        (GOOD.format("", BODY.replace("<P>1</P>", "<P>nan</P>")), "line 5, <P>: 'nan' is not a finite number"),
        (GOOD.format("", BODY.replace("<P>1</P>", "<P>0,5</P>")), "line 5, <P>: '0,5' is not a number"),
        (GOOD.format("", BODY.replace("<P>1</P>", "<P>-1</P>")), "line 5: weight -1 is negative"),
        (GOOD.format("", BODY.replace("<x>4</x>", "")), "<location> has no <pose/x>"),
        (GOOD.format("", BODY.replace("<x>4</x>", "<x>9</x>")), "line 4: location .9, -2. is outside the limits"),
        (GOOD.format("", BODY).replace("<step>1</step>", ""), "<parameters> has no <step>"),
        (GOOD.format("", BODY).replace("<step>1</step>", "<step>0</step>"), "step 0 and radious 1 must be above 0"),
        (GOOD.format("", ""), "no location has a distribution: the map is empty"),
        (GOOD.format("", BODY)[:-9], "line 7: not XML"),
        ("<html><body/></html>", "no CLiFF-map: its root is <html>"),
        ("<map><parameters/><clusters/></map>", "a GMMT-map, not a CLiFF-map"),
        ("<map><parameters/><cells/></map>", "an intensity map, not a CLiFF-map"),
        ("<CLiFFMap><Metadata/><Components/></CLiFFMap>", "cliffpy's own XML, without covariances"),
        ("<a>" * 100_000, "deeper than any map"),
        (GOOD.format('<!DOCTYPE map [<!ENTITY a "aaaa">]>', BODY), "line 1: it declares an entity"),
        (GOOD.format('<!DOCTYPE map [<!ENTITY a SYSTEM "file:///etc/hostname">]>', BODY.replace("<P>1", "<P>&a;")),
         "line 1: it declares an entity"),
    ],
)  # fmt: skip
def test_what_is_no_map_is_refused_by_line(write, text, message):
    refused(message, modlhmp.load_map, write(text, "theirs.xml"))


def test_a_stef_map_in_the_form_of_a_cliff_map(write):
    zero = re.sub(r"<(e_..)>[-0-9.]+<", r"<\1>0<", BODY)
    two = zero + zero.replace("<x>4</x>", "<x>5</x>")
    text = GOOD.format("", two).replace("<x_max>4", "<x_max>5")
    refused("all covariances are 0: directions only", modlhmp.load_map, write(text, "theirs.xml"))


# --- published maps ---------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def published(real_data):
    folder = real_data / "maps"
    if not folder.is_dir():
        pytest.skip("there are no published maps")
    return folder


REPAIRED = {  # counted in the files by other means
    "atc-20121024-cliff.csv": ("matlab", 2423, 1368, 36, 105),
    "shopping_center_20121024_1s.xml": ("xml", 1618, 909, 16, 157),
}


@pytest.mark.real
@pytest.mark.parametrize("name", REPAIRED)
def test_published_maps(published, tmp_path, name, caplog):
    a_map = modlhmp.load_map(published / name, site=Site(timezone="Asia/Tokyo"))
    form, rows, locations, indefinite, weights = REPAIRED[name]
    about = imported(a_map.whole)
    assert (about["form"], a_map.whole.num_rows) == (form, rows)
    assert len(set(a_map.whole["location"].to_pylist())) == locations
    assert about["repaired"]["covariances that were not positive definite, raised"] == indefinite
    assert about["repaired"]["locations whose weights did not sum to 1, scaled"] == weights
    assert len([message for message in caplog.messages if name in message]) == 1, "told once"
    for form in ("matlab", "online", "xml", "nemo"):
        caplog.clear()
        a_map.save(tmp_path / "again", form=form)
        again = modlhmp.load_map(tmp_path / "again")
        assert imported(again.whole) | {"repaired": {}} == imported(again.whole), "there is nothing left to repair"
        assert imported(again.whole)["form"] == form
        for part in ("x", "y", "weight", "mean_speed", "var_heading", "var_speed"):
            np.testing.assert_array_equal(column(a_map.whole, part), column(again.whole, part), err_msg=part)


@pytest.mark.real
def test_a_roll_out_on_the_published_map_gives_known_numbers(published, real_data, load_shipped):
    """The calibration's errors on the map's own day, by the paper protocol: ranked ADE and FDE of some horizons.

    They were measured on a copy of the day that has the test persons of hour 12 as well (745 tracks of 60 s, here 668),
    so the few tracks that are still scored at 60 s differ: there 4 % are allowed, whose standard error is above that.
    """
    dataset = load_shipped("atc_1day", real_data)
    if missing := [one.path for one in dataset.recordings if not one.exists]:
        pytest.skip(f"{missing[0]}: not there")
    tracks = together(clean_recording(one.path, dataset, one)[0] for one in dataset.recordings)
    rows = usable(tracks, dataset)
    rows = rows[tracks.t[rows[:, 1]] - tracks.t[rows[:, 0]] >= 22.95]  # of 20 s or more, which the horizons below need
    tracks = tracks.take(np.concatenate([np.arange(first, last + 1) for first, last in rows]))
    history = tracks.take((tracks.bounds()[:-1, None] + np.arange(4)).ravel())
    site = site_of(build(Site, as_plain(dataset)))
    a_map = modlhmp.load_map(published / "atc-20121024-cliff.csv", site=site)
    found = {horizon: [] for horizon in KNOWN}
    for seed in range(3):
        scores = modlhmp.score(modlhmp.forecast(a_map, history, 60, seed=seed), tracks, "paper")
        for horizon in KNOWN:
            scored = scores.eligible[:, horizon - 1] & np.isfinite(scores.ade[:, horizon - 1])
            found[horizon].append([part[scored, horizon - 1].mean() for part in (scores.ade, scores.fde)])
    for horizon, known in KNOWN.items():
        np.testing.assert_allclose(np.mean(found[horizon], axis=0), known, rtol=0.04 if horizon == 60 else 0.02)


KNOWN = {20: (2.768, 5.480), 30: (3.504, 7.067), 40: (3.952, 7.969), 60: (5.575, 11.920)}
