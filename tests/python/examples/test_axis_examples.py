# SPDX-License-Identifier: MIT
"""The examples of whole axes, on simulated axes whose friction the library does not integrate."""

import ctypes
import importlib
import math
import random
import re
from collections.abc import Callable
from pathlib import Path

import dahl
import numpy as np
import pytest
from axis_plant import Axis
from programs import shared_object
from sources import CORE, LIB

COMPENSATOR = sorted((LIB / "compensator").glob("*.c"))
TICK_S = 1e-3
RAD = 2 * math.pi / 16384  # per count


def compiled(root: Path, folder: Path, shim: str, *names: str) -> ctypes.CDLL:
    """Compile the files of examples/ with a shim that makes structs of numbers."""
    (folder / "shim.c").write_text(shim)
    files = [root / "examples" / name for name in names]
    includes = [f"-I{path}" for path in {root / "lib/include", *(file.parent for file in files)}]
    flags = ["-Wno-double-promotion", *includes, folder / "shim.c", *files]
    return shared_object(folder, *flags, *CORE, *COMPENSATOR, "-lm")


def numbers(*values: float) -> ctypes.Array[ctypes.c_float]:
    return (ctypes.c_float * len(values))(*values)


# --- position_loop --------------------------------------------------------------------------------

POSITION_LOOP = """
#include "position_loop.h"
static position_loop_params_t params; static position_loop_t loop;
int init(const float *x) /* sigma0, Fc, rad, gain, period, inertia, corner, limit, speed_gain */
{
    params = (position_loop_params_t){
        .compensator = {.friction = {x[0], x[1], x[2]}, .law = DAHL_COMPENSATOR_REFERENCE,
                        .gain = x[3], .limit = 2 * x[1], .slew = 200 * x[1], .period = x[4],
                        .rise = 0.05f, .fall = 0.02f, .noise = 1, .play = 4, .jump = 1000},
        .observer = {x[5], x[6], x[7], x[8], 0, 1},
        .position_gain = 40, .integral_time = 0.06f, .drive_limit = 5};
    return position_loop_init(&loop, &params);
}
float tick(int32_t wanted, const float *x, int32_t dcounts, int is_good)
{
    const position_loop_reference_t reference = {wanted, x[0], x[1], x[2]};
    return position_loop_tick(&loop, &reference, dcounts, is_good);
}
"""
SIGMA0, FC, INERTIA, SPEED_GAIN = 100.0, 0.5, 0.002, 0.4


@pytest.fixture(scope="module")
def position_loop(root: Path, tmp_path_factory: pytest.TempPathFactory) -> ctypes.CDLL:
    lib = compiled(
        root, tmp_path_factory.mktemp("loop"), POSITION_LOOP, "position_loop/position_loop.c"
    )
    lib.tick.restype = ctypes.c_float
    return lib


def start(lib: ctypes.CDLL, Fc: float, gain: float, limit: float, rad: float = RAD) -> int:  # noqa: N803
    given = (SIGMA0 * Fc / FC, Fc, rad, gain, TICK_S, INERTIA, 15.0, limit, SPEED_GAIN)
    return int(lib.init(numbers(*given)))


def test_the_position_loop_adds_the_torques_of_python(position_loop: ctypes.CDLL) -> None:
    """With bad readings, and with a drive that is at its limit."""
    assert start(position_loop, FC, 0.9, FC / 2) == 0
    chance, friction = random.Random(4), (SIGMA0, FC, RAD)
    law = dahl.Compensator(
        *friction, reference=True, gain=0.9, limit=2 * FC, slew=200 * FC, period=TICK_S, rise=0.05,
        fall=0.02, noise=1, play=4, jump=1000)  # fmt: skip
    loop = {"inertia": INERTIA, "corner": 15.0, "speed_gain": SPEED_GAIN}
    observer = dahl.Residual(*friction, **loop, limit=FC / 2, slew=200 * FC, period=TICK_S)
    element = dahl.Friction(dahl.Plan(*friction))
    integral, error, speed, silent, clamped = 0.0, 0, 0.0, 0, 0
    for _ in range(5000):
        wanted, dcounts, is_good = (
            chance.randint(-9, 10),
            chance.randint(-9, 10),
            chance.random() < 0.9,
        )
        feed = [chance.uniform(-2, 2), chance.uniform(-99, 99), chance.uniform(-0.1, 0.1)]
        torque = position_loop.tick(wanted, numbers(*feed), dcounts, is_good)
        error, silent = error + wanted - dcounts * is_good, silent + 1
        if is_good:
            speed, silent = dcounts * RAD / (silent * TICK_S), 0
        law.move(dcounts, is_good)
        known = law.torque(element.step_counts_q30(wanted)) + feed[2]
        residual = observer.torque(law, dcounts)
        lack = feed[0] + 40 * error * RAD - speed
        integral = min(max(integral + SPEED_GAIN * lack * TICK_S / 0.06, -5), 5)
        due = SPEED_GAIN * lack + integral + known + INERTIA * feed[1] + residual
        clamped += abs(due) > 5
        due = min(max(due, -5), 5)
        observer.note(due - known)
        assert torque == pytest.approx(due, abs=2e-4)
    assert 10 < clamped < 4000


