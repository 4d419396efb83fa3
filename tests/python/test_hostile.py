# SPDX-License-Identifier: MIT
"""Every verb of `dahl` with what it did not hope for: names that are markup, summaries of another
shape, outputs that cannot be written, readers that have gone, terminals without UTF-8. One line
`error: ...`, the right exit code, nothing outside the named place.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from identify_tools import FC, complaint, dahl_torque, noise_of, sine, write_csv

pytestmark = pytest.mark.usefixtures("library")

SCRIPT = "<script>alert(1)</script>"


def shaft(name: str = "shaft.csv", header: str = "t,angle [deg],torque [Nm]") -> Path:
    """A quick log of some name, with some names of columns."""
    theta = sine(1, rows=600, cycles=5)
    torque = dahl_torque(theta) + 0.01 * FC * noise_of(1, 600)
    return write_csv(Path(name), theta, torque, header)


@pytest.mark.parametrize("name", ["[deg]x.csv", ":heart:.csv", "x" * 251 + ".csv"])
def test_a_name_that_is_markup_is_shown_as_it_is(dahl, name, monkeypatch):
    monkeypatch.setenv("COLUMNS", "400")
    done = dahl("identify", shaft(name), "-o", "[bold]", "--name", "a")
    assert done.returncode == 0, done.stderr
    assert "".join(done.stdout.split()).startswith(name)
    assert "[bold]/a.json" in done.stdout
    each = Path("[red]each")
    each.mkdir()
    shutil.copy(name, each)
    done = dahl("identify", "--each", each, "-o", "out", "--jobs", "1")
    assert done.returncode == 0, done.stderr
    assert f" {name[:200]}" in done.stdout


def test_a_name_cannot_command_the_terminal(dahl):
    done = dahl("identify", shaft("a\x1b[2J\nb.csv"), "--no-files")
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("a?[2J") and "\x1b" not in done.stdout
    code, said = complaint(dahl("identify", "a\x1b[2J\n.csv", "--no-files"))
    assert code == 2 and "\x1b" not in said


def test_columns_that_are_markup(dahl):
    path = shaft(header="t,angle [/rad],torque [/bold red]")
    names = ("--angle", "angle [/rad]", "--torque", "torque [/bold red]")
    assert dahl("identify", path, *names, "--no-files").returncode == 0
    own = ("--sigma0", "100", "--fc", "0.5", "--counts-per-turn", "16384", "--bus", "socketcand")
    done = dahl("demo", path, *names, *own, "--seconds", "0.3", "--output", "[x]")
    assert done.returncode == 0, done.stderr
    assert "'angle [/rad]'" in done.stdout and "[x]/run.log" in done.stdout


def test_a_log_of_nan_alone_is_refused(dahl):
    table = np.full((100, 3), np.nan)
    np.savetxt("nan.csv", table, delimiter=",", header="t,angle,torque", comments="")
    for words in ((), ("--skip-gaps",)):
        code, said = complaint(dahl("identify", "nan.csv", "--no-files", *words))
        assert code == 2 and said.startswith("nan.csv:2")


@pytest.mark.parametrize("speed", ["1e-30", "1e-6"])
def test_a_motion_that_would_never_end_is_refused(dahl, speed):
    guess = ("--sigma0", "100", "--fc", "0.5", "--counts-per-turn", "16384", "-o", ".")
    code, said = complaint(dahl("excite", *guess, "--speed", speed))
    assert code == 2 and "1000000" in said


# --- summaries that anyone may have written -------------------------------------------------------


@pytest.fixture(scope="module")
def recorded(tmp_path_factory, library, dahl_loop) -> Path:
    folder = tmp_path_factory.mktemp("storm")
    words = ["demo", "--scene", "fault-storm", "--seconds", "1", "--output", folder]
    subprocess.run([sys.executable, "-m", "dahl", *words], check=True, capture_output=True)
    return folder


@pytest.fixture
def storm(recorded, dahl) -> Path:
    """A run of the fault storm, in the folder `run`."""
    return Path(shutil.copytree(recorded, "run"))


def test_nothing_in_a_summary_becomes_a_part_of_the_page(storm, dahl):
    table = {SCRIPT: 1, '"><img src=x>': 2}
    faults = {"injected": table, "expected": {**table, f"{SCRIPT}b": 3}}
    tables = dict.fromkeys(("node", "control", "parameters", "answers_by_state"), table)
    texts = dict.fromkeys(("title", "bus", "time"), SCRIPT)
    known = json.loads((storm / "summary.json").read_text())
    (storm / "summary.json").write_text(json.dumps(known | texts | tables | {"faults": faults}))
    assert dahl("report", storm).returncode == 0
    page = (storm / "report.html").read_text(encoding="utf-8")
    assert page.startswith("<!DOCTYPE html>") and page.count("&lt;script&gt;alert(1)") >= 9
    assert "<script" not in page and "<img src=x" not in page


@pytest.mark.parametrize(
    "content",
    [
        b"[" * 100_000,
        b"\xff\xfe",
        b'{"scene_file": "x", "n": ' + b"9" * 5000 + b"}",
        b'{"scene_file": "x"',
        None,  # a folder
    ],
    ids=lambda each: str(each)[:20],
)
def test_a_summary_that_is_no_json_is_one_line(storm, dahl, content):
    path = storm / "summary.json"
    path.unlink()
    path.mkdir() if content is None else path.write_bytes(content)
    guess = ("excite", "--from", path, "--counts-per-turn", "16384", "-o", storm)
    for words in (("report", storm), ("plot", storm), guess):
        code, said = complaint(dahl(*words))
        assert code == 2 and "summary.json" in said and len(said) < 300


# --- outputs --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("where", "code", "words"),
    [
        (".", 2, "folder"),
        ("run", 2, "folder"),
        ("/dev/full", 1, "No space left on device"),
        ("none/x", 1, "No such file or directory"),
        ("x" * 300, 1, "File name too long"),
    ],
)
def test_an_output_that_cannot_be_is_one_line_and_leaves_nothing(storm, dahl, where, code, words):
    log = shaft()
    before = sorted(Path.cwd().rglob("*"))
    for verb in (
        ("report", storm, "-o", where),
        ("plot", storm, "-o", where),
        ("identify", log, "--no-files", "--json", where),
    ):
        found, said = complaint(dahl(*verb))
        assert found == code and words in said and where in said
    assert sorted(Path.cwd().rglob("*")) == before


def test_an_output_may_be_a_link_or_a_device(storm, dahl):
    """A link keeps pointing where it did; a device is no file to be replaced; a file keeps its
    mode.
    """
    Path("page.html").symlink_to("real.html")
    Path("real.html").write_text("old")
    Path("real.html").chmod(0o600)
    os.mkfifo("pipe")
    reader = subprocess.Popen(["cp", "pipe", "copy"])
    for output in ("page.html", "pipe"):
        assert dahl("report", storm, "-o", output).returncode == 0
    assert Path("page.html").is_symlink() and Path("pipe").is_fifo()
    assert Path("real.html").read_text().startswith("<!DOCTYPE html>")
    assert Path("real.html").stat().st_mode & 0o777 == 0o600
    assert reader.wait(timeout=20) == 0
    assert Path("copy").read_text() == Path("real.html").read_text()


def shell(command: str, **environment: str) -> subprocess.CompletedProcess:
    """A line for the shell, with `dahl` in it, in the folder of the test."""
    dahl = f'dahl() {{ {sys.executable} -m dahl "$@"; }}; '
    text = {"encoding": "utf-8", "errors": "replace", "capture_output": True, "timeout": 120}
    env = {**os.environ, **environment}
    return subprocess.run(["bash", "-c", dahl + command], check=False, env=env, **text)


OWN = "--angle 'angle [deg]' --sigma0 100 --fc 1 --counts-per-turn 4096"


@pytest.mark.parametrize(
    ("kept", "words"),
    [
        ("plan.h", "plan --sigma0 1 --fc 1 --theta-per-count 1e-3 --force -o plan.h"),
        ("bus.dbc", "dbc --force -o bus.dbc"),
        ("own.ini", f"demo shaft.csv {OWN} --output ."),
    ],
)
def test_a_disk_that_is_full_leaves_the_old_file(dahl, kept, words):
    shaft()
    Path(kept).write_text("old")
    code, said = complaint(shell(f"ulimit -f 0; dahl {words}"))
    assert code == 1 and said.endswith(f"{kept}: File too large")
    assert Path(kept).read_text() == "old" and not list(Path().glob(".*"))


PLAN = "plan --sigma0 1 --fc 1 --theta-per-count 1 -o -"
NODE = f"node {PLAN[5:-5]} -i virtual -c x --seconds 0.05"
PRINTING = ["--help", "data", "complete", PLAN, "report run", NODE]


@pytest.mark.parametrize("buffered", ["", pytest.param("1", marks=pytest.mark.checks)])
@pytest.mark.parametrize("words", PRINTING)
def test_standard_output_that_is_full_or_has_no_reader(storm, words, buffered):
    """Where few lines wait in the buffer until the end, and where each is written at once."""
    code, said = complaint(shell(f"dahl {words} >/dev/full", PYTHONUNBUFFERED=buffered))
    assert code == 1 and "No space left on device" in said
    reader = "| true; exit ${PIPESTATUS[0]}"
    gone = shell(f"dahl {words} {reader}", PYTHONUNBUFFERED=buffered)
    assert (gone.returncode, gone.stderr) == (0, "")


@pytest.mark.checks
def test_closed_streams_change_no_exit_code(dahl):
    shaft()
    for stream in (">&-", "2>&-"):
        assert shell(f"dahl identify --no-files shaft.csv {stream}").returncode == 0
    for stream in ("2>&-", "2>/dev/full", ">&- 2>&-"):
        assert shell(f"dahl identify --no-files none.csv {stream}").returncode == 2


@pytest.mark.parametrize(
    "terminal",
    [
        {"PYTHONUTF8": "0", "LC_ALL": "C", "PYTHONCOERCECLOCALE": "0"},
        pytest.param({"PYTHONIOENCODING": "latin-1"}, marks=pytest.mark.checks),
        pytest.param({"LC_ALL": "C"}, marks=pytest.mark.checks),
    ],
)
def test_a_terminal_without_utf8(storm, terminal):
    for words in (
        "report run -o $'a\\xff²[x].html' && dahl --help",
        "demo --scene fault-storm --seconds 0.5 --output d",
    ):
        done = shell(f"dahl {words}", **terminal)
        assert (done.returncode, done.stderr) == (0, "")
    assert complaint(shell("dahl report $'n\\xff²[/x].csv'", **terminal))[0] == 2
