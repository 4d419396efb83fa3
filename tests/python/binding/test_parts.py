# SPDX-License-Identifier: MIT
"""The friction models next to dahl.Friction, and their fast forms.

References are exact fractions, or Friction itself if a model becomes one.
"""

from __future__ import annotations

import math
from fractions import Fraction
from functools import partial
from itertools import pairwise
from typing import Any

import dahl
import numpy as np
import pytest
from dahl.binding import models
from hypothesis import given, settings
from hypothesis import strategies as st
from model_examples import BRISTLES, made, whole
from strategies import as_float

pytestmark = pytest.mark.usefixtures("library")

PLAN = dahl.Plan(100.0, 0.5, 2e-4)
SIGMA0, FC, THETA = [100.0, 70.0, 3.0], [0.5, 1.25, 0.01], 2e-4
ULPS = 0.55  # of Fc (of the sum, of the larger Fc): the bound of the docstrings
TABLE = {model.name: model for model in BRISTLES}
TABLE |= {name: model for name, model in models.table().items() if model.sigma0s == 0}
MADE = {name: partial(made, model) for name, model in TABLE.items()} | {
    "work": lambda: dahl.Work(PLAN),
    "velocity": lambda: dahl.VelocityTable([0.1 * k - 0.3 for k in range(16)], 2),
}
MOVES = np.random.default_rng(5).integers(-60, 61, 3000).astype(np.int32)
LOADS = np.random.default_rng(6).uniform(0, 1.99, MOVES.size)


def ulp_of(torque: float) -> float:
    return float(np.spacing(np.float32(torque)))


# --- a log, single moves, and the ratio -----------------------------------------------------------


@pytest.mark.parametrize("name", MADE)
def test_a_log_has_the_bits_of_single_moves(name):
    one, many, by_ratio = MADE[name](), MADE[name](), MADE[name]()
    torques = many.run_counts(MOVES, out := np.empty(MOVES.size, np.float32))
    assert torques is out and np.ptp(torques) > 0.3
    assert torques.tolist() == [one.step_counts(int(move)) for move in MOVES]
    if name != "velocity":
        assert one == many and many.torque == torques[-1]
    if name in TABLE:
        ratios = [by_ratio.step_counts_q30(move) * 2.0**-30 for move in MOVES.tolist()]
        assert ratios == pytest.approx(torques.astype(float) / whole(TABLE[name]), abs=7e-8)


@pytest.mark.parametrize("is_fixed", [False, True])
def test_a_log_with_loads_has_the_bits_of_single_moves(is_fixed):
    """By counts, or by angles if the stiffness stays. A load of 1 has the bits of a bearing."""
    path = (MOVES * THETA).astype(np.float32) if is_fixed else MOVES
    run, step = ("run", "step") if is_fixed else ("run_counts", "step_counts")
    one, many, steady = (dahl.Loaded(PLAN, fixed_stiffness=is_fixed) for _ in range(3))
    torques = getattr(many, run)(path, LOADS, out := np.empty(MOVES.size, np.float32))
    pairs = zip(path.tolist(), LOADS.tolist(), strict=True)
    assert torques is out and torques.tolist() == [getattr(one, step)(*pair) for pair in pairs]
    assert one == many and many.torque == torques[-1]
    assert many.load == round(LOADS[-1] * 2**30) / 2**30
    bearing = getattr(dahl.Friction(PLAN), run)(path)
    assert (getattr(steady, run)(path, np.ones(MOVES.size)) == bearing).all()
    most = math.nextafter(2.0, 0.0)  # rounds to 2, beyond Q30
    assert getattr(steady, step)(10**9, most) == getattr(many, run)([10**9], [most])[0] == 1


STREAMS = MADE | {
    "dahl": lambda: dahl.Friction(PLAN),
    "by angle": lambda: dahl.Friction(PLAN),
    "load": lambda: dahl.Loaded(PLAN),
}


def run_chunk(one: Any, name: str, part: slice) -> np.ndarray:
    if name == "by angle":
        return one.run(MOVES[part] * THETA)
    return one.run_counts(MOVES[part], *([LOADS[part]] if name == "load" else []))


@pytest.mark.parametrize("name", STREAMS)
@settings(max_examples=20)
@given(st.lists(st.integers(0, MOVES.size), max_size=5))
def test_a_log_in_chunks_of_any_size_has_the_bits_of_the_whole(name, cuts):
    at_once, in_chunks = STREAMS[name](), STREAMS[name]()
    edges = [0, *sorted(cuts), MOVES.size]
    torques = [run_chunk(in_chunks, name, slice(*pair)) for pair in pairwise(edges)]
    assert np.concatenate(torques).tobytes() == run_chunk(at_once, name, slice(None)).tobytes()


