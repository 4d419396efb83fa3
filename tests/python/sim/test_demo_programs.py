# SPDX-License-Identifier: MIT
"""`dahl demo` and the programs that it starts: the scene that it writes, the options that it gives
to dahl-loop, and a dahl-loop or firmware that fails, hangs or gives wrong answers.
"""

import contextlib
import math
import re
import subprocess
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import can
import numpy as np
import pytest
from dahl import Node, Plan, RunError, node
from dahl.codec import Param, ParamWrite
from dahl.sim import recorded_run
from demo_tools import FC, OWN, SIGMA0, TURN, in_role, scene_of, summary_of, write_loop
from identify_tools import complaint
from log_reading import drawing
from loop_tools import REPLAY, SCENES, is_running

pytestmark = pytest.mark.usefixtures("library", "dahl_loop", "unpainted")


@pytest.fixture
def unpainted() -> Iterator[None]:
    """Save each picture as an empty file, since drawing takes longest."""
    with drawing(rendered=False):
        yield


# --- own logs -------------------------------------------------------------------------------------


SHAFT = OWN[4:10]  # sigma0, Fc and counts per turn
TURN_MM, PER_RAD = TURN / 1e3, math.degrees(1)
COLUMNS = [  # column, unit by option or name, counts per unit, plotted unit, and that in SI
    ("angle", None, "deg", TURN / 360, "deg", PER_RAD),
    ("theta_mrad", None, "mrad", TURN / math.tau / 1e3, "rad", 1),
    ("angle [rev]", None, "turn", TURN, "rad", 1),
    ("Position [mm]", None, "mm", TURN, "mm", 1000),
    ("pos [um]", None, "um", TURN_MM, "m", 1),
    ("Counts", None, "counts", 1, "rad", 1),
    ("a #1", "rad", "rad", TURN / math.tau, "rad", 1),
    ("angle", "mm", "mm", TURN, "mm", 1000),
]


@pytest.mark.parametrize(("column", "given", "unit", "per_unit", "plotted", "scale"), COLUMNS)
def test_the_scene_of_an_own_log_is_in_its_units(
    dahl, column, given, unit, per_unit, plotted, scale
):
    Path("x.csv").write_text(f"{column},T,t\n0,4,0\n")
    words = ["--angle", column, "--torque", "T", "--time", "t", *SHAFT, "--torque-scale", -0.5]
    words += ["--offset", 0.07, "--spring", 3, *(("--angle-unit", given) if given else ())]
    done = dahl("demo", "x.csv", *words, "--bus", "canopy", "-o", "out")
    assert complaint(done)[0] == 2  # the bus, once the scene is written
    assert re.match(rf"angle .*'{re.escape(column)}' in {unit} ", done.stdout)
    is_linear, scene = unit in ("mm", "um"), scene_of(Path("out/own.ini"))
    theta, force = (1e-3, "N") if is_linear else (math.tau, "N m")
    texts = {"title": "x.csv", "kind": "log", "file": "own.csv"}
    texts |= {"angle": column, "torque": "T", "time": "t"}
    texts |= {"label_angle": f"{column} from the start [{plotted}]"}
    texts |= {"label_torque": f"friction [{force}]"}
    numbers = {"sigma0": SIGMA0, "Fc": FC, "theta_per_count": theta / TURN}
    numbers |= {"counts_per_unit": per_unit, "period_ms": 100}
    numbers |= {"offset": 0.07, "spring": 3, "angle_scale": scale}
    found = {key: text for section in scene.values() for key, text in section.items()}
    assert {key: found.pop(key) for key in texts} == texts
    assert {key: float(text) for key, text in found.items()} == pytest.approx(numbers, rel=1e-15)
    assert np.loadtxt("out/own.csv", delimiter=",", skiprows=1)[1] == -2  # of the torque


