# SPDX-License-Identifier: MIT
"""What a sensor did to its signal before it was logged: a low pass of the torque, noise of the
angle. Parameters that hang on it are not claimed; a log without it keeps its claim.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from dahl.identify import angle_noise, pipeline
from identify_tools import COUNT, FC, SIGMA0, dahl_torque, noise_of, sine, synthetic
from scipy.signal import butter, lfilter, sosfilt

pytestmark = pytest.mark.usefixtures("library")

FILTERS = {
    "first order of 10 rows": lambda x: lfilter([0.1], [1, -0.9], x),
    "first order of 30 rows": lambda x: lfilter([1 / 30], [1, -29 / 30], x),
    "mean of 10 rows": lambda x: lfilter(np.ones(10) / 10, [1], x),
    "second order": lambda x: sosfilt(butter(2, 0.03, output="sos"), x),
}


@pytest.mark.parametrize("place", ["before the noise", "behind it"])
@pytest.mark.parametrize("name", FILTERS)
def test_a_low_passed_torque_is_not_believed(name, place):
    log = synthetic(1)
    drawn, noise = dahl_torque(sine(1)), 0.05 * FC * noise_of(1, log.rows)
    behind = place == "behind it"
    log.torque = FILTERS[name](drawn + noise * behind) + noise * (not behind)
    result = pipeline.identify([log], pipeline.Options(delay=False))
    sigma0 = result.estimate.sigma0
    assert sigma0 < 0.95 * SIGMA0  # as a fit sees it
    assert result.estimate.ci95["sigma0"].high > 1.1 * sigma0
    assert not result.verdict.sigma0
    assert any(words in result.verdict.text for words in ("low-passed", "sigma0 hangs on"))


@pytest.mark.parametrize("kind", [{"part": 0.2}, {}, {"shared": 0.95}])
def test_a_torque_as_it_came_keeps_its_claim(kind):
    for seed in range(3):
        result = pipeline.identify([synthetic(seed, **kind)], pipeline.Options(delay=False))
        assert result.verdict.identifiable == {"sigma0": True, "Fc": True}


def shaky(seed: int, counts: float, res: float = COUNT):
    """A log with independent errors on its angle, rounded to `res`; 0: not at all."""
    log = synthetic(seed)
    theta = sine(seed) + counts * COUNT * noise_of(seed + 50, log.rows)
    return replace(log, theta=np.round(theta / res) * res if res else theta, resolution=res)


@pytest.mark.parametrize(("counts", "res"), [(2, COUNT), (5, COUNT), (20, COUNT), (5, 0.0)])
def test_angle_noise_is_not_believed(counts, res):
    result = pipeline.identify([shaky(1, counts, res)])
    assert not result.verdict.sigma0
    assert "angle noise" in result.verdict.text


@pytest.mark.parametrize("counts", [0, 1, 3, 10])
def test_the_size_of_the_angle_noise(counts):
    log = shaky(1, counts)
    least = 0.3 * COUNT
    assert angle_noise.noise_of(log.theta, COUNT) == pytest.approx(
        counts * COUNT, rel=0.1, abs=least
    )


def test_a_rough_motion_is_no_angle_noise():
    """A dozen rows a stroke: what bends from row to row is the motion."""
    theta = sine(1, rows=300, cycles=12)
    assert angle_noise.noise_of(theta, 0.0) == 0
