# SPDX-License-Identifier: MIT
"""One table for each verb: what is asked for, and what its user then sees in a file, on the screen,
in the words that another program is given, and in the exit code.
"""

from __future__ import annotations

import contextlib
import json
import os
import re
import shlex
import subprocess
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import can
import cantools
import numpy as np
import pytest
from can.interfaces.virtual import channels
from dahl import RunError, cli, firmware, html_report, loop, paths, plots, scene
from dahl.cli import build_parser
from dahl.identify import folder_runs, pipeline
from identify_tools import COUNT, FC, complaint, dahl_torque, noise_of, sine, write_csv
from log_writers import DBC, STEP
from log_writers import frames as write_frames
from test_monitor import frames, sending

pytestmark = pytest.mark.usefixtures("library", "dahl_loop")

# --- all verbs ------------------------------------------------------------------------------------


def test_what_holds_of_a_log_of_ones_own_where_nothing_is_said():
    own = scene.OwnLog(Path("x.csv"), "a", "T", 100.0, 0.5, 4096.0)
    assert (own.angle_unit, own.time) == ("deg", "")
    assert (own.torque_scale, own.offset, own.spring) == (1, 0, 0)


@pytest.mark.parametrize(
    "verb", [verb for verb in cli.COMMANDS if verb not in {"complete", "data"}]
)
def test_each_example_of_the_help_is_a_command_line(dahl, verb):
    """Whose options the verb has; the other two show words of a shell."""
    line = rf"^(?:  |example: )dahl ({verb}\b.*?)(?:   .*)?$"
    text = re.sub(r" \\\n +", " ", dahl(verb, "--help").stdout)
    examples = re.findall(line, text, re.MULTILINE)
    assert examples
    for words in map(shlex.split, examples):
        args = build_parser().parse_args(words)
        assert args.command == verb
        if verb in ("monitor", "record"):
            assert args.port in (None, 29536), "where socketcand listens by default"


def test_the_help_names_the_folder_of_an_installed_package(dahl, monkeypatch):
    monkeypatch.setattr(paths, "INSTALLED", True)
    monkeypatch.setattr(paths, "OUTPUT", Path("dahl-out"))
    shown = {name: dahl(name, "--help").stdout for name in cli.COMMANDS}
    assert [name for name, text in shown.items() if re.search(r"\b(build|lib)/", text)] == []
    assert "in dahl-out/demo" in shown["demo"] and "dahl plot dahl-out/demo" in shown["plot"]


# --- demo -----------------------------------------------------------------------------------------


@pytest.fixture
def told(monkeypatch, tmp_path):
    """The words of each dahl-loop that is started, by its role."""
    script, log = tmp_path / "loop", tmp_path / "told"
    script.write_text(f'#!/bin/sh\necho "$*" >>{log}\nexec {os.environ["DAHL_LOOP"]} "$@"\n')
    script.chmod(0o755)
    monkeypatch.setenv("DAHL_LOOP", str(script))
    monkeypatch.setattr(plots, "save", lambda figure, path: None)  # takes longest, is no matter

    def words() -> dict[str, list[str]]:
        lines = [line.split() for line in log.read_text().splitlines()]
        log.unlink()
        return {line[line.index("--role") + 1]: line for line in lines}

    return words


def pairs(words: list[str]) -> dict[str, str | None]:
    """Each option of a command line with its value."""
    following = [*words[1:], None]
    pair = zip(words, following, strict=True)
    return {a: None if b is None or b.startswith("--") else b for a, b in pair if a[:2] == "--"}


REAL = ("node", "encoder")
RUNS = [
    (("--scene", "segments", "--bus", "socketcand"), REAL, {}),
    (("--scene", "creep"), ("both",), {"--virtual": None, "--trace": "out/trace.csv"}),
    (("--scene", "fault-storm", "--seed", 7), ("both",), {"--virtual": None, "--seed": "7"}),
    (("--scene", "creep", "--bus", "socketcand"), REAL, {}),
    (("--scene", "own.ini", "--bus", "socketcand"), REAL, {"--log-file": "own.csv"}),
]


