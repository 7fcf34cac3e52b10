"""`modlhmp map`: build, info, plot, convert and compare, as one would type them."""

import inspect
import re
from itertools import pairwise

import numpy as np
import pytest
from typer.testing import CliRunner

import modlhmp
from modlhmp.cli import app, main
from modlhmp.contract import SITE, crowd
from modlhmp.maps.base import hour_files
from modlhmp.maps.comparison import compare, flows
from modlhmp.storage import column
from modlhmp.tracks import write_tracks
from modlhmp.updates import UpdatedMap


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Maps of every kind, and the tracks that they are of."""
    folder = tmp_path_factory.mktemp("maps")
    for kind in ("cliff", "tc_cliff", "stef", "episodes", "snippets", "pooled", "exits"):
        a_map = modlhmp.build_map(kind, crowd(), SITE)
        a_map.save(folder / (f"{kind}.parquet" if a_map.whole is not None and not a_map.hours else kind))
    modlhmp.load_map(folder / "cliff.parquet").save(folder / "cliff.csv", form="matlab")
    write_tracks(crowd(), folder / "tracks.parquet")
    return folder


def said(*arguments, status=0, **more):
    """What is printed on (standard output, standard error)."""
    done = CliRunner().invoke(app, ["map", *map(str, arguments)], **more)
    assert done.exit_code == status, done.output
    return done.stdout, done.stderr


def refused(monkeypatch, capsys, *arguments):
    """The one line that a command ends with, status 1."""
    monkeypatch.setattr("sys.argv", ["modlhmp", "map", *map(str, arguments)])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 1
    return capsys.readouterr().err.strip().splitlines()[-1]


@pytest.mark.parametrize("verb", ["build", "update", "info", "plot", "convert", "compare"])
def test_help_teaches_by_example(verb):
    text, _ = said(verb, "--help")
    assert f"modlhmp map {verb} " in text
    assert "Traceback" not in text
    assert "Status 0: done; 1: the data are" in " ".join(said("--help")[0].split())


VERBS = {  # that take --set: what is said, the library's function behind them, which of its arguments --set may give
    "forecast": (
        ("forecast", "--map", "cliff.parquet", "--tracks", "tracks.parquet"),
        modlhmp.forecast,
        ("k", "exits"),
    ),
    "live": (("live", "--map", "cliff.parquet"), modlhmp.Live.__init__, ("seed", "most_people")),
    "build": (("map", "build", "cliff", "tracks.parquet", "--out", "new.parquet"), modlhmp.build_map, ()),
    "update": (("map", "update", "new.state.parquet", "tracks.parquet"), UpdatedMap.__init__, ()),
    "info": (("map", "info", "cliff.csv"), modlhmp.load_map, ()),
    "convert": (("map", "convert", "cliff.csv", "new.parquet"), modlhmp.load_map, ()),
}


@pytest.mark.parametrize("verb", VERBS)
def test_arguments_are_no_options_of_a_kind(folder, monkeypatch, capsys, verb):
    """They are refused by their names, whatever the function behind the verb calls its own."""
    monkeypatch.chdir(folder)
    words, function, options = VERBS[verb]
    named = [one.name for one in inspect.signature(function).parameters.values() if one.kind != one.VAR_KEYWORD]
    for name in {*named, "self", "source"} - {*options}:
        monkeypatch.setattr("sys.argv", ["modlhmp", *words, "--set", f"{name}=1"])
        with pytest.raises(SystemExit) as ended:
            main()
        told = capsys.readouterr().err.strip().splitlines()[-1]
        assert ended.value.code == 1
        assert told.startswith(f"--set {name}=1: ") or f"unknown key '{name}'" in told
    assert not list(folder.glob("new*"))


# --- build ------------------------------------------------------------------------------------------------------------


def test_a_map_is_built_from_clean_tracks(folder, tmp_path):
    _, told = said("build", "cliff", folder / "tracks.parquet", "--out", tmp_path / "fine.parquet", "--set",
                   "resolution_m=0.5", "--set", "bandwidth=kucner")  # fmt: skip
    made = modlhmp.load_map(tmp_path / "fine.parquet")
    assert f"fine.parquet: cliff, {made.whole.num_rows} rows" in told
    wanted = modlhmp.build_map("cliff", crowd(), resolution_m=0.5, bandwidth="kucner")
    assert made.whole.equals(wanted.whole)


def test_a_map_by_hours_takes_the_place_s_clock(folder, tmp_path):
    said("build", "tc_cliff", folder / "tracks.parquet", "--out", tmp_path / "hours", "--timezone", "Asia/Tokyo")
    assert list(hour_files(tmp_path / "hours")) == [16, 17]


@pytest.mark.parametrize("verb", ["build", "update"])
@pytest.mark.parametrize(
    ("kind", "zone", "told"), [("tc_cliff", (), 1), ("tc_cliff", ("--timezone", "UTC"), 0), ("cliff", (), 0)]
)
def test_hours_of_tracks_without_a_time_zone_are_told_once(folder, tmp_path, caplog, verb, kind, zone, told):
    """UTC that is said is not asked for again, and the second piece is of the first's zone."""
    words = [kind, folder / "tracks.parquet", "--out", tmp_path / "new"]
    if verb == "update":
        words = [tmp_path / "state.parquet", folder / "tracks.parquet", "--kind", kind, "--out", tmp_path / "new"]
    said(verb, *words, *zone)
    assert caplog.text.count("hours are taken for those of UTC") == told
    assert caplog.text.count(f"map {verb} --timezone NAME") == told
    if verb == "update":
        said("update", tmp_path / "state.parquet", folder / "tracks.parquet", *zone)
        assert caplog.text.count("hours are taken for those of UTC") == told