def follow(lib: ctypes.CDLL, rad: float, bad: float = 0.0) -> tuple[float, float]:
    """Return the RMS error in rad of 0.3 rad at 0.5 Hz, and the largest one late in a hold.
    A part of the readings is bad.
    """
    axis = Axis(FC, SIGMA0, INERTIA, peak=1.2, damping=0.1)
    noise, torque, counts, before, errors = random.Random(5), 0.0, 0, 0, []
    moving, rate = round(4 / TICK_S), math.pi
    for k in range(moving + round(1 / TICK_S)):
        time = min(k, moving) * TICK_S
        angle = 0.3 * math.sin(rate * time)
        feed = (0.3 * rate * math.cos(rate * time), -(rate**2) * angle, 0.0)
        feed = feed if k < moving else (0.0, 0.0, 0.0)
        wanted, reading = round(angle / rad), math.floor(axis.angle / rad + noise.uniform(-1, 1))
        errors.append(angle - axis.angle)
        axis.advance(torque, TICK_S)
        is_good = noise.random() >= bad
        torque = lib.tick(wanted - before, numbers(*feed), reading - counts, is_good)
        before, counts = wanted, reading if is_good else counts
    quarter = moving // 4
    return float(np.std(errors[quarter:moving])), max(map(abs, errors[-200:]))


@pytest.mark.parametrize(("share", "bad"), [(0.7, 0), (1.0, 0), (1.3, 0), (0.7, 0.02)])
def test_the_position_loop_follows_a_turn(
    position_loop: ctypes.CDLL, share: float, bad: float
) -> None:
    """Also if Fc is wrong by 30 %, and with bad readings. A hold does not hunt."""
    fine = 2 * math.pi / 2**17
    assert start(position_loop, FC, 0.0, 1e-9, fine) == 0
    without, _ = follow(position_loop, fine)
    assert start(position_loop, share * FC, 1.0, 0.64 * share * FC, fine) == 0
    found, hold = follow(position_loop, fine, bad)
    assert found < 0.12 * without and hold < 1e-3


# --- machine_axis ---------------------------------------------------------------------------------


@pytest.fixture
def quadrants(root: Path, monkeypatch: pytest.MonkeyPatch):
    pytest.importorskip("matplotlib", reason="unproven: the picture of docs/quadrants.md")
    monkeypatch.syspath_prepend(root / "examples/machine_axis")
    return importlib.import_module("quadrants")


def test_the_observer_takes_away_the_marks_of_the_quadrants(quadrants, tmp_path: Path) -> None:
    circle = quadrants.build(tmp_path)
    for friction in ("dahl", "lugre"):
        for feed in (1.0, 3.0):
            none, *laws = (quadrants.largest(circle, feed, friction, *case) for case in (
                ("none",), ("observer",), ("observer", 0.8), ("observer", 1.2)))  # fmt: skip
            assert 7.5 < none < 14 and max(laws) < none / 6 and max(laws) < 2.5


@pytest.mark.checks
def test_the_page_has_the_table_and_picture_of_its_program(
    quadrants, root: Path, tmp_path: Path
) -> None:
    def cells(text: str) -> list[float]:
        return [float(x) for x in re.findall(r"(?<=\| )\d+\.\d\d(?= \|)", text)]

    circle = quadrants.build(tmp_path)
    page = cells((root / "docs/quadrants.md").read_text())
    table = cells(quadrants.table(circle))
    assert len(page) == len(table) == 42 and page == pytest.approx(table, abs=0.011)
    quadrants.draw(circle, tmp_path / "picture.png")
    assert (tmp_path / "picture.png").stat().st_size > 20000


# --- hand_guiding ---------------------------------------------------------------------------------

HAND_GUIDING = """
#include "hand_guiding.h"
int init(const float *x, int32_t count)
{ return hand_guiding_init(&(hand_guiding_payload_t){x[0], x[1]}, count); }
"""
ARM_RAD = 2 * math.pi / 65536
ARM_WEIGHT = 4.0  # N m, true


