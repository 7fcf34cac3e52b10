"""Maps in other people's forms: what goes out comes back, and what is wrong in a file is repaired or refused by row."""

import ast
import itertools
import logging

import numpy as np
import pyarrow as pa
import pytest

import modlhmp
from modlhmp import DataError, Site
from modlhmp.contract import SITE, crowd
from modlhmp.exchange.forms import FORMS
from modlhmp.exchange.maps import imported
from modlhmp.maps.base import box_of, check_box
from modlhmp.maps.cliff import COLUMNS
from modlhmp.maps.columns import METADATA, described
from modlhmp.maps.stef import evaluate, middle_of_hour
from modlhmp.storage import column
from modlhmp.tracks import Tracks

CLIFF = [form.name for form in FORMS if "cliff" in form.kinds]
LOST = {"matlab": {"count"}, "online": set(), "nemo": {"p", "count"}, "xml": {"count"}}


def hall(people=150):
    """People who cross a hall in many directions and at many speeds: several components at most locations."""
    rng, parts = np.random.default_rng(1), []
    for person in range(people):
        t, way = np.arange(15.0), rng.uniform(-np.pi, np.pi)
        speed = rng.uniform(0.5, 1.7)
        x, y = rng.uniform(-3, 3) + speed * np.cos(way) * (t - 7), 0.5 * rng.normal() + speed * np.sin(way) * (t - 7)
        began = 1.3e9 + 40 * person
        parts.append((np.full(15, person), began + t, x, y, np.full(15, speed), np.full(15, way)))
    return Tracks(*map(np.concatenate, zip(*parts, strict=True)))


@pytest.fixture(scope="module")
def maps():
    """Maps of made-up people: {kind: map}; `cliff` with many components to a location."""
    return {
        "cliff": modlhmp.build_map("cliff", hall(), SITE),
        "tc_cliff": modlhmp.build_map("tc_cliff", crowd(), SITE),
        "stef": modlhmp.build_map("stef", crowd(), SITE),
    }


def refused(message, call, *arguments, **named):
    with pytest.raises(DataError, match=message):
        call(*arguments, **named)


def same(ours, theirs, but=(), digits=1e-8):
    """Whether two CLiFF tables hold the same but for some columns; float32 to the bit, others to 9 digits."""
    assert ours.column_names == theirs.column_names
    for name in ours.column_names:
        one, other = column(ours, name), column(theirs, name)
        if name in but:
            continue
        if name == "mean_heading":  # goes out as an angle from 0 to 2 pi, whose 9 digits end at 5e-9
            np.testing.assert_allclose(np.angle(np.exp(1j * (one.astype(float) - other))), 0, atol=1e-7)
        elif one.dtype == np.float32 and name != "cov_heading_speed":
            np.testing.assert_array_equal(one, other, err_msg=name)
        else:
            np.testing.assert_allclose(one, other, rtol=digits, atol=1e-9, err_msg=name)


# --- there and back ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("header", [False, True])
@pytest.mark.parametrize("form", CLIFF)
def test_a_form_carries_what_it_says(maps, tmp_path, form, header):
    ours = maps["cliff"]
    assert len(ours.whole) > 1.5 * len(set(ours.whole["location"].to_pylist())), "several components to a location"
    file = tmp_path / "map.of.mine"
    if header and form not in {"matlab", "online"}:
        return
    ours.save(file, form=form, **({"header": True} if header else {}))
    for said in (form, None):
        theirs = modlhmp.load_map(file, form=said, site=SITE)
        assert (theirs.kind, theirs.site) == ("cliff", SITE)
        same(ours.whole, theirs.whole, LOST[form])
        assert imported(theirs.whole)["repaired"] == {}
        assert theirs.whole.schema.metadata[b"resolution"] == b"1"
    theirs.save(tmp_path / "map.parquet")
    same(theirs.whole, modlhmp.load_map(tmp_path / "map.parquet").whole)


@pytest.mark.parametrize("form", CLIFF)
def test_a_map_by_hours_is_a_folder(maps, tmp_path, form):
    ours = maps["tc_cliff"]
    ours.save(tmp_path / "hours", form=form)
    suffix = ".xml" if form == "xml" else ".csv"
    assert sorted(file.name for file in (tmp_path / "hours").iterdir()) == [f"{n}{suffix}" for n in ("07", "08", "day")]
    theirs = modlhmp.load_map(tmp_path / "hours", form=form, site=SITE)
    assert (theirs.kind, list(theirs.hours)) == ("tc_cliff", [7, 8])
    for hour, table in ours.hours.items():
        same(table, theirs.hours[hour], LOST[form])
    same(ours.whole, theirs.whole, LOST[form])
    other = modlhmp.Map("tc_cliff", SITE, None, {8: ours.hours[8]})
    other.save(tmp_path / "hours", form=form)
    assert [file.name for file in (tmp_path / "hours").iterdir()] == [f"08{suffix}"], "no hour of the map before"


