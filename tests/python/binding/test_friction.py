# SPDX-License-Identifier: MIT
"""dahl.Plan, Friction and Encoder against fractions and 50 digits.

The library steps by a table. The references are closed forms and share no formula with it.
"""

import copy
import math
from fractions import Fraction

import dahl
import mpmath
import numpy as np
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule
from sources import number
from strategies import COPIES, PLANS, STEPS, as_float, float32

ULP_COUNTS, ULP_ANGLE = number("DAHL_ULP_COUNTS"), number("DAHL_ULP_ANGLE")
ONE = 1 << 62  # w of a torque of Fc
STATE_END = ONE + (1 << 31)  # each call leaves -STATE_END <= w < STATE_END (dahl.h)
EXTREMES = [STATE_END - 1, ONE, ONE - 1, -ONE, -STATE_END, 1 - STATE_END]
TABLE = [*range(1, 9), *(2**k for k in range(4, 31))]  # moves that a plan has one entry for
LONGEST = 2**31 - 1
digits = mpmath.mp.clone()
digits.dps = 50


def exact_ratio(*values: float) -> mpmath.mpf:
    """Return values[0] / values[1] * values[2] exactly, then to 50 digits."""
    ratio = Fraction(values[0]) / Fraction(values[1]) * Fraction(values[2])
    return digits.mpf(ratio.numerator) / ratio.denominator


def moved(w: mpmath.mpf, travel: mpmath.mpf) -> mpmath.mpf:
    """Solve Eq. 1 for one signed travel: the gap to the limit shrinks by exp(-|travel|)."""
    side = int(digits.sign(travel)) or 1
    return side - (side - w) * digits.exp(-abs(travel))


def changed(before: dahl.Plan, after: dahl.Plan, w: int) -> Fraction:
    """Return the torque in N m that dahl.h promises after a change of plan."""
    F = Fraction(w, ONE) * Fraction(before.Fc)
    F *= min(Fraction(1), Fraction(after.sigma0) / Fraction(before.sigma0))
    return max(-Fraction(after.Fc), min(Fraction(after.Fc), F))


class Calls(RuleBasedStateMachine):
    @initialize(plan=PLANS)
    def begin(self, plan: dahl.Plan) -> None:
        self.one, self.twin = dahl.Friction(plan), dahl.Friction(plan)
        self.bound = ULP_COUNTS
        self.read_state()

    def read_state(self) -> None:
        self.w = digits.mpf(self.one.state.w) / ONE

    def set_state(self, w: int) -> None:
        self.one.state.w = self.twin.state.w = w
        self.read_state()

    def check(self, torque: float, travel: mpmath.mpf) -> None:
        self.w = moved(self.w, travel)
        plan = self.one.plan
        assert abs(torque - self.w * plan.Fc) <= self.bound * plan.ulp

    @rule(moves=st.lists(STEPS, max_size=20))
    def step_counts(self, moves: list[int]) -> None:
        plan = self.one.plan
        count = exact_ratio(plan.sigma0, plan.Fc, plan.theta_per_count)
        for move, torque in zip(moves, self.twin.run_counts(moves).tolist(), strict=True):
            assert self.one.step_counts(move) == torque
            self.check(torque, count * move)

    @rule(moves=st.lists(float32(-1e3, 1e3), max_size=20), digits_less=st.integers(0, 11))
    def step_by_angle(self, moves: list[float], digits_less: int) -> None:
        plan = self.one.plan
        radian = exact_ratio(plan.sigma0, plan.Fc, 1)
        assume(2.0**-60 < radian < 2.0**60)  # the angles below are normal floats
        angles = [as_float(move * 10.0**-digits_less / float(radian)) for move in moves]
        self.bound = ULP_ANGLE if moves else self.bound
        for angle, torque in zip(angles, self.twin.run(angles).tolist(), strict=True):
            assert self.one.step(angle) == torque
            self.check(torque, radian * angle)

    @rule(angle=st.sampled_from([math.nan, 0.0, math.inf, -math.inf]))
    def step_by_no_finite_angle(self, angle: float) -> None:
        """NaN is no motion. Infinity ends at Fc."""
        Fc = self.one.plan.Fc  # noqa: N806
        wanted = math.copysign(Fc, angle) if math.isinf(angle) else self.one.torque
        assert self.one.step(angle) == self.twin.run([angle])[0] == wanted
        self.bound = ULP_ANGLE
        self.read_state()

    @rule(move=STEPS)
    def step_in_q30(self, move: int) -> None:
        ratio = self.one.step_counts_q30(move)
        torque = self.twin.step_counts(move)
        assert self.one == self.twin and abs(ratio - self.one.state.w / 2**32) <= 0.51
        assert abs(torque - ratio * self.one.plan.Fc / 2**30) <= self.one.plan.ulp
        self.read_state()

    @rule(move=st.sampled_from(TABLE))
    def first_move_has_32_bits(self, move: int) -> None:
        plan = self.one.plan
        fresh = dahl.Friction(plan)
        fresh.step_counts(move)
        wanted = -digits.expm1(-move * exact_ratio(plan.sigma0, plan.Fc, plan.theta_per_count))
        error = abs(digits.mpf(fresh.state.w) / ONE - wanted)
        assert error <= wanted / 2**32 + digits.mpf(2) ** -61

    @rule(ratio=st.floats(-1.5, 1.5) | st.sampled_from([math.inf, -math.inf, math.nan]))
    def set_torque(self, ratio: float) -> None:
        """The torque comes back, limited to Fc. NaN changes nothing."""
        Fc, before = self.one.plan.Fc, self.one.torque  # noqa: N806
        F = as_float(ratio * Fc)
        self.one.torque = F
        self.twin.set_torque(F)
        wanted = before if math.isnan(F) else max(-Fc, min(Fc, F))
        if abs(wanted) >= 2.0**-36 * Fc:  # w has all bits of a larger one
            assert self.one.torque == wanted
        assert abs(self.one.torque - wanted) <= 2.0**-61 * Fc
        self.read_state()

    @rule(plan=PLANS)
    def change_plan(self, plan: dahl.Plan) -> None:
        """The torque stays as far as the plan can hold it. The stored energy never grows."""
        before, w = self.one.plan, self.one.state.w
        for each in (self.one, self.twin):
            each.change_plan(plan)
        F, wanted = Fraction(self.one.state.w, ONE) * Fraction(plan.Fc), changed(before, plan, w)
        slack = abs(wanted) / 2**30 + Fraction(plan.Fc) / ONE
        assert self.one.plan is plan and abs(F - wanted) <= slack
        stored = (Fraction(w, ONE) * Fraction(before.Fc)) ** 2 / Fraction(before.sigma0)
        assert max(abs(F) - slack, 0) ** 2 / Fraction(plan.sigma0) <= stored
        assert abs(self.one.state.w) <= ONE
        self.read_state()

    @rule(same=st.booleans())
    def change_the_other_parameters(self, same: bool) -> None:
        plan = self.one.plan
        sigma0 = plan.sigma0 if same else plan.sigma0 * 0.75
        values = sigma0, plan.Fc / 2, 0.75 * plan.theta_per_count
        assume(min(values) >= 2.0**-64)
        self.change_plan(dahl.Plan(*values))

    @rule(copied=st.sampled_from(COPIES))
    def go_on_with_a_copy(self, copied) -> None:
        self.one = copied(self.one)

    @rule(w=st.sampled_from(EXTREMES) | st.integers(-ONE, ONE))
    def go_on_from_a_state(self, w: int) -> None:
        self.one = dahl.Friction(self.one.plan)
        self.set_state(w)

    @rule(ratio=st.floats(-1, 1), is_now=st.booleans())
    def move_to_a_torque(self, ratio: float, is_now: bool) -> None:
        F = self.one.torque if is_now else as_float(ratio * self.one.plan.Fc)
        side = 1 if F > self.one.torque else -1

        def torque_after(move: int) -> float:
            return side * copy.deepcopy(self.one).step_counts(move)

        try:
            counts = self.one.counts_to_torque(F)
        except dahl.Error:
            assert torque_after(side * LONGEST) < side * F
            return
        assert (counts == 0) == (F == self.one.torque)
        if counts:
            assert torque_after(counts) >= side * F > torque_after(counts - side)

    @invariant()
    def bearing_is_in_range_and_equal_to_its_twin(self) -> None:
        assert self.one == self.twin
        assert abs(self.one.torque) <= self.one.plan.Fc
        assert -STATE_END <= self.one.state.w < STATE_END


