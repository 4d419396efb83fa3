# SPDX-License-Identifier: MIT
"""`dahl data` finds measured sets, downloads them and checks their sha256. The server is on this
machine.
"""

from __future__ import annotations

import hashlib
import http.server
import json
import re
import threading
from dataclasses import replace
from pathlib import Path

import pytest
from dahl.io import data  # the pinned sums and the checkout's folder: see `alone` and `expected`
from identify_tools import complaint

ROWS = [(8.595, 1), (8.6, 2), (8.605, 3), (128.995, 4), (129, 5), (130, 6)]
HEADER = "Time [s]\tNormal [uN]\tPosition [mm]\tFriction [uN]"
CUT = "\n".join([HEADER, "8.6\t1\t2\t2", "8.605\t1\t2\t3", "128.995\t1\t2\t4", ""]).encode()


def upstream(end: str = "\n") -> bytes:
    return end.join([HEADER, *(f"{t:g}\t1\t2\t{n}" for t, n in ROWS), ""]).encode()


@pytest.fixture
def alone(dahl, monkeypatch, tmp_path) -> Path:
    """A machine without measured sets and with its own cache. Returns the folder of sets next to
    its project.
    """
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr(data.paths, "ROOT", tmp_path / "elsewhere" / "project")
    monkeypatch.delenv("DAHL_DATA", raising=False)
    return tmp_path / "elsewhere" / "shared" / "data"


@pytest.fixture
def server(monkeypatch):
    """A web server on this machine; yields its files {path: bytes}."""
    files: dict[str, bytes] = {}

    class Handler(http.server.BaseHTTPRequestHandler):
        def do_GET(self) -> None:  # noqa: N802 (http.server's name)
            content = files.get(self.path)
            self.send_response(200 if content is not None else 404)
            self.send_header("Content-Length", str(len(content or b"")))
            self.end_headers()
            self.wfile.write(content or b"")

        def log_message(self, *_: object) -> None:
            """Quiet."""

    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler) as running:
        threading.Thread(target=running.serve_forever, args=(0.02,), daemon=True).start()
        monkeypatch.setenv(
            "DAHL_DATA_URL", f"http://127.0.0.1:{running.server_port}/{{repo}}/{{commit}}/{{path}}"
        )
        monkeypatch.setenv("NO_PROXY", "127.0.0.1")
        yield files
        running.shutdown()


def expected(monkeypatch, name: str, content: bytes) -> list[str]:
    """Set the pinned sums of a set to those of `content`; returns the addresses on the server."""
    known = data.SETS[name]
    right = hashlib.sha256(content).hexdigest()
    files = tuple(replace(file, sha256=right) for file in known.files)
    monkeypatch.setitem(data.SETS, name, replace(known, files=files))
    places = (file.path.replace(" ", "%20") for file in files)
    return [f"/{known.repo}/{known.commit}/{place}" for place in places]


def got(dahl, name: str) -> Path:
    done = dahl("data", name)
    assert done.returncode == 0, done.stderr
    return Path(done.stdout.removesuffix("\n"))


@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_a_download_is_cut_checked_and_cached(alone, server, dahl, monkeypatch, end):
    (address,) = expected(monkeypatch, "tribometer", CUT)
    server[address] = upstream(end)
    folder = got(dahl, "tribometer")
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == {"reciprocating.tsv": CUT}
    server.clear()
    assert got(dahl, "tribometer") == folder  # from the cache, without the server
    (folder / "reciprocating.tsv").unlink()
    code, line = complaint(dahl("data", "tribometer"))
    assert code == 1 and address in line


@pytest.mark.parametrize(
    ("content", "wanted", "words"),
    [
        (upstream().replace(b"8.605", b"8.606"), CUT, "sha256 .*reciprocating.tsv.*{sum}"),
        (b"<html>sorry</html>\nnot a number\n", b"", "{address}: "),
        (None, CUT, "{address} "),
    ],
    ids=["changed", "another", "absent"],
)
def test_a_file_with_another_sum_is_refused(
    alone, server, dahl, monkeypatch, content, wanted, words
):
    (address,) = expected(monkeypatch, "tribometer", wanted)
    server |= {} if content is None else {address: content}
    right = hashlib.sha256(wanted).hexdigest()
    code, line = complaint(dahl("data", "tribometer"))
    assert code == 1 and re.search(words.format(sum=right, address=address), line)
    assert not [*Path("cache").rglob("*.tsv")]
    (entry,) = (one for one in json.loads(dahl("data", "--json").stdout) if "trib" in one["name"])
    assert entry["folder"] is None


