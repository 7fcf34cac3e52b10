"""`modlhmp live`: rows in, forecasts out, whatever comes in and whoever reads."""

import json
import os
import subprocess
import sys
import threading
import time

import numpy as np
import pytest

import modlhmp
from modlhmp import Live, Site
from modlhmp.cli import main
from modlhmp.contract import SITE, crowd
from modlhmp.live_lines import MOST_BYTES, Moments, Newest, batches, forecasts, row_of, text_of

T0 = 1.3e9
STEPS = Site(horizon_s=5)


def cvm():
    return Live("cvm", 5, site=STEPS)


def rows(times, who=1, speed=1.2, y=0.5):
    return [
        json.dumps({"t": T0 + t, "id": who, "x": round(speed * t, 6), "y": y}).encode()
        for t in np.asarray(times).tolist()
    ]


def moments_of(lines, every_s=1.0, **options):
    """Seconds after `T0` of the forecasts that these lines have made, and how many people each is of."""
    live = options.pop("live", None) or cvm()
    return [
        (round(t0 - T0, 6), len(futures.t0))
        for t0, futures in forecasts(live, [[one] for one in lines], every_s, **options)
    ]


# --- lines -----------------------------------------------------------------------------------------------------------


def test_a_row_is_read():
    assert row_of(b' {"y": 2, "t": 5.5, "id": "P01", "x": -1, "colour": "red"} ') == (5.5, "P01", -1.0, 2.0)
    assert row_of(b'{"t": 5}') == (5.0, None, 0.0, 0.0)


@pytest.mark.parametrize(
    ("line", "why"),
    [
        (b"hello", "not JSON"), (b"[1, 2, 3, 4]", "not {...}"), (b"7", "not {...}"), (b'"t"', "not {...}"),
        (b"{}", "no t"), (b"\xff\xfe{}", "not JSON"), (b"[" * 50_000, "not JSON"),
        (b'{"t": ' + b"9" * 9000 + b"}", "not JSON"),
        (b'{"t": ' + b" " * MOST_BYTES + b"5}", "longer than 65536 bytes"),
        (b'{"t": "5", "id": 1, "x": 0, "y": 0}', "t is text, not a number"), (b'{"t": "5"}', "t is text, not a number"),
        (b'{"id": 1, "x": 0, "y": 0}', "no t"), (b'{"t": 5, "id": 1, "x": 0}', "no y"),
        (b'{"t": 5, "id": 1, "x": NaN, "y": 0}', "NaN is no number of JSON"),
        (b'{"t": 5, "id": 1, "x": 1e999, "y": 0}', "x inf is beyond 10,000 km: in m?"),
        (b'{"t": 5, "id": Infinity, "x": 0, "y": 0}', "Infinity is no number of JSON"),
        (b'{"t": 1351042800000, "id": 1, "x": 0, "y": 0}', "t 1351042800000 is beyond the year 5138: in ms? Give s"),
        (b'{"t": 5, "id": [1], "x": 0, "y": 0}', "id is a list, not a number or text"),
        (b'{"t": 5, "id": "\\ud800", "x": 0, "y": 0}', "is nobody's"),
        (b'{"t": 5, "id": true, "x": 0, "y": 0}', "id is true or false, not a number or text"),
        (b'{"t": 5, "id": 1e999, "x": 0, "y": 0}', "id inf is nobody's"),
        (b'{"t": 5, "id": "", "x": 0, "y": 0}', "id '' is nobody's"),
        (b'{"t": 5, "x": 0, "y": 0}', "no id"), (b'{"t": 5, "id": null, "x": 0}', "no id"),
        (b'{"t": 5, "track_id": 7, "x": 0, "y": 0}', "no id; it has t, track_id, x, y"),
    ],
    ids=range(25),
)  # fmt: skip
def test_what_is_no_row_is_told_why(line, why):
    """One that has a place is not taken for one that tells the time alone."""
    told = row_of(line)
    assert isinstance(told, str) and why in told


def test_lines_come_as_they_are_written():
    source, sink = os.pipe()
    got = batches(source)
    os.write(sink, b"one\ntw")
    assert next(got) == [b"one"]
    os.write(sink, b"o\n\nthree")
    assert next(got) == [b"two", b""]
    os.close(sink)
    assert [*got] == [[b"three"]]
    os.close(source)