@pytest.mark.parametrize(("words", "roles", "chosen"), RUNS, ids=lambda each: str(each)[:40])
def test_each_demo_starts_the_programs_that_it_needs(dahl, told, tmp_path, words, roles, chosen):
    Path("own.ini").write_text(
        "[scene]\ntitle = mine\n[friction]\nsigma0 = 50\nFc = 0.5\ntheta_per_count = 1e-4\n"
        "[motion]\nkind = log\nfile = own.csv\nangle = a\ncounts_per_unit = 1\n"
    )
    Path("own.csv").write_text("\n".join(["a", *map(str, range(400))]))
    done = dahl("demo", *words, "--seconds", 0.2, "--output", "out")
    assert done.returncode == 0, done.stderr
    started = told()
    assert set(started) == set(roles)
    motion = pairs(started[roles[-1]])  # the program that moves
    shipped = scene.find(str(words[1]))
    assert (motion["--scene"], motion["--seconds"]) == (str(shipped), "0.2")
    for option in ("--virtual", "--trace", "--seed", "--log-file", "--lockstep"):
        assert (option in motion) == (option in chosen)
        assert motion.get(option) == chosen.get(option)
    numbers = json.loads(Path("out/summary.json").read_text())
    log = str(tmp_path / "own.csv") if "--log-file" in chosen else None
    assert (numbers["log"], numbers["ticks"], numbers["bus"]) == (log, 200, "socketcand")
    assert numbers["title"] == scene.read(shipped).title
    assert f"scene   {numbers['title']} ({shipped.name})" in done.stdout
    assert ("log own.csv" in done.stdout) == bool(log)
    assert ("virtual time" in done.stdout.partition("bus ")[2].split("\n")[0]) == (len(roles) == 1)
    if len(roles) > 1:
        node = pairs(started["node"])
        assert node.keys() >= {"--lockstep", "--until-idle"} and "--seconds" not in node


@contextlib.contextmanager
def another_node(program, asked, core, params, folder, port, number):
    """Node 0 of the scene segments joins a served bus; on entry it is there."""
    asked.append((core, params, folder, number))
    bus = ("--role", "node", "--bus", f"socketcand:127.0.0.1:{port}")
    command = [program, "--scene", paths.SCENES / "segments.ini", *bus]
    here = {"interface": "socketcand", "channel": "vcan0", "host": "127.0.0.1", "port": port}
    with subprocess.Popen(command, stderr=subprocess.DEVNULL) as node:
        try:
            with can.Bus(**here) as listener:
                while listener.recv(5).arbitration_id != 0x120:  # Status of node 0
                    pass
            yield
        finally:
            node.terminate()


def test_a_target_takes_the_place_of_the_node(dahl, told, dahl_loop, monkeypatch, tmp_path):
    """Another node on the served bus stands for the firmware; dahl-loop's own is never asked."""
    asked = []
    image = paths.ROOT / "build/m4f/port/node_image"
    monkeypatch.setattr(firmware, "build", lambda core: image)
    attached = partial(another_node, dahl_loop, asked)
    monkeypatch.setattr(firmware, "attached", attached)
    words = ("--scene", "segments", "--seconds", 0.3, "--target", "m4f")
    done = dahl("demo", *words, "--output", tmp_path / "out")
    assert done.returncode == 0, done.stderr
    assert asked == [("m4f", (50.0, 0.5, 9.587379924285257e-05), tmp_path / "out", 0)]
    started = told()
    assert pairs(started["node"])["--scene"] == str(tmp_path / "out/hub.ini")
    assert "--lockstep" in started["encoder"]
    numbers = json.loads(Path("out/summary.json").read_text())
    assert (numbers["target"], numbers["node"], numbers["frames_answered"]) == ("m4f", {}, 300)
    board = firmware.boards()["m4f"].machine
    assert f"node    {image.relative_to(paths.ROOT)} on {board} in QEMU" in done.stdout
    refused = dahl("demo", *words, "--bus", "socketcan:x", "--output", tmp_path / "out")
    assert complaint(refused) == (2, "--target goes with --bus socketcand, not socketcan:x")


