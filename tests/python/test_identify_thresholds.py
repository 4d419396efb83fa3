# SPDX-License-Identifier: MIT
"""Both sides of each threshold by which a word is said, a row is left out or a claim is taken away:
one line for each, with a log, a result or a score made by hand that lies 4 % (of a number: one)
below it and above it.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from dahl import Error
from dahl.identify import (
    angle_noise,
    clean,
    drift,
    explore,
    grid,
    in_step,
    load,
    lowpass,
    model_table,
    pipeline,
    plan_quality,
    play,
    readers,
    recording,
    ripple,
    torque_steps,
    trial,
    turning,
    variety,
)
from dahl.identify.choices import Choice, Trial
from dahl.identify.compare import Candidate
from dahl.identify.fit import Interval
from dahl.identify.log import Log
from dahl.identify.model_table import Compared
from dahl.identify.result import Cycles
from identify_tools import COUNT, FC, SIGMA0, dahl_torque, noise_of, sine, synthetic
from scipy.stats import t as student

pytestmark = pytest.mark.usefixtures("library")

A = SIGMA0 / FC
UNEVEN = np.resize([1.0, -1.0], 40)  # parts of a log or cycles, that add up to nothing
UNEVEN = UNEVEN / UNEVEN.std(ddof=1)


@functools.cache
def good():
    """A result that nothing speaks against."""
    return pipeline.identify([synthetic(5, rows=3000, cycles=6)], pipeline.Options(terms=()))


def strokes(ends: Sequence[float], rows: Sequence[int]) -> Log:
    """From turning point to turning point, each in so many rows."""
    pairs = zip(ends, ends[1:], rows, strict=False)
    theta = np.concatenate([np.linspace(*two, n, endpoint=False) for *two, n in pairs])
    return Log("strokes", theta, theta, np.arange(len(theta)) * 1e-3)


def unseen(log: Log, word: str) -> bool:
    return word in variety.note([log], A, 0.3 / A)


def one_speed(times: float) -> bool:
    ends, rows = np.resize([1.0, -1.0], 42), np.resize([1000, 1000 * times], 41).astype(int)
    return unseen(strokes(ends, rows), "one speed")


def same_angle(lengths: float) -> bool:
    return unseen(strokes(np.resize([1.0, -1, 1 + lengths / A, -1], 81), [50] * 80), "turning")


def estimate_of(**wide: float) -> SimpleNamespace:
    """sigma0 = 100 and Fc = 0.5 with these parts of them as half widths of their intervals."""
    values = {"sigma0": SIGMA0, "Fc": FC}
    ends = {
        n: Interval(v * (1 - wide.get(n, 0.1)), v * (1 + wide.get(n, 0.1)))
        for n, v in values.items()
    }
    return SimpleNamespace(**values, a=A, ci95=ends, sse=1.0, rows=1.0, terms={}, blocks=24)


def enough_strokes(turns: int) -> bool:
    return unseen(strokes(np.resize([1.0, -1.0], turns + 2), [50] * 99), "turning")


def between_rows(lengths: float) -> bool:
    return bool(explore.between_rows(1.0, lengths))


def widens(part: float) -> bool:
    return bool(trial.widening("", estimate_of(Fc=0.1), {"Fc": -0.1 * part}, {"Fc": (0, 1)}))


def turns_between(lengths: float) -> bool:
    """A stroke whose vertex lies so much beyond the row: there and back."""
    theta = 1 - np.abs(np.arange(-20.0, 21.0)) / 10
    theta[[19, 20, 21]] = 1.0 + np.array([-0.5, 0, -0.1])  # vertex: 0.4^2 / (8 * 0.6) beyond
    a = lengths / (2 * 0.4**2 / (8 * 0.6))
    result = SimpleNamespace(estimate=replace_of(estimate_of(), a=a), logs=[Log("x", theta, theta)])
    tried: list = []
    turning.finding(result, lambda made: tried.append(1) or estimate_of(), 0.5)
    return bool(tried)


def replace_of(one: SimpleNamespace, **changed: object) -> SimpleNamespace:
    return SimpleNamespace(**{**vars(one), **changed})


def steps_show(part: float) -> bool:
    """Without noise Fc is off by half a step, here a tenth."""
    torque = np.round(4 * np.sin(np.arange(4000) / 500)) * 0.2 * FC
    return bool(torque_steps.finding([Log("x", torque, torque)], estimate_of(Fc=0.1 / part)))


def levels_tell(count: int) -> bool:
    """A torque of more levels whose gaps are of no grid tells nothing."""
    levels = np.array([0.0, 1.0, 2.6, 4.31, 6.13])[:count] * FC
    return bool(
        torque_steps.finding([Log("x", np.arange(4000.0), np.repeat(levels, 1000))], estimate_of())
    )


def noise_shows(lengths: float, counts: float = 9.0) -> bool:
    noise = lengths / A
    return bool(angle_noise._shows(Log("x", UNEVEN, UNEVEN, resolution=noise / counts), noise, A))


def noise_moves(part: float) -> bool:
    return bool(angle_noise._moved(estimate_of(Fc=0.1), {"Fc": -0.1 * part}, 0.0))


def much_noise(lengths: float) -> bool:
    return bool(angle_noise._moved(estimate_of(), {"sigma0": 0.0}, lengths / A))


def alternates(correlation: float) -> bool:
    """A third difference of noise that is as much like its neighbour as this."""
    third = np.random.default_rng(1).normal(size=30_000)
    b = (1 - np.sqrt(1 - 4 * correlation**2)) / 2 / correlation  # third + b shifted
    mixed = third[1:] + b * third[:-1]
    return angle_noise.noise_of(np.cumsum(np.cumsum(np.cumsum(mixed))), 0.0) == 0


def costs_of(total: float, shake: float = 0.0) -> np.ndarray:
    """Of 40 cycles, that disagree by a standard error of `shake` of the sum."""
    return np.full(40, total / 40) + shake * UNEVEN / np.sqrt(40)


def trial_of(total: float, shake: float = 0.0, **value: float) -> Trial:
    both = {"sigma0": SIGMA0, "Fc": FC, **value}
    without = {name: np.full(8, one) for name, one in both.items()}
    return Trial(Choice(), A, both, without, costs_of(total, shake))


def curve_is_clear(errors: float = 9.0, part: float = 0.5) -> bool:
    """Of all that is left a curve removes a part, and so many standard errors."""
    models = SimpleNamespace(candidates=[])
    result = SimpleNamespace(explored=SimpleNamespace(models=models))
    return ripple._is_clear(result, trial_of(1.0, part / errors), trial_of(1 - part))


def curve_matters(part: float) -> bool:
    """Outside of its interval a parameter of the curve is told; from so much on it is no claim."""
    result = SimpleNamespace(logs=[synthetic(1, rows=40)], estimate=estimate_of(Fc=1e-3))
    (found,) = ripple._told(result, trial_of(1.0, Fc=FC * (1 + part)))
    return found.doubts == ("Fc",)


def curve_is_tried(rows: int) -> bool:
    """35 strokes of so many rows."""
    with pytest.MonkeyPatch.context() as patch:
        tried: list = []
        patch.setattr(ripple, "beside_a_curve", lambda *_: tried.append(1))
        short = [good().logs[0].head(35 * rows)]
        ripple.finding(replace(good(), logs=short, reversals=35), 0.3 / A)
    return bool(tried)


def load_is_followed(errors: float = 9.0, pays: float = 0.5) -> bool:
    theta = sine(1, rows=2400, cycles=8)
    log = Log("x", theta, dahl_torque(theta), load=np.linspace(1, 3, 2400))
    slope = 0.1
    with pytest.MonkeyPatch.context() as patch:
        judged = (trial_of(1 - pays), slope / errors, {})
        patch.setattr(load, "_best", lambda *_: (A, -slope))
        patch.setattr(load, "_judged", lambda *_: judged)
        patch.setattr(load.choices, "fitted", lambda *_: trial_of(1.0))
        return load.found([log], estimate_of(), 0.3 / A) is not None


def models_of(**cost: tuple[float, float, int]) -> Compared:
    names = {"dahl": "Dahl", "slip": "slip K=2", "slower": model_table.SLOWER, "one": "slip K=1"}
    made = [Candidate(names[n], trial_of(c, s), [], k) for n, (c, s, k) in cost.items()]
    return Compared(made, made, spread=10.0)


def explains_more(errors: float = 9.0, part: float = 0.5) -> bool:
    table = models_of(dahl=(1.0, part / errors, 2), slip=(1 - part, 0.0, 4))
    return model_table.better(table) is not None


def falls_with_speed(errors: float) -> bool:
    table = models_of(dahl=(1.0, 0.5 / errors, 2), slower=(0.5, 0.0, 4))
    return any(one.doubts for one in model_table.findings(table))


def does_without_delay(part: float) -> bool:
    late = replace(trial_of(1.0), choice=Choice((), 2.0))
    return model_table.better_plainly(models_of(one=(1 - part, 0.0, 3)), late)


def filter_is_better(errors: float) -> bool:
    """Of a gain of a tenth, in 40 parts of a log."""
    gain = 0.1 * (1 + UNEVEN * np.sqrt(40) / errors)
    return lowpass.is_better(np.repeat(1.0 + gain, 10), np.ones(400))


def cycles_of(values: np.ndarray, error: float = 1e-3) -> Cycles:
    steady = {"Fc": FC, "sigma0": SIGMA0, "offset": 0.0}
    size = {"Fc": FC, "sigma0": SIGMA0, "offset": FC}
    rows = np.arange(len(values)) * 100
    value = {n: np.full(len(values), one) for n, one in steady.items()} | {"Fc": FC * values}
    return Cycles(value, {n: np.full(len(values), error * s) for n, s in size.items()}, rows)


def drifts(times: float) -> bool:
    """Student's t of a trend of 20 cycles, of a chance of 0.005 in 20 and to either side."""
    trend = np.linspace(-0.5, 0.5, 20)
    rest = UNEVEN[:20] - trend * (trend @ UNEVEN[:20]) / (trend @ trend)
    spread = np.sqrt(rest @ rest / 18 / (trend @ trend))
    return any(
        "drifts" in one.text
        for one in drift.findings(cycles_of(1 + 0.2 * (trend + rest / spread / times)))
    )


