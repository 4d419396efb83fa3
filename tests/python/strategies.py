# SPDX-License-Identifier: MIT
"""Hypothesis strategies that several tests share: parameters of the model, plans, moves, copies."""

import copy
import pickle

import dahl
import numpy as np
from hypothesis import strategies as st

LIMIT = 64  # sigma0, Fc and theta_per_count lie within 2^-64 and 2^64
STEPS = st.integers(-9, 9) | st.integers(-5000, 5000) | st.integers(-(2**31), 2**31 - 1)  # counts
TRAVELS = st.floats(-29.9, 9.8).map(lambda exponent: 2.0**exponent)  # presliding lengths a count


def as_float(x: float) -> float:
    return float(np.float32(x))


def float32(low: float, high: float) -> st.SearchStrategy[float]:
    return st.floats(as_float(low), as_float(high), width=32)


def is_in_range(parameters: tuple[float, ...]) -> bool:
    return all(2.0**-LIMIT <= each < 2.0 ** (LIMIT - 1) for each in parameters)


def parameters(exponents: float = LIMIT - 1) -> st.SearchStrategy[tuple[float, float, float]]:
    """sigma0, Fc and theta_per_count, Fc and theta_per_count up to 2^exponents."""
    powers = st.floats(-exponents, exponents).map(lambda exponent: 2.0**exponent)
    of = st.tuples(TRAVELS, powers, powers)
    return of.map(lambda one: (one[0] * one[1] / one[2], one[1], one[2])).filter(is_in_range)


PLANS = parameters().map(lambda one: dahl.Plan(*one))


def pickled(one: object) -> object:
    return pickle.loads(pickle.dumps(one))


COPIES = (copy.copy, copy.deepcopy, pickled)