@pytest.mark.parametrize(
    ("script", "code", "words"),
    [
        ("exec sleep 60", 1, "dahl-loop (node) did not say which port it serves"),
        ("exit 3", 1, "dahl-loop (node) ended with code 3"),
        ("echo x; echo error: no wheel >&2; exit 2", 2, "no wheel"),
        ("echo error: no bus >&2; exit 1", 1, "no bus"),
        ("echo odd >&2; echo '  error: no rig ' >&2; echo error: two >&2; exit 1", 1, "no rig"),
        ("kill -TERM $$", 1, "dahl-loop (node) ended with code -15"),
        ("kill -INT $$", 1, "dahl-loop (node) ended with code -2"),
    ],
)
def test_what_dahl_loop_complains_about_is_told(dahl, monkeypatch, tmp_path, script, code, words):
    (tmp_path / "loop").write_text(f"#!/bin/sh\n{script}\n")
    (tmp_path / "loop").chmod(0o755)
    monkeypatch.setenv("DAHL_LOOP", str(tmp_path / "loop"))
    monkeypatch.setattr(loop, "PATIENCE", 0.5)
    done = dahl("demo", "--scene", "segments", "--bus", "socketcand", "--output", "out")
    assert complaint(done) == (code, words)


@pytest.mark.parametrize(
    "name",
    [
        "loop.png",
        "params.m4f.bin",
        "own.ini",
        "node.json",
        "run.log",
        "summary.json",
        "trace.csv",
        "node.err",
    ],
)
def test_no_output_of_a_demo_may_be_its_log(dahl, name):
    Path(name).write_text("a\n1\n")
    done = dahl("demo", name, "--output", ".")
    assert complaint(done) == (2, f"{name}: a run in . would destroy it; name another -o")
    Path("scene").write_text(f"[motion]\nkind = log\nfile = {name}\nangle = a\n")
    done = dahl("demo", "--scene", "scene", "--output", ".")
    assert complaint(done)[1].endswith(f"{name}: a run in . would destroy it; name another -o")
    assert Path(name).read_text() == "a\n1\n"
    assert "needs --angle" in complaint(dahl("demo", name, "--output", "out"))[1]


# --- firmware -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("script", "words"),
    [
        ("echo odd >&2; echo broken tool >&2; exit 1", "m4f could not be built, .*: broken tool"),
        ("echo only here; exit 1", "tools/setup.sh firmware brings what is needed: only here"),
        (
            "printf 'odd\\nfatal: no host\\n  where (include)\\n' >&2; exit 1",
            "needed: fatal: no host",
        ),
        (None, "cmake is not installed; tools/setup.sh installs it"),
    ],
)
def test_an_image_that_cannot_be_built_is_one_line(monkeypatch, tmp_path, script, words):
    if script:
        (tmp_path / "cmake").write_text(f"#!/bin/sh\n{script}\n")
        (tmp_path / "cmake").chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}:/usr/bin:/bin" if script else str(tmp_path))
    with pytest.raises(RunError, match=f"{words}$"):
        firmware.build("m4f")


def test_the_image_of_a_core_is_built_by_its_preset(monkeypatch, tmp_path):
    (tmp_path / "cmake").write_text(f'#!/bin/sh\necho "$PWD: $*" >>{tmp_path}/asked\n')
    (tmp_path / "cmake").chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}:/usr/bin:/bin")
    monkeypatch.chdir(tmp_path)
    folder = paths.ROOT / "build" / "m0"
    assert firmware.build("m0") == folder / "port/node_image"
    asked = (tmp_path / "asked").read_text().splitlines()
    build = f"{paths.ROOT}: --build {folder} --target node_image"
    assert asked == [f"{paths.ROOT}: --preset m0", build]


