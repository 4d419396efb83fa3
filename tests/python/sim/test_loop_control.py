# SPDX-License-Identifier: MIT
"""The closed loop: the rotor against an ODE solver, drive and summary against trace and log, and
the benefit of friction compensation.
"""

import functools
import re
from collections.abc import Callable

import numpy as np
import pytest
from dahl.binding.library import c
from loop_model import nearest
from loop_tools import SCENES, Logged, counts_of, read_log, run, setting, word
from scipy.integrate import solve_ivp

SIGMA0, FC = 120.0, float(np.float32(1.8))
COUNT = float(np.float32(3.7450702829239285e-07))  # rad
COLUMNS = "time_s,reference_rad,angle_rad,velocity_rad_s,motor_Nm,friction_Nm,compensation_Nm"
TRACED = ("angle", "velocity", "friction", "hand")
Traced = tuple[dict[str, np.ndarray], dict, list[Logged]]


@pytest.fixture(scope="module")
def traced(tmp_path_factory):
    """Columns of --trace, by name without unit, summary and log; one run for each scene."""

    @functools.cache
    def of(scene: str, *sets: str) -> Traced:
        folder = tmp_path_factory.mktemp("traced")
        trace = folder / "trace.csv"
        words = ("--virtual", "--trace", trace, *setting(*sets))
        result = run(folder, SCENES / f"{scene}.ini", *words)
        assert (result.code, result.err) == (0, "")
        head = trace.read_text(encoding="ascii").partition("\n")[0]
        assert head == COLUMNS + ",hand_Nm" * any(word.startswith("hand.") for word in sets)
        names = [name.partition("_")[0] for name in head.split(",")]
        table = np.loadtxt(trace, delimiter=",", skiprows=1)
        return dict(zip(names, table.T, strict=True)), result.summary, read_log(result.log)

    return of


def solved(
    motor: np.ndarray,
    viscous: float,
    inertia: float,
    load: np.ndarray | float = 1.0,
    hand: Callable[[float, float, float], float] | None = None,
) -> np.ndarray:
    """(angle, velocity, friction) at each tick from rest on, by an ODE solver.

    Each tick is solved by itself, since the motor's torque and the load leap between two.
    """

    def slope(time: float, y: np.ndarray, torque: float, share: float) -> list[float]:
        angle, omega, friction = y
        bristle = SIGMA0 * (omega - abs(omega) * friction / (share * FC))
        if hand is not None:
            torque += hand(time, angle, omega)
        return [omega, (torque - viscous * omega - friction) / inertia, bristle]

    state, states = np.zeros(3), []
    loads = np.broadcast_to(load, len(motor))
    for tick, (torque, share) in enumerate(zip(motor, loads, strict=True)):
        states.append(state)
        start = [*state[:2], np.clip(state[2], -share * FC, share * FC)]
        span, given = (tick * 1e-3, (tick + 1) * 1e-3), (torque, share)
        done = solve_ivp(slope, span, start, args=given, method="DOP853", rtol=1e-11, atol=1e-13)
        state = done.y[:, -1]
    return np.array(states)


SOLVED = [  # scene, viscous, inertia, ticks, largest error in rad
    ("creep", 0.5, 0.02, 1500, 3e-6),
    ("slow-reversal", 0.02, 0.02, 2500, 1e-5),
    ("parking", 2.0, 0.05, 2500, 1e-5),
]


@pytest.mark.parametrize(("scene", "viscous", "inertia", "ticks", "angle_limit"), SOLVED)
def test_the_rotor_follows_an_ode_solver(traced, scene, viscous, inertia, ticks, angle_limit):
    trace, *_ = traced(scene, f"rotor.viscous={viscous}", f"rotor.inertia={inertia}")
    check_solved(trace, solved(trace["motor"][:ticks], viscous, inertia), angle_limit)


def check_solved(trace: dict[str, np.ndarray], states: np.ndarray, angle_limit: float) -> None:
    angle, velocity, friction = states.T
    assert np.abs(angle).max() > 100 * angle_limit
    ticks = len(angle)
    assert np.abs(trace["angle"][:ticks] - angle).max() < angle_limit
    assert np.abs(trace["velocity"][:ticks] - velocity).max() < 1e-3
    assert np.abs(trace["friction"][:ticks] - friction).max() < 1e-3 * FC


