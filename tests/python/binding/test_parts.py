# SPDX-License-Identifier: MIT
"""The friction models next to dahl.Friction, and their fast forms: a log has the bits of single
moves, and the torques are those of dahl.sim.reference.
"""

import math
from fractions import Fraction
from functools import partial
from types import SimpleNamespace

import dahl
import numpy as np
import pytest
from dahl.binding import models
from dahl.sim import reference
from model_examples import OWN, STATE_ELEMENTS, THETA, made, numbers, whole

PLAN = dahl.Plan(100.0, 0.5, 2e-4)
SLIPS = [100.0, 70.0, 3.0], [0.5, 1.25, 0.01], 2e-4
TABLE = {model.name: model for model in STATE_ELEMENTS}
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
    path = (MOVES * PLAN.theta_per_count).astype(np.float32) if is_fixed else MOVES
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


# --- exact torques --------------------------------------------------------------------------------


@pytest.mark.parametrize("name", models.table())
def test_the_torques_are_the_exact_ones_of_the_parameters(name):
    """Within 0.6 ulp, of which an element of a mix has a share and the sum of them half an ulp."""
    model = models.table()[name]
    element, (sigma0, Fc) = made(model), numbers(model)  # noqa: N806
    loads = [LOADS] if name == "loaded" else []
    if name == "dahl":
        element = dahl.Friction(element)
    torques = element.run_counts(MOVES, *loads)
    scene = SimpleNamespace(sigma0=sigma0[0], Fc=Fc[0], theta_per_count=THETA)
    scene.own = OWN.get(model.key)
    scene.elements = [(sigma0[min(k, len(sigma0) - 1)], torque) for k, torque in enumerate(Fc)]
    loads_q30 = [Fraction(round(load * 2**30), 2**30) for load in LOADS]
    exact = reference.EXACT[name](scene, MOVES, loads_q30)
    most = 0.6 if model.has_plan else 1.1
    assert reference.error_in_ulp(torques, exact, whole(model)).max() <= most


def test_work_has_the_torques_of_its_bearing():
    torques = dahl.Friction(PLAN).run_counts(MOVES)
    assert np.abs(dahl.Work(PLAN).run_counts(MOVES) - torques).max() <= ulp_of(0.5)


def test_a_mix_is_the_sum_of_its_parts_with_their_present_plans():
    alone, slip = dahl.Friction(PLAN), dahl.Slip(*SLIPS)
    mix, total = dahl.Parallel(dahl.Friction(PLAN), dahl.Slip(*SLIPS)), sum(SLIPS[1])
    torques = mix.run_counts(MOVES)
    wanted = slip.run_counts(MOVES).astype(float) + alone.run_counts(MOVES)
    assert np.abs(torques - wanted).max() <= 1.6 * ulp_of(total + 0.5)
    assert mix.parts == (alone, slip) and mix.torque == torques[-1]
    for torque in (2.0, 0.5):
        mix.parts[0].change_plan(dahl.Plan(80.0, torque, 2e-4))
        ratio = mix.step_counts_q30(3) * 2.0**-30
        assert ratio == pytest.approx(mix.torque / (total + torque), abs=7e-8)
    assert dahl.Parallel().step_counts_q30(3) == 0


def test_a_table_over_speed_is_odd_and_linear_between_its_points():
    torques = [0.5, 0.3, 0.25, 0.0, -0.125, *(0.1 * k for k in range(1, 12))]
    table, speeds = dahl.VelocityTable(torques, 3), np.arange(-200, 201)
    values = np.array([0.0, *torques], np.float32)
    wanted = np.interp(abs(speeds), 8 * np.arange(17), values) * np.sign(speeds)
    slack = 1.5 * 2.0**-30 * max(torques) + 2.0**-24
    assert np.abs(table.run_counts(speeds) - wanted).max() <= slack
    assert table.step_counts(-(2**31)) == -np.float32(torques[-1])
