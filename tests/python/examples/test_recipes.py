# SPDX-License-Identifier: MIT
"""Recipes of docs/recipes.md that compute something, against references without the library.
(test_readme.py compiles all of them.)
"""

import ctypes
import itertools
import math
import random
import re
from pathlib import Path
from typing import Any

import dahl
import numpy as np
import pytest
from conftest import ROOT
from programs import call, shared_object
from sources import as_one

PAGE = (ROOT / "docs/recipes.md").read_text()
PLAN = ctypes.c_uint32 * 78


class Params(ctypes.Structure):
    _fields_ = [(name, ctypes.c_float) for name in ("sigma0", "Fc", "theta_per_count")]


class State(ctypes.Structure):
    _fields_ = [("w", ctypes.c_int64)]


class Encoder(ctypes.Structure):
    _fields_ = [*((f"word{k}", ctypes.c_uint32) for k in range(7)), ("sign", ctypes.c_int8)]
    _fields_ += [("primed", ctypes.c_uint8)]


def recipe(title: str) -> str:
    section = PAGE.partition(f"\n## {title}\n")[2].partition("\n## ")[0]
    (code,) = re.findall(r"```c\n(.*?)```", section, re.S)
    return code


@pytest.fixture
def made(tmp_path: Path, library: Path) -> Any:
    """made(title, C behind the recipe) is the recipe as a library."""

    def build(title: str, more: str = "") -> ctypes.CDLL:
        (tmp_path / "recipe.c").write_text(recipe(title) + more)
        mocks = ROOT / "tests/python/examples/zephyr_mock"
        words = [f"-I{ROOT}/lib/include", f"-I{mocks}", "-D_GNU_SOURCE", tmp_path / "recipe.c"]
        links = ["-Wl,--no-as-needed", library, f"-Wl,-rpath,{library.parent}"]
        return shared_object(tmp_path, *words, *links)

    return build


def prepared(library: ctypes.CDLL, params: Params) -> ctypes.Array[ctypes.c_uint32]:
    plan = PLAN()
    assert library.dahl_prepare(plan, ctypes.byref(params)) == 0
    return plan


def started(library: ctypes.CDLL, modulus: int) -> Encoder:
    encoder = Encoder()
    assert library.dahl_encoder_init(ctypes.byref(encoder), modulus, 1, 0) == 0
    return encoder


def joint_torques(sigma0: float, Fc: float, angles: list[float]) -> list[float]:
    """Dahl's equation in double, solved for the joint."""
    F, torques = 0.0, []
    for before, now in itertools.pairwise(angles):
        end = math.copysign(Fc, now - before)
        F = end + (F - end) * math.exp(-sigma0 / Fc * abs(now - before))
        torques.append(F)
    return torques


def test_a_gear_gives_the_torque_of_the_joint(made: Any) -> None:
    """The element at the motor gives it over N, that at the joint as it is. If the sides turn
    against each other, the joint steps by the negated counts.
    """
    gear, rng, theta = made("Gear ratio"), random.Random(5), 2 * math.pi / 16384
    gear.dahl_step_counts.restype = ctypes.c_float
    for _ in range(50):
        N, Fc, sign = rng.uniform(0.3, 200), 10 ** rng.uniform(-2, 2), rng.choice((-1, 1))
        joint = Params(Fc * 10 ** rng.uniform(1.5, 3.5), Fc, 0.0)
        moves = [rng.randrange(-4000, 4001) for _ in range(200)]
        angles = [sign * theta / N * count for count in itertools.accumulate(moves, initial=0)]
        exact = np.array(joint_torques(joint.sigma0, joint.Fc, angles))
        for convert, turn, factor in (
            (gear.at_the_motor, 1, sign * N),
            (gear.at_the_joint, sign, 1.0),
        ):
            convert.restype = Params
            plan = prepared(gear, convert(joint, ctypes.c_float(N), ctypes.c_float(theta)))
            state = State()
            step = gear.dahl_step_counts
            found = [step(plan, ctypes.byref(state), turn * move) for move in moves]
            assert factor * np.array(found) == pytest.approx(exact, abs=1e-5 * Fc)
        assert np.abs(exact).max() > 0.01 * Fc


