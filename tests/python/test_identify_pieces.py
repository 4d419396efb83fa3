# SPDX-License-Identifier: MIT
"""The pieces of an identification one by one: models beside Dahl's, cleaning, checks, filters,
noise, the design of a motion and the worth of a plan, each against numpy on the rows, a closed
form, or a log made by hand.
"""

from __future__ import annotations

import configparser
from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
from dahl import Error, plots
from dahl.identify import (
    angle_noise,
    carried,
    choices,
    clean,
    compare,
    cycles,
    design,
    draw,
    drift,
    explore,
    fit,
    folder_runs,
    grid,
    lowpass,
    model_table,
    output,
    path,
    pipeline,
    plan_quality,
    readers,
    recording,
    sweep,
    text_tables,
    units,
)
from dahl.identify.choices import Choice, Trial
from dahl.identify.compare import Key
from dahl.identify.explore import Explored
from dahl.identify.fit import Interval
from dahl.identify.log import Log, resolution_of
from dahl.identify.result import Result
from dahl.identify.terms import TIMED, place_of, torque_of
from identify_tools import (
    COUNT,
    FC,
    SIGMA0,
    dahl_torque,
    noise_of,
    sine,
    springs,
    synthetic,
    write_csv,
)
from scipy.ndimage import median_filter
from scipy.optimize import lsq_linear

pytestmark = pytest.mark.usefixtures("library")

A = SIGMA0 / FC
RNG = np.random.default_rng(21)
START = RNG.bit_generator.state


@pytest.fixture(autouse=True)
def _same_numbers_in_any_order() -> None:
    """Each test draws the same random numbers, whichever tests ran before it."""
    RNG.bit_generator.state = START


def log_of(torque: np.ndarray, theta: np.ndarray, part: float = 0.02, **more) -> Log:
    noisy = torque[: len(theta)] + part * FC * noise_of(3, len(theta))
    return Log("log", theta, noisy, np.arange(len(theta)) * 1e-3, **more)


# --- other models ---------------------------------------------------------------------------------

THETA = sine(2, rows=1500, cycles=8)
MIXED = dahl_torque(THETA, 60, 0.2) + springs(THETA, (90, 0.3)) + 0.1


@pytest.fixture(scope="module")
def book(library) -> compare.Dictionary:
    cut = cycles.Cut([log_of(MIXED, THETA)], A, 0.003, 10)
    return compare.Dictionary(cut, A, ("offset",), 0.0)


def drawn_by(key: Key) -> np.ndarray:
    one = dahl_torque(THETA, key.a, 1.0) if key.kind == "dahl" else springs(THETA, (key.a, 1.0))
    return one


def solved(book, keys, span=slice(None), without=None) -> tuple[np.ndarray, float]:
    """Elements that do not push, an offset of any sign: coefficients, and what they leave on the
    rows of `span` when those of `without` are not fitted.
    """
    x = np.column_stack((*map(drawn_by, keys), np.ones(1500))) * book.cut.root[:, None]
    y = book.cut.torque * book.cut.root
    counted = np.concatenate([np.arange(one.start, one.stop) for one in book.cut.spans])
    used = counted if without is None else np.setdiff1d(counted, np.arange(1500)[without])
    ends = ([0] * len(keys) + [-np.inf], np.inf)
    best = lsq_linear(x[used], y[used], bounds=ends, tol=1e-12).x
    here = np.intersect1d(counted, np.arange(1500)[span])
    return best, float(np.sum((y[here] - x[here] @ best) ** 2))


def test_elements_with_what_each_cycle_says_of_them(book):
    keys = [Key("dahl", 300.0), Key("slip", 300.0)]
    grams = book.grams([book.column(key) for key in keys])
    found = compare._candidate(book, "mixed", keys, grams)
    best, _ = solved(book, keys)
    assert found.name == found.trial.choice.model == "mixed K=2" and found.size == 5
    assert [part["kind"] for part in found.parts] == ["dahl", "slip"]
    assert [part["Fc"] for part in found.parts] == pytest.approx(best[:2], rel=1e-3)
    assert [part["sigma0"] for part in found.parts] == pytest.approx(300 * best[:2], rel=1e-3)
    assert found.trial.value["Fc"] == pytest.approx(best[:2].sum(), rel=1e-4)
    assert found.trial.value["sigma0"] == pytest.approx(300 * best[:2].sum(), rel=1e-4)
    assert found.trial.terms == pytest.approx({"offset": best[2]}, rel=1e-3)
    assert found.trial.a == pytest.approx(300)
    for k, span in enumerate(book.cut.spans):
        rest, cost = solved(book, keys, span, span)
        assert found.trial.cost[k] == pytest.approx(cost, rel=2e-3)
        assert found.trial.without["Fc"][k] == pytest.approx(rest[:2].sum(), rel=1e-3)
        assert found.trial.without["sigma0"][k] == pytest.approx(300 * rest[:2].sum(), rel=1e-3)
    unused = [Key("dahl", 300.0), Key("slip", 300.0), Key("slip", 40.0)]
    turned = compare._candidate(
        book, "mixed", unused[::-1], book.grams([book.column(key) for key in unused[::-1]])
    )
    best, _ = solved(book, unused[::-1])
    assert len(turned.parts) == np.count_nonzero(best[:3] > 1e-6)
    assert turned.size == 7


def test_elements_are_added_where_they_lower_the_cost_most(book):
    found = compare.side_by_side(book, ["dahl", "slip"], "mixed", 3)
    keys = [Key(kind, A * node) for kind in ("dahl", "slip") for node in compare.NODES]
    chosen: list[Key] = []
    for one in found[:2]:
        costs = {key: solved(book, [*chosen, key])[1] for key in keys if key not in chosen}
        chosen.append(min(costs, key=costs.__getitem__))
        assert one.trial.value["sigma0"] == pytest.approx(
            solved(book, chosen)[0][:-1] @ [key.a for key in chosen], rel=2e-3
        )
    assert [one.name for one in found] == [f"mixed K={k + 1}" for k in range(len(found))]
    for most in (1, 2):
        assert len(compare.side_by_side(book, ["dahl", "slip"], "mixed", most)) == most
    assert compare.NODES.min() == pytest.approx(0.262144)
    assert compare.NODES.max() == pytest.approx(1.25**8)


@pytest.mark.parametrize("nodes", [(-4, 3), (-1, 7)])
def test_a_promising_pair_is_made_finer(nodes):
    """Two springs that slip, between the nodes: each a is found within the last step."""
    true = tuple(A * 1.25**node * 1.09 for node in nodes)
    torque = springs(THETA, (true[0] * 0.2, 0.2), (true[1] * 0.3, 0.3))
    cut = cycles.Cut([log_of(torque, THETA, 0.001)], A, 0.003, 10)
    book = compare.Dictionary(cut, A, (), 0.0)
    coarse, fine = (compare.pair(book, "slip", "slip", least) for least in (0.0, np.inf))
    assert fine.trial.cost.sum() < 0.1 * coarse.trial.cost.sum()
    found = sorted(fine.parts, key=lambda part: part["sigma0"])
    assert [part["Fc"] for part in found] == pytest.approx([0.2, 0.3], rel=0.02)
    a = [part["sigma0"] / part["Fc"] for part in found]
    assert a == pytest.approx(true, rel=0.02)
    nodes = [part["sigma0"] / part["Fc"] / A for part in coarse.parts]
    assert all(np.abs(np.log(node / compare.NODES)).min() < 1e-9 for node in nodes)


def test_the_sign_of_the_motion_alone(book):
    found = compare.coulomb(book)
    sign = np.sign(np.diff(THETA, prepend=THETA[0]))
    x = np.column_stack((sign, np.ones(1500))) * book.cut.root[:, None]
    best = np.linalg.lstsq(x, book.cut.torque * book.cut.root, rcond=None)[0]
    assert (found.name, found.size) == ("Coulomb", 2)
    assert found.trial.value["Fc"] == pytest.approx(best[0], rel=1e-2)


@pytest.mark.parametrize("guess", [0.7, 1.3])
def test_an_element_of_another_shape_at_its_best(guess):
    """A friction that falls to three quarters with the speed: both parts and the slope."""
    speed = np.abs(np.gradient(THETA, 1e-3))
    fades = np.exp(-((speed / 0.5) ** 2))
    true = dahl_torque(THETA, A, 1.0)
    log = log_of(FC * (0.75 + 0.25 * fades) * true, THETA, 0.002)
    cut = cycles.Cut([log], A, 0.003, 10)
    book = compare.Dictionary(cut, guess * A, ("offset",), 0.0)
    found = compare.shaped(book, path.dahl, "fading", [fades])
    assert found.name == found.trial.choice.model == "fading" and not found.product
    assert found.size == 5
    assert found.trial.value["Fc"] == pytest.approx(0.75 * FC, rel=5e-3)
    assert found.trial.value["sigma0"] / found.trial.value["Fc"] == pytest.approx(A, rel=0.03)
    assert found.trial.without["Fc"] == pytest.approx(0.75 * FC, rel=2e-2)
    assert found.trial.without["sigma0"] == pytest.approx(found.trial.value["sigma0"], rel=2e-2)
    assert abs(found.trial.terms["offset"]) < 1e-3
    assert found.parts == [{"kind": "fading", **found.trial.value}]
    turned = replace(log, torque=-log.torque)
    other = compare.Dictionary(cycles.Cut([turned], A, 0.003, 10), A, (), 0.0)
    assert compare.shaped(other, path.dahl, "fading") is None


@pytest.mark.parametrize(
    "made",
    [
        lambda book: compare.shaped(book, path.dahl, "bent"),
        lambda book: compare.one(book, "dahl", "Dahl"),
    ],
)
def test_another_model_has_the_delay_that_it_was_fitted_with(made):
    """The torque comes 3 rows late: with that delay the fit is exact, and the choice says so."""
    late = np.r_[np.zeros(3), dahl_torque(THETA)[:-3]]
    cut = cycles.Cut([log_of(late, THETA, 0.002)], A, 0.003, 10)
    book = compare.Dictionary(cut, A, ("offset",), 3.0)
    found = made(book)
    assert found.trial.choice.delay == 3 and found.trial.choice.terms == ("offset",)
    assert found.trial.value["sigma0"] == pytest.approx(SIGMA0, rel=0.01)


