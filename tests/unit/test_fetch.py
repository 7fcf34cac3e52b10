"""Downloads from a local server that resumes, breaks off, fails and lies; sums recorded and checked."""

import fcntl
import gzip
import hashlib
import os
import random
import re
import subprocess
import sys
import threading
import time
from email.utils import formatdate
from functools import partial
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from types import SimpleNamespace

import pytest

from modlhmp.file_format import Columns, FileFormat, Recording
from modlhmp.storage import DataError, read_json, write_json
from modlhmp.study import fetch as fetching

BODY = random.Random(5).randbytes(300_000)
SUM = hashlib.sha256(BODY).hexdigest()
SIZE = len(BODY)
HALF = SIZE // 2
OLD_DATE, NEW_DATE = "Mon, 01 Jan 2001 00:00:00 GMT", "Fri, 01 Jan 2100 00:00:00 GMT"
TAG = '"version 1"'
ROWS = "".join(f"{k}.5,1,{k}.25,2\n" for k in range(20)).encode()
fetch = partial(fetching.fetch, progress=False)


@pytest.mark.parametrize("root", ["", "data/", "/mnt/data/", "../data/"])
def test_each_file_of_a_recording_has_its_own_source(root):
    one, other = {"file": "p/1.csv", "sha256": "a"}, {"file": "p/2.csv", "sha256": None}
    files = [f"{root}p/{n}.csv" for n in (1, 2, 3)]
    assert fetching.listed_sources(files, "p/1.csv", [one, other]) == {files[0]: one, files[1]: other}
    assert fetching.listed_sources(files[1:2], "p/2.csv", [one, other]) == {files[1]: other}
    assert fetching.listed_sources(files, "p/1.csv", []) == {}


