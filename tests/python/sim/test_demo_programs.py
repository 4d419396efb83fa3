# SPDX-License-Identifier: MIT
"""`dahl demo` and the programs that it starts: the scene that it writes, the options that it gives
to dahl-loop, and a dahl-loop or firmware that fails, hangs or gives wrong answers.
"""

from __future__ import annotations

import contextlib
import math
import os
import re
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import can
import numpy as np
import pytest
from dahl import Node, Plan, RunError, node
from dahl.codec import Param, ParamWrite
from dahl.sim import loop
from demo_tools import FC, OWN, SIGMA0, TURN, in_role, scene_of, summary_of, write_loop
from identify_tools import complaint
from log_reading import drawing
from loop_tools import SCENES, is_running

pytestmark = pytest.mark.usefixtures("library", "dahl_loop", "unpainted")


@pytest.fixture
def unpainted() -> Iterator[None]:
    """Save each picture as an empty file, since drawing takes longest."""
    with drawing(rendered=False):
        yield


# --- own logs -------------------------------------------------------------------------------------


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
    Path("x.csv").write_text(f"{column},T\n0,1\n")
    words = (
        "--angle",
        column,
        "--torque",
        "T",
        *OWN[4:10],
        *(given and ("--angle-unit", given) or ()),
    )
    done = dahl("demo", "x.csv", *words, "--bus", "canopy", "-o", "out")
    assert complaint(done)[0] == 2  # the bus, once the scene is written
    assert re.match(rf"angle .*'{re.escape(column)}' in {unit} ", done.stdout)
    scene, is_linear = scene_of(Path("out/own.ini")), unit in ("mm", "um", "m")
    number = {name: float(scene["friction"][name]) for name in ("sigma0", "Fc", "theta_per_count")}
    theta = (1e-3 if is_linear else math.tau) / TURN
    assert number == pytest.approx({"sigma0": SIGMA0, "Fc": FC, "theta_per_count": theta})
    assert float(scene["motion"]["counts_per_unit"]) == pytest.approx(per_unit, rel=1e-15)
    measured = scene["measured"]
    assert (measured["torque"], scene["motion"]["angle"]) == ("T", column)
    assert measured["label_angle"].endswith(f" [{plotted}]")
    assert measured["label_torque"].endswith(" [N]" if is_linear else " [N m]")
    assert float(measured["angle_scale"]) == pytest.approx(scale, rel=1e-15)


@pytest.mark.parametrize(("unit", "turn"), [("deg", 360), ("rad", math.tau), ("counts", 16384)])
def test_an_angle_that_wraps_at_each_turn_is_unwrapped(dahl, unit, turn):
    angle = np.arange(800) % 360 / 360 * turn
    Path("wraps.csv").write_text("a,T\n" + "".join(f"{one!r},0\n" for one in angle.tolist()))
    words = ("--angle", "a", "--angle-unit", unit, "--torque", "T", *OWN[4:10], "--bus", "canopy")
    assert "canopy" in complaint(dahl("demo", "wraps.csv", *words, "-o", "out"))[1]
    played = np.loadtxt("out/own.csv", delimiter=",", skiprows=1)[:, 0]
    np.testing.assert_allclose(played, np.arange(800) / 360 * turn)
    scene = Path("out/own.ini").read_text().replace("own.csv", "wraps.csv")
    Path("wraps.ini").write_text(scene)
    code, line = complaint(dahl("demo", "--scene", "wraps.ini", "-o", "again"))
    assert code == 2 and line.startswith("wraps.csv: ") and f"{angle[359]:g} to 0" in line


@pytest.mark.parametrize(
    ("time_column", "torque"), [((), ()), (("--time", "t"), ("--torque", "T"))]
)
def test_an_own_log_is_drawn_again_from_any_folder(dahl, monkeypatch, time_column, torque):
    angles = 20 * np.sin(np.arange(200) / 30)
    rows = [f"{n / 1000},{5 - n % 7},{angle}" for n, angle in enumerate(angles)]
    (folder := Path("b ;c")).mkdir()  # a folder may have any name
    (folder / "a.csv").write_text("\n".join(["t,T,a", *rows]) + "\n")
    words = ("--angle", "a", *OWN[4:10], *time_column, *torque, "--bus", "socketcand")
    assert dahl("demo", folder / "a.csv", *words, "-o", "out").returncode == 0
    told = summary_of(Path("out"))
    assert (told["ticks"], told["title"]) == (200, "a.csv")
    assert (told["r2_measured"] is None) == (torque == ())
    out = Path("out").resolve()
    monkeypatch.chdir(folder)
    assert "200 ticks, a.csv" in dahl("plot", out).stdout