def test_all_models_with_and_without_what_is_beside_them(book):
    """Of a late torque: each model with the delay where that is better, the plain ones apart."""
    late = np.roll(FC * drawn_by(Key("dahl", A)), 3) + 0.1
    cut = cycles.Cut([log_of(late, THETA)], A, 0.003, 10)
    base = choices.fitted(cut, A, Choice(("offset", "viscous"), 3.0))
    table = model_table.compared(cut, base, A)
    assert table.chosen == "Dahl" and table.forced == ""
    assert table.of("Dahl").trial.choice.delay == 3.0
    assert {one.trial.choice.delay for one in table.plain} == {0.0}
    assert {one.trial.choice.terms for one in table.plain} == {("offset",)}
    assert [one.size for one in table.candidates] == sorted(one.size for one in table.candidates)
    assert table.spread == pytest.approx(cut.spread)
    r2 = 1 - table.of("Dahl").trial.cost.sum() / cut.spread
    assert table.r2(table.of("Dahl")) == pytest.approx(r2) and r2 > 0.99
    assert table.of("nobody's") is None
    forced = model_table.compared(cut, base, A, "slip K=2")
    assert (forced.chosen, forced.forced) == ("slip K=2", "slip K=2")
    plainly = forced.plainly()
    assert plainly.chosen == "slip K=2" and plainly.candidates[0].trial.choice.delay == 0.0
    alone = replace(base, choice=Choice(("offset",)))
    assert model_table.compared(cut, alone, A).of("Dahl").trial.choice.delay == 0.0


# --- what a header and a scene carry --------------------------------------------------------------


def test_the_torque_of_each_kind_of_friction():
    moves = np.diff(THETA, prepend=THETA[0])
    asymmetric, F = [], 0.0  # noqa: N806
    for move in moves:
        limit = 0.6 if move > 0 else 0.4
        side = np.sign(move)
        F = side * limit - (side * limit - F) * np.exp(-SIGMA0 * abs(move) / limit)  # noqa: N806
        asymmetric.append(F)
    cases = [
        (("dahl", (100.0,), (0.5,), ()), dahl_torque(THETA), 200),
        (("slip", (100.0, 30.0), (0.5, 0.1), ()), springs(THETA, (100, 0.5), (30, 0.1)), 130 / 0.6),
        (
            ("parallel", (60.0, 90.0), (0.2, 0.3), ("dahl", "slip")),
            dahl_torque(THETA, 60, 0.2) + springs(THETA, (90, 0.3)),
            300,
        ),
        (("asymmetric", (100.0,), (0.6, 0.4), ()), np.array(asymmetric), 200),
    ]
    for words, torque, a in cases:
        one = carried.Friction(*words, {})
        assert one.torque(moves) == pytest.approx(torque, abs=1e-5), words
        assert one.a == pytest.approx(a)


def test_the_plans_of_each_kind_of_friction():
    plans = {
        words[0]: carried.Friction(*words, {}).plans(COUNT)
        for words in (
            ("dahl", (100.0,), (0.5,), ()),
            ("slip", (100.0, 30.0), (0.5, 0.1), ()),
            ("parallel", (60.0, 90.0, 20.0), (0.2, 0.3, 0.1), ("dahl", "slip", "dahl")),
            ("asymmetric", (100.0,), (0.6, 0.4), ()),
        )
    }
    names = {kind: {end: type(one).__name__ for end, one in p.items()} for kind, p in plans.items()}
    assert names == {
        "dahl": {"": "Plan"},
        "slip": {"": "Slip"},
        "parallel": {"_1": "Plan", "_2": "Plan", "_slip": "Slip"},
        "asymmetric": {"": "Asymmetric"},
    }
    two = plans["parallel"]["_2"]
    assert (two.sigma0, two.Fc) == pytest.approx((20, 0.1), rel=1e-6)


# --- cleaning -------------------------------------------------------------------------------------


def test_weights_are_hubers():
    residual = RNG.normal(size=300)
    residual[::25] += 30.0
    odd = np.abs(residual - median_filter(residual, 9, mode="nearest"))
    limit = 4 * 1.4826 * np.median(odd[odd > 0])
    wanted = np.where(odd > limit, limit / np.maximum(odd, 1e-9), 1.0)
    assert clean.huber(residual, None) == pytest.approx(wanted)
    before = RNG.uniform(size=300)
    assert clean.huber(residual, before) == pytest.approx(wanted * before)
    seen = np.arange(300) % 4 == 0  # the others are no neighbours
    some = clean.huber(residual, 0.5 * seen)
    assert some[seen] == pytest.approx(0.5 * clean.huber(residual[seen], None))
    assert not some[~seen].any()
    assert np.all(clean.huber(np.zeros(50), None) == 1)
    steps = np.where(np.arange(90) < 45, 0.0, 1.0)  # a step has neighbours on either side
    assert np.all(clean.huber(steps, None) == 1)
    lone = np.zeros(90)
    lone[40] = 1.0
    assert clean.huber(lone, None)[40] == pytest.approx(1, abs=1e-9)


def test_an_angle_that_turns_back_at_once():
    theta = np.repeat(np.array([0.0, 10, 0, 10, 0]), 1)
    theta = np.interp(np.arange(400) / 100, np.arange(5), theta)
    log = Log("", theta, theta, resolution=0.1)
    assert clean.flickers(log) == 0
    shaky = theta.copy()
    shaky[[50, 150, 250, 251, 350]] += [3, 3, 3, -3, 3]
    count = clean.flickers(replace(log, theta=shaky))
    moves = np.diff(shaky)
    assert count == np.count_nonzero(moves[1:] * moves[:-1] < 0) - 3 == 8
    assert clean.median(log, 1) is log.theta
    five = clean.median(replace(log, theta=shaky), 5)
    assert five == pytest.approx(median_filter(shaky, 5, mode="nearest"))


@pytest.mark.parametrize("counts", [2**10, 2**13])
def test_the_angle_between_the_counts(counts):
    """Closer to the truth than the reading, and within half a count of it everywhere."""
    count, true = 2 * np.pi / counts, sine(3, rows=4000, cycles=8)
    log = Log("", np.round(true / count) * count, np.zeros(4000), resolution=count)
    inner = clean.between_counts(log)
    assert np.abs(inner - log.theta).max() <= count / 2 * (1 + 1e-9)
    assert np.std(inner - true) < 0.3 * np.std(log.theta - true)
    turning = np.argsort(np.abs(np.gradient(true)))[:400]
    assert np.std((inner - true)[turning]) < 0.6 * np.std((log.theta - true)[turning])
    phase = np.arange(4000) / 500 % 1
    true = 0.05 * np.sin(np.pi / 2 * np.interp(phase, [0, 0.3, 0.5, 0.8, 1], [-1, 1, 1, -1, -1]))
    log = replace(log, theta=np.round(true / count) * count)
    inner, still = clean.between_counts(log), np.diff(true) == 0
    assert np.abs(np.diff(inner))[still].sum() < count  # of 16 rests together
    assert np.std(inner - true) < 0.7 * np.std(log.theta - true)
    bare = replace(log, resolution=0.0)
    assert clean.between_counts(bare) is bare.theta


@pytest.mark.parametrize("speeds", [(2e-5, 4e-4), (4e-4, 2e-5)])
def test_a_shaft_that_creeps_after_it_was_fast_does_not_rest(speeds):
    """A rest takes much longer than the counts on both sides of it."""
    rows = [600 if speed < 1e-4 else 200 for speed in speeds]
    true = np.cumsum(np.tile(np.repeat([*speeds, *(-v for v in speeds)], rows * 2), 5))
    count = 2 * np.pi / 1024
    assert not clean.rests(Log("", np.round(true / count) * count, true, resolution=count))
    few = Log("", np.repeat([0.0, 1, 2, 1], 20), np.zeros(80), resolution=1.0)
    assert clean.between_counts(few) is few.theta


@pytest.mark.parametrize("rows", [120, 150])
def test_between_counts_small_strokes_keep_their_length(rows):
    """Of so many rows, beside long ones: a wide cubic cuts five percent off them."""
    now, count = np.arange(8000), 2 * np.pi / 2**12
    true = 0.05 * np.sin(now / 500) + 0.0075 * np.sin(2 * np.pi * now / rows)
    log = Log("", np.round(true / count) * count, np.zeros(8000), resolution=count)
    travel = [np.abs(np.diff(theta)).sum() for theta in (clean.between_counts(log), true)]
    assert travel[0] == pytest.approx(travel[1], rel=0.015)


def played(
    slack: float, centre: float, theta: np.ndarray = THETA
) -> tuple[Log, np.ndarray, np.ndarray]:
    """A log whose torque rests at `centre` of Fc over `slack` rad after each reversal."""
    ratio, w, gap = [], 0.0, 0.0
    for move in np.diff(theta, prepend=theta[0]):
        side = np.sign(move)
        aim = w + side * (1 - side * w) * -np.expm1(-A * abs(move))
        crosses = (w - centre) * (aim - centre) < 0
        if (crosses or gap > 0) and gap < slack:
            w, gap = centre, gap + abs(move)
        else:
            w, gap = aim, 0.0
        ratio.append(w)
    ratio = np.array(ratio)
    return Log("", theta, FC * ratio, resolution=1e-5), ratio, path.reversals(theta, 0.01)


