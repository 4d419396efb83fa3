# SPDX-License-Identifier: MIT
"""`dahl commission`: a simulated axis, the recording of a table, and drives on a bus. All have the
simulated shaft, whose parameters are the truth.
"""

import ctypes
import importlib
import json
import re
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace

import can
import numpy as np
import pytest
from bus_frames import new_channel
from conftest import ROOT
from dahl.binding.commission import REASONS, SWEEP_SPEEDS, Command
from dahl.binding.compensator import Compensator
from dahl.binding.library import c
from dahl.can import drives
from dahl.report.commission import Report
from dahl.sim import axis as simulation
from dahl.sim.axis import COUNTS_PER_TURN, FC, GRAVITY, INERTIA, SIGMA0, VISCOUS, Shaft
from identify_tools import complaint
from programs import run, shared_object

TRUTH = {"Fc": FC, "sigma0": SIGMA0, "length": FC / SIGMA0, "inertia": INERTIA, "delay": 1e-3}
TRUTH |= {"viscous": VISCOUS}
WITHOUT_UNIT = {"breakaway", "gain", "elastic"}  # ratios, and a flag


def assert_true(numbers: dict, names=tuple(TRUTH)) -> None:
    for name in names:
        one = numbers["result"][name]
        assert one["least"] <= TRUTH[name] <= one["most"], name
    error = numbers["result"]["load_error"]
    load = GRAVITY * np.cos(numbers["sweeps"]["angle"])
    assert numbers["result"]["load"] == pytest.approx(load, abs=error)


def test_a_simulated_axis_is_commissioned(dahl, root: Path, tmp_path: Path) -> None:
    done = dahl("commission", "--simulate", "--json", "-", "--name", "Rig 1", "-o", "out")
    assert done.returncode == 0, done.stderr
    numbers = json.loads(done.stdout)
    assert numbers == json.loads(Path("out/rig_1.json").read_text())
    shown = {name for part in ("configuration", "sweeps", "result") for name in numbers[part]}
    assert numbers["units"].keys() == shown - WITHOUT_UNIT
    assert numbers["refusal"] is None and numbers["stage"] == "done"
    assert_true(numbers)
    law = Compensator(**numbers["compensator"])
    assert (law.gain, law.Fc_low) == (numbers["result"]["gain"], numbers["result"]["Fc"]["least"])
    assert Path("out/rig_1.png").read_bytes().startswith(b"\x89PNG")
    assert_header(numbers, root, tmp_path)


def assert_header(numbers: dict, root: Path, folder: Path) -> None:
    """The header compiles in C and C++, and has the parameters and the load of the axis."""
    source = folder / "use.c"
    source.write_text(
        '#include "dahl_plan_rig_1.h"\n'
        "int prepare(void);\nfloat load(float angle);\nfloat gain(void);\n"
        "int prepare(void) { dahl_compensator_plan_t plan;"
        " return dahl_compensator_prepare(&plan, &dahl_plan_rig_1_compensator); }\n"
        "float load(float angle) { return dahl_plan_rig_1_load(angle); }\n"
        "float gain(void) { return (float)dahl_plan_rig_1.Fc_exponent; }\n"
    )
    includes = [f"-I{root}/lib/include", "-Iout"]
    strict = ["-Wall", "-Wextra", "-Werror", "-fsyntax-only", *includes]
    run("c++", "-std=c++11", "-x", "c++", *strict, "-Wno-missing-declarations", source)
    sources = [
        one
        for name in ("arith", "model", "parts", "compensator")
        for one in (root / "lib" / name).glob("*.c")
    ]
    lib = shared_object(folder, *includes, source, *sources)
    lib.load.restype, lib.load.argtypes = ctypes.c_float, [ctypes.c_float]
    assert lib.prepare() == 0
    axis = simulation.commission(simulation.simulated(), Shaft()).axis
    for angle in np.linspace(-0.6, 0.6, 241).tolist():
        assert lib.load(angle) == axis.load(angle)


def test_the_sweeps_have_the_speeds_that_are_drawn() -> None:
    commands: list[Command] = []
    simulation.commission(simulation.simulated(), Shaft(), watch=commands.append)
    speeds = {round(abs(one.speed), 3) for one in commands if one.stage == "sweeps"}
    for speed in SWEEP_SPEEDS:  # whole ticks change a speed by less than 1 %
        assert min(abs(one / speed - 1) for one in speeds) < 0.01
    assert max(speeds) < 1.01 * max(SWEEP_SPEEDS)


# --- a table and its recording --------------------------------------------------------------------


