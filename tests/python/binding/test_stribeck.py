# SPDX-License-Identifier: MIT
"""Stribeck friction at a speed that the caller gives, against mpmath; its ranges."""

import dahl
import mpmath
import numpy as np
import pytest

SIGMA0, FS, FC, THETA = 100.0, 0.75, 0.5, 2.0**-13  # floats of the C without rounding
ERROR_Q30, HALF_ULP = 6.6e-9, 2.0**-25  # DAHL_STRIBECK_ERROR_Q30; of torques below 1 N m


def element(stribeck: float = 0.0) -> dahl.Stribeck:
    return dahl.Stribeck(SIGMA0, FS, FC, THETA, stribeck)


def exact(moves: np.ndarray, speeds: np.ndarray) -> list[mpmath.mpf]:
    """Solve dF/dtheta = sigma0 (1 - s F/Fc(v)) in each move; speeds in parts of vs."""
    torque, torques = mpmath.mpf(0), []
    with mpmath.workprec(100):
        for move, speed in zip(moves.tolist(), speeds.tolist(), strict=True):
            limit = FC + (FS - FC) * mpmath.exp(-(mpmath.mpf(speed) ** 2))
            gap = mpmath.sign(move) * limit - torque
            torque -= gap * mpmath.expm1(-SIGMA0 / limit * abs(move) * THETA)
            torques.append(torque)
    return torques


def test_each_move_is_exact_at_its_speed() -> None:
    rng = np.random.default_rng(4)
    moves = np.concatenate((rng.integers(-40, 41, 400), rng.integers(1, 9, 400)))
    speeds = np.round(rng.normal(0, 1, 800) * 2**20) / 2**20
    by_torque, by_ratio = element(), element()
    for move, speed, truth in zip(moves, speeds, exact(moves, speeds), strict=True):
        assert abs(by_torque.step_at_speed(move, speed) - truth) <= ERROR_Q30 * FS + HALF_ULP
        ratio = by_ratio.step_at_speed_q30(move, -speed) / 2**30
        assert abs(ratio - truth / FS) <= ERROR_Q30
        assert by_torque.state == by_ratio.state


def test_the_speed_of_a_tick_is_that_of_its_counts() -> None:
    """8 counts are the Stribeck speed."""
    by_counts, at_speed, moves = element(8 * THETA), element(), [5, -3, 8, 1, -60, 0, 2]
    for move in moves:
        assert by_counts.step_counts(move) == pytest.approx(
            at_speed.step_at_speed(move, move / 8), abs=1e-8
        )
    again = element(8 * THETA)
    assert again.run_counts(moves).tolist()[-1] == by_counts.torque


def test_speeds_that_are_no_numbers_are_refused_and_large_ones_are_fast() -> None:
    one = element()
    for bad, error in ((float("nan"), dahl.InputError), ("1", TypeError)):
        with pytest.raises(error, match="speed"):
            one.step_at_speed(1, bad)
    assert one.state == dahl.State()
    assert one.step_at_speed(10**6, float("-inf")) == FC


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ((SIGMA0, FS, FC, THETA, 3.9 * THETA), r"stribeck = 0.000476\d+ .* = 0.000488"),
        ((SIGMA0, FS, FS / 17, THETA, 1), "Fc = 0.0441.* Fs = 0.75"),
        ((SIGMA0, FS, FC, 0, 1), "theta_per_count = 0 "),
        ((SIGMA0, -1, FC, THETA, 1), "Fs = -1 "),
    ],
)
def test_a_parameter_out_of_range_is_named_with_its_limit(values, words) -> None:
    with pytest.raises(dahl.InputError, match=words):
        dahl.Stribeck(*values)