def test_a_line_without_end_does_not_grow(tmp_path):
    (tmp_path / "rows").write_bytes(b"x" * (5 * MOST_BYTES) + b"\n" + rows([1])[0])
    source = os.open(tmp_path / "rows", os.O_RDONLY)
    lines = [line for batch in batches(source) for line in batch]
    assert [isinstance(row_of(line), tuple) for line in lines] == [False, True]
    assert max(map(len, lines)) <= 2 * MOST_BYTES + 1
    os.close(source)


# --- moments ---------------------------------------------------------------------------------------------------------


def test_a_moment_comes_once_with_the_first_row_after_it():
    moments = Moments(0.5)
    assert [moments.passed(t) for t in (10.2, 10.4, 10.5, 10.6, 10.9, 12.0, 12.01)] == [
        None, None, None, 10.5, None, 11.5, 12.0
    ]  # fmt: skip
    assert moments.passed(12.0, reached=True) is None
    assert moments.passed(12.5, reached=True) == 12.5
    assert [Moments(0.1).passed(T0 + 0.1 * k, reached=True) for k in range(3)] == pytest.approx(
        [T0, T0 + 0.1, T0 + 0.2], abs=1e-6
    )


@pytest.mark.parametrize("every_s", [1.0, 0.1, 1 / 30, 0.04, 0.02, 0.01])
def test_frames_of_a_camera_are_moments(every_s):
    """Each once, though a unix time is a multiple of `every_s` only to 2.4e-7 s."""
    first = round(1.35e9 / every_s)
    frames = [round(n * every_s, 6) for n in range(first, first + 3000)]
    for reached, expected in ((True, frames), (False, frames[:-1])):
        moments = Moments(every_s)
        found = [moment for t in frames if (moment := moments.passed(t, reached)) is not None]
        np.testing.assert_allclose(found, expected, rtol=0, atol=2e-6)


def test_forecasts_are_of_what_is_known_then():
    """And as `Live` has them; the last moment is reached by the last row."""
    times = np.arange(0, 8.01, 0.25)
    assert moments_of(rows(times)) == [(t, int(t >= 3)) for t in range(9)]
    assert moments_of(rows(times), 2.0) == [(0, 0), (2, 0), (4, 1), (6, 1), (8, 1)]
    live, batch = cvm(), cvm()
    for t in times[times <= 5]:
        batch.see(T0 + t, 1, round(1.2 * t, 6), 0.5)
    for t0, futures in forecasts(live, [rows(times)], 1.0):
        if t0 == T0 + 5:
            np.testing.assert_array_equal(futures.paths, batch.forecast(T0 + 5).paths)


def test_of_moments_that_pass_with_one_row_the_last_is_forecast():
    assert moments_of(rows([0, 1, 2, 3, 4, 900.5, 901.5])) == [
        (0, 0), (1, 0), (2, 0), (3, 1), (900, 0), (901, 0)
    ]  # fmt: skip


def test_a_line_that_tells_the_time_alone():
    """Who was there has been told: no row is waited for; and time passes where nobody is."""
    said = [*rows(range(5)), json.dumps({"t": T0 + 4}).encode(), json.dumps({"t": T0 + 7.5}).encode()]
    assert moments_of(said)[2:] == [(2, 0), (3, 1), (4, 1), (7, 0)]
    assert moments_of([json.dumps({"t": T0 + t}).encode() for t in (10, 11)], 5.0) == [(10, 0)]
    assert moments_of([json.dumps({"t": T0 + t}).encode() for t in (10, 14, 19)], 5.0) == [(10, 0), (15, 0)]


def test_a_clock_that_is_set_back():
    live = cvm()
    got = moments_of(rows([*range(3000, 3005), *np.arange(0, 10, 0.5)]), live=live)
    assert [t for t, _ in got] == [3000, 3001, 3002, 3003, 5, 6, 7, 8, 9]
    assert got[-1][1] == 1
    assert live.counts["clock_set_back"] == 1
    live = cvm()
    told = [*rows(range(5)), json.dumps({"t": T0 + 1e6}).encode(), *rows(np.arange(5, 20, 0.5))]
    assert moments_of(told, live=live)[-1] == (19, 1), "a wrong time does not stop it for long"