def test_a_scene_of_any_editor_is_played_and_shown(dahl):
    text = (SCENES / "segments.ini").read_text().replace("Three", "Lenkung ä² <b>")
    Path("my.ini").write_text(text.replace("\n", "\r\n"), encoding="utf-8-sig", newline="")
    words = ("--scene", "my.ini", "--seconds", 0.2, "--bus", "socketcand", "--output", "out")
    assert dahl("demo", *words).returncode == 0
    assert summary_of(Path("out"))["title"].startswith("Lenkung ä² <b>")
    assert dahl("report", "out").returncode == 0
    assert "<title>Lenkung ä² &lt;b&gt;" in Path("out/report.html").read_text(encoding="utf-8")


# --- what dahl-loop is started with ---------------------------------------------------------------

REAL = ("node", "encoder")
RUNS = [
    (("--scene", "segments", "--bus", "socketcand", "--seed", 0), REAL, {"--seed": "0"}),
    (("--scene", "creep"), ("both",), {"--virtual": None, "--trace": "out/trace.csv"}),
    (("--scene", "fault-storm", "--seed", 7), ("both",), {"--virtual": None, "--seed": "7"}),
    (("--scene", "own.ini", "--bus", "socketcand"), REAL, {"--log-file": "own.csv"}),
]
OF_ENCODER = ("--virtual", "--trace", "--seed", "--log-file", "--lockstep", "--seconds")


def options_by_role(loop_said: Path) -> dict[str, dict[str, str | None]]:
    started = {}
    for line in (line.split() for line in loop_said.read_text().splitlines()):
        following = [*line[1:], "--"]
        pairs = {a: b for a, b in zip(line, following, strict=True) if a.startswith("--")}
        started[pairs["--role"]] = {a: None if b[:2] == "--" else b for a, b in pairs.items()}
    return started


@pytest.mark.parametrize(("words", "roles", "chosen"), RUNS, ids=lambda each: str(each)[:40])
def test_each_demo_starts_the_programs_that_it_needs(
    dahl, monkeypatch, tmp_path, words, roles, chosen
):
    script = f'echo "$*" >>{tmp_path}/told\nexec "$LOOP" "$@"'
    monkeypatch.setenv("DAHL_LOOP", str(write_loop(tmp_path / "bin", script)))
    Path("own.ini").write_text(
        "[scene]\ntitle = mine\n[friction]\nsigma0 = 50\nFc = 0.5\ntheta_per_count = 1e-4\n"
        "[motion]\nkind = log\nfile = own.csv\nangle = a\ncounts_per_unit = 1\n"
    )
    Path("own.csv").write_text("\n".join(["a", *map(str, range(400))]))
    Path("out").mkdir()
    for name in (*roles, "summary"):
        Path(f"out/{name}.json").write_text('{"ticks": 99, "node": {"crc": 70000}}')
    done = dahl("demo", *words, "--seconds", 0.2, "--output", "out")
    assert done.returncode == 0, done.stderr
    started = options_by_role(tmp_path / "told")
    assert set(started) == set(roles)
    motion = started[roles[-1]]
    assert Path(motion["--scene"]).stem == Path(words[1]).stem
    wanted = chosen | {"--seconds": "0.2"}
    assert {key: motion[key] for key in OF_ENCODER if key in motion} == wanted
    assert {role["--with-parent"] for role in started.values()} == {str(os.getpid())}
    numbers = summary_of(Path("out"))
    log = str(tmp_path / "own.csv") if "--log-file" in chosen else None
    assert (numbers["log"], numbers["ticks"]) == (log, 200)
    assert numbers["node"]["crc"] < 70000
    shown = done.stdout.partition("bus ")[2].split("\n")[0]
    assert ("virtual time" in shown) == (len(roles) == 1)
    if len(roles) > 1:
        assert {"--lockstep", "--until-idle"} <= started["node"].keys()
        assert not {"--seconds", "--seed"} & started["node"].keys()


# --- a dahl-loop with a fault ---------------------------------------------------------------------


@pytest.mark.parametrize(
    ("script", "code", "words"),
    [
        ("exit 0", 1, r"\(node\).* port"),
        ("exit 3", 1, r"\(node\).* 3"),
        ("echo x; echo error: no wheel >&2; exit 2", 2, "^no wheel$"),
        ("echo error: no bus >&2; exit 1", 1, "^no bus$"),
        ("echo odd >&2; echo '  error: no rig ' >&2; echo error: two >&2; exit 1", 1, "^no rig$"),
        ("kill -TERM $$", 1, r"\(node\).* -15"),
        ("kill -INT $$", 1, r"\(node\).* -2"),
    ],
)
def test_an_error_of_dahl_loop_is_passed_on(dahl, monkeypatch, tmp_path, script, code, words):
    monkeypatch.setenv("DAHL_LOOP", str(write_loop(tmp_path / "bin", script)))
    found = complaint(dahl("demo", "--scene", "segments", "--bus", "socketcand", "--output", "out"))
    assert found[0] == code and re.search(words, found[1]), found