@pytest.mark.parametrize("centre", [-0.2, 0.0, 0.3])
def test_the_travel_and_the_place_of_backlash(centre):
    log, ratio, turns = played(0.01, centre)
    slack, place, moves = clean.backlash(log, ratio, turns)
    assert slack == pytest.approx(0.01, rel=0.15)
    assert place == pytest.approx(centre, abs=0.11)
    assert np.sign(moves) == pytest.approx(np.sign(log.moves))
    lost = np.abs(log.moves).sum() - np.abs(moves).sum()
    assert lost == pytest.approx(slack * (len(turns) + 1), rel=0.3)


def test_backlash_of_short_strokes():
    log, ratio, turns = played(0.01, 0.0, sine(2, rows=1500, cycles=11, amplitude=0.02))
    assert np.diff(turns).max() < 75
    assert clean.backlash(log, ratio, turns)[0] == pytest.approx(0.01, rel=0.3)


def test_no_backlash_is_made_up():
    log, ratio, turns = played(0.0, 0.0)
    slack, place, moves = clean.backlash(log, ratio, turns)
    assert (slack, place) == (0, 0) and moves == pytest.approx(log.moves)
    log, ratio, turns = played(0.01, 0.0)
    ends = [0, *turns.tolist(), log.rows - 1]
    parts = [(i, j) for i, j in zip(ends, ends[1:], strict=False) if j - i > 8]
    share, extra, crossed = clean._flatness(log, ratio, parts, 0.0)
    assert crossed >= len(parts) - 1  # forward and backward
    assert share > 3 and extra == pytest.approx(0.01, rel=0.15)
    coarse = replace(log, resolution=0.004)  # three counts are more than the flat zone
    assert clean.backlash(coarse, ratio, turns)[0] == 0


# --- the recording --------------------------------------------------------------------------------


def test_steps_of_an_encoder():
    walk = np.cumsum(RNG.integers(-3, 4, size=400))
    for step in (1e-6, 0.3, 7.0):
        assert resolution_of(step * walk) == pytest.approx(step)
        printed = np.round(step * walk, 8 if step < 1e-5 else 3)
        assert resolution_of(printed) == pytest.approx(step, rel=0.01)
        off = step * (walk + 0.03 * np.sign(np.sin(7 * walk)))  # printed with few digits
        assert resolution_of(off) == pytest.approx(step, rel=0.01)
    assert resolution_of(RNG.normal(size=400)) == 0
    for odd, found in ((4, True), (6, False)):  # of a hundred steps, that are none
        gaps = np.where(np.arange(100) < odd, 1.5, 1.0)
        assert (resolution_of(np.cumsum(gaps)) > 0.9) is found
    assert resolution_of(np.zeros(10)) == 0
    assert resolution_of(np.array([0.0, 1, 2])) == 0  # two gaps are no grid
    assert resolution_of(np.array([0.0, 1, 2, 3])) == 1


def test_the_head_of_a_log_and_its_moves():
    log = Log("", np.array([1.0, 3, 6, 10]), np.arange(4.0), np.arange(4.0), resolution=1.0)
    assert log.moves.tolist() == [0, 2, 3, 4]
    assert log.moves_of(slice(0, 4)).tolist() == [0, 2, 3, 4]
    assert log.moves_of(slice(2, 4)).tolist() == [3, 4]
    free = replace(log, free_moves=np.array([0.0, 1, 1, 1]), weight=np.ones(4))
    assert free.moves_of(slice(1, 3)).tolist() == [1, 1] and free.moves.tolist() == [0, 2, 3, 4]
    assert log.head(4) is log and log.head(5) is log
    short = free.head(3)
    columns = (short.theta, short.torque, short.time, short.weight, short.free_moves)
    assert [len(column) for column in columns] == [3] * 5
    assert (log.unit, log.slope_unit, log.angle_unit) == ("N m", "N m/rad", "rad")
    linear = replace(log, linear=True)
    assert (linear.unit, linear.slope_unit, linear.angle_unit) == ("N", "N/m", "m")


