# SPDX-License-Identifier: MIT
"""Odd names and streams: markup and control characters, outputs that are links or devices, readers
that have gone, terminals without UTF-8.
"""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from identify_tools import FC, complaint, dahl_torque, noise_of, sine, write_csv
from log_reading import drawing

SCRIPT = "<script>alert(1)</script>"


def shaft(name: str = "shaft.csv", header: str = "t,angle [deg],torque [Nm]") -> Path:
    theta = sine(1, rows=600, cycles=5)
    torque = dahl_torque(theta) + 0.01 * FC * noise_of(1, 600)
    return write_csv(Path(name), theta, torque, header)


@pytest.mark.parametrize("name", ["[deg] :heart:.csv", "x" * 251 + ".csv"])
def test_markup_in_a_name_is_shown_literally(dahl, name, monkeypatch):
    monkeypatch.setenv("COLUMNS", "400")
    done = dahl("identify", shaft(name), "-o", "[bold]", "--name", "a")
    assert done.returncode == 0, done.stderr
    assert "".join(done.stdout.split()).startswith("".join(name.split()))
    assert "[bold]/a.json" in done.stdout
    each = Path("[red]each")
    each.mkdir()
    shutil.copy(name, each)
    done = dahl("identify", "--each", each, "-o", "out", "--jobs", "1")
    assert done.returncode == 0, done.stderr
    assert f" {name[:100]}" in done.stdout


def test_control_characters_in_a_name_do_not_reach_the_terminal(dahl):
    done = dahl("identify", shaft("a\x1b[2J\nb.csv"), "--no-files")
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("a?[2J") and "\x1b" not in done.stdout
    code, line = complaint(dahl("identify", "a\x1b[2J\n.csv", "--no-files"))
    assert code == 2 and "\x1b" not in line


def test_markup_in_names_of_columns_is_literal(dahl):
    path = shaft(header="t,angle [/rad],torque [/bold red]")
    names = ("--angle", "angle [/rad]", "--torque", "torque [/bold red]")
    assert dahl("identify", path, *names, "--no-files").returncode == 0
    own = ("--sigma0", "100", "--fc", "0.5", "--counts-per-turn", "16384", "--bus", "socketcand")
    done = dahl("demo", path, *names, *own, "--seconds", "0.3", "--output", "[x]")
    assert done.returncode == 0, done.stderr
    assert "'angle [/rad]'" in done.stdout and "[x]/run.log" in done.stdout


# --- summaries that anyone may have written -------------------------------------------------------


@pytest.fixture
def storm(dahl) -> Path:
    with drawing(rendered=False):
        assert dahl("demo", "--scene", "fault-storm", "--seconds", 1, "-o", "run").returncode == 0
    return Path("run")


def test_texts_of_a_summary_are_escaped_in_the_page(storm, dahl):
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


# --- outputs --------------------------------------------------------------------------------------


def test_an_output_may_be_a_link_or_a_device(storm, dahl):
    """A link keeps its target and a file its mode. A device is written, not replaced."""
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
    dahl = f'dahl() {{ {sys.executable} -m dahl "$@"; }}; '
    text = {"encoding": "utf-8", "errors": "replace", "capture_output": True, "timeout": 120}
    env = {**os.environ, **environment}
    return subprocess.run(["bash", "-c", dahl + command], check=False, env=env, **text)


PLAN = "plan --sigma0 1 --fc 1 --theta-per-count 1e-3 -o -"
NODE = f"node {PLAN[5:-5]} -i virtual -c x --seconds 0.05"


@pytest.mark.parametrize("buffered", ["", pytest.param("1", marks=pytest.mark.checks)])
@pytest.mark.parametrize("words", ["--help", PLAN, NODE])
def test_a_full_standard_output_is_an_error_and_a_closed_one_is_not(words, buffered):
    """Output is flushed at the end or, unbuffered, at each line."""
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
        {"PYTHONIOENCODING": "ascii"},
        pytest.param(
            {"PYTHONUTF8": "0", "LC_ALL": "C", "PYTHONCOERCECLOCALE": "0"}, marks=pytest.mark.checks
        ),
    ],
)
def test_a_terminal_without_utf8(storm, terminal):
    done = shell("dahl report run -o $'a\\xff²[x].html'", **terminal)
    assert (done.returncode, done.stderr) == (0, "")
    assert complaint(shell("dahl report $'n\\xff²[/x].csv'", **terminal))[0] == 2