@pytest.mark.parametrize("told", [[], [9.6], [10.0]], ids=["the rows end", "between", "at a moment"])
def test_moments_before_a_clock_was_set_back_are_not_asked_for(told):
    """However far apart moments are, and whatever comes next; one that comes later is forecast."""
    back = [*rows(range(3000, 3012)), *rows(np.arange(8.6, 9.55, 0.1))]
    back += [json.dumps({"t": T0 + t}).encode() for t in told]
    got = moments_of(back, 10.0)
    assert [t for t, _ in got] == [3000, 3010, *([10] if told == [10.0] else [])]
    assert moments_of([*back, *rows(range(11, 22))], 10.0)[2:] == [(10, 0), (20, 1)]


def test_with_latest_a_batch_that_sets_the_clock_back_has_its_newest_moment():
    lines = [*rows(range(3000, 3012)), *rows(np.arange(0, 10, 0.5))]
    assert [t0 - T0 for t0, _ in forecasts(cvm(), [lines], 1.0, latest=True)] == [9]


@pytest.mark.parametrize("latest", [False, True])
def test_one_person_whose_clock_is_ahead_stops_no_moment(latest):
    """Whether rows come one by one, or several at once."""
    for size in (1, 4):
        live, lines = cvm(), []
        for t in np.arange(0, 9, 0.5):
            lines += [*rows([t]), *rows([t], "b"), *rows([t + 3600], "ahead")]
        batch = [lines[first : first + size] for first in range(0, len(lines), size)]
        got = [*forecasts(live, batch, 1.0, latest=latest)]
        assert [t0 - T0 for t0, _ in got] == list(range(9))
        assert [len(futures.t0) for _, futures in got][3:] == [2] * 6
        assert live.counts["ahead"] == 18


def test_a_moment_has_the_rows_that_waited_for_it():
    live = cvm()
    lines = [*rows(range(5)), *rows(range(5), "b"), *rows(range(60, 65), "c")]
    assert moments_of(lines, live=live)[-3:] == [(62, 0), (63, 1), (64, 1)]
    assert live.counts["ahead"] == 0


def test_with_latest_a_batch_has_one_forecast_at_most():
    live = cvm()
    got = [*forecasts(live, [rows(np.arange(0, 6.5, 0.25)), rows([6.5]), rows([6.75, 7.25])], 1.0, latest=True)]
    assert [t0 - T0 for t0, _ in got] == [6, 7]
    assert all(len(futures.t0) == 1 for _, futures in got)
    long = [*forecasts(cvm(), [rows(np.arange(0, 14.9, 0.5))], 5.0, latest=True)]
    assert [t0 - T0 for t0, _ in long] == [10], "what it needs has not been forgotten"


def test_what_is_no_row_is_told_with_its_number():
    live, told = cvm(), []
    lines = [b"", b"header", *rows(range(6)), b"{}", b"  "]
    assert len(moments_of(lines, live=live, problem=lambda *one: told.append(one))) == 6
    assert [one[:2] for one in told] == [(2, b"header"), (9, b"{}")]
    assert "not JSON" in told[0][2] and "no t" in told[1][2]
    assert live.counts["bad"] == 2


# --- what is told ----------------------------------------------------------------------------------------------------


def told_of(live, **asked):
    return json.loads(text_of(live.now, live.forecast(), live, **asked))


def test_a_forecast_as_a_line():
    live = cvm()
    for t in range(5):
        live.see(T0 + t, "ann", 1.2 * t, 0.5)
    live.see(T0 + 4, 7, 0, 0)
    told = told_of(live, samples=2, at_s=[1, 5])
    assert (told["t0"], told["step_s"], told["new"]) == (T0 + 4, 1.0, 1)
    (one,) = told["people"]
    assert one["id"] == "ann"
    assert one["path"] == [[6.0, 0.5], [7.2, 0.5], [8.4, 0.5], [9.6, 0.5], [10.8, 0.5]]
    assert one["left"] == [0] * 5
    assert one["samples"] == [one["path"]]
    assert told["occupancy"] == [
        {"at_s": 1, "cells": [[6.5, 0.5, 1.0]]}, {"at_s": 5, "cells": [[10.5, 0.5, 1.0]]}
    ]  # fmt: skip


def test_nobody_as_a_line():
    live = cvm()
    live.pass_time(T0)
    assert told_of(live, samples=3, at_s=[2]) == {
        "t0": T0, "step_s": 1.0, "people": [], "new": 0, "occupancy": [{"at_s": 2, "cells": []}]
    }  # fmt: skip


