# SPDX-License-Identifier: MIT
"""dahl.Asymmetric, ElastoPlastic, Loaded, Work, VelocityTable and the way back from a torque: what
a log has, a copy keeps and a caller gets wrong. How exact they are: test_parts_ode.py.
"""

from __future__ import annotations

import copy
import math
import pickle
from fractions import Fraction

import dahl
import mpmath
import numpy as np
import pytest

pytestmark = pytest.mark.usefixtures("library")

PLAN = (100.0, 0.5, 2e-4)
TABLE = [0.5, 0.3, 0.25, 0.0, -0.125, *(0.1 * k for k in range(1, 12))]
MADE = {
    "asymmetric": lambda: dahl.Asymmetric(100.0, 0.5, 0.3, 2e-4),
    "elastoplastic": lambda: dahl.ElastoPlastic(*PLAN, 0.7),
    "slip": lambda: dahl.Slip([100.0, 70.0, 3.0], [0.5, 1.25, 0.01], 2e-4),
    "work": lambda: dahl.Work(dahl.Plan(*PLAN)),
}


@pytest.fixture(params=MADE)
def part(request):
    return MADE[request.param]()


@pytest.fixture
def moves():
    return np.random.default_rng(5).integers(-60, 61, 3000).astype(np.int32)


def test_a_log_has_the_bits_of_its_moves(part, moves):
    one, many = copy.deepcopy(part), part
    found = many.run_counts(moves)
    assert found.tolist() == [one.step_counts(int(move)) for move in moves]
    assert one == many
    assert many.torque == found[-1]
    assert np.ptp(found) > 0.3


def test_a_loaded_log_has_the_bits_of_its_moves(moves):
    loads = np.random.default_rng(6).uniform(0, 1.99, moves.size)
    one, many = (dahl.Loaded(dahl.Plan(*PLAN)) for _ in range(2))
    found = many.run_counts(moves, loads, out := np.empty(moves.size, np.float32))
    assert found is out
    assert found.tolist() == [
        one.step_counts(int(move), float(load)) for move, load in zip(moves, loads, strict=True)
    ]
    assert one == many
    assert many.torque == found[-1]
    bearing, steady = dahl.Friction(dahl.Plan(*PLAN)), dahl.Loaded(dahl.Plan(*PLAN))
    assert (steady.run_counts(moves, np.ones(moves.size, int)) == bearing.run_counts(moves)).all()
    assert steady.step_counts_q30(7, 1) == bearing.step_counts_q30(7)


def exact_clamped(plan, moves, loads):
    """F' = sigma0 (1 - F/(load Fc)) forward, from tick to tick in 50 digits; sigma0 stays, F is cut
    off at load*Fc.
    """
    sigma0, torque = mpmath.mpf(plan.sigma0), mpmath.mpf(plan.Fc)
    found, F = [], mpmath.mpf(0)
    for angle, load in zip(moves, loads, strict=True):
        most = torque * load
        F = max(-most, min(most, F))
        if load and angle:
            end = most if angle > 0 else -most
            F = end - (end - F) * mpmath.exp(-sigma0 * abs(mpmath.mpf(float(angle))) / most)
        found.append(F if load else mpmath.mpf(0))
        F = found[-1]
    return found


def test_a_load_that_leaves_the_stiffness_is_exact(moves):
    """Within 0.6 ulp of Fc, or of load*Fc where that is more; a log has the bits of its moves."""
    rng, plan = np.random.default_rng(6), dahl.Plan(*PLAN[:2])
    angles = (moves[:1000] * 2e-4).astype(np.float32)
    loads = rng.integers(0, 2**11, angles.size) / 2**10  # of which 2^30 is a multiple
    loads[-1] = math.nextafter(2, 0)  # which is rounded down
    one, many = (dahl.Loaded(plan, fixed_stiffness=True) for _ in range(2))
    found = many.run(angles, loads, out := np.empty(angles.size, np.float32))
    assert found is out
    assert found.tolist() == [
        one.step(float(angle), float(load)) for angle, load in zip(angles, loads, strict=True)
    ]
    assert one == many and many.torque == found[-1] and many.load == 2 - 2.0**-30
    with mpmath.workdps(50):
        exact = exact_clamped(plan, angles, loads)
        ulp = np.spacing(np.float32(plan.Fc) * np.maximum(loads, 1).astype(np.float32))
        errors = [
            abs(mpmath.mpf(float(F)) - E) / float(u)
            for F, E, u in zip(found, exact, ulp, strict=True)
        ]
    assert max(errors) <= 0.6
    bearing, steady = dahl.Friction(plan), dahl.Loaded(plan, fixed_stiffness=True)
    assert (steady.run(angles, np.ones(angles.size)) == bearing.run(angles)).all()