@pytest.mark.parametrize("rows", [2, 3, 10])
def test_a_clock_coarser_than_the_rows(rows):
    """Of so many rows at one time each has a speed, and a viscous part its size."""
    theta = sine(1, rows=2000, cycles=8)
    log = log_of(dahl_torque(theta) + 0.05 * np.gradient(theta, 1e-3), theta, 0.01)
    true, log.time = log.time, np.arange(2000) // rows * rows * 1e-3
    (even,) = recording.mended(log)
    assert even.time == pytest.approx(true, abs=1e-9)
    count = 2000 - -(-2000 // rows)
    assert even.notes == [f"{count} of 2000 rows have the time of the row before: spread evenly"]
    options = pipeline.Options(terms=("viscous",), delay=False)
    found = pipeline.identify([log], options)
    assert found.estimate.terms["viscous"] == pytest.approx(0.05, rel=0.05)


def test_a_clock_that_goes_and_one_that_stands():
    log = synthetic(1, rows=300, cycles=4)
    assert recording.evened(log) is log
    bare = replace(log, time=None)
    assert recording.evened(bare) is bare
    stands = recording.evened(replace(log, time=np.full(300, 5.0)))
    assert stands.time is None and stands.notes == ["the clock stands still: not used"]
    ragged = replace(log.head(6), time=np.array([0.0, 0, 1, 4, 4, 4]), notes=[])
    assert recording.evened(ragged).time.tolist() == [0, 0.5, 1, 4, 7, 10]


@pytest.mark.parametrize(("rest", "left_out"), [(0.88, True), (0.92, False)])
def test_a_log_mostly_at_rest_keeps_its_rows(rest, left_out):
    still = np.arange(3000) % 100 < 100 * rest
    theta = np.cumsum(np.where(still, 0.0, 1e-3))
    torque = np.cumsum(np.where(still, 0.0, RNG.normal(size=3000)))
    log = Log("", theta, torque)
    assert (recording.without_repeats(log) is not log) is left_out


@pytest.mark.parametrize(("chance", "left_out"), [(0.08, True), (0.12, False)])
def test_torques_that_stay_by_chance(chance, left_out):
    """A third of the rows repeat; of those that move, a part of that third keeps its torque."""
    again = np.arange(3000) % 3 == 2
    moves = np.where(again, 0.0, 1e-3)
    kept = np.zeros(3000, dtype=bool)
    moving = np.flatnonzero(~again)
    kept[moving[: round(chance / 3 * len(moving))]] = True
    torque = np.cumsum(np.where(again | kept, 0.0, RNG.normal(size=3000)))
    log = Log("", np.cumsum(moves), torque)
    found = recording.without_repeats(log)
    assert (found is not log) is left_out
    if left_out:
        assert found.notes == ["1000 of 3000 rows repeat the row before: left out"]
        assert found.rows == 2000


@pytest.mark.parametrize(
    ("bits", "off", "said"),
    [(7, 0.0, False), (8, 0.0, True), (14, 4e-4, True), (14, 6e-4, False), (26, 0, True)],
)
def test_a_power_of_two_in_the_other_unit(bits, off, said):
    """An encoder of so many bits in deg, taken for rad."""
    step = np.degrees(2 * np.pi / 2**bits) * (1 + off)
    log = Log("log", THETA, THETA, resolution=step)
    if said:
        with pytest.raises(Error, match="but .* in deg: is the angle in deg"):
            grid.refuse(log)
    else:
        grid.refuse(log)
    grid.refuse(replace(log, linear=True))
    grid.refuse(replace(log, resolution=0.0))


# --- cycle by cycle -------------------------------------------------------------------------------


def test_the_numbers_of_one_cycle_are_least_squares():
    theta = sine(1, rows=2000, cycles=8)
    log = log_of(dahl_torque(theta) + 0.03, theta)
    log.weight = RNG.uniform(0.1, 1, size=2000)
    estimate = SimpleNamespace(a=0.97 * A, Fc=1.02 * FC, sigma0=0.97 * A * 1.02 * FC)
    drawn = 1.02 * dahl_torque(theta, 0.97 * SIGMA0, FC)
    found = drift.cycles_of([log, log], [drawn, drawn], estimate, 0.02)
    turns = path.reversals(theta, 0.02)[::2]
    assert found.rows.tolist() == [*turns[:-1], *(2000 + turns[:-1])]
    w, apart = dahl_torque(theta, 0.97 * A, 1.0), 1e-3
    above, below = (dahl_torque(theta, 0.97 * A * np.exp(x), 1.0) for x in (apart, -apart))
    x = np.column_stack((w, (above - below) / 2 / apart, np.ones(2000)))
    y = log.torque - drawn + 1.02 * FC * w
    for k, (i, j) in enumerate(zip(turns, turns[1:], strict=False)):
        root = np.sqrt(log.weight[i:j])
        F, G, c = np.linalg.lstsq(x[i:j] * root[:, None], y[i:j] * root, rcond=None)[0]  # noqa: N806
        values = {"Fc": F, "sigma0": 0.97 * A * (F + G), "offset": c}
        assert {name: found.value[name][k] for name in values} == pytest.approx(values, rel=1e-3)
        spread = np.linalg.inv((x[i:j] * root[:, None]).T @ (x[i:j] * root[:, None]))
        slope = 0.97 * A * np.array([1, 1, 0])
        errors = {"Fc": spread[0, 0], "sigma0": slope @ spread @ slope, "offset": spread[2, 2]}
        for name, variance in errors.items():
            assert found.error[name][k] == pytest.approx(np.sqrt(variance), rel=1e-3)
    assert len(found) == len(found.rows)
    for rows, counted in ((11, 0), (12, 9)):  # of a cycle
        quick = log_of(drawn, 0.05 * np.sin(2 * np.pi * np.arange(10 * rows) / rows + 1))
        assert len(drift.cycles_of([quick], [drawn[: 10 * rows]], estimate, 0.02)) == counted


# --- filters and noise ----------------------------------------------------------------------------


def test_the_vertex_of_a_cost():
    nodes = A * np.geomspace(0.7, 2.8, 15)
    for place in (0.75, 1.0, 1.9, 2.7):
        assert lowpass._vertex(nodes, (np.log(nodes / A / place)) ** 2) == pytest.approx(place * A)
    assert lowpass._vertex(nodes, nodes) == pytest.approx(nodes[0])
    assert lowpass._vertex(nodes, -nodes) == pytest.approx(nodes[-1])


@pytest.mark.parametrize("counts", [0.0, 1.0, 2.0])
@pytest.mark.parametrize("spikes", [False, True])
def test_the_noise_of_an_angle(counts, spikes):
    """Beside its rounding; spikes are no noise."""
    count = 1e-4
    theta = 0.05 * np.sin(2 * np.pi * 7.3 * np.arange(20_000) / 20_000)
    theta += counts * count * RNG.normal(size=20_000)
    read = np.round(theta / count) * count
    if spikes:
        read[RNG.choice(20_000, 60, replace=False)] += 50 * count
    found = angle_noise.noise_of(read, count)
    assert found == pytest.approx(counts * count, rel=0.1, abs=0.25 * count)
    if counts:
        bare = angle_noise.noise_of(read, 0.0)
        assert bare**2 == pytest.approx(found**2 + count**2 / 12, rel=1e-3)
    slow = np.cumsum(RNG.normal(size=5000))  # a rough motion
    assert angle_noise.noise_of(np.cumsum(np.cumsum(slow)), 0.0) == 0


def test_a_path_is_smoothed_by_parts_of_its_strokes():
    true = sine(1, rows=4000, cycles=6)
    rough = true + 1e-3 * RNG.normal(size=4000)
    smooth = angle_noise.smoothed(rough)
    assert np.std(smooth - true) < 0.4 * np.std(rough - true)
    assert angle_noise.smoothed(true) == pytest.approx(true, abs=2e-4)


# --- the design of a motion -----------------------------------------------------------------------


def test_the_interval_of_a_motion_is_the_cramer_rao_bound():
    wanted = design.Wanted(SIGMA0, FC, COUNT, noise=0.04, within=0.02, rate=500.0, speed=0.2)
    motion = design.propose(wanted)
    rows = motion.rows_per_cycle
    theta = motion.amplitude * np.sin(2 * np.pi * np.arange(3 * rows) / rows)
    moves = np.diff(theta, prepend=0)

    def change(sigma0: float, Fc: float) -> np.ndarray:  # noqa: N803
        return (
            dahl_torque(theta, SIGMA0 * (1 + sigma0), FC * (1 + Fc))
            - dahl_torque(theta, SIGMA0 * (1 - sigma0), FC * (1 - Fc))
        ) / 2e-3

    x = np.column_stack((change(1e-3, 0), change(0, 1e-3), np.ones(3 * rows), theta, moves))
    slope = SIGMA0 * (1 - np.sign(moves) * dahl_torque(theta) / FC)
    variance = (0.04 * FC) ** 2 + (slope * COUNT) ** 2 / 12
    x = (x / np.sqrt(variance)[:, None])[2 * rows :]
    one = 1.96 * np.sqrt(np.diag(np.linalg.inv(x.T @ x)))[:2]
    assert motion.within == pytest.approx(
        dict(zip(("sigma0", "Fc"), one / np.sqrt(motion.cycles), strict=True)), rel=0.01
    )
    assert motion.cycles == max(np.ceil(1.5 * (one[0] / 0.02) ** 2), 5)
    assert rows == np.ceil(2 * np.pi * motion.amplitude / 0.2 * 500)
    assert motion.seconds == pytest.approx((len(motion.theta()) - 1) / 500)
    assert motion.reversals == 2 * motion.cycles
    path_of = motion.theta()
    assert (path_of[0], path_of[-1]) == pytest.approx((0, 0), abs=1e-12)
    assert path_of.max() == pytest.approx(motion.amplitude, rel=1e-2)
    times = [design._sine(wanted, k / A).seconds for k in np.geomspace(3, 30, 12)]
    assert motion.seconds == min(times)


def test_what_limits_a_motion():
    wanted = design.Wanted(SIGMA0, FC, COUNT)
    easy = design.propose(replace(wanted, within=0.9))
    assert easy.cycles == 5
    fast = 1000 / (8 * A)  # eight rows in a presliding length
    assert easy.rows_per_cycle == np.ceil(2 * np.pi * easy.amplitude / (1000 * fast / 1000) * 1000)
    for length, refused in ((4.1, False), (3.9, True)):
        coarse = replace(wanted, theta_per_count=1 / A / length)
        if refused:
            with pytest.raises(Error, match="presliding is 3.9 counts .* at least 4 are needed"):
                design.propose(coarse)
        else:
            design.propose(coarse)
    with pytest.raises(Error, match=r"a cycle would take 9.42e\+06 rows; at most 1000000"):
        design.propose(replace(wanted, speed=1e-5))
    slow = design.propose(replace(wanted, speed=1.05e-4))  # which longer strokes are too long for
    assert slow.amplitude * A == pytest.approx(3) and 8e5 < slow.rows_per_cycle < 1e6


# --- a plan and its worth -------------------------------------------------------------------------


def test_the_torque_of_a_plan_has_the_best_beginning():
    friction = carried.Friction("dahl", (SIGMA0,), (FC,), (), {})
    moves = np.diff(THETA, prepend=THETA[0])
    measured = dahl_torque(THETA) + 0.3 * np.exp(-A * np.cumsum(np.abs(moves)))
    measured += 0.01 * RNG.normal(size=1500)
    start = np.exp(-A * np.cumsum(np.abs(moves)))
    first = np.linalg.lstsq(start[:, None], measured - dahl_torque(THETA), rcond=None)[0][0]
    wanted = dahl_torque(THETA) + first * start
    assert plan_quality.drawn(friction, moves, measured) == pytest.approx(wanted, abs=1e-5)


@pytest.mark.parametrize("count", [0.0, 0.004])
def test_r2_of_a_plan_on_the_raw_motion(count):
    """By counts, with the sign, the offset and the spring that were found."""
    terms = {"offset": 0.1, "spring": 2.0, "viscous": 9.0}
    log = log_of(dahl_torque(THETA) + 0.1 + 2.0 * (THETA - 0.01), THETA, 0.1)
    raw = replace(log, torque=-log.torque)
    other = replace(raw, theta=raw.theta[:700], torque=raw.torque[:700])
    result = SimpleNamespace(raw=[raw, other], sign=-1.0, logs=[replace(log, zero=0.01)])
    friction = carried.Friction("dahl", (SIGMA0,), (FC,), (), terms)
    lost = spread = 0.0
    for one in result.raw:
        theta = one.theta - one.theta[0]
        theta = np.round(theta / count) * count if count else theta
        measured = -one.torque - 0.1 - 2.0 * (one.theta - 0.01)
        start = np.exp(-A * np.cumsum(np.abs(np.diff(theta, prepend=theta[0]))))
        left = measured - dahl_torque(theta)
        left -= start * (start @ left) / (start @ start)
        lost += left @ left
        spread += np.var(measured) * len(theta)
    found = plan_quality.r2_on_raw(result, count, friction)
    assert found == pytest.approx(1 - lost / spread, abs=1e-5)


# --- the steps of the pipeline --------------------------------------------------------------------


def test_where_a_slope_is_sought():
    log = synthetic(1, rows=900, cycles=4)
    other = replace(synthetic(2, rows=900, cycles=4), resolution=2 * COUNT)
    study = pipeline.Study([log, other])
    assert study.low == pytest.approx(2 / max(np.ptp(log.theta), np.ptp(other.theta)))
    assert study.high == pytest.approx(3 / (2 * COUNT))
    assert {"viscous", "inertia"} <= set(study.candidates) and study.blocks == 12
    assert {one.zero for one in study.logs} == {log.theta[0]}
    bare = [replace(log, resolution=0.0, time=None)]
    study = pipeline.Study(bare)
    moves = np.abs(np.diff(log.theta))
    assert study.high == pytest.approx(9 / np.median(moves[moves > 0]))
    assert "spring" in study.candidates and TIMED.isdisjoint(study.candidates)
    assert study.blocks == 24
    assert pipeline.Study([log] * 8).blocks == 4
    coarse = pipeline.Study([replace(log, resolution=0.05)])
    assert coarse.high == pytest.approx(100 * coarse.low)


def test_a_prediction_has_the_best_beginning():
    log = log_of(dahl_torque(THETA) + 0.4, THETA)
    log.weight = RNG.uniform(size=1500)
    study = pipeline.Study([log])
    estimate = SimpleNamespace(a=A, Fc=FC, terms={"offset": 0.4, "spring": 1.0})
    start = np.exp(-A * np.cumsum(np.abs(np.diff(THETA, prepend=THETA[0]))))
    drawn = dahl_torque(THETA) + 0.4 + (THETA - THETA[0])
    root = np.sqrt(log.weight)
    first = np.linalg.lstsq((start * root)[:, None], (log.torque - drawn) * root, rcond=None)[0][0]
    assert study.predicted(estimate, 0) == pytest.approx(drawn + first * start, abs=1e-5)


def test_the_torque_of_the_terms():
    log = log_of(0 * THETA, THETA, zero=0.02)
    speed = np.gradient(THETA, 1e-3)
    found = torque_of(log, {"offset": 0.5, "spring": 3.0, "viscous": 0.2})
    inner = slice(20, -20)
    wanted = 0.5 + 3.0 * (THETA - 0.02) + 0.2 * speed
    assert found[inner] == pytest.approx(wanted[inner], rel=1e-3, abs=2e-3)
    mass = torque_of(log, {"inertia": 1.0})[inner]
    assert np.corrcoef(mass, -THETA[inner])[0, 1] > 0.999 and mass.max() > 50
    assert torque_of(log, {}).tolist() == [0.0] * 1500


def test_weights_are_shifted_with_their_torques():
    log = log_of(dahl_torque(THETA), THETA)
    log.weight = RNG.uniform(size=1500)
    study = pipeline.Study([log])
    assert pipeline._undelayed(study, taken(Choice((), 2.5))) == 2.5
    assert study.logs[0].weight[:-3] == pytest.approx(np.minimum(log.weight[2:-1], log.weight[3:]))


@pytest.fixture(scope="module")
def result(library):
    theta = sine(5, rows=1500, cycles=7)
    log = log_of(dahl_torque(theta) + 0.1, theta, 0.05)
    return pipeline.identify([log], pipeline.Options(terms=("offset",)))


def test_r2_of_a_log_that_was_not_fitted(result):
    theta = sine(9, rows=1500, cycles=6)
    log = log_of(dahl_torque(theta) + 0.1, theta, 0.1)
    start = np.exp(-result.estimate.a * np.cumsum(np.abs(np.diff(theta, prepend=theta[0]))))
    drawn = dahl_torque(theta, result.estimate.sigma0, result.estimate.Fc)
    left = log.torque - drawn - result.estimate.terms["offset"]
    left -= start * (start @ left) / (start @ start)
    spread = np.sum((log.torque - log.torque.mean()) ** 2)
    assert pipeline.check(result, log) == pytest.approx(1 - left @ left / spread, abs=1e-4)
    (whole,) = logs_of("linear")  # a spring of 3 N/m, relaxed where the fitted log began
    rest = recording.taken(whole, slice(750, None), [])
    assert abs(rest.theta[0] - whole.theta[0]) > 0.03
    assert pipeline.check(result_of("linear"), rest) > 0.99


def test_the_models_that_a_result_is_compared_with(result):
    """The sign alone with terms of its own, and a spring that slips."""
    log, models = result.logs[0], result.models
    speed = np.gradient(log.theta, log.time)
    beside = {"spring": log.theta, "viscous": speed, "inertia": np.gradient(speed, log.time)}
    own = [beside[name] for name in models.terms["coulomb"] if name != "offset"]
    assert own
    sign = np.sign(log.moves)
    sign[0] = 0.0
    first = np.arange(1500) == 0
    x = np.column_stack((sign, np.ones(1500), first, *own))
    left = log.torque - x @ np.linalg.lstsq(x, log.torque, rcond=None)[0]
    spread = np.sum((log.torque - log.torque.mean()) ** 2)
    assert models.r2_coulomb == pytest.approx(1 - left @ left / spread, abs=0.01)
    assert models.r2_coulomb > models.r2["coulomb"] - 0.01
    fits = {}
    for a in result.estimate.a * np.geomspace(1 / 8, 4, 13):
        w = springs(log.theta, (a, 1.0))
        start = np.exp(-a * np.cumsum(np.abs(log.moves)))
        x = np.column_stack((w, start, np.ones(1500)))
        best = np.linalg.lstsq(x, log.torque, rcond=None)[0]
        fits[float(np.sum((log.torque - x @ best) ** 2))] = a * best[0]
    assert models.bilinear_sigma0 == pytest.approx(fits[min(fits)], rel=0.02)
    assert models.r2["dahl"] > models.r2["bilinear"] > models.r2["coulomb"] > models.r2["none"]
    for name, r2 in models.r2.items():
        assert models.rmse[name] == pytest.approx(np.sqrt((1 - r2) * spread / 1500), rel=1e-3)
    assert models.terms["dahl"] == ["offset"]
    left = log.torque - result.predicted[0]
    assert result.rmse == pytest.approx(np.sqrt(np.mean(left**2)), rel=2e-3)
    assert result.r2 == pytest.approx(1 - left @ left / spread, rel=1e-4)
    w = dahl_torque(log.theta, result.estimate.a, 1.0)
    steep = (1 - np.sign(log.moves) * w)[log.moves != 0] > 0.1
    assert result.informs == pytest.approx(steep.mean(), abs=2e-3)
    assert result.reversals == len(path.reversals(log.theta, 0.3 / A))


# --- what else may be chosen ----------------------------------------------------------------------


def test_sets_of_terms_that_draw_a_short_log_as_well():
    theta = sine(1, rows=600, cycles=2)
    log = log_of(dahl_torque(theta) + 0.2, theta, 0.05)
    found = fit.search(lambda a: sweep.sweep([log], 6, a), 20.0, 5000.0, ["offset"])
    sets = [(), ("offset",), ("offset", "spring")]
    estimate = fit.point(found, ["offset"])
    seen = explore.unscored(found, estimate, sets)
    assert [one.choice.terms for one in seen.trials] == sets
    assert [one.plausible for one in seen.trials] == [False, True, True]
    assert seen.taken is seen.trials[1] and seen.spread == pytest.approx(fit.spread_of(found))
    for one in seen.trials:
        own = fit.point(found, one.choice.terms)
        assert one.value == pytest.approx({"sigma0": own.sigma0, "Fc": own.Fc})
        assert one.plausible is (own.sse <= 1.03 * estimate.sse)
        assert one.cost.tolist() == [own.sse] and one.terms == own.terms
    counted = replace(estimate, a=0.5 * estimate.a)
    more = explore.with_backlash(seen, counted)
    last = more.trials[-1]
    assert last.choice == Choice(("offset",), backlash=True) and last.plausible
    assert last.value["sigma0"] == pytest.approx(0.5 * estimate.sigma0)
    assert len(seen.trials) == 3


# --- files and units ------------------------------------------------------------------------------


INCH = 0.0254  # m


def test_every_unit_of_torque_is_what_it_is():
    pound, g = 0.45359237, 9.80665
    sizes = {"u": 1e-6, "m": 1e-3, "c": 1e-2, "": 1, "k": 1e3, "M": 1e6}
    torques = {f"{prefix}Nm": size for prefix, size in sizes.items()}
    torques |= {f"{prefix}N": size for prefix, size in sizes.items() if prefix != "c"}
    torques |= {"kgf": g, "gf": g / 1000, "kgfcm": g / 100, "gfcm": g / 1e5}
    torques |= {"lb": pound * g, "kip": 1000 * pound * g, "lbin": pound * g * INCH}
    torques |= {"lbft": pound * g * INCH * 12, "ozin": pound * g * INCH / 16}
    assert units.TORQUES == pytest.approx(torques, rel=1e-8)


def test_every_unit_of_angle_and_time_is_what_it_is():
    deg = np.pi / 180
    turns = {"deg": deg, "mdeg": deg / 1e3, "arcmin": deg / 60, "arcsec": deg / 3600}
    turns |= {"rad": 1, "mrad": 1e-3, "urad": 1e-6, "turn": 2 * np.pi, "counts": 0}
    lengths = {"m": 1, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "in": INCH, "ft": 12 * INCH}
    for known, is_linear in ((turns, False), (lengths, True)):
        found = {name: size for name, (size, linear) in units.ANGLES.items() if linear is is_linear}
        assert found == pytest.approx(known)
    assert units.TIMES == {"s": 1, "sec": 1, "ms": 1e-3, "msec": 1e-3, "us": 1e-6, "ns": 1e-9}


@pytest.mark.parametrize(
    ("name", "known", "unit"),
    [
        ("angle [deg]", units.ANGLES, "deg"),
        ("angle_mrad", units.ANGLES, "mrad"),
        ("Angle (°)", units.ANGLES, "deg"),
        ("position / mm", units.ANGLES, "mm"),
        ("pos_in_mm", units.ANGLES, "mm"),
        ("encoder counts", units.ANGLES, "counts"),
        ("turn", units.ANGLES, "turn"),
        ("m", units.ANGLES, ""),
        ("angle", units.ANGLES, ""),
        ("[RAD]", units.ANGLES, "rad"),
        ("torque_Nm", units.TORQUES, "Nm"),
        ("torque [N m]", units.TORQUES, "Nm"),
        ("torque [N*m]", units.TORQUES, "Nm"),
        ("load [lb-ft]", units.TORQUES, "lbft"),
        ("torque_mNm", units.TORQUES, "mNm"),
        ("force [µN]", units.TORQUES, "uN"),
        ("force_n", units.TORQUES, ""),
        ("force_N", units.TORQUES, "N"),
        ("torque [N·m]", units.TORQUES, "Nm"),
        ("torque (mN.m)", units.TORQUES, "mNm"),
        ("torque [Ncm]", units.TORQUES, "cNm"),
        ("force [mN]", units.TORQUES, "mN"),
        ("force [MN]", units.TORQUES, "MN"),
        ("torque_MNm", units.TORQUES, "MNm"),
        ("angle [rev]", units.ANGLES, "turn"),
        ("angle (arcmin)", units.ANGLES, "arcmin"),
        ("pos_cm", units.ANGLES, "cm"),
        ("theta_m", units.ANGLES, ""),
        ("angle_in", units.ANGLES, ""),
        ("theta_in_deg", units.ANGLES, "deg"),
        ("theta [in]", units.ANGLES, "in"),
        ("pos_in", units.ANGLES, "in"),
        ("x_m", units.ANGLES, "m"),
        ("position_inch", units.ANGLES, "in"),
        ("way [inches]", units.ANGLES, "in"),
        ("torque_kgcm", units.TORQUES, "kgfcm"),
        ("torque [g*cm]", units.TORQUES, "gfcm"),
        ("time [µs]", units.TIMES, "us"),
        ("time [μs]", units.TIMES, "us"),
        ("stamp_ns", units.TIMES, "ns"),
        ("time [ms]", units.TIMES, "ms"),
        ("Time (seconds)", units.TIMES, "s"),
        ("torque_ft_lb", units.TORQUES, "lbft"),
        ("torque_in_lb", units.TORQUES, "lbin"),
        ("trq_lb_ft", units.TORQUES, "lbft"),
        ("Torque [ft-lb]", units.TORQUES, "lbft"),
        ("torque_oz_in", units.TORQUES, "ozin"),
        ("load_lbf", units.TORQUES, "lb"),
        ("torque_N_m", units.TORQUES, "Nm"),
        ("torque_kN_m", units.TORQUES, "kNm"),
        ("M_N", units.TORQUES, "N"),
        ("Torque (motor) [mNm]", units.TORQUES, "mNm"),
        ("Torque [Nm] (filtered)", units.TORQUES, "Nm"),
        ("Torque_Nm [V]", units.TORQUES, ""),
        ("Angle (Radians)", units.ANGLES, "rad"),
        ("Angle [Degrees]", units.ANGLES, "deg"),
        ("Position (raw) [rad]", units.ANGLES, "rad"),
        ("time [Milliseconds]", units.TIMES, "ms"),
    ],
)
def test_the_unit_in_a_name(name, known, unit):
    assert units.unit_in(name, known, "") == unit
    assert units.unit_in(name, known, "usual") == (unit or "usual")


@pytest.mark.parametrize(
    ("what", "names", "found", "beside"),
    [
        ("angle", ["t", "Theta", "trq"], "Theta", ""),
        ("angle", ["t", "shaft_pos", "torque"], "shaft_pos", ""),
        ("angle", ["position", "encoder", "angle_ref"], "position", "'encoder'"),
        ("angle", ["counts", "trq"], "counts", ""),
        ("torque", ["angle", "LOAD"], "LOAD", ""),
        ("torque", ["angle", "x_Nm", "y_Nm", "z_Nm"], "x_Nm", "'y_Nm' or 'z_Nm'"),
        ("torque", ["moment", "force"], "moment", ""),
        ("torque", ["load_cell_N", "torque_Nm"], "torque_Nm", ""),
        ("torque", ["torque_cmd", "torque_rate", "torque_error", "torque_meas"], "torque_meas", ""),
        ("torque", ["torque_cmd", "load_N"], "load_N", ""),
        ("torque", ["trq_ref"], "trq_ref", ""),
        ("angle", ["theta_dot", "theta_ddot", "angle_rate", "theta_vel", "theta"], "theta", ""),
        ("angle", ["position_error", "pos_err", "angle_acc", "angle_ref_rad", "pos"], "pos", ""),
        ("angle", ["set_position", "encoder"], "encoder", ""),
        ("angle", ["target_angle"], "target_angle", ""),
        ("angle", ["level_angle", "accurate_angle"], "level_angle", "'accurate_angle'"),
        ("time", ["angle", "timestamp", "time_ms"], "timestamp", ""),
        ("time", ["t", "angle"], "t", ""),
        ("time", ["t [s]"], "t [s]", ""),
        ("time", ["torque", "test"], "", ""),
    ],
)
def test_columns_that_nobody_named(what, names, found, beside):
    """Of several that say so as well the first one, and a note says which it is not."""
    notes = [f"{what} taken from '{found}', not from {beside} (--{what})"] * bool(beside)
    assert units.column(what, "", names, "x.csv") == (found, notes)


def test_a_rate_is_no_angle():
    with pytest.raises(Error, match=r"x.csv: which column is the angle\?"):
        units.column("angle", "", ["t", "theta_dot", "angle speed", "angle_vel", "trq"], "x.csv")


def test_a_force_over_an_angle_is_named(tmp_path):
    """A load cell on a lever: what it says lacks a length."""
    up = np.arange(40.0)
    for angle, noted in (("angle_rad", True), ("x_mm", False)):
        path = write_csv(tmp_path / "lever.csv", up, up, f"t,{angle},load_N")
        notes = " ".join(readers.read(path, readers.Source(angle=angle)).notes)
        assert ("'load_N' is a force over an angle: N taken for N m" in notes) == noted


def test_columns_that_somebody_named():
    names = ["t", "angle", "2"]
    for said, taken in (("angle", "angle"), ("2", "2"), ("1", "t"), ("3", "2")):  # a name first
        assert units.column("angle", said, names, "x.csv") == (taken, [])
    for wrong in ("0", "4", "angel"):
        with pytest.raises(Error, match=f"x.csv: no column '{wrong}'"):
            units.column("angle", wrong, names, "x.csv")
    with pytest.raises(Error, match="which column is the torque"):
        units.column("torque", "", ["x", "y"], "x.csv")


def source(**words) -> readers.Source:
    return readers.Source(**words)


def test_torques_of_two_messages():
    """In turns: the torque after its angle; at rates of their own: between its frames."""
    angle = np.arange(0.0, 1.0, 0.1)
    rows, values = readers._torque_at(angle, angle, angle)
    assert rows.tolist() == list(range(10)) and values.tolist() == angle.tolist()
    late = angle + 0.09
    rows, values = readers._torque_at(angle, late, np.arange(10.0))
    assert rows.tolist() == list(range(10)) and values.tolist() == list(range(10))
    often = np.arange(0.05, 0.85, 0.01)
    rows, values = readers._torque_at(angle, often, 2 * often)
    assert rows.tolist() == list(range(1, 9)) and values == pytest.approx(2 * angle[1:9])


@pytest.mark.parametrize(
    ("text", "names", "first", "row"),
    [
        ("a,b\n1,2\n3,4\n", ["a", "b"], 2, [1, 2]),
        ("a; b\n1;2\n", ["a", "b"], 2, [1, 2]),
        ("1\t2\n3\t4\n", ["1", "2"], 1, [1, 2]),
        ("a   b\n1 2\n", ["a", "b"], 2, [1, 2]),
        ("a;b\ns;\n1;2\n3;4\n", ["a [s]", "b"], 3, [1, 2]),
        ("\n  \na,b,c\n1,2,3\n", ["a", "b", "c"], 4, [1, 2, 3]),
        ("a,b;c\n", None, 0, []),
    ],
)
def test_a_table_of_text(tmp_path, text, names, first, row):
    place = tmp_path / "x.csv"
    place.write_text(text)
    if names is None:
        with pytest.raises(Error, match="x.csv:1: no rows"):
            text_tables.read(place)
        return
    frame, line = text_tables.read(place)
    assert list(frame.columns) == names and line == first
    assert frame.iloc[0].tolist() == row


def test_what_is_kept_as_a_result():
    whole = {name: 0 for name in ("sigma0", "Fc", "r2", "r2_coulomb", "reversals", "verdict")}
    whole["units"] = {"sigma0": "N/m", "Fc": "N"}
    ends = {"sigma0": [1, 2], "Fc": [1, None]}
    assert folder_runs.is_result({**whole, "ci95": ends})
    assert folder_runs.is_result({"error": "why"})
    for wrong in (
        None,
        [],
        {},
        {"error": 3},
        {**whole, "ci95": ends, "units": None},
        whole,
        {**whole, "ci95": {"sigma0": [1, 2]}},
        {**whole, "ci95": {**ends, "Fc": [1]}},
        {"ci95": ends, "sigma0": 1},
    ):
        assert not folder_runs.is_result(wrong)
    for name in whole:  # as another version may have kept it
        other = {key: value for key, value in whole.items() if key != name}
        assert not folder_runs.is_result({**other, "ci95": ends}), name


# --- the picture ----------------------------------------------------------------------------------


def test_the_longest_piece_is_drawn(library, tmp_path, monkeypatch):
    logs = [synthetic(k, rows=rows, cycles=4) for k, rows in ((1, 700), (2, 1100))]
    found = pipeline.identify(logs, pipeline.Options(terms=()))
    figures = []
    monkeypatch.setattr(plots, "save", lambda figure, path: figures.append(figure))
    draw.draw(tmp_path / "x.png", found)
    rows = {len(line.get_xdata()) for axes in figures[0].axes for line in axes.lines}
    assert 1100 in rows and 700 not in rows


@pytest.mark.parametrize(
    ("linear", "size", "unit", "part"),
    [(False, 0.05, "rad", 1), (True, 0.05, "mm", 1e-3), (True, 3.0, "m", 1)],
)
def test_the_angle_and_the_speed_that_are_drawn(linear, size, unit, part):
    theta = 0.4 + size * np.sin(np.arange(50_000) / 3000)
    log = Log("", theta, theta, 2e-3 * np.arange(50_000), linear=linear)
    weight, free = np.ones(50_000), log.moves.copy()
    weight[10_000:20_000], free[:5_000] = 0.4, 0.4 * log.moves[:5_000]
    log = replace(log, weight=weight, free_moves=free)
    shown = draw.shown_of(SimpleNamespace(logs=[log], raw=[log]), 0)
    assert (shown.unit, shown.size, shown.some.step) == (unit, part, 2)
    assert shown.angle == pytest.approx((theta - theta[0])[::2] / part)
    speed = np.gradient(theta, 2e-3)[::2] / part
    assert shown.speed[10:-10] == pytest.approx(speed[10:-10], rel=1e-3, abs=1e-3 * speed.max())
    bare = draw.shown_of(SimpleNamespace(logs=[replace(log, time=None)], raw=[log]), 0)
    assert bare.speed == pytest.approx(2e-3 * shown.speed)
    (odd, odd_rows, _), (flat, flat_rows, _) = draw.marks_of(shown)
    assert (odd, flat) == ("weighs less", "travel taken out as backlash")
    assert (odd_rows.sum(), flat_rows.sum()) == (5000, pytest.approx(2500, abs=2))
    plain = draw.shown_of(SimpleNamespace(logs=[replace(log, weight=None)], raw=[log]), 0)
    assert not draw.marks_of(plain)[0][1].any()


# --- frames ---------------------------------------------------------------------------------------

BUS = """VERSION ""
NS_ :
BS_:
BU_: A
BO_ 256 Shaft: 8 A
 SG_ Angle : 0|16@1- (0.5,0) [-1000|1000] "deg" A
 SG_ Gear : 32|8@1+ (1,0) [0|5] "" A
BO_ 257 Load: 8 A
 SG_ Torque : 0|16@1- (0.01,0) [0|0] "Nm" A
VAL_ 256 Gear 1 "first" ;
"""


def sent(number: int, data: bytes, time: float, **more):
    import can

    return can.Message(
        arbitration_id=number, data=data, timestamp=time, is_extended_id=False, **more
    )


def test_frames_that_tell_a_signal(tmp_path):
    """Also short ones where the signal is in them, and of any value where the DBC has no range."""
    (tmp_path / "bus.dbc").write_text(BUS)
    signals = readers.Signals(tmp_path / "bus.dbc", "Angle", "Torque")
    for number, name, size in ((256, "Angle", 0.5), (257, "Torque", 0.01)):
        frames = [sent(number, data, time) for time, data in enumerate((b"\x02\0", b"\1", b""))]
        frames += [sent(number, b"", 3, is_remote_frame=True, dlc=8), sent(999, bytes(8), 4)]
        frames += [sent(number, b"\x04" + bytes(7), 5), sent(number, b"\0\x80", 6)]  # -32768
        for frame in frames:
            signals.feed(frame)
        wanted = [(0, 2 * size), (5, 4 * size), (6, -327.68)][: 2 if name == "Angle" else 3]
        assert np.array(signals.found[name]) == pytest.approx(np.array(wanted))


def test_an_angle_and_its_torque_at_one_time():
    """Frames of one time belong together, also where one of them is missing."""
    angle = np.arange(500.0)
    torque = np.delete(angle, 200)
    rows, values = readers._torque_at(angle, torque, torque)
    assert rows.tolist() == torque.tolist() and values.tolist() == torque.tolist()


# --- how the steps hang together ------------------------------------------------------------------


def taken(choice: Choice) -> Explored:
    """That this choice was taken, and nothing else tried."""
    value = {"sigma0": SIGMA0, "Fc": FC}
    without = {name: np.full(8, one) for name, one in value.items()}
    one = Trial(choice, A, value, without, np.ones(8))
    return Explored([one], one)


def test_what_is_found_on_the_way_reaches_the_result(monkeypatch):
    """A delay that was taken out lets the angle be taken between the counts, which tells more of
    the delay: both are added up; the terms are those of the choice; what the counts hide is told.
    """
    log, inner, hidden = synthetic(3, rows=1200, cycles=7), iter([False, True]), []

    def between(logs, options):
        found = next(inner)
        return logs, [np.full(log.rows, 1e-3)] * found

    estimate = fit.estimate
    monkeypatch.setattr(pipeline, "_between_counts", between)
    monkeypatch.setattr(pipeline, "_explored", lambda *_: taken(Choice((), 2.0)))
    again = taken(Choice(("offset", "spring"), 0.5))
    monkeypatch.setattr(pipeline, "_explored_again", lambda *_: (again, 0.5))
    monkeypatch.setattr(fit, "estimate", lambda *words: hidden.append(words[2]) or estimate(*words))
    found = pipeline.identify([log], pipeline.Options(target_counts=5000))
    assert found.delay == 2.5 and found.inner and found.explored is again
    late = [note.endswith("torque comes 2.5 rows (0.0025 s) late") for note in found.notes]
    assert late.count(True) == 1
    assert list(found.estimate.terms) == ["offset", "spring"]
    assert hidden[0].keys() == {"a", "Fc", "sigma0"}
    assert found.raw[0].torque.tolist() == log.torque.tolist()
    assert found.logs[0].torque[:-3] == pytest.approx(clean.shifted(log.torque, 2.0)[:-3])
    assert found.options["target_counts"] == 5000 and found.plan.of_target
    assert found.plan.theta_per_count == pytest.approx(2 * np.pi / 5000)
    assert found.backlash == 0 and found.median == 1 and found.sign == 1


def test_what_was_between_the_counts_from_the_start_is_not_asked_again(monkeypatch):
    log = synthetic(3, rows=1200, cycles=7)
    monkeypatch.setattr(
        pipeline, "_between_counts", lambda logs, _: (logs, [np.zeros(logs[0].rows)])
    )
    monkeypatch.setattr(pipeline, "_explored", lambda *_: taken(Choice((), 2.0)))
    found = pipeline.identify([log])
    assert found.delay == 2.0 and found.inner


@pytest.mark.parametrize(
    ("options", "asked"),
    [
        ({}, (None, True, "")),
        ({"delay": False}, (None, False, "")),
        ({"terms": ("offset",)}, ((("offset",),), True, "")),
        ({"model": "slip-2"}, (None, True, "slip K=2")),
        ({"model": "coulomb"}, (None, True, "Coulomb")),
    ],
)
def test_what_may_be_tried_is_what_was_asked_for(monkeypatch, options, asked):
    tried = []

    def explored(logs, estimate, least_turn, wanted):
        tried.append((wanted, least_turn, estimate))
        return Explored()

    monkeypatch.setattr(explore, "explored", explored)
    log = synthetic(3, rows=1200, cycles=7)
    for timed in (True, False):
        study = pipeline.Study([log if timed else replace(log, time=None)])
        found, terms = study.search(("offset",))
        estimate = fit.point(found, terms)
        given = pipeline.Options(**options)
        seen = pipeline._explored(study, found, estimate, given, least=0.2)
        wanted, turn, at = tried.pop()
        sets, delays, model = asked
        assert wanted.delays is (delays and timed) and wanted.model == model
        assert wanted.terms == (sets or tuple(fit.sets_of(found, study.candidates)))
        assert wanted.least_delay == 0.2 and turn == pytest.approx(0.3 / estimate.a)
        assert at is estimate
        assert seen.taken is None or len(seen.taken.cost) == 1  # no cycle was left out
    lost = replace(estimate, sse=0.71 * fit.spread_of(found))
    assert pipeline._explored(study, found, lost, given).trials == [] and tried == []
    lost = replace(estimate, sse=0.69 * fit.spread_of(found))
    pipeline._explored(study, found, lost, given)
    assert tried.pop()[0].least_delay == 0.3
    other = replace(estimate, Fc=-FC)
    assert pipeline._explored(study, found, other, given).trials == [] and tried == []


@pytest.mark.parametrize(
    ("counts", "sse", "median", "inner"),
    [(0.0031, 0.9, 0, True), (0.0029, 0.9, 0, False), (0.01, 1.0, 0, False), (0.01, 0.9, 3, False)],
)
def test_when_the_angle_is_taken_between_the_counts(monkeypatch, counts, sse, median, inner):
    """Counts of three thousandths of a presliding length, and a torque that fits better."""
    log = replace(synthetic(3, rows=1200, cycles=7), resolution=counts / A)
    read = SimpleNamespace(a=A, sse=1.0, sigma0=100.0)
    looks = iter([read, SimpleNamespace(a=A, sse=sse, sigma0=104.0)])
    monkeypatch.setattr(pipeline, "_first", lambda *_: next(looks))
    fine = replace(log, resolution=log.resolution / 9, notes=[])  # the coarsest log tells
    logs, doubts = pipeline._between_counts([log, fine], pipeline.Options(median=median))
    assert len(doubts) == 2 * inner
    assert [one is given for one, given in zip(logs, (log, fine), strict=True)] == [not inner] * 2
    if inner:
        assert logs[0].theta == pytest.approx(clean.between_counts(log))
        assert logs[0].notes == [
            "angle taken between the counts of the encoder: the torque fits it better"
        ]


def test_a_log_to_check_is_cleaned_as_the_others(result):
    log = synthetic(4, rows=900, cycles=5)
    way = replace(result, median=5, sign=-1.0, delay=2.0, inner=False)
    found = pipeline._as_fitted(way, log)
    assert found.theta == pytest.approx(median_filter(log.theta, 5, mode="nearest"))
    assert found.torque[:-2] == pytest.approx(-log.torque[2:])
    between = pipeline._as_fitted(replace(result, inner=True), log)
    assert between.theta == pytest.approx(clean.between_counts(log))
    assert between.torque == pytest.approx(log.torque)


def test_each_log_of_a_folder_has_its_own_numbers(tmp_path):
    """Those of earlier runs first, in their order, and the others under their own names."""
    paths = [tmp_path / f"{k}.csv" for k in range(5)]
    known = {paths[0]: {"log": "0"}, paths[3]: {"log": "3"}}
    kept = SimpleNamespace(
        get=known.get, asked=lambda path: (path,), call=lambda path: {"log": path.stem}
    )
    found = list(folder_runs.run(paths, kept, 1, None))
    assert [(path.stem, earlier) for path, _, earlier in found[:2]] == [("0", True), ("3", True)]
    assert sorted(path.stem for path, *_ in found[2:]) == ["1", "2", "4"]
    for place, numbers, earlier in found:
        assert numbers == {"log": place.stem} and earlier is (place in known)


@pytest.mark.parametrize(
    ("sigma0", "reach"), [(0.8, 125.0), (1.25, 80.0), (0.05, 1000.0), (0.999, None)]
)
def test_how_far_noise_of_the_angle_may_have_moved_a_parameter(sigma0, reach):
    """Back by the part that the trial moved it by, ten times at most."""
    theta = sine(1, rows=2000, cycles=6) + 0.01 / A * RNG.normal(size=2000)
    ends = {"sigma0": Interval(98.0, 102.0), "Fc": Interval(0.49, 0.51)}
    estimate = SimpleNamespace(a=A, sigma0=100.0, Fc=FC, ci95=ends)
    log = log_of(dahl_torque(THETA), THETA)
    raw = replace(log, theta=theta, torque=dahl_torque(theta))
    result = SimpleNamespace(estimate=estimate, raw=[raw])
    made = []

    def refit(logs):
        made.extend(logs)
        return SimpleNamespace(sigma0=100.0 * sigma0, Fc=FC)

    found = angle_noise.finding(result, refit)
    assert [one.reach for one in found] == (
        [{"sigma0": (pytest.approx(reach), pytest.approx(reach))}] if reach else []
    )
    assert [one.doubts for one in found] == [("sigma0",)] * bool(reach)
    assert made[0].rows == 2000 and np.std(made[0].theta - theta) > 0.008 / A


def test_the_units_of_a_can_log_are_those_of_its_dbc(tmp_path):
    import can

    text = BUS.replace('"deg"', '"mrad"').replace('"Nm"', '"mNm"')
    (tmp_path / "x.dbc").write_text(text)
    with can.Logger(tmp_path / "x.asc") as logger:
        for k in range(5):
            logger.on_message_received(sent(256, bytes([2 * k, 0]) + bytes(6), 1 + 0.1 * k))
            logger.on_message_received(sent(257, bytes([50, 0]) + bytes(6), 1 + 0.1 * k))
    words = source(dbc=tmp_path / "x.dbc", angle="Angle", torque="Torque")
    log = readers.read(tmp_path / "x.asc", words)
    assert log.theta == pytest.approx(1e-3 * np.arange(5))
    assert log.torque == pytest.approx(np.full(5, 0.5e-3)) and log.notes == []


def test_one_shaky_log_of_two_takes_the_claim():
    """Beyond .06 presliding lengths of noise in any of them the trial itself tells too little."""
    theta = sine(1, rows=2000, cycles=6)
    ends = {"sigma0": Interval(98.0, 102.0), "Fc": Interval(0.49, 0.51)}
    estimate = SimpleNamespace(a=A, sigma0=100.0, Fc=FC, ci95=ends)
    for part, doubts in ((0.05, []), (0.08, [("sigma0",)])):
        shaky = theta + part / A * RNG.normal(size=2000)
        raw = [Log("", one, dahl_torque(theta)) for one in (theta, shaky)]
        result = SimpleNamespace(estimate=estimate, raw=raw)
        found = angle_noise.finding(result, lambda _: SimpleNamespace(sigma0=100.0, Fc=FC))
        assert [one.doubts for one in found] == doubts


def test_a_first_look_has_the_terms_that_were_asked_for():
    log = log_of(dahl_torque(THETA), THETA)
    for terms in (("viscous",), ("offset",), ("offset", "inertia")):
        found = pipeline._first([log], pipeline.Options(terms=terms))
        assert tuple(found.terms) == terms
    assert tuple(pipeline._first([log], pipeline.Options()).terms) == ("offset", "spring")


# --- a whole result and the rows that it is of ----------------------------------------------------


SEVERAL = ("two", "late", "against")  # logs


def logs_of(kind: str) -> list[Log]:
    """Logs of 2400 and 1500 rows, or the first of them, with something beside friction."""
    made = [synthetic(3, rows=2400, cycles=8), synthetic(4, rows=1500, cycles=6)]
    start, logs = made[0].theta[0], []
    for log in made[: 1 + (kind in SEVERAL)]:
        way, late = log.theta - start, np.r_[np.zeros(4), log.torque[:-4]]
        torque = {
            "late": late + 0.07,
            "against": -log.torque - 2 * way,
            "linear": log.torque + 0.1 + 3 * way,
            "viscous": log.torque + 0.03 * np.gradient(log.theta, 1e-3) + 0.1,
            "slips": springs(log.theta, (90, 0.15), (30, 0.3)) + 0.01 * noise_of(3, log.rows),
            "spikes": log.torque + 3 * (np.arange(log.rows) % 97 == 0),
        }
        log = replace(log, torque=torque.get(kind, log.torque))  # noqa: PLW2901
        logs.append(replace(log, linear=True, time=None) if kind == "linear" else log)
    return logs


@cache
def result_of(kind: str) -> Result:
    return pipeline.identify(logs_of(kind))


@pytest.mark.parametrize(
    ("kind", "terms", "notes"),
    [
        ("plain", {}, []),
        ("late", {"offset": 0.07}, ["torque comes 3.7 rows (0.00375 s) late"]),
        ("against", {"offset": 0.0, "spring": 2.0}, ["torque taken with the other sign"]),
        ("linear", {"offset": 0.1, "spring": 3.0}, []),
        ("two", {}, []),
        ("viscous", {"offset": 0.1, "viscous": 0.03}, []),
        ("spikes", {}, ["26 of 2400 torque rows disagree with their neighbours"]),
    ],
)
def test_a_result_agrees_with_its_rows(kind, terms, notes):
    logs, found = logs_of(kind), result_of(kind)
    best, numbers = found.estimate, output.numbers(found)
    assert best.terms == pytest.approx(terms, abs=5e-3)
    assert set(found.explored.choice.terms) == set(terms)
    assert found.delay == pytest.approx(3.7 * (kind == "late"), abs=0.1)
    claimed = kind != "late"
    check_notes(found, notes, claimed)
    assert found.verdict.identifiable == {"sigma0": claimed, "Fc": claimed}
    for name, true in (("sigma0", SIGMA0), ("Fc", FC)):
        assert getattr(best, name) == pytest.approx(true, rel=0.05)
        ends = best.ci95[name]
        assert ends.low < getattr(best, name) < ends.high < (1.8, 1.2)[claimed] * ends.low
    assert [raw.torque.tolist() for raw in found.raw] == [log.torque.tolist() for log in logs]
    assert numbers["rows"] == sum(log.rows for log in logs) == sum(numbers["pieces"])
    left, spread, weights, steep = np.sum(list(sums_of(found, terms)), axis=0)
    assert numbers["sum_of_weights"] == pytest.approx(weights)
    assert numbers["rmse"] == pytest.approx(np.sqrt(left / weights), rel=1e-3)
    assert numbers["r2"] == pytest.approx(1 - left / spread, rel=1e-3)
    moving = sum(np.count_nonzero(log.moves) for log in found.logs)
    assert numbers["informs_sigma0"] == pytest.approx(steep / moving, abs=0.002)
    assert numbers["reversals"] == (28 if kind in SEVERAL else 16)
    held = numbers["held_out"]
    assert held["none"]["r2"] < held["coulomb"]["r2"] < held["bilinear"]["r2"]
    assert held["bilinear"]["r2"] < held["dahl"]["r2"] < numbers["r2"] + 1e-3
    assert held["dahl"]["rmse"] == pytest.approx(numbers["rmse"], rel=0.02)
    assert numbers["coulomb_extra"] == sorted(numbers["coulomb_extra"], key=place_of)


def check_notes(found, notes, claimed):
    """Those of the cleaning in each log; of like strokes in the first, where sigma0 is claimed, and
    perhaps of like cycles.
    """
    in_step = "the encoder is read in step with the motion, the same counts in each cycle"
    for k, log in enumerate(found.logs):
        said = [note.split(": ")[0] for note in log.notes]
        said = [note for note in said if k > 0 or note != in_step]
        alike = ["all strokes have one speed"] * (claimed and k == 0)
        told = ["angle taken between the counts of the encoder", *notes, *alike]
        assert sorted(said) == sorted(told)


def sums_of(found, terms):
    """Of each log: squares left and around the mean, weights, moving rows in which sigma0 shows."""
    best = found.estimate
    for log, drawn in zip(found.logs, found.predicted, strict=True):
        weight = np.ones(log.rows) if log.weight is None else log.weight
        speed = np.gradient(log.theta, 1e-3)
        friction = dahl_torque(log.theta, best.sigma0, best.Fc)
        load = terms.get("offset", 0) + terms.get("viscous", 0) * speed
        load = load + terms.get("spring", 0) * (log.theta - found.logs[0].theta[0])
        fades = np.exp(-best.a * np.cumsum(np.abs(log.moves)))
        rest = log.torque - friction - load
        first = (weight * fades) @ rest / ((weight * fades) @ fades)
        assert drawn[20:-20] == pytest.approx((friction + load + first * fades)[20:-20], abs=6e-3)
        left = weight @ (log.torque - drawn) ** 2
        spread = weight @ log.torque**2 - (weight @ log.torque) ** 2 / weight.sum()
        shows = (1 - np.sign(log.moves) * friction / best.Fc > 0.1)[log.moves != 0].sum()
        yield left, spread, weight.sum(), shows


@pytest.mark.parametrize("kind", ["plain", *SEVERAL, "linear", "viscous", "spikes"])
def test_the_scene_of_a_result_draws_its_log(kind, tmp_path):
    found = result_of(kind)
    said = configparser.ConfigParser(inline_comment_prefixes=";")
    said.read(output.write_scene(found, "x", tmp_path))
    way, torque = np.loadtxt(tmp_path / "x.csv", delimiter=",", skiprows=1).T
    friction = dahl_torque(way, *(float(said["friction"][name]) for name in ("sigma0", "Fc")))
    scale, offset, spring = (
        float(said["measured"][name]) for name in ("torque_scale", "offset", "spring")
    )
    settled = slice(int(said["measured"]["settle"]), None)
    rest = (scale * torque - friction - offset - spring * way)[settled]
    same = (found.logs[0].torque - found.predicted[0])[settled]
    assert np.std(rest) == pytest.approx(np.std(same), rel=0.05)
    assert np.mean(rest) == pytest.approx(np.mean(same), abs=5e-3)


@pytest.mark.parametrize(
    ("kind", "size"), [("late", 1e-4), ("spikes", 1e4), ("slips", 1e-4), ("slips", 1e4)]
)
def test_the_size_of_a_torque_does_not_matter(kind, size):
    """A small bearing and a large one of the same presliding length are told alike."""
    found = result_of(kind)
    other = pipeline.identify([replace(log, torque=size * log.torque) for log in logs_of(kind)])
    for name in ("sigma0", "Fc"):
        assert getattr(other.estimate, name) == pytest.approx(
            size * getattr(found.estimate, name), rel=1e-3
        )
        ends = [
            np.array((one.low, one.high))
            for one in (found.estimate.ci95[name], other.estimate.ci95[name])
        ]
        assert ends[1] == pytest.approx(size * ends[0], rel=1e-2)
    assert other.explored.models.chosen == found.explored.models.chosen
    assert other.explored.choice.terms == found.explored.choice.terms
    assert other.delay == pytest.approx(found.delay, abs=0.01)
    assert other.verdict.identifiable == found.verdict.identifiable
    assert [one.doubts for one in other.findings] == [one.doubts for one in found.findings]
    assert other.plan.r2 == pytest.approx(found.plan.r2, abs=1e-3)
    assert len(other.plan.against) == len(found.plan.against)
    assert [note[:20] for note in other.notes] == [note[:20] for note in found.notes]
