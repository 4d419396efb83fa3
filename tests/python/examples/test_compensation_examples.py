# SPDX-License-Identifier: MIT
"""The page and the examples of friction compensation: their torques are those of dahl.Compensator,
within limit and slew, in the units that they promise.
"""

import ctypes
import importlib
import json
import math
import random
import re
import runpy
import struct
import sys
from collections.abc import Callable
from pathlib import Path

import can
import dahl
import numpy as np
import pytest
from dahl.binding import plan_header
from dahl.sim import axis
from numpy.typing import NDArray
from programs import run, shared_object
from sources import CORE, LIB

COMPENSATOR = sorted((LIB / "compensator").glob("*.c"))
FC_LOW, LENGTH_LONG, SIGMA0_HIGH = 0.45, 0.0055, 90.0  # N m, rad, N m/rad
MOVES = np.rint(6 * np.sin(np.arange(1000) / 60)).astype(int)  # counts: at most 2.3 rad/s


def compiled(root: Path, folder: Path, *words: object) -> ctypes.CDLL:
    includes = [f"-I{root}/lib/include", f"-I{folder}"]
    return shared_object(folder, *includes, *words, *CORE, *COMPENSATOR)


def compiled_page(root: Path, folder: Path, bounds: str) -> ctypes.CDLL:
    blocks = re.findall(r"```c\n(.*?)```", (root / "docs/compensation.md").read_text(), re.S)
    (code,) = (block for block in blocks if "compensation_tick" in block)
    (folder / "page.c").write_text(code)
    (folder / "dahl_plan_rig.h").write_text(bounds)
    page = compiled(root, folder, folder / "page.c")
    page.compensation_tick.restype = ctypes.c_float
    assert page.compensation_init() == 0
    return page


def test_the_page_has_the_bits_of_python(root: Path, tmp_path: Path) -> None:
    bounds = plan_header.bounds("rig", FC_LOW, LENGTH_LONG, SIGMA0_HIGH, "N m", "rad")
    page = compiled_page(root, tmp_path, bounds)
    low, long, high = (float(one) for one in re.findall(r"(\S+)f /\*", bounds))
    sigma0 = float(np.float32(low) / np.float32(long))
    theta = float(np.float32(6.2831853) / 16384)
    compensator = dahl.Compensator(
        *(sigma0, low, theta),
        **{"Fc_low": low, "length_long": long, "gain": 0.9, "limit": 1.2 * low, "slew": 100 * low},
        **{"sigma0_high": high, "inertia": 0.002, "delay": 2e-3, "period": 1e-3},
        **{"rise": 0.5, "fall": 0.02, "fade_speed": 5.0},
        **{"noise": 1, "play": 4, "jump": 200},
    )
    flags = np.abs(np.arange(len(MOVES)) - 700) > 10
    due = compensator.run_log(dahl.Friction(dahl.Plan(sigma0, low, theta)), MOVES, is_good=flags)
    found = [page.compensation_tick(int(m), int(f)) for m, f in zip(MOVES, flags, strict=True)]
    assert found == pytest.approx(due, abs=1e-7 * low)
    assert math.isclose(max(found), max(due), rel_tol=1e-6) and max(found) > 0.1


# --- change_parameters ----------------------------------------------------------------------------


CHANGING = ("sigma0", "Fc", "Fc_low", "gain", "limit", "slew")
CONSTANT = {"theta_per_count": 4e-4, "length_long": 1e-4, "sigma0_high": 300, "inertia": 0.01}
CONSTANT |= {"delay": 1e-3, "period": 1e-3, "play": 1, "jump": 100}
SETTER = """#include "compensation.h"
int set(float sigma0, float Fc, float Fc_low, float gain, float limit, float slew, int *code)
{
    dahl_compensator_params_t params = {
        .friction = {sigma0, Fc, 4e-4f}, .law = DAHL_COMPENSATOR_MEASURED, .Fc_low = Fc_low,
        .length_long = 1e-4f, .sigma0_high = 300, .inertia = 0.01f, .delay = 1e-3f, .gain = gain,
        .limit = limit, .slew = slew, .period = 1e-3f, .play = 1, .jump = 100};
    return compensation_set(&params, code);
}
"""