def test_a_map_is_built_from_a_dataset_file(tmp_path, monkeypatch, capsys, caplog):
    rows = [
        f"{person},{t},{1.2 * t * (1 if person % 2 else -1)},{0.1 * person}" for person in range(12) for t in range(20)
    ]
    for name in ("a", "b"):
        (tmp_path / f"{name}.csv").write_text("\n".join(["person,t,x,y", *rows, f"99{ord(name)},0,0,0", ""]))
    (tmp_path / "mine.yaml").write_text(
        "title: Mine\nreader: delimited\ntimezone: Europe/London\nheader: true\n"
        "columns: {track_id: person, t: t, x: x, y: y}\nhorizon_s: 5\nvelocity: differences\n"
        "citation: nobody\nterms: free\nrecordings:\n"
        "  - {files: a.csv, day: 2020-03-02, start: '08:00', split: train}\n"
        "  - {files: b.csv, day: 2020-03-03, start: '08:00', split: test}\n"
    )
    out = tmp_path / "map.parquet"
    said("build", "snippets", tmp_path / "mine.yaml", "--data-root", tmp_path, "--out", out)
    made = modlhmp.load_map(out)
    assert (made.site.timezone, made.site.horizon_s) == ("Europe/London", 5)
    training = modlhmp.read_tracks(tmp_path / "mine.yaml", data_root=tmp_path, split="train")
    assert made.whole.equals(modlhmp.build_map("snippets", training, made.site).whole)
    said("build", "tc_cliff", tmp_path / "mine.yaml", "--data-root", tmp_path, "--out", tmp_path / "hours")
    assert "UTC" not in caplog.text
    for words in (
        ("build", "cliff", tmp_path / "mine.yaml", "--out", out),
        ("update", tmp_path / "s.parquet", tmp_path / "mine.yaml"),
    ):
        line = refused(monkeypatch, capsys, *words, "--data-root", tmp_path, "--timezone", "Asia/Tokyo")
        assert "--timezone Asia/Tokyo" in line and "mine.yaml has a `timezone` of its own; leave it out" in line


def test_what_cannot_be_built(folder, tmp_path, monkeypatch, capsys):
    out = tmp_path / "map.parquet"
    tracks = folder / "tracks.parquet"
    assert "describe it first: modlhmp inspect a.csv > a.yaml" in refused(
        monkeypatch, capsys, "build", "cliff", "a.csv", "--out", out
    )
    assert "did you mean 'cliff'" in refused(monkeypatch, capsys, "build", "clif", tracks, "--out", out)
    assert "did you mean 'resolution_m'" in refused(
        monkeypatch, capsys, "build", "cliff", tracks, "--out", out, "--set", "resolution=2"
    )
    assert "give NAME=VALUE" in said("build", "cliff", tracks, "--out", out, "--set", "5", status=2)[1]
    assert not out.exists()