# --- models that become a Friction ----------------------------------------------------------------


@given(st.lists(st.integers(-400, 400), max_size=40), st.integers(1, 2**31 - 1))
def test_a_model_that_becomes_a_bearing_moves_like_one(moves, load_q30):
    """A load c scales sigma0 and Fc. Equal limits, or motion in one direction, leave one Fc."""
    load = load_q30 / 2**30
    bearing = dahl.Friction(PLAN)
    torques = bearing.run_counts(moves).astype(float)
    twins = {  # a log of the model, the log that it equals, and its largest torque
        "loaded": (dahl.Loaded(PLAN).run_counts(moves, [load] * len(moves)), load * torques, 1.0),
        "asymmetric": (dahl.Asymmetric(100, 0.5, 0.5, 2e-4).run_counts(moves), torques, 0.5),
        "parallel": (
            dahl.Parallel(dahl.Friction(PLAN), dahl.Friction(PLAN)).run_counts(moves),
            2 * torques,
            1.0,
        ),
        "work": (dahl.Work(PLAN).run_counts(moves), torques, 0.5),
    }
    one_way = np.abs(moves)
    for sign, limits in ((1, (0.5, 0.3)), (-1, (0.3, 0.5))):
        here = dahl.Asymmetric(100, *limits, 2e-4).run_counts(sign * one_way)
        twins[f"asymmetric {sign}"] = here, dahl.Friction(PLAN).run_counts(sign * one_way), 0.5
    for name, (here, there, most) in twins.items():
        assert np.abs(here - there).max(initial=0) <= 1.1 * ulp_of(most), name


# --- slip elements and mixes ----------------------------------------------------------------------


def exact_slip(sigma0, torques, moves) -> list[Fraction]:
    """Springs that slip, in fractions of the parameters as C reads them."""
    count, *values = (Fraction(as_float(value)) for value in (THETA, *sigma0, *torques))
    stiff, most = [k * count for k in values[: len(sigma0)]], values[len(sigma0) :]
    force, sums = [Fraction(0)] * len(stiff), []
    for move in moves.tolist():
        limited = zip(force, stiff, most, strict=True)
        force = [max(-F, min(F, f + k * move)) for f, k, F in limited]
        sums.append(sum(force))
    return sums


def test_a_mix_is_the_sum_of_its_parts_with_their_present_plans():
    alone = dahl.Friction(PLAN)
    mix = dahl.Parallel(dahl.Friction(PLAN), dahl.Slip(SIGMA0, FC, THETA))
    exact = np.array(exact_slip(SIGMA0, FC, MOVES), float) + alone.run_counts(MOVES)
    torques = mix.run_counts(MOVES)
    assert np.abs(torques - exact).max() <= (ULPS + 0.52) * ulp_of(sum(FC) + 0.5)
    assert mix.parts[0] == alone and mix.torque == torques[-1]
    for torque in (2.0, 0.5):
        mix.parts[0].change_plan(dahl.Plan(80.0, torque, THETA))
        ratio = mix.step_counts_q30(3) * 2.0**-30
        assert ratio == pytest.approx(mix.torque / (sum(FC) + torque), abs=7e-8)
    assert dahl.Parallel().step_counts_q30(3) == 0


def test_the_fast_mix_equals_the_exact_mix_each_time():
    theta, limit, moves = as_float(THETA), as_float(FC[1]), np.tile(MOVES, 10)
    exact = dahl.Parallel(
        dahl.Friction(dahl.Plan(80, 2, theta)), dahl.Slip([100], [limit], theta)
    ).run_counts(moves)
    fast = dahl.ThroughputParallel(
        dahl.Throughput(80, 2, theta), dahl.ThroughputSlip([100], [limit], theta)
    )
    for _ in range(2):
        assert np.abs(fast.run_counts(moves).astype(float) - exact).max() <= 1.07 * ulp_of(3.25)
    assert dahl.ThroughputParallel().run_counts([1, 2]).tolist() == [0, 0]


# --- other references -----------------------------------------------------------------------------


def test_a_table_over_speed_is_odd_and_linear_between_its_points():
    torques = [0.5, 0.3, 0.25, 0.0, -0.125, *(0.1 * k for k in range(1, 12))]
    table, speeds = dahl.VelocityTable(torques, 3), np.arange(-200, 201)
    values = np.array([0.0, *torques], np.float32)
    wanted = np.interp(abs(speeds), 8 * np.arange(17), values) * np.sign(speeds)
    slack = 1.5 * 2.0**-30 * max(torques) + 2.0**-24
    assert np.abs(table.run_counts(speeds) - wanted).max() <= slack
    assert table.step_counts(-(2**31)) == -np.float32(torques[-1])
