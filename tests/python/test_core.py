# SPDX-License-Identifier: MIT
"""The binding: the model's laws on inputs that hypothesis makes up, against the closed form in 100
bits.

Nothing here shares a formula with the library: it steps by a recursion, the reference is anchored
at each reversal.
"""

from __future__ import annotations

import math
import re
from fractions import Fraction

import dahl
import numpy as np
import pytest
from dahl import core, reference
from hypothesis import given, settings
from hypothesis import strategies as st

pytestmark = pytest.mark.usefixtures("library")

ULP_COUNTS, ULP_ANGLE = 0.52, 0.6
torques = st.floats(2.0**-20, 2.0**20, width=32)
travels = st.floats(-29, 4.3).map(lambda exponent: 2.0**exponent)  # of one count: 2e-9 .. 20
small_moves = st.integers(-50, 50)
moves = st.lists(st.one_of(small_moves, st.integers(-(2**31), 2**31 - 1)), min_size=1, max_size=40)


def plan_for(Fc: float, travel: float) -> dahl.Plan:  # noqa: N803
    """A plan whose travel of one count is near `travel`."""
    return dahl.Plan(Fc, Fc, travel)


@given(torques, travels, moves)
def test_ratio_and_torque_are_one_state(Fc, travel, path):  # noqa: N803
    plan = plan_for(Fc, travel)
    by_torque, by_ratio = dahl.Friction(plan), dahl.Friction(plan)
    for move in path:
        by_torque.step_counts(move)
        by_ratio.step_counts_q30(move)
        assert by_torque.state.w == by_ratio.state.w


@given(torques, st.floats(-1, 1))
def test_set_torque_comes_back(Fc, ratio):  # noqa: N803
    bearing = dahl.Friction(dahl.Plan(Fc, Fc))
    wanted = np.float32(ratio * Fc)
    if abs(wanted) < 2.0**-36 * Fc:
        wanted = np.float32(0)
    bearing.torque = wanted
    assert bearing.torque == wanted
    bearing.set_torque(math.inf)
    assert bearing.torque == np.float32(Fc)


@given(torques, torques, st.floats(-1, 1))
def test_change_of_plan_makes_no_energy(Fc, other, ratio):  # noqa: N803
    """P15: the stored energy F^2/(2 sigma0) never grows."""
    before, after = dahl.Plan(Fc, Fc), dahl.Plan(other * 3, other)
    bearing = dahl.Friction(before)
    bearing.torque = ratio * Fc
    stored = bearing.torque**2 / before.sigma0
    bearing.change_plan(after)
    assert abs(bearing.torque) <= after.Fc
    assert bearing.torque**2 / after.sigma0 <= stored * (1 + 1e-6)


@given(st.integers(0, 2**32 - 1), st.integers(0, 2**32 - 1), st.integers(0, 2**32 - 1))
def test_counts_between_is_the_shortest_way(before, now, modulus):
    size = modulus or 2**32
    way = dahl.counts_between(before % size, now % size, modulus)
    assert -size <= 2 * way < size
    assert (before + way - now) % size == 0


@given(st.integers(-(2**31), 2**31 - 1), st.integers(0, 2**30))
def test_whole_units_are_the_nearest(ratio, Fc_units):  # noqa: N803
    assert dahl.to_units(ratio, Fc_units) == math.floor(
        Fraction(ratio * Fc_units, 2**30) + Fraction(1, 2)
    )


@settings(max_examples=20)
@given(st.integers(1, 2**20))
def test_received_torque_rounds_once(seed):
    """What a receiver computes from the 31-bit ratio, against exact fractions."""
    random = np.random.default_rng(seed)
    Fc = np.float32(random.uniform(1e-3, 1e3))
    ratios = random.integers(-(2**30), 2**30 + 1, 50)
    got = reference.received_torque(ratios, Fc)
    for ratio, torque in zip(ratios.tolist(), got, strict=True):
        exact = reference.Fraction(ratio, 2**30) * reference.Fraction(float(Fc))
        near = (np.nextafter(torque, np.float32(side)) for side in (-np.inf, np.inf))
        error = abs(reference.Fraction(float(torque)) - exact)
        assert all(error <= abs(reference.Fraction(float(other)) - exact) for other in near)


@pytest.mark.parametrize(("mantissa", "ratio"), [(16777213, 1012225365), (16777185, 554730529)])
def test_received_torque_is_not_rounded_to_a_tie_first(mantissa, ratio):
    """The product is just above half way between two floats, by the last of its 54 bits."""
    for turned in (ratio, -ratio):
        (torque,) = reference.received_torque([turned], mantissa / 2**23)
        exact = reference.Fraction(turned * mantissa, 2**53)
        near = (np.nextafter(torque, np.float32(side)) for side in (-np.inf, np.inf))
        error = abs(reference.Fraction(float(torque)) - exact)
        assert all(error < abs(reference.Fraction(float(other)) - exact) for other in near)


def test_parameters_of_the_reference_are_rounded_to_floats_first():
    given, rounded = (0.1, 0.7, 0.3), map(np.float32, (0.1, 0.7, 0.3))
    assert reference.travel_per_count(*given) == reference.travel_per_count(*rounded)


def test_limits_are_those_of_the_header(root):
    header = (root / "lib" / "include" / "dahl.h").read_text()
    named = dict(re.findall(r"#define DAHL_(\w+) ([\d.e+-]+)f?\b", header))
    for name in ("TORQUE_MIN", "TORQUE_MAX", "TRAVEL_MIN", "TRAVEL_MAX"):
        assert float(named[name]) == pytest.approx(getattr(core, name), rel=1e-15)
    assert float(named["ULP_COUNTS"]) == ULP_COUNTS
    assert float(named["ULP_ANGLE"]) == ULP_ANGLE