RATIO, MOTOR, JOINT = 50, (60.0, 0.1), (20000.0, 10.0)  # sigma0 N m/rad, Fc N m of each side
MOTOR_COUNT, JOINT_COUNT = 2 * math.pi / 2**17, 2 * math.pi / 2**19


def geared_plant() -> tuple[list[int], list[int], np.ndarray]:
    """Return the counts of both encoders in each tick of 1 ms, and the friction at the motor. The
    motor swings by 2 rad; the gear twists by 10 mrad at the joint before the joint slips. Bristles
    and the joint are integrated in steps of 20 us.
    """
    stiffness, inertia, damping, step = 1000.0, 0.05, 5.0, 2e-5
    angle = speed = motor_z = joint_z = before = 0.0
    counts: tuple[list[int], list[int]] = ([], [])
    friction = []
    for k in range(200_000):
        motor = 2.0 * math.sin(2 * math.pi * 0.5 * k * step)
        motor_z += motor - before - MOTOR[0] / MOTOR[1] * abs(motor - before) * motor_z
        twist, before = motor / RATIO - angle, motor
        speed += step / inertia * (stiffness * twist - damping * speed - JOINT[0] * joint_z)
        angle += step * speed
        joint_z += step * (speed - JOINT[0] / JOINT[1] * abs(speed) * joint_z)
        if k % 50 == 0:
            counts[0].append(math.floor(motor / MOTOR_COUNT))
            counts[1].append(math.floor(angle / JOINT_COUNT))
            friction.append(MOTOR[0] * motor_z + JOINT[0] * joint_z / RATIO)
    return *counts, np.array(friction)


def test_friction_on_both_sides_follows_a_gear_that_twists(made: Any) -> None:
    """If both elements step by the motor, the joint reverses too early."""
    axis, (motor, joint, friction) = made("Friction on both sides"), geared_plant()
    axis.both_sides_tick.restype = ctypes.c_float
    Fc = MOTOR[1] + JOINT[1] / RATIO

    def worst(joint_moves: np.ndarray, joint_count: float) -> float:
        sides = [Params(*MOTOR, MOTOR_COUNT), Params(*JOINT, joint_count)]
        assert axis.both_sides_init(*map(ctypes.byref, sides)) == 0
        pairs = zip(np.diff(motor).tolist(), joint_moves.tolist(), strict=True)
        found = np.array([axis.both_sides_tick(*pair) for pair in pairs])
        return float(np.abs(found - friction[1:])[1000:].max() / Fc)

    assert worst(np.diff(joint), JOINT_COUNT) < 0.03
    assert worst(np.diff(motor), MOTOR_COUNT / RATIO) > 0.3


AXIS = """
void axis_start(axis_t *axis, const dahl_plan_t *plan, uint32_t modulus)
{
    static const axis_t none = {0};
    *axis = none;
    axis->plan = plan;
    if (dahl_encoder_init(&axis->encoder, modulus, 1, 0) != DAHL_OK) { axis->plan = 0; }
}
size_t axis_bytes(void) { return sizeof(axis_t); }
"""


def test_two_axes_share_a_plan_and_nothing_else(made: Any) -> None:
    axes, rng = made("Two axes", "#include <stddef.h>\n" + AXIS), random.Random(3)
    axes.axis_tick.restype = ctypes.c_float
    params = Params(100.0, 0.5, 3.8e-4)
    plan = prepared(axes, params)
    both = [ctypes.create_string_buffer(axes.axis_bytes()) for _ in range(2)]
    alone = [
        dahl.Friction(dahl.Plan(params.sigma0, params.Fc, params.theta_per_count)) for _ in both
    ]
    position = [0, 0]
    for axis in both:
        axes.axis_start(axis, plan, 65536)
        axes.axis_tick(axis, 0)
    for _ in range(200):
        k, move = rng.randrange(2), rng.randrange(-99, 100)
        position[k] = (position[k] + move) % 65536
        assert axes.axis_tick(both[k], position[k]) == alone[k].step_counts(move)