# --- clients of a bus -----------------------------------------------------------------------------

OPTIONS = [
    ("-b 250000", {"bitrate": 250000}),
    ("--fd --data-bitrate 2000000", {"fd": True, "data_bitrate": 2000000}),
    ("--host away --port 5", {"host": "away", "port": 5}),
    ("--bus-kwargs app_name=dahl", {"app_name": "dahl"}),
]


@pytest.mark.parametrize("verb", ["monitor", "record -o x.log", "identify --follow"])
@pytest.mark.parametrize(("words", "settings"), OPTIONS)
def test_what_is_said_of_a_bus_reaches_python_can(dahl, monkeypatch, verb, words, settings):
    """And is told where the bus cannot be opened."""
    asked: dict[str, object] = {}

    def refuse(**given: object) -> None:
        asked.update(given)
        raise OSError("no such thing")

    monkeypatch.setattr(can, "Bus", refuse)
    Path("bus.dbc").write_text(DBC)
    signals = ("--dbc", "bus.dbc", "--angle", "Angle", "--torque", "Torque")
    follow = signals if verb.startswith("identify") else ()
    done = dahl(*verb.split(), "-i", "virtual", "-c", "x", *words.split(), *follow)
    code, said = complaint(done)
    wanted = {"interface": "virtual", "channel": "x", **settings}
    assert {key: asked.get(key) for key in wanted} == wanted
    assert code == 1 and said.endswith(": no such thing")
    for key, value in wanted.items():
        assert f"{key}={value}" in said or f"'{key}': '{value}'" in said


@pytest.mark.parametrize(
    ("words", "rows"), [(("--frames", 1300), 650), (("--within", 8, "--frames", 1400), 500)]
)
def test_following_a_bus_ends_where_it_is_told(dahl, words, rows):
    """The first look, at 500 rows, tells sigma0 within 8 %; all 700 do not tell it within 2 %."""
    Path("bus.dbc").write_text(DBC)
    theta = np.floor(sine(1, rows=700, cycles=10) / COUNT) * COUNT
    torque = dahl_torque(theta) + 0.1 * FC * noise_of(1, 700)
    bits = [np.rint(values / STEP).astype(int) for values in (np.degrees(theta), torque)]
    write_frames(Path("bus.log"), 1e9 + np.arange(700) * 1e-3, *bits)
    signals = ("--dbc", "bus.dbc", "--angle", "Angle", "--torque", "Torque")
    quiet = ("--json", "-", "-o", "out", "--terms", "offset", "--name", "Live one", "--seconds", 20)
    with sending("live", list(can.LogReader("bus.log")), lambda: len(channels["live"]) == 2):
        bus = ("-i", "virtual", "-c", "live")
        done = dahl("identify", "--follow", *bus, *signals, *quiet, *words)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert found["rows"] == pytest.approx(rows, abs=2)
    assert list(found["extra"]) == ["offset"]
    assert Path("out/dahl_plan_live_one.h").is_file()


def test_a_monitor_shows_what_it_saw_before_the_bus_went(dahl, dbc, monkeypatch):
    view = ("EncoderState", 1.0, {"Counter": 3, "Valid": 1, "Count": 77})
    ticks = [*frames(dbc, view)]

    def recv(_: float) -> can.Message:
        if not ticks:
            raise can.CanOperationError("cable out")
        return ticks.pop()

    monkeypatch.setenv("COLUMNS", "120")
    monkeypatch.setattr(can, "Bus", lambda **_: contextlib.nullcontext(SimpleNamespace(recv=recv)))
    done = dahl("monitor", "-i", "virtual", "-c", "x")
    assert complaint(done) == (1, "the bus has gone: cable out")
    assert re.search(r"^ ?EncoderState +1 +0 +0 +0 +Valid Valid +Count 77 *$", done.stdout, re.M)
    assert re.search(r"^ ?FrictionTorque +0 +0 +0 +0 +not seen *$", done.stdout, re.M)
    assert re.search(r"^ ?node states +none yet *$", done.stdout, re.M)


