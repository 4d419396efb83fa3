# SPDX-License-Identifier: MIT
"""`dahl demo`: what a user gets wrong is one line before anything runs; what dahl-loop is started
with; and a dahl-loop that is wrong, silent or deaf makes a failed run.
"""

from __future__ import annotations

import contextlib
import math
import os
import re
import resource
import subprocess
import sys
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import can
import numpy as np
import pytest
from dahl import Node, Plan, RunError, node
from dahl.codec import Param, ParamWrite
from demo_tools import FC, OWN, SIGMA0, TURN, another_loop, in_role, scene_of, summary_of, write_log
from identify_tools import complaint
from log_reading import drawing
from loop_tools import SCENES

pytestmark = pytest.mark.usefixtures("library", "dahl_loop", "unpainted")


@pytest.fixture
def unpainted() -> Iterator[None]:
    """A picture is an empty file here: its painting takes longest."""
    with drawing(rendered=False):
        yield


@pytest.fixture(scope="module")
def own_log(tmp_path_factory, library) -> Path:
    return write_log(tmp_path_factory.mktemp("own") / "shaft.csv")


# --- arguments ------------------------------------------------------------------------------------

NEEDED = ("--angle", "--sigma0", "--fc", "--counts-per-turn")
OF_A_LOG = (*NEEDED, "--torque", "--time", "--torque-scale", "--offset", "--spring")


def without(option: str) -> list[object]:
    at = OWN.index(option)
    return OWN[:at] + OWN[at + 2 :]


REFUSED = [
    *((["LOG", *without(one)], [one]) for one in NEEDED),
    (["LOG", *OWN, "--angle", "shft"], ["shaft.csv:1", "'shft'", "'shaft [deg]'"]),
    (["LOG", *OWN, "--fc", "-1"], ["Fc = -1"]),
    *((["LOG", *OWN, f"--counts-per-turn={n}"], ["-turn", n]) for n in ("0", "-1", "nan", "inf")),
    (["LOG", *OWN, "--bus", "canopy"], ["--bus canopy", "socketcan"]),
    (["LOG", *OWN, "--scene", "steering"], ["--scene"]),
    (["none.csv", *OWN], ["none.csv: no such file"]),
    (["none.csv"], ["none.csv: no such file"]),
    (["--scene", "none"], ["'none'", "creep", "cycloidal"]),
    *(([one, "1"], [one]) for one in OF_A_LOG),
    (["--fc", "1", "--scene", "steering"], ["--fc"]),
    (["--offset", "0", "--time", "t"], ["--offset", "--time"]),
    (["--spring", "0.3", "--angle-unit", "deg"], ["--angle-unit", "--spring"]),
    (["--scene", "segments", "--target", "m4f", "--bus", "socketcan:x"], ["--target", "can:x"]),
]


@pytest.mark.parametrize(("arguments", "words"), REFUSED)
def test_bad_arguments_are_one_line(own_log, dahl, tmp_path, arguments, words):
    given = [own_log if one == "LOG" else one for one in arguments]
    code, said = complaint(dahl("demo", *given, "--output", tmp_path))
    assert code == 2 and all(word in said for word in words), said
    assert not (tmp_path / "run.log").exists()


@pytest.mark.parametrize(
    ("column", "unit"),
    [
        ("angle", "deg"),
        ("Winkel [°]", "deg"),
        ("theta [rad]", "rad"),
        ("theta_rad", "rad"),
        ("Position [mm]", "mm"),
        ("Counts", "counts"),
        ("gradient", "deg"),
        *(("theta_mrad", "mrad"), ("angle [rev]", "turn"), ("pos [um]", "um"), ("x_m", "m")),
    ],
)
def test_the_unit_of_an_angle_is_in_its_name(dahl, column, unit):
    """As `dahl identify` reads it."""
    Path("x.csv").write_text(f"{column},T\n1,2\n")
    own = ("--torque", "T", *OWN[4:10], "--bus", "canopy")
    done = dahl("demo", "x.csv", "--angle", column, *own, "-o", "out")
    assert complaint(done)[0] == 2
    assert re.match(rf"angle .*'{re.escape(column)}' in {unit} ", done.stdout)
    assert scene_of(Path("out/own.ini"))["motion"]["angle"] == column