@pytest.mark.parametrize(
    ("arguments", "remedy"),
    [
        (("map", "build", "cliff", "nowhere.parquet", "--out", "z.png"), "--out z.png: the name must end in .parquet"),
        (("map", "build", "tc_cliff", "nowhere.yaml", "--out", "z.png"), "is a folder; give a name without .png"),
        (("map", "build", "stef", "nowhere.yaml", "--out", "z.PARQUET"), "is a folder; give a name without .PARQUET"),
        (("map", "update", "z.csv", "nowhere.parquet"), "STATE z.csv: the name must end in .parquet"),
        (("map", "update", "s.parquet", "nowhere.parquet", "--out", "z.png"), "--out z.png: the name must end in .par"),
        (("map", "update", "s.parquet", "nowhere.yaml", "--kind", "stef", "--out", "z.png"), "without .png"),
        (("map", "plot", "nowhere", "--out", "z.parquet"), "--out z.parquet: the name must end in .pdf, .png or .svg"),
        (("map", "compare", "nowhere", "nowhere", "--out", "z.png"), "--out z.png: the name must end in .csv or .txt"),
        (("forecast", "--map", "no", "--tracks", "no", "--out", "z.png"), "must end in .csv, .parquet or .ndjson"),
        (("live", "--map", "nowhere", "--keep", "z.csv"), "--keep z.csv: the name must end in .parquet"),
        (("inspect", "nowhere.csv", "--to", "z.yaml"), "--to z.yaml: where the picture and the page go is a folder"),
        (("export-task", "nowhere.yaml", "--to", "z.csv"), "--to z.csv: a task is a folder; give a name without .csv"),
    ],
)
def test_a_name_that_says_another_form_is_refused_before_the_work(tmp_path, monkeypatch, capsys, arguments, remedy):
    """Before anything is read: what is to be read is not there."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.argv", ["modlhmp", *arguments])
    with pytest.raises(SystemExit) as ended:
        main()
    said = capsys.readouterr().err
    assert ended.value.code == 1 and remedy in said and len(said.splitlines()) == 1
    assert not list(tmp_path.iterdir())


# --- info -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "parts"),
    [
        ("cliff.parquet", ("kind: cliff", "Europe/London", "resolution 1.0", "radius 1.0", "locations", "var_heading")),
        ("cliff.csv", ("kind: cliff", "resolution 1", "from cliff.csv, form matlab")),
        ("tc_cliff", ("hours: 7 8", "whole day: ", "hour 08: ")),
        ("stef", ("hours: 7 8", "orientations 8")),
        ("episodes.parquet", ("kind: episodes", "step 1.0", "  t [s]: unix time")),
        ("snippets.parquet", ("cell 1.0", "past 3")),
        ("exits.parquet", ("  left: people who left within",)),
    ],
)
def test_info(folder, name, parts):
    text, _ = said("info", folder / name)
    for part in parts:
        assert part in text
    if name == "cliff.parquet":
        whole = modlhmp.load_map(folder / name).whole
        assert f"{whole.num_rows} rows, {len(set(whole['location'].to_pylist()))} locations" in text


def test_info_of_a_stream_and_of_what_is_no_map(folder, monkeypatch, capsys):
    text, _ = said("info", "-", input=(folder / "cliff.csv").read_bytes())
    assert "from standard input, form matlab" in text
    assert "Parquet is not read from a stream" in str(
        CliRunner().invoke(app, ["map", "info", "-"], input=(folder / "cliff.parquet").read_bytes()).exception
    )
    assert "no such file" in refused(monkeypatch, capsys, "info", folder / "nothing")


# --- plot -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "name", ["cliff.parquet", "cliff.csv", "tc_cliff", "stef", "episodes.parquet", "snippets.parquet", "pooled.parquet"]
)
def test_plot(folder, tmp_path, name):
    from PIL import Image  # noqa: PLC0415

    file = folder / (f"{name}.parquet" if name in {"episodes", "snippets"} else name)
    said("plot", file, "--out", tmp_path / "map.png")
    picture = np.asarray(Image.open(tmp_path / "map.png").convert("RGB")).reshape(-1, 3).astype(int)
    coloured = np.ptp(picture, axis=1) > 60
    assert coloured.sum() > 3000, "arrows and the key have colours"


def test_arrows_are_whole_and_the_title_says_no_more_than_there_is(folder, tmp_path, monkeypatch):
    from modlhmp import pictures  # noqa: PLC0415

    drawn = []
    monkeypatch.setattr(pictures, "save", lambda figure, path: drawn.append(figure.axes[0]))
    for name, title in (("cliff.csv", "cliff.csv, cliff"), ("tc_cliff", "tc_cliff, tc_cliff, 7:00 to 8:00")):
        said("plot", folder / name, "--out", tmp_path / "map.png")
        ax = drawn[-1]
        assert ax.get_title() == title
        (arrows,) = (one for one in ax.collections if hasattr(one, "XY"))
        for axis, part, along in ((ax.get_xlim(), 0, arrows.U), (ax.get_ylim(), 1, arrows.V)):
            tips = arrows.XY[:, part] + along
            assert axis[0] < tips.min() and tips.max() < axis[1]


def test_plot_over_a_floor_plan(folder, tmp_path):
    from PIL import Image  # noqa: PLC0415

    Image.fromarray(np.where(np.arange(40)[:, None] < 20, 0, 254).astype(np.uint8) * np.ones((1, 80), np.uint8)).save(
        tmp_path / "plan.png"
    )
    (tmp_path / "plan.yaml").write_text(
        "image: plan.png\nresolution: 0.5\norigin: [-20, -10, 0]\nnegate: 0\n"
        "occupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )
    grey = []
    for more in ((), ("--floor-plan", tmp_path / "plan.yaml")):
        said("plot", folder / "cliff.parquet", "--out", tmp_path / "map.png", *more)
        picture = np.asarray(Image.open(tmp_path / "map.png").convert("RGB")).reshape(-1, 3)
        grey.append((picture == 180).all(axis=1).mean())
    assert grey[1] - grey[0] > 0.03, "the upper half is wall"


def test_what_is_not_drawn(folder, tmp_path, monkeypatch, capsys):
    line = refused(monkeypatch, capsys, "plot", folder / "cliff.parquet", "--out", tmp_path / "map.jpeg")
    assert "must end in .pdf, .png or .svg" in line
    line = refused(monkeypatch, capsys, "plot", folder / "tc_cliff", "--hour", 12, "--out", tmp_path / "map.png")
    assert "hour 12: the map has 7, 8" in line
    line = refused(monkeypatch, capsys, "plot", folder / "exits.parquet", "--out", tmp_path / "map.png")
    assert "a map of kind exits is not drawn" in line
    assert not list(tmp_path.iterdir())


# --- convert ----------------------------------------------------------------------------------------------------------


def test_convert_there_and_back(folder, tmp_path):
    steps = [folder / "cliff.parquet", tmp_path / "a.xml", tmp_path / "b.csv", tmp_path / "c.parquet"]
    for (before, after), to in zip(pairwise(steps), ((), ("--to", "online"), ()), strict=True):
        _, told = said("convert", before, after, *to)
        assert f"{after}: cliff" in told
        assert ("loses" in told) == (after.suffix != ".parquet")
    ours, theirs = (modlhmp.load_map(path).whole for path in (steps[0], steps[-1]))
    for name in ("x", "y", "weight", "mean_speed", "var_heading", "var_speed"):
        np.testing.assert_array_equal(column(ours, name), column(theirs, name))


def test_convert_streams(folder):
    """Only the map goes to standard output."""
    out, told = said("convert", "-", "-", "--to", "online", input=(folder / "cliff.csv").read_bytes())
    rows = [line.split(",") for line in out.splitlines()]
    assert {len(row) for row in rows} == {10}
    assert "Form online loses" in told
    back, _ = said("convert", "-", "-", "--form", "online", "--to", "matlab", "--header", input=out.encode())
    assert back.startswith("x,y,mean_heading,mean_speed")
    assert back.splitlines()[1:] == (folder / "cliff.csv").read_text().splitlines()


def test_convert_moves_a_map(folder, tmp_path):
    said("convert", folder / "cliff.csv", tmp_path / "moved.parquet", "--origin", -3, 2)
    ours, moved = (modlhmp.load_map(path).whole for path in (folder / "cliff.csv", tmp_path / "moved.parquet"))
    for name, by in (("x", 3), ("y", -2)):
        np.testing.assert_allclose(column(moved, name), column(ours, name) + by)


def test_convert_needs_what_a_form_does_not_say(folder, tmp_path, caplog):
    said("convert", folder / "stef", tmp_path / "stef.txt", "--to", "histogram")
    assert "tell whoever reads it" in caplog.text
    low = {name: column(modlhmp.load_map(folder / "stef").whole, name) for name in ("x", "y")}
    box = [f"{name}={values.min() - 0.5},{values.max() + 0.5}" for name, values in low.items()]
    said("convert", tmp_path / "stef.txt", tmp_path / "again", "--form", "histogram", "--set", box[0], "--set", box[1],
         "--timezone", "Europe/London")  # fmt: skip
    assert list(modlhmp.load_map(tmp_path / "again").hours) == [7, 8]


@pytest.mark.parametrize("way", ["info", "convert", "stream"])
def test_hours_whose_time_zone_nobody_said_are_told(folder, tmp_path, caplog, way):
    """UTC that is said is not asked for again."""
    said("convert", folder / "stef", tmp_path / "stef.txt", "--to", "histogram")
    words = ["info", "-"] if way == "stream" else [way, tmp_path / "stef.txt"]
    words += ["--form", "histogram", "--set", "x=-50,50", "--set", "y=-50,50"]
    words += [tmp_path / "out"] if way == "convert" else []
    for zone, told in (((), True), (("--timezone", "UTC"), False)):
        caplog.clear()
        CliRunner().invoke(app, ["map", *map(str, words), *zone], input=(tmp_path / "stef.txt").read_bytes())
        assert ("hours are taken for those of UTC" in caplog.text) == told


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("episodes.parquet", "a.csv", "--to", "matlab"), "form matlab cannot carry a map of kind episodes"),
        (("cliff.parquet", "a.csv", "--to", "matlb"), "did you mean 'matlab'"),
        (("cliff.parquet", "-"), "Parquet does not go to standard output"),
        (("tc_cliff", "-", "--to", "matlab"), "a map of kind tc_cliff is a folder of hours in form matlab"),
        (("cliff.parquet", "b.parquet", "--origin", "1", "1"), "it holds its site and its frame itself"),
        (("cliff.parquet", "b.xml", "--header"), "unknown key 'header'"),
        (
            ("tc_cliff", "b", "--timezone", "Asia/Tokyo"),
            "--timezone Asia/Tokyo: tc_cliff says of which time zone its hours are; leave it out",
        ),
        (
            ("cliff.parquet", "b.frob"),
            "b.frob: the name must end in .parquet, as form parquet does; `modlhmp map convert --to` writes others",
        ),
        (("cliff.parquet", "b.csv", "--to", "xml"), "b.csv: the name must end in .xml, as form xml does"),
        (("cliff.parquet", "b.xml", "--to", "online"), "b.xml: the name must end in .csv or .txt, as form online does"),
        (("tc_cliff", "b.csv", "--to", "matlab"), "b.csv: a map of kind tc_cliff, one map an hour, is a folder; give"),
        (("tc_cliff", "b.parquet"), "is a folder; give a name without .parquet"),
    ],
)
def test_what_is_not_converted(folder, monkeypatch, capsys, arguments, message):
    before = sorted(folder.rglob("*"))
    monkeypatch.chdir(folder)
    monkeypatch.setattr("sys.argv", ["modlhmp", "map", "convert", *arguments])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 1
    assert message in capsys.readouterr().err
    assert sorted(folder.rglob("*")) == before


# --- compare ----------------------------------------------------------------------------------------------------------


def test_a_map_is_like_itself(folder):
    text, _ = said("compare", folder / "cliff.parquet", folder / "cliff.csv")
    assert "of the map" not in text
    direction = float(re.search("direction: median 0, 90th percentile ([^ ]+) of the probability", text)[1])
    assert direction < 1e-6
    assert "speed: median 0 m/s, 90th percentile 0 m/s" in text


def test_maps_of_two_kinds(folder):
    text, _ = said("compare", folder / "tc_cliff", folder / "stef", "--hour", 8)
    assert "speed: one of the maps has none" in text
    assert "of the map 8:00 to 9:00, of the other 8:00 to 9:00" in text
    assert (
        "of the map 7:00 to 8:00, of the other all hours"
        in said("compare", folder / "tc_cliff", folder / "cliff.parquet")[0]
    )
    text, told = said("compare", folder / "cliff.parquet", folder / "cliff.csv", "--out", "-")
    assert text.startswith("x,y,apart_m,direction,speed_m_s,p,p_theirs\n")
    assert "direction: " in told


def test_an_hour_of_maps_without_hours_is_refused(folder, monkeypatch, capsys):
    files = folder / "cliff.parquet", folder / "cliff.csv"
    assert "--hour 9: neither map has hours" in refused(monkeypatch, capsys, "compare", *files, "--hour", 9)
    said("compare", folder / "cliff.parquet", folder / "tc_cliff", "--hour", 7)


def test_maps_that_hold_walks_are_not_compared(folder, monkeypatch, capsys):
    line = refused(monkeypatch, capsys, "compare", folder / "cliff.parquet", folder / "episodes.parquet")
    assert (
        "a map of kind episodes holds no flows of places; kinds that do: cliff, tc_cliff, smoothed_cliff, stef" in line
    )


def cliff_of(*components, step="1"):
    """A CLiFF-map's table: each component is location, x, y, weight, heading, speed, variance of heading, p."""
    import pyarrow as pa  # noqa: PLC0415

    names = ("location", "x", "y", "weight", "mean_heading", "mean_speed", "var_heading", "p")
    columns = dict(zip(names, np.array(components, float).T, strict=True))
    return pa.table(columns).replace_schema_metadata({"resolution": step})