def is_odd(errors: float) -> bool:
    """In robust standard errors of the others."""
    wobble = 0.02 * np.random.default_rng(1).permutation(np.linspace(-1, 1, 401))
    wobble[200] = errors * 1.4826 * 0.01
    return any("disagrees" in one.text for one in drift.findings(cycles_of(1 + wobble)))


def odd_ones_claim(count: int) -> bool:
    """Of 100 cycles."""
    values = 1 + 1e-3 * np.resize([1.0, -1.0], 100)
    values[2 : 2 + 9 * count : 9] += 0.3
    return not any(one.doubts for one in drift.findings(cycles_of(values)))


def reads_in_step(part: float = 0.9, turns: int = 9, rows: int = 100) -> bool:
    """Cycles of which a part has the counts of the one before."""
    one = np.round(50 * np.sin(2 * np.pi * np.arange(rows) / rows))
    inner = np.flatnonzero(np.abs(one) < 49)
    other = one.copy()
    other[inner[: round((1 - part) * rows)]] += 7
    theta = np.concatenate([(one, other)[k % 2] for k in range(turns)])
    return in_step.period_of(Log("x", theta, theta, resolution=1.0), 30.0) > 0


def mostly(share: float, kept: float, other: float, rows: int = 10_000) -> np.ndarray:
    """A column in which a share of the rows, evenly spread, has another value."""
    place = np.arange(rows)
    return np.where(np.floor((place + 1) * share) > np.floor(place * share), other, kept)


