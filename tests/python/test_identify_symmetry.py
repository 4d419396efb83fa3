# SPDX-License-Identifier: MIT
"""What must not change the result: units, signs, origins, the clock, the order of logs, where a log
is cut, and how many rows it has.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from dahl.identify import Log
from identify_tools import (
    COUNT,
    FC,
    SIGMA0,
    chirp,
    dahl_torque,
    log_of,
    seen,
    shaft,
    synthetic,
    width,
)

pytestmark = pytest.mark.usefixtures("library")

TRUTH = {"sigma0": SIGMA0, "Fc": FC}


def late_and_viscous() -> Log:
    theta = chirp(2400)
    torque = dahl_torque(theta) + 0.02 * np.gradient(theta, 1e-3) + 0.1
    return log_of(theta[3:], torque[:-3])


def springy() -> Log:
    log = shaft(1)
    return replace(log, torque=log.torque + 4 * log.theta, time=None)


LOGS: dict[str, Callable[[], Log]] = {
    "late, viscous": late_and_viscous,
    "spring, no clock": springy,
}


@cache
def usual(name: str) -> dict[str, Any]:
    return seen(LOGS[name](), trust_units=True)


def assert_same(one: dict[str, Any], other: dict[str, Any], sigma0: float, Fc: float) -> None:  # noqa: N803
    """`other` is `one` with parameters and intervals times these factors."""
    for name, factor in (("sigma0", sigma0), ("Fc", Fc)):
        assert other[name] == pytest.approx(factor * one[name], rel=2e-3)
        assert width(other, name) == pytest.approx(width(one, name), rel=0.05, abs=1e-3)
    for name in ("identifiable", "model", "rows", "reversals", "cycles_scored", "pieces"):
        assert other[name] == one[name], name
    assert other["r2"] == pytest.approx(one["r2"], abs=1e-4)
    assert other["r2_plan"] == pytest.approx(one["r2_plan"], abs=1e-3)
    assert other["delay_rows"] == pytest.approx(one["delay_rows"], abs=0.05)


@pytest.mark.parametrize("name", LOGS)
@pytest.mark.parametrize(
    ("torque", "angle", "clock", "sign", "shift"),
    [
        pytest.param(-1.0, 1.0, 1.0, -1, 0, id="sensor turned"),
        pytest.param(-1.0, -1.0, 1.0, 1, 0, id="seen from behind"),
        pytest.param(2000.0, 0.02, 7.0, 1, 0, id="other units, slower clock"),
        pytest.param(1.0, 1.0, 1.0, 1, 4321, id="other origin"),
    ],
)
def test_units_signs_and_origins_change_nothing_else(name, torque, angle, clock, sign, shift):
    log, facts = LOGS[name](), usual(name)
    other = replace(
        log,
        theta=angle * (log.theta + shift * COUNT),
        resolution=abs(angle) * log.resolution,
        torque=torque * log.torque,
        time=None if log.time is None else clock * log.time + 5 * shift,
    )
    found = seen(other, trust_units=True)
    assert_same(facts, found, abs(torque / angle), abs(torque))
    assert found["torque_sign"] == sign * facts["torque_sign"]
    assert list(found["extra"]) == list(facts["extra"])
    units = {"offset": torque * sign, "spring": torque * sign / angle}
    units["viscous"] = units["spring"] * clock
    for term in set(units) & set(found["extra"]) - ({"offset"} if shift else set()):
        wanted = units[term] * facts["extra"][term]
        assert found["extra"][term] == pytest.approx(wanted, rel=0.02, abs=1e-3 * abs(units[term]))


def test_what_those_logs_are():
    """So that the test above compares what is there."""
    found = usual("late, viscous")
    assert found["delay_rows"] == pytest.approx(3, abs=0.3)
    assert found["extra"]["viscous"] == pytest.approx(0.02, rel=0.1)
    assert usual("spring, no clock")["extra"]["spring"] == pytest.approx(4, rel=0.1)
    for facts in map(usual, LOGS):
        assert all(facts["identifiable"].values())
        for name, truth in TRUTH.items():
            low, high = facts["ci95"][name]
            assert low <= truth <= high


def parts_of(log: Log) -> tuple[Log, Log]:
    """Cut at the turn next to the middle."""
    middle = log.rows // 2
    cut = middle + int(np.argmax(np.abs(log.theta[middle : middle + log.rows // 6])))
    return replace(log.part(slice(cut)), name="first"), replace(
        log.part(slice(cut, None)), name="b"
    )


def test_a_log_may_be_cut_at_a_turn_and_given_in_any_order():
    log = shaft(2, rows=2400, cycles=10.3)
    first, second = parts_of(log)
    whole, cut, back = seen(log), seen(first, second), seen(second, first)
    assert cut["identifiable"] == whole["identifiable"] == dict.fromkeys(TRUTH, True)
    assert cut["rows"] == whole["rows"] and sorted(cut["logs"]) == ["b", "first"]
    assert_same(cut, {**back, "pieces": cut["pieces"]}, 1.0, 1.0)
    assert back["pieces"] == cut["pieces"][::-1]
    for name in TRUTH:
        low, high = whole["ci95"][name]
        assert low <= cut[name] <= high


def test_ten_times_the_rows_give_the_same():
    """Of the same motion: a long log is thinned to samples of several rows."""
    few, many = (synthetic(4, 0.05, rows=rows, cycles=10) for rows in (2400, 24_000))
    facts, found = seen(few), seen(many)
    assert facts["rows_per_sample"] == 1 < found["rows_per_sample"]
    assert found["identifiable"] == dict.fromkeys(TRUTH, True)
    for name, truth in TRUTH.items():
        for one, other in ((facts, found), (found, facts)):
            low, high = one["ci95"][name]
            assert low <= truth <= high
            assert (
                abs(other[name] - one[name]) < 1.5 * (width(one, name) + width(other, name)) * truth
            )
    assert found["rows"] == 24_000 and sum(found["pieces"]) == 24_000
