# SPDX-License-Identifier: MIT
"""Every verb of `dahl` with what it did not hope for: names that are markup, summaries of another
shape, outputs that cannot be written, readers that have gone, terminals without UTF-8. One line
`error: ...`, the right exit code, nothing outside the named place.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys

import numpy as np
import pytest
from identify_tools import FC, dahl_torque, noise_of, sine, write_csv

pytestmark = pytest.mark.usefixtures("library")

SCRIPT = "<script>alert(1)</script>"


def refused(done: subprocess.CompletedProcess, *words: str) -> int:
    """The exit code of a run that ended in one line with these words."""
    assert re.fullmatch(r"error: [^\n]+\n", done.stderr), done.stderr
    assert all(word in done.stderr for word in words), done.stderr
    return done.returncode


@pytest.fixture
def shaft(tmp_path):
    """A quick log of some name, with some names of columns."""

    def write(name: str = "shaft.csv", header: str = "t,angle [deg],torque [Nm]"):
        theta = sine(1, rows=600, cycles=5)
        torque = dahl_torque(theta) + 0.01 * FC * noise_of(1, 600)
        return write_csv(tmp_path / name, theta, torque, header)

    return write


NAMES = ["[deg]x.csv", ":heart:.csv", "x" * 251 + ".csv"]


@pytest.mark.parametrize("name", NAMES)
def test_a_name_that_is_markup_is_shown_as_it_is(shaft, dahl_here, tmp_path, name, monkeypatch):
    monkeypatch.setenv("COLUMNS", "400")
    done = dahl_here("identify", shaft(name), "-o", tmp_path / "[bold]", "--name", "a")
    assert done.returncode == 0, done.stderr
    assert "".join(done.stdout.split()).startswith(name)
    assert f"{tmp_path}/[bold]/a.json" in done.stdout
    each = tmp_path / "[red]each"
    each.mkdir()
    shutil.copy(tmp_path / name, each)
    done = dahl_here("identify", "--each", each, "-o", tmp_path / "out", "--jobs", "1")
    assert done.returncode == 0, done.stderr
    assert f" {name[:200]}" in done.stdout


def test_a_name_cannot_command_the_terminal(shaft, dahl_here):
    done = dahl_here("identify", shaft("a\x1b[2J\nb.csv"), "--no-files")
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("a?[2J")
    assert "\x1b" not in done.stdout


def test_columns_that_are_markup(shaft, dahl_here, tmp_path):
    path = shaft(header="t,angle [/rad],torque [/bold red]")
    names = ("--angle", "angle [/rad]", "--torque", "torque [/bold red]")
    assert dahl_here("identify", path, *names, "--no-files").returncode == 0
    own = ("--sigma0", "100", "--fc", "0.5", "--counts-per-turn", "16384", "--bus", "socketcand")
    done = dahl_here("demo", path, *names, *own, "--seconds", "0.3", "--output", tmp_path / "[x]")
    assert done.returncode == 0, done.stderr
    assert "column 'angle [/rad]'" in done.stdout
    assert f"{tmp_path}/[x]/run.log" in done.stdout


# --- summaries that anyone may have written -------------------------------------------------------


@pytest.fixture(scope="module")
def recorded(tmp_path_factory, library, dahl_loop):
    folder = tmp_path_factory.mktemp("storm")
    words = ["demo", "--scene", "fault-storm", "--seconds", "1", "--output", folder]
    subprocess.run([sys.executable, "-m", "dahl", *words], check=True, capture_output=True)
    return folder


@pytest.fixture
def storm(recorded, tmp_path):
    """A run of the fault storm, with other values in its summary."""

    def change(**values):
        folder = tmp_path / "run"
        shutil.copytree(recorded, folder, dirs_exist_ok=True)
        known = json.loads((folder / "summary.json").read_text())
        (folder / "summary.json").write_text(json.dumps(known | values))
        return folder

    return change


def test_nothing_in_a_summary_becomes_a_part_of_the_page(storm, dahl_here):
    table = {SCRIPT: 1, '"><img src=x>': 2}
    faults = {"injected": table, "expected": {**table, f"{SCRIPT}b": 3}}
    tables = dict.fromkeys(("node", "control", "parameters", "answers_by_state"), table)
    texts = dict.fromkeys(("title", "bus", "time"), SCRIPT)
    folder = storm(**texts, **tables, faults=faults)
    assert dahl_here("report", folder).returncode == 0
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert page.startswith("<!DOCTYPE html>")
    assert "<script" not in page
    assert "<img src=x" not in page
    assert page.count("&lt;script&gt;alert(1)") >= 9


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"[" * 100_000, "not JSON"),
        (b"\xff\xfe", "not a text file (byte 0)"),
        (b'{"scene_file": "x", "n": ' + b"9" * 5000 + b"}", "not JSON"),
        (None, "s a directory"),
    ],
)
def test_a_summary_that_is_no_json_is_one_line(storm, dahl_here, content, words):
    path = storm() / "summary.json"
    path.unlink()
    path.mkdir() if content is None else path.write_bytes(content)
    for verb in ("report", "plot"):
        assert refused(dahl_here(verb, path.parent), "summary.json", words) == 2
    guess = ("excite", "--from", path, "--counts-per-turn", "16384", "-o", path.parent)
    assert refused(dahl_here(*guess), "summary.json", words) == 2


# --- outputs --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("where", "code", "words"),
    [
        (".", 2, "a folder; the name of a file was expected"),
        ("run", 2, "a folder; the name of a file was expected"),
        ("/dev/full", 1, "No space left on device"),
        ("none/x", 1, "No such file or directory"),
        ("x" * 300, 1, "File name too long"),
    ],
)
def test_an_output_that_cannot_be_is_one_line_and_leaves_nothing(
    storm, shaft, dahl_here, tmp_path, monkeypatch, where, code, words
):
    folder, log = storm(), shaft()
    monkeypatch.chdir(tmp_path)
    before = sorted(tmp_path.rglob("*"))
    for verb, option in (("report", "-o"), ("plot", "-o")):
        assert refused(dahl_here(verb, folder, option, where), words) == code
    done = dahl_here("identify", log, "--no-files", "--json", where)
    assert refused(done, words) == code
    assert sorted(tmp_path.rglob("*")) == before


def test_an_output_may_be_a_link_or_a_device(storm, dahl_here, tmp_path):
    """A link keeps pointing where it did; a device is no file to be replaced."""
    (tmp_path / "page.html").symlink_to(tmp_path / "real.html")
    (tmp_path / "real.html").write_text("old")
    os.mkfifo(tmp_path / "pipe")
    reader = subprocess.Popen(["cp", tmp_path / "pipe", tmp_path / "copy"])
    for output in ("page.html", "pipe"):
        assert dahl_here("report", storm(), "-o", tmp_path / output).returncode == 0
    assert (tmp_path / "page.html").is_symlink()
    assert (tmp_path / "real.html").read_text().startswith("<!DOCTYPE html>")
    assert reader.wait(timeout=20) == 0
    assert (tmp_path / "copy").read_text() == (tmp_path / "real.html").read_text()
    assert (tmp_path / "pipe").is_fifo()


def shell(command: str, cwd, **environment: str) -> subprocess.CompletedProcess:
    """A line for the shell, with `dahl` in it."""
    dahl = f'dahl() {{ {sys.executable} -m dahl "$@"; }}; '
    return subprocess.run(
        ["bash", "-c", dahl + command],
        capture_output=True,
        encoding="utf-8",
        errors="replace",
        cwd=cwd,
        timeout=120,
        check=False,
        env={**os.environ, **environment},
    )


@pytest.mark.parametrize(
    ("kept", "words"),
    [
        ("plan.h", "plan --sigma0 1 --fc 1 --theta-per-count 1e-3 --force -o plan.h"),
        ("bus.dbc", "dbc --force -o bus.dbc"),
        (
            "own.ini",
            "demo shaft.csv --angle 'angle [deg]' --sigma0 100 --fc 1 --counts-per-turn 4096"
            " --output .",
        ),
    ],
)
def test_a_disk_that_is_full_leaves_the_old_file(shaft, tmp_path, kept, words):
    shaft()
    (tmp_path / kept).write_text("old")
    done = shell(f"ulimit -f 0; dahl {words}", tmp_path)
    assert refused(done, f"{kept}: File too large") == 1
    assert (tmp_path / kept).read_text() == "old"
    assert not list(tmp_path.glob(".*"))


@pytest.mark.parametrize("buffered", ["", pytest.param("1", marks=pytest.mark.checks)])
@pytest.mark.parametrize("words", ["--help", "data", "report run", "identify --no-files shaft.csv"])
def test_standard_output_that_is_full_or_has_no_reader(storm, shaft, tmp_path, words, buffered):
    storm(), shaft()
    said = shell(f"dahl {words} >/dev/full", tmp_path, PYTHONUNBUFFERED=buffered)
    assert refused(said, "No space left on device") == 1
    gone = shell(
        f"dahl {words} | true; exit ${{PIPESTATUS[0]}}", tmp_path, PYTHONUNBUFFERED=buffered
    )
    assert (gone.returncode, gone.stderr) == (0, "")


@pytest.mark.checks
def test_closed_streams_change_no_exit_code(shaft, tmp_path):
    shaft()
    assert shell("dahl identify --no-files shaft.csv >&-", tmp_path).returncode == 0
    assert shell("dahl identify --no-files shaft.csv 2>&-", tmp_path).returncode == 0
    for stream in ("2>&-", "2>/dev/full", ">&- 2>&-"):
        assert shell(f"dahl identify --no-files none.csv {stream}", tmp_path).returncode == 2


@pytest.mark.parametrize(
    "terminal",
    [
        {"PYTHONUTF8": "0", "LC_ALL": "C", "PYTHONCOERCECLOCALE": "0"},
        pytest.param({"PYTHONIOENCODING": "latin-1"}, marks=pytest.mark.checks),
        pytest.param({"LC_ALL": "C"}, marks=pytest.mark.checks),
    ],
)
def test_a_terminal_without_utf8(recorded, tmp_path, terminal):
    done = shell(
        f"dahl report {recorded} -o $'a\\xff²[x].html' && dahl --help", tmp_path, **terminal
    )
    assert (done.returncode, done.stderr) == (0, "")
    done = shell("dahl identify $'n\\xff²[/x].csv'", tmp_path, **terminal)
    assert refused(done, "no such file") == 2
    done = shell("dahl demo --scene fault-storm --seconds 0.5 --output d", tmp_path, **terminal)
    assert (done.returncode, done.stderr) == (0, "")


def test_a_log_of_nan_alone_is_refused(dahl_here, tmp_path):
    table = np.full((100, 3), np.nan)
    np.savetxt(tmp_path / "nan.csv", table, delimiter=",", header="t,angle,torque", comments="")
    for words in ((), ("--skip-gaps",)):
        done = dahl_here("identify", tmp_path / "nan.csv", "--no-files", *words)
        assert refused(done, "nan.csv:2", "no finite number") == 2


@pytest.mark.parametrize("speed", ["1e-30", "1e-6"])
def test_a_motion_that_would_never_end_is_refused(dahl_here, tmp_path, speed):
    guess = ("--sigma0", "100", "--fc", "0.5", "--counts-per-turn", "16384", "-o", tmp_path)
    done = dahl_here("excite", *guess, "--speed", speed)
    assert refused(done, "a cycle would take", "at most 1000000") == 2
