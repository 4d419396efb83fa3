# SPDX-License-Identifier: MIT
"""What may be claimed: six scored cycles at least, a narrow interval, logs that agree, a torque
that is mostly friction; and what a Result offers to a program.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from dahl import Error
from dahl.identify import Log, Options, Result, check, identify, report
from identify_tools import (
    COUNT,
    FC,
    SIGMA0,
    chirp,
    dahl_torque,
    log_of,
    noise_of,
    seen,
    shaft,
    sine,
    synthetic,
)

pytestmark = pytest.mark.usefixtures("library")

TRUTH = {"sigma0": SIGMA0, "Fc": FC}
MAX_HALF_WIDTH, MIN_CYCLES = 0.3, 6


def machine(seed: int, sigma0: float = 1.0, Fc: float = 1.0, late: int = 0, side: int = 1) -> Log:  # noqa: N803
    """A log of a machine whose parameters are these parts of the usual ones."""
    theta = sine(seed, rows=1600, cycles=6.3)
    torque = side * np.roll(dahl_torque(theta, sigma0 * SIGMA0, Fc * FC), late)
    return replace(log_of(theta[20:], torque[20:], 0.01), name=f"log {seed}")


def coarse(counts: float) -> Log:
    """An encoder with so many counts in a presliding length."""
    theta = sine(2, rows=2400, cycles=8)
    return log_of(theta, dahl_torque(theta), 0.02, FC / SIGMA0 / counts)


def coulomb() -> Log:
    theta = np.floor(sine(5, rows=1500, cycles=8) / COUNT) * COUNT
    moves = np.diff(theta, prepend=theta[0])
    moving = np.maximum.accumulate(np.where(moves != 0, np.arange(1500), 0))
    return log_of(theta, FC * np.sign(moves)[moving], 0.05)


def never_slips() -> Log:
    theta = sine(1, rows=2400, cycles=8, amplitude=0.1 * FC / SIGMA0)
    return log_of(theta, SIGMA0 * theta, 0.01, 0.0)


CASES: dict[str, tuple[Callable[[], list[Log]], tuple[bool | None, bool | None], str]] = {
    # logs; what is claimed of sigma0 and Fc (None: either); words of the verdict
    "nothing wrong": (lambda: [shaft()], (True, True), "sigma0 = "),
    "noise of 20 %": (lambda: [shaft(5, 0.2)], (None, True), "Fc = "),
    "noise of 300 %": (lambda: [shaft(5, 3.0)], (False, False), "explains"),
    "one cycle": (lambda: [synthetic(1, 0.01, rows=900, cycles=1.4)], (False, False), "cycles"),
    "two cycles": (lambda: [synthetic(2, 0.01, rows=900, cycles=2.3)], (False, False), "2 cycles"),
    "five cycles": (
        lambda: [synthetic(3, 0.01, rows=1500, cycles=5.2)],
        (False, False),
        "5 cycles",
    ),
    "three and four": (
        lambda: [synthetic(k, 0.01, rows=1200, cycles=k + 0.6) for k in (3, 4)],
        (None, True),
        "Fc = ",
    ),
    "1.5 counts": (lambda: [coarse(1.5)], (None, True), "Fc = "),
    "a bare sign": (lambda: [coulomb()], (False, True), "sigma0 is not identifiable"),
    "never slips": (lambda: [never_slips()], (None, False), "Fc is not identifiable"),
    "two of one": (lambda: [machine(1), machine(2)], (True, True), ""),
    "sensor turned in one": (lambda: [machine(1), machine(2, side=-1)], (None, None), ""),
    "sensor turned in both": (lambda: [machine(k, side=-1) for k in (1, 2)], (True, True), ""),
    "other delays": (lambda: [machine(1), machine(2, late=4)], (None, None), ""),
}


@cache
def found(name: str) -> Result:
    return identify(CASES[name][0]())


@pytest.mark.parametrize("name", CASES)
def test_what_is_claimed(name):
    """Each claim is true and keeps to the rule; each refusal has its reason in the verdict."""
    result, (_, claimed, words) = found(name), CASES[name]
    for is_claimed, wanted in zip(result.claimed, claimed, strict=True):
        assert wanted is None or is_claimed is wanted, result.verdict
    assert words in result.verdict
    for parameter, is_claimed in zip(TRUTH, result.claimed, strict=True):
        p = getattr(result, parameter)
        if is_claimed:
            assert p.low <= TRUTH[parameter] <= p.high, result.verdict
            assert p.half_width <= MAX_HALF_WIDTH and result.samples.cycles >= MIN_CYCLES
            assert f"{parameter} = {p.value:.4g}" in result.verdict
        else:
            assert f"{parameter} is not identifiable" in result.verdict and result.reasons


@pytest.mark.parametrize(("sigma0", "Fc"), [(1.3, 1.0), (1.0, 1.25), (1.1, 1.0), (1.0, 1.06)])
def test_logs_of_two_machines(sigma0, Fc):  # noqa: N803
    """What differs is not claimed, or its interval holds both."""
    result = identify([machine(1), machine(2, sigma0, Fc), machine(3), machine(4, sigma0, Fc)])
    for parameter, one, part in ((result.sigma0, SIGMA0, sigma0), (result.Fc, FC, Fc)):
        ends = sorted((one, part * one))
        holds = parameter.low <= ends[0] * 1.01 and ends[1] * 0.99 <= parameter.high
        assert holds or not parameter.claimed, result.verdict


def test_one_broken_sensor_among_good_logs_is_no_claim_of_another_friction():
    result = found("sensor turned in one")
    assert not any(result.claimed) or result.Fc.value == pytest.approx(FC, rel=0.02)


def test_swapped_columns_are_named():
    """The loop is run through backward, and the counts of the encoder are in the torque."""
    log = shaft()
    swapped = replace(log, theta=log.torque, torque=log.theta, resolution=0.0)
    result = identify([swapped], Options(trust_units=True))
    assert result.claimed == (False, False) and "swapped" in result.verdict
    turned = identify([replace(log, torque=-log.torque)])
    assert "swapped" not in turned.verdict and turned.claimed == (True, True)


# --- what a program gets --------------------------------------------------------------------------


@cache
def plain() -> Result:
    theta = chirp(2400, first=6, last=12)
    torque = dahl_torque(theta) + 0.1 + 0.02 * np.gradient(theta, 1e-3)
    return identify([log_of(theta, torque, 0.05)])


def test_residuals_and_the_data_frame():
    result = plain()
    table = result.to_dataframe()
    names = ["log", "time", "angle", "speed", "torque", "predicted", "residual", "weight"]
    assert list(table.columns) == names and len(table) == result.samples.rows == 2400
    assert set(table["log"]) == {"rig"}
    left = table["torque"] - table["predicted"]
    assert left.to_numpy() == pytest.approx(table["residual"].to_numpy())
    used = table["weight"] > 0
    assert table["residual"][used].std() == pytest.approx(0.05 * FC, rel=0.1)
    assert result.terms["viscous"] == pytest.approx(0.02, rel=0.2)
    assert result.terms["offset"] == pytest.approx(0.1, rel=0.1)


def test_bootstrap_draws_and_correlation():
    result = plain()
    draws = result.bootstrap()
    assert draws.shape[1] == 2 and len(draws) >= 100
    assert draws.mean(axis=0) == pytest.approx([result.sigma0.value, result.Fc.value], rel=0.02)
    error = result.chosen.error
    assert draws.std(axis=0) == pytest.approx(error, rel=0.5)
    assert -1 <= result.correlation <= 1
    assert result.correlation == pytest.approx(np.corrcoef(draws.T)[0, 1], abs=0.3)
    assert np.array_equal(draws, result.bootstrap())


def test_parameters_cycle_by_cycle():
    cycles = plain().by_cycle()
    assert {len(values) for values in cycles.values()} == {len(plain().samples.folds)}
    assert cycles["Fc"] == pytest.approx(np.full(len(cycles["Fc"]), FC), rel=0.1)
    assert np.median(cycles["sigma0"]) == pytest.approx(SIGMA0, rel=0.1)
    assert np.median(cycles["offset"]) == pytest.approx(0.1, rel=0.1)


def test_a_is_the_ratio_and_its_interval_stays_above_zero():
    for result in (plain(), found("a bare sign"), found("noise of 300 %")):
        for p in (result.a, result.sigma0, result.Fc):
            assert 0 <= p.low <= p.value <= p.high
        assert result.a.value == pytest.approx(result.sigma0.value / result.Fc.value)
        json.loads(report.as_json(result), parse_constant=pytest.fail)


def test_a_log_that_was_not_fitted_is_predicted():
    """With its own motion and offset in time; a log of another machine is not."""
    same, other = log_of(chirp(1500), 1.0 * dahl_torque(chirp(1500)) + 0.1, 0.05), shaft(3)
    viscous = 0.02 * np.gradient(chirp(1500), 1e-3)
    assert check(plain(), replace(same, torque=same.torque + viscous)) > 0.98
    assert check(plain(), replace(other, torque=3 * other.torque)) < 0.7
    with pytest.raises(Error, match="angle is constant"):
        check(plain(), replace(other, theta=np.zeros(other.rows)))


@pytest.mark.parametrize("term", ["viscous", "inertia"])
def test_a_term_of_the_speed_needs_times(term):
    for log in (replace(shaft(), time=None), replace(shaft(), time=np.full(2400, 5.0))):
        with pytest.raises(Error, match=f"{term}.*time"):
            identify([log], Options(terms=("offset", term)))


def test_a_result_is_the_same_each_time():
    log = shaft(1, rows=1200)
    log.torque = np.round(log.torque / FC * 8) * FC / 8  # made logs have this rounding, and noise
    first, second = (report.numbers(identify([log])) for _ in range(2))
    assert first == second


def test_noise_that_is_all():
    log = Log("x", sine(1, rows=1500, cycles=8), noise_of(1, 1500), np.arange(1500) * 1e-3)
    assert identify([log]).claimed == (False, False)


@pytest.mark.parametrize(
    ("motion", "words"),
    [
        (0.05 * np.sin(np.arange(2400) / 48), ("one speed", "the same turning points")),
        (0.02 * np.sin(np.arange(3600) / 80) + 0.04 * np.sin(np.arange(3600) / 33), ()),
    ],
)
def test_a_motion_of_equal_strokes_is_named(motion, words):
    """What acts alike in each stroke cannot be told from friction."""
    found = seen(log_of(motion, dahl_torque(motion)))
    assert found["identifiable"]["sigma0"]
    alike = [note for note in found["notes"] if "all strokes have" in note]
    assert all(word in note for note in alike for word in words)
    assert bool(alike) == bool(words)
