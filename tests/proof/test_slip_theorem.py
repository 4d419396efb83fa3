# SPDX-License-Identifier: MIT
"""docs/accuracy.md on slip elements: what a prepared plan errs by, in exact fractions."""

from __future__ import annotations

import ctypes
import random
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from sources import number
from test_error_theorem import THEOREM, read_constants

MOST = 8
FULL = 2**62


class Params(ctypes.Structure):
    """dahl_slip_params_t"""

    _fields_ = [
        ("elements", ctypes.c_uint32),
        ("theta_per_count", ctypes.c_float),
        ("sigma0", ctypes.c_float * MOST),
        ("Fc", ctypes.c_float * MOST),
    ]


class Element(ctypes.Structure):
    """dahl_slip_element_t"""

    _fields_ = [("limit", ctypes.c_uint32), ("weight", ctypes.c_uint32)]


class Plan(ctypes.Structure):
    """dahl_slip_plan_t"""

    _fields_ = [
        ("full", ctypes.c_uint64),
        ("Fc_mantissa", ctypes.c_uint32),
        ("Fc_exponent", ctypes.c_int32),
        ("elements", ctypes.c_uint32),
        ("element", Element * MOST),
        ("shift", ctypes.c_uint8 * MOST),
    ]


def random_params() -> Params:
    """Travel of a count of 2^-29 to 2, shares that are alike or differ by 2^60."""
    params = Params(random.randint(1, MOST), np.float32(random.uniform(0.5, 1)))
    spread = random.choice((0, 1, 4, 60))
    for k in range(params.elements):
        params.Fc[k] = random.uniform(1, 2) * 2.0 ** (30 - random.uniform(0, spread))
        params.sigma0[k] = params.Fc[k] * 2.0 ** random.uniform(-28, 0)
    return params


def test_a_prepared_plan_errs_as_the_theorem_says(library: Path) -> None:
    lib = ctypes.CDLL(str(library))
    constants = {
        name: Fraction(float(v)) for name, v in read_constants(THEOREM.read_text()).items()
    }
    random.seed(1)
    worst_limit = worst_weight = Fraction(0)
    for _ in range(4000):
        params, plan = random_params(), Plan()
        assert lib.dahl_slip_prepare(ctypes.byref(plan), ctypes.byref(params)) == 0
        total = sum(Fraction(params.Fc[k]) for k in range(params.elements))
        weights = Fraction(0)
        for k in range(params.elements):
            element, Fc = plan.element[k], Fraction(params.Fc[k])  # noqa: N806
            travel = Fraction(params.sigma0[k]) * Fraction(params.theta_per_count)
            limit_error = abs(element.limit - Fc / travel * 2 ** plan.shift[k])
            assert 2**30 <= element.limit < 2**31 and limit_error <= constants["limit_units"]
            worst_limit = max(worst_limit, limit_error)
            weights += abs(element.weight * element.limit - Fc / total * FULL)
        limits = sum(element.limit for element in plan.element[: params.elements])
        assert weights <= constants["weight_units"] * limits
        worst_weight = max(worst_weight, weights / limits)
        assert plan.full == sum(e.weight * e.limit for e in plan.element[: params.elements])
        assert abs(plan.full - FULL) <= constants["full_excess"] * FULL
        excess = plan.Fc_mantissa - total / Fraction(2) ** plan.Fc_exponent
        assert 0 <= excess <= 1 and 2**31 <= plan.Fc_mantissa
    assert worst_limit > Fraction(99, 100) * constants["limit_units"]
    assert worst_weight > Fraction(9, 10) * constants["weight_units"]


@pytest.mark.parametrize("elements", [1, MOST])
def test_the_bound_of_the_header_is_that_of_the_theorem(elements: int) -> None:
    k = {name: float(v) for name, v in read_constants(THEOREM.read_text()).items()}
    error = 4 * k["limit_units"] * 2**-31 + k["weight_units"] * (2 * elements - 1) * 2**-32
    assert error + k["gap_rounding"] <= number("DAHL_SLIP_ERROR_Q30", "dahl_parts.h")
    assert k["output"] + error * 2**24 <= number("DAHL_ULP_PARTS", "dahl_parts.h")