def test_each_rule_of_a_load_has_its_own_moves():
    fixed, loaded = dahl.Loaded(dahl.Plan(*PLAN), True), dahl.Loaded(dahl.Plan(*PLAN))
    assert fixed.step(1e-3, 1.0) > 0 and fixed.fixed_stiffness and not loaded.fixed_stiffness
    kept = copy.copy(fixed)
    for call, words in (
        (lambda: fixed.step_counts(1, 1.0), "Loaded.step_counts: fixed_stiffness = True moves by"),
        (lambda: fixed.step_counts_q30(1, 1.0), "Loaded.step_counts_q30: .* True moves by step"),
        (lambda: fixed.run_counts([1], [1.0]), "Loaded.run_counts: .* True moves by step"),
        (lambda: loaded.step(1e-3, 1.0), "Loaded.step: .* False moves by step_counts"),
        (lambda: loaded.run([1e-3], [1.0]), "Loaded.run: .* False moves by step_counts"),
        (lambda: fixed.step("1", 1.0), "dtheta = '1' is not a number"),
        (lambda: fixed.step(1e-3, 2.0), "load = 2.0 is outside 0 <= load < 2"),
        (lambda: fixed.run([1e-3, 1.0], [1.0, 3.0]), r"loads\[1\] = 3.0 is outside"),
        (lambda: dahl.Loaded(dahl.Plan(*PLAN), 1), "fixed_stiffness = 1 is not a bool"),
    ):
        with pytest.raises(dahl.Error, match=words):
            call()
    assert kept == fixed
    assert fixed.step(math.inf, 0.5) == 0.25 and fixed.step(math.nan, 1.0) == 0.25
    assert fixed.step(1e300, 1.5) == 0.75


def test_work_has_the_torques_of_a_bearing(moves):
    bearing, work = dahl.Friction(dahl.Plan(*PLAN)), MADE["work"]()
    assert (work.run_counts(moves) == bearing.run_counts(moves)).all()
    assert work.state == bearing.state
    far, torque = MADE["work"](), work.step_counts(10**7)
    assert torque == far.step_counts(10**7)
    work.state.w = far.state.w
    assert work.state == far.state and work != far


def test_q30_is_the_torque_over_the_larger_fc(moves):
    for name in ("asymmetric", "elastoplastic"):
        one, other = MADE[name](), MADE[name]()
        for move in moves[:500].tolist():
            ratio = one.step_counts_q30(move) * 2.0**-30
            assert ratio == pytest.approx(other.step_counts(move) / 0.5, abs=7e-8)


def test_a_loaded_copy_keeps_its_load():
    gear = dahl.Loaded(dahl.Plan(*PLAN))
    gear.step_counts(40, 0.5)
    again = pickle.loads(pickle.dumps(gear))
    assert again == gear
    assert (again.load, again.torque) == (0.5, gear.torque)
    again.step_counts(0, 0.25)
    assert again != gear
    assert again.torque == gear.torque / 2


def test_a_table_is_odd_and_linear_in_between():
    table = dahl.VelocityTable(TABLE, 3)
    speeds = np.arange(-200, 201)
    values = np.array([0.0, *TABLE], np.float32)
    wanted = np.interp(abs(speeds), 8 * np.arange(17), values) * np.sign(speeds)
    found = table.run_counts(speeds)
    assert np.abs(found - wanted).max() <= 1.5 * 2.0**-30 * max(TABLE) + 2.0**-24
    assert found.tolist() == [table.step_counts(int(speed)) for speed in speeds]
    assert table.step_counts(-(2**31)) == -np.float32(TABLE[-1])