def test_friction_follows_a_table_over_temperature(made: Any) -> None:
    library = made("Temperature")
    library.Fc_at.restype = ctypes.c_uint32
    table = [
        int(word)
        for word in re.search(r"POINTS\] = \{(.*?)\}", recipe("Temperature"))[1].split(",")
    ]
    hundredths = [-(10**9), *range(-4000, 10001, 7), 10**9]
    wanted = np.interp(np.array(hundredths) / 100, np.arange(len(table)) * 25 - 20, table)
    assert [library.Fc_at(c) for c in hundredths] == pytest.approx(wanted, abs=1)
    plan, state = prepared(library, Params(100.0, 0.5, 3.8e-4)), State()
    for centi_C, Fc in ((-2000, 900000), (8000, 400000)):
        found = library.friction_uNm(plan, ctypes.byref(state), 10**6, centi_C)
        assert found == pytest.approx(Fc, abs=1)


KEPT = """
void spoil(uint32_t magic, int64_t w) { kept.magic = magic; kept.bearing.w = w; }
"""
MAGIC, HALF = 0x44414831, 1 << 61


@pytest.mark.parametrize(
    ("is_watchdog", "magic", "state", "kept"),
    [
        (1, MAGIC, HALF, 0.5),
        (0, MAGIC, HALF, 0.0),  # after power-on the memory may hold the old bits
        (1, 0x5A5A5A5A, HALF, 0.0),
        (1, MAGIC, -(1 << 63), 0.0),
    ],
)
def test_only_a_watchdog_reset_keeps_the_state(
    made: Any, is_watchdog: int, magic: int, state: int, kept: float
) -> None:
    library = made("Watchdog and .noinit", KEPT)
    library.friction_tick.restype = ctypes.c_float
    library.spoil.argtypes = [ctypes.c_uint32, ctypes.c_int64]
    plan = prepared(library, Params(100.0, 1.0, 3.8e-4))
    library.spoil(magic, state)
    library.friction_start(is_watchdog)
    assert not library.watchdog_may_be_fed()
    assert library.friction_tick(plan, 0) == kept
    assert library.watchdog_may_be_fed() and not library.watchdog_may_be_fed()


class FastAxis(ctypes.Structure):
    _fields_ = [("bearing", State), ("encoder", Encoder), ("friction_uNm", ctypes.c_int32)]
    _fields_ += [("phase", ctypes.c_uint32)]


def test_a_slower_element_has_the_torque_of_the_path(made: Any) -> None:
    """Beside an element that steps in each tick. A reversal within five ticks is seldom."""
    library = made("20 kHz")
    params = Params(100.0, 0.5, 3.8e-4)
    plan, fast = prepared(library, params), FastAxis(encoder=started(library, 65536))
    each = dahl.Friction(dahl.Plan(params.sigma0, params.Fc, params.theta_per_count))
    position = [round(300 * math.sin(2 * math.pi * k / 20000)) for k in range(40000)]
    worst = 0.0
    library.current_loop_tick(plan, ctypes.byref(fast), 0)
    for tick, (before, now) in enumerate(itertools.pairwise(position), 1):
        found = library.current_loop_tick(plan, ctypes.byref(fast), now % 65536)
        wanted = each.step_counts(now - before)
        if tick % 5 == 4 and tick > 5:
            worst = max(worst, abs(found * 1e-6 - wanted))
    assert worst < 2e-6


PREEMPTED = """
#include <signal.h>
#include <sys/time.h>
static volatile int32_t turn;
static void interrupt(int number)
{
    (void)number;
    turn = turn + 1;
    loop_publish(turn, -turn);
}
int torn_reads(int32_t interrupts)
{
    const struct itimerval often = {{0, 20}, {0, 20}}, never = {{0, 0}, {0, 0}};
    int torn = 0;
    signal(SIGALRM, interrupt);
    setitimer(ITIMER_REAL, &often, 0);
    while (turn < interrupts) {
        const telemetry_t read = telemetry_read();
        torn += read.torque_uNm != -read.count;
    }
    setitimer(ITIMER_REAL, &never, 0);
    return torn;
}
"""