def test_python_steps_the_shaft_of_dahl_loop_bit_by_bit(traced):
    keys = {"stiffness": 40, "damping": 0.3, "amplitude": 0.2, "frequency": 1.5, "start": 0.2}
    trace, *_ = traced("slow-reversal", *(f"hand.{key}={value}" for key, value in keys.items()))
    shaft, hand = c.new("rotor_t *"), c.new("hand_t *", keys)
    wrong = [c.dahl_rotor_open(shaft, 0.02, 0.02, SIGMA0, Fc) for Fc in (-1.8, np.nan, 1e-30)]
    assert 0 not in wrong and c.dahl_rotor_open(shaft, 0.02, 0.02, SIGMA0, 1.8) == 0
    shaft.hand = hand
    for *due, motor in zip(*(trace[name] for name in TRACED), trace["motor"], strict=True):
        assert [shaft.theta, shaft.omega, shaft.friction, c.dahl_rotor_hand_torque(shaft)] == due
        c.dahl_rotor_advance(shaft, motor)


def test_friction_grows_with_a_load_above_1(traced):
    """Up to rotor_limit, while the node gets a load of 1 at most."""
    sets = ["friction.model=loaded", "load.full=1.5", "load.rest=0.25", "motor.bias=0"]
    sets += ["motor.amplitude=3.5", "motor.seconds=1"]
    trace, _, log = traced("creep", *sets, "load.rotor_limit=1.75")
    load = np.floor(np.minimum(1.75, 0.25 + np.abs(trace["motor"]) / 1.5) * 65536 + 0.5) / 65536
    check_solved(trace, solved(trace["motor"], 0.5, 0.02, load=load), 1e-5)
    assert np.abs(trace["friction"]).max() > 1.7 * FC
    sent = [word(frame.data, 4) for frame in log if frame.id == 0x130]
    assert max(sent) == 65536
    limited, *_ = traced("creep", *sets)
    assert 0.99 * FC < np.abs(limited["friction"]).max() <= FC * (1 + 1e-6)


IDLE = ("motor.bias=0", "motor.amplitude=0", "motor.seconds=1.2")


@pytest.mark.parametrize(
    ("scene", "sets", "viscous"), [("creep", IDLE, 0.5), ("slow-reversal", (), 0.02)]
)
def test_a_hand_leads_the_shaft(traced, scene, sets, viscous):
    """A spring and a damper pull it along a sine from a start on, beside any motor."""
    stiffness, damping, amplitude, rate = 40.0, 0.3, 0.2, 2 * np.pi * 1.5

    def hand(time: float, angle: float, omega: float) -> float:
        if time < 0.2:
            return 0.0
        path, speed = np.sin(rate * (time - 0.2)), rate * np.cos(rate * (time - 0.2))
        return stiffness * (amplitude * path - angle) + damping * (amplitude * speed - omega)

    keys = {"stiffness": 40, "damping": 0.3, "amplitude": 0.2, "frequency": 1.5, "start": 0.2}
    trace, *_ = traced(scene, *(f"hand.{key}={value}" for key, value in keys.items()), *sets)
    check_solved(trace, solved(trace["motor"][:1200], viscous, 0.02, hand=hand), 1e-5)
    rows = zip(trace["time"], trace["angle"], trace["velocity"], strict=True)
    due = np.array([hand(time + 1e-9, angle, omega) for time, angle, omega in rows])
    assert np.abs(trace["hand"] - due).max() < 1e-6 < FC < np.abs(due).max()


def used_answers(log: list[Logged], ticks: int) -> np.ndarray:
    """The torque of the drive at each tick: the last answer, for three ticks."""
    answers = {round(f.time * 1000): word(f.data, 4) / 2**30 * FC for f in log if f.id == 0x110}
    recent = [[answers.get(tick - age) for age in (1, 2, 3)] for tick in range(ticks)]
    return np.array([next((one for one in row if one is not None), 0.0) for row in recent])