@pytest.fixture
def rig(root: Path, tmp_path: Path) -> ctypes.CDLL:
    (setter := tmp_path / "set.c").write_text(SETTER)
    folder = root / "examples/change_parameters"
    lib = compiled(root, tmp_path, f"-I{folder}", setter, folder / "compensation.c")
    lib.set.argtypes = [ctypes.c_float] * len(CHANGING) + [ctypes.POINTER(ctypes.c_int)]
    lib.compensation_tick.restype = ctypes.c_float
    return lib


def test_friction_and_compensator_change_together(rig: ctypes.CDLL) -> None:
    """The bits of Python. Limit and slew hold in N m; a torque above a new limit falls to it."""
    chance, code, last = random.Random(6), ctypes.c_int(), 0.0
    values = dict(zip(CHANGING, (100.0, 0.5, 0.5, 0.5, 0.3, 50.0), strict=True))
    assert rig.set(*values.values(), ctypes.byref(code))
    law, friction = dahl.Compensator(**values, **CONSTANT), dahl.Friction(dahl.Plan(100, 0.5, 4e-4))
    for _ in range(3000):
        move = chance.randint(-6, 10)
        torque = rig.compensation_tick(move, True)
        due = law.torque(friction.step_counts_q30(law.move(move)))
        limit, slew = min(law.limit, 2 * law.Fc), law.slew * law.period
        assert torque == pytest.approx(due, abs=1e-7) and abs(torque) <= limit + 1e-7
        assert abs(torque - last) <= slew + max(0, abs(last) - limit) + 1e-7
        last = torque
        if chance.random() < 0.3:
            numbers = chance.uniform(50, 200), chance.uniform(0.1, 1), 1.0, chance.uniform(0.1, 0.9)
            numbers += chance.uniform(0.05, 0.5), chance.uniform(5, 500)
            values = dict(zip(CHANGING, numbers, strict=True))
            assert not rig.set(*(values | {"Fc_low": 0.001}).values(), ctypes.byref(code))
            assert code.value == -19  # DAHL_COMPENSATOR_GAIN
            assert rig.set(*values.values(), ctypes.byref(code)) and code.value == 0
            assert not rig.set(*values.values(), ctypes.byref(code)) and code.value == 0  # it waits
            law.change(**values)
            friction.change_plan(dahl.Plan(law.sigma0, law.Fc, law.theta_per_count))


# --- stm32_current_loop ---------------------------------------------------------------------------

CR1, SMCR, CCMR1, CNT, ARR, CCR1 = 0, 2, 6, 9, 11, 13  # words of a timer
SR, JDR1 = 0, 15  # words of the ADC
PWM_PERIOD, VOLT, OHM, HENRY, TICK_S = 8400, 24.0, 1.0, 1e-3, 1e-4
AMPERE_PER_LSB = 3.3 / 4096 / 0.1
STM32 = Path("examples/stm32_current_loop")


class Motor:
    """Registers and winding of the current loop; the shaft is turned by the test."""

    def __init__(self, root: Path, folder: Path) -> None:
        (mock := folder / "mock.c").write_text(
            '#include "registers.h"\ntimer_registers_t tim1, tim3;\nadc_registers_t adc1;\n'
        )
        flags = ["-DHOST_REGISTERS", f"-I{root / STM32}"]
        self.lib = compiled(root, folder, *flags, mock, root / STM32 / "current_loop.c")
        words = ctypes.c_uint32 * 14
        self.tim1, self.tim3 = (words.in_dll(self.lib, name) for name in ("tim1", "tim3"))
        self.adc = (ctypes.c_uint32 * 16).in_dll(self.lib, "adc1")
        self.current, self.is_open = 0.0, False  # A; whether the winding is open

    def value(self, name: str) -> ctypes.c_float:
        return ctypes.c_float.in_dll(self.lib, name)

    def run(self, ticks: int, counts: int) -> list[float]:
        """Turn by this number of counts in each tick. Return the compensation in N m."""
        added = []
        for _ in range(ticks):
            self.tim3[CNT] = (self.tim3[CNT] + counts) % 65536
            self.adc[JDR1] = round(2048 + self.current / AMPERE_PER_LSB)
            self.adc[SR] = 0b1110  # a bit that is written 0 ends its interrupt
            self.lib.ADC_IRQHandler()
            assert self.adc[SR] & 0b1110 == 0b1010 and self.tim1[CCR1] <= PWM_PERIOD
            volt = VOLT * (2 * self.tim1[CCR1] / PWM_PERIOD - 1)
            self.current += (volt - OHM * self.current) / HENRY * TICK_S
            self.current *= not self.is_open
            added.append(self.value("compensation").value)
        return added