def repeats(share: float) -> bool:
    again = mostly(share, 0, 1) > 0
    moves = np.where(again, 0.0, 1.0)
    torque = np.cumsum(np.where(again, 0.0, noise_of(1, 10_000)))
    return recording.without_repeats(Log("x", np.cumsum(moves), torque)).rows < 10_000


def noiseless(part: float) -> bool:
    """Second differences of a torque of range 1."""
    return recording._noiseless(
        np.append(np.cumsum(np.cumsum(np.resize([1, -1], 999))) * part, 1.0) / 1
    )


def jumps_after_rests(counts: float) -> bool:
    theta = np.repeat(np.arange(400.0), 3) * counts
    return recording.without_stale_angles(Log("x", theta, theta, resolution=1.0)).rows < 1200


def travels_by_jumps(part: float) -> bool:
    """The rest of the travel row by row."""
    moves = np.concatenate((np.tile([0, 0, 12.0 * part], 300), np.full(300, 12.0 * (1 - part))))
    theta = np.cumsum(moves)
    return recording.without_stale_angles(Log("x", theta, theta, resolution=1.0)).rows < 1200


def wraps(moves: int) -> bool:
    """A counter that goes through its range in so many."""
    return bool(recording.wraps_of(np.tile(np.linspace(0, 1, moves + 1), 5)).any())