class Handler(BaseHTTPRequestHandler):
    """The first word of the address says how the server behaves; each request is noted in `server.seen`."""

    def do_GET(self):
        asked = self.headers.get("Range")
        self.server.seen.append(SimpleNamespace(range=asked, only=self.headers.get("If-Range"), sent=0))
        getattr(self, self.path.strip("/").split(".")[0])(asked, len(self.server.seen))

    def log_message(self, *_):
        """Keep the test output clean."""

    def answer(self, status, body=b"", length=None, **headers):
        self.send_response(status)
        self.send_header("Content-Length", str(len(body) if length is None else length))
        for name, value in headers.items():
            self.send_header(name.replace("_", "-"), value)
        self.end_headers()
        self.server.seen[-1].sent = len(body)  # before the write: the client may look as soon as it has the body
        self.wfile.write(body)

    def ranged(self, asked, _, total=SIZE, **headers):
        headers = headers or {"ETag": TAG}
        start = int(re.fullmatch(r"bytes=(\d+)-", asked)[1]) if asked else 0
        if start >= len(BODY):
            self.answer(416, Content_Range=f"bytes */{len(BODY)}")
        elif asked:
            span = f"bytes {start}-{len(BODY) - 1}/{total}"
            self.answer(206, BODY[start:], Content_Range=span, **headers)
        else:
            self.answer(200, BODY, **headers)

    def dated(self, asked, nth):
        self.ranged(asked, nth, Last_Modified=OLD_DATE)

    def other_tag(self, asked, nth):
        self.ranged(asked, nth, ETag='"version 2"')

    def other_date(self, asked, nth):
        self.ranged(asked, nth, Last_Modified=NEW_DATE)

    def without_tag(self, asked, nth):
        self.ranged(asked, nth, Server="none")

    def other_total(self, asked, nth):
        self.ranged(asked, nth, total=len(BODY) + 7 if asked else len(BODY), ETag=TAG)

    def compliant(self, asked, nth):
        self.ranged(None if self.headers.get("If-Range") != '"version 2"' else asked, nth, ETag='"version 2"')

    def plain(self, *_):
        self.answer(200, BODY)

    def halves(self, asked, nth):
        """The second half comes when the first is on disk."""
        self.answer(200, BODY[:HALF], length=len(BODY), ETag=TAG)
        self.wfile.flush()
        self.server.stop.wait(5)
        self.wfile.write(BODY[HALF:])

    def breaks_once(self, asked, nth):
        if nth == 1:
            self.answer(200, BODY[:HALF], length=len(BODY), ETag=TAG)
        else:
            self.ranged(asked, nth)

    def breaks(self, asked, nth):
        if self.server.whole:
            return self.ranged(asked, nth)
        return self.answer(200, BODY[:HALF], length=len(BODY), ETag=TAG)

    def chunks_break_once(self, asked, nth):
        if nth > 1:
            return self.ranged(asked, nth)
        self.protocol_version = "HTTP/1.1"
        self.close_connection = True
        self.send_response(200)
        self.send_header("Transfer-Encoding", "chunked")
        self.send_header("ETag", TAG)
        self.end_headers()
        return self.wfile.write(b"%x\r\n" % len(BODY) + BODY[:HALF])

    def silent_once(self, asked, nth):
        if nth > 1:
            return self.ranged(asked, nth)
        return self.server.stop.wait(5)

    def closes_once(self, asked, nth):
        if nth > 1:
            self.ranged(asked, nth)

    def fails_twice(self, asked, nth):
        if nth <= 2:
            self.answer(500, b"later")
        else:
            self.ranged(asked, nth)

    def fails(self, *_):
        self.answer(503)

    def absent(self, *_):
        self.answer(404, b"no such page")

    def wrong_place(self, asked, nth):
        if asked:
            self.answer(206, BODY[10:], Content_Range=f"bytes 10-{len(BODY) - 1}/{len(BODY)}")
        else:
            self.ranged(asked, nth)

    def empty(self, *_):
        self.answer(200)

    def nothing(self, *_):
        self.send_response(200)
        self.end_headers()

    def until_closed(self, *_):
        self.send_response(200)
        self.end_headers()
        self.wfile.write(BODY[:HALF])

    def partial(self, *_):
        self.answer(206, BODY[:HALF], Content_Range=f"bytes 0-{HALF - 1}/{len(BODY)}")

    def other_status(self, *_):
        self.answer(203, BODY)

    def packed(self, *_):
        self.answer(200, gzip.compress(ROWS), Content_Encoding="gzip", Content_Type="text/csv")

    def login(self, *_):
        self.answer(200, b"<!doctype html><html><body>Please log in, 1, 2, 3\n</body></html>\n" * 50)

    def rows(self, *_):
        self.answer(200, ROWS)

    def busy_once(self, asked, nth):
        if nth > 1:
            return self.ranged(asked, nth)
        return self.answer(self.server.status, Retry_After=self.server.after)


@pytest.fixture
def server():
    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    server.seen, server.stop, server.whole = [], threading.Event(), False
    server.at = lambda behaviour: f"http://127.0.0.1:{server.server_port}/{behaviour}.csv"
    thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01})
    thread.start()
    yield server
    server.stop.set()
    server.shutdown()
    server.server_close()
    thread.join()


@pytest.fixture(autouse=True)
def pauses(monkeypatch):
    """Waits before retries, noted instead of spent."""
    noted = []
    monkeypatch.setattr(fetching.time, "sleep", noted.append)
    return noted


@pytest.fixture
def path(tmp_path):
    return tmp_path / "site" / "day.csv"


@pytest.fixture
def part(path):
    path.parent.mkdir()
    return path.with_name("day.csv.part")


def leave(part, content, address, validator=TAG, total=SIZE):
    """An interrupted download, and what is known of its version."""
    part.write_bytes(content)
    write_json(note_of(part), {"url": address, "validator": validator, "total": total, "held": len(content)})


def note_of(part):
    return part.with_name(part.name + ".json")


def read(path):
    """Read rows of t, id, x, y."""
    form = FileFormat(columns=Columns(t=0, track_id=1, x=2, y=3))
    fetching.read_as(path, form, [Recording()])


def files(path):
    return sorted(file.name for file in path.parent.iterdir())


def test_plain_download(server, path, capsys):
    assert fetching.fetch(server.at("plain"), path) == SUM
    assert path.read_bytes() == BODY
    assert files(path) == ["day.csv"]
    assert "day.csv" in capsys.readouterr().err  # the progress bar
    fetch(server.at("plain"), path.with_name("quiet.csv"))
    assert capsys.readouterr().err == ""


