# SPDX-License-Identifier: MIT
"""dahl.Slip and dahl.Parallel against exact fractions, and what a caller gets wrong."""

from __future__ import annotations

import copy
from fractions import Fraction

import dahl
import numpy as np
import pytest

pytestmark = pytest.mark.usefixtures("library")

SIGMA0, FC, THETA = [100.0, 70.0, 3.0], [0.5, 1.25, 0.01], 2e-4
ULPS = 0.55  # of the sum of Fc: what the docstrings promise


def as_float(x) -> Fraction:
    return Fraction(float(np.float32(x)))


def exact_slip(sigma0, torques, theta, moves, exact=as_float) -> list[Fraction]:
    """Springs that slip, in exact fractions of the parameters, as C takes them."""
    stiff, most = [exact(x) for x in sigma0], [exact(x) for x in torques]
    theta = exact(theta)
    force, sums = [Fraction(0)] * len(stiff), []
    for move in moves:
        force = [
            max(-F, min(F, f + k * theta * int(move)))
            for f, k, F in zip(force, stiff, most, strict=True)
        ]
        sums.append(sum(force))
    return sums


def bound(torques) -> Fraction:
    """In N m."""
    return Fraction(ULPS) * Fraction(float(np.spacing(np.float32(sum(torques)))))


@pytest.fixture
def moves():
    return np.random.default_rng(5).integers(-60, 61, 4000).astype(np.int32)


def test_slip_is_exact(moves):
    slip = dahl.Slip(SIGMA0, FC, THETA)
    exact = exact_slip(SIGMA0, FC, THETA, moves)
    found = [Fraction(slip.step_counts(int(move))) for move in moves]
    assert max(abs(a - b) for a, b in zip(found, exact, strict=True)) <= bound(FC)


def test_q30_is_the_torque_over_the_sum(moves):
    slip = dahl.Slip(SIGMA0, FC, THETA)
    exact = exact_slip(SIGMA0, FC, THETA, moves)
    total = sum(Fraction(float(np.float32(x))) for x in FC)
    found = [Fraction(slip.step_counts_q30(int(move)), 2**30) for move in moves]
    assert max(abs(a - b / total) for a, b in zip(found, exact, strict=True)) < Fraction(4e-9)


def test_a_mix_is_the_sum(moves):
    bearing, slip = (dahl.Friction(dahl.Plan(80.0, 2.0, THETA)), dahl.Slip(SIGMA0, FC, THETA))
    alone, mix = copy.deepcopy(bearing), dahl.Parallel(bearing, slip)
    exact = np.array(exact_slip(SIGMA0, FC, THETA, moves), dtype=float) + alone.run_counts(moves)
    ulp = float(np.spacing(np.float32(sum(FC) + 2.0)))
    found = mix.run_counts(moves)
    assert np.abs(found - exact).max() <= (ULPS + 0.52) * ulp  # alone is rounded too
    assert bearing == alone
    assert mix.torque == found[-1]
    assert mix.step_counts(3) == pytest.approx(alone.step_counts(3) + slip.torque, abs=2 * ulp)


def test_a_mix_in_q30_is_over_the_sum(moves):
    """Of the plans that the parts have at the time."""
    bearing, slip = dahl.Friction(dahl.Plan(80.0, 2.0, THETA)), dahl.Slip(SIGMA0, FC, THETA)
    mix = dahl.Parallel(bearing, slip)
    alike = copy.deepcopy(mix)
    for torque in (2.0, 0.5):
        for each in (mix, alike):
            each.parts[0].change_plan(dahl.Plan(80.0, torque, THETA))
        total = sum(FC) + torque
        for move in moves[:500]:
            found = mix.step_counts_q30(int(move)) * 2.0**-30
            assert found == pytest.approx(alike.step_counts(int(move)) / total, abs=7e-8)
    assert dahl.Parallel().step_counts_q30(3) == 0