def wraps_at_a_turn(off: float) -> bool:
    theta = np.resize([0.0, 2 * np.pi / (1 + off)], 9)
    return recording.period_of(Log("x", theta, theta), np.ones(8, dtype=bool)) > 0


def told_by_readings(steps: int) -> bool:
    torque = np.repeat(np.random.default_rng(1).normal(size=steps + 2), 5)
    return len(recording.torque_readings(torque)) > 0


def comes_evenly(share: float) -> bool:
    rows = mostly(1 - share, 20.0, 27.0, 1000)
    return recording._evenly(np.cumsum(rows)) is True


def by_edges(share: float) -> bool:
    theta = np.cumsum(mostly(1 - share, 1.0, 2.0))
    return recording.by_event(Log("x", theta, theta, resolution=1.0))


def clips(share: float = 0.5, rows: int = 10_000, moving: float = 1.0, runs: float = 1.0) -> bool:
    """A noisy torque at one extreme for a share of the rows."""
    torque, count = noise_of(1, rows), round(share * rows)
    there = np.arange(count) + rows // 4
    apart = mostly(1 - runs, 0, 1, count).astype(int)
    there = there + np.cumsum(apart)
    theta = np.cumsum(np.ones(rows))
    theta[there[: round((1 - moving) * count)]] = theta[there[0]]
    torque[there] = 9.0
    try:
        clean._refuse_clipped(Log("x", theta, torque))
    except Error:
        return True
    return False


def is_steadied(flickers: int) -> bool:
    with pytest.MonkeyPatch.context() as patch:
        looks: list = []
        patch.setattr(clean, "flickers", lambda _: flickers)
        patch.setattr(pipeline, "_first", lambda *_: looks.append(1) or SimpleNamespace(sse=1))
        pipeline._steadied([good().raw[0]], pipeline.Options())
    return bool(looks)


def is_flat(times: float) -> bool:
    """Between reversals a band around 0 takes so many times the travel of those beside it."""
    way = np.array([-1, -0.1, 0.1, 1])
    spread = np.concatenate(([0], np.cumsum([0.9, 0.2 * times, 0.9])))
    theta = np.concatenate([np.linspace(0, spread[-1], 400), np.linspace(spread[-1], 0, 400)] * 4)
    up = np.interp(np.linspace(0, spread[-1], 400), spread, way)
    ratio = np.tile(np.concatenate((up, -up)), 4)
    log = Log("x", theta, ratio)
    return clean.backlash(log, ratio, np.arange(400, 3200, 400))[0] > 0


def coarser_is_believed(steps: float) -> bool:
    up = np.arange(int(steps) + 1.0)
    return bool(grid.finding(Log("x", up, up, resolution=0.5)))