def test_present_file_is_checked_not_replaced(server, path, part):
    path.write_bytes(b"mine")
    with pytest.raises(DataError, match="delete"):
        fetch(server.at("plain"), path, sha256=SUM)
    assert path.read_bytes() == b"mine"
    assert fetch(server.at("plain"), path) == hashlib.sha256(b"mine").hexdigest()
    assert server.seen == []


@pytest.mark.parametrize(("behaviour", "validator"), [("ranged", TAG), ("dated", OLD_DATE)])
def test_resume_sends_only_the_rest(server, path, part, behaviour, validator):
    leave(part, BODY[:HALF], server.at(behaviour), validator)
    fetch(server.at(behaviour), path, sha256=SUM.upper())
    assert path.read_bytes() == BODY
    (seen,) = server.seen
    assert (seen.range, seen.only, seen.sent) == (f"bytes={HALF}-", validator, len(BODY) - HALF)
    assert files(path) == ["day.csv"]


@pytest.mark.parametrize(
    "behaviour", ["plain", "other_tag", "other_date", "without_tag", "other_total", "wrong_place", "compliant"]
)
def test_part_is_never_put_before_what_may_be_another_version(server, path, part, behaviour):
    leave(part, b"x" * HALF, server.at(behaviour))
    fetch(server.at(behaviour), path, retries=0)
    assert path.read_bytes() == BODY
    assert server.seen[0].range == f"bytes={HALF}-"


@pytest.mark.parametrize("lacks", ["note", "validator", "address", "whole note"])
def test_part_of_an_unknown_version_is_begun_anew(server, path, part, lacks):
    other = "http://127.0.0.1/day.csv" if lacks == "address" else server.at("ranged")
    leave(part, b"x" * HALF, other, None if lacks == "validator" else TAG)
    if lacks == "note":
        note_of(part).unlink()
    elif lacks == "whole note":
        note_of(part).write_bytes(note_of(part).read_bytes()[:-9])
    fetch(server.at("ranged"), path, retries=0)
    assert path.read_bytes() == BODY
    assert [one.range for one in server.seen] == [None]


@pytest.mark.parametrize("behaviour", ["weak", "young"])
def test_what_two_versions_may_have_in_common_continues_nothing(server, path, behaviour, monkeypatch):
    """A weak ETag, and a date of the second in which the file was sent."""
    headers = {"ETag": f"W/{TAG}"} if behaviour == "weak" else {"Last_Modified": formatdate(time.time() + 5)}
    monkeypatch.setattr(Handler, "breaks", lambda self, *_: self.answer(200, BODY[:HALF], len(BODY), **headers))
    with pytest.raises(DataError):
        fetch(server.at("breaks"), path, retries=1)
    assert [one.range for one in server.seen] == [None, None]


