# SPDX-License-Identifier: MIT
"""`dahl demo` end to end: from a log to picture, record and summary, over a served bus. How a run
ends, and the files that it leaves.
"""

import functools
import json
import math
import os
import re
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import dahl
import numpy as np
import pytest
from dahl.binding.library import load
from dahl.io import can_logs
from dahl.report import run_files, traces
from dahl.sim import compensation, park_steer, replay, scene
from demo_tools import (
    FC,
    OFFSET,
    OWN,
    SIGMA0,
    TICKS,
    TURN,
    answered,
    in_role,
    rows_of,
    summary_of,
    write_log,
    write_loop,
)
from identify_tools import complaint
from log_reading import drawing
from loop_tools import SCENES, is_running, run, spawn, wait_for_bytes, wait_until


@pytest.fixture
def unpainted():
    """The figures that are drawn, saved as empty files, since drawing takes longest."""
    with drawing(rendered=False) as figures:
        yield figures


@pytest.fixture
def quick_scenes(monkeypatch):
    """Scenes without dahl-loop, simulated once and shortly."""
    compare, simulate = functools.cache(compensation.compare), functools.cache(park_steer.simulate)
    monkeypatch.setattr(compensation, "compare", lambda seed, _progress: compare(seed))
    monkeypatch.setattr(park_steer, "simulate", lambda gain, _progress: simulate(gain))


@pytest.fixture(scope="module")
def own_log(tmp_path_factory, library) -> Path:
    return write_log(tmp_path_factory.mktemp("own") / "shaft.csv")


@pytest.fixture(scope="module")
def demo(own_log, tmp_path_factory, root) -> tuple[Path, str]:
    folder = tmp_path_factory.mktemp("demo")
    words = [sys.executable, "-m", "dahl", "demo", own_log, *OWN, "--output", folder]
    process = spawn(words, cwd=root)
    shown, errors = process.communicate(timeout=120)
    assert process.returncode == 0, shown + errors
    return folder, shown


def measured(own_log: Path) -> tuple[np.ndarray, np.ndarray]:
    """Degrees from the start, and the torque of the sensor in mN m."""
    table = np.loadtxt(own_log, delimiter=",", skiprows=1)
    return table[:, 1] - table[0, 1], table[:, 2]


def fit_of(truth: np.ndarray, model: np.ndarray) -> tuple[float, float]:
    residual = truth - model
    r2 = 1 - np.sum(residual**2) / np.sum((truth - truth.mean()) ** 2)
    return float(np.sqrt(np.mean(residual**2))), float(r2)


# --- files of a run -------------------------------------------------------------------------------


def test_a_run_leaves_record_picture_and_summary(demo, own_log):
    folder, shown = demo
    numbers, (counts, ratios) = summary_of(folder), answered(folder / "run.log")
    bearing = dahl.Friction(dahl.Plan(SIGMA0, FC, 2 * math.pi / TURN))
    moves = np.diff(counts, prepend=counts[0]).tolist()
    assert len(ratios) == TICKS
    assert ratios.tolist() == [bearing.step_counts_q30(move) for move in moves]
    degrees, sensor = measured(own_log)
    assert np.array_equal(counts - counts[0], np.rint(degrees * TURN / 360))
    rmse, r2 = fit_of(-sensor / 1000, ratios * 2.0**-30 * FC + OFFSET)
    assert numbers["rmse_measured"] == pytest.approx(rmse, rel=1e-6) == pytest.approx(0.01, rel=0.1)
    assert numbers["r2_measured"] == pytest.approx(r2, rel=1e-6) and r2 > 0.99
    facts = dict.fromkeys(("ticks", "frames_sent", "frames_answered", "frames_recorded"), TICKS)
    facts |= {"frames_lost": 0, "frames_not_recorded": 0, "interrupted": False}
    facts |= {"log": str(own_log), "time": "real", "model": "dahl", "recorder_dropped": False}
    assert numbers == numbers | facts and 0 < numbers["max_error_ulp_Fc"] <= 0.52
    latency = numbers["latency_us"]
    assert 0 < latency["p50"] <= latency["p99"] <= latency["max"]
    assert " 'shaft [deg]' " in numbers["command"]  # quoted for a shell
    assert (folder / "loop.png").read_bytes().startswith(b"\x89PNG")
    assert not list(folder.glob("*.part*"))
    assert re.search(rf"^run .* 100% {TICKS} ticks", shown, re.MULTILINE)
    assert "ended early" not in shown