def test_the_loop_may_interrupt_a_reader_of_telemetry(made: Any) -> None:
    """A timer signal is the loop."""
    library = made("Priority of CAN", PREEMPTED)
    assert library.torn_reads(3000) == 0


def test_a_closed_drive_accepts_counts_but_no_parameters(made: Any) -> None:
    library = made("Who may read and write")
    library.node_may_receive.restype = ctypes.c_bool
    frame = (ctypes.c_uint64 * 4)()
    identifier = ctypes.cast(ctypes.byref(frame, 8), ctypes.POINTER(ctypes.c_uint32))

    def passes(base: int, is_in_service: bool) -> bool:
        found = set()
        for node in range(16):
            identifier[0] = base + node
            found.add(library.node_may_receive(frame, is_in_service))
        (same,) = found
        return same

    dbc = {"EncoderState": 0x100, "Status": 0x120, "ParamWrite": 0x130, "Reset": 0x150}
    closed = {name for name, base in dbc.items() if not passes(base, False)}
    assert closed == {"ParamWrite", "Reset"} and all(passes(base, True) for base in dbc.values())


class SensorValue(ctypes.Structure):
    _fields_ = [("val1", ctypes.c_int32), ("val2", ctypes.c_int32)]


SENSOR = """
static struct sensor_value next;
static int next_code;
void answer(int32_t val1, int32_t val2, int code)
{
    next.val1 = val1;
    next.val2 = val2;
    next_code = code;
}
int sensor_sample_fetch(const struct device *dev) { (void)dev; return next_code; }
int sensor_channel_get(const struct device *dev, enum sensor_channel channel,
                       struct sensor_value *value)
{
    (void)dev;
    *value = next;
    return channel == SENSOR_CHAN_ROTATION ? 0 : -134;
}
"""


def stm32(count: int, turn: int) -> tuple[int, int]:
    """The driver's value: the angle in 1/64 degree, rounded down."""
    steps = count * 360 * 64 // turn
    return steps // 64, steps % 64 * 15625


def nordic(move: int, turn: int) -> tuple[int, int]:
    """The driver's value: whole degrees and millionths, both rounded towards 0."""
    whole = int(move * 360 / turn)
    return whole, int((move * 360 - whole * turn) * 1000000 / turn)


def test_counts_come_back_from_degrees(made: Any) -> None:
    """Also with the most counts of the page; the whole degrees alone lose them."""
    most = int(re.search(r"exact up to ([\d,]+) counts", PAGE)[1].replace(",", ""))
    text = recipe("Zephyr's sensor API")
    library = made("Zephyr's sensor API", SENSOR)
    assert "COUNTS_PER_TURN = 10000" in text
    found, count = set(), ctypes.c_int32()
    for wanted in range(10000):
        library.answer(*stm32(wanted, 10000), 0)
        assert library.read_counts(None, ctypes.byref(count)) == 0 and count.value == wanted
        found.add(stm32(wanted, 10000)[0])
    assert len(found) == 360
    for wanted in range(-3000, 3001):
        library.answer(*nordic(wanted, 2000), 0)
        assert library.read_counts(None, ctypes.byref(count)) == 0 and count.value == 5 * wanted
    library.answer(0, 0, -5)
    assert library.read_counts(None, ctypes.byref(count)) == -5
    for turn, is_exact in ((most, True), (16384, False)):
        back = [
            round((v1 + v2 / 1e6) * turn / 360) for v1, v2 in (stm32(k, turn) for k in range(turn))
        ]
        assert (back == list(range(turn))) == is_exact


def test_a_c2000_stops_with_the_error_of_the_page(tmp_path: Path) -> None:
    """A gcc that believes in bytes of 16 bits."""
    (line,) = re.findall(r'```\n#error (".*")\n```', PAGE)
    words = ["gcc", "-std=c99", "-D__CHAR_BIT__=16", f"-I{ROOT}/lib/include", "-fsyntax-only"]
    done = call(*words, as_one(tmp_path))
    assert done.returncode != 0 and f"#error {line}" in done.stderr