TestCalls = Calls.TestCase
TestCalls.settings = settings(stateful_step_count=30)


# --- parameters -----------------------------------------------------------------------------------


def is_accepted(kind: type, *parameters: float) -> bool:
    try:
        kind(*parameters)
    except dahl.Error as error:
        assert "travel" in str(error) and "2^-30" in str(error) and "2^20" in str(error)
        return False
    return True


def floats_of(bits: int) -> st.SearchStrategy[float]:
    """Few bits make products exactly on a limit, many make products next to it."""
    whole = st.integers(1, 2**bits)
    return st.builds(lambda n, power: as_float(n * 2.0**power), whole, st.integers(-10, 10))


@settings(max_examples=400)
@given(
    st.sampled_from([1, 2, 3, 12, 24]).flatmap(lambda bits: st.tuples(*[floats_of(bits)] * 2)),
    st.sampled_from([2.0**-30, 2.0**20]),
    st.sampled_from([0.0, None, math.inf]),
    st.sampled_from([np.float32, np.float64]),
)
def test_the_limits_of_a_travel_are_decided_exactly(sigma0_Fc, limit, side, kind):  # noqa: N803
    """2^-30 is accepted and 2^20 is not, also if sigma0/Fc has no end in binary."""
    sigma0, Fc = sigma0_Fc  # noqa: N806
    theta = kind(limit * Fc / sigma0)
    theta = float(theta if side is None else np.nextafter(theta, kind(side)))
    travel = Fraction(sigma0) * Fraction(theta) / Fraction(Fc)
    is_within = Fraction(1, 2**30) <= travel < 2**20
    for made in (dahl.Plan, dahl.Throughput) if kind is np.float32 else (dahl.Throughput,):
        assert is_accepted(made, sigma0, Fc, theta) == is_within


# --- readings, counts and units -------------------------------------------------------------------

WORDS = st.integers(0, 2**32 - 1)


@given(WORDS, WORDS, WORDS)
def test_counts_between_is_the_shortest_way(before, now, modulus):
    size = modulus or 2**32
    way = dahl.counts_between(before % size, now % size, modulus)
    assert -size <= 2 * way < size
    assert (before + way - now) % size == 0