@pytest.mark.parametrize("held", [None, 0, HALF // 2])
def test_what_was_not_on_disk_is_fetched_again(server, path, part, held):
    """As after a loss of power: a part is as long as it was, but anything may stand where it was not synced."""
    leave(part, BODY[: HALF // 2] + bytes(HALF), server.at("ranged"))
    noted = read_json(note_of(part))
    write_json(note_of(part), {**noted, "held": held} if held is not None else {"url": noted["url"]})
    fetch(server.at("ranged"), path)
    assert path.read_bytes() == BODY
    assert [one.range for one in server.seen] == [f"bytes={held}-" if held else None]


def test_what_has_come_is_put_on_disk_from_time_to_time(server, path, monkeypatch):
    """Else all of a long download would be lost with the power, or by a kill."""
    monkeypatch.setattr(fetching, "HELD_BYTES", 1)
    hold, held = fetching._hold, []

    def holds(file, note):
        hold(file, note)
        held.append(read_json(note)["held"])
        if held[-1] == HALF:
            server.stop.set()

    monkeypatch.setattr(fetching, "_hold", holds)
    fetch(server.at("halves"), path)
    assert path.read_bytes() == BODY
    assert {HALF, len(BODY)} <= set(held)


def test_complete_part_is_only_checked(server, path, part):
    leave(part, BODY, server.at("ranged"))
    fetch(server.at("ranged"), path, sha256=SUM)
    assert path.read_bytes() == BODY
    assert server.seen == []
    assert files(path) == ["day.csv"]


def test_too_long_part_is_replaced(server, path, part):
    leave(part, BODY + b"more", server.at("ranged"))
    fetch(server.at("ranged"), path, retries=0)
    assert path.read_bytes() == BODY
    assert [one.range for one in server.seen] == [f"bytes={len(BODY) + 4}-", None]


@pytest.mark.parametrize("behaviour", ["breaks_once", "chunks_break_once"])
def test_broken_connection_is_continued(server, path, pauses, behaviour):
    fetch(server.at(behaviour), path, sha256=SUM)
    assert path.read_bytes() == BODY
    assert [one.range for one in server.seen] == [None, f"bytes={HALF}-"]
    assert pauses == [fetching.BACKOFF]


def test_silent_and_closed_connections_are_retried(server, path, monkeypatch):
    monkeypatch.setattr(fetching, "TIMEOUT", 0.2)
    for behaviour in ("silent_once", "closes_once"):
        server.seen.clear()
        fetch(server.at(behaviour), path.with_name(behaviour), sha256=SUM)
        assert len(server.seen) == 2


def test_server_errors_are_retried_with_growing_pauses(server, path, pauses):
    fetch(server.at("fails_twice"), path, sha256=SUM)
    assert path.read_bytes() == BODY
    assert pauses == [fetching.BACKOFF, 2 * fetching.BACKOFF]


def test_retries_end(server, path, pauses):
    with pytest.raises(DataError, match=r"day\.csv: .*failed 3 times.*503.*run again"):
        fetch(server.at("fails"), path, retries=2)
    assert (len(server.seen), len(pauses)) == (3, 2)
    assert files(path) == []


def test_part_outlives_failure(server, path):
    with pytest.raises(DataError, match=f"ended after {HALF} of {len(BODY)} bytes"):
        fetch(server.at("breaks"), path, retries=0)
    assert files(path) == ["day.csv.part", "day.csv.part.json"]
    server.whole = True
    fetch(server.at("breaks"), path, sha256=SUM)
    assert server.seen[-1].sent == len(BODY) - HALF
    assert files(path) == ["day.csv"]


def test_unreachable_server(server, path):
    server.shutdown()
    server.server_close()
    with pytest.raises(DataError, match=r"failed 2 times.*refused"):
        fetch(server.at("plain"), path, retries=1)


def test_refusal_is_final(server, path, pauses):
    with pytest.raises(DataError, match=r"day\.csv: .*absent\.csv answered 404 Not Found; correct its url"):
        fetch(server.at("absent"), path)
    assert (len(server.seen), pauses, files(path)) == (1, [], [])


@pytest.mark.parametrize("url", ["day.csv", "http://127.0.0.1/a day.csv"])
def test_unusable_address(path, pauses, url):
    with pytest.raises(DataError, match="not a usable address"):
        fetch(url, path)
    assert (pauses, files(path)) == ([], [])


@pytest.mark.parametrize("behaviour", ["empty", "nothing"])
@pytest.mark.parametrize("sha256", [None, hashlib.sha256(b"").hexdigest()])
def test_an_empty_answer_is_no_recording(server, path, behaviour, sha256):
    """Also where its sum is known: nobody meant it, and a connection that is cut at once looks the same."""
    with pytest.raises(DataError, match=r"day\.csv: .*(sent nothing|does not say how long it is)"):
        fetch(server.at(behaviour), path, sha256=sha256, retries=1)
    assert files(path) == []


@pytest.mark.parametrize(
    ("behaviour", "match"),
    [
        ("partial", "answered 206 to a request for the whole file"),
        ("other_status", "answered 203 to a request for the whole file"),
        ("until_closed", "does not say how long it is, .* give its sha256"),
        ("packed", r"packed \(gzip\)"),
    ],
)
def test_what_cannot_be_judged_is_refused(server, path, tmp_path, pauses, behaviour, match):
    with pytest.raises(DataError, match=match):
        fetch(server.at(behaviour), path, sums=tmp_path / "sums.txt", read=read)
    assert (files(path), pauses, (tmp_path / "sums.txt").exists()) == ([], [], False)


def test_a_known_sum_judges_what_has_no_length(server, path):
    half = hashlib.sha256(BODY[:HALF]).hexdigest()
    assert fetch(server.at("until_closed"), path, sha256=half) == half
    with pytest.raises(DataError, match="expected SHA-256"):
        fetch(server.at("until_closed"), path.with_name("other.csv"), sha256=SUM)


def test_a_packed_file_that_is_asked_for_stays_packed(server, path):
    """Servers name the packing of a .gz as if it were the connection's."""
    path = path.with_name("day.csv.gz")
    fetch(server.at("packed"), path, read=read)
    assert gzip.decompress(path.read_bytes()) == ROWS


def test_a_page_to_log_in_is_no_recording(server, path, tmp_path):
    sums = tmp_path / "sums.txt"
    with pytest.raises(
        DataError, match=r"day\.csv: what .*login\.csv sends is not .*day\.csv: no usable row.*a page to log in"
    ):
        fetch(server.at("login"), path, sums=sums, read=read)
    assert (files(path), sums.exists()) == ([], False)
    fetch(server.at("rows"), path, sums=sums, read=read)
    assert sums.read_text().split() == [hashlib.sha256(ROWS).hexdigest(), "site/day.csv"]


def test_a_known_sum_says_more_than_reading(server, path):
    def unread(path):
        raise AssertionError(path)

    fetch(server.at("plain"), path, sha256=SUM, read=unread)
    assert path.read_bytes() == BODY


@pytest.mark.parametrize("status", [429, 503, 500])
@pytest.mark.parametrize(
    ("after", "pause"),
    [("7", 7), ("0", 0), ("soon", 1), ("-5", 1), ("an hour", None), ("9" * 5000, None),
     ("Mon, 01 Jan 2001 00:00:00 GMT", 0), ("Mon, 99 Foo 99999999999 00:00:00 GMT", 1)],
)  # fmt: skip
def test_a_server_names_its_own_delay(server, path, pauses, status, after, pause):
    server.status = status
    server.after = formatdate(time.time() + 3700) if after == "an hour" else after  # of when it runs, not of collection
    if pause is None:
        with pytest.raises(DataError, match=rf"{status}.*asks to be left alone for (3\d{{3}}|inf) s; run again then"):
            fetch(server.at("busy_once"), path)
        assert (len(server.seen), pauses) == (1, [])
    else:
        fetch(server.at("busy_once"), path)
        assert (path.read_bytes() == BODY, pauses) == (True, [pause])


def test_wrong_sum_leaves_nothing(server, path, tmp_path):
    with pytest.raises(DataError) as caught:
        fetch(server.at("plain"), path, sha256="0" * 64)
    for word in (
        str(path),
        "0" * 64,
        SUM,
        "discarded",
        "run again",
        "correct its sha256 in the dataset file",
    ):
        assert word in str(caught.value)
    assert files(path) == []
    sums = tmp_path / "sums.txt"
    sums.write_text(f"{'1' * 64}  site/day.csv\n")
    with pytest.raises(DataError, match=r"discarded.*delete the line of site/day\.csv in .*sums\.txt"):
        fetch(server.at("plain"), path, sums=sums)
    assert files(path) == []
    assert sums.read_text() == f"{'1' * 64}  site/day.csv\n"


def test_second_process_keeps_off(server, path, part):
    part.write_bytes(BODY[:10])
    with open(part, "ab") as other:
        fcntl.flock(other, fcntl.LOCK_EX)
        with pytest.raises(DataError, match="another process"):
            fetch(server.at("plain"), path)
    assert (part.read_bytes(), server.seen) == (BODY[:10], [])


def test_first_use_is_recorded_and_a_change_found(server, path, tmp_path):
    sums = tmp_path / "state" / "sums.txt"
    fetch(server.at("plain"), path, sums=sums)
    assert sums.read_text() == f"{SUM}  ../site/day.csv\n"
    assert fetching.check_sum(path, sums=sums) == SUM
    path.write_bytes(BODY + b"\n")
    found = hashlib.sha256(BODY + b"\n").hexdigest()
    with pytest.raises(DataError) as caught:
        fetching.check_sum(path, sums=sums)
    for word in (str(path), SUM, found, f"delete {path}", f"delete the line of ../site/day.csv in {sums}"):
        assert word in str(caught.value)
    assert sums.read_text() == f"{SUM}  ../site/day.csv\n"


def test_given_sum_goes_before_the_record(path, part, tmp_path):
    path.write_bytes(BODY)
    sums = tmp_path / "sums.txt"
    fetching.check_sum(path, "day", sha256=SUM, sums=sums)
    assert not sums.exists()
    with pytest.raises(DataError, match="correct its sha256"):
        fetching.check_sum(path, "day", sha256="0" * 64, sums=sums)


def test_record_keeps_other_lines_and_sha256sum_reads_it(path, part, tmp_path):
    path.write_bytes(BODY)
    sums = tmp_path / "sums.txt"
    sums.write_text(f"{SUM.upper()} *by hand\n\n{'a' * 64}  other")
    for name in ("by hand", "site/day.csv"):
        fetching.record_sum(fetching.check_sum(path, name, sums=sums), name, sums)
    assert sums.read_text() == f"{SUM.upper()} *by hand\n\n{'a' * 64}  other\n{SUM}  site/day.csv\n"


def test_damaged_record_names_the_line(path, part, tmp_path):
    path.write_bytes(BODY)
    sums = tmp_path / "sums.txt"
    sums.write_text(f"{SUM}  a\nabc  site/day.csv\n")
    with pytest.raises(DataError, match=r"sums\.txt, line 2: 'abc  site/day\.csv'"):
        fetching.check_sum(path, sums=sums)


def test_known_sum_needs_no_writable_folder(path, part, tmp_path):
    path.write_bytes(BODY)
    fetching.record_sum(SUM, "site/day.csv", tmp_path / "sums.txt")
    (tmp_path / ".sums.txt.lock").unlink()
    fetching.record_sum(SUM, "site/day.csv", tmp_path / "sums.txt")
    assert not (tmp_path / ".sums.txt.lock").exists()


def test_recording_from_several_processes_keeps_all_lines(tmp_path):
    program = (
        "import sys; from modlhmp.study.fetch import record_sum\n"
        "print('ready', flush=True); sys.stdin.readline()\n"
        "for i in range(40): record_sum('0' * 64, f'{sys.argv[1]}/{i}', 'sums.txt')"
    )
    workers = [
        subprocess.Popen(
            [sys.executable, "-c", program, str(i)],
            cwd=tmp_path,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
        )
        for i in range(4)
    ]
    for worker in workers:
        assert worker.stdout.readline() == "ready\n"
    for worker in workers:
        worker.stdin.write("go\n")
        worker.stdin.flush()
    for worker in workers:
        worker.communicate(timeout=20)
        assert worker.returncode == 0
    lines = (tmp_path / "sums.txt").read_text().splitlines()
    assert sorted(lines) == sorted(f"{'0' * 64}  {i}/{k}" for i in range(4) for k in range(40))


def test_missing_message(path):
    text = fetching.missing_message("day.csv", path, "https://example.org/data", "Forum")
    for word in (
        "Forum",
        "https://example.org/data",
        "day.csv",
        str(path.parent),
        ".gz",
        ".bz2",
        ".zip",
        "MODLHMP_DATA",
        "data_root",
    ):
        assert word in text


def test_a_folder_that_cannot_be_written_to_is_named(tmp_path):
    """Here a file stands where the folder should be: nobody who runs tests as root is refused otherwise."""
    (tmp_path / "data").write_text("")
    with pytest.raises(DataError, match=r"day\.csv\.part: the folder cannot be written to \(.*\); .* data_root"):
        fetch("http://127.0.0.1:9/day.csv", tmp_path / "data/day.csv")