def test_shares_of_directions():
    """Those of a normal distribution wrapped around the circle; a very wide one is even."""
    both_ways = (0, 0, 0, 0.5, 0, 1, 1e-4, 1), (0, 0, 0, 0.5, np.pi, 2, 1e-4, 1)
    found = flows("cliff", cliff_of(*both_ways, (1, 1, 0, 1, 3, 1, 80, 1), (2, 2, 0, 1, np.pi / 8, 1, 0.01, 1)))
    np.testing.assert_allclose(found.shares[0], [0.5, 0, 0, 0, 0.5, 0, 0, 0], atol=1e-9)
    np.testing.assert_allclose(found.shares[1], 0.125, atol=1e-3)
    np.testing.assert_allclose(found.shares[2], [0.5, 0.5, 0, 0, 0, 0, 0, 0], atol=1e-3)
    np.testing.assert_allclose(found.speed, [1.5, 1, 1])
    rng = np.random.default_rng(0)
    drawn = rng.normal(2.8, np.sqrt(0.7), 400_000)
    counts = np.bincount(np.floor(np.mod(drawn + np.pi / 8, 2 * np.pi) * 8 / (2 * np.pi)).astype(int), minlength=8)
    shares = flows("cliff", cliff_of((0, 0, 0, 1, 2.8, 1, 0.7, 1))).shares[0]
    np.testing.assert_allclose(shares, counts / len(drawn), atol=0.003)