def test_the_table_has_the_numbers_of_the_summary(demo):
    rows, numbers = rows_of(demo[1]), summary_of(demo[0])
    assert (rows["bus"], rows["ticks of 1 ms"]) == (numbers["bus"], str(TICKS))
    assert (rows["frames sent"], rows["frames without an answer"]) == (str(TICKS), "0")
    for name, value in numbers["latency_us"].items():
        assert f"{name} {value:.0f}" in rows["latency of an answer"]
    exact = rows["largest error against the exact torque"]
    assert exact == f"{numbers['max_error_ulp_Fc']:.3f} ulp of Fc"
    fit = rows["rms error against the measurement"], rows["R² against the measurement"]
    assert fit == (f"{numbers['rmse_measured']:.4g} N m", f"{numbers['r2_measured']:.4f}")


def test_a_scene_of_any_editor_without_a_measurement_runs(dahl, unpainted, tmp_path):
    text = (SCENES / "segments.ini").read_text().replace("Three", "Lenkung ä² <b>")
    text = text.replace("[friction]", "[friction]\nnode = 3").replace("\n", "\r\n")
    Path("scene.ini").write_text(text, encoding="utf-8-sig", newline="")
    done = dahl("demo", "--scene", "scene.ini", "--seconds", "0.3", "-o", "run")
    assert (done.returncode, done.stderr) == (0, "")
    assert "no measurement here" in done.stdout
    assert re.search(r"^run .* 100% 300 ticks", done.stdout, re.MULTILINE)
    numbers = summary_of(tmp_path / "run")
    assert numbers["ticks"] == numbers["frames_recorded"] == 300
    assert numbers["r2_measured"] is None and numbers["max_error_ulp_Fc"] <= 0.52
    assert len(answered(tmp_path / "run" / "run.log", node=3)[1]) == 300
    assert numbers["title"].startswith("Lenkung ä² <b>")
    assert ": 300 ticks, " in dahl("plot", "run").stdout
    assert dahl("report", "run").returncode == 0
    page = Path("run/report.html").read_text(encoding="utf-8")
    assert "<title>Lenkung ä² &lt;b&gt;" in page


def test_a_run_of_one_tick_is_recorded(dahl, unpainted, tmp_path):
    """The node and its server end with the encoder. --json prints the summary."""
    words = ("--scene", "steering", "--bus", "socketcand:0", "--seconds", 0.001, "--json")
    done = dahl("demo", *words, "-o", tmp_path)
    assert "the bus has gone" not in done.stderr and "scene   " in done.stderr
    numbers = summary_of(tmp_path)
    assert json.loads(done.stdout) == numbers == numbers | {"ticks": 1, "bus": "socketcand:0"}
    assert len(answered(tmp_path / "run.log")[1]) == 1


@pytest.mark.parametrize(("name", "r2"), [("tribometer", 0.9865), ("tribometer-slip", 0.997)])
def test_the_model_fits_the_tribometer(measured_file, tmp_path, name, r2):
    """The promise of the README."""
    log = measured_file("tribometer", "reciprocating.tsv")
    played = scene.read(SCENES / f"{name}.ini")
    result = run(tmp_path, played.path, "--virtual", "--data", log.parents[1])
    trace = traces.trace_of(can_logs.read_candump(result.log))
    assert traces.fit(played, trace, replay.read_recorded(played, log))["r2_measured"] >= r2


