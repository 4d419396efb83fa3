# SPDX-License-Identifier: MIT
"""dahl.Slip, Parallel, Asymmetric, ElastoPlastic, Loaded, Work, VelocityTable and the fast forms
against exact fractions, closed forms in 50 digits, and a solver of their differential equations.
"""

from __future__ import annotations

import copy
import math
import random
from collections.abc import Callable
from fractions import Fraction

import dahl
import mpmath
import numpy as np
import pytest
from scipy.integrate import solve_ivp

pytestmark = pytest.mark.usefixtures("library")

PLAN = dahl.Plan(100.0, 0.5, 2e-4)
SIGMA0, FC, THETA = [100.0, 70.0, 3.0], [0.5, 1.25, 0.01], 2e-4
ULPS = 0.55  # of Fc (of the sum, of the larger one): what the docstrings promise
FAST_ULPS = 0.5001  # of ThroughputSlip
MADE = {
    "asymmetric": lambda: dahl.Asymmetric(100.0, 0.5, 0.3, THETA),
    "elastoplastic": lambda: dahl.ElastoPlastic(100.0, 0.5, THETA, 0.7),
    "slip": lambda: dahl.Slip(SIGMA0, FC, THETA),
    "work": lambda: dahl.Work(PLAN),
    "parallel": lambda: dahl.Parallel(dahl.Friction(PLAN), dahl.Slip(SIGMA0, FC, THETA)),
    "velocity": lambda: dahl.VelocityTable([0.1 * k - 0.3 for k in range(16)], 2),
}
LARGER_FC = {"asymmetric": 0.5, "elastoplastic": 0.5, "slip": sum(FC), "parallel": sum(FC) + 0.5}


@pytest.fixture
def moves() -> np.ndarray:
    return np.random.default_rng(5).integers(-60, 61, 3000).astype(np.int32)


def ulp_of(torque: float) -> float:
    return float(np.spacing(np.float32(torque)))


# --- a log, its moves one by one, and the ratio ---------------------------------------------------


@pytest.mark.parametrize("name", MADE)
def test_a_log_has_the_bits_of_its_moves(name, moves):
    one, many, by_ratio = MADE[name](), MADE[name](), MADE[name]()
    out = np.empty(moves.size, np.float32)
    found = many.run_counts(moves, out)
    assert found is out and np.ptp(found) > 0.3
    assert found.tolist() == [one.step_counts(int(move)) for move in moves]
    if name != "velocity":  # which keeps nothing
        assert one == many and many.torque == found[-1]
    if name in LARGER_FC:
        ratios = [by_ratio.step_counts_q30(move) * 2.0**-30 for move in moves.tolist()]
        assert ratios == pytest.approx(found.astype(float) / LARGER_FC[name], abs=7e-8)


def test_a_loaded_log_has_the_bits_of_its_moves(moves):
    """By counts and by angles; at a load of 1 they are those of a bearing."""
    loads, whole = np.random.default_rng(6).uniform(0, 1.99, moves.size), np.ones(moves.size, int)
    angles = (moves * THETA).astype(np.float32)
    for fixed, path, run, step in (
        (False, moves, "run_counts", "step_counts"),
        (True, angles, "run", "step"),
    ):
        one, many, steady = (dahl.Loaded(PLAN, fixed_stiffness=fixed) for _ in range(3))
        found = getattr(many, run)(path, loads, out := np.empty(moves.size, np.float32))
        assert found is out and many.torque == found[-1]
        pairs = zip(path.tolist(), loads.tolist(), strict=True)
        assert found.tolist() == [getattr(one, step)(*pair) for pair in pairs]
        assert one == many and many.load == round(loads[-1] * 2**30) / 2**30
        bearing = dahl.Friction(PLAN)
        assert (getattr(steady, run)(path, whole) == getattr(bearing, run)(path)).all()
    loaded, bearing = dahl.Loaded(PLAN), dahl.Friction(PLAN)
    assert loaded.step_counts_q30(7, 1) == bearing.step_counts_q30(7)