@pytest.fixture(scope="module")
def episodes(tmp_path_factory):
    path = tmp_path_factory.mktemp("map") / "episodes.parquet"
    modlhmp.build_map("episodes", crowd(), SITE).save(path)
    return path


def test_samples_end_where_people_leave(episodes):
    live = Live(modlhmp.load_map(episodes), 8)
    for t in range(4):
        live.see(T0 + t, 1, 5 + 1.2 * t, 0.0)
    (one,) = told_of(live, samples=100)["people"]
    lengths = [len(path) for path in one["samples"]]
    assert len(lengths) == 100
    assert min(lengths) < 8
    share = [sum(length < step for length in lengths) / 100 for step in range(1, 9)]
    np.testing.assert_allclose(one["left"], share, atol=1e-3)
    stranger = Live(modlhmp.load_map(episodes), 8)
    for t in range(4):
        stranger.see(T0 + t, 1, 500 + t, 0.0)
    (one,) = told_of(stranger, samples=2)["people"]
    assert one["left"] == [0] * 8, "nobody went there, so nobody says that this one leaves"
    assert one["samples"] == [one["path"]] * 2


# --- the command -----------------------------------------------------------------------------------------------------


def run(*arguments, given=b"", **options):
    return subprocess.run(
        [sys.executable, "-m", "modlhmp.cli", "live", *map(str, arguments)],
        input=given, capture_output=True, timeout=300, check=False, **options,
    )  # fmt: skip


def test_rows_of_a_file_and_of_the_input(episodes, tmp_path):
    lines = b"\n".join([*rows(range(-8, 6)), b"no row"])
    (tmp_path / "rows.jsonl").write_bytes(lines)
    asked = (
        "--map",
        episodes,
        "--horizon",
        4,
        "--every",
        2,
        "--occupancy",
        "1,4",
        "--set",
        "persons=3",
        "--samples",
        5,
    )
    one, other = run(*asked, given=lines), run(*asked, tmp_path / "rows.jsonl")
    assert (one.returncode, one.stdout) == (0, other.stdout)
    told = [json.loads(line) for line in one.stdout.splitlines()]
    assert [line["t0"] - T0 for line in told] == [-8, -6, -4, -2, 0, 2, 4]
    assert [len(line["people"]) for line in told] == [0, 0, 1, 1, 1, 1, 1]
    assert {len(line["people"][0]["samples"]) for line in told[2:]} == {5}
    assert [len(line["people"][0]["path"]) for line in told[2:]] == [4] * 5
    assert "line 15 is no row, not JSON: no row" in one.stderr.decode()
    assert "taken 14, bad 1, forecasts 7" in one.stderr.decode()
    assert run(*asked[:4], given=b"").stdout == b""


@pytest.mark.parametrize(
    ("arguments", "status", "message"),
    [
        (("--map", "nowhere.parquet"), 1, "nowhere.parquet: no such file"),
        (("--map", "MAP", "nowhere.jsonl"), 1, "nowhere.jsonl: cannot be read"),
        (("--map", "MAP", "--set", "persons"), 2, "--set 'persons': give NAME=VALUE"),
        (("--map", "MAP", "."), 1, ".: a folder; name a file in it"),
        (("--map", "nowhere.parquet"), 1, "give the file of a map, or its folder of hours"),
        (("--map", "stef"), 1, "--map stef: a kind of map, not a map: build one by `modlhmp map build stef`"),
        (("--map", "MAP", "--set", "horizon_s=3"), 1, "--set horizon_s=3: here that is --horizon"),
        (("--map", "MAP", "--set", "exits=a.parquet"), 1, "--set exits=a.parquet: here that is --exits FILE"),
        (("--map", "MAP", "--set", "exits=true"), 1, "unknown key 'exits'"),
        (("--map", "MAP", "--set", "key=a"), 1, "--set key=a: that is no option"),
        (("--map", "MAP", "--set", "person=3"), 1, "did you mean 'persons'"),
        (("--map", "MAP", "--set", "persons=[1"), 1, "persons: '[1' is not a whole number"),
        (("--map", "MAP", "--occupancy", "3,x"), 1, "give seconds, such as 10,20"),
        (("--map", "MAP", "--occupancy", "90"), 1, "--occupancy 90.0: give a multiple of 1 s from 1 to 8"),
        (("--map", "MAP", "--every", "0"), 1, "--every 0: give 0.01 to 3600 s"),
        (("--map", "MAP", "--horizon", "0.5"), 1, "horizon_s 0.5"),
        (("--map", "MAP", "--exits", "MAP"), 1, "a map of kind `exits`"),
        ((), 2, "Missing option"),
        (("--map", "MAP", "--samples", "-1"), 2, "samples"),
    ],
)
def test_what_cannot_be_done(episodes, monkeypatch, capfd, arguments, status, message):
    monkeypatch.setattr("sys.argv", ["modlhmp", "live", *(str(episodes) if one == "MAP" else one for one in arguments)])
    with pytest.raises(SystemExit) as ended:
        main()
    said = capfd.readouterr()
    assert (ended.value.code, said.out) == (status, "")
    assert message in said.err
    assert "Traceback" not in said.err