def test_opposite_flows_are_as_different_as_can_be():
    east, west = (flows("cliff", cliff_of((0, 0, 0, 1, way, 1, 1e-3, 1))) for way in (0, np.pi))
    assert compare(east, west)["direction"][0] == pytest.approx(1)
    assert compare(east, east)["direction"][0] == 0
    faster = flows("cliff", cliff_of((0, 0.3, 0, 1, 0, 1.5, 1e-3, 1), (1, 5, 0, 1, 0, 1, 1e-3, 1)))
    found = compare(east, faster)
    assert found["speed_m_s"].tolist() == [0.5]
    assert found["apart_m"].tolist() == [pytest.approx(0.3)]
    assert len(compare(flows("cliff", cliff_of((0, 9, 9, 1, 0, 1, 1, 1))), east)["x"]) == 0


# --- update -----------------------------------------------------------------------------------------------------------


def test_a_map_is_updated_piece_by_piece(folder, tmp_path):
    """Torn apart by person, told twice, merged, and a day taken out again: the map of the tracks."""
    tracks = crowd()
    for name, part in (("even", 0), ("odd", 1)):
        write_tracks(tracks.take(tracks.track_id % 2 == part), tmp_path / name / "hall.parquet")
    write_tracks(tracks._replace(t=tracks.t + 86400), tmp_path / "tuesday.parquet")
    state, other = tmp_path / "state.parquet", tmp_path / "other.parquet"
    _, told = said("update", state, tmp_path / "even/hall.parquet", tmp_path / "tuesday.parquet", "--kind", "exits")
    assert "hall: 800 taken; 2 slots of time changed" in told
    assert "800 repeated; the map is that of before" in said("update", state, tmp_path / "even/hall.parquet")[1]
    said("update", other, tmp_path / "odd/hall.parquet", "--kind", "exits")
    day = str(np.datetime64(int(tracks.t[0] + 86400), "s"))[:10]
    _, told = said("update", state, "--merge", other, "--remove-day", day, "--out", tmp_path / "exits.parquet")
    assert f"{len(tracks.t)} rows of {day} removed" in told and f"exits.parquet: exits, {_rows(folder)} rows" in told
    assert modlhmp.load_map(tmp_path / "exits.parquet").whole.equals(modlhmp.load_map(folder / "exits.parquet").whole)


