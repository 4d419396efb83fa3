# SPDX-License-Identifier: MIT
"""Measured sets: found where they are, fetched with their sha256 proved, refused otherwise. No
network but our own.
"""

from __future__ import annotations

import hashlib
import http.server
import json
import threading
from dataclasses import replace

import pytest
from dahl import Error, RunError, cli, data

ROWS = [(8.595, 1), (8.6, 2), (8.605, 3), (128.995, 4), (129, 5), (130, 6)]
HEADER = "Time [s]\tNormal [uN]\tPosition [mm]\tFriction [uN]"


def upstream(end: str = "\n") -> bytes:
    """A small file of the tribometer's form."""
    return end.join([HEADER, *(f"{t:g}\t1\t2\t{n}" for t, n in ROWS), ""]).encode()


@pytest.fixture
def alone(monkeypatch, tmp_path):
    """A machine without any measured set, with a cache of its own."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr(data.paths, "ROOT", tmp_path / "elsewhere" / "project")
    monkeypatch.delenv("DAHL_DATA", raising=False)
    return tmp_path


@pytest.fixture
def server(monkeypatch):
    """A web server on this machine that gives what it is told to; yields the dictionary {path:
    bytes}.
    """
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
        threading.Thread(target=running.serve_forever, daemon=True).start()
        monkeypatch.setenv(
            "DAHL_DATA_URL", f"http://127.0.0.1:{running.server_port}/{{repo}}/{{commit}}/{{path}}"
        )
        monkeypatch.setenv("NO_PROXY", "127.0.0.1")
        yield files
        running.shutdown()


def small_tribometer(monkeypatch, content: bytes) -> str:
    """Expect `content` of the set tribometer; returns its address on the server."""
    known = data.SETS["tribometer"]
    file = replace(known.files[0], sha256=hashlib.sha256(content).hexdigest())
    monkeypatch.setitem(data.SETS, "tribometer", replace(known, files=(file,)))
    return f"/{known.repo}/{known.commit}/{file.path}"


@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_the_cut_keeps_header_and_rows(end):
    kept = data.cut_tribometer(upstream(end)).decode()
    assert kept == "\n".join([HEADER, "8.6\t1\t2\t2", "8.605\t1\t2\t3", "128.995\t1\t2\t4", ""])


def test_download_cuts_and_proves_and_keeps(alone, server, monkeypatch):
    address = small_tribometer(monkeypatch, data.cut_tribometer(upstream()))
    server[address] = upstream()
    folder = data.folder("tribometer")
    assert (folder / "reciprocating.tsv").read_bytes() == data.cut_tribometer(upstream())
    assert [path.name for path in folder.iterdir()] == ["reciprocating.tsv"]
    server.clear()
    assert data.folder("tribometer") == folder  # from the cache, without the server
    (folder / "reciprocating.tsv").unlink()
    with pytest.raises(RunError, match="cannot be fetched"):  # a folder is not yet its files
        data.folder("tribometer")


def test_a_changed_file_is_refused(alone, server, monkeypatch):
    address = small_tribometer(monkeypatch, data.cut_tribometer(upstream()))
    server[address] = upstream().replace(b"8.605", b"8.606")
    with pytest.raises(RunError, match="sha256 of reciprocating.tsv is"):
        data.folder("tribometer")
    assert data.local_folder("tribometer") is None


def test_another_file_is_refused(alone, server, monkeypatch):
    address = small_tribometer(monkeypatch, b"")
    server[address] = b"<html>sorry</html>\nnot a number\n"
    with pytest.raises(RunError, match="not the file that was expected"):
        data.folder("tribometer")


def test_files_used_as_they_are_have_their_sha256_proved(alone, server, monkeypatch):
    known, right = data.SETS["pneumatic"], hashlib.sha256(b"right").hexdigest()
    files = tuple(replace(file, sha256=right) for file in known.files)
    monkeypatch.setitem(data.SETS, "pneumatic", replace(known, files=files))
    addresses = [f"/{known.repo}/{known.commit}/{file.path}" for file in files]
    server |= dict.fromkeys(addresses, b"wrong")
    with pytest.raises(RunError, match="hash"):
        data.folder("pneumatic")
    server |= dict.fromkeys(addresses, b"right")
    folder = data.folder("pneumatic")
    assert [(folder / file.name).read_bytes() for file in files] == [b"right"] * 3


def test_absent_upstream_or_no_network(alone, server):
    with pytest.raises(RunError, match="cannot be fetched"):
        data.folder("tribometer")


def test_what_is_derived_is_not_downloaded(alone):
    with pytest.raises(Error, match="derived from .* cannot be downloaded; point DAHL_DATA"):
        data.folder("cycloidal")


def test_a_folder_that_was_given_and_has_it_not_is_named(alone, monkeypatch):
    monkeypatch.setenv("DAHL_DATA", "/nowhere")
    with pytest.raises(Error, match=r"cannot be downloaded.*; /nowhere \(DAHL_DATA\) has no cyc"):
        data.folder("cycloidal")


def test_a_folder_given_comes_first(alone, monkeypatch):
    (alone / "mine" / "cycloidal").mkdir(parents=True)
    monkeypatch.setenv("DAHL_DATA", str(alone / "mine"))
    (alone / "elsewhere" / "shared" / "data" / "cycloidal").mkdir(parents=True)
    assert data.folder("cycloidal") == alone / "mine" / "cycloidal"
    monkeypatch.delenv("DAHL_DATA")
    beside = alone / "elsewhere" / "shared" / "data" / "cycloidal"
    assert data.folder("cycloidal") == beside
    (beside / "log.csv").write_text("a\n")
    assert data.find_log("cycloidal/log.csv", alone) == beside / "log.csv"
    with pytest.raises(Error, match="none.csv: no such file in the measured set 'cycloidal'"):
        data.find_log("cycloidal/none.csv", alone)


def test_unknown_set_and_missing_file(alone, monkeypatch):
    with pytest.raises(Error, match="no measured set 'tribo' .*tribometer"):
        data.folder("tribo")
    with pytest.raises(Error, match="no such file"):
        data.find_log("mine.csv", alone)


@pytest.mark.parametrize("name", [name for name, known in data.SETS.items() if known.files])
def test_files_in_reach_have_the_stated_sha256(measured_file, name):
    for file in data.SETS[name].files:
        content = measured_file(name, file.name).read_bytes()
        assert hashlib.sha256(content).hexdigest() == file.sha256


def test_a_list_and_a_program_have_where_each_set_is_or_comes_from(alone, monkeypatch, capsys):
    for name in ("servo_pendulum", "cycloidal"):  # to download, and not
        (alone / "mine" / name).mkdir(parents=True)
    monkeypatch.setenv("DAHL_DATA", str(alone / "mine"))
    assert cli.main(["data"]) == 0
    listed = capsys.readouterr().out.split("\n")
    assert cli.main(["data", "--json"]) == 0
    folders = {name: f"{alone / 'mine' / name}" for name in ("servo_pendulum", "cycloidal")}
    assert (sets := json.loads(capsys.readouterr().out)) == [
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
        assert where.endswith(known["folder"] or known["download"] or "not to be downloaded")
    assert {bool(known.commit) for known in data.SETS.values()} == {True, False}
    assert cli.main(["data", "servo_pendulum", "--json"]) == 0
    said = {"name": "servo_pendulum", "folder": folders["servo_pendulum"]}
    assert json.loads(capsys.readouterr().out) == said