@pytest.mark.parametrize(
    ("unit", "counts_per_unit", "theta_per_count", "plotted", "per_unit"),
    [
        ("deg", TURN / 360, math.tau / TURN, "deg", math.degrees(1)),
        ("rad", TURN / math.tau, math.tau / TURN, "rad", 1),
        ("counts", 1, math.tau / TURN, "rad", 1),
        ("mm", TURN, 1e-3 / TURN, "mm", 1000),
        ("mrad", TURN / math.tau / 1e3, math.tau / TURN, "rad", 1),
        ("um", TURN / 1e3, 1e-3 / TURN, "m", 1),
    ],
)
def test_the_scene_of_an_own_log_is_in_its_units(
    dahl, unit, counts_per_unit, theta_per_count, plotted, per_unit
):
    Path("x.csv").write_text("a #1,T\n0,1\n")
    words = ("--angle", "a #1", "--torque", "T", *OWN[4:10], "--angle-unit", unit)
    words += ("--bus", "canopy")  # refused once the scene is written
    assert dahl("demo", "x.csv", *words, "-o", "out").returncode == 2
    scene = scene_of(Path("out/own.ini"))
    number = {name: float(scene["friction"][name]) for name in ("sigma0", "Fc", "theta_per_count")}
    assert number == pytest.approx({"sigma0": SIGMA0, "Fc": FC, "theta_per_count": theta_per_count})
    assert float(scene["motion"]["counts_per_unit"]) == pytest.approx(counts_per_unit, rel=1e-15)
    measured = scene["measured"]
    assert (measured["torque"], scene["motion"]["angle"]) == ("T", "a #1")
    assert measured["label_angle"].endswith(f" [{plotted}]")
    assert measured["label_torque"].endswith(" [N]" if unit in ("mm", "um") else " [N m]")
    assert float(measured["angle_scale"]) == pytest.approx(per_unit, rel=1e-15)


@pytest.mark.parametrize(("unit", "turn"), [("deg", 360), ("rad", math.tau), ("counts", 16384)])
def test_an_angle_that_starts_anew_at_each_turn_is_unwrapped(dahl, unit, turn):
    """A scene that replays such a log itself is refused: the shaft would turn back in one tick."""
    angle = np.arange(800) % 360 / 360 * turn
    Path("wraps.csv").write_text("a,T\n" + "".join(f"{one!r},0\n" for one in angle.tolist()))
    words = ("--angle", "a", "--angle-unit", unit, "--torque", "T", *OWN[4:10], "--bus", "canopy")
    assert "canopy" in complaint(dahl("demo", "wraps.csv", *words, "-o", "out"))[1]
    played = np.loadtxt("out/own.csv", delimiter=",", skiprows=1)[:, 0]
    np.testing.assert_allclose(played, np.arange(800) / 360 * turn)
    scene = Path("out/own.ini").read_text().replace("own.csv", "wraps.csv")
    Path("wraps.ini").write_text(scene)
    code, said = complaint(dahl("demo", "--scene", "wraps.ini", "-o", "again"))
    assert code == 2 and said.startswith("wraps.csv: ") and f"{angle[359]:g} to 0" in said


def test_a_way_in_mm_has_no_turn(dahl):
    """A rig that is put back by hand jumps as far as it likes; parts of a count are taken."""
    Path("x.csv").write_text("a\n" + "".join(f"{n % 10 * 500}\n" for n in range(20)))
    words = ("--angle", "a", "--angle-unit", "mm", *OWN[4:8], "--counts-per-turn", 99.5)
    assert dahl("demo", "x.csv", *words, "--bus", "socketcand", "-o", "out").returncode == 0


def test_a_bad_row_is_named_before_anything_runs(own_log, dahl):
    Path("bad.csv").write_text(own_log.read_text().replace("\n0.003,", "\n0.003,x", 1))
    code, said = complaint(dahl("demo", "bad.csv", *OWN, "--output", "out"))
    assert code == 2 and said.startswith("bad.csv:5: ") and "'shaft [deg]'" in said
    assert not Path("out/run.log").exists()


NAMES = ["loop.png", "params.m4f.bin", "own.ini", "node.json", "run.log", "summary.json"]


@pytest.mark.parametrize("name", [*NAMES, "trace.csv", "node.err"])
def test_no_output_of_a_demo_may_be_its_log(dahl, name):
    """Nor that of its scene."""
    Path(name).write_text("a\n1\n")
    Path("scene").write_text(f"[motion]\nkind = log\nfile = {name}\nangle = a\n")
    for words in ((name,), ("--scene", "scene")):
        code, said = complaint(dahl("demo", *words, "--output", "."))
        assert code == 2 and f"{name}: " in said and "-o" in said
    assert Path(name).read_text() == "a\n1\n"