# --- identify -------------------------------------------------------------------------------------


@pytest.fixture
def shaft(tmp_path):
    """A quick log; its second clock goes twice as fast."""
    theta = np.floor(sine(1, rows=1000, cycles=5) / COUNT) * COUNT
    torque = dahl_torque(theta) + 0.02 * FC * noise_of(1, 1000)
    path = write_csv(tmp_path / "My shaft.csv", theta, torque)
    lines = path.read_text().splitlines()
    more = ["t,angle_deg,torque_Nm,clock"]
    more += [f"{line},{n * 5e-4}" for n, line in enumerate(lines[1:])]
    path.write_text("\n".join(more) + "\n")
    return path


def test_identify_leaves_what_is_asked_for_under_its_name(dahl, shaft):
    done = dahl("identify", shaft, "--json", "-", "-o", "out")
    numbers = json.loads(done.stdout)  # and nothing else is printed
    assert (done.returncode, numbers["rows"]) == (0, 1000)
    assert json.loads(Path("out/my_shaft.json").read_text()) == numbers
    made = {"my_shaft.json", "my_shaft.png", "my_shaft.ini", "dahl_plan_my_shaft.h"}
    assert {path.name for path in Path("out").iterdir()} >= made
    done = dahl("identify", shaft, "--name", "Left one", "-o", "other")
    assert Path("other/left_one.json").is_file() and Path("other/dahl_plan_left_one.h").is_file()
    shown = done.stdout.split("files   ")[1]
    assert shown.split(", ")[0] == "other/left_one.json"
    assert shown.strip().endswith("other/dahl_plan_left_one.h")
    done = dahl("identify", shaft, "--no-files", "--json", "x.json", "-o", "none")
    assert json.loads(Path("x.json").read_text()) == numbers
    assert "files" not in done.stdout and "no plan" not in done.stdout
    assert not Path("none").exists()


def test_the_clock_of_a_log_is_the_column_that_is_named(dahl, shaft):
    found = [
        json.loads(dahl("identify", shaft, *words, "--json", "-", "--no-files").stdout)["extra"]
        for words in (
            ("--terms", "viscous", "--time", "t"),
            ("--terms", "viscous", "--time", "clock"),
        )
    ]
    assert found[0]["viscous"] == pytest.approx(2 * found[1]["viscous"], rel=1e-3)


def test_no_plan_where_the_log_does_not_tell_both(dahl, tmp_path):
    theta = np.floor(sine(1, rows=1000, cycles=5) / COUNT) * COUNT
    path = write_csv(tmp_path / "noise.csv", theta, noise_of(1, 1000))
    done = dahl("identify", path, "-o", "out")
    assert done.returncode == 0, done.stderr
    assert "no plan for firmware: not both parameters are identifiable" in done.stdout
    assert not list(Path("out").glob("*.h"))


def test_a_log_that_memory_cannot_hold_is_one_line(dahl, shaft, monkeypatch):
    def fail(*_: object) -> None:
        raise MemoryError

    monkeypatch.setattr(pipeline, "identify", fail)
    said = "2000 rows do not fit into memory (100 bytes a row)"
    assert complaint(dahl("identify", shaft, shaft)) == (1, said)


@pytest.mark.parametrize("words", [("x.csv", "--each", "."), ("--each", ".", "--follow")])
def test_one_source_of_logs_at_a_time(dahl, words):
    code, said = complaint(dahl("identify", *words))
    assert code == 2 and said.startswith("give LOGs, or --each DIR, or --follow")