@pytest.mark.parametrize("F", [0.0, 0.01, 0.3, 0.4999, -0.2, -0.5, 0.25])
def test_a_torque_is_reached_by_no_fewer_counts(F):
    bearing = dahl.Friction(dahl.Plan(*PLAN))
    bearing.step_counts(13)
    before = bearing.torque
    counts = bearing.counts_to_torque(F)
    assert bearing.torque == before
    wanted, s = float(np.float32(F)), 1 if F > before else -1

    def torque_after(move):
        return copy.deepcopy(bearing).step_counts(move)

    assert s * torque_after(counts) >= s * wanted
    assert s * counts > 0
    assert s * torque_after(counts - s) < s * wanted
    assert bearing.counts_to_torque(before) == 0


def test_the_tips_of_a_loop():
    plan = dahl.Plan(*PLAN)
    bearing = dahl.Friction(plan)
    for stroke in (1, 7, 50, 1000):
        bearing.run_counts(np.tile([stroke, -stroke], 3000))
        tip = plan.tip_torque(stroke)
        assert tip == pytest.approx(-bearing.torque, rel=1e-6)
        assert tip == pytest.approx(
            plan.Fc * math.tanh(plan.travel_per_count * stroke / 2), rel=1e-7
        )
    assert plan.tip_torque(2**32 - 1) == plan.Fc
    assert plan.tip_torque(0) == 0


def test_no_creep_below_breakaway():
    """Whole counts to and fro at half of Fc: nothing is left of them, in exact fractions."""
    part = dahl.ElastoPlastic(128.0, 0.5, 2.0**-13, 0.7)
    assert part.step_counts(10) == Fraction(10 * 128, 2**13)
    part.run_counts(np.tile([6, -6], 50_000).astype(np.int32))
    assert part.torque == Fraction(10 * 128, 2**13)


WRONG = [
    (lambda: dahl.Asymmetric(1.0, 1, 1e12, 1e-3), "travel of one count sigma0/Fc_backward"),
    (lambda: dahl.Asymmetric(1.0, 1, "1", 1e-3), "Fc_backward = '1' is not a number"),
    (lambda: dahl.Asymmetric(1.0, 1, 1), "missing a required argument: 'theta_per_count'"),
    (lambda: dahl.ElastoPlastic(1.0, 1, 1, 0.0), "breakaway = 0.0 is outside 0 < breakaway < 1"),
    (lambda: dahl.ElastoPlastic(1.0, 1, 1, 1), "breakaway = 1.0 is outside 0 < breakaway < 1"),
    (lambda: dahl.ElastoPlastic(1.0, 1, 1, -0.5), "breakaway = -0.5 is outside"),
    (lambda: dahl.ElastoPlastic(1.0, 1, 1, math.nan), "breakaway = nan is outside"),
    (lambda: dahl.Slip([1], [1, 1], 1e-4), "sigma0 has 1 elements and Fc 2"),
    (lambda: dahl.Loaded(dahl.Plan(1, 1)), "theta_per_count = 0: no encoder"),
    (lambda: dahl.Loaded(3), "plan = 3 is not a Plan"),
    (lambda: dahl.Work(dahl.Plan(1, 1)), "theta_per_count = 0: no encoder"),
    (lambda: dahl.Work(None), "plan = None is not a Plan"),
    (lambda: dahl.VelocityTable([1.0] * 15, 0), "torque has 15 values; 16 were expected"),
    (lambda: dahl.VelocityTable(1.0, 0), "torque = 1.0 is not a list"),
    (lambda: dahl.VelocityTable(np.array(1.0), 0), r"torque = array\(1.\) is not a list"),
    (lambda: dahl.VelocityTable([1e-50] * 16, 0), r"torque\[0\] = 1e-50 is outside 0, or 2"),
    (lambda: dahl.VelocityTable([math.nan] * 16, 0), r"torque\[0\] = nan is outside 0, or 2"),
    (lambda: dahl.VelocityTable([-1.0] * 15 + [1e-30], 0), r"torque\[15\] = 1e-30 is outside"),
    (lambda: dahl.VelocityTable([1.0] * 16, 25), "segment_bits = 25 is not .* 0 to 24"),
    (lambda: dahl.VelocityTable([1.0] * 16, 0).step_counts(2**31), "dcounts = 2147483648"),
    (lambda: dahl.VelocityTable([1.0] * 16, 0).run_counts([0.5]), r"moves\[0\] = 0.5"),
    (lambda: dahl.Plan(1, 1).tip_torque(1), "theta_per_count = 0: no encoder"),
    (lambda: dahl.Plan(1, 1, 1).tip_torque(-1), "stroke = -1 is not a whole number from 0"),
]


