# SPDX-License-Identifier: MIT
"""Identification over many seeds of one kind of log: the errors of sigma0 and Fc, and how many of
the intervals hold the truth. One log of each trouble: test_identify_claims.py.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import identify_cases as made
import numpy as np
import pytest
from dahl.identify.log import Log
from identify_tools import COUNT, FC, SIGMA0, dahl_torque, noise_of, seen, sine, synthetic, width

pytestmark = pytest.mark.usefixtures("library")

TRUTH = {"sigma0": SIGMA0, "Fc": FC}
SEEDS = 40  # of the short form; 200 in the long one


def held(facts: dict[str, Any]) -> list[bool]:
    """Whether the intervals hold the truth."""
    ends = facts["ci95"]
    return [ends[name][0] <= true <= (ends[name][1] or np.inf) for name, true in TRUTH.items()]


def errors_and_cover(seeds: int, shared: float, **options: object) -> tuple[np.ndarray, np.ndarray]:
    """Median relative errors of sigma0 and Fc, and the part of intervals that hold the truth."""
    found = [seen(synthetic(seed, shared=shared), **options) for seed in range(seeds)]
    errors = [[abs(one[name] / true - 1) for name, true in TRUTH.items()] for one in found]
    return np.median(errors, axis=0), np.mean([held(one) for one in found], axis=0)


@pytest.mark.checks
@pytest.mark.parametrize("shared", [0.0, 0.9])
def test_error_and_cover(shared):
    errors, cover = errors_and_cover(SEEDS, shared)
    assert shared or (errors < (0.005, 0.001)).all()
    assert (cover >= 0.85).all()  # 40 seeds: 90 % and two standard errors less


@pytest.mark.long
@pytest.mark.parametrize("shared", [0.0, 0.9])
def test_error_and_cover_of_200_seeds(shared):
    """Inside the true choice; over the choices see test_coverage_identify.py."""
    errors, cover = errors_and_cover(200, shared, terms=(), delay=False)
    assert shared or (errors < (0.005, 0.001)).all()
    assert (cover >= 0.90).all() and (cover <= 0.99).all()


def counted_strokes(seed: int) -> Log:
    """Strokes of .03 rad to either side at two speeds in turn, half cosines, so that at each turn
    the acceleration leaps; a count is .08 presliding lengths; viscous friction and 5 % noise.
    """
    draw = np.random.default_rng(seed)
    ends = 0.03 * np.resize([1, -1], 25) * (1 + 0.25 * draw.random(25))
    rows = np.resize([340, 170], 24)
    shapes = [(1 - np.cos(np.pi * np.arange(n) / n)) / 2 for n in rows]
    strokes = zip(ends, np.diff(ends), shapes, strict=False)
    theta = np.concatenate([start + step * shape for start, step, shape in strokes])
    time = np.arange(len(theta)) * 1e-3
    torque = dahl_torque(theta) + 0.2 * np.gradient(theta, time)
    torque += 0.05 * FC * draw.standard_normal(len(theta))
    read = np.floor(theta / COUNT + draw.random()) * COUNT
    return Log(f"seed {seed}", read, torque, time, resolution=COUNT)


def test_what_the_counts_hide_of_a_turn_is_in_the_intervals():
    """Without them half of these intervals hold the truth."""
    words = {"terms": ("viscous",), "delay": False, "model": "dahl"}
    found = [seen(counted_strokes(seed), **words) for seed in range(4)]
    for facts in found:
        assert facts["angle_between_counts"] and width(facts, "sigma0") < 0.03
    assert np.sum([held(facts) for facts in found]) >= 7


@pytest.mark.parametrize("noise", [0.0, 1e-5])
def test_an_interval_holds_its_own_estimate(noise):
    """Of a log that is all but exact."""
    theta = sine(1, rows=3000, cycles=5)
    torque = dahl_torque(theta) + noise * FC * noise_of(1, len(theta))
    facts = seen(Log("exact", theta, torque))
    for name, (low, high) in facts["ci95"].items():
        assert low <= facts[name] <= high and width(facts, name) < 1e-3


def test_the_torque_at_the_first_row_is_estimated():
    """A log that begins in full friction, and has little else to tell."""
    whole = made.shaft(2, 0.05, rows=4000, cycles=2)
    start = int(np.argmin(np.abs(whole.theta[:2000]))) + 1
    rows = slice(start, start + 1800)
    late = replace(whole, theta=whole.theta[rows], torque=whole.torque[rows], time=whole.time[rows])
    assert abs(late.torque[:50].mean()) > 0.9 * FC
    facts = seen(late)
    assert facts["delay_rows"] == 0 and facts["rmse"] == pytest.approx(0.05 * FC, rel=0.05)
    assert facts["sigma0"] == pytest.approx(SIGMA0, rel=0.04)