@pytest.mark.parametrize("before", ["parquet", "matlab", "xml"])
@pytest.mark.parametrize("after", ["parquet", "matlab", "xml"])
def test_a_folder_is_of_one_map(maps, tmp_path, before, after):
    """A map in another form is not written among the files of one, whose hours or day would be read for its own."""
    for hour in (5, 8):
        folder, ours = tmp_path / f"of_{hour}", maps["tc_cliff"]
        ours.save(folder, form=before)
        (folder / "readme.csv").touch()
        held = {file: file.read_bytes() for file in folder.iterdir()}
        other = modlhmp.Map("tc_cliff", SITE, None, {hour: ours.hours[8]})
        suffix = {"matlab": ".csv"}.get(after, f".{after}")
        if before == after:
            other.save(folder, form=after)
            assert {file.name for file in folder.iterdir()} == {f"{hour:02d}{suffix}", "readme.csv"}
            continue
        refused(r"of_\d: 07\.\w+ lies there, .* in another form than \.\w+; remove", other.save, folder, form=after)
        assert {file: file.read_bytes() for file in folder.iterdir()} == held
        other.save(tmp_path / "other", form=after)
        (tmp_path / "other" / f"{hour:02d}{suffix}").rename(folder / f"{hour:02d}{suffix}")
        refused("lies there|several forms|a file already|named 09.parquet", modlhmp.load_map, folder, site=SITE)


def test_hours_by_names_of_others(maps, tmp_path):
    maps["tc_cliff"].save(tmp_path / "a", form="matlab")
    (tmp_path / "a/07.csv").rename(tmp_path / "a/ATC_7_online.csv")
    (tmp_path / "a/08.csv").rename(tmp_path / "a/ATC_8_online.csv")
    found = modlhmp.load_map(tmp_path / "a/ATC_{hour}_online.csv", form="matlab", site=SITE)
    assert list(found.hours) == [7, 8]
    refused("a folder without a map", modlhmp.load_map, tmp_path / "a")
    refused("no such files", modlhmp.load_map, tmp_path / "a/B_{hour}.csv")
    (tmp_path / "a/ATC_07_online.csv").touch()
    refused("hour 7 has a file already", modlhmp.load_map, tmp_path / "a/ATC_{hour}_online.csv", form="matlab")


@pytest.mark.parametrize("header", [False, True])
def test_orientation_probabilities(maps, tmp_path, header):
    ours = maps["stef"]
    ours.save(tmp_path / "stef", form="stef_csv", header=header)
    theirs = modlhmp.load_map(tmp_path / "stef", form=None if header else "stef_csv", site=SITE)
    assert theirs.kind == "stef"
    for hour, table in ours.hours.items():
        for name in ("x", "y", "probabilities"):
            np.testing.assert_allclose(column(table, name), column(theirs.hours[hour], name), atol=1e-9)
    one = modlhmp.load_map(tmp_path / "stef/08.csv", form="stef_csv", site=SITE)
    assert list(one.hours) == [7, 8], "a single file serves every hour of the site"
    for a_map in (theirs, one):
        futures = modlhmp.forecast(a_map, crowd(), k=2, without_map="whole_day")
        assert np.isfinite(futures.paths).any()


def test_weights_of_directions_that_are_no_probabilities(write, caplog):
    """Any weights, in per cent say; a cell without any has no dynamics; a negative one is refused."""
    text = "0.5,0.5,20,0,60,0\n1.5,0.5,0,0,0,0\n2.5,0.5,0.25,0.25,0.25,0.25\n"
    found = modlhmp.load_map(write(text), form="stef_csv", site=SITE)
    probabilities = column(found.hours[7], "probabilities").reshape(3, 4)
    np.testing.assert_allclose(probabilities, [[0.25, 0, 0.75, 0], [0, 0, 0, 0], [0.25] * 4])
    assert "1 cells whose weights did not sum to 1, scaled" in caplog.text
    refused(
        "row 2: weight -1 is negative", modlhmp.load_map, write(text.replace("1.5,0.5,0", "1.5,0.5,-1")), "stef_csv"
    )
    refused("falls on another", modlhmp.load_map, write(text.replace("1.5,0.5", "0.5,0.5")), "stef_csv")


