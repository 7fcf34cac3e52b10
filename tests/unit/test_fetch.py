"""Downloads from a local server that resumes, breaks off, fails and lies; sums recorded and checked."""

import fcntl
import hashlib
import os
import random
import re
import subprocess
import sys
import threading
from functools import partial
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from types import SimpleNamespace

import pytest

from modlhmp.storage import DataError
from modlhmp.study import fetch as fetching

BODY = random.Random(5).randbytes(300_000)
SUM = hashlib.sha256(BODY).hexdigest()
HALF = len(BODY) // 2
OLD_DATE, NEW_DATE = "Mon, 01 Jan 2001 00:00:00 GMT", "Fri, 01 Jan 2100 00:00:00 GMT"
fetch = partial(fetching.fetch, progress=False)


class Handler(BaseHTTPRequestHandler):
    """The first word of the address says how the server behaves; each request is noted in `server.seen`."""

    def do_GET(self):
        asked = self.headers.get("Range")
        self.server.seen.append(SimpleNamespace(range=asked, sent=0))
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

    def ranged(self, asked, _, **headers):
        start = int(re.fullmatch(r"bytes=(\d+)-", asked)[1]) if asked else 0
        if start >= len(BODY):
            self.answer(416, Content_Range=f"bytes */{len(BODY)}")
        elif asked:
            span = f"bytes {start}-{len(BODY) - 1}/{len(BODY)}"
            self.answer(206, BODY[start:], Content_Range=span, **headers)
        else:
            self.answer(200, BODY, **headers)

    def dated(self, asked, nth):
        self.ranged(asked, nth, Last_Modified=OLD_DATE)

    def changed(self, asked, nth):
        self.ranged(asked, nth, Last_Modified=NEW_DATE)

    def plain(self, *_):
        self.answer(200, BODY)

    def breaks_once(self, asked, nth):
        if nth == 1:
            self.answer(200, BODY[:HALF], length=len(BODY))
        else:
            self.ranged(asked, nth)

    def breaks(self, *_):
        self.answer(200, BODY[:HALF], length=len(BODY))

    def chunks_break_once(self, asked, nth):
        if nth > 1:
            return self.ranged(asked, nth)
        self.protocol_version = "HTTP/1.1"
        self.close_connection = True
        self.send_response(200)
        self.send_header("Transfer-Encoding", "chunked")
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


@pytest.fixture
def server():
    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    server.seen, server.stop = [], threading.Event()
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


@pytest.mark.parametrize("behaviour", ["ranged", "dated"])
def test_resume_sends_only_the_rest(server, path, part, behaviour):
    part.write_bytes(BODY[:HALF])
    fetch(server.at(behaviour), path, sha256=SUM.upper())
    assert path.read_bytes() == BODY
    assert [(one.range, one.sent) for one in server.seen] == [(f"bytes={HALF}-", len(BODY) - HALF)]
    assert files(path) == ["day.csv"]


@pytest.mark.parametrize("behaviour", ["plain", "changed", "wrong_place"])
def test_part_that_the_server_does_not_continue_is_replaced(server, path, part, behaviour):
    part.write_bytes(b"x" * HALF)
    fetch(server.at(behaviour), path, retries=0)
    assert path.read_bytes() == BODY
    assert server.seen[0].range == f"bytes={HALF}-"


def test_complete_part_is_only_checked(server, path, part):
    part.write_bytes(BODY)
    fetch(server.at("ranged"), path, sha256=SUM)
    assert path.read_bytes() == BODY
    assert [one.sent for one in server.seen] == [0]


def test_too_long_part_is_replaced(server, path, part):
    part.write_bytes(BODY + b"more")
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
    assert files(path) == ["day.csv.part"]
    fetch(server.at("ranged"), path, sha256=SUM)
    assert server.seen[-1].sent == len(BODY) - HALF


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


def test_empty_file(server, path):
    assert fetch(server.at("empty"), path) == hashlib.sha256(b"").hexdigest()


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
    fetching.check_sum(path, "by hand", sums=sums)
    fetching.check_sum(path, "site/day.csv", sums=sums)
    assert sums.read_text() == f"{SUM.upper()} *by hand\n\n{'a' * 64}  other\n{SUM}  site/day.csv\n"


def test_damaged_record_names_the_line(path, part, tmp_path):
    path.write_bytes(BODY)
    sums = tmp_path / "sums.txt"
    sums.write_text(f"{SUM}  a\nabc  site/day.csv\n")
    with pytest.raises(DataError, match=r"sums\.txt, line 2: 'abc  site/day\.csv'"):
        fetching.check_sum(path, sums=sums)


def test_known_sum_needs_no_writable_folder(path, part, tmp_path):
    path.write_bytes(BODY)
    fetching.check_sum(path, sums=tmp_path / "sums.txt")
    (tmp_path / ".sums.txt.lock").unlink()
    fetching.check_sum(path, sums=tmp_path / "sums.txt")
    assert not (tmp_path / ".sums.txt.lock").exists()


def test_recording_from_several_processes_keeps_all_lines(tmp_path):
    (tmp_path / "day.csv").write_bytes(BODY[:100])
    program = (
        "import sys; from modlhmp.study.fetch import check_sum\n"
        "print('ready', flush=True); sys.stdin.readline()\n"
        "for i in range(40): check_sum('day.csv', f'{sys.argv[1]}/{i}', sums='sums.txt')"
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
    expected = hashlib.sha256(BODY[:100]).hexdigest()
    assert sorted(lines) == sorted(f"{expected}  {i}/{k}" for i in range(4) for k in range(40))


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