@pytest.fixture(scope="module")
def arm(root: Path, tmp_path_factory: pytest.TempPathFactory) -> ctypes.CDLL:
    lib = compiled(
        root, tmp_path_factory.mktemp("arm"), HAND_GUIDING, "hand_guiding/hand_guiding.c"
    )
    lib.hand_guiding_tick.restype = ctypes.c_float
    return lib


def guide(
    lib: ctypes.CDLL, pose: float, hand: Callable[[float, Axis], float], seconds: float
) -> Axis:
    """Let a hand move the arm from a pose; hand(time, axis) returns its torque."""
    axis = Axis(1.0, 190.0, 0.05, peak=1.1, damping=0.3, angle=pose)
    noise, torque = random.Random(6), ARM_WEIGHT * math.cos(pose)
    for k in range(round(seconds / TICK_S)):
        count = math.floor(axis.angle / ARM_RAD + noise.uniform(-1, 1))
        pushed = hand(k * TICK_S, axis)
        axis.outside = lambda angle, pushed=pushed: pushed - ARM_WEIGHT * math.cos(angle)
        axis.advance(torque, TICK_S)
        torque = lib.hand_guiding_tick(count, 1)
    return axis


def tap(time: float, axis: Axis) -> float:
    """Push up and then down, 2 Fc for 30 ms each, after the fade-in."""
    return 2.0 * (0.7 < time < 0.73) - 2.0 * (1.2 < time < 1.23)


@pytest.mark.parametrize("error", [-0.1, 0.1])
@pytest.mark.parametrize("pose", [-2.5, -0.8, 0.0, 0.8, 1.5707])
def test_an_arm_stays_where_the_hand_leaves_it(arm: ctypes.CDLL, pose: float, error: float) -> None:
    """Its weight is wrong by 10 % up or down, as its load says."""
    weight = ARM_WEIGHT * (1 + error)
    assert arm.init(numbers(weight, 0.41), math.floor(pose / ARM_RAD)) == 0
    axis = guide(arm, pose, tap, 3.0)
    assert abs(axis.speed) < 0.02 and abs(axis.angle - pose) < 0.5


def test_a_load_that_was_not_said_moves_the_arm(arm: ctypes.CDLL) -> None:
    """The condition of the guarantee is needed: with gain 0.9, 10 % of the weight is too much."""
    assert arm.init(numbers(1.1 * ARM_WEIGHT, 0.0), 0) == 0
    assert abs(guide(arm, 0.0, tap, 3.0).angle) > 1.0
    assert arm.init(numbers(ARM_WEIGHT, 0.9), 0) != 0  # friction does not hold this load
    assert arm.init(numbers(ARM_WEIGHT, 2.0), 0) != 0


def test_the_hand_feels_less_friction(arm: ctypes.CDLL) -> None:
    """The hand swings the arm by 0.4 rad with a soft spring; without friction it needs 0.1 N m."""

    def work(load: float) -> float:
        torques = []

        def hand(time: float, axis: Axis) -> float:
            pushed = 60 * (0.4 * math.sin(2 * time) - axis.angle) - 2 * axis.speed
            torques.append(pushed)
            return pushed

        assert arm.init(numbers(ARM_WEIGHT, load), 0) == 0
        guide(arm, 0.0, hand, 4.0)
        return float(np.std(torques[1000:]))

    least, loaded, most = work(0.0), work(0.4), work(0.89)
    assert least < 0.35 * most and least < loaded < 0.75 * most


# --- geared_joint ---------------------------------------------------------------------------------

GEARED_JOINT = """
#include "geared_joint.h"
geared_joint_t joint;
int init(const float *x, float gain, float limit, float speed_gain, float rad, float joint_rad)
{
    const geared_joint_params_t params = {x[0], x[1], x[2], x[3], x[4], rad, joint_rad};
    const position_loop_params_t motor = {
        .compensator = {.gain = gain, .limit = 2, .slew = 20, .period = 1e-3f,
                        .play = 1, .jump = 4000},
        .observer = {.corner = 5, .limit = limit, .speed_gain = speed_gain, .delay = 1},
        .position_gain = 20, .integral_time = 0.1f, .drive_limit = 5};
    return geared_joint_init(&joint, &params, &motor, 0);
}
float tick(const float *x, int32_t dcounts, int32_t count, int joint_is_good)
{
    return geared_joint_tick(&joint, &(geared_joint_reference_t){x[0], x[1], x[2], x[3]},
                             &(geared_joint_readings_t){dcounts, count, 1, joint_is_good});
}
float at_motor(int k)
{
    const float found[] = {joint.motor.compensator.friction.Fc,
                           joint.motor.compensator.friction.sigma0, joint.motor.observer.inertia};
    return found[k];
}
"""
JOINT_RAD = 2 * math.pi / 2**19
MOTOR_FC, MOTOR_SIGMA0, ROTOR, LINK, LIFTED = 0.08, 1.6, 6e-5, 1.0, 20.0  # at motor, at joint


