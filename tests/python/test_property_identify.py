# SPDX-License-Identifier: MIT
"""Laws of identification, of its parts and of `dahl excite`: what a change of units, sign, origin,
clock or order of the logs must do to the result, and must not.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from dahl.identify import design, fit, path, pipeline, sweep, units
from dahl.identify.log import Log, resolution_of
from dahl.identify.result import Result
from hypothesis import strategies as st
from identify_tools import COUNT, FC, SIGMA0, dahl_torque, noise_of, sine, synthetic
from law_tools import holds, modes

pytestmark = pytest.mark.usefixtures("library")

ROWS = 1500
OPTIONS = pipeline.Options(trust_units=True)
seeds = st.integers(0, 10_000)
factors = st.floats(-2, 2).map(lambda power: float(10**power))
paths = st.lists(st.floats(-1, 1), min_size=1, max_size=200).map(np.array)
steepness = st.floats(-2, 3).map(lambda power: float(10**power))


def found_in(*logs: Log) -> Result:
    return pipeline.identify(logs, OPTIONS)


def short(seed: int) -> Log:
    return synthetic(seed, rows=ROWS, cycles=5)


def agree(one: Result, other: Result, sigma0: float, Fc: float, within: float) -> None:  # noqa: N803
    """`other` is `one` with its parameters and their intervals times these factors."""
    for name, factor in (("sigma0", sigma0), ("Fc", Fc)):
        first, second = one.estimate, other.estimate
        assert getattr(second, name) == pytest.approx(factor * getattr(first, name), rel=within)
        widths = [found.ci95[name].high - found.ci95[name].low for found in (first, second)]
        assert widths[1] == pytest.approx(factor * widths[0], rel=100 * within)
    assert other.verdict.identifiable == one.verdict.identifiable
    assert list(other.estimate.terms) == list(one.estimate.terms)
    assert other.r2 == pytest.approx(one.r2, abs=100 * within)


# --- the whole of an identification ---------------------------------------------------------------


@modes(short=4, long=25)
def test_torque_in_another_unit_scales_both_parameters(examples):
    def law(seed: int, factor: float) -> None:
        log = short(seed)
        scaled = replace(log, torque=factor * log.torque)
        agree(found_in(log), found_in(scaled), factor, factor, 1e-5)

    holds(law, examples, seeds, factors)


@modes(short=4, long=25)
def test_angle_in_another_unit_scales_sigma0_the_other_way(examples):
    def law(seed: int, factor: float) -> None:
        log = short(seed)
        scaled = replace(log, theta=factor * log.theta, resolution=factor * log.resolution)
        agree(found_in(log), found_in(scaled), 1 / factor, 1.0, 1e-4)

    holds(law, examples, seeds, factors)


@modes(short=4, long=25)
def test_another_origin_changes_nothing(examples):
    """Neither of the angle nor, but for the offset, of the torque, nor of the clock."""

    def law(seed: int, turns: int, counts: int, later: float) -> None:
        log, up = short(seed), 0.01 * FC * turns
        moved = replace(
            log, theta=log.theta + counts * COUNT, torque=log.torque + up, time=log.time + later
        )
        one, other = (
            pipeline.identify([each], replace(OPTIONS, terms=("offset",))) for each in (log, moved)
        )
        agree(one, other, 1.0, 1.0, 1e-5)
        changed = other.estimate.terms["offset"] - one.estimate.terms["offset"]
        assert changed == pytest.approx(up, abs=1e-5 * FC)

    holds(law, examples, seeds, st.integers(-50, 50), st.integers(-9999, 9999), st.floats(0, 1e4))


@modes(short=4, long=25)
def test_the_mirrored_log_has_the_same_friction(examples):
    def law(seed: int) -> None:
        log = short(seed)
        mirrored = replace(log, theta=-log.theta, torque=-log.torque)
        agree(found_in(log), found_in(mirrored), 1.0, 1.0, 1e-5)

    holds(law, examples, seeds)


@modes(short=4, long=25)
def test_friction_knows_no_time(examples):
    """A slower clock changes neither parameter, with all terms of time allowed."""

    def law(seed: int, factor: float) -> None:
        log = short(seed)
        slower = replace(log, time=factor * log.time)
        agree(found_in(log), found_in(slower), 1.0, 1.0, 1e-5)

    holds(law, examples, seeds, factors)


@modes(short=3, long=12)
def test_the_order_of_the_logs_does_not_matter(examples):
    def law(seed: int) -> None:
        logs = [short(seed), short(seed + 1)]
        agree(found_in(*logs), found_in(*logs[::-1]), 1.0, 1.0, 1e-4)

    holds(law, examples, seeds)


@modes(short=5, long=30)
def test_the_wrong_sign_of_the_torque_is_seen(examples):
    def law(seed: int) -> None:
        log = short(seed)
        turned = replace(log, torque=-log.torque)
        one, other = found_in(log), found_in(turned)
        assert (one.sign, other.sign) == (1.0, -1.0)
        agree(one, other, 1.0, 1.0, 1e-5)

    holds(law, examples, seeds)


@modes(short=5, long=30)
def test_coulomb_alone_says_nothing_about_sigma0(examples):
    """A torque that is a bare sign: Fc is found, sigma0 never claimed."""

    def law(seed: int, part: float) -> None:
        theta = np.floor(sine(seed, rows=ROWS, cycles=6) / COUNT) * COUNT
        sign = path.coulomb(np.diff(theta, prepend=theta[0]), 0.0)
        torque = FC * (sign + part * noise_of(seed, ROWS))
        result = found_in(Log("coulomb", theta, torque, resolution=COUNT))
        assert not result.verdict.sigma0
        assert result.estimate.ci95["sigma0"].high == np.inf  # it has no end
        assert result.estimate.Fc == pytest.approx(FC, rel=0.1)

    holds(law, examples, seeds, st.floats(0.02, 0.2))


# --- its parts ------------------------------------------------------------------------------------


@modes(short=100, long=1000)
def test_a_path_may_be_walked_in_pieces(examples):
    """From where the first piece ended; every model stays within +-1."""

    def law(moves: np.ndarray, a: float, place: float) -> None:
        cut = int(place * len(moves))
        for model in (path.dahl, path.bilinear, path.coulomb):
            whole = model(moves, a)
            first = model(moves[:cut], a) if cut else np.zeros(1)
            rest = model(moves[cut:], a, float(first[-1])) if cut < len(moves) else moves[:0]
            np.testing.assert_allclose(whole[cut:], rest, atol=1e-6)
            assert (np.abs(whole) <= 1).all()

    holds(law, examples, paths, steepness, st.floats(0, 1))


@modes(short=100, long=1000)
def test_a_path_and_its_mirror_image(examples):
    def law(moves: np.ndarray, a: float) -> None:
        for model in (path.dahl, path.bilinear, path.coulomb):
            np.testing.assert_array_equal(model(-moves, a), -model(moves, a))

    holds(law, examples, paths, steepness)


@modes(short=60, long=2000)
def test_dahl_and_bilinear_are_what_they_are_defined_as(examples):
    """Each step in closed form, in double: w = s - (s - w) exp(-a |move|), and a clipped spring."""

    def law(moves: np.ndarray, a: float) -> None:
        w, spring, bent, straight = 0.0, 0.0, [], []
        for move in moves.astype(np.float32).astype(float):
            side = np.sign(move)
            w = side - (side - w) * np.exp(-a * abs(move)) if side else w
            bent.append(w)
        for move in moves:
            spring = min(max(spring + a * move, -1.0), 1.0)
            straight.append(spring)
        np.testing.assert_allclose(path.dahl(moves, a), bent, atol=2e-7)
        np.testing.assert_allclose(path.bilinear(moves, a), straight, atol=1e-9)

    holds(law, examples, paths, steepness)


@modes(short=80, long=1000)
def test_reversals_are_of_the_path_not_of_its_unit(examples):
    def law(moves: np.ndarray, factor: int, least: float) -> None:
        theta = np.round(np.cumsum(moves) * 64) / 64  # in binary, so that a factor rounds nothing
        turns = path.reversals(theta, least).tolist()
        scale = 2.0**factor
        assert path.reversals(scale * theta, scale * least).tolist() == turns
        assert path.reversals(-theta, least).tolist() == turns
        assert path.reversals(theta + 8, least).tolist() == turns
        assert len(path.reversals(theta, 2 * least)) <= len(turns)
        steps = np.diff(theta[[*turns]])
        assert (np.abs(steps) > least).all()
        assert (np.sign(steps[1:]) == -np.sign(steps[:-1])).all()

    holds(law, examples, paths, st.integers(-20, 20), st.floats(0.02, 1))


@modes(short=100, long=1000)
def test_pieces_cover_each_row_once_and_keep_to_blocks(examples):
    def law(rows: int, blocks: int) -> None:
        cut = sweep.pieces(rows, blocks)
        length = max(-(-rows // blocks), 1)
        assert cut
        covered = [(piece.rows.start, piece.rows.stop) for piece in cut]
        assert covered[0][0] == 0 and covered[-1][1] == rows
        assert all(one[1] == other[0] for one, other in zip(covered, covered[1:], strict=False))
        for piece in cut:
            assert 0 < piece.rows.stop - piece.rows.start <= sweep.PIECE
            assert piece.rows.start // length == piece.block
            whole_blocks = piece.rows.start % length == 0
            assert whole_blocks or (piece.rows.stop - 1) // length == piece.block

    holds(law, examples, st.integers(1, 500_000), st.integers(1, 40))


@modes(short=20, long=300)
def test_gram_matrices_add_up_over_blocks_and_order(examples):
    """The sum is the same however the log is cut, and projecting the start out twice is once."""

    def law(seed: int, blocks: int) -> None:
        log = synthetic(seed, rows=300, cycles=2)
        whole, parts = (sweep.sweep([log], n, np.array([50.0, 200.0])) for n in (1, blocks))
        summed = parts.gram.sum(axis=1)
        np.testing.assert_allclose(summed, whole.gram[:, 0], rtol=1e-5, atol=1e-7)
        total = whole.total()
        np.testing.assert_allclose(sweep.without_start(total), total, atol=1e-9)
        np.testing.assert_allclose(total, np.swapaxes(total, 1, 2), rtol=1e-9, atol=1e-12)

    holds(law, examples, seeds, st.integers(2, 30))


@modes(short=100, long=1000)
def test_folds_are_whole_logs_or_contiguous_parts_of_one(examples):
    def law(sizes: list[int]) -> None:
        owner = np.repeat(np.arange(len(sizes)), sizes)
        fold = fit.folds_of(owner)
        assert (np.diff(fold) >= 0).all()
        several = len(sizes) > 1
        assert len(set(fold.tolist())) == min(len(sizes) if several else sizes[0], fit.FOLDS)
        for log in range(len(sizes) if several else 0):
            assert len(set(fold[owner == log].tolist())) == 1

    holds(law, examples, st.lists(st.integers(1, 40), min_size=1, max_size=5))


@modes(short=100, long=1000)
def test_the_step_of_an_encoder_is_found_in_any_unit(examples):
    def law(counts: list[int], step: float) -> None:
        theta = np.cumsum(counts) * step
        levels = np.diff(np.unique(np.cumsum(counts)))
        known = resolution_of(theta)
        assert known == 0 or known >= 0.99 * step
        if (levels == 1).sum() >= 3:
            assert known == pytest.approx(step, rel=1e-3)

    holds(law, examples, st.lists(st.integers(-3, 3), min_size=8, max_size=80), factors)


# --- the design of an experiment ------------------------------------------------------------------

wanted = st.builds(
    design.Wanted,
    sigma0=st.floats(20, 400),
    Fc=st.floats(0.2, 2),
    theta_per_count=st.just(COUNT / 8),
    noise=st.floats(0.01, 0.1),
    within=st.floats(0.005, 0.05),
)


@modes(short=8, long=200)
def test_a_motion_reaches_what_was_wanted(examples):
    def law(wish: design.Wanted) -> None:
        motion = design.propose(wish)
        assert motion.within["sigma0"] <= wish.within
        theta = motion.theta()
        assert len(theta) == motion.rows + 1 >= motion.cycles * motion.rows_per_cycle
        assert np.abs(theta).max() <= motion.amplitude * (1 + 1e-12)
        assert abs(theta[0]) + abs(theta[-1]) < 1e-9 * max(motion.cycles, 1)
        assert motion.reversals == 2 * motion.cycles

    holds(law, examples, wanted)


@modes(short=8, long=200)
def test_a_design_knows_no_units(examples):
    """Torque in another unit changes nothing; angle in another one the amplitude alone."""

    def law(wish: design.Wanted, power: int) -> None:
        factor, motion = 2.0**power, design.propose(wish)
        louder = replace(wish, sigma0=factor * wish.sigma0, Fc=factor * wish.Fc)
        finer = replace(
            wish, sigma0=wish.sigma0 / factor, theta_per_count=factor * wish.theta_per_count
        )
        for changed, amplitude in ((louder, 1.0), (finer, factor)):
            other = design.propose(changed)
            assert (other.cycles, other.rows_per_cycle) == (motion.cycles, motion.rows_per_cycle)
            assert other.amplitude == pytest.approx(amplitude * motion.amplitude, rel=1e-9)

    holds(law, examples, wanted, st.integers(-6, 6))


@modes(short=8, long=200)
def test_more_noise_or_a_narrower_interval_takes_longer(examples):
    def law(wish: design.Wanted) -> None:
        usual = design.propose(wish)
        assert design.propose(replace(wish, noise=2 * wish.noise)).seconds >= usual.seconds
        assert design.propose(replace(wish, within=wish.within / 2)).seconds >= usual.seconds
        # with a limit of speed the search goes over other cycles: whole ones, in whole rows
        slow = design.propose(replace(wish, speed=0.5))
        cycle = max(usual.rows_per_cycle, slow.rows_per_cycle) / wish.rate
        assert slow.seconds >= 0.99 * usual.seconds - cycle

    holds(law, examples, wanted)


# --- the laws themselves --------------------------------------------------------------------------


def test_planted_asymmetric_model_is_found(monkeypatch):
    def lopsided(moves: np.ndarray, a: float, start: float = 0.0) -> np.ndarray:
        return 1.01 * np.maximum(sound(moves, a, start), -1 / 1.01)

    sound = path.dahl
    monkeypatch.setattr(path, "dahl", lopsided)
    with pytest.raises(AssertionError):
        test_a_path_and_its_mirror_image(100)


def test_planted_lost_block_is_found(monkeypatch):
    sound = sweep.pieces
    monkeypatch.setattr(sweep, "pieces", lambda rows, blocks: sound(rows, blocks)[:-1])
    with pytest.raises(AssertionError):
        test_pieces_cover_each_row_once_and_keep_to_blocks(100)


def test_truth_of_the_generator():
    """What the laws start from: the synthetic log has the parameters that it is said to have."""
    found = found_in(short(1)).estimate
    assert found.sigma0 == pytest.approx(SIGMA0, rel=0.1)
    assert found.Fc == pytest.approx(FC, rel=0.05)
    assert dahl_torque(sine(1))[-1] != 0 and units.ANGLES["rad"] == (1.0, False)
