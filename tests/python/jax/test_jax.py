# SPDX-License-Identifier: MIT
"""dahl.jax in float32 and float64: its error against the library and the exact torque; batches. Its
gradients against finite differences, also at reversals and without motion.
"""

import re
from functools import partial
from importlib import import_module
from typing import Any

import dahl
import mpmath
import numpy as np
import pytest
from dahl.sim import reference
from hypothesis import given
from hypothesis import strategies as st
from strategies import float32

MISSING = "unproven: dahl.jax: jax is not installed; tools/setup.sh checks installs it"
jax: Any = pytest.importorskip("jax.numpy", reason=MISSING) and import_module("jax")
friction: Any = import_module("dahl.jax")

EPS = {"float32": 2.0**-24, "float64": 2.0**-53}
DTYPES = pytest.mark.parametrize("dtype", EPS)
STATED = int(re.search(r"(\d+) eps Fc, for any motion", friction.__doc__)[1])
LIBRARY = 1.2 * 2.0**-24  # of Fc: 0.6 ulp
THETA = 2.0**-20  # [rad] of one count, so that a move of 24 bits is exact in float32
ROWS, LONG = 48, 5_000  # moves
MOVES = st.lists(
    st.integers(-9, 9)
    | st.integers(-(2**23), 2**23)
    | st.builds(lambda n, k: n * 2**k, st.integers(-(2**23), 2**23), st.integers(0, 8)),
    min_size=1,
    max_size=ROWS,
)
KINDS = ("Dahl", "Slip", "ElastoPlastic")
KIND = pytest.mark.parametrize("kind", KINDS)
B = 0.625  # breakaway


def made(kind: str, sigma0: Any, Fc: Any, breakaway: Any = B) -> Any:  # noqa: N803
    if kind == "Slip":
        return friction.Slip(jax.numpy.asarray(sigma0)[..., None], jax.numpy.asarray(Fc)[..., None])
    own = (breakaway,) if kind == "ElastoPlastic" else ()
    return getattr(friction, kind)(sigma0, Fc, *own)


@partial(jax.jit, static_argnums=(0, 4))
def torques(kind: str, sigma0: Any, Fc: Any, moves: Any, dtype: str) -> Any:  # noqa: N803
    """Return F after each move [rad], from rest, in one compiled scan."""
    one = made(kind, sigma0, Fc)
    return jax.lax.scan(one.step, one.relaxed(dtype=dtype), moves)[1]


def run(kind: str, sigma0: float, Fc: float, counts: list[int], dtype: str) -> np.ndarray:  # noqa: N803
    with jax.enable_x64(dtype == "float64"):
        values = (np.asarray(each, dtype) for each in (sigma0, Fc, np.multiply(counts, THETA)))
        return np.asarray(torques(kind, *values, dtype))


def exact(kind: str, sigma0: float, Fc: float, counts: list[int]) -> list[mpmath.mpf]:  # noqa: N803
    """Return F/Fc after each move, by mpmath."""
    travel = reference.travel_per_count(sigma0, Fc, THETA)
    if kind == "Slip":
        return reference.exact_slip_ratios(counts, [(sigma0, Fc)], THETA)
    if kind == "ElastoPlastic":
        return reference.exact_elastoplastic_ratios(counts, travel, B)
    return reference.exact_ratios(counts, travel)


def of_library(kind: str, sigma0: float, Fc: float, counts: list[int]) -> np.ndarray:  # noqa: N803
    if kind == "Dahl":
        return dahl.Friction(dahl.Plan(sigma0, Fc)).run(np.multiply(counts, THETA))
    if kind == "Slip":
        return dahl.Slip([sigma0], [Fc], THETA).run_counts(counts)
    return dahl.ElastoPlastic(sigma0, Fc, THETA, B).run_counts(counts)


def elastic_travels(kind: str, ratios: Any, travels: np.ndarray) -> np.ndarray:
    """Return the travel within the spring since the torque was last saturated, after each move."""
    total, sums = 0.0, []
    for ratio, travel in zip(ratios, travels, strict=True):
        total = 0.0 if kind == "Dahl" or abs(ratio) > 1 - 2.0**-30 else total + min(travel, 2.0)
        sums.append(total)
    return np.array(sums)