def test_the_current_loop_adds_the_current_of_the_friction(root: Path, tmp_path: Path) -> None:
    """0.9 times 0.045 N m at 0.05 N m/A, over the wrap of the timer, and back."""
    motor = Motor(root, tmp_path)
    motor.tim3[CNT] = 65500
    assert motor.lib.current_loop_init() == 0
    started = {CR1: 1, SMCR: 3, CCMR1: 0x0101, ARR: 65535, CNT: 65500}
    assert {word: value for word, value in enumerate(motor.tim3) if value} == started
    low, long = float(np.float32(0.045)), float(np.float32(0.0055))
    plan = dahl.Plan(float(np.float32(low) / np.float32(long)), low, 2 * math.pi / 16384)
    compensator = dahl.Compensator(
        *(plan.sigma0, low, plan.theta_per_count),
        **{"Fc_low": low, "length_long": long, "limit": 0.06, "slew": 5.0, "period": TICK_S},
        **{"sigma0_high": 9.0, "inertia": 2e-5, "delay": 1.2e-3},
        **{"rise": 0.5, "fall": 0.02, "fade_speed": 20.0, "noise": 1, "play": 4, "jump": 100},
    )
    due = compensator.run_log(
        dahl.Friction(plan), [0] + 199 * [1]
    )  # the first reading is the start
    assert motor.run(200, 1) == pytest.approx(due, abs=1e-7 * low) and due[-1] > 0
    friction = 0.9 * 0.045 / 0.05  # A
    for counts in (1, -1):
        motor.run(8000, counts)
        assert motor.current == pytest.approx(counts * friction, abs=0.02)
        assert motor.value("compensation").value == pytest.approx(counts * 0.0405, abs=1e-4)
    motor.value("torque_command").value = 0.1
    motor.run(300, -1)
    assert motor.current == pytest.approx(0.1 / 0.05 - friction, abs=0.02)
    motor.value("torque_command").value = 10.0
    motor.run(300, -1)
    assert motor.current == pytest.approx(4.0, abs=0.02)
    motor.is_open = True  # the integral must not grow without limit
    motor.run(2000, -1)
    motor.is_open = False
    ctypes.c_int.in_dll(motor.lib, "encoder_is_good").value = 0
    motor.value("torque_command").value = 0.0
    motor.run(300, -1)
    assert motor.value("compensation").value == 0 and abs(motor.current) < 0.02


# --- simplefoc ------------------------------------------------------------------------------------


def foc_of(root: Path, folder: Path) -> ctypes.CDLL:
    mock, own = root / "tests/python/examples/simplefoc_mock", root / "examples/commission_axis"
    compiled(root, folder, f"-I{own}", own / "axis.c", *sorted((LIB / "commission").glob("*.c")))
    words = ["g++", "-std=c++11", "-Wall", "-Wextra", "-Wconversion", "-Werror", "-shared", "-fPIC"]
    words += [f"-I{root}/lib/include", f"-I{mock}", f"-I{root}/examples/simplefoc", f"-I{own}"]
    words += [mock / "motor.cpp", folder / "made.so", f"-Wl,-rpath,{folder}"]
    run(*words, "-o", folder / "foc.so")
    lib = ctypes.CDLL(str(folder / "foc.so"))
    lib.motor_loop.restype = ctypes.c_float
    return lib


@pytest.fixture
def foc(root: Path, tmp_path: Path) -> ctypes.CDLL:
    return foc_of(root, tmp_path)


