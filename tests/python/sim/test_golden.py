# SPDX-License-Identifier: MIT
"""Logs, traces and summaries of all scenes, faults and models in virtual time have not changed.

tests/sim/golden.txt has for each run its scene and options, and below a SHA-256 of each file. If a
change is intended, replace the lines by those that the failed test shows.
"""

import hashlib
import json
from pathlib import Path

import pytest
from conftest import ROOT
from dahl.io import data
from loop_tools import SCENES, run

CHANGING = ("wall_s", "realtime_factor", "max_rss_kib")  # keys of a summary, from run to run
REPLAY = """[friction]
model = loaded
sigma0 = 50
Fc = 0.5
theta_per_count = 1e-4
[load]
full = 5
column = x
[motion]
kind = log
file = replay.csv
angle = a
counts_per_unit = 100
"""


def blocks() -> dict[str, list[str]]:
    text = (ROOT / "tests/sim/golden.txt").read_text(encoding="ascii")
    runs = [block.splitlines() for block in text.split("\n\n")[1:]]
    return {command: digests for command, *digests in runs}


GOLDEN = blocks()


def write_replay(folder: Path) -> Path:
    """A log whose numbers a reader must convert exactly."""
    rows = [
        f"{i / 1000:.3f};{(i * 37 % 400 - 200) / 7};{(i * i % 977) / 3:.4f};{i * 13 % 97 / 16}"
        for i in range(3000)
    ]
    (folder / "replay.csv").write_text("\n".join(["t [s];a;b;x", *rows, ""]))
    (folder / "replay.ini").write_text(REPLAY)
    return folder / "replay.ini"


def options_of(command: str) -> tuple[str, list[str]]:
    """The scene and the options of a golden run. A value may contain blanks."""
    scene, *options = command.split(" --")
    return scene, [word for option in options for word in f"--{option}".split(" ", 1)]


def digests(folder: Path, command: str) -> list[str]:
    name, options = options_of(command)
    scene = write_replay(folder) if name == "replay" else SCENES / f"{name}.ini"
    if name in ("cycloidal", "tribometer", "tribometer-slip"):
        source = data.local_folder(name.partition("-")[0])
        if source is None:
            pytest.skip(f"unproven: golden run of {name}: measured set not in reach")
        options += ["--data", str(source.parent)]
    trace = folder / "trace.csv"
    has_trace = "[rotor]" in scene.read_text(encoding="utf-8")
    options += ["--trace", str(trace)] if has_trace else []
    result = run(folder, scene, "--virtual", *options)
    assert (result.code, result.err) == (0, "")
    summary = {key: one for key, one in result.summary.items() if key not in CHANGING}
    summary["scene"] = Path(summary["scene"]).name
    text = json.dumps(summary, sort_keys=True)
    digits = json.loads(text, parse_float=lambda number: f"{float(number):.12g}")
    files = {"log": result.log.read_bytes()}
    files |= {"trace": trace.read_bytes()} if has_trace else {}
    files |= {"summary": json.dumps(digits).encode()}
    return [f"{kind} {hashlib.sha256(one).hexdigest()}" for kind, one in files.items()]


@pytest.mark.parametrize("command", GOLDEN)
def test_a_run_has_its_golden_log_trace_and_summary(tmp_path, command):
    assert digests(tmp_path, command) == GOLDEN[command]


def test_each_scene_has_a_golden_run():
    assert {path.stem for path in SCENES.glob("*.ini")} <= GOLDEN.keys()
