# SPDX-License-Identifier: MIT
"""`dahl data` finds measured sets, downloads them and checks their sha256. The server is on this
machine.
"""

import hashlib
import json
import re
import threading
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
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
def server(monkeypatch, tmp_path) -> Iterator[Path]:
    """A web server on this machine; yields the folder of its files."""
    (folder := tmp_path / "served").mkdir()
    monkeypatch.setattr(SimpleHTTPRequestHandler, "log_message", lambda *_: None)
    served = partial(SimpleHTTPRequestHandler, directory=folder)
    with ThreadingHTTPServer(("127.0.0.1", 0), served) as running:
        threading.Thread(target=running.serve_forever, args=(0.02,), daemon=True).start()
        port = running.server_port
        monkeypatch.setenv("DAHL_DATA_URL", f"http://127.0.0.1:{port}/{{repo}}/{{commit}}/{{path}}")
        monkeypatch.setenv("NO_PROXY", "127.0.0.1")
        yield folder
        running.shutdown()


def expected(monkeypatch, name: str, content: bytes) -> list[str]:
    """Set the pinned sums of a set to those of `content`; returns the paths on the server."""
    known = data.SETS[name]
    right = hashlib.sha256(content).hexdigest()
    files = tuple(replace(file, sha256=right) for file in known.files)
    monkeypatch.setitem(data.SETS, name, replace(known, files=files))
    return [f"{known.repo}/{known.commit}/{file.path}" for file in files]


def serve(server: Path, path: str, content: bytes) -> None:
    (server / path).parent.mkdir(parents=True, exist_ok=True)
    (server / path).write_bytes(content)


def got(dahl, name: str) -> Path:
    done = dahl("data", name)
    assert done.returncode == 0, done.stderr
    return Path(done.stdout.removesuffix("\n"))


@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_a_download_is_cut_checked_and_cached(alone, server, dahl, monkeypatch, end):
    (path,) = expected(monkeypatch, "tribometer", CUT)
    serve(server, path, upstream(end))
    folder = got(dahl, "tribometer")
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == {"reciprocating.tsv": CUT}
    (server / path).unlink()
    assert got(dahl, "tribometer") == folder  # from the cache, without the server
    (folder / "reciprocating.tsv").unlink()
    code, line = complaint(dahl("data", "tribometer"))
    assert code == 1 and f"{path} " in line


@pytest.mark.parametrize(
    "content", [upstream().replace(b"8.605", b"8.606"), b"<html>\nno number\n"]
)
def test_a_file_with_another_sum_is_refused(alone, server, dahl, monkeypatch, content):
    (path,) = expected(monkeypatch, "tribometer", CUT)
    serve(server, path, content)
    code, line = complaint(dahl("data", "tribometer"))
    assert code == 1 and f"{path}: " in line
    is_cut = content.startswith(HEADER.encode())
    right = hashlib.sha256(CUT).hexdigest()
    assert bool(re.search(f"sha256 .*reciprocating.tsv.*{right}", line)) is is_cut
    assert not [*Path("cache").rglob("*.tsv")]
    (entry,) = (one for one in json.loads(dahl("data", "--json").stdout) if "trib" in one["name"])
    assert entry["folder"] is None


def test_each_file_of_a_set_is_checked(alone, server, dahl, monkeypatch):
    *others, last = expected(monkeypatch, "friction_damper", b"right")
    for path in others:
        serve(server, path, b"right")
    serve(server, last, b"wrong")
    code, line = complaint(dahl("data", "friction_damper"))
    assert code == 1 and last.replace(" ", "%20") in line
    for path in others:  # the files that were right are not fetched again
        (server / path).unlink()
    serve(server, last, b"right")
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
        text = f"[motion]\nkind = log\nfile = {log}\nangle = a\ncounts_per_unit = 1\n"
        Path("x.ini").write_text(text)
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