def a_grid_is_another(off: float) -> bool:
    theta = np.round(sine(1) / COUNT) * COUNT
    return bool(grid.finding(Log("x", theta, theta, resolution=COUNT * (1 + off))))


def other_unit(bits: float) -> bool:
    """An encoder of so many bits in deg, taken for rad."""
    try:
        grid.refuse(Log("x", UNEVEN, UNEVEN, resolution=np.degrees(2 * np.pi / 2 ** int(bits))))
    except Error:
        return True
    return False


def late_is_looked_at(rows: float, module: object, **changed: object) -> bool:
    """A delay, where nothing else speaks for a filter or a play."""
    with pytest.MonkeyPatch.context() as patch:
        asked: list = []
        patch.setattr(lowpass, "is_better", lambda *_: False)
        patch.setattr(lowpass, "_bent_otherwise", lambda *_: asked.append(1) or True)
        patch.setattr(play, "_best", lambda *_: asked.append(1) or (SimpleNamespace(squares=0), 0))
        patch.setattr(play, "_disagrees", lambda *_: False)
        module.finding(replace(good(), delay=rows, **changed))
    return bool(asked)


def looks_swapped(part: float = 0.1, left: float = 0.5) -> bool:
    """So much is left unexplained; the other way round a part of that."""
    spread = iter([1.0, 1.0])
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(pipeline.fit, "spread_of", lambda _: next(spread))
        patch.setattr(pipeline.fit, "point", lambda *_: SimpleNamespace(sse=part * left))
        try:
            pipeline._refuse_swapped(
                [good().logs[0]], None, SimpleNamespace(sse=left), pipeline.Options()
            )
        except Error:
            return True
    return False


def is_a_word(change: float, name: str) -> bool:
    """How much a parameter has to change by, over the log."""
    cycles = cycles_of(np.ones(20))
    scale = {"Fc": FC, "sigma0": SIGMA0, "offset": FC}[name]
    cycles.value[name] = cycles.value[name] + scale * change * np.linspace(-0.5, 0.5, 20)
    return bool(drift.findings(cycles))


def clock_in_ms(step: float) -> bool:
    columns = {"t": np.arange(9.0) * step, "angle_rad": np.arange(9.0), "torque_Nm": np.arange(9.0)}
    notes = readers._log("x.csv", readers.Source(), {n: n for n in columns}, columns).notes
    return any("ms?" in note for note in notes)


def plan_is_left(r2: float) -> bool:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(plan_quality, "r2_on_raw", lambda *_: r2)
        return not plan_quality.of(good()).against


def is_filtered_unclocked(reversals: int) -> bool:
    unclocked = [replace(log, time=None) for log in good().logs]
    return late_is_looked_at(5.0, lowpass, logs=unclocked, reversals=reversals)


def takes_turns(lost: int) -> bool:
    """Of 1000 angles so many have no torque: the others have theirs as it came, a bit later."""
    angle = np.arange(1000.0)
    late = np.delete(angle, np.arange(5, 5 + 3 * lost, 3)) + 0.5
    return bool((readers._torque_at(angle, late, late)[1] % 1 == 0.5).all())


