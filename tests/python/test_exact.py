# SPDX-License-Identifier: MIT
"""The library, by its Python names, against exact fractions and 50 digits: which parameters it
takes, single moves, long mixed motions, changes of plan, and the ways from readings to counts.

Nothing here shares a formula with the library: it steps by a table, the references are closed.
"""

from __future__ import annotations

import copy
import math
import pickle
from collections.abc import Iterator
from fractions import Fraction
from random import Random

import dahl
import mpmath
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sources import number

pytestmark = pytest.mark.usefixtures("library")

ULP_COUNTS, ULP_ANGLE = number("DAHL_ULP_COUNTS"), number("DAHL_ULP_ANGLE")
ONE = 1 << 62  # of a state
STATE_END = ONE + (1 << 31)  # each call leaves -STATE_END <= w < STATE_END (dahl.h)
digits = mpmath.mp.clone()
digits.dps = 50


def as_float(x: float) -> float:
    return float(np.float32(x))


def float32(low: float, high: float) -> st.SearchStrategy[float]:
    return st.floats(as_float(low), as_float(high), width=32)


# --- which parameters are taken -------------------------------------------------------------------


def near_a_limit(random: Random, count: int) -> Iterator[tuple[float, float, float]]:
    """Floats whose travel of one count is at 2^-30 or 2^20, just beside it, or on it: few bits make
    products exactly on the limit, many make those beside it.
    """
    for _ in range(count):
        limit, bits = random.choice([2.0**-30, 2.0**20]), random.choice([1, 2, 3, 12, 24])
        sigma0, torque = (
            as_float(random.randint(1, 2**bits) * 2.0 ** random.randint(-10, 10)) for _ in range(2)
        )
        theta = np.float32(limit * torque / sigma0)
        side = np.float32(random.choice([0, theta, math.inf]))
        yield sigma0, torque, float(np.nextafter(theta, side))


def doubles_near_a_limit(random: Random, count: int) -> Iterator[tuple[float, float, float]]:
    for _ in range(count):
        sigma0, torque = random.uniform(1e-3, 1e3), random.uniform(1e-3, 1e3)
        theta = random.choice([2.0**-30, 2.0**20]) * torque / sigma0
        yield sigma0, torque, math.nextafter(theta, random.choice([0.0, math.inf]))


def is_taken(kind: type, *parameters: float) -> bool:
    try:
        kind(*parameters)
    except dahl.Error as error:
        assert "travel" in str(error) and "2^-30" in str(error) and "2^20" in str(error)
        return False
    return True


def test_the_limits_of_a_travel_are_decided_exactly():
    """2^-30 is in, 2^20 is out, also where sigma0/Fc has no end in binary."""
    on_it = [(1.0, 3.0, 3 * 2.0**-30), (2.0**20, 3.0, 3.0)]
    floats, doubles = near_a_limit(Random(1), 6000), doubles_near_a_limit(Random(2), 6000)
    cases = [((dahl.Plan, dahl.Throughput), one) for one in (*on_it, *floats)]
    cases += [((dahl.Throughput,), one) for one in doubles]
    for kinds, (sigma0, torque, theta) in cases:
        travel = Fraction(sigma0) * Fraction(theta) / Fraction(torque)
        within = Fraction(1, 2**30) <= travel < 2**20
        for kind in kinds:
            assert is_taken(kind, sigma0, torque, theta) == within, (kind, sigma0, torque, theta)


# --- torques --------------------------------------------------------------------------------------


def exact_travel(plan: dahl.Plan) -> mpmath.mpf:
    """sigma0/Fc theta_per_count of the floats, exactly, then to 50 digits."""
    u = Fraction(plan.sigma0) / Fraction(plan.Fc) * Fraction(plan.theta_per_count)
    return digits.mpf(u.numerator) / u.denominator


def solve(w: mpmath.mpf, u: mpmath.mpf, direction: int) -> mpmath.mpf:
    """Eq. 1 for one travel u: the gap to the limit shrinks by exp(-u)."""
    return direction - (direction - w) * digits.exp(-u)


plans = st.builds(
    lambda travel, Fc, theta: dahl.Plan(travel * Fc / theta, Fc, theta),
    st.floats(math.log(1.1e-9), math.log(900)).map(math.exp),
    float32(1e-3, 1e3),
    float32(1e-7, 1e-1),
)
counts = st.one_of(st.integers(-9, 9), st.integers(-5000, 5000), st.integers(-(2**31), 2**31 - 1))


@given(plans)
def test_single_moves_from_rest_are_exact_to_32_bits(plan):
    """By 1 .. 8 and 16 .. 2^30 counts, each of which is one entry of the plan's table."""
    u = exact_travel(plan)
    for n in (*range(1, 9), *(2**k for k in range(4, 31))):
        bearing = dahl.Friction(plan)
        bearing.step_counts(n)
        wanted = -digits.expm1(-u * n)
        error = abs(digits.mpf(bearing.state.w) / ONE - wanted)
        assert error <= wanted / 2**32 + digits.mpf(2) ** -61, n