def play(table: Path, late_s: float = 0.4) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return time, angle in rad and torque in N m of a recording that begins before the table."""
    _, *columns = np.loadtxt(table, delimiter=",", skiprows=1).T
    shaft = Shaft()
    loop = simulation.PositionLoop(1e-3, shaft.theta_per_count, INERTIA)
    angles, torques = [], []
    for row in np.vstack((np.zeros((round(late_s * 1e3), 3)), np.array(columns).T)).tolist():
        torque = loop.torque(Command("track", *row, 0.0, 5.0, ""))
        angles.append(loop.angle)
        torques.append(torque)
        loop.read(shaft.move(torque))
    return np.arange(len(angles)) * 1e-3, np.array(angles), np.array(torques)


def write(path: str, names: str, *columns: np.ndarray) -> None:
    np.savetxt(path, np.column_stack(columns), delimiter=",", header=names, comments="")


def slow(angle: np.ndarray) -> np.ndarray:
    """Return the angle behind a mean over 0.3 s."""
    return np.convolve(angle, np.ones(300) / 300)[: len(angle)]


@pytest.fixture
def recording(dahl) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    done = dahl("commission", "--table", "sweeps.csv")
    assert done.returncode == 0, done.stderr
    return play(Path("sweeps.csv"))


def test_a_recording_shows_friction_and_load_but_no_bounds(dahl, recording) -> None:
    time, angle, torque = recording
    Path("out").mkdir()
    Path("out/dahl_plan_axis.h").write_text("of an earlier run")
    write("log.csv", "time_s,angle_deg,torque_mNm", time, np.degrees(angle) + 77, 1e3 * torque)
    done = dahl("commission", "log.csv", "--json", "-", "-o", "out")
    assert done.returncode == 0, done.stderr
    numbers = json.loads(done.stdout)
    sweeps = numbers["sweeps"]
    assert sweeps["Fc"]["least"] <= FC <= sweeps["Fc"]["most"] < 1.03 * FC
    assert sweeps["load"] == pytest.approx(GRAVITY * np.cos(sweeps["angle"]), abs=0.02)
    assert np.abs(sweeps["load"] - GRAVITY * np.cos(sweeps["angle"])).max() <= sweeps["load_error"]
    assert sweeps["load_error"] < 0.3 * FC
    assert sweeps["viscous"]["least"] <= VISCOUS <= sweeps["viscous"]["most"]
    assert "inertia" not in done.stderr + "".join(numbers)  # it would have no interval
    assert numbers["result"] is numbers["compensator"] is None
    for name in ("Fc_low", "length_long", "sigma0_high", "gain"):
        assert name in numbers["verdict"]
    assert not Path("out/dahl_plan_axis.h").exists()


@pytest.mark.parametrize(
    ("names", "change", "said"),
    [
        ("time_s,angle_deg,torque", lambda t, a, T: (t, np.degrees(a), T), "--torque-unit"),
        ("time_s,angle_deg,torque_Nm", lambda t, a, T: (t, a, T), "its unit"),
        ("time_s,angle_rad,torque_Nm", lambda t, a, T: (t, slow(a), T), "follows"),
        ("time_s,angle_rad,torque_Nm", lambda t, a, T: (t, -a, T), "sign"),
        ("time_s,angle_rad,torque_Nm", lambda t, a, T: (t, a, -T), "negate"),
        ("time_s,angle_rad,torque_Nm", lambda t, a, T: (t[:5000], a[:5000], T[:5000]), "take"),
        ("time_s,angle_rad,torque_Nm", lambda t, a, T: (t, a, 0 * T), "right column"),
        ("angle_rad,torque_Nm", lambda t, a, T: (a, T), "needs times"),
    ],
)
def test_a_recording_that_does_not_fit_is_refused(names, change, said, dahl, recording) -> None:
    write("log.csv", names, *change(*recording))
    code, line = complaint(dahl("commission", "log.csv", "-o", "out"))
    assert code == 2 and said in line and not Path("out/axis.json").exists()


def test_a_result_is_no_recording(dahl) -> None:
    assert dahl("commission", "--simulate", "-o", "out").returncode == 0
    code, line = complaint(dahl("commission", "out/axis.json"))
    assert code == 2 and "out/axis.json" in line and "not a recording" in line


@pytest.mark.parametrize(("gravity", "is_heavy"), [(0.0, False), (1.3 * FC, True)])
def test_a_load_above_the_friction_is_said_in_the_verdict(gravity: float, is_heavy: bool) -> None:
    done = simulation.commission(simulation.simulated(), Shaft(gravity=gravity))
    report = Report(done, "simulated axis")
    assert (report.numbers()["compensator_without_load_table"]["gain"] == 0) == is_heavy
    assert ("load may exceed" in report.verdict) == is_heavy
    assert ("load table" in report.next_step) == is_heavy


def test_a_table_does_not_overwrite_a_file_of_the_user(dahl) -> None:
    Path("mine.csv").write_text("a,b\n")
    code, line = complaint(dahl("commission", "--table", "mine.csv"))
    assert code == 2 and "mine.csv" in line and Path("mine.csv").read_text() == "a,b\n"


# --- a drive on a bus -----------------------------------------------------------------------------

sys.path.append(str(ROOT / "examples/odrive_moteus"))
simulated_drive = importlib.import_module("simulated_drive")
OPTIONS = ["--counts-per-turn", COUNTS_PER_TURN, "--inertia", 1.2 * INERTIA, "--torque-limit", 5]


class Bench:
    """The simulated drive of the examples. It answers each torque with the angle a period later."""

    def __init__(self, bus: can.BusABC, kind: str, sign: int, period: float) -> None:
        self._bus, self._period = bus, period
        self._drive = simulated_drive.SimulatedDrive(kind, 3, sign)
        self._ended = threading.Event()
        self.torques: list[float] = []
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def end(self) -> None:
        self._ended.set()
        self._thread.join()

    def _run(self) -> None:
        while not self._ended.is_set():
            message = self._bus.recv(0.05)
            torque = self._drive.torque(message) if message else None
            if torque is not None:
                self.torques.append(torque)
                angle = self._drive.move(torque)
                angle.timestamp = 1e9 + len(self.torques) * self._period
                self._bus.send(angle)


@contextmanager
def drive_on(channel: str, kind: str, sign: int = 1, period: float = 1e-3) -> Iterator[Bench]:
    settings = {"protocol": can.CanProtocol.CAN_FD, "preserve_timestamps": True}
    with can.Bus(interface="virtual", channel=channel, **settings) as bus:
        drive = Bench(bus, kind, sign, period)
        try:
            yield drive
        finally:
            drive.end()


@pytest.fixture
def live(dahl, monkeypatch):
    """Return the call of the command on a bus. The host does not wait for its own clock."""
    clock = SimpleNamespace(monotonic=drives.time.monotonic, sleep=lambda seconds: None)
    monkeypatch.setattr(drives, "time", clock)

    def call(channel: str, kind: str, *words: object):
        bus = ["-i", "virtual", "-c", channel, "--drive", kind, "--node", 3]
        bus += ["--fd"] * (kind == "moteus")
        return dahl("commission", *bus, *OPTIONS, "--json", "-", "-o", "out", *words)

    return call


@pytest.mark.parametrize("kind", ["odrive", "moteus"])
def test_a_drive_on_a_bus_is_commissioned(kind: str, live) -> None:
    channel = new_channel()
    with drive_on(channel, kind) as drive:
        done = live(channel, kind)
    assert done.returncode == 0, done.stderr
    numbers = json.loads(done.stdout)
    assert_true(numbers)
    assert numbers["source"].startswith(kind) and Path("out/dahl_plan_axis.h").is_file()
    assert max(map(abs, drive.torques)) <= 5 and drive.torques[-1] == 0


def test_the_simulated_drive_sends_angles_and_has_a_watchdog(monkeypatch) -> None:
    """On a clock of the test: one torque of twice the friction, then none."""
    now, frames, waiting = 0.0, [], [drives.ODrive(3).command(2 * FC)]

    def recv(seconds: float) -> can.Message | None:
        nonlocal now
        now += seconds
        if now > 0.2:
            raise InterruptedError
        return waiting.pop() if waiting else None

    clock = SimpleNamespace(monotonic=lambda: now)
    monkeypatch.setattr(simulated_drive, "time", clock)
    bus = SimpleNamespace(recv=recv, send=frames.append)
    with pytest.raises(InterruptedError):
        simulated_drive.serve(bus, simulated_drive.SimulatedDrive("odrive", 3))
    turns = [drives.ODrive(3).turns(frame) for frame in frames]
    assert len(turns) == pytest.approx(200, abs=3)
    assert turns[45] - turns[0] > 0.01 and abs(turns[-1] - turns[-50]) < 1e-3


def test_a_wrong_sign_is_refused_with_its_next_step_and_torque_0(live) -> None:
    channel = new_channel()
    with drive_on(channel, "odrive", sign=-1) as drive:
        done = live(channel, "odrive")
    numbers = json.loads(done.stdout)
    assert done.returncode == 1 and numbers["refusal"] == "SIGN" and numbers["stage"] == "sweeps"
    assert numbers["next_step"] == REASONS["SIGN"][1] and drive.torques[-1] == 0
    assert not Path("out/dahl_plan_axis.h").exists() and Path("out/axis.png").is_file()


def test_a_drive_at_another_rate_is_refused(live) -> None:
    channel = new_channel()
    with drive_on(channel, "odrive", period=2e-3) as drive:
        code, line = complaint(live(channel, "odrive"))
    assert code == 1 and "each 2 ms" in line and "--period" in line and drive.torques[-1] == 0


def test_a_silent_bus_is_one_line(live) -> None:
    code, line = complaint(live(new_channel(), "odrive"))
    assert code == 1 and "no angle" in line and "--node" in line


def test_ctrl_c_leaves_torque_0(live, monkeypatch) -> None:
    channel, frames, receive = new_channel(), [], drives.receive

    def interrupt(*words: object) -> can.Message | None:
        frames.append(words)
        if len(frames) == 1500:
            signal.raise_signal(signal.SIGINT)
        return receive(*words)

    monkeypatch.setattr(drives, "receive", interrupt)
    with drive_on(channel, "odrive") as drive:
        done = live(channel, "odrive")
    assert done.returncode == 130 and not Path("out").exists()
    assert max(map(abs, drive.torques)) > 0.3 and drive.torques[-1] == 0


@pytest.mark.parametrize("call", ["send", "recv"])
def test_a_bus_that_is_lost_is_one_line(call: str, live, monkeypatch) -> None:
    """Also if no frame with torque 0 can be sent any more."""

    def fail(*_: object, **__: object) -> None:
        raise can.CanOperationError("unplugged")

    monkeypatch.setattr(can.interfaces.virtual.VirtualBus, call, fail)
    code, line = complaint(live(new_channel(), "odrive"))
    assert code == 1 and "unplugged" in line


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("", "--simulate"),
        ("--simulate --table x.csv", "one of"),
        ("--simulate --inertia 1", "--inertia"),
        ("--simulate --counts-per-turn 99", "--counts-per-turn: has no use without LOG"),
        ("--table x.csv --angle-unit deg", "--angle-unit: has no use without LOG"),
        ("-i virtual -c x --skip-gaps", "--skip-gaps: has no use without LOG"),
        (
            "-i virtual -c x --inertia 1 --torque-limit 1 --counts-per-turn 999 --bandwidth 36",
            "0.035/period = 35 Hz",
        ),
        ("-i virtual -c x --inertia 1", "--torque-limit, --counts-per-turn"),
        ("-i virtual -c x --inertia 1 --torque-limit 1 --counts-per-turn 0", "--counts-per-turn"),
        ("-i virtual -c x --inertia 1 --torque-limit 1 --counts-per-turn 999 --travel 9", "travel"),
        ("none.csv", "none.csv"),
    ],
)
def test_bad_words_are_refused(words: str, said: str, dahl) -> None:
    code, line = complaint(dahl("commission", *words.split()))
    assert code == 2 and said in line


# --- refusals -------------------------------------------------------------------------------------


def test_code_and_page_have_the_same_next_step_for_each_refusal(root: Path) -> None:
    codes = set(
        re.findall(
            r"DAHL_COMMISSION_(\w+) = -4\d|DAHL_COMMISSION_(\w+) = -5\d",
            (root / "lib/include/dahl_commission.h").read_text(),
        )
    )
    names = {one or other for one, other in codes} - {"PARAM"}
    assert names == set(REASONS)
    rows = re.findall(r"^\| `(\w+)` \| ([^|]+) \| ([^|]+) \|", page(root), re.MULTILINE)
    assert {name: (what, step) for name, what, step in rows} == REASONS
    for name in names:
        assert hasattr(c, f"DAHL_COMMISSION_{name}")


def page(root: Path) -> str:
    return (root / "docs/commissioning.md").read_text()


def test_the_page_has_the_numbers_of_the_demo(root: Path) -> None:
    done = simulation.commission(simulation.simulated(), Shaft()).axis
    rms = [1e3 * simulation.track(done, is_on).rms for is_on in (False, True)]
    (words,) = re.findall(r"from ([\d.]+) to ([\d.]+) mrad", page(root))
    assert [float(word) for word in words] == pytest.approx(rms, rel=0.1)
    assert 0.89 < done.result["gain"] < 0.95