@pytest.mark.parametrize("kind", [np.float16, np.float32, np.float64])
def test_moves_and_loads_are_the_same_in_any_type(kind):
    """The range of half precision ends below that of the int32 that moves are compared with."""
    moves, loads = np.array([1000, 1000, 0], kind), np.array([1.0, 0.5, 1.5], kind)
    torques = dahl.Loaded(dahl.Plan(100, 0.5, 1e-3)).run_counts(moves, loads)
    assert torques.tolist() == [0.5, 0.25, 0.25]


# --- slip elements and mixes ----------------------------------------------------------------------


def as_float(x: float) -> Fraction:
    return Fraction(float(np.float32(x)))


def exact_slip(sigma0, torques, moves, exact=as_float) -> list[Fraction]:
    """Springs that slip, in exact fractions of the parameters, as C takes them."""
    stiff, most = [exact(x) * exact(THETA) for x in sigma0], [exact(x) for x in torques]
    force, sums = [Fraction(0)] * len(stiff), []
    for move in moves.tolist():
        limited = zip(force, stiff, most, strict=True)
        force = [max(-F, min(F, f + k * move)) for f, k, F in limited]
        sums.append(sum(force))
    return sums


def test_slip_is_exact(moves):
    """In N m, as a part of the sum of Fc, and the fast form in fractions of the doubles given."""
    slip, by_ratio = MADE["slip"](), MADE["slip"]()
    exact, ulp = exact_slip(SIGMA0, FC, moves), Fraction(ulp_of(sum(FC)))
    found = [Fraction(float(torque)) for torque in slip.run_counts(moves)]
    assert max(abs(a - b) for a, b in zip(found, exact, strict=True)) <= Fraction(ULPS) * ulp
    total = sum(map(as_float, FC))
    ratios = [Fraction(by_ratio.step_counts_q30(move), 2**30) for move in moves.tolist()]
    assert max(abs(a - b / total) for a, b in zip(ratios, exact, strict=True)) < Fraction(4e-9)
    fast = dahl.ThroughputSlip(SIGMA0, FC, THETA).run_counts(moves)
    exact = exact_slip(SIGMA0, FC, moves, Fraction)
    errors = [abs(Fraction(float(a)) - b) for a, b in zip(fast, exact, strict=True)]
    assert max(errors) <= Fraction(FAST_ULPS) * ulp


def test_a_mix_is_the_sum_of_its_parts(moves):
    """Of parts that it moves, by the plans that they have at the time; and so is the fast form."""
    alone, mix = dahl.Friction(PLAN), MADE["parallel"]()
    exact = np.array(exact_slip(SIGMA0, FC, moves), float) + alone.run_counts(moves)
    found, ulp = mix.run_counts(moves), ulp_of(sum(FC) + 0.5)
    assert np.abs(found - exact).max() <= (ULPS + 0.52) * ulp  # alone is rounded too
    assert mix.parts[0] == alone and mix.torque == found[-1]
    alike = copy.deepcopy(mix)
    for torque in (2.0, 0.5):
        for each in (mix, alike):
            each.parts[0].change_plan(dahl.Plan(80.0, torque, THETA))
        ratio = mix.step_counts_q30(3) * 2.0**-30
        assert ratio == pytest.approx(alike.step_counts(3) / (sum(FC) + torque), abs=7e-8)
    assert dahl.Parallel().step_counts_q30(3) == 0
    theta, limit = (float(np.float32(value)) for value in (THETA, FC[1]))
    same = dahl.Parallel(
        dahl.Friction(dahl.Plan(80, 2, theta)), dahl.Slip([100], [limit], theta)
    ).run_counts(long := np.tile(moves, 10))
    fast = dahl.ThroughputParallel(
        dahl.Throughput(80, 2, theta), dahl.ThroughputSlip([100], [limit], theta)
    )
    for _ in range(2):  # nothing is kept
        assert np.abs(fast.run_counts(long).astype(float) - same).max() <= 1.07 * ulp_of(3.25)
    assert dahl.ThroughputParallel().run_counts([1, 2]).tolist() == [0, 0]