def test_the_fault_storm_is_counted_and_exact(dahl, unpainted, tmp_path):
    """In virtual time, which has no latencies."""
    done = dahl("demo", "--scene", "fault-storm", "--seconds", "3", "--output", "out")
    assert done.returncode == 0, done.stderr
    numbers = summary_of(tmp_path / "out")
    injected = numbers["faults"]["injected"]
    assert numbers["max_error_ulp_Fc"] <= 0.52 and sum(injected.values()) > 200
    rows = {name: " ".join(value.split()) for name, value in rows_of(done.stdout).items()}
    assert "all, to the last one" in rows["faults counted by the node"]
    assert f"drop {injected['drop']}" in rows["faults"]
    assert not [key for key in numbers if re.search("latency|jitter|deadline|late_", key)]
    assert " µs" not in done.stdout
    assert dahl("report", "out").returncode == 0 and dahl("plot", "out").returncode == 0
    assert "latency of" not in (tmp_path / "out" / "report.html").read_text().lower()


def test_a_closed_loop_reports_its_tracking_error(dahl, unpainted, tmp_path):
    done = dahl("demo", "--scene", "slow-reversal", "--seconds", 2, "--output", "out")
    assert done.returncode == 0, done.stderr
    assert dahl("plot", "out").returncode == 0
    tracking, without = (line.get_ydata() for line in unpainted[0].axes[-1].lines)
    again = [line.get_ydata() for line in unpainted[1].axes[-1].lines]
    assert np.array_equal(again, [tracking, without])
    assert np.sqrt(np.mean(without**2)) > 2 * np.sqrt(np.mean(tracking**2))
    numbers, rows = summary_of(tmp_path / "out"), rows_of(done.stdout)
    assert numbers["max_error_ulp_Fc"] is None
    control = numbers["control"]
    for name, part in (("rms_error_rad", "rms"), ("max_error_rad", "max")):
        assert f"{part} {control[name]:.3g} rad" in rows["tracking error"]
    turns = (control["torque_alternations"], control["reference_reversals"])
    assert rows["sign of the torque"] == "changed {} times, the motion {} times".format(*turns)
    assert control["rms_error_rad"] == pytest.approx(np.sqrt(np.mean(tracking**2)), rel=1e-6)


# --- a folder with runs of several scenes ---------------------------------------------------------