def test_rows_in_another_form(episodes):
    done = run("--map", episodes, given=b"time,id,x,y\n1,2,3,4\n")
    assert (done.returncode, done.stdout) == (3, b"")
    assert "line 1 is no row, not JSON: time,id,x,y" in done.stderr.decode()
    renamed = b"\n".join(rows(range(6))).replace(b'"id"', b'"track_id"')
    done = run("--map", episodes, given=renamed)
    assert (done.returncode, done.stdout) == (3, b"")
    assert "line 1 is no row, no id; it has t, track_id, x, y: {" in done.stderr.decode()
    assert done.stderr.decode().splitlines()[-1] == "bad 6"


def test_a_kind_that_needs_no_map_and_more_samples_than_there_are():
    done = run("--map", "cvm", "--horizon", 3, "--samples", 9, given=b"\n".join(rows(range(6))))
    assert done.returncode == 0
    told = [json.loads(line) for line in done.stdout.splitlines()]
    assert [len(line["people"]) for line in told] == [0, 0, 0, 1, 1, 1]
    assert len(told[-1]["people"][0]["samples"]) == 1
    assert done.stderr.decode().count("--samples 9: a forecast has 1") == 1


def test_help_teaches_by_example():
    text = run("--help").stdout.decode()
    for part in ('{"t": 1351042800.1, "id": 7', "--occupancy 10,20 --latest | robot", "Status 0:", "docs/live.md"):
        assert part in text


def started(episodes, *arguments):
    return subprocess.Popen(
        [sys.executable, "-m", "modlhmp.cli", "live", "--map", str(episodes), "--set", "persons=3", *arguments],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
    )  # fmt: skip


def test_a_reader_that_goes(episodes):
    with started(episodes) as process:
        process.stdin.write(b"\n".join(rows(range(20))) + b"\n")
        process.stdin.flush()
        assert json.loads(process.stdout.readline())["t0"] == T0
        process.stdout.close()
        try:
            process.stdin.write(b"\n".join(rows(range(20, 4000))) + b"\n")
            process.stdin.close()
        except BrokenPipeError:
            pass
        said = process.stderr.read().decode()
        assert process.wait(60) == 0
    assert "Traceback" not in said and "Exception" not in said
    assert "forecasts" in said


def test_a_reader_that_stalls(episodes):
    """Without `--latest` rows are no longer taken and nothing is lost; with it all are, and the newest comes first."""
    many = b"\n".join(rows(np.arange(0, 4000))) + b"\n"
    for latest in (False, True):
        with started(episodes, *(["--latest"] if latest else [])) as process:
            written = threading.Thread(target=lambda: (process.stdin.write(many), process.stdin.close()))
            written.start()
            written.join(120 if latest else 10)
            assert written.is_alive() != latest, "who waits for whom"
            told = [json.loads(line)["t0"] - T0 for line in process.stdout]
            said = process.stderr.read().decode()
            written.join()
            assert process.wait(60) == 0
        assert (told == list(range(4000))) != latest
        assert told == sorted(told) and told[-1] == 3999
        assert "taken 4000" in said


def test_newest_writes_the_last_line_and_ends():
    source, sink = os.pipe()
    writer = Newest(sink)
    writer.put("x" * 300_000)  # more than a pipe holds
    time.sleep(0.2)
    for number in range(50):
        writer.put(str(number))
    assert writer.skipped == 49
    closing = threading.Thread(target=writer.close)
    closing.start()
    got = b""
    while not got.endswith(b"\n49\n"):
        got += os.read(source, 1 << 20)
    closing.join(5)
    assert not closing.is_alive()
    assert len(got) == 300_001 + 3
    os.close(source)
    os.close(sink)