@pytest.mark.parametrize("threads", [2, 3])
def test_threads_go_on_where_the_part_before_them_ends(threads):
    """Also in a long log of so little motion that no part forgets its start, by the closed form."""
    ticks, fast = 3 * 2**18, dahl.Throughput(100.0, 0.5, 1e-8)
    travel = fast.travel_per_count * np.arange(1, ticks + 1)
    wanted = 0.5 - (0.5 + 0.3) * np.exp(-travel)
    found = fast.run_counts(np.ones(ticks, np.int32), F=-0.3, threads=threads)
    assert np.abs(found - wanted).max() <= ulp_of(0.5)


# --- a load that leaves the stiffness -------------------------------------------------------------


def exact_clamped(plan: dahl.Plan, angles: np.ndarray, loads: np.ndarray) -> list[mpmath.mpf]:
    """F' = sigma0 (1 - F/(load Fc)) forward, from tick to tick; sigma0 stays, F is cut off at
    load*Fc.
    """
    found, F = [], mpmath.mpf(0)
    for angle, load in zip(angles.tolist(), loads.tolist(), strict=True):
        most = mpmath.mpf(plan.Fc) * load
        F = max(-most, min(most, F))
        if load and angle:
            end = math.copysign(1, angle) * most
            F = end - (end - F) * mpmath.exp(-plan.sigma0 * abs(mpmath.mpf(angle)) / most)
        found.append(F)
    return found


def test_a_load_that_leaves_the_stiffness_is_exact(moves):
    """Within 0.6 ulp of Fc, or of load*Fc where that is more."""
    angles = (moves[:1000] * THETA).astype(np.float32)
    loads = np.random.default_rng(6).integers(0, 2**11, angles.size) / 2**10
    loads[-1] = math.nextafter(2, 0)  # which is rounded down
    part = dahl.Loaded(PLAN, fixed_stiffness=True)
    found = part.run(angles, loads)
    assert part.load == 2 - 2.0**-30
    with mpmath.workdps(50):
        exact = exact_clamped(PLAN, angles, loads)
        ulps = np.spacing(np.float32(PLAN.Fc) * np.maximum(loads, 1).astype(np.float32))
        pairs = zip(found.tolist(), exact, ulps.tolist(), strict=True)
        assert max(abs(F - E) / ulp for F, E, ulp in pairs) <= 0.6
    assert part.step(math.inf, 0.5) == 0.25 and part.step(math.nan, 1.0) == 0.25
    assert part.step(1e300, 1.5) == 0.75


# --- against a solver, event by event: dF/dtheta is stated here, and no closed form ---------------

STIFF, MOST, COUNT = (float(np.float32(x)) for x in (100.0, 0.7, 1e-3))
SOLVER = 2e-9 * MOST  # what the solver itself may err by
Slope = Callable[[float, int], float]


def integrated(
    slope: Slope, F: float, counts: int, stop: float | None = None, below: Slope | None = None
) -> tuple[float, float]:
    """F after a move, and its work. Where the slope has a corner at F = stop, it is `below` up to
    there, and the solver, which no corner may meet inside a step, begins anew.
    """
    s, left, work = (1 if counts > 0 else -1), abs(counts) * COUNT, 0.0

    def corner(_: float, y: np.ndarray) -> float:
        return float(y[0]) - s * (stop or 0.0)

    corner.terminal = True  # type: ignore[attr-defined]
    while left > 0:
        is_below = stop is not None and s * F < stop
        here, events = (below, corner) if is_below and below else (slope, None)
        done = solve_ivp(
            lambda _, y, here=here: [s * here(y[0], s), s * y[0]],
            (0, left),
            [F, 0.0],
            method="DOP853",
            rtol=1e-11,
            atol=1e-13,
            events=events,
        )
        hit = events is not None and done.status == 1
        left = left - float(done.t[-1]) if hit else 0.0
        F = s * stop if hit and stop is not None else float(done.y[0][-1])
        work += float(done.y[1][-1])
    return F, work