def test_a_new_state_is_of_what_is_said_or_merged(tmp_path, monkeypatch, capsys):
    """A mistyped name is no new map, and one that begins with others' is of their kind, site and options."""
    new = tmp_path / "new.state.parquet"
    for words in (("--out", tmp_path / "new.parquet"), ("--half-life", 12), ("--remove-day", "2012-10-24")):
        assert f"{new}: no such file" in refused(monkeypatch, capsys, "update", new, *words)
    assert not list(tmp_path.iterdir())
    tracks = crowd()
    site, names = modlhmp.Site(timezone="Asia/Tokyo", time_step_s=0.4), ("even", "odd")
    whole = UpdatedMap("snippets", site, cell_m=2.0)
    for part, name in enumerate(names):
        rows, one = tracks.take(tracks.track_id % 2 == part), UpdatedMap("snippets", site, 3, cell_m=2.0)
        rows = rows._replace(t=rows.t[0] + 0.4 * (rows.t - rows.t[0]))
        one.add(rows, name)
        whole.add(rows, name)
        one.save(tmp_path / f"{name}.parquet")
    merged = [word for name in names for word in ("--merge", tmp_path / f"{name}.parquet")]
    assert "leave --kind and --set out" in refused(monkeypatch, capsys, "update", new, *merged, "--kind", "stef")
    assert "is of Asia/Tokyo; leave it out" in refused(monkeypatch, capsys, "update", new, *merged, "--timezone", "UTC")
    said("update", new, *merged)
    found = UpdatedMap.load(new)
    assert (found.site, found.building, found.half_life_h) == (site, whole.building, None)
    assert found.written().whole.equals(whole.written().whole)