def foc_current(foc: ctypes.CDLL, turns: float, enabled: int = 1, good: int = 1, us: int = 1000):
    """Return the current of a tick in A. turns: -1 .. 1, negative for SimpleFOC's `Encoder`."""
    return foc.motor_loop(ctypes.c_float(turns * 2 * math.pi), ctypes.c_ulong(us), enabled, good)


@pytest.mark.parametrize("direction", [1, -1])
def test_simplefoc_gets_ampere_within_the_limit(direction: int, foc: ctypes.CDLL) -> None:
    """On top of the current of another term, through the zero of the sensor, and 0 if disabled."""
    other = 0.25  # A
    assert foc.motor_init(direction, ctypes.c_float(other), 16384) == 0

    def turn(ticks: int, counts: int, start: int, enabled: int = 1, us: int = 1000) -> list[float]:
        turns = [(start + counts * k) % 16384 / 16384 for k in range(ticks)]
        return [foc_current(foc, one, enabled, us=us) - other for one in turns]

    early = turn(40, 1, 15960, us=250)  # a quarter of a period: each fourth call is a tick
    assert 5 < sum(a != b for a, b in zip(early, early[1:], strict=False)) <= 10
    forward = turn(300, 2, 16000)
    limit = 0.03 / 0.05  # A
    assert forward[-1] == pytest.approx(direction * limit, rel=1e-5)
    assert max(map(abs, forward)) <= limit * (1 + 1e-5)
    steps = [abs(b - a) for a, b in zip(forward, forward[1:], strict=False)]
    assert max(steps) <= 5.0 * 1e-3 / 0.05 * (1 + 1e-4)
    assert turn(300, -2, 16598)[-1] == pytest.approx(-direction * limit, rel=1e-5)
    assert foc.motor_rejected() == 0
    assert turn(60, -2, 15998, enabled=0)[-1] == pytest.approx(0, abs=1e-6)


@pytest.mark.parametrize("counts_per_turn", [8000, 10000, 16384])
def test_negative_angles_of_simplefoc_turn_on(counts_per_turn: int, foc: ctypes.CDLL) -> None:
    """Encoder::update() of 2.4.0 returns the remainder of a turn with the sign of its counter. To
    and fro through the turns around 0, no move is longer than the shaft's, and the torque keeps
    the sign of the motion.
    """
    assert foc.motor_init(1, ctypes.c_float(0), counts_per_turn) == 0
    count, sign = 0, 1
    for sign, length in ((-1, 2.5), (1, 4), (-1, 3.2), (1, 1.7)):
        for travel in range(round(length * counts_per_turn)):
            count += sign
            current = foc_current(foc, math.fmod(count, counts_per_turn) / counts_per_turn)
            assert abs(foc.motor_moved()) <= 1
            assert travel < 100 or current * sign > 0
    assert foc.motor_rejected() == 0


@pytest.mark.parametrize("direction", [1, -1])
def test_a_motor_of_simplefoc_commissions_itself(direction: int, foc: ctypes.CDLL) -> None:
    """Then a hand with 0.6 of Fc turns the simulated shaft, and the torque of another loop is
    added.
    """
    foc.commission_loop.restype = foc.commission_Fc.restype = ctypes.c_float
    shaft, turn, ampere = axis.Shaft(), axis.COUNTS_PER_TURN, 0.0
    numbers = ctypes.c_float(1.2 * axis.INERTIA), ctypes.c_float(5)
    assert foc.commission_init(direction, turn, *numbers) == 0
    counts = 0

    def tick(torque: float = 0.0) -> float:
        nonlocal counts, ampere
        counts += shaft.move(0.05 * ampere)
        angle = direction * counts % turn / turn * 2 * math.pi
        ampere = foc.commission_loop(ctypes.c_float(angle), ctypes.c_float(torque))
        return ampere

    for _ in range(30_000):
        tick()
        if foc.commission_is_compensating() or foc.commission_refusal():
            break
    assert foc.commission_refusal() == 0 and foc.commission_is_compensating()
    assert foc.commission_Fc(-1) <= axis.FC <= foc.commission_Fc(1)
    alone = [tick() for _ in range(1000)][-1]
    assert 0.05 * alone == pytest.approx(axis.GRAVITY, abs=0.01 + 0.9 * axis.FC)
    shaft.hand, before = 0.6 * axis.FC, shaft.rotor.theta
    for _ in range(500):
        tick()
    assert shaft.rotor.theta - before > 0.05
    quiet = tick()
    assert tick(0.1) - quiet == pytest.approx(0.1 / 0.05, abs=0.05)