def drive(trace: dict[str, np.ndarray], kp: float, kd: float, limit: float) -> np.ndarray:
    """Motor torque: PD on counts with a filtered rate, plus friction feedforward, limited."""
    seen = np.array([nearest(angle / COUNT) for angle in trace["angle"]])
    error = np.rint(trace["reference"] / COUNT) - seen
    rates, rate = [], 0.0
    for change in np.diff(error, prepend=0):
        rate += 0.2 * (change - rate)
        rates.append(rate)
    feedback = COUNT * (kp * error + kd * np.array(rates) / 0.001)
    return np.clip(feedback + trace["compensation"], -limit, limit)


def turns(signs: np.ndarray) -> int:
    return np.count_nonzero(np.diff(signs[signs != 0]))


DROPS = ("friction.max_step=100000", "faults.drop=0.45", "faults.silence=0.01")
DROPS += ("friction.ramp_ms=0",)
BACKWARD = [f"motion.theta{k}={end}" for k, end in ((1, -100000), (2, -90000), (3, -100000))]
DRIVEN = [  # scene, settings, kp, kd, limit
    ("parking", (), 60, 2, 8),
    ("parking", ("control.torque_limit=1.5",), 60, 2, 1.5),
    ("parking", ("motion.tremor=20000", "motion.tremor_s=0.2", "motion.seconds=10"), 60, 2, 8),
    ("parking", DROPS, 60, 2, 8),
    ("parking", ("friction.model=asymmetric", "friction.Fc=1.8 1.1"), 60, 2, 8),
    ("slow-reversal", (), 60, 2, 6),
    ("slow-reversal", ("control.kp=55", "control.kd=3", *BACKWARD), 55, 3, 6),
]


@pytest.mark.parametrize(("scene", "sets", "kp", "kd", "limit"), DRIVEN)
def test_the_trace_agrees_with_bus_drive_and_summary(traced, scene, sets, kp, kd, limit):
    """Reference, compensation and motor torque row by row; errors and sign changes of the run."""
    trace, summary, log = traced(scene, *sets)
    ticks = summary["ticks"]
    assert len(trace["time"]) == ticks == summary["frames_sent"]
    assert np.abs(trace["time"] - np.arange(ticks) * 1e-3).max() < 1e-9
    sent = {round(f.time * 1000): word(f.data, 2) * COUNT for f in log if f.id == 0x100}
    rows = np.array([*sent])
    assert np.abs(trace["reference"][rows] - np.array([*sent.values()])).max() < 1e-12
    assert len(rows) == ticks or sets == DROPS
    assert np.abs(trace["compensation"] - used_answers(log, ticks)).max() < 1e-12
    assert np.abs(trace["motor"] - drive(trace, kp, kd, limit)).max() < 1e-9
    control, error = summary["control"], trace["reference"] - trace["angle"]
    assert control["max_error_rad"] == pytest.approx(np.abs(error).max(), rel=1e-9)
    assert control["rms_error_rad"] == pytest.approx(np.sqrt(np.mean(error**2)), rel=1e-9)
    assert control["torque_alternations"] == turns(np.sign(trace["motor"]))
    assert control["reference_reversals"] == turns(np.sign(np.diff(trace["reference"]))) >= 2


def test_a_driven_shaft_is_read_to_the_count_until_its_motor_ends(traced):
    """There is no feedforward. The reference is the count itself."""
    sets = ("motor.bias=-0.2", "motor.amplitude=0.3", "motor.frequency=5", "motor.seconds=1.3")
    trace, summary, log = traced("creep", *sets)
    assert (summary["ticks"], "control" in summary) == (1300, False)
    due = -0.2 + 0.3 * np.sin(2 * np.pi * 5 * trace["time"])
    assert np.abs(trace["motor"] - due).max() < 1e-9
    assert counts_of(log) == [nearest(angle / COUNT) for angle in trace["angle"]]
    assert (np.abs(trace["reference"] - np.array(counts_of(log)) * COUNT) < 1e-12).all()
    assert not trace["compensation"].any()