@pytest.mark.parametrize(("unit", "turn"), [("deg", 360), ("rad", math.tau), ("counts", 16384)])
def test_an_angle_that_wraps_at_each_turn_is_unwrapped(dahl, unit, turn):
    angle = np.arange(800) % 360 / 360 * turn
    Path("wraps.csv").write_text("a,T\n" + "".join(f"{one!r},0\n" for one in angle.tolist()))
    words = ("--angle", "a", "--angle-unit", unit, "--torque", "T", *SHAFT, "--bus", "canopy")
    assert "canopy" in complaint(dahl("demo", "wraps.csv", *words, "-o", "out"))[1]
    played = np.loadtxt("out/own.csv", delimiter=",", skiprows=1)[:, 0]
    np.testing.assert_allclose(played, np.arange(800) / 360 * turn)
    scene = Path("out/own.ini").read_text().replace("own.csv", "wraps.csv")
    Path("wraps.ini").write_text(scene)
    code, line = complaint(dahl("demo", "--scene", "wraps.ini", "-o", "again"))
    assert code == 2 and line.startswith("wraps.csv: ") and f"{angle[359]:g} to 0" in line


@pytest.mark.parametrize("columns", [(), ("--time", "t", "--torque", "T")])
def test_an_own_log_is_drawn_again_from_any_folder(dahl, monkeypatch, columns):
    angles = 20 * np.sin(np.arange(200) / 30)
    rows = [f"{n / 1000},{5 - n % 7},{angle}" for n, angle in enumerate(angles)]
    (folder := Path("b ;c")).mkdir()  # a folder may have any name
    (folder / "a.csv").write_text("\n".join(["t,T,a", *rows]) + "\n")
    words = ("--angle", "a", *SHAFT, *columns, "--bus", "socketcand")
    assert dahl("demo", folder / "a.csv", *words, "-o", "out").returncode == 0
    numbers = summary_of(Path("out"))
    assert (numbers["ticks"], numbers["title"]) == (200, "a.csv")
    assert (numbers["r2_measured"] is None) == (columns == ())
    out = Path("out").resolve()
    monkeypatch.chdir(folder)
    assert "200 ticks, a.csv" in dahl("plot", out).stdout


# --- a run follows its options --------------------------------------------------------------------

RUNS = [  # words, facts of the summary
    ("--scene segments --bus socketcand --seed 0", {"time": "real", "seed": 0, "log": None}),
    ("--scene creep", {"time": "virtual", "seed": 1, "log": None}),
    ("--scene fault-storm --seed 7", {"time": "virtual", "seed": 7, "log": None}),
    ("--scene own.ini --bus socketcand", {"time": "real", "seed": 1, "title": "mine"}),
]


@pytest.mark.parametrize(("words", "facts"), RUNS)
def test_a_run_follows_its_options_and_not_files_of_an_earlier_run(dahl, monkeypatch, words, facts):
    """The log of the last scene is in a measured set."""
    (log := Path("sets/tribometer/a.csv").resolve()).parent.mkdir(parents=True)
    log.write_text("\n".join(["a", *map(str, range(400))]))
    monkeypatch.setenv("DAHL_DATA", str(log.parents[1]))
    Path("own.ini").write_text(REPLAY.replace("a.csv", "tribometer/a.csv"))
    Path("out").mkdir()
    Path("out/summary.json").write_text('{"ticks": 99, "node": {"crc": 70000}}')
    done = dahl("demo", *words.split(), "--seconds", 0.2, "--output", "out")
    assert done.returncode == 0, done.stderr
    numbers = summary_of(Path("out"))
    assert numbers == numbers | {"log": str(log), "ticks": 200, "frames_sent": 200} | facts
    assert numbers["node"]["crc"] < 70000
    assert Path("out/trace.csv").exists() == ("creep" in words)
    is_virtual = "virtual time" in done.stdout.partition("bus ")[2].split("\n")[0]
    assert is_virtual == (facts["time"] == "virtual")


# --- a dahl-loop with a fault ---------------------------------------------------------------------


FAILURES = [  # script in the place of dahl-loop, exit code of the demo, words of the message
    ("exit 0", 1, r"\(node\).* port"),
    ("exit 3", 1, r"\(node\).* 3"),
    ("echo x; echo error: no wheel >&2; exit 2", 2, "^no wheel$"),
    ("echo odd >&2; echo '  error: no rig ' >&2; echo error: two >&2; exit 1", 1, "^no rig$"),
    (r"printf 'error: caf\351\n' >&2; exit 2", 2, "^caf\ufffd$"),
    ("kill -INT $$", 1, r"\(node\).* -2"),
]