@pytest.fixture(scope="module")
def joint(root: Path, tmp_path_factory: pytest.TempPathFactory) -> ctypes.CDLL:
    files = ("geared_joint/geared_joint.c", "position_loop/position_loop.c")
    lib = compiled(root, tmp_path_factory.mktemp("joint"), GEARED_JOINT, *files)
    lib.init.argtypes = [ctypes.POINTER(ctypes.c_float), *5 * [ctypes.c_float]]
    lib.tick.restype = lib.at_motor.restype = ctypes.c_float
    return lib


def prepare_joint(lib: ctypes.CDLL, ratio: float, gain: float, limit: float) -> int:
    """The friction is given as a log at the joint shows it: at the joint a rad is `ratio` of the
    motor, a N m is 1/`ratio` of one.
    """
    N = abs(ratio)  # noqa: N806
    given = numbers(ratio, MOTOR_FC * N, MOTOR_SIGMA0 * N * N, LINK, ROTOR)
    speed_gain = 75 * (ROTOR + LINK / ratio**2)  # a bandwidth of 12 Hz
    return int(lib.init(given, gain, limit, speed_gain, RAD, JOINT_RAD))


def swing_joint(lib: ctypes.CDLL, ratio: float) -> tuple[float, float]:
    """Return the RMS error of the joint, 0.2 rad at 0.4 Hz, and its largest speed in a hold."""
    stiff, inertia = (2 * math.pi * 50) ** 2, LINK / ratio**2  # of the gear, seen from the motor
    axis = Axis(MOTOR_FC, MOTOR_SIGMA0, ROTOR, peak=1.2, stribeck_speed=5.0, damping=0.002,
                shaft=stiff * inertia * ROTOR / (ROTOR + inertia), load_inertia=inertia,
                outside=lambda angle: -LIFTED * math.sin(angle / ratio) / ratio)  # fmt: skip
    torque, before, errors, speeds, rate = 0.0, 0, [], [], 0.8 * math.pi
    for k in range(7000):
        time = min(k, 5000) * TICK_S
        angle = 0.1 * (1 - math.cos(rate * time))
        speed, acceleration = (
            0.1 * rate * math.sin(rate * time),
            0.1 * rate**2 * math.cos(rate * time),
        )
        if k >= 5000:
            speed = acceleration = 0.0
        errors.append(angle - axis.load_angle / ratio)
        speeds.append(abs(axis.load_speed / ratio))
        reading, count = (
            math.floor(axis.angle / RAD),
            math.floor(axis.load_angle / ratio / JOINT_RAD),
        )
        axis.advance(torque, TICK_S, 20)
        wanted = numbers(angle, speed, acceleration, LIFTED * math.sin(angle))
        good = k % 50 != 7
        torque = lib.tick(wanted, reading - before, count if good else 12345, good)
        before = reading
    return float(np.std(errors[1250:5000])), max(speeds[-500:])


def test_a_geared_joint_without_a_ratio_is_refused(joint: ctypes.CDLL) -> None:
    for ratio in (0.0, math.inf, math.nan):
        given = numbers(ratio, 8.0, 16000.0, LINK, ROTOR)
        assert joint.init(given, 0.9, 0.08, 0.01, RAD, JOINT_RAD) < 0


@pytest.mark.parametrize("ratio", [100.0, -50.0])
def test_a_geared_joint_follows(joint: ctypes.CDLL, ratio: float) -> None:
    assert prepare_joint(joint, ratio, 0.0, 1e-9) == 0
    without, _ = swing_joint(joint, ratio)
    assert prepare_joint(joint, ratio, 0.95, MOTOR_FC / 2) == 0
    inertia = ROTOR + LINK / ratio**2
    found = [joint.at_motor(k) for k in range(3)]
    assert found == pytest.approx([MOTOR_FC, MOTOR_SIGMA0, inertia], rel=1e-6)
    error, speed = swing_joint(joint, ratio)
    assert error < 0.3 * without and speed < 2e-3