def test_histograms(maps, tmp_path, caplog):
    """They carry probabilities in whole ten-thousandths; FreMEn makes a map of them again."""
    ours = maps["stef"]
    ours.save(tmp_path / "stef.txt", form="histogram")
    box = ast.literal_eval(caplog.messages[-1].split("whoever reads it: ")[1])
    lines = [np.array(line.split(","), float) for line in (tmp_path / "stef.txt").read_text().splitlines()]
    assert [((t + 3600) % 86400) / 3600 for t, *_ in lines] == [7, 8], (
        "London's clock on 1 January 1970 was an hour ahead"
    )
    size = [round((high - low) / box["resolution_m"]) for low, high in (box["x"], box["y"])]
    for (hour, table), line in zip(ours.hours.items(), lines, strict=True):
        counts = line[1:].reshape(*size, 8)
        found = column(table, "probabilities").reshape(-1, 8)
        i, j = (np.floor(column(table, name) - box[name][0]).astype(int) for name in ("x", "y"))
        np.testing.assert_allclose(counts[i, j] / 10_000, found, atol=5.1e-5, err_msg=hour)
        assert counts.sum() == pytest.approx(10_000 * (found.sum(axis=1) > 0).sum(), abs=8 * len(found))
    theirs = modlhmp.load_map(tmp_path / "stef.txt", form="histogram", site=SITE, **box)
    assert (theirs.kind, list(theirs.hours)) == ("stef", [7, 8])
    seen = np.zeros(size, bool)
    for table in ours.hours.values():
        i, j = (np.floor(column(table, name) - box[name][0]).astype(int) for name in ("x", "y"))
        seen[i, j] |= column(table, "probabilities").reshape(-1, 8).any(axis=1)
    assert theirs.hours[7].num_rows == seen.sum()
    refused("histograms. Then name the form, histogram,", modlhmp.load_map, tmp_path / "stef.txt")
    refused("row 1 has .* numbers after its time: .* = 8; give the box", modlhmp.load_map, tmp_path / "stef.txt",
            form="histogram", x=(0, 1), y=(0, 1))  # fmt: skip


def test_histograms_of_a_map_come_back(tmp_path):
    """The probabilities of every hour, in ten-thousandths: FreMEn alone would smooth hours that are unlike."""
    walks = crowd()
    turned = [
        walks._replace(
            track_id=walks.track_id + 1000 * hour, t=walks.t + 3600 * hour, heading=(walks.heading + hour) % 6.28 - 3.14
        )
        for hour in range(6)
    ]
    site = Site(timezone="Europe/London")
    ours = modlhmp.build_map("stef", Tracks(*map(np.concatenate, zip(*turned, strict=True))), site)
    ours.save(tmp_path / "stef.txt", form="histogram")
    box = {name: (column(ours.whole, name).min() - 0.5, column(ours.whole, name).max() + 0.5) for name in ("x", "y")}
    theirs = modlhmp.load_map(tmp_path / "stef.txt", form="histogram", site=site, **box)
    assert list(theirs.hours) == list(ours.hours) and len(ours.hours) >= 6
    smoothed = 0.0
    for hour, table in ours.hours.items():
        places = dict(zip(zip(column(table, "x"), column(table, "y"), strict=True),
                          column(table, "probabilities").reshape(-1, 8), strict=True))  # fmt: skip
        again = theirs.hours[hour]
        found = column(again, "probabilities").reshape(-1, 8)
        expected = np.array([places[at] for at in zip(column(again, "x"), column(again, "y"), strict=True)])
        np.testing.assert_allclose(found, expected, atol=3e-4)
        learned = column(evaluate(theirs.whole, middle_of_hour(hour)), "probabilities").reshape(-1, 8)
        smoothed = max(smoothed, np.abs(learned - expected).max())
    assert smoothed > 0.05


@pytest.mark.parametrize("form", [form.name for form in FORMS])
def test_hours_come_back_whichever_they_are(maps, tmp_path, form):
    """Every choice of hours, alone and with the whole day: apart, at night, none that the site lists."""
    (kind,) = {"tc_cliff", "stef"} & set(next(one for one in FORMS if one.name == form).kinds)
    of_hour, how = dict(zip((0, 9, 11, 23), 2 * list(maps[kind].hours.values()), strict=True)), {}
    if form == "histogram":
        xy = np.array([[column(table, name) for name in ("x", "y")] for table in of_hour.values()])
        how = {name: (xy[:, i].min() - 0.5, xy[:, i].max() + 0.5) for i, name in enumerate("xy")}
    chosen = [some for n in range(5) for some in itertools.combinations(of_hour, n)]
    for number, (some, whole) in enumerate(itertools.product(chosen, (None, maps[kind].whole))):
        if not some and (whole is None or form == "histogram"):
            continue
        modlhmp.Map(kind, SITE, whole, {hour: of_hour[hour] for hour in some}).save(tmp_path / f"{number}", form=form)
        theirs = modlhmp.load_map(tmp_path / f"{number}", form=form, site=SITE, **how)
        assert (theirs.kind, tuple(theirs.hours)) == (kind, some)
        assert form == "histogram" or (theirs.whole is None) == (whole is None)
        for hour, table in theirs.hours.items():
            if kind == "stef":
                ours, again = (
                    dict(zip(zip(column(one, "x").round(6), column(one, "y").round(6), strict=True),
                             column(one, "probabilities").reshape(-1, 8), strict=True))
                    for one in (of_hour[hour], table)
                )  # fmt: skip
                np.testing.assert_allclose(list(again.values()), [ours[place] for place in again], atol=3e-4)
            else:
                same(of_hour[hour], table, LOST[form])