@pytest.mark.parametrize(("script", "code", "words"), FAILURES)
def test_an_error_of_dahl_loop_is_passed_on(dahl, monkeypatch, tmp_path, script, code, words):
    """The results of an earlier run are removed."""
    (out := Path("out")).mkdir()
    results = [out / name for name in ("summary.json", "trace.csv", "uncompensated.csv")]
    for path in results:
        path.write_text("{}")
    monkeypatch.setenv("DAHL_LOOP", str(write_loop(tmp_path / "bin", script)))
    found = complaint(dahl("demo", "--scene", "segments", "--bus", "socketcand", "--output", out))
    assert found[0] == code and re.search(words, found[1]), found
    assert not any(path.exists() for path in results)


def test_an_error_of_the_run_without_compensation_is_passed_on(dahl, monkeypatch, tmp_path):
    gain = "grep -q '^friction.gain = 0$' \"$1\""
    script = f'{gain} && {{ echo error: no gain >&2; exit 1; }}; exec "$LOOP" "$@"'
    monkeypatch.setenv("DAHL_LOOP", str(write_loop(tmp_path / "bin", script)))
    code, line = complaint(dahl("demo", "--scene", "parking", "--seconds", 0.1, "-o", "out"))
    assert code == 1 and line.endswith("without compensation: no gain")


def with_value(name: str, value: object) -> str:
    """A script that changes a value of the run file."""
    change = f"s/^{name} = .*/{name} = {value}/"
    return f"""sed '{change}' "$1" >"$0.run" && shift && set -- "$0.run" "$@" """


NODES = [  # scene, sigma0 of the node: one float away; words of the message
    ("segments", 50.000008, "ulp.* 0.52"),
    ("slip.ini", 50.000004, "ulp.* 0.55"),
]


@pytest.mark.parametrize(("scene", "sigma0", "words"), NODES)
def test_a_node_with_a_wrong_torque_exits_with_1(dahl, monkeypatch, scene, sigma0, words):
    text = (SCENES / "segments.ini").read_text()
    Path("slip.ini").write_text(text.replace("[friction]", "[friction]\nmodel = slip"))
    script = in_role("node", with_value("friction.sigma0", sigma0))
    monkeypatch.setenv("DAHL_LOOP", str(write_loop(Path("bin").resolve(), script)))
    check_failed(dahl("demo", "--scene", scene, "--seconds", "0.6", "--output", "out"), words)
    assert 0.5 < summary_of(Path("out"))["max_error_ulp_Fc"] < 1.5


def check_failed(done: subprocess.CompletedProcess, words: str) -> None:
    """The run exits with 1 and keeps its files."""
    code, line = complaint(done)
    assert code == 1 and line.startswith("out/summary.json: ") and re.search(words, line), line
    assert Path("out/loop.png").exists()


CHANGES = [  # scene, change of what dahl-loop counts, words of the message
    ("segments", {"frames_lost": 2}, "2 frames"),
    ("fault-storm", {"node": {"crc": 99999}}, "'crc': .99999, "),
    ("fault-storm", {"faults": None}, r"\d frames .*\d frames"),
    ("fault-storm", {"bus_counts": {"dropped": 1}}, "not compared: .*read too slowly"),
]


@pytest.mark.parametrize(("scene", "change", "words"), CHANGES)
def test_a_wrong_count_exits_with_1(dahl, monkeypatch, scene, change, words):
    """Unanswered frames, a wrong count of faults, none, and frames that the recorder missed."""
    real = recorded_run.Program.numbers

    def numbers(program: recorded_run.Program) -> dict:
        known = real(program)
        for name, value in change.items():
            known[name] = known.get(name, {}) | value if isinstance(value, dict) else value
        return {name: value for name, value in known.items() if value is not None}

    monkeypatch.setattr(recorded_run.Program, "numbers", numbers)
    check_failed(dahl("demo", "--scene", scene, "--seconds", "0.6", "--output", "out"), words)
    is_recorded = "bus_counts" not in change
    assert (summary_of(Path("out"))["max_error_ulp_Fc"] is not None) == is_recorded


DEAF = "$LOOP $(echo \"$*\" | sed 's/--with-parent [0-9]*//'); exec sleep 60"
QUIET = with_value("status.period_ms", 60000)
HANGING = {  # a demo that would wait for ever: scene, dahl-loop, fact of the message
    "silent": ("segments", in_role("encoder", "exec sleep 60", QUIET), "0.5 s"),
    "deaf": ("segments", in_role("node", f"trap '' INT; echo $$ >$0.pid; {DEAF}"), "-9"),
    "unserved": ("segments", "exec sleep 60", "(node)"),
    "still": ("creep", 'exec "$LOOP" "$@" --wait-clients 2', "0.5 s"),
}