def test_each_uses_the_jobs_and_the_cluster_that_are_named(dahl, shaft, monkeypatch):
    asked = []

    def run(logs, kept, jobs, dask):
        asked.append((jobs, dask))
        return iter(())

    monkeypatch.setattr(folder_runs, "run", run)
    for words in ((), ("--jobs", 3), ("--dask", "tcp://x:1")):
        assert dahl("identify", "--each", shaft.parent, "-o", "out", *words).returncode == 0
    assert asked == [(-1, None), (3, None), (-1, "tcp://x:1")]


# --- excite ---------------------------------------------------------------------------------------


def test_the_scene_of_excite_has_the_guess_and_the_encoder(dahl):
    Path("known.json").write_text(json.dumps({"sigma0": 90, "Fc": 0.25, "linear": False}))
    turns = ("--from", "known.json", "--counts-per-turn", 16384)
    done = dahl("excite", *turns, "--name", "A b", "-o", "out")
    assert done.returncode == 0, done.stderr
    played = scene.read(Path("out/a_b.ini"))
    assert (played.sigma0, played.Fc, played.log) == (90, 0.25, "a_b.csv")
    assert played.theta_per_count == pytest.approx(COUNT) and played.title.startswith("a_b:")
    assert (played.motion["angle"], played.motion["counts_per_unit"]) == ("counts", "1")
    assert done.stdout.splitlines()[-1] == "files      out/a_b.csv, out/a_b.ini"
    Path("known.json").write_text(json.dumps({"sigma0": 3e4, "Fc": 2.7, "linear": True}))
    linear = ("--from", "known.json", "--mm", "--counts-per-turn", 10000)
    assert dahl("excite", *linear, "-o", "out").returncode == 0
    assert scene.read(Path("out/excite.ini")).Fc == 2.7
    for text in ("[]", '{"sigma0": 1}', '{"sigma0": "x", "Fc": 1}', '{"sigma0": -1, "Fc": 1}'):
        Path("known.json").write_text(text)
        said = "known.json: not what dahl identify leaves (sigma0 and Fc)"
        assert complaint(dahl("excite", *linear)) == (2, said)


# --- plan, dbc, data, report, plot ----------------------------------------------------------------


def test_a_plan_says_what_it_was_made_of(dahl):
    done = dahl("plan", "--sigma0", 3, "--fc", 7.5, "--theta-per-count", 0.25, "-o", "x.h")
    assert done.stdout == "x.h: Plan(sigma0=3.0, Fc=7.5, theta_per_count=0.25)\n"
    text = Path("x.h").read_text()
    assert "sigma0 = 3, Fc = 7.5, theta_per_count = 0.25;" in text
    assert max(map(len, text.splitlines())) <= 96 and text.count("DAHL_PLAN_X_H") == 3
    again = dahl("plan", "--sigma0", 3, "--fc", 7.5, "--theta-per-count", 0.25, "-o", "-")
    assert again.stdout == text.replace("plan_x ", "plan_shaft ").replace(
        "PLAN_X_H", "PLAN_SHAFT_H"
    )


def test_one_node_is_described_where_no_number_is_given(dahl, dbc):
    done = dahl("dbc")
    assert "\r" not in done.stdout
    one, all_of_it = (cantools.database.load_string(done.stdout), cantools.database.load_file(dbc))
    assert [each.name for each in one.messages] == [each.name for each in all_of_it.messages]


SUMMARY = {"scene_file": str(paths.SCENES / "segments.ini")}
FAULTS = {"injected": {"bad_crc": 4}, "expected": {"crc": 4, "lost": 2}}