def walk(seed: int) -> list[int]:
    """Counts of moves that slide, that do not, and of one count."""
    random.seed(seed)
    return [random.choice((-1, 1)) * random.choice((1, 2, 5, 7, 12, 40, 300)) for _ in range(300)]


def dahl_slope(F: float, s: int) -> float:
    return STIFF * (1 - s * F / MOST)


def test_asymmetric_follows_its_equation():
    backward, F = float(np.float32(0.3)), 0.0
    part = dahl.Asymmetric(STIFF, MOST, backward, COUNT)

    def slope(F: float, s: int) -> float:  # noqa: N803
        return STIFF * (1 - F / MOST) if s > 0 else STIFF * (1 + F / backward)

    for counts in walk(1):
        F, _ = integrated(slope, F, counts)
        assert abs(part.step_counts(counts) - F) <= ULPS * ulp_of(MOST) + SOLVER
        assert abs(part.state.w * 2.0**-62 - F / MOST) <= 1.5e-9 + SOLVER


@pytest.mark.parametrize("b", [0.1, 0.5, 0.95])
def test_elastoplastic_follows_its_equation(b):
    b, F = float(np.float32(b)), 0.0
    part = dahl.ElastoPlastic(STIFF, MOST, COUNT, b)
    for counts in walk(2):
        F, _ = integrated(
            lambda F, s: dahl_slope(F, s) / (1 - b), F, counts, b * MOST, lambda *_: STIFF
        )
        assert abs(part.step_counts(counts) - F) <= ULPS * ulp_of(MOST) + SOLVER


def test_elastoplastic_does_not_creep_below_breakaway():
    """Whole counts to and fro at half of Fc: nothing is left of them, in exact fractions."""
    part = dahl.ElastoPlastic(128.0, 0.5, 2.0**-13, 0.7)
    assert part.step_counts(10) == Fraction(10 * 128, 2**13)
    part.run_counts(np.tile([6, -6], 50_000).astype(np.int32))
    assert part.torque == Fraction(10 * 128, 2**13)


def test_loaded_follows_its_equation():
    """A falling load takes F with it; a growing one leaves it."""
    part, F, before = dahl.Loaded(dahl.Plan(STIFF, MOST, COUNT)), 0.0, 0.0
    for counts in walk(3):
        c = random.randrange(1 << 31) / 2**30
        F *= min(1.0, c / before) if before > 0 else 1.0
        F, _ = integrated(lambda F, s, c=c: c * dahl_slope(F / c, s), F, counts)
        before = c
        assert abs(part.step_counts(counts, c) - F) <= ULPS * 2 * ulp_of(MOST) + SOLVER
        assert part.load == c


def test_work_is_the_integral_of_the_torque():
    """Beside the torques of a bearing, bit for bit; also from a state that was put back."""
    plan = dahl.Plan(STIFF, MOST, COUNT)
    part, bearing, F, work = dahl.Work(plan), dahl.Friction(plan), 0.0, 0.0
    for counts in walk(4):
        F, more = integrated(dahl_slope, F, counts)
        work += more
        torque = part.step_counts(counts)
        assert (
            torque == bearing.step_counts(counts)
            and abs(torque - F) <= ULPS * ulp_of(MOST) + SOLVER
        )
        assert part.work == pytest.approx(work, rel=2e-7, abs=1e-9)
    assert part.state == bearing.state
    far = dahl.Work(plan)
    far.state.w = part.state.w
    assert far.state == part.state and far != part


def test_a_table_over_speed_is_odd_and_linear_in_between():
    torques = [0.5, 0.3, 0.25, 0.0, -0.125, *(0.1 * k for k in range(1, 12))]
    table, speeds = dahl.VelocityTable(torques, 3), np.arange(-200, 201)
    values = np.array([0.0, *torques], np.float32)
    wanted = np.interp(abs(speeds), 8 * np.arange(17), values) * np.sign(speeds)
    slack = 1.5 * 2.0**-30 * max(torques) + 2.0**-24
    assert np.abs(table.run_counts(speeds) - wanted).max() <= slack
    assert table.step_counts(-(2**31)) == -np.float32(torques[-1])