# --- odrive_moteus --------------------------------------------------------------------------------

LIMIT = 0.03  # N m
NODE = 3


def odrive_angle(turns: float) -> can.Message:
    data = struct.pack("<ff", turns, 0.0)
    return can.Message(arbitration_id=0x069, data=data, is_extended_id=False)


def odrive_torque(message: can.Message) -> float:
    assert message.arbitration_id == 0x06E and len(message.data) == 4
    assert not message.is_extended_id and not message.is_fd
    return struct.unpack("<f", message.data)[0]


def moteus_angle(turns: float) -> can.Message:
    data = b"\x2d\x01" + struct.pack("<f", turns)
    return can.Message(arbitration_id=0x300, data=data, is_extended_id=True, is_fd=True)


def moteus_torque(message: can.Message) -> float:
    """Read the subframes of a frame: writes of registers by type, then the query."""
    assert message.arbitration_id == 0x8003 and len(message.data) == 32
    assert message.is_extended_id and message.is_fd
    assert message.data[:3] == b"\x01\x00\x0a"  # write one int8 from register 0: position mode
    assert message.data[3:6] == b"\x0c\x05\x20"  # write five floats from register 0x20
    position, *velocity_to_kd = struct.unpack_from("<5f", message.data, 6)
    assert math.isnan(position) and velocity_to_kd[0] == velocity_to_kd[2] == velocity_to_kd[3] == 0
    assert message.data[26:] == b"\x1d\x01\x50\x50\x50\x50"  # read one float from register 1
    return velocity_to_kd[1]


BOUNDS = {"Fc_low": 0.045, "length_long": 0.0055, "sigma0_high": 9.0, "inertia": 2e-4}
BOUNDS |= {"delay": 4e-3, "limit": LIMIT, "fade_speed": 5.0}
OPTIONS = [f"--{name.replace('_', '-')}={value}" for name, value in BOUNDS.items()]


@pytest.mark.parametrize(
    ("words", "asked", "said"),
    [
        (["odrive", "can7", *OPTIONS], {"channel": "can7", "fd": False}, "error: cannot open can7"),
        (["moteus", "can7", *OPTIONS], {"channel": "can7", "fd": True}, "error: cannot open can7"),
        (["odriv", "can0", *OPTIONS], {}, "invalid choice: 'odriv'"),
        (["odrive", "can7", *OPTIONS, "--load=0.01"], {}, "error: gain*Fc = 0.040"),
        (["odrive", "can7", *OPTIONS, "--elastic", "--inertia=1e-6"], {}, "error: inertia = 1e-06"),
        *((["odrive", "can7", *OPTIONS[:k], *OPTIONS[k + 1 :]], {}, "required") for k in range(7)),
    ],
)
def test_the_host_needs_a_known_drive_each_bound_and_a_bus(
    words, asked, said, root, monkeypatch, capsys
) -> None:
    """A moteus needs CAN FD."""
    given: dict[str, object] = {}

    def refuse(**settings: object) -> None:
        given.update(settings)
        raise OSError(19, "No such device") if settings["fd"] else can.CanError("down")

    monkeypatch.setattr(can, "Bus", refuse)
    monkeypatch.setattr(sys, "argv", ["feed_forward.py", *words])
    with pytest.raises(SystemExit) as ended:
        runpy.run_path(str(root / "examples/odrive_moteus/feed_forward.py"), run_name="__main__")
    assert said in f"{ended.value.code} {capsys.readouterr().err}"
    assert given == ({"interface": "socketcan"} | asked if asked else {})