@pytest.mark.parametrize(
    ("sigma0", "torques", "theta", "words"),
    [
        ([], [], 1e-3, "sigma0 has 0 elements and Fc 0"),
        ([1.0] * 9, [1.0] * 9, 1e-3, "sigma0 has 9 elements"),
        ([1.0, 2.0], [1.0], 1e-3, "sigma0 has 2 elements and Fc 1"),
        ([1.0, 1e-9], [1.0, 1e9], 1e-3, r"element 1: travel of one count"),
        (100.0, [1.0], 1e-3, r"sigma0 = 100.0 is not a list of numbers"),
        ("12", [1.0], 1e-3, r"sigma0 = '12' is not a list of numbers"),
        (np.array(100.0), [1.0], 1e-3, r"sigma0 = array\(100.\) is not a list of numbers"),
        ([1.0], np.ma.masked, 1e-3, "Fc = masked is not a list of numbers"),
        ([1.0], [np.timedelta64(1, "s")], 1e-3, r"Fc\[0\] = .*timedelta64.* is not a number"),
        ([1.0], [None], 1e-3, r"Fc\[0\] = None is not a number"),
        ([1.0], [1.0], "x", "theta_per_count = 'x' is not a number"),
    ],
)
def test_bad_parameters_are_named(sigma0, torques, theta, words):
    with pytest.raises(dahl.Error, match=words):
        dahl.Slip(sigma0, torques, theta)


def test_bad_moves_and_parts_are_named():
    slip = dahl.Slip(SIGMA0, FC, THETA)
    with pytest.raises(dahl.Error, match=r"dcounts = 2147483648 is not a whole number"):
        slip.step_counts_q30(2**31)
    with pytest.raises(dahl.Error, match=r"dcounts = -2147483649 is not a whole number"):
        dahl.Parallel(slip).step_counts_q30(-(2**31) - 1)
    with pytest.raises(dahl.Error, match=r"parts\[1\] = 3 is neither"):
        dahl.Parallel(slip, 3)
    with pytest.raises(dahl.Error, match=r"parts\[1\] stands there twice"):
        dahl.Parallel(slip, slip)
    assert dahl.Parallel(slip, copy.copy(slip)).torque == 0  # alike is not the same
    with pytest.raises(dahl.Error, match="theta_per_count = 0: no encoder"):
        dahl.Parallel(dahl.Friction(dahl.Plan(1.0, 1.0))).step_counts(1)
    with pytest.raises(dahl.Error, match="Slip: fc = 1"):
        dahl.Slip(sigma0=[1.0], fc=1, theta_per_count=1.0)
    assert slip == dahl.Slip(SIGMA0, FC, THETA)


def test_fast_slip_is_exact(moves):
    """In fractions of the doubles given, whose sum is rounded once."""
    exact = exact_slip(SIGMA0, FC, THETA, moves, Fraction)
    found = dahl.ThroughputSlip(SIGMA0, FC, THETA).run_counts(moves)
    ulp = Fraction(float(np.spacing(np.float32(sum(FC)))))
    assert max(abs(Fraction(float(a)) - b) for a, b in zip(found, exact, strict=True)) <= (
        Fraction(5001, 10000) * ulp
    )


def test_a_fast_mix_is_the_exact_one(moves):
    theta, torque = (float(np.float32(value)) for value in (THETA, FC[1]))
    exact = dahl.Parallel(
        dahl.Friction(dahl.Plan(80.0, 2.0, theta)), dahl.Slip([100.0], [torque], theta)
    )
    fast = dahl.ThroughputParallel(
        dahl.Throughput(80.0, 2.0, theta), dahl.ThroughputSlip([100.0], [torque], theta)
    )
    long = np.tile(moves, 10)
    found = fast.run_counts(long)
    ulp = float(np.spacing(np.float32(2.0 + FC[1])))
    assert np.abs(found.astype(float) - exact.run_counts(long)).max() <= (ULPS + 0.52) * ulp
    assert (fast.run_counts(long) == found).all()  # nothing is kept
    assert dahl.ThroughputParallel().run_counts([1, 2]).tolist() == [0, 0]


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: dahl.ThroughputSlip([1.0], [], 1.0), "sigma0 has 1 elements and Fc 0"),
        (lambda: dahl.ThroughputSlip([1.0], [1.0], 2**20 * (1 - 1e-12)), "travel of one count"),
        (lambda: dahl.ThroughputSlip([1.0], [1.0], 2**-30 * (1 - 1e-12)), "element 0: travel of"),
        (lambda: dahl.ThroughputSlip([1.0], [1.0], 1).run_counts([0.5]), r"moves\[0\] = 0.5"),
        (lambda: dahl.ThroughputSlip([1.0], [1.0], 1).run_counts(), "missing a required argument"),
        (lambda: dahl.ThroughputParallel(dahl.Throughput(1, 1)), "theta_per_count = 0: no encoder"),
        (lambda: dahl.ThroughputParallel(1), r"parts\[0\] = 1 is neither a Throughput nor"),
    ],
)
def test_what_the_fast_forms_refuse(call, words):
    with pytest.raises(dahl.Error, match=words):
        call()
