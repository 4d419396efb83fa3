# SPDX-License-Identifier: MIT
"""What a log says does not hang on the sign of its torque sensor or on the side from which its
shaft is looked at: a log of known trouble and its mirror images are told alike.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from identify_tools import seen, told
from test_identify_claims import CASES, facts_of

pytestmark = pytest.mark.usefixtures("library")

TROUBLES = {  # logs of test_identify_claims, and a word that is said of them
    "low pass": "low-passed",
    "viscous, no clock": "even steps",
    "play before": "play",
    "backlash": "rests",
    "Fc halves": "Fc",
    "magnets": "depends on",
    "torque in coarse steps": "steps of",
    "turns between the rows": "turns between",
    "encoder in step": "in step",
    "spikes of the torque": "weigh",
    "9 rows late": "comes",
}


SIDES = [
    pytest.param(1, id="sensor turned"),
    pytest.param(-1, id="seen from behind", marks=pytest.mark.checks),
]


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize("name", TROUBLES)
def test_a_mirrored_log_is_told_alike(name, side):
    """With the torque of the other sign the same numbers, and with the angle too."""
    log, facts = facts_of(name)
    torque, theta = (-log.torque, log.theta) if side > 0 else (-log.torque, -log.theta)
    other = seen(replace(log, torque=torque, theta=theta), **CASES[name].options)
    assert other["torque_sign"] == -side * facts["torque_sign"]
    assert other["identifiable"] == facts["identifiable"]
    for parameter in ("sigma0", "Fc"):
        assert other[parameter] == pytest.approx(facts[parameter], rel=1e-3)
        assert other["ci95"][parameter] == pytest.approx(facts["ci95"][parameter], rel=1e-2)
    word = TROUBLES[name]
    assert np.abs(told(other, word)) == pytest.approx(np.abs(told(facts, word)), rel=2e-2)
