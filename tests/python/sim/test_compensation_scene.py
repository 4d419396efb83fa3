# SPDX-License-Identifier: MIT
"""`dahl demo --scene compensation`: what docs/compensation.md states of each law, its files, and its
refusals. The laws and the axis themselves are in test_compensation_axis.py.
"""

import json
from pathlib import Path

import numpy as np
import pytest
from dahl.sim import compensation
from dahl.sim.compensation import Comparison
from dahl.sim.compensation_axis import LIMIT, PERIOD_S, SLEW, Run, run
from identify_tools import complaint

OBSERVED, LUGRE, DISTURBANCE = "dahl + observer", "LuGre observer", "disturbance observer"
RIVALS = [law for law in compensation.LAWS if law not in ("none", "dahl", OBSERVED)]
RIGHT = ("17 bits", "17 bits, integral", "17 bits, cascade", "LuGre with Stribeck")
WRONG = ("Fc 10 % low", "Fc 10 % high", "Fc 30 % low", "Fc 30 % high")


@pytest.fixture(scope="module")
def compared(library) -> Comparison:
    ended: list[None] = []
    found = compensation.compare(progress=lambda: ended.append(None))
    assert len(ended) == compensation.count_steps()
    return found


@pytest.fixture(scope="module")
def position(compared: Comparison) -> dict[str, dict[str, dict[str, float]]]:
    return compared.numbers["position"]


@pytest.fixture(scope="module")
def hand(compared: Comparison) -> dict[str, dict[str, dict[str, float]]]:
    return compared.numbers["hand"]


AT_MOST = [  # case, law, ratio: what the page promises of the library
    ("17 bits", "dahl", 0.005),
    ("17 bits", OBSERVED, 0.005),
    ("17 bits, cascade", OBSERVED, 0.02),
    ("LuGre with Stribeck", OBSERVED, 0.006),
    ("Maxwell slip", OBSERVED, 0.03),
    ("Fc 10 % low", OBSERVED, 0.015),
    ("Fc 10 % high", OBSERVED, 0.015),
    ("Fc 30 % low", OBSERVED, 0.04),
    ("Fc 30 % high", OBSERVED, 0.04),
    ("Fc 30 % low, cascade", OBSERVED, 0.1),
    ("Fc 30 % high, cascade", OBSERVED, 0.1),
    ("10 mrad to and fro", OBSERVED, 0.05),
]


@pytest.mark.parametrize(("case", "law", "limit"), AT_MOST)
def test_the_library_keeps_its_ratio(case: str, law: str, limit: float, position) -> None:
    assert position[case][law]["ratio"] <= limit


def test_a_right_model_is_twice_as_good_as_each_rival_but_the_learned_one(position) -> None:
    for case in RIGHT:
        rivals = [position[case][law]["ratio"] for law in RIVALS if law != "learned"]
        assert position[case][OBSERVED]["ratio"] < 0.7 * min(rivals), case


def test_with_the_observer_a_wrong_friction_is_a_third_of_the_rivals(position) -> None:
    """Of all but the learned one, also if sigma0 is three times too large."""
    for case in (*WRONG, "Fc 30 % low, cascade", "Fc 30 % high, cascade", "Maxwell slip"):
        rivals = [position[case][law]["ratio"] for law in RIVALS if law != "learned"]
        assert position[case][OBSERVED]["ratio"] < 0.4 * min(rivals), case