def test_a_file_that_cannot_be_written_is_one_line(dahl):
    """Of a rotor's trace too, in the run that waits for the recorder: a disk that is full at its
    end.
    """
    Path("file").write_text("")
    words = ("demo", "--scene", "segments", "--output", "file/out")
    code, said = complaint(dahl(*words))
    assert code == 1 and said.startswith("file/out: ")
    for name in ("trace.csv", "run.log"):
        Path(name).unlink(missing_ok=True)
        Path(name).symlink_to("/dev/full")
        done = dahl("demo", "--scene", "parking", "--seconds", 0.3, "--output", ".")
        code, said = complaint(done)
        assert code == 1 and said.endswith(f"{name}: No space left on device")
        Path(name).unlink()


@pytest.mark.parametrize(("limit", "name"), [(50003, "run.log"), (0, "node.err")])
def test_a_full_disk_leaves_whole_lines(run_dahl, tmp_path, limit, name):
    """As many as fit: a limit of the file's size cuts one as a full disk does. It may hold no word
    of dahl-loop.
    """
    words = ("demo", "--scene", "steering", "--seconds", "2", "--bus", "socketcand")
    done = run_dahl(
        *words,
        *("--output", tmp_path),
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit)),
    )
    file = tmp_path / name
    assert complaint(done) == (1, f"{file}: File too large")
    if limit:
        assert file.read_bytes().endswith(b"\n") and limit - 50 < file.stat().st_size <= limit


# --- what dahl-loop is started with ---------------------------------------------------------------

REAL = ("node", "encoder")
RUNS = [
    (("--scene", "segments", "--bus", "socketcand", "--seed", 0), REAL, {"--seed": "0"}),
    (("--scene", "creep"), ("both",), {"--virtual": None, "--trace": "out/trace.csv"}),
    (("--scene", "fault-storm", "--seed", 7), ("both",), {"--virtual": None, "--seed": "7"}),
    (("--scene", "own.ini", "--bus", "socketcand"), REAL, {"--log-file": "own.csv"}),
]
OF_ENCODER = ("--virtual", "--trace", "--seed", "--log-file", "--lockstep", "--seconds")


def told_to(loop_said: Path) -> dict[str, dict[str, str | None]]:
    """Each option and its value, by the role of the program that was started with them."""
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
    """What a run before left is not taken for this one's."""
    script = f'echo "$*" >>{tmp_path}/told\nexec "$LOOP" "$@"'
    monkeypatch.setenv("DAHL_LOOP", str(another_loop(tmp_path / "bin", script)))
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
    started = told_to(tmp_path / "told")
    assert set(started) == set(roles)
    motion = started[roles[-1]]  # the program that moves
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


# --- a dahl-loop that is another ------------------------------------------------------------------


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
def test_what_dahl_loop_complains_about_is_told(dahl, monkeypatch, tmp_path, script, code, words):
    monkeypatch.setenv("DAHL_LOOP", str(another_loop(tmp_path / "bin", script)))
    found = complaint(dahl("demo", "--scene", "segments", "--bus", "socketcand", "--output", "out"))
    assert found[0] == code and re.search(words, found[1]), found