def _rows(folder):
    return modlhmp.load_map(folder / "exits.parquet").whole.num_rows


def test_what_cannot_be_updated_is_refused(folder, tmp_path, monkeypatch, capsys):
    state = tmp_path / "state.parquet"
    assert "holds no counts to be updated" in refused(
        monkeypatch, capsys, "update", folder / "cliff.parquet", folder / "tracks.parquet"
    )
    assert "nothing to do: give tracks" in refused(monkeypatch, capsys, "update", state)
    assert "half_life_h 0.0: give hours above 0" in refused(
        monkeypatch, capsys, "update", state, folder / "tracks.parquet", "--kind", "episodes", "--half-life", "0"
    )
    assert not state.exists()
    said("update", state, folder / "tracks.parquet", "--kind", "episodes")
    assert "it is a map of kind episodes with options of its own" in refused(
        monkeypatch, capsys, "update", state, folder / "tracks.parquet", "--kind", "cliff"
    )
    assert "--timezone Asia/Tokyo: the map " in refused(
        monkeypatch, capsys, "update", state, folder / "tracks.parquet", "--timezone", "Asia/Tokyo"
    )
    assert "two recordings have the same name" in refused(
        monkeypatch, capsys, "update", state, folder / "tracks.parquet", folder / "tracks.parquet"
    )
