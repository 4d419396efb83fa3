# SPDX-License-Identifier: MIT
"""The laws beside that of a run: each fits a log of its own kind, and only that."""

import numpy as np
import pytest
from dahl.report import other_laws, traces
from dahl.sim.scene import Scene, find, read


def trace_of(counts: np.ndarray) -> traces.Trace:
    rows, no = np.arange(len(counts)), np.zeros(len(counts), bool)
    zeros = np.zeros(len(counts))
    return traces.Trace(rows, rows / 1000, counts, zeros, no, no, {}, len(counts), 0)


@pytest.fixture
def scene() -> Scene:
    return read(find("segments"))


@pytest.fixture
def counts() -> np.ndarray:
    """A slow sine of whole counts, with rests at its ends."""
    return np.rint(1000 * np.sin(np.linspace(0, 20, 4000))).astype(int)


def test_a_log_of_slip_is_fitted_by_slip_elements_and_not_by_a_sign(scene, counts) -> None:
    """Two elements as Python, of lengths between those of the fit, and an offset."""
    slip = np.zeros((len(counts), 2))
    for k, limit in enumerate((90.0, 340.0)):
        for i in range(1, len(counts)):
            moved = slip[i - 1, k] + counts[i] - counts[i - 1]
            slip[i, k] = min(max(moved, -limit), limit)
    measured = slip @ [2e-3, 1e-3] + 0.07
    by_name = {law.name: law for law in other_laws.fitted(scene, trace_of(counts), measured)}
    assert by_name["slip elements"].r2 > 0.999
    assert by_name["Fc sign(v)"].r2 < 0.95


def test_a_log_of_coulomb_friction_is_fitted_by_a_sign(scene, counts) -> None:
    moves = np.diff(counts, prepend=0)
    held = [0]
    for move in moves[1:]:
        held.append(int(np.sign(move)) or held[-1])
    measured = 0.4 * np.array(held) - 0.02
    by_name = {law.name: law for law in other_laws.fitted(scene, trace_of(counts), measured)}
    assert by_name["Fc sign(v)"].r2 == pytest.approx(1)
    np.testing.assert_allclose(by_name["Fc sign(v)"].torque, measured, atol=1e-12)


def test_a_shaft_that_rests_has_no_other_law(scene) -> None:
    assert other_laws.fitted(scene, trace_of(np.full(50, 7)), np.zeros(50)) == []


def test_a_travel_of_any_encoder_is_fitted(scene) -> None:
    """Both ways by 2^31 - 1 counts from the first row."""
    counts = np.rint((2**31 - 1) * np.sin(np.linspace(0, 20, 4000))).astype(int)
    laws = other_laws.fitted(scene, trace_of(counts), np.sign(np.diff(counts, prepend=0)) * 1.0)
    assert laws[0].r2 > 0.5 and laws[1].r2 > 0.99


def test_a_torque_that_helps_the_motion_is_no_friction(scene, counts) -> None:
    """No law may explain it by a negative Fc."""
    measured = -0.4 * np.sign(np.diff(counts, prepend=0))
    for law in other_laws.fitted(scene, trace_of(counts), measured):
        assert law.r2 < 0.1, law.name
