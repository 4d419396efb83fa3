# SPDX-License-Identifier: MIT
"""Parameters that change within a log: a trend, a step and odd cycles are named, and nothing is
claimed of what changes.
"""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from dahl.identify import pipeline
from identify_tools import FC, SIGMA0, noise_of, sine, synthetic, varying_torque

pytestmark = pytest.mark.usefixtures("library")

ROWS = 10_000
RAMP, STEP = np.linspace(-0.5, 0.5, ROWS), np.arange(ROWS) >= ROWS // 2


def changing(seed: int, sigma0=0.0, Fc=0.0, part: float = 0.05, shared: float = 0.0, cycles=10):  # noqa: N803
    """A log whose parameters differ from the usual ones by these parts, row by row."""
    theta = sine(seed, cycles=cycles)
    torque = varying_torque(theta, SIGMA0 * (1 + sigma0 * RAMP**0), FC * (1 + Fc * RAMP**0))
    torque += part * FC * noise_of(seed, ROWS, shared)
    return replace(synthetic(seed, cycles=cycles), torque=torque)


@pytest.mark.parametrize("noise", [{}, {"part": 0.2}, {"shared": 0.95}])
@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"Fc": 0.2 * RAMP}, "Fc drifts"),
        ({"Fc": -0.5 * STEP}, "Fc steps"),
        ({"Fc": 0.2 * STEP, "sigma0": 0.2 * STEP}, "Fc steps"),
    ],
)
def test_a_change_of_fc_is_named_and_nothing_claimed(change, said, noise):
    result = pipeline.identify([changing(1, **change, **noise)])
    assert said in result.verdict.text
    assert result.verdict.identifiable == {"sigma0": False, "Fc": False}


def test_a_change_of_sigma0_leaves_fc():
    result = pipeline.identify([changing(1, sigma0=0.3 * RAMP)])
    (part,) = re.findall(r"sigma0 drifts by (\S+) %", result.verdict.text)
    assert float(part) == pytest.approx(27, abs=5)  # of nine of ten cycles
    sigma0 = result.cycles.value["sigma0"]
    assert sigma0[-1] / sigma0[0] == pytest.approx(1.13 / 0.87, rel=0.1)
    assert result.verdict.identifiable == {"sigma0": False, "Fc": True}


@pytest.mark.parametrize("noise", [{"part": 0.01}, {}, {"part": 0.2}, {"shared": 0.95}])
def test_steady_parameters_do_not_drift(noise):
    for seed in range(3):
        assert pipeline.identify([changing(seed, **noise)]).findings == []


def test_each_cycle_has_its_own_numbers():
    """Half of Fc from the middle on; the step is found at its row, give or take a cycle."""
    result = pipeline.identify([changing(1, Fc=-0.5 * STEP)])
    Fc, rows = result.cycles.value["Fc"], result.cycles.rows  # noqa: N806
    early, late = rows < ROWS // 2 - 1000, rows > ROWS // 2
    assert Fc[early] == pytest.approx(FC, rel=0.1)
    assert Fc[late] == pytest.approx(FC / 2, rel=0.1)
    (said,) = [found.text for found in result.findings if "Fc steps" in found.text]
    row = int(said.split("(row ")[1].rstrip(")"))
    assert abs(row - ROWS // 2) <= 1000


def test_one_odd_cycle_is_named_and_takes_no_claim_away():
    odd = 0.3 * ((np.arange(ROWS) > 5150) & (np.arange(ROWS) < 5350))
    result = pipeline.identify([changing(1, Fc=odd, cycles=20)])
    assert "disagrees" in result.verdict.text
    assert result.verdict.Fc


def test_a_sensor_that_drifts_is_named_and_takes_no_claim_away():
    log = synthetic(1)
    log.torque = log.torque + 0.3 * FC * RAMP
    result = pipeline.identify([log])
    assert "offset drifts" in result.verdict.text
    assert result.verdict.identifiable == {"sigma0": True, "Fc": True}