@pytest.mark.parametrize(("call", "words"), WRONG)
def test_bad_parameters_are_named(call, words):
    with pytest.raises(dahl.Error, match=words):
        call()


MOVED_WRONG = [
    (lambda gear: gear.step_counts(1, 2.0), "load = 2.0 is outside 0 <= load < 2"),
    (lambda gear: gear.step_counts(1, -1e-9), "load = -1e-09 is outside"),
    (lambda gear: gear.step_counts(1, math.nan), "load = nan is outside"),
    (lambda gear: gear.step_counts_q30(1, "1"), "load = '1' is not a number"),
    (lambda gear: gear.step_counts(0.5, 1), "dcounts = 0.5 is not a whole number"),
    (lambda gear: gear.step_counts(1), "missing a required argument: 'load'"),
    (lambda gear: gear.run_counts([1, 2], [1.0]), r"loads has shape \(1,\), not \(2,\)"),
    (
        lambda gear: gear.run_counts([1, 2], [1.0, 2.0]),
        r"loads\[1\] = 2.0 is outside 0 <= load < 2",
    ),
    (lambda gear: gear.run_counts([1, 2], [1.0, math.nan]), r"loads\[1\] = nan is outside"),
    (lambda gear: gear.run_counts([1, 2], ["a", "b"]), "loads has type"),
    (lambda gear: gear.run_counts([1], [[1], [1, 2]]), "loads is not an array of numbers"),
    (lambda gear: gear.run_counts([1], np.ma.array([1.0], mask=[True])), "loads has masked values"),
    (lambda gear: gear.run_counts([1, 0.5], [1, 1]), r"moves\[1\] = 0.5"),
]


@pytest.mark.parametrize(("call", "words"), MOVED_WRONG)
def test_bad_moves_and_loads_move_nothing(call, words):
    gear = dahl.Loaded(dahl.Plan(*PLAN))
    with pytest.raises(dahl.Error, match=words):
        call(gear)
    assert gear == dahl.Loaded(dahl.Plan(*PLAN))


def test_bad_moves_move_nothing(part):
    before = copy.deepcopy(part)
    for move in (0.5, 2**31, None, "1"):
        with pytest.raises(dahl.Error, match="dcounts = "):
            part.step_counts(move)
    with pytest.raises(dahl.Error, match=r"moves\[1\] = 1.5"):
        part.run_counts([1, 1.5])
    with pytest.raises(dahl.Error, match="out is float32"):
        part.run_counts([1, 2], out=np.empty(3, np.float32))
    assert part == before


@pytest.mark.parametrize(
    ("F", "words"),
    [
        (math.nan, "F = nan is not a finite number of N m"),
        (math.inf, "F = inf is not a finite number of N m"),
        (0.6, "F = 0.6000.* N m is reached by no move: a move of 2.31-1 counts .* most 0.5 N m"),
        (1e300, "F = inf N m is reached by no move"),
        ("1", "F = '1' is not a number"),
    ],
)
def test_torques_that_no_move_reaches(F, words):
    bearing = dahl.Friction(dahl.Plan(*PLAN))
    with pytest.raises(dahl.Error, match=words):
        bearing.counts_to_torque(F)
    with pytest.raises(dahl.Error, match="theta_per_count = 0: no encoder"):
        dahl.Friction(dahl.Plan(1, 1)).counts_to_torque(0.5)