def test_histograms_are_learned_from_like_counts_of_tracks(tmp_path):
    """A file of the counts that `stef.build` makes of tracks gives its map: axes, bins and times are the same."""
    tracks, site = crowd(), Site(timezone="Europe/London", hours=(7, 9))
    ours = modlhmp.build_map("stef", tracks, site, interval_s=3600)
    local = tracks.t  # London in March 2011
    moving = np.isfinite(tracks.heading) & (tracks.speed != 0)
    x0, y0, wide, high = -25, -5, 50, 10
    lines = []
    for interval in range(24):
        counts = np.zeros((wide, high, 8), int)
        for at in np.flatnonzero(moving & ((local % 86400) // 3600 == interval)):
            bin_of = int(np.ceil(tracks.heading[at] * 8 / (2 * np.pi) - 0.5)) % 8
            counts[int(np.floor(tracks.x[at])) - x0, int(np.floor(tracks.y[at])) - y0, bin_of] += 1
        lines.append(",".join(map(str, [int(1.3e9 // 86400 * 86400) + 3600 * interval, *counts.ravel()])))
    (tmp_path / "counts.txt").write_text("\n".join(lines))
    theirs = modlhmp.load_map(
        tmp_path / "counts.txt", form="histogram", site=site, x=(x0, x0 + wide), y=(y0, y0 + high)
    )
    for name in ("x", "y", "orientation", "mean", "amplitudes", "phases", "periods"):
        np.testing.assert_allclose(column(ours.whole, name), column(theirs.whole, name), atol=1e-9, err_msg=name)


@pytest.mark.parametrize("kind", ["episodes", "snippets", "exits"])
def test_a_kind_that_a_form_cannot_carry(tmp_path, kind):
    a_map = modlhmp.build_map(kind, crowd(), SITE)
    refused("cannot carry a map of kind .*; forms that can: parquet", a_map.save, tmp_path / "a.csv", form="matlab")
    refused("did you mean 'matlab'", a_map.save, tmp_path / "a.csv", form="matlb")
    assert not list(tmp_path.iterdir())


def test_options_of_forms_are_checked(maps, tmp_path):
    refused("unknown key 'hedder', did you mean 'header'", maps["cliff"].save, tmp_path / "a", form="matlab", hedder=1)
    refused("name its form, such as xml", maps["cliff"].save, tmp_path / "a.csv")
    refused("no options", maps["cliff"].save, tmp_path / "a.parquet", header=True)
    maps["cliff"].save(tmp_path / "a", form="matlab")
    maps["cliff"].save(tmp_path / "a.parquet")
    refused("resolution_m", modlhmp.load_map, tmp_path / "a", resolution_m=-1)
    refused("its site and its frame itself", modlhmp.load_map, tmp_path / "a.parquet", site=SITE)
    refused("its site and its frame itself", modlhmp.load_map, tmp_path / "a.parquet", origin_m=(1, 2))
    for origin in ((np.nan, 1), (1,), 3, ("a", 1), (0, np.inf)):
        refused("origin_m .*: give .x, y. in m", modlhmp.load_map, tmp_path / "a", origin_m=origin)
    refused("a folder is there", maps["cliff"].save, tmp_path, form="matlab")
    refused("a file is there", maps["tc_cliff"].save, tmp_path / "a", form="matlab")


def test_an_empty_map_has_no_grid(maps, tmp_path):
    empty = modlhmp.Map("cliff", SITE, maps["cliff"].whole[:0], {})
    refused("an empty map has no grid", empty.save, tmp_path / "a.xml", form="xml")
    empty.save(tmp_path / "a.csv", form="matlab")
    refused("the file is empty", modlhmp.load_map, tmp_path / "a.csv", form="matlab")


def test_a_map_is_moved_to_the_recordings(maps, tmp_path):
    far = maps["cliff"].whole
    for at, name in ((1, "x"), (2, "y")):
        far = far.set_column(at, name, pa.array(column(far, name) + 400_000.0))
    modlhmp.Map("cliff", SITE, far, {}).save(tmp_path / "far.csv", form="matlab")
    modlhmp.Map("cliff", SITE, far, {}).save(tmp_path / "far.xml", form="xml")
    for name, row in (("far.csv", "row 1"), ("far.xml", "line [0-9]+")):
        refused(
            f"{name}: {row}: .* more than 10 km from the origin; give `origin_m`", modlhmp.load_map, tmp_path / name
        )
        near = modlhmp.load_map(tmp_path / name, origin_m=(400_000, 400_000))
        np.testing.assert_allclose(column(near.whole, "x"), column(maps["cliff"].whole, "x"), atol=1e-3)


def test_walkers_of_another_frame(maps):
    """A map that nobody is on is refused, with what it spans and where they are; some of them on it are enough."""
    box, there = box_of([maps["cliff"].whole]), np.column_stack([np.linspace(-5, 5, 11), np.zeros(11)])
    away, far = there + np.array([1000, 0]), there + np.array([500_000.123, 4_123_456.789])
    assert check_box("here", box, there) == 1
    assert check_box("here", box, np.concatenate([there, away])) == 0.5
    message = r"here: the map is of -\d+ to \d+ x -\d+ to \d+ m, and all walkers are in 995 to 1005 x 0 to 0 m"
    refused(message, check_box, "here", box, away)
    message = r"in 499995\.12 to 500005\.12 x 4123456\.79 to 4123456.79 m: .*modlhmp map convert --origin X Y"
    refused(message, check_box, "here", box, far)


@pytest.mark.parametrize("kind", ["tc_cliff", "stef"])
def test_whose_hours_they_are_is_asked(maps, tmp_path, caplog, kind):
    """Files named by hours do not say of which time zone; a map that is the same all day needs none."""
    form = "online" if kind == "tc_cliff" else "stef_csv"
    maps[kind].save(tmp_path / "hours", form=form)
    modlhmp.load_map(tmp_path / "hours", form, site=SITE)
    if kind == "stef":
        modlhmp.load_map(next((tmp_path / "hours").glob("0*")), form)
    assert "taken for those of UTC" not in caplog.text
    modlhmp.load_map(tmp_path / "hours", form)
    assert "hours are taken for those of UTC; say whose they are: site=modlhmp.Site(timezone=...), or" in caplog.text
    assert "`modlhmp map convert --timezone NAME`" in caplog.text


def test_a_forecast_far_from_a_published_map_is_told(maps, tmp_path, caplog):
    maps["cliff"].save(tmp_path / "a.csv", form="matlab")
    theirs = modlhmp.load_map(tmp_path / "a.csv", form="matlab")
    for by, told in ((0.0, 0), (3000.0, 1)):
        caplog.clear()
        history = np.stack([1.3e9 + np.arange(4.0), by + np.arange(4.0), np.zeros(4)], axis=1)
        assert modlhmp.forecast(theirs, history, k=2).left(1).min() == told
        assert sum("another frame?" in message for message in caplog.messages) == told


@pytest.mark.parametrize("kind", ["cliff", "tc_cliff", "stef", "episodes", "snippets", "exits"])
def test_every_column_of_every_map_is_documented(kind):
    a_map = modlhmp.build_map(kind, crowd(), SITE)
    for table in filter(None, (a_map.whole, *a_map.hours.values())):
        assert list(described(table)) == table.column_names
        assert all(meaning for _, meaning in described(table).values())
        assert {key.decode() for key in table.schema.metadata} <= METADATA.keys()


# --- which order it is ------------------------------------------------------------------------------------------------


def rows_of(order, *components):
    """A file's text: a component is x, y, heading, speed, variance, covariance, variance, weight, and what follows."""
    lines = []
    for x, y, heading, speed, vtt, vtr, vrr, weight, *rest in components:
        if order == "matlab":
            lines.append([x, y, heading, speed, vtt, vtr, vtr, vrr, weight, *(rest or [1, 1])])
        else:
            lines.append([x, y, speed, heading, vrr, vtr, vtr, vtt, weight, *(rest or [7])])
    return "".join(",".join(f"{value:g}" for value in line) + "\n" for line in lines)


def field(order="matlab", number=40, **changed):
    """A file's text of a row of locations whose headings go once around; `changed` are components by number."""
    headings = np.arange(number) * 2 * np.pi / number
    found = [[n, 2, h, 1.1, 0.1, 0.01, 0.05, 1] for n, h in enumerate(headings)]
    for key, values in changed.items():
        found[int(key[1:])] = values
    return rows_of(order, *found)


@pytest.mark.parametrize("order", ["matlab", "online"])
def test_the_order_is_found_from_the_data(write, order):
    found = modlhmp.load_map(write(field(order)))
    assert imported(found.whole)["form"] == order
    np.testing.assert_allclose(column(found.whole, "mean_speed"), 1.1, rtol=1e-6)
    np.testing.assert_allclose(column(found.whole, "var_heading"), 0.1, rtol=1e-6)
    np.testing.assert_allclose(column(found.whole, "var_speed"), 0.05, rtol=1e-6)


@pytest.mark.parametrize("order", ["matlab", "online"])
def test_angles_from_minus_pi_to_pi_tell_it_too(write, order):
    rows = [[n, 2, h, 1.1, 0.1, 0.01, 0.05, 1] for n, h in enumerate(np.linspace(-3.1, 3.1, 40))]
    assert imported(modlhmp.load_map(write(rows_of(order, *rows))).whole)["form"] == order


def test_where_nothing_tells_the_order_it_is_asked_for(write):
    one_way = write(rows_of("matlab", *([n, 0, 0.5, 1.2, 0.1, 0, 0.1, 1] for n in range(9))))
    refused("is its form matlab .* or online .* above pi are 0.0% of column 3 and 0.0%", modlhmp.load_map, one_way)
    for order, speed in (("matlab", 1.2), ("online", 0.5)):
        found = modlhmp.load_map(one_way, form=order)
        np.testing.assert_allclose(column(found.whole, "mean_speed"), speed, rtol=1e-6)


def test_the_user_s_word_wins_and_a_contradiction_is_told(write, caplog):
    found = modlhmp.load_map(write(field("matlab")), form="online")
    assert "as was said, but it looks like `matlab`" in caplog.text
    np.testing.assert_allclose(column(found.whole, "mean_heading"), 1.1, rtol=1e-6)


@pytest.mark.parametrize("order", ["matlab", "online"])
def test_a_header_tells_the_order(write, order):
    middle = "angle,speed" if order == "matlab" else "speed,angle"
    rows = rows_of(order, [0, 0, 0.5, 1.2, 0.1, 0, 0.1, 1], [1, 0, 0.5, 1.2, 0.1, 0, 0.1, 1])
    columns = 11 if order == "matlab" else 10
    names = f"x,y,motion_{middle}," + ",".join(f"c{n}" for n in range(columns - 4)) + "\n"
    assert imported(modlhmp.load_map(write(names + rows)).whole)["form"] == order


IN_ORDER = {
    "matlab": "x,y,Heading,Speed,var_heading,cov,cov,var_speed,weight,p,q",
    "online": "x,y,velocity,motion_angle,cov1,cov2,cov3,cov4,weight,motion_ratio",
    "stef_csv": "x,y,theta_1,theta_2,theta_3,theta_4",
}


@pytest.mark.parametrize("form", IN_ORDER)
def test_columns_that_a_header_has_in_another_order_are_refused(write, caplog, form):
    """Wherever two columns are swapped that it tells apart; names that nobody knows are told."""
    names = IN_ORDER[form].split(",")
    rows = "0,0,1,0,0,0\n1,0,0.5,0.5,0,0\n" if form == "stef_csv" else field(form)
    known = [name for name in names if not name.startswith("cov")]
    assert len(modlhmp.load_map(write(",".join(names) + "\n" + rows), form=form).hours or [1])
    assert ("unclear names of columns" in caplog.text) == (len(known) < len(names))
    for one, other in itertools.combinations(range(len(names)), 2):
        swapped = list(names)
        swapped[one], swapped[other] = names[other], names[one]
        if {names[one], names[other]} <= set(known) and {names[one], names[other]} != {"p", "q"}:
            told = f"column {one + 1} is called {swapped[one]}, where form {form} has .* bring the columns"
            refused(told, modlhmp.load_map, write(",".join(swapped) + "\n" + rows), form=form)


HEADERS = {
    "matlab": [
        "x,y,theta,rho,sigma_theta,sigma_theta_rho,sigma_rho_theta,sigma_rho,weight,p,q",
        "x,y,mean_angle,mean_speed,angle_var,angle_speed_cov,speed_angle_cov,speed_var,weight,p,q",
        "X,Y,MeanAngle,MeanSpeed,AngleVar,Cov,Cov,SpeedVar,MixingFactor,P,Q",
        "x,y,theta,rho,theta_theta,theta_rho,rho_theta,rho_rho,pi,p,q",
        "x,y,mu_theta,mu_rho,S_theta,S_theta_rho,S_rho_theta,S_rho,w,p,q",
        "x,y,mu_theta,mu_rho,S11,S12,S21,S22,mixing_ratio,p,q",
        "x,y,motion_angle,speed,P11,P12,P21,P22,weight,motion_intensity,observation_ratio",
        "x,y,theta,rho,p_11,p_12,p_21,p_22,p_mix,p,q",
        "x,y,heading,speed,var_heading,rho,rho,var_speed,weight,p,q",
        "x,y,heading_rad,speed_mps,sd_heading,corr,corr,sd_speed,weight,p,q",
        "x,y,velocity_direction,velocity_magnitude,var_direction,cov,cov,var_velocity,weight,p,q",
        "x,y,direction,velocity,std_direction,cov,cov,std_velocity,weight_normalised,p,q",
    ],
    "online": [
        "x,y,rho,theta,sigma_rho,sigma_rho_theta,sigma_theta_rho,sigma_theta,weight,count",
        "x,y,mean_speed,motion_angle,var11,var12,var21,var22,mixing_factor,motion_ratio",
        "x,y,speed,angle,speed_var,cov,cov,angle_var,mixing_weight,n,decay",
        "x,y,speed,angle,speed_spread,cov_1,cov_2,angle_spread,mixing ratio,count",
    ],
}


@pytest.mark.parametrize(("form", "header"), [(form, one) for form, those in HEADERS.items() for one in those])
def test_columns_that_a_header_has_in_order_are_read(write, form, header):
    """However others call them: what is not plain goes by its place."""
    rows = rows_of(form, *([n, 2, 1.0, 1.1, 0.1, 0.01, 0.05, 1] for n in range(3)))
    rows = "".join(line + ",1\n" for line in rows.splitlines()) if header.endswith("decay") else rows
    for how in ({}, {"form": form}):
        found = modlhmp.load_map(write(header + "\n" + rows), **how).whole
        assert imported(found)["form"] == form
        np.testing.assert_allclose(column(found, "var_heading"), 0.1, rtol=1e-6)


@pytest.mark.parametrize("header", [
    "x,y,theta,rho,sigma_rho,sigma_theta_rho,sigma_rho_theta,sigma_theta,weight,p,q",
    "x,y,angle,speed,speed_var,cov,cov,angle_var,weight,p,q", "x,y,v,theta,a,b,c,d,w,p,q",
    "x,y,theta,rho,weight,sigma_theta,cov,cov,sigma_rho,p,q",
])  # fmt: skip
def test_variances_that_a_header_has_in_another_order_are_refused(write, header):
    refused("column [0-9] is called .* bring the columns", modlhmp.load_map, write(header + "\n" + field()), "matlab")


# --- defects ----------------------------------------------------------------------------------------------------------

GOOD = [5, 2, 1.0, 1.1, 0.1, 0.01, 0.05, 1]


@pytest.mark.parametrize(
    ("rows", "told"),
    [
        ([[0, 0, 1.0, 1, 0.1, 0.2, 0.1, 1]], "1 covariances that were not positive definite"),
        ([[0, 0, 1.0, 1, 1e-6, 0, 0.1, 1]], "1 narrow covariances"),
        ([[0, 0, 1.0, 1, 0.1, 0, 0.1, 0.3], [0, 0, 2.0, 1, 0.1, 0, 0.1, 0.3]], "1 locations whose weights"),
        ([[0, 0, 1.0, 1, 0.1, 0, 0.1, 1], [0, 0, 0, 0, 0, 0, 0, 0]], "1 components of weight 0"),
        ([[0, 0, 8.0, 1, 0.1, 0, 0.1, 1]], "1 headings beyond one turn"),
        ([[0, 0, 1.0, -1.8, 0.1, 0, 0.1, 1]], "1 negative mean speeds"),
        ([GOOD], "1 locations that the file repeats"),
        ([[0, 0, 1.0, 1, 0.1, 0, 0.1, 0.5, 1, 0.2], [0, 0, 2.0, 1, 0.1, 0, 0.1, 0.5, 1, 0.3]], "1 locations whose r"),
    ],
)  # fmt: skip
def test_what_can_be_repaired_is_and_is_told_once(write, caplog, rows, told):
    caplog.set_level(logging.INFO, "modlhmp")
    found = modlhmp.load_map(write(field(n5=GOOD) + rows_of("matlab", *rows)), form="matlab")
    assert sum(told in message for message in caplog.messages) == 1
    assert list(imported(found.whole)["repaired"].values()) == [1]
    table = {name: column(found.whole, name).astype(float) for name in COLUMNS}
    assert (table["weight"] > 0).all()
    assert (np.abs(table["mean_heading"]) <= np.pi + 1e-6).all()
    vtt, vtr, vrr = (table[name] for name in ("var_heading", "cov_heading_speed", "var_speed"))
    assert (np.linalg.eigvalsh(np.array([[vtt, vtr], [vtr, vrr]]).T) > 0.99e-4).all()
    for location in np.unique(table["location"]):
        assert table["weight"][table["location"] == location].sum() == pytest.approx(1, abs=1e-6)


def test_p_comes_from_the_number_that_varies(write):
    """Whatever it is called: a ratio as it is, a count by the largest; 1 without any."""

    def p_of(text, **how):
        return column(modlhmp.load_map(write(text), **how).whole, "p").tolist()

    def rows(order, *more):
        return rows_of(order, *([n, 2, 3.2 + n, 1.1, 0.1, 0.01, 0.05, 1, *rest] for n, rest in enumerate(more)))

    shares, counts = (0.1, 0.2, 0.4), (5, 10, 20)
    assert p_of(rows("matlab", *([1, share] for share in shares))) == [0.1, 0.2, 0.4]
    assert p_of(rows("matlab", *([share, 1] for share in shares))) == [0.1, 0.2, 0.4]
    assert p_of(rows("matlab", *([1, count] for count in counts))) == [0.25, 0.5, 1]
    assert p_of(rows("online", *([count] for count in counts))) == [0.25, 0.5, 1]
    assert p_of(rows("online", *([count, 0.1] for count in counts))) == [0.25, 0.5, 1]
    assert p_of(rows("matlab", *([1, 1] for _ in counts))) == [1, 1, 1]
    counted = modlhmp.load_map(write(rows("online", *([count] for count in counts))))
    assert column(counted.whole, "count").tolist() == [5, 10, 20]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (field() + "1,2,3\n", "row 41 has 3 columns, the rows before it 11"),
        (field(n3=[3, 2, 1, 1.1, 0.1, 0.01, 0.05, -0.2]), "row 4: weight -0.2 is negative"),
        (field(n3=[3, 2, 200, 1.1, 0.1, 0.01, 0.05, 1]), "row 4: heading 200 rad .* in degrees. Speeds in mm/s"),
        (field(n3=[3, 2, 1, 110, 0.1, 0.01, 0.05, 1]), "row 4: mean speed 110 m/s: in another unit"),
        (field(n3=[3, 2, 1, 1.1, 0.1, 0.01, 0.05, 1, 1, -1]), "row 4: a p, q or count that is negative"),
        (field(n3=[3, 2, 1, 1.1, 0.1, 0.01, 5e7, 1]), "row 4: a covariance is larger than"),
        (field(n3=[3.4, 2, 1, 1.1, 0.1, 0.01, 0.05, 1]), "row 4: location .3.4, 2. is not on the others' lattice"),
        (field(n3=[2.05, 2, 1, 1.1, 0.1, 0.01, 0.05, 1]), "row 4: location .2.05, 2. falls on another"),
        (field(n3=[9e6, 2, 1, 1.1, 0.1, 0.01, 0.05, 1]), "row 4: location .* more than 10 km from the origin"),
        (field().replace("3,2,", "500001.25,4123456.5,", 1),
         r"row 4: location .500001.25, 4123456.5. .*modlhmp map convert --origin X Y"),
        (field(n3=[9e3, 9e3, 1, 1.1, 0.1, 0.01, 0.05, 1]), "row 4: location .9000, 9000. is far from the others"),
        (field() + rows_of("matlab", [5, 2, 1, 1.3, 0.1, 0.01, 0.05, 1]),
         "row 41: .* row 6 already, .* or sort the rows by location"),
        (field().replace("1.1", "x", 1), "row 1, column 4: 'x' is not a number"),
        (field().replace("1.1", "nan", 1), "row 1, column 4: 'nan' is not a finite number"),
        (field().replace(",", ";"), "row 2, column 1: .* is not a number .columns are separated by commas"),
        ("", "the file is empty"),
        ("x,y,mean_speed,mean_motion_angle,var_speed,var_motion_angle,coef,weight\n", "no rows: the map is empty"),
        ("version https://git-lfs.github.com/spec/v1\noid sha256:0\n", "a pointer of Git LFS, .* `git lfs pull`"),
        ("component_id,x_position,y_position,direction_rad,direction_deg,weight\n1,0,0,0,0,1\n", "cliffpy: .* no cov"),
        ("1,2,3\n4,5,6\n", "3 columns: a CLiFF-map has 10 or 11"),
        ("0.5,0.5,1,0,0,2,0,0,0,0\n", "columns 6 and 7 differ, .* name the form, stef_csv"),
        (b"\xff\xfe\x00\x01\xff", "not a text file"),
        (rows_of("matlab", [0, 0, 4, 1, 0, 0, 0, 1], [1, 0, 5, 1, 0, 0, 0, 1]), "all covariances are 0: directions"),
        (rows_of("matlab", [0, 0, 4, 1, 1, 0, 1, 0], [1, 0, 5, 1, 1, 0, 1, 0]), "all weights are 0: the map is empty"),
        (rows_of("matlab", *([n, 2, -n, 9, 1, 0, 1, 1] for n in range(9))), "half of the mean speeds are above 9"),
    ],
)  # fmt: skip
def test_what_cannot_be_read_is_refused_by_row(write, text, message):
    refused(message, modlhmp.load_map, write(text, "theirs.csv"))


@pytest.mark.parametrize("form", ["matlab", "nemo", "stef_csv", "xml", "histogram"])
def test_another_form_than_said(write, form):
    file = write("a,b,c\n1,2,3\n4,5,6\n" if form != "stef_csv" else "1,2,-3,4\n")
    how = {"x": (0, 1), "y": (0, 1)} if form == "histogram" else {}
    refused("recording.csv: ", modlhmp.load_map, file, form=form, **how)


def test_nemo_s_correlation(write):
    head = "x,y,mean_speed,mean_motion_angle,var_speed,var_motion_angle,coef,weight\n"
    table = modlhmp.load_map(write(head + "0,0,1.0,3.5,0.04,0.25,0.5,1\n1,0,1.0,3.5,0.04,0.25,-0.5,1\n")).whole
    np.testing.assert_allclose(column(table, "cov_heading_speed"), [0.05, -0.05], rtol=1e-6)
    refused("row 2: coef 1.2 is no correlation", modlhmp.load_map, write(head + "0,0,1.0,3.5,0.04,0.25,1.2,1\n"))


def test_a_spaced_lattice_and_one_that_is_said(write):
    rows = [[0.906 + 0.5 * n, 0.246, 3.2 + 0.05 * n, 1.1, 0.1, 0.01, 0.05, 1] for n in range(20)]
    assert modlhmp.load_map(write(rows_of("matlab", *rows))).whole.schema.metadata[b"resolution"] == b"0.5"
    said = modlhmp.load_map(write(rows_of("matlab", *rows)), resolution_m=0.25)
    assert said.whole.schema.metadata[b"resolution"] == b"0.25"
    refused("give the right resolution_m", modlhmp.load_map, write(rows_of("matlab", *rows)), resolution_m=0.3)