def check_bound(kind: str, sigma0: float, Fc: float, counts: list[int], dtype: str) -> None:  # noqa: N803
    ratios = exact(kind, sigma0, Fc, counts)
    travels = np.abs(np.multiply(counts, THETA)) * sigma0 / Fc
    bound = STATED * EPS[dtype] * (1 + elastic_travels(kind, ratios, travels))
    got = run(kind, sigma0, Fc, counts, dtype)
    wrong = [abs(float(mpmath.mpf(float(F)) / Fc - w)) for F, w in zip(got, ratios, strict=True)]
    assert (wrong <= bound).all() and (abs(got) <= Fc * (1 + 2 * EPS[dtype])).all()
    own = abs(got - of_library(kind, sigma0, Fc, counts).astype(float)) / Fc
    assert (own <= bound + LIBRARY).all()


HARD = {
    "tiny moves near Fc": (3.0, 0.7, [500_000, *[1] * LONG]),
    "tiny moves to and fro": (3.0, 0.7, [500_000, *[2, -1] * (LONG // 2)]),
    "one count to and fro": (1e3, 0.7, [1_000, *[1, -1] * (LONG // 2)]),
    "random": (7e3, 0.3, np.random.default_rng(1).integers(-40, 41, LONG).tolist()),
    "giant": (1e3, 1e-3, [2**30, -(2**30), 1, 0, -(2**30), 0, 3, -3]),
    "long reversals": (90.0, 1.3, [3**k * (-1) ** k for k in range(14)] * (LONG // 14)),
}


@KIND
@DTYPES
@given(sigma0=float32(1, 2**13), Fc=float32(2**-7, 2**10), counts=MOVES)
def test_the_error_is_at_most_the_stated_one(kind, dtype, sigma0, Fc, counts) -> None:  # noqa: N803
    padded = counts + [0] * (ROWS - len(counts))  # of one length: one compilation
    check_bound(kind, sigma0, Fc, padded, dtype)


@KIND
@DTYPES
@pytest.mark.parametrize("name", HARD)
def test_the_error_does_not_grow_in_long_motions(kind, dtype, name) -> None:
    sigma0, Fc, counts = HARD[name]
    sigma0, Fc = float(np.float32(sigma0)), float(np.float32(Fc))
    check_bound(kind, sigma0, Fc, counts, dtype)


def loss(one: Any, moves: Any, weights: Any) -> Any:
    return weights @ jax.lax.scan(one.step, one.relaxed(), moves)[1]


@KIND
@pytest.mark.parametrize("seed", range(3))
def test_gradients_by_parameters_and_moves_are_those_of_finite_differences(kind, seed) -> None:
    """Of a sum of torques over moves of both directions. Some saturate."""
    rng = np.random.default_rng(seed)
    moves = rng.normal(size=40) * 10.0 ** rng.uniform(-4, -1, 40)
    with jax.enable_x64(True):
        one = jax.tree.map(np.asarray, made(kind, 30.0, 0.7))
        point, restore = import_module("jax.flatten_util").ravel_pytree((one, moves))
        weights = rng.normal(size=40)
        value = jax.jit(lambda point: loss(*restore(point), weights))
        steps = np.diag(1e-6 * np.maximum(abs(point), 1e-4))
        apart = [(value(point + h) - value(point - h)) / (2 * h.sum()) for h in steps]
        got = jax.grad(value)(point)
    assert got == pytest.approx(np.array(apart), rel=2e-6, abs=2e-6 * np.abs(got).max())


STARTS = (-1.0, -B, -0.3, 0.0, 0.2, B, 1.0)  # F/Fc


@KIND
@DTYPES
@pytest.mark.parametrize("start", STARTS)
def test_at_a_kink_the_slope_lies_between_those_of_both_sides(kind, dtype, start) -> None:
    """At the start of a reversal, at a limit, and at the end of the spring, all without motion."""
    with jax.enable_x64(dtype == "float64"):
        one = made(kind, np.asarray(64, dtype), np.asarray(0.5, dtype))
        state = one.relaxed(dtype=dtype)._replace(ratio=np.full(np.shape(one.sigma0), start, dtype))
        torque = jax.jit(lambda move: one.step(state, move)[1])
        h = 2.0**-20
        sides = sorted([(torque(h) - torque(0.0)) / h, (torque(0.0) - torque(-h)) / h])
        slope = jax.jit(jax.grad(torque))(np.asarray(0, dtype))
    assert sides[0] - 0.02 * 64 <= slope <= sides[1] + 0.02 * 64


@KIND
@given(counts=MOVES, start=st.sampled_from(STARTS))
def test_gradients_are_finite(kind, counts, start) -> None:
    """In float32, by each parameter, move and the start, for giant moves, no motion, reversals."""
    moves = np.multiply(
        counts + [0] * (ROWS - len(counts)), np.float32(1e20 if start == 0 else THETA)
    )
    values = gradients(kind, moves.astype(np.float32), np.float32(start))
    assert all(np.isfinite(each).all() for each in jax.tree.leaves(values))


@partial(jax.jit, static_argnums=0)
def gradients(kind: str, moves: Any, start: Any) -> Any:
    def value(one: Any, moves: Any, start: Any) -> Any:
        state = jax.tree.map(lambda zero: zero + start, one.relaxed())._replace(
            low=one.relaxed().low
        )
        return jax.lax.scan(one.step, state, moves)[1].sum()

    return jax.grad(value, (0, 1, 2))(made(kind, 100.0, 0.5), moves, start)


@KIND
@pytest.mark.parametrize("move", [np.nan, np.inf, -np.inf])
def test_a_nan_is_no_motion_and_an_infinite_move_saturates(kind, move) -> None:
    one = made(kind, 100.0, 0.5)
    state, torque = one.step(one.relaxed(), 2e-3)
    after = one.step(state, move)[1]
    assert after == (torque if np.isnan(move) else np.copysign(np.float32(0.5), move))
    slopes = jax.grad(lambda one: one.step(state, move)[1])(one)
    assert all(np.isfinite(each).all() for each in jax.tree.leaves(slopes))


@KIND
def test_a_batch_by_vmap_or_by_broadcasting_has_the_torques_of_single_elements(kind) -> None:
    rng = np.random.default_rng(4)
    sigma0, Fc = rng.uniform(50, 100, 5), rng.uniform(0.1, 1, 5)  # noqa: N806
    moves = rng.normal(size=(5, 30)) * 0.01
    with jax.enable_x64(True):
        single = [made(kind, *pair) for pair in zip(sigma0, Fc, strict=True)]
        alone = [
            jax.lax.scan(one.step, one.relaxed(), row)[1]
            for one, row in zip(single, moves, strict=True)
        ]
        all_of_them = made(kind, sigma0, Fc)
        if kind == "ElastoPlastic":
            all_of_them = all_of_them._replace(breakaway=np.full(5, B))
        batch = jax.jit(jax.vmap(lambda one, row: jax.lax.scan(one.step, one.relaxed(), row)[1]))
        mapped = batch(all_of_them, moves)
        broadcast = jax.lax.scan(all_of_them.step, all_of_them.relaxed(), moves.T)[1].T
    assert np.array(alone) == pytest.approx(np.asarray(mapped), abs=1e-15)
    assert np.array(alone) == pytest.approx(np.asarray(broadcast), abs=1e-15)


def test_slip_elements_in_parallel_have_the_torque_of_the_library() -> None:
    sigma0, Fc = [100.0, 50.0, 20.0], [0.25, 0.5, 1.0]  # noqa: N806
    counts = np.random.default_rng(5).integers(-20_000, 20_000, 200)
    one = friction.Slip(np.float32(sigma0), np.float32(Fc))
    got = jax.lax.scan(one.step, one.relaxed(), np.float32(counts * THETA))[1]
    expected = dahl.Slip(sigma0, Fc, THETA).run_counts(counts)
    assert np.asarray(got) == pytest.approx(expected, abs=200 * EPS["float32"] * sum(Fc))


def test_parameters_may_be_whole_numbers_and_one_slip_element_needs_no_list() -> None:
    for one in (friction.Dahl(100, 1), friction.Slip(100, 1), friction.ElastoPlastic(100, 1, 0.5)):
        state, torque = jax.lax.scan(one.step, one.relaxed(), np.full(3, 1e-3, np.float32))
        assert state.ratio.dtype == np.float32 and 0.09 < torque[0] < torque[2] < 0.31


@KIND
def test_the_method_of_the_class_maps_over_elements_states_and_moves(kind) -> None:
    several = made(kind, np.float32([50, 60]), np.float32([1, 2]), np.float32([B, B]))
    moves = np.float32([1e-3, -1e-3])
    mapped = jax.vmap(type(several).step)(several, several.relaxed(), moves)[1]
    assert np.asarray(mapped) == pytest.approx(several.step(several.relaxed(), moves)[1])