def test_each_file_of_a_set_is_checked(alone, server, dahl, monkeypatch):
    *others, last = expected(monkeypatch, "friction_damper", b"right")
    server |= {**dict.fromkeys(others, b"right"), last: b"wrong"}
    code, line = complaint(dahl("data", "friction_damper"))
    assert code == 1 and last in line
    server.clear()  # the files that were right are not fetched again
    server[last] = b"right"
    files = {path.name: path.read_bytes() for path in got(dahl, "friction_damper").iterdir()}
    assert files == {file.name: b"right" for file in data.SETS["friction_damper"].files}


def test_a_derived_set_cannot_be_downloaded(alone, dahl, monkeypatch):
    code, line = complaint(dahl("data", "cycloidal"))
    assert code == 2 and "cycloidal" in line and "DAHL_DATA" in line
    monkeypatch.setenv("DAHL_DATA", "/nowhere")
    assert "/nowhere (DAHL_DATA)" in complaint(dahl("data", "cycloidal"))[1]
    code, line = complaint(dahl("data", "tribo"))
    assert code == 2 and "'tribo'" in line and "tribometer" in line


def test_dahl_data_is_searched_before_the_folder_of_the_project(alone, dahl, monkeypatch, tmp_path):
    given, beside = tmp_path / "mine" / "cycloidal", alone / "cycloidal"
    given.mkdir(parents=True)
    beside.mkdir(parents=True)
    monkeypatch.setenv("DAHL_DATA", str(given.parent))
    assert got(dahl, "cycloidal") == given
    given.rmdir()
    assert got(dahl, "cycloidal") == beside
    (beside / "log.csv").write_text("a\n1\nx\n")
    for log, place in (
        ("cycloidal/log.csv", f"{beside / 'log.csv'}:3: "),
        ("cycloidal/none.csv", f"{beside / 'none.csv'}: no such file in the measured set"),
        ("mine.csv", "mine.csv: "),
    ):
        Path("x.ini").write_text(f"[motion]\nkind = log\nfile = {log}\nangle = a\n")
        code, line = complaint(dahl("demo", "--scene", "x.ini", "-o", "out"))
        assert code == 2 and line.startswith(place)


@pytest.mark.parametrize("name", [name for name, known in data.SETS.items() if known.files])
def test_files_in_reach_have_the_stated_sha256(measured_file, name):
    for file in data.SETS[name].files:
        content = measured_file(name, file.name).read_bytes()
        assert hashlib.sha256(content).hexdigest() == file.sha256


def test_the_list_and_the_json_have_the_source_of_each_set(alone, dahl, monkeypatch):
    for name in ("servo_pendulum", "cycloidal"):
        (alone / name).mkdir(parents=True)
    listed = dahl("data").stdout.split("\n")
    folders = {name: str(alone / name) for name in ("servo_pendulum", "cycloidal")}
    assert (sets := json.loads(dahl("data", "--json").stdout)) == [
        {
            "name": name,
            "what": known.what,
            "licence": known.licence,
            "folder": folders.get(name),
            "download": known.repo if known.commit else None,
        }
        for name, known in data.SETS.items()
    ]
    for n, known in enumerate(sets):
        name, what, where = (line.strip() for line in listed[3 * n : 3 * n + 3])
        assert (name, what) == (known["name"], f"{known['what']} ({known['licence']})")
        assert where.endswith(known["folder"] or known["download"] or "no download exists")
    assert {bool(known.commit) for known in data.SETS.values()} == {True, False}
    said = {"name": "servo_pendulum", "folder": folders["servo_pendulum"]}
    assert json.loads(dahl("data", "servo_pendulum", "--json").stdout) == said