def test_the_host_takes_the_bounds_of_a_commissioning(root, dahl, monkeypatch) -> None:
    """It has them, so that only the bus is missing. Those of a refused axis are null."""
    assert dahl("commission", "--simulate", "-o", ".").returncode == 0
    known = json.loads(Path("axis.json").read_text())
    assert known["compensator_without_load_table"]["gain"] < known["compensator"]["gain"]
    Path("refused.json").write_text(json.dumps(known | {"compensator_without_load_table": None}))
    example = str(root / "examples/odrive_moteus/feed_forward.py")
    Path("other.json").write_text("{}")
    ends = {"axis.json": "error: cannot open can7"}
    for name in ("axis.json", "refused.json", "other.json", "none.json"):
        words = ["feed_forward.py", "odrive", "can7", "--from", name]
        monkeypatch.setattr(sys, "argv", words)
        with pytest.raises(SystemExit) as ended:
            runpy.run_path(example, run_name="__main__")
        assert str(ended.value.code).startswith(ends.get(name, "2"))


def torques_of_moves(moves: list[int], period: float) -> np.ndarray:
    plan = dahl.Plan(0.045 / 0.0055, 0.045, 2 * math.pi / 16384)
    compensator = dahl.Compensator(
        *(plan.sigma0, 0.045, plan.theta_per_count),
        **BOUNDS,
        **{"slew": 9.0, "rise": 0.5, "period": period, "fall": 0.02, "noise": 1, "play": 4},
    )
    return compensator.run_log(dahl.Friction(plan), moves)