def names_in(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


SHORT = ("--seconds", 0.2)
PAIR = {"node.err", "encoder.err"}
SEGMENTS = ("--scene", "segments", "--bus", "socketcand", *SHORT)
SCENES_IN_ONE_FOLDER = [  # words, picture, and the other files of such a run
    (SEGMENTS, "loop.png", {"run.log", *PAIR}),
    (("--scene", "compensation"), "compensation.png", set()),
    (
        ("--scene", "parking", *SHORT),
        "loop.png",
        {"run.log", "trace.csv", "uncompensated.csv", "both.err"},
    ),
    (("--scene", "fault-storm", *SHORT), "loop.png", {"run.log", "faultless.log", "both.err"}),
    (("--scene", "park-steer"), "park-steer.png", {"run.log"}),
    (("--scene", "commission"), "commission.png", set()),
    (SEGMENTS, "loop.png", {"run.log", *PAIR}),
]


def test_plot_and_report_know_each_scene_and_no_file_of_another_scene_stays(dahl, quick_scenes):
    """A file that is not of dahl, or that has changed since, stays."""
    out, own = Path("out"), {"notes.txt", "run.csv", "node.ini", "x.json"}
    out.mkdir()
    for name in own:
        (out / name).write_text("mine")
    for words, name, left in SCENES_IN_ONE_FOLDER:
        assert dahl("demo", *words, "-o", "out").returncode == 0
        assert names_in(out) == {*own, *left, name, "summary.json", ".dahl-files.json"}
        (picture := out / name).unlink()
        done = dahl("plot", "out")
        assert (done.returncode, done.stderr) == (0, "")
        assert picture.exists() and done.stdout.startswith(f"{picture}: ")
        assert dahl("report", "out").returncode == 0 and (out / "report.html").exists()
        assert dahl("plot", "out", "-o", "out/own.svg").returncode == 0  # stays
        own.add("own.svg")
    (out / "loop.png").write_bytes(b"mine")
    (out / "trace.csv").write_text("time_s,of,mine\n")
    assert dahl("demo", "--scene", "compensation", "-o", "out").returncode == 0
    assert (out / "loop.png").read_bytes() == b"mine" and (out / "trace.csv").exists()
    assert all((out / name).read_text() == "mine" for name in own - {"own.svg"})
    left = own | {"compensation.png", "summary.json", ".dahl-files.json", "loop.png", "trace.csv"}
    assert names_in(out) == left


@pytest.mark.parametrize("words", [words for words, *_ in SCENES_IN_ONE_FOLDER[:4]])
def test_files_of_the_user_survive_a_run_that_writes_the_same_names(dahl, quick_scenes, words):
    (out := Path("out")).mkdir()
    own = {"summary.json", "run.log", "trace.csv", "loop.png", "park-steer.png", "own.csv"}
    for name in own:
        (out / name).write_text(f"mine: {name}")
    for _ in range(2):  # the second run removes the files of the first one only
        assert dahl("demo", *words, "-o", "out").returncode == 0
        kept = {path.read_bytes() for path in out.iterdir()}
        assert {f"mine: {name}".encode() for name in own} <= kept


def test_a_run_keeps_the_files_that_it_reads(dahl, own_log, unpainted):
    """A scene and a table that an earlier run wrote into the folder."""
    words = ("--bus", "socketcand", *SHORT, "-o", "out")
    assert dahl("demo", own_log, *OWN, *words).returncode == 0
    for _ in range(2):
        done = dahl("demo", "--scene", "out/own.ini", "--bus", "socketcand", *SHORT, "-o", "new")
        assert done.returncode == 0, done.stderr
        assert {"own.ini", "own.csv"} <= names_in(Path("out"))
    shutil.copy("out/own.ini", "new/own.ini")
    assert dahl("demo", "--scene", "segments", *words).returncode == 0
    assert not {"own.ini", "own.csv"} & names_in(Path("out"))


def test_a_failed_run_leaves_files_that_the_next_run_removes(
    dahl, unpainted, monkeypatch, tmp_path
):
    with monkeypatch.context() as patched:
        script = in_role("encoder", "exit 3")
        patched.setenv("DAHL_LOOP", str(write_loop(tmp_path / "bin", script)))
        words = ("--scene", "segments", "--bus", "socketcand", *SHORT, "-o", "out")
        assert dahl("demo", *words).returncode == 1
    assert "node.err" in names_in(Path("out"))
    assert dahl("demo", "--scene", "creep", *SHORT, "-o", "out").returncode == 0
    assert "node.err" not in names_in(Path("out"))


@pytest.mark.parametrize("text", ["{", "[]", '{"../trace.csv": STAMP}', '{"kept": STAMP}', "{}"])
@pytest.mark.parametrize("more", ["", ', "trace.csv": 7', ', "trace.csv": [4]'])
def test_a_list_of_files_that_anyone_may_have_written_removes_no_other_file(tmp_path, text, more):
    (folder := tmp_path / "out").mkdir()
    kept = [tmp_path / "trace.csv", folder / "trace.csv", folder / "kept"]
    for path in kept:
        path.write_text("mine")
        os.utime(path, ns=(10**18, 10**18))
    text = text.replace("}", f"{more}}}").replace("{,", "{").replace("STAMP", f"[4, {10**18}]")
    (folder / ".dahl-files.json").write_text(text)
    run_files.remove_earlier(folder)
    assert all(path.exists() for path in kept)
    (folder / ".dahl-files.json").write_text(f'{{"trace.csv": [4, {10**18}]}}')
    run_files.remove_earlier(folder)
    assert [path.exists() for path in kept] == [True, False, True]


# --- how a run ends -------------------------------------------------------------------------------


@pytest.fixture
def running(root, tmp_path):
    """A demo whose two programs are running."""
    words = [sys.executable, "-m", "dahl", "demo", "--scene", "steering", "--output", tmp_path]
    process = spawn(words, cwd=root)
    wait_for_bytes(tmp_path / "run.log", 40000, 60)
    yield process
    process.kill()
    process.communicate()


def children(process: subprocess.Popen) -> list[int]:
    found = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
    return [*map(int, found)]


def test_one_run_a_folder_and_ctrl_c_leaves_whole_files(running, dahl_here, tmp_path):
    """A second demo in the folder is refused, by any name. Ctrl-C reaches the demo, which ends its
    programs.
    """
    (tmp_path / "link").symlink_to(tmp_path)
    for name in (tmp_path, tmp_path / "link", tmp_path / ".." / tmp_path.name):
        code, said = complaint(dahl_here("demo", "--scene", "segments", "--output", name))
        assert code == 1 and said.startswith(f"{name}: ")
    programs = children(running)
    assert len({os.getpgid(process) for process in (*programs, running.pid)}) == 3
    node, encoder = (Path(f"/proc/{one}/cmdline").read_text().split("\0") for one in programs)
    assert {"--lockstep", "--until-idle"} <= {*node} and "--lockstep" not in encoder
    running.send_signal(signal.SIGINT)
    shown, errors = running.communicate(timeout=60)
    assert (running.returncode, errors) == (130, "interrupted\n") and "ended early" in shown
    assert not any(map(is_running, programs))
    numbers = summary_of(tmp_path)
    assert numbers["interrupted"] is True and numbers["max_error_ulp_Fc"] <= 0.52
    assert (numbers["scene"], numbers["frames_not_recorded"]) == ("steering", 0)
    assert (tmp_path / "run.log").read_text().endswith("\n") and (tmp_path / "loop.png").exists()


def test_the_programs_of_a_killed_demo_end_with_it(running):
    programs = children(running)
    assert len(programs) == 2
    running.kill()
    running.wait(60)
    wait_until(lambda: not any(map(is_running, programs)))


@pytest.mark.parametrize(("which", "name"), [(0, "node"), (1, "encoder")])
def test_a_program_that_dies_is_named(running, which, name):
    os.kill(children(running)[which], signal.SIGKILL)
    _, errors = running.communicate(timeout=60)
    assert running.returncode == 1 and errors.count("\n") == 1
    assert errors.startswith("error: ") and f"({name})" in errors and "-9" in errors


# --- without a log --------------------------------------------------------------------------------


def test_without_a_measured_set_the_demo_runs_steering(dahl, unpainted, monkeypatch, tmp_path):
    """Otherwise it plays the best set. The folder of the checkout is replaced, after the library is
    loaded from it.
    """
    load()
    monkeypatch.setattr("dahl.paths.ROOT", tmp_path / "a" / "b")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setenv("DAHL_DATA_URL", "http://127.0.0.1:1/{path}")
    monkeypatch.delenv("DAHL_DATA", raising=False)
    done = dahl("demo", "--seconds", "0.3", "--output", "out")
    assert done.returncode == 0, done.stderr
    assert re.search("(?s)tribometer.*cycloidal.*'steering'", done.stdout)
    assert summary_of(tmp_path / "out")["scene"] == "steering"
    monkeypatch.setenv("DAHL_DATA", str(tmp_path))
    for best in ("cycloidal", "tribometer"):
        (tmp_path / best).mkdir()  # without its file, so that the message names it
        code, said = complaint(dahl("demo", "--output", tmp_path / "new" / "out"))
        assert code == 2 and said.startswith(f"{tmp_path / best}")