@given(plans, st.lists(counts, max_size=40))
def test_moves_in_counts_are_exact(plan, moves):
    """And the ratio of the bus is the same state, rounded to Q30."""
    bearing, by_ratio = dahl.Friction(plan), dahl.Friction(plan)
    w, u = digits.mpf(0), exact_travel(plan)
    for n in moves:
        w = solve(w, u * abs(n), 1 if n > 0 else -1) if n else w
        assert abs(bearing.step_counts(n) - w * plan.Fc) <= ULP_COUNTS * plan.ulp
        ratio = by_ratio.step_counts_q30(n)
        assert by_ratio.state == bearing.state and abs(ratio - bearing.state.w / 2**32) <= 0.51


@given(plans, st.lists(float32(-1e3, 1e3), max_size=40))
def test_moves_by_angle_are_exact(plan, moves):
    """Angles scaled so that travels from 1e-12 to 1e3 presliding lengths occur."""
    bearing, w = dahl.Friction(plan), digits.mpf(0)
    a = digits.mpf(plan.sigma0) / plan.Fc
    for n, move in enumerate(moves):
        dtheta = as_float(move * 10.0 ** -(n % 12) / float(a))
        w = solve(w, a * abs(digits.mpf(dtheta)), 1 if dtheta > 0 else -1)
        assert abs(bearing.step(dtheta) - w * plan.Fc) <= ULP_ANGLE * plan.ulp


def test_states_stay_where_the_header_says():
    """From both ends of the range, by every call."""
    bearing = dahl.Friction(dahl.Plan(100.0, 0.5, 1e-3))
    by_counts = (bearing.step_counts, (0, 1, -8, 9, -9, 1000, -1000, 2**31 - 1, -(2**31)))
    by_angle = (bearing.step, (0.0, 1e-20, -1e-3, 10.0, math.inf, -math.inf, math.nan))
    ratio = (bearing.step_counts_q30, by_counts[1])
    for w in (STATE_END - 1, ONE, ONE - 1, -ONE, -STATE_END, 1 - STATE_END):
        for (call, moves), most in ((by_counts, 0.5), (by_angle, 0.5), (ratio, 2**30)):
            for move in moves:
                bearing.state.w = w
                assert abs(call(move)) <= most and abs(bearing.torque) <= 0.5
                assert -STATE_END <= bearing.state.w < STATE_END
        bearing.state.w = w
        bearing.change_plan(bearing.plan)
        assert abs(bearing.state.w) <= ONE


# --- setting a torque, another plan ---------------------------------------------------------------


@given(float32(2.0**-20, 2.0**20), st.floats(-1, 1))
def test_a_torque_that_is_set_comes_back(Fc, ratio):  # noqa: N803
    """Clamped to +-Fc; NaN changes nothing."""
    bearing = dahl.Friction(dahl.Plan(Fc, Fc))
    wanted = as_float(ratio * Fc)
    wanted = 0.0 if abs(wanted) < 2.0**-36 * Fc else wanted
    for value, comes_back in ((wanted, wanted), (math.inf, Fc), (-2 * Fc, -Fc), (math.nan, -Fc)):
        bearing.torque = value
        assert bearing.torque == np.float32(comes_back)


def changed(before: dahl.Plan, after: dahl.Plan, w: int) -> Fraction:
    """F in N m after a change of plan as dahl.h says it, in fractions."""
    F = Fraction(w, ONE) * Fraction(before.Fc)
    F *= min(Fraction(1), Fraction(after.sigma0) / Fraction(before.sigma0))
    return max(-Fraction(after.Fc), min(Fraction(after.Fc), F))


def test_a_change_of_plan_keeps_the_torque_and_makes_no_energy():
    """Any ratio of Fc and sigma0, up to the ends of what a plan takes, and any state; the stored
    energy F^2/(2 sigma0) never grows.
    """
    random = Random(3)
    for _ in range(6000):
        values = [random.uniform(1, 1.9999) * 2.0 ** random.randint(-64, 63) for _ in range(4)]
        if random.random() < 0.5:  # the same stiffness: F is kept, or clamped
            values[2] = values[0]
        before, after = dahl.Plan(*values[:2]), dahl.Plan(*values[2:])
        bearing = dahl.Friction(before)
        w = random.choice([1, -1]) * random.randint(0, ONE) >> random.randint(0, 61)
        bearing.state.w = w
        bearing.change_plan(after)
        F, wanted = Fraction(bearing.state.w, ONE) * Fraction(after.Fc), changed(before, after, w)
        slack = abs(wanted) / 2**30 + Fraction(after.Fc) / ONE
        assert bearing.plan is after and abs(F - wanted) <= slack, (values, w)
        stored = (Fraction(w, ONE) * Fraction(before.Fc)) ** 2 / Fraction(before.sigma0)
        left = max(abs(F) - slack, 0) ** 2 / Fraction(after.sigma0)
        assert left <= stored