def test_a_page_says_where_it_is_and_which_counter_is_wrong(dahl):
    numbers = {**SUMMARY, "faults": FAULTS, "node": {"crc": 4, "lost": 9}}
    Path("summary.json").write_text(json.dumps({**numbers, "control": {"max_error_rad": 0.5}}))
    Path("loop.png").write_bytes(b"\x89PNG" + bytes(3000))
    done = dahl("report", ".")
    text = Path("report.html").read_text(encoding="utf-8")
    assert done.stdout == f"report.html: {len(text) // 1024} KiB\n"
    assert re.findall(r'class="wrong">(.*?)<', text) == ["9"] and "<title>a run</title>" in text
    cells = [re.sub("<.*?>", "", cell) for cell in re.findall("<td>(.*?)</td>", text, re.DOTALL)]
    assert [cell.strip() for cell in cells] == (
        ["bad crc", "4", "crc", "4", "4", "lost", "2", "9", "max error rad", "0.5"]
        + ["crc", "4", "lost", "9"]
    )
    page = html_report.page({**SUMMARY, "faults": FAULTS, "node": {"crc": 4, "lost": 2}}, b"")
    assert 'class="wrong"' not in page and "Every fault was counted" in page
    said = "report.html: a file; the folder of a run was expected"
    assert complaint(dahl("report", "report.html")) == (2, said)


TEXTS = ("title", "bus", "time", "log", "date", "version", "command")
NUMBERS = ("ticks", "frames_sent", "frames_lost", "deadline_misses", "max_error_ulp_Fc")
NUMBERS += ("rmse_measured", "r2_measured", "bus_load", "realtime_factor")
OBJECTS = ("parameters", "control", "node", "answers_by_state", "latency_us", "jitter_us", "faults")
OBJECTS += ("units",)


SPOILED = dict.fromkeys(TEXTS, 5) | dict.fromkeys(NUMBERS, "5") | dict.fromkeys(OBJECTS, [["x"]])
SPOILED |= {"ticks": float("nan"), "frames_sent": 10**400, "latency_histogram": {}}
TIMES = {"p50": 1, "p99": 2, "max": 3}
MEASURED = {"latency_us": TIMES, "jitter_us": TIMES, "deadline_misses": 0}
SHAPES = [
    *SPOILED.items(),
    *(("latency_histogram", [pair]) for pair in ([1, -2], [1], [1, "2"], [1, 2])),
    ("latency_us", {"max": 1}),
    ("r2_measured", float("nan")),
    *(("faults", {"injected": {}} | more) for more in ({}, {"injected": {"a": "b"}})),
]


@pytest.mark.parametrize("verb", ["report", "plot"])
@pytest.mark.parametrize(("key", "spoiled"), SHAPES, ids=lambda each: str(each)[:20])
def test_each_number_of_a_summary_has_its_shape(dahl, verb, key, spoiled):
    Path("run.log").touch()
    Path("summary.json").write_text(json.dumps({**SUMMARY, key: spoiled}))
    code, said = complaint(dahl(verb, "."))
    assert code == 2 and said.startswith(f"summary.json: {key}")
    Path("summary.json").write_text(json.dumps({**SUMMARY, key: None}), encoding="utf-8-sig")
    missing = {"report": "loop.png: no such file; `dahl plot .`", "plot": "run.log: no frames"}
    assert complaint(dahl(verb, "."))[1].startswith(missing[verb])


@pytest.mark.parametrize("left_out", MEASURED)
def test_a_histogram_needs_what_is_measured_beside_it(dahl, left_out):
    known = {key: value for key, value in MEASURED.items() if key != left_out}
    Path("summary.json").write_text(json.dumps({**SUMMARY, "latency_histogram": [], **known}))
    assert "latency_histogram without" in complaint(dahl("report", "."))[1]


@pytest.mark.parametrize("verb", ["report", "plot"])
def test_a_summary_names_its_scene(dahl, verb):
    Path("run.log").touch()
    Path("summary.json").write_text('{"scene_file": 7}')
    code, said = complaint(dahl(verb, "."))
    assert code == 2 and said.startswith("summary.json: ") and "scene_file" in said