AFTERWARDS = """for word; do [ "$last" = --summary ] && file=$word; last=$word; done
"$LOOP" $(echo "$*" | sed 's/--with-parent [0-9]*//'); code=$?
sed -i '0,/"{name}":[[:space:]]*[0-9]*/s//"{name}": {value}/' "$file"; exit $code"""
NO_FAULTS = AFTERWARDS.replace(
    AFTERWARDS.splitlines()[2], "sed -i s/faults/others/ $file; exit $code"
)
BEHIND = [  # scene, a dahl-loop with a fault, pattern of the message
    ("segments", in_role("node", 'set -- "$@" --set friction.sigma0=50.000008'), "ulp.* 0.52"),
    ("segments", AFTERWARDS.format(name="frames_lost", value=2), "2 frames"),
    ("fault-storm", AFTERWARDS.format(name="crc", value=99999), "'crc': .99999, "),
    ("fault-storm", NO_FAULTS, r"\d frames .*\d frames"),
    ("slip.ini", in_role("node", 'set -- "$@" --set friction.sigma0=50.000004'), "ulp.* 0.55"),
]
SLIP = (SCENES / "segments.ini").read_text().replace("[friction]", "[friction]\nmodel = slip")


@pytest.mark.parametrize(
    ("scene", "script", "words"), BEHIND, ids=["error", "lost", "faults", "missing", "slip"]
)
def test_a_wrong_run_exits_with_1_and_keeps_its_files(
    dahl, monkeypatch, tmp_path, scene, script, words
):
    """sigma0 one float away, an unanswered frame, a wrong count of faults, no count of faults."""
    Path("slip.ini").write_text(SLIP)
    monkeypatch.setenv("DAHL_LOOP", str(write_loop(tmp_path / "bin", script)))
    done = dahl("demo", "--scene", scene, "--seconds", "0.6", "--output", "out")
    code, said = complaint(done)
    assert code == 1 and said.startswith("out/summary.json: ") and re.search(words, said), said
    assert summary_of(Path("out"))["max_error_ulp_Fc"] < 1.5
    assert Path("out/loop.png").exists()


DEAF = "$LOOP $(echo \"$*\" | sed 's/--with-parent [0-9]*//'); exec sleep 60"
QUIET = 'set -- "$@" --set status.period_ms=60000'
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
        monkeypatch.setattr("dahl.sim.loop.PROGRAM_TIMEOUT_S", 0.5)
    monkeypatch.setattr("dahl.sim.loop.MAX_SILENCE_S", 0.5)
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


def test_firmware_replaces_the_node_of_dahl_loop(dahl, monkeypatch, root):
    """The emulator takes seconds, so its two calls are replaced."""
    asked: list[tuple[object, ...]] = []
    monkeypatch.setattr("dahl.sim.firmware.build", lambda core: root / "build/m4f/node_image")
    monkeypatch.setattr("dahl.sim.firmware.attach_firmware", partial(attached, asked))
    words = ("--scene", "segments", "--seconds", 0.3, "--target", "m4f")
    done = dahl("demo", *words, "--output", "out")
    assert done.returncode == 0, done.stderr
    numbers = summary_of(Path("out"))
    assert set(asked) == {("m4f", (50.0, 0.5, 9.587379924285257e-05), Path("out"), 0)}
    assert (numbers["target"], numbers["node"], numbers["frames_answered"]) == ("m4f", {}, 300)
    assert numbers["max_error_ulp_Fc"] <= 0.52
    assert "build/m4f/node_image" in done.stdout and "QEMU" in done.stdout


def test_a_run_whose_recorder_was_dropped_is_not_compared(dahl, monkeypatch, tmp_path):
    """By the count of the server: faults on the bus hide the loss from the sequence counters."""
    real = loop.Program.numbers
    counts = {"bus_counts": {"dropped": 1}}
    monkeypatch.setattr(loop.Program, "numbers", lambda program: real(program) | counts)
    done = dahl("demo", "--scene", "fault-storm", "--seconds", "1", "-o", tmp_path / "out")
    assert done.returncode == 1 and "read too slowly" in done.stdout + done.stderr
    assert summary_of(tmp_path / "out")["max_error_ulp_Fc"] is None
