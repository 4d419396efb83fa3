# SPDX-License-Identifier: MIT
"""dahl.Damping: its formula, and refusals with their limits."""

import math

import dahl
import pytest

GIVEN = {"sigma0": 500.0, "Fc": 1.5, "sigma1": 1.9, "period": 1e-3}


def test_the_damping_is_sigma1_over_sigma0_times_the_change_of_the_torque() -> None:
    element = dahl.Friction(dahl.Plan(500.0, 1.5, 3.8e-4))
    damping, before = dahl.Damping(**GIVEN), 0.0
    for tick in range(1000):
        w = element.step_counts_q30(round(3 * math.sin(tick / 20)))
        F = 1.5 * w / 2**30  # noqa: N806
        due = F + 1.9 / 500 * (F - before) / 1e-3
        assert damping.apply(w) == pytest.approx(max(-3.0, min(due, 3.0)), abs=1e-4)
        before = F


REFUSED = [
    ({"sigma0": 0.0}, ("sigma0 = 0 ", "N m/rad")),
    ({"Fc": math.nan}, ("Fc = nan ", "N m")),
    ({"sigma1": -1.0}, ("sigma1 = -1 ", "N m s/rad")),
    ({"period": math.inf}, ("period = inf ", "s")),
    ({"sigma1": 2e4}, ("sigma1/(sigma0*period) = 40000 ", "32767")),
    ({"sigma1": 1e-6}, ("sigma1/(sigma0*period) = 2e-06 ", "2^-16")),
]


@pytest.mark.parametrize(("changed", "words"), REFUSED)
def test_a_value_out_of_range_is_named_with_its_limit(changed, words) -> None:
    with pytest.raises(dahl.Error) as caught:
        dahl.Damping(**(GIVEN | changed))
    assert [word for word in words if word not in str(caught.value)] == []