@pytest.mark.parametrize("scene", ["slow-reversal", "parking"])
def test_compensation_divides_the_error_by_five_without_chatter(traced, scene):
    """The motor torque changes its sign at most once for each reversal of the reference."""
    _, without, _ = traced(scene, "friction.gain=0")
    trace, summary, _ = traced(scene)
    control = summary["control"]
    assert np.abs(trace["compensation"]).max() <= 0.95 * FC * (1 + 1e-6)
    assert without["control"]["rms_error_rad"] >= 5 * control["rms_error_rad"]
    assert control["torque_alternations"] <= control["reference_reversals"]
    assert turns(np.sign(trace["compensation"])) <= control["reference_reversals"]


STRONG = ["control.kp=1e12", "control.torque_limit=1e12", "rotor.inertia=3e-7"]
AWAY = [  # scene, settings, largest count of the message
    ("creep", ["motor.bias=1e12", "rotor.inertia=5e-6"], np.inf),
    ("slow-reversal", STRONG, np.inf),
    ("creep", ["motor.bias=2e9"], 1.002 * 2**53),  # against the viscous friction: 4e9 rad/s
]


@pytest.mark.parametrize(("scene", "sets", "most"), AWAY)
def test_a_shaft_beyond_2_to_the_53_counts_is_an_error(tmp_path, scene, sets, most):
    """The frames before it are logged. At a thousandth of the limit in each tick, the count is just
    beyond. A motion that fails has not ended, so --seconds adds no warning.
    """
    words = ("--virtual", "--seconds", "1000", *setting(*sets))
    result = run(tmp_path, SCENES / f"{scene}.ini", *words)
    seconds, counts = re.search(r"(\S+) s: .* (\S+) counts.*2\^53", result.error(2)).groups()
    assert round(float(seconds) * 1000) == result.summary["ticks"] > 0
    assert 2**53 < abs(float(counts)) < most
    assert len(read_log(result.log)) > result.summary["ticks"]


LIGHT = [  # viscous friction, sigma0, stiffness and damping of a hand at rest
    (0.0, 120.0, 0.0, 0.0),
    (1e-4, 314.0, 0.0, 0.0),
    (100.0, 10.0, 0.0, 0.0),
    (0.5, 120.0, 1e5, 0.5),
    (0.5, 120.0, 1e3, 50.0),
]


@pytest.mark.parametrize(("viscous", "sigma0", "stiffness", "damping"), LIGHT)
def test_an_inertia_below_the_limit_is_refused_and_the_limit_is_stable(
    tmp_path, viscous, sigma0, stiffness, damping
):
    """At the limit of the message, angle, speed and friction stay within their drive."""
    keys = [f"rotor.viscous={viscous}", f"rotor.sigma0={sigma0}", "motor.seconds=2"]
    if stiffness:
        keys += [f"hand.stiffness={stiffness}", f"hand.damping={damping}"]
        keys += ["hand.amplitude=0", "hand.frequency=0"]
    words = (SCENES / "creep.ini", "--virtual", *setting(*keys, "motor.amplitude=2"))
    error = run(tmp_path, *words, *setting("rotor.inertia=1e-9")).error(2)
    assert ": rotor.inertia = 1e-09: " in error
    least = float(re.search(r"below (\S+),", error)[1])
    due = max((viscous + damping) * 1e-5, (sigma0 + stiffness / 2) * 4e-10)
    assert least == pytest.approx(due, rel=1e-8)
    trace = tmp_path / "trace.csv"
    done = run(tmp_path, *words, *setting(f"rotor.inertia={least!r}"), "--trace", trace)
    if viscous == 0 and "2^53" in done.err:
        return  # free and light: it does fly away
    assert (done.code, done.err) == (0, "")
    angle, speed, _, friction = np.abs(np.loadtxt(trace, delimiter=",", skiprows=1).T[2:6])
    assert friction.max() <= FC * (1 + 1e-6)
    if viscous >= 100:  # overdamped: the speed follows the torque
        assert speed.max() <= 1.05 * (3 + FC) / viscous
    if stiffness:
        assert angle.max() < 1.5 * (2.9 + FC) / stiffness
