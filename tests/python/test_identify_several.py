# SPDX-License-Identifier: MIT
"""Several logs of one shaft: what is wrong in one of them is put right there, said of that log, and
counts for all.
"""

from __future__ import annotations

from dataclasses import replace

import identify_cases as made
import numpy as np
import pytest
from dahl import Error
from identify_cases import FC, SIGMA0, shaft
from identify_tools import seen, told
from test_identify_claims import coarse

pytestmark = pytest.mark.usefixtures("library")


def test_of_two_logs_the_worse_one_counts():
    """Noise of the angle, counts too coarse, steps of the torque: in one of them it is in both."""
    good = shaft(2)
    for bad, word in (
        (made.shaky(5), "angle noise"),
        (coarse(1.9)(), "resolution"),
        (made.in_steps(1.5, 0.0), "steps of"),
    ):
        facts = seen(good, bad)
        assert told(facts, word) is not None, word
        assert not facts["identifiable"]["sigma0"], word


SECOND = {  # a log of its own trouble, the word for it, and where there is a second one its numbers
    "spikes of the angle": (lambda: made.spiked(20, angle=0.02), "median", [22]),
    "spikes of the torque": (lambda: made.spiked(100, torque=2.0), "weigh", [100, 3000]),
    "a gap": (lambda: made.with_gaps(shaft(4), (500, 700)), "gap", [1, 2]),
    "rows that repeat": (lambda: made.repeating(29), "repeat", [29, 2429]),
    "a counter of 128": (lambda: made.wrapping(128), "wraps", [48, 128]),
}


@pytest.mark.parametrize("name", SECOND)
@pytest.mark.parametrize("place", [0, 1])
def test_what_is_wrong_in_one_of_two_logs_is_put_right_and_said_of_that(name, place):
    make, word, numbers = SECOND[name]
    logs = [replace(shaft(2), name="good")]
    logs.insert(place, replace(make(), name="bad"))
    facts = seen(*logs, terms=(), delay=False)
    assert all(facts["identifiable"].values()), facts["verdict"]
    assert (facts["sigma0"], facts["Fc"]) == pytest.approx((SIGMA0, FC), rel=0.02)
    said = [note for note in facts["notes"] if word in note]
    assert said and all(note.startswith("bad: ") for note in said)
    assert set(numbers) <= set(told(facts, word))


def test_two_logs_have_one_delay_one_sign_and_the_larger_backlash():
    late = [made.late(8, seed) for seed in (5, 6)]
    facts = seen(*(replace(log, torque=-log.torque) for log in late))
    assert facts["delay_rows"] == pytest.approx(8, abs=0.3) and facts["torque_sign"] == -1
    assert (facts["sigma0"], facts["Fc"]) == pytest.approx((SIGMA0, FC), rel=0.02)
    assert facts["rmse"] == pytest.approx(0.02 * FC, rel=0.2)
    facts = seen(late[0], made.without_clock(late[1]))
    assert facts["delay_rows"] == 0 and {one["delay_rows"] for one in facts["choices"]} == {0}
    for slacks in ((0.01, 0.004), (0.004, 0.01)):
        facts = seen(*map(made.played, slacks), terms=(), delay=False)
        assert facts["backlash"] == pytest.approx(0.01, rel=0.1)


@pytest.mark.parametrize("viscous", [0.05, 0.0])
def test_logs_without_times_may_have_rows_of_other_lengths(viscous):
    """One of them has every second row: no common clock explains both, but each has its own."""
    logs = [made.without_clock(made.beside("viscous", viscous)) for _ in range(2)]
    logs[1] = replace(logs[1], theta=logs[1].theta[::2], torque=logs[1].torque[::2])
    facts = seen(*logs)
    assert facts["identifiable"]["Fc"] is (viscous == 0)
    low, high = facts["ci95"]["Fc"]
    assert low <= 1.002 * FC and 0.998 * FC <= high


def test_a_viscous_part_too_small_to_pay_is_in_the_interval():
    """Without times it goes into Fc: 1.4 % of Fc at the highest speed, and both are claimed."""
    facts = seen(made.without_clock(made.beside("viscous", 0.008)))
    low, high = facts["ci95"]["Fc"]
    assert all(facts["identifiable"].values()) and low <= FC <= high
    assert facts["Fc"] > 1.003 * FC


@pytest.mark.parametrize("term", ["viscous", "inertia"])
def test_a_term_of_the_speed_takes_times(term):
    """It was told as 0, and what it would have taken went into sigma0 and Fc."""
    log = replace(made.without_clock(shaft()), name="untimed")
    with pytest.raises(Error, match=f"untimed: {term} .*--time"):
        seen(shaft(2), log, terms=("offset", term))
    still = replace(shaft(), name="untimed", time=np.full(2400, 5.0))
    with pytest.raises(Error, match=f"untimed: {term} .*--time"):
        seen(still, terms=(term,))
    facts = seen(made.without_clock(made.beside("viscous", 0.05)), terms=("offset",))
    assert not facts["identifiable"]["Fc"]