@given(st.integers(1, 40), st.integers(0, 2**32 - 1))
def test_what_is_kept_between_steps_changes_no_bit(ticks, seed):
    """A bearing that is pickled, or rebuilt from w, after each step goes on as one that is not."""
    path = np.random.default_rng(seed).integers(-2000, 2001, ticks)
    plan = dahl.Plan(100.0, 0.5, 1e-4)
    wanted, kept = dahl.Friction(plan).run_counts(path), dahl.Friction(plan)
    for move, torque in zip(path, wanted, strict=True):
        w, kept = pickle.loads(pickle.dumps(kept)).state.w, dahl.Friction(plan)
        kept.state.w = w
        assert kept.step_counts(move) == torque


# --- the inverse ----------------------------------------------------------------------------------


@pytest.mark.parametrize("F", [0.0, 0.01, 0.3, 0.4999, -0.2, -0.5, 0.25])
def test_a_torque_is_reached_by_no_fewer_counts(F):  # noqa: N803
    bearing = dahl.Friction(dahl.Plan(100.0, 0.5, 2e-4))
    bearing.step_counts(13)
    before, counts = bearing.torque, bearing.counts_to_torque(F)
    wanted, s = as_float(F), 1 if F > before else -1

    def torque_after(move: int) -> float:
        return copy.deepcopy(bearing).step_counts(move)

    assert bearing.torque == before and s * counts > 0
    assert s * torque_after(counts) >= s * wanted > s * torque_after(counts - s)
    assert bearing.counts_to_torque(before) == 0


def test_the_tips_of_a_loop_are_those_of_the_closed_form():
    """Fc tanh(u/2), which is also where a shaft that goes to and fro ends up."""
    plan = dahl.Plan(100.0, 0.5, 2e-4)
    for stroke in (0, 1, 7, 50, 1000, 2**32 - 1):
        wanted = plan.Fc * math.tanh(plan.travel_per_count * stroke / 2)
        assert plan.tip_torque(stroke) == pytest.approx(wanted, rel=1e-7)
        if stroke <= 1000:
            bearing = dahl.Friction(plan)
            bearing.run_counts(np.tile([stroke, -stroke], 3000))
            assert -bearing.torque == pytest.approx(wanted, rel=1e-6)


# --- readings, counts and units -------------------------------------------------------------------

words = st.integers(0, 2**32 - 1)


@given(words, words, words)
def test_counts_between_is_the_shortest_way(before, now, modulus):
    size = modulus or 2**32
    way = dahl.counts_between(before % size, now % size, modulus)
    assert -size <= 2 * way < size
    assert (before + way - now) % size == 0
    for readings in ((before, now), (now, before)):
        if max(readings) >= size:
            with pytest.raises(dahl.Error, match=f"from 0 to {size - 1}"):
                dahl.counts_between(*readings, modulus=modulus)


@given(st.integers(-(2**31), 2**31 - 1), st.integers(0, 2**30))
def test_whole_units_are_the_nearest(ratio, most):
    wanted = math.floor(Fraction(ratio * most, 2**30) + Fraction(1, 2))
    assert dahl.to_units(ratio, most) == wanted


@given(
    st.integers(3, 2**32) | st.just(2**16),
    st.sampled_from([1, -1]),
    st.lists(st.floats(-0.499, 0.499), min_size=1, max_size=20),
)
def test_an_encoder_gives_back_each_move_within_half_a_round(size, sign, parts):
    encoder, angle = dahl.Encoder(size % 2**32, sign), 0
    assert encoder.move(0) == 0
    for move in (int(part * size) for part in parts):
        angle += sign * move
        assert encoder.move(angle % size) == move
    assert encoder.jumps == 0


def test_an_encoder_tells_a_jump_and_goes_home():
    """Also where modulus, readings and the largest step need all 32 bits."""
    encoder = dahl.Encoder(10000, 1, 100)
    assert [encoder.move(reading) for reading in (9990, 5, 5000, 5003)] == [0, 15, 0, 3]
    encoder.home(0)
    assert (encoder.move(9999), encoder.jumps) == (-1, 1)
    wide = dahl.Encoder(modulus=2**32 - 1, largest_step=2**31 - 2)
    wide.home(2**32 - 2)
    assert (wide.move(1), wide.move(2**31 - 2), wide.jumps) == (2, 2**31 - 3, 0)
    assert wide.move(2**31 - 2 - 70_000) == -70_000
    narrow = dahl.Encoder(modulus=0, largest_step=70_000)
    narrow.home(3_000_000_000)
    assert (narrow.move(3_000_070_000), narrow.move(3_000_140_001)) == (70_000, 0)
    assert narrow.jumps == 1