@pytest.mark.parametrize("name", HANGING)
def test_a_demo_that_would_hang_ends_and_leaves_no_program(dahl, monkeypatch, tmp_path, name):
    scene, script, fact = HANGING[name]
    loop = write_loop(tmp_path / "bin", script)
    monkeypatch.setenv("DAHL_LOOP", str(loop))
    if name == "unserved":
        monkeypatch.setattr("dahl.sim.recorded_run.PROGRAM_TIMEOUT_S", 0.5)
    monkeypatch.setattr("dahl.sim.recorded_run.MAX_SILENCE_S", 0.5)
    bus = ("--bus", "socketcand") if scene == "segments" else ()
    code, said = complaint(dahl("demo", "--scene", scene, "--seconds", "0.2", *bus, "-o", "out"))
    assert code == 1 and fact in said
    if name == "deaf":
        assert not is_running(int(loop.with_name("loop.pid").read_text()))


# --- firmware in the place of the node ------------------------------------------------------------

BUILDS = [
    ("echo odd >&2; echo broken tool >&2; exit 1", "m4f .*: broken tool$"),
    ("echo only here; exit 1", "tools/setup.sh firmware .*: only here$"),
    ("printf 'odd\\nfatal: no host\\n  where (include)\\n' >&2; exit 1", ": fatal: no host$"),
    (None, "cmake .*tools/setup.sh"),
]


@pytest.mark.parametrize(("script", "words"), BUILDS)
def test_an_image_that_cannot_be_built_is_one_line(
    dahl, monkeypatch, tmp_path, root, script, words
):
    if script:
        asked = f'echo "$PWD: $*" >>{tmp_path}/asked'
        (tmp_path / "cmake").write_text(f"#!/bin/sh\n{asked}\n{script}\n")
        (tmp_path / "cmake").chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}:/usr/bin:/bin" if script else str(tmp_path))
    for verb in (("node",), ("demo", "--scene", "segments", "-o", "out")):
        code, said = complaint(dahl(*verb, "--target", "m4f"))
        assert code == 1 and re.search(words, said), said
    if script:
        assert (tmp_path / "asked").read_text().startswith(f"{root}: --preset m4f")


@contextlib.contextmanager
def attached(asked, core, params, folder, port, number) -> Iterator[None]:
    """Join the served bus with a node in Python, as the firmware does. Its number is free."""
    asked.append((core, params, folder, number))
    settings = {"interface": "socketcand", "channel": "vcan0", "host": "127.0.0.1", "port": port}
    with can.Bus(**settings) as bus:
        with pytest.raises(RunError, match=f"node {number} "):
            node.ask(bus, ParamWrite(Param.MODEL), number, timeout=0.2)
        notifier = can.Notifier(bus, [node.Listener(bus, Node(Plan(*params), number, timeout=60))])
        try:
            yield
        finally:
            notifier.stop()


@pytest.mark.parametrize("number", [14, 15])
def test_firmware_replaces_the_node_of_dahl_loop(dahl, monkeypatch, root, number):
    """The emulator takes seconds, so its two calls are replaced."""
    text = (SCENES / "segments.ini").read_text()
    Path("own.ini").write_text(text.replace("[friction]", f"[friction]\nnode = {number}"))
    asked: list[tuple[object, ...]] = []
    monkeypatch.setattr("dahl.target.firmware.build", lambda core: root / "build/m4f/node_image")
    monkeypatch.setattr("dahl.target.firmware.attach_firmware", partial(attached, asked))
    words = ("--scene", "own.ini", "--seconds", 0.3, "--target", "m4f")
    done = dahl("demo", *words, "--output", "out")
    assert done.returncode == 0, done.stderr
    numbers = summary_of(Path("out"))
    assert asked == [("m4f", (50.0, 0.5, 9.587379924285257e-05), Path("out"), number)]
    assert (numbers["target"], numbers["node"], numbers["frames_answered"]) == ("m4f", {}, 300)
    assert numbers["max_error_ulp_Fc"] <= 0.52
    assert "build/m4f/node_image" in done.stdout and "QEMU" in done.stdout