THRESHOLDS: dict[str, tuple[Callable[..., bool], float, bool]] = {
    # name: what is asked of a number; the threshold; whether the answer below it is yes
    "strokes of one speed": (one_speed, 1.3, True),
    "strokes that turn at one angle": (same_angle, 0.5, True),
    "strokes that tell": (enough_strokes, 4, False),
    "rows too long to shift by parts": (between_rows, 0.3, False),
    "what widens an interval": (widens, 0.2, False),
    "turning points between the rows": (turns_between, 0.02, False),
    "steps of the torque": (steps_show, 0.2, False),
    "levels of a torque in steps": (levels_tell, 4, True),
    "noise of an angle in presliding lengths": (noise_shows, 1e-3, False),
    "noise of an angle in counts": (functools.partial(noise_shows, 0.1), 0.3, False),
    "noise of an angle in intervals": (noise_moves, 0.5, False),
    "noise too large for a trial": (much_noise, 0.06, False),
    "differences of noise alternate": (alternates, -0.3, False),
    "a curve beyond chance": (curve_is_clear, 3.0, False),
    "a curve that explains more": (lambda x: curve_is_clear(part=x), 0.05, False),
    "a curve that changes a parameter": (curve_matters, 0.02, False),
    "a curve of enough rows": (curve_is_tried, 14 * 6, False),
    "a slope beyond chance": (load_is_followed, 3.0, False),
    "a slope that pays": (lambda x: load_is_followed(pays=x), 0.03, False),
    "a model beyond chance": (explains_more, 2.0, False),
    "a model that explains more": (lambda x: explains_more(part=x), 0.05, False),
    "a speed beyond chance": (falls_with_speed, 3.0, False),
    "a model instead of a delay": (does_without_delay, 0.1, False),
    "a filter beyond chance": (filter_is_better, 4.0, False),
    "a delay that may be a filter": (lambda x: late_is_looked_at(x, lowpass), 0.3, False),
    "a delay that may be a play": (lambda x: late_is_looked_at(x, play), 0.3, False),
    "a trend beyond chance": (drifts, float(student.ppf(1 - 0.005 / 2 / 20, 18)), False),
    "an odd cycle": (is_odd, 6.0, False),
    "odd cycles without a claim": (odd_ones_claim, 11, True),
    "a change of Fc": (lambda x: is_a_word(x, "Fc"), 0.03, False),
    "a change of sigma0": (lambda x: is_a_word(x, "sigma0"), 0.1, False),
    "a change of the offset": (lambda x: is_a_word(x, "offset"), 0.05, False),
    "rows in step": (reads_in_step, 0.5, False),
    "turns of a motion in step": (lambda x: reads_in_step(turns=x), 4, False),
    "rows of a cycle in step": (lambda x: reads_in_step(rows=int(x)), 3001, True),
    "repeated rows": (repeats, 0.01, False),
    "a torque without noise": (noiseless, 1e-4, True),
    "jumps of a held angle": (jumps_after_rests, 1.5, False),
    "travel of a held angle": (travels_by_jumps, 0.5, False),
    "readings of a held torque": (told_by_readings, 12, False),
    "readings at even rows": (comes_evenly, 0.9, False),
    "rows at the edges of an encoder": (by_edges, 0.9, False),
    "rows of a clipped torque": (clips, 0.02, False),
    "number of clipped rows": (lambda x: clips(x / 200, 200), 21, False),
    "clipped rows that move": (lambda x: clips(moving=x), 0.25, False),
    "clipped rows in a run": (lambda x: clips(runs=x), 0.7, False),
    "a flat band of torque": (is_flat, 2.5, False),
    "steps of a coarser grid": (coarser_is_believed, 20, False),
    "a grid that is another": (a_grid_is_another, 0.01, False),
    "bits of an encoder": (other_unit, 8, False),
    "most bits of an encoder": (other_unit, 27, True),
    "what is left of swapped columns": (looks_swapped, 0.3, True),
    "a fit that may be swapped": (lambda x: looks_swapped(left=x), 0.2, False),
    "r2 of a plan": (plan_is_left, 0.9, False),
    "reversals without a clock": (is_filtered_unclocked, 8, False),
    "frames that take turns": (takes_turns, 11, True),
    "moves of a counter that wraps": (wraps, 17, False),
    "a period of a turn": (wraps_at_a_turn, 0.01, True),
    "an angle that flickers": (is_steadied, 9, False),
}


@pytest.fixture(scope="module")
def made(library) -> None:
    """It is made before anything is replaced."""
    good()


@pytest.mark.parametrize("name", THRESHOLDS)
@pytest.mark.usefixtures("made")
def test_both_sides_of(name):
    ask, limit, below = THRESHOLDS[name]
    apart = 0.04 * abs(limit)
    low, high = (limit - 1, limit) if isinstance(limit, int) else (limit - apart, limit + apart)
    assert (ask(low), ask(high)) == (below, not below)