@pytest.mark.parametrize("name", ["ODrive", "Moteus"])
def test_a_host_feeds_newton_metres_forward(
    name: str, root: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(root / "examples/odrive_moteus")
    module = importlib.import_module("feed_forward")
    monkeypatch.setattr(module, "TIMEOUT_S", 0.02)
    angle, torque_of = {
        "ODrive": (odrive_angle, odrive_torque),
        "Moteus": (moteus_angle, moteus_torque),
    }[name]
    feed = module.FeedForward(getattr(module, name)(NODE), **BOUNDS)
    stranger = can.Message(arbitration_id=0x7FF, data=[1], is_extended_id=False)
    with (
        can.Bus(interface="virtual", channel=name, protocol=can.CanProtocol.CAN_FD) as host,
        can.Bus(interface="virtual", channel=name, protocol=can.CanProtocol.CAN_FD) as drive,
    ):

        def torques(counts: range) -> list[float]:
            found = []
            for count in counts:
                drive.send(stranger)
                drive.send(angle(count / 16384))
                returned = feed.tick(host)
                found.append(torque_of(drive.recv(1)))
                assert found[-1] == pytest.approx(returned, abs=1e-9)
            return found

        found = torques(range(0, 1200, 3)) + torques(range(1200, 600, -3))
        due = torques_of_moves([0] + 400 * [3] + 199 * [-3], module.PERIOD_S)
        assert found == pytest.approx(due, abs=1e-9)
        assert (max(found), found[-1]) == pytest.approx((LIMIT, -LIMIT), rel=1e-5)
        # no number, then a jump there and back
        for count in (math.nan, 603, 603, 1e38, 603, 603, 603):
            drive.send(angle(count / 16384))
            assert feed.tick(host) == pytest.approx(-LIMIT, rel=1e-5)
        cut = angle(0.0)
        cut.data, cut.dlc = cut.data[:2], 2
        drive.send(cut)
        silent = [feed.tick(host) for _ in range(15)]  # the first two do not fade
        fades = [max(0.0, 1 - tick * module.PERIOD_S / 0.02) for tick in range(-1, 14)]
        assert silent == pytest.approx(
            [-min(LIMIT, 0.9 * 0.045 * fade) for fade in fades], abs=1e-4
        )


def test_a_host_is_as_fast_on_a_larger_axis(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(root / "examples/odrive_moteus")
    module = importlib.import_module("feed_forward")
    counts = [*range(0, 1200, 3), *range(1200, 1000, -3)]
    ratios = []
    with (
        can.Bus(interface="virtual", channel="large") as host,
        can.Bus(interface="virtual", channel="large") as drive,
    ):
        for scale in (1, 1000):
            larger = {n: scale * BOUNDS[n] for n in ("Fc_low", "sigma0_high", "inertia", "limit")}
            feed = module.FeedForward(module.ODrive(NODE), **BOUNDS | larger)
            found = []
            for count in counts:
                drive.send(odrive_angle(count / 16384))
                found.append(feed.tick(host) / scale)
            ratios.append(found)
    assert ratios[0] == pytest.approx(ratios[1], abs=1e-6)


# --- bad readings, on every axis that has an encoder and a compensator ----------------------------

Tick = Callable[[int, bool], float]  # count of the shaft, is_good -> torque


def tick_of_the_page(root: Path, folder: Path) -> Tick:
    page = compiled_page(root, folder, plan_header.bounds("rig", 0.45, 5.5e-3, 90.0, "N m", "rad"))
    last = 0

    def tick(count: int, is_good: bool) -> float:
        nonlocal last
        dcounts, last = count - last, count
        return float(page.compensation_tick(dcounts, int(is_good)))

    return tick


def tick_of_spi(root: Path, folder: Path) -> Tick:
    """The SPI encoder of encoder.md."""
    lib = encoder_page(root, folder, "read_spi_encoder", SPI)
    assert lib.init() == 0
    reading, flag = (ctypes.c_uint32.in_dll(lib, name) for name in ("spi_reading", "spi_is_good"))

    def tick(count: int, is_good: bool) -> float:
        reading.value, flag.value = count % 16384, is_good
        return float(lib.compensation_tick()) / 2**30

    return tick


def tick_of_stm32(root: Path, folder: Path) -> Tick:
    motor = Motor(root, folder)
    assert motor.lib.current_loop_init() == 0

    def tick(count: int, is_good: bool) -> float:
        motor.tim3[CNT] = count % 65536
        ctypes.c_int.in_dll(motor.lib, "encoder_is_good").value = is_good
        return motor.run(1, 0)[0]

    return tick


def tick_of_simplefoc(root: Path, folder: Path) -> Tick:
    lib = foc_of(root, folder)
    assert lib.motor_init(1, ctypes.c_float(0), 16384) == 0
    return lambda count, is_good: foc_current(lib, count % 16384 / 16384, good=int(is_good))


def tick_of_odrive(root: Path, folder: Path) -> Tick:
    """A bad reading is a frame without a number."""
    (folder / "feed_forward.py").write_text(
        (root / "examples/odrive_moteus/feed_forward.py").read_text()
    )
    module = runpy.run_path(str(folder / "feed_forward.py"))
    module["FeedForward"].tick.__globals__["TIMEOUT_S"] = 1e-3
    feed = module["FeedForward"](module["ODrive"](NODE), **BOUNDS)
    bus = {"interface": "virtual", "channel": str(folder)}
    host, drive = can.Bus(**bus), can.Bus(**bus)

    def tick(count: int, is_good: bool) -> float:
        drive.send(odrive_angle(count / 16384 if is_good else math.nan))
        return float(feed.tick(host))

    return tick


TICKS = [tick_of_the_page, tick_of_spi, tick_of_stm32, tick_of_simplefoc, tick_of_odrive]


@pytest.mark.parametrize("make", TICKS)
def test_a_bad_reading_does_not_turn_the_torque(
    make: Callable[[Path, Path], Tick], root: Path, tmp_path: Path
) -> None:
    """A shaft turns steadily. A wrong count is reported, and below the largest move."""
    tick, count, random = make(root, tmp_path), 0, np.random.default_rng(1)

    def turn(bad: NDArray[np.bool_]) -> list[float]:
        nonlocal count
        torques = []
        for is_bad in bad:
            count += 2
            wrong = int(random.integers(-90, 91))
            torques.append(tick(count + (wrong if is_bad else 0), not is_bad))
        return torques

    ticks = 6000 if make is tick_of_stm32 else 700  # to fade in
    full = turn(np.zeros(ticks, bool))[-1]
    assert full > 0
    single = turn(np.arange(300) % 5 == 0)
    assert single == pytest.approx([full] * 300, rel=1e-3)
    assert min(turn(random.random(300) < 0.6)) >= 0
    assert turn(np.zeros(ticks, bool))[-1] == pytest.approx(full, rel=1e-3)


# --- encoder.md -----------------------------------------------------------------------------------

SPI = """
#include "dahl_compensator.h"
#include "dahl_encoder.h"
dahl_plan_t friction; dahl_compensator_plan_t plan; dahl_encoder_t encoder;
uint32_t spi_reading, spi_is_good;
int read_spi_encoder(uint32_t *reading) { *reading = spi_reading; return (int)spi_is_good; }
int init(void) {
    dahl_compensator_params_t params = {.friction = {80, 0.4f, 6.2831853f / 16384},
        .law = DAHL_COMPENSATOR_MEASURED, .Fc_low = 0.4f, .length_long = 0.005f,
        .sigma0_high = 90, .inertia = 0.002f, .delay = 2e-3f, .gain = 0.9f,
        .limit = 1, .slew = 50, .period = 1e-3f, .rise = 0.1f, .fall = 0.02f,
        .noise = 1, .play = 4, .jump = 200};
    return dahl_prepare(&friction, &params.friction) | dahl_encoder_init(&encoder, 16384, 1, 0)
        | dahl_compensator_prepare(&plan, &params);
}
"""

INDEX = """
#include "dahl_encoder.h"
dahl_encoder_t encoder;
uint32_t counter; int moved;
static uint32_t is_masked;
static void tick(void) { if (!is_masked) { moved += dahl_encoder_move(&encoder, counter); } }
void set_counter(uint32_t count) { counter = count; tick(); }
uint32_t mask_interrupts(void) { tick(); uint32_t was = is_masked; is_masked = 1; return was; }
void unmask_interrupts(uint32_t before) { is_masked = before; tick(); }
int turn(int counts) { moved = 0; counter += (uint32_t)counts; tick(); return moved; }
int init(void) { return dahl_encoder_init(&encoder, 0, 1, 0); }
"""


def encoder_page(root: Path, folder: Path, word: str, rest: str) -> ctypes.CDLL:
    """Return the block of encoder.md that has this word, compiled with the rest of its program."""
    blocks = re.findall(r"```c\n(.*?)```", (root / "docs/encoder.md").read_text(), re.S)
    (block,) = (one for one in blocks if word in one)
    (folder / "block.c").write_text(block)
    (folder / "rest.c").write_text(rest)
    return compiled(root, folder, folder / "block.c", folder / "rest.c")


def test_no_tick_runs_between_the_index_and_its_home(root: Path, tmp_path: Path) -> None:
    """A tick is pending at each call out of the interrupt."""
    lib = encoder_page(root, tmp_path, "index_interrupt", INDEX)
    moved = ctypes.c_int.in_dll(lib, "moved")
    assert lib.init() == 0 and lib.turn(8000) == 0
    for counts in (5, 8000, -3000):
        assert lib.turn(counts) == counts
        moved.value = 0
        lib.index_interrupt()
        assert moved.value == 0 and ctypes.c_uint32.in_dll(lib, "counter").value == 0


def error_of_sweeps(turns: int, start: int) -> float:
    """Return the largest error, in Fc, of sweeps of 100 counts by differences of a float angle."""
    theta = 2 * math.pi / 16384
    plan = dahl.Plan(200 * 0.5, 0.5, theta)
    by_angle, by_counts, worst = dahl.Friction(plan), dahl.Friction(plan), 0.0
    step = (1, 2, 5, 10, 20, 50, 100)[start % 7]
    sweep = [*range(0, 100, step), *range(100, 0, -step)]
    counts = turns * 16384 + start + np.array(6 * sweep)
    angles = (counts * theta).astype(np.float32)
    for angle, dcounts in zip(np.diff(angles).tolist(), np.diff(counts).tolist(), strict=True):
        error = by_angle.step(angle) - by_counts.step_counts(dcounts)
        worst = max(worst, abs(error) / plan.Fc)
    return worst


@pytest.mark.parametrize(("turns", "limit"), [(0, 1.4e-4), (538, 0.071)])
def test_a_float_angle_errs_as_the_page_says(turns: int, limit: float) -> None:
    worst = max(error_of_sweeps(turns, start) for start in range(0, 16284, 9))
    assert 0.9 * limit < worst <= limit