AFTERWARDS = """for word; do [ "$last" = --summary ] && file=$word; last=$word; done
"$LOOP" $(echo "$*" | sed 's/--with-parent [0-9]*//'); code=$?
sed -i '0,/"{name}":[[:space:]]*[0-9]*/s//"{name}": {value}/' "$file"; exit $code"""
NO_FAULTS = AFTERWARDS.replace(
    AFTERWARDS.splitlines()[2], "sed -i s/faults/others/ $file; exit $code"
)
BEHIND = [  # of a node and of a summary that are not as they should be: what is told of it
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
def test_a_run_that_was_wrong_has_another_code_than_0(
    dahl, monkeypatch, tmp_path, scene, script, words
):
    """A sigma0 one float away; a frame without an answer; a fault that was not counted; frames that
    nobody meant to spoil, and that are not there. The files are there all the same.
    """
    Path("slip.ini").write_text(SLIP)
    monkeypatch.setenv("DAHL_LOOP", str(another_loop(tmp_path / "bin", script)))
    done = dahl("demo", "--scene", scene, "--seconds", "0.6", "--output", "out")
    code, said = complaint(done)
    assert code == 1 and said.startswith("out/summary.json: ") and re.search(words, said), said
    assert summary_of(Path("out"))["max_error_ulp_Fc"] < 1.5
    assert Path("out/loop.png").exists()


DEAF = "$LOOP $(echo \"$*\" | sed 's/--with-parent [0-9]*//'); exec sleep 60"
QUIET = 'set -- "$@" --set status.period_ms=60000'
HANGING = {  # where a demo would wait for ever: scene, dahl-loop, what is told
    "silent": ("segments", in_role("encoder", "exec sleep 60", QUIET), "10"),
    "deaf": ("segments", in_role("node", f"trap '' INT; echo $$ >$0.pid; {DEAF}"), "-9"),
    "unserved": ("segments", "exec sleep 60", "(node)"),
    "still": ("creep", 'exec "$LOOP" "$@" --wait-clients 2', "10"),
}


@pytest.fixture(scope="module", autouse=True)
def hanging(request, tmp_path_factory, library, dahl_loop) -> Iterator[dict[str, subprocess.Popen]]:
    """A demo of each, which waits while the other tests of this file run."""
    running = {}
    chosen = " ".join(item.name for item in request.session.items)
    for name in [name for name in HANGING if f"for_ever[{name}]" in chosen]:
        scene, script, _ = HANGING[name]
        loop = another_loop(tmp_path_factory.mktemp(name), script)
        words = ("demo", "--scene", scene, "--seconds", "0.2", "--output", loop.parent / "out")
        words += ("--bus", "socketcand") if scene == "segments" else ()
        running[name] = subprocess.Popen(
            ["timeout", "45", sys.executable, "-m", "dahl", *map(str, words)],
            env={**os.environ, "DAHL_LOOP": str(loop)},
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
        )
    yield running
    for process in running.values():
        process.terminate()
        process.communicate()


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
    """It is asked for by the preset of its core, in the checkout."""
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
    """A node in Python joins the served bus as the firmware does; nobody else has its number."""
    asked.append((core, params, folder, number))
    settings = {"interface": "socketcand", "channel": "vcan0", "host": "127.0.0.1", "port": port}
    with can.Bus(**settings) as bus:
        with pytest.raises(RunError, match=f"node {number} "):
            node.ask(bus, ParamWrite(Param.MODEL), number, timeout=0.2)
        notifier = can.Notifier(bus, [node.Listener(bus, Node(Plan(*params), number))])
        try:
            yield
        finally:
            notifier.stop()


def test_a_target_takes_the_place_of_the_node(dahl, monkeypatch, root):
    """An exception to the public seams: the emulator, which takes seconds, is replaced at its two
    calls. dahl-loop's own node is never asked.
    """
    asked: list[tuple[object, ...]] = []
    monkeypatch.setattr("dahl.sim.firmware.build", lambda core: root / "build/m4f/node_image")
    monkeypatch.setattr("dahl.sim.firmware.attach_firmware", partial(attached, asked))
    words = ("--scene", "segments", "--seconds", 0.3, "--target", "m4f")
    for _ in range(4):  # the node in Python may be late on a busy machine, and is told so
        done = dahl("demo", *words, "--output", "out")
        if done.returncode == 0 or "no answer in time" not in done.stderr:
            break
    assert done.returncode == 0, done.stderr
    numbers = summary_of(Path("out"))
    assert set(asked) == {("m4f", (50.0, 0.5, 9.587379924285257e-05), Path("out"), 0)}
    assert (numbers["target"], numbers["node"], numbers["frames_answered"]) == ("m4f", {}, 300)
    assert numbers["max_error_ulp_Fc"] <= 0.52
    assert "build/m4f/node_image" in done.stdout and "QEMU" in done.stdout


# --- a run that waits (the last here: see `hanging`) ----------------------------------------------


@pytest.mark.parametrize("name", HANGING)
def test_a_demo_waits_for_nothing_for_ever(hanging, name):
    """An encoder that says nothing, a node that does not end or serves no bus, virtual time that
    stands still; and no program is left behind.
    """
    process = hanging[name]
    _, said = process.communicate(timeout=60)
    assert process.returncode == 1 and said.startswith("error: ") and said.count("\n") == 1, said
    assert HANGING[name][2] in said
    if name == "deaf":
        (left,) = Path(process.args[process.args.index("--output") + 1]).parent.glob("*.pid")
        assert not Path(f"/proc/{left.read_text().strip()}").exists()
