# SPDX-License-Identifier: MIT
"""Laws of identification and of `dahl excite`: what a change of units, sign, origin, clock or order
of the logs must do to the result, and must not.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

import identify_cases as made
import numpy as np
import pytest
from dahl.identify.log import Log
from hypothesis import strategies as st
from identify_cases import FC, SIGMA0, A, of
from identify_tools import COUNT, complaint, dahl_torque, noise_of, seen, sine, springs
from law_tools import holds, modes

pytestmark = pytest.mark.usefixtures("library")

KINDS: dict[str, Callable[[], Log]] = {
    "plain": lambda: made.plus(made.shaft(1, 0.05, rows=1500, cycles=6), 0.1),
    "late": lambda: made.late(-8, noise=0.05, count=2000),
    "spikes": lambda: made.spiked(60, torque=3.0),
    "slips": lambda: of(TWO, springs(TWO, (90, 0.15), (30, 0.3)), 0.01),
    "drifts": lambda: made.drifting(Fc=0.2 * made.ramp(2000), rows=2000, cycles=8),
    "backlash": lambda: made.played(0.01, 0.3, rows=2000),
    "in steps": lambda: made.in_steps(4, 0.0),
    "no clock": lambda: made.without_clock(made.shaft(2)),
}
TWO = sine(2, rows=2000, cycles=8)
seeds = st.integers(0, 10_000)
factors = st.floats(-2, 2).map(lambda power: float(10**power))
signs = st.sampled_from((1.0, -1.0))


@cache
def usual(kind: str) -> dict[str, Any]:
    return seen(KINDS[kind](), trust_units=True)


def agree(one: dict[str, Any], other: dict[str, Any], sigma0: float, Fc: float) -> None:  # noqa: N803
    """`other` is `one` with its parameters, intervals and offset times these factors."""
    for name, factor in (("sigma0", sigma0), ("Fc", Fc)):
        assert other[name] == pytest.approx(factor * one[name], rel=1e-4)
        ends = [end and factor * end for end in one["ci95"][name]]
        assert other["ci95"][name] == pytest.approx(ends, rel=1e-3)
    for name in ("identifiable", "model", "rows", "reversals", "median_rows", "pieces"):
        assert other[name] == one[name], name
    assert list(other["extra"]) == list(one["extra"])
    for name in ("r2", "r2_plan", "delay_rows"):
        assert other[name] == pytest.approx(one[name], abs=1e-3), name
    doubts = [[found["doubts"] for found in facts["findings"]] for facts in (one, other)]
    assert doubts[0] == doubts[1]
    assert len(other["plan"]["against"]) == len(one["plan"]["against"])


@pytest.mark.parametrize("kind", KINDS)
@modes(short=2, long=20)
def test_units_signs_and_origins_change_nothing_else(kind, examples):
    """Torque and angle in other units scale both parameters; a slower clock, another origin of the
    angle and the clock, the mirror image and the sign of the torque sensor change nothing.
    """

    def law(  # noqa: PLR0913 - all at once, each may be alone
        torque: float,
        angle: float,
        clock: float,
        mirror: float,
        sign: float,
        counts: int,
        later: float,
    ) -> None:
        log = KINDS[kind]()
        turned = replace(
            log,
            theta=mirror * angle * (log.theta + counts * log.resolution),
            resolution=angle * log.resolution,
            torque=mirror * sign * torque * log.torque,
            time=None if log.time is None else clock * log.time + later,
        )
        facts = seen(turned, trust_units=True)
        agree(usual(kind), facts, torque / angle, torque)
        assert facts["torque_sign"] == sign * usual(kind)["torque_sign"]
        offset = usual(kind)["extra"].get("offset", 0.0)
        turned_offset = mirror * torque * offset
        assert facts["extra"].get("offset", 0.0) == pytest.approx(turned_offset, rel=1e-3, abs=1e-6)

    later = st.floats(0, 1e3)
    ways = (factors, factors, factors, signs, signs, st.integers(-9999, 9999), later)
    holds(law, examples, *ways)


@modes(short=2, long=12)
def test_the_order_of_the_logs_does_not_matter(examples):
    def law(seed: int) -> None:
        logs = [made.shaft(seed + k, 0.05, rows=1500, cycles=5) for k in (0, 1)]
        agree(seen(*logs, trust_units=True), seen(*logs[::-1], trust_units=True), 1.0, 1.0)

    holds(law, examples, seeds)


@modes(short=4, long=30)
def test_coulomb_alone_says_nothing_about_sigma0(examples):
    """A torque that is a bare sign: Fc is found, sigma0 never claimed."""

    def law(seed: int, part: float) -> None:
        theta = np.floor(sine(seed, rows=1500, cycles=6) / COUNT) * COUNT
        moves = np.diff(theta, prepend=theta[0])
        moving = np.maximum.accumulate(np.where(moves != 0, np.arange(1500), 0))
        torque = FC * (np.sign(moves)[moving] + part * noise_of(seed, 1500))
        facts = seen(Log("coulomb", theta, torque, resolution=COUNT), trust_units=True)
        assert not facts["identifiable"]["sigma0"] and facts["ci95"]["sigma0"][1] is None
        assert facts["Fc"] == pytest.approx(FC, rel=0.1)

    holds(law, examples, seeds, st.floats(0.02, 0.2))


@modes(short=6, long=60)
def test_the_step_of_an_encoder_is_found(examples):
    """Of any size, over a small or a large range, also where angles were printed with few digits:
    it is the one that a plan is made for.
    """

    def law(counts: int, size: float, digits: int) -> None:
        step = 0.05 * 2 / counts
        theta = np.round(sine(1, rows=900, cycles=5) / step) * step
        printed = np.round(theta / step, digits) * step
        log = Log("", size * printed, dahl_torque(theta), resolution=size * step)
        grid = seen(log, terms=(), delay=False, trust_units=False)
        assert not any("grid" in found["text"] for found in grid["findings"])
        other = seen(replace(log, resolution=1.1 * size * step), terms=(), delay=False)
        assert any("grid" in found["text"] for found in other["findings"])

    holds(law, examples, st.integers(60, 400), st.floats(0.03, 3.0), st.integers(6, 12))


# --- the design of an experiment ------------------------------------------------------------------

ROWS_OF_A_LENGTH, LEAST_COUNTS, MARGIN, FEWEST = 8, 4, 1.5, 6


def proposed(run, **words: float) -> dict[str, Any]:
    """What `dahl excite` prints of a motion, and the motion that it leaves."""
    said = [part for key, value in words.items() for part in (f"--{key.replace('_', '-')}", value)]
    done = run("excite", *said, "-o", "out")
    assert done.returncode == 0, done.stderr
    numbers = [float(word) for word in re.findall(r"(?<= )\d[\d.]*(?=\s|$)", done.stdout)]
    least, most, cycles, cycle, _, reversals, seconds, rows, sigma0, Fc = numbers[:10]  # noqa: N806
    table = np.loadtxt("out/excite.csv", delimiter=",", skiprows=1)
    shown = {"least": least, "most": most, "cycles": cycles, "cycle": cycle, "rows": rows}
    shown |= {"reversals": reversals, "seconds": seconds, "within": (sigma0, Fc)}
    return {**shown, "time": table[:, 0], "theta": table[:, 1]}


def bound(sigma0: float, Fc: float, count: float, noise: float, amplitude: float, rows: int):  # noqa: N803
    """Half widths of 95 %, as parts of sigma0 and Fc, that one cycle of a sine can reach beside an
    offset, a spring and a viscous part (Cramer and Rao), with the rounding of the encoder as noise.
    """
    theta = amplitude * np.sin(2 * np.pi * np.arange(3 * rows) / rows)
    moves = np.diff(theta, prepend=0)

    def change(one: float, other: float) -> np.ndarray:
        up = dahl_torque(theta, sigma0 * (1 + one), Fc * (1 + other))
        return (up - dahl_torque(theta, sigma0 * (1 - one), Fc * (1 - other))) / 2e-3

    x = np.column_stack((change(1e-3, 0), change(0, 1e-3), np.ones(3 * rows), theta, moves))
    slope = sigma0 * (1 - np.sign(moves) * dahl_torque(theta, sigma0, Fc) / Fc)
    variance = (noise * Fc) ** 2 + (slope * count) ** 2 / 12
    x = (x / np.sqrt(variance)[:, None])[2 * rows :]
    return 1.96 * np.sqrt(np.diag(np.linalg.inv(x.T @ x)))[:2]


@pytest.mark.parametrize(
    ("noise", "within", "rate", "speed"), [(0.04, 2.0, 500.0, 0.2), (0.05, 1.0, 1000.0, None)]
)
def test_a_motion_reaches_what_its_bound_allows(dahl, noise, within, rate, speed):
    """As many cycles as the interval needs and half as many again, of the amplitude that takes the
    least time, no faster than is allowed and than eight rows in a presliding length.
    """
    words = {"sigma0": SIGMA0, "fc": FC, "counts_per_turn": 16384, "noise": noise}
    words |= {"within": within, "rate": rate} | ({"speed": speed} if speed else {})
    shown = proposed(dahl, **words)
    fastest = min(speed or np.inf, rate / (A * ROWS_OF_A_LENGTH))
    times = {}
    for amplitude in np.geomspace(3, 30, 12) / A:
        rows = int(np.ceil(2 * np.pi * amplitude / fastest * rate))
        one = bound(SIGMA0, FC, COUNT, noise, amplitude, rows)
        cycles = max(int(np.ceil(MARGIN * (100 * one[0] / within) ** 2)), FEWEST)
        times[cycles * rows] = (amplitude, rows, cycles, 100 * one / np.sqrt(cycles))
    amplitude, rows, cycles, reached = times[min(times)]
    theta = shown["theta"]
    assert (shown["most"], shown["cycles"]) == (pytest.approx(amplitude, rel=1e-3), cycles)
    assert shown["cycle"] == pytest.approx(rows / rate, rel=1e-3)
    assert shown["within"] == pytest.approx(reached, rel=0.06)
    assert np.abs(theta).max() == pytest.approx(amplitude, rel=1e-3)
    assert np.abs(np.diff(theta)).max() * rate <= 1.01 * fastest
    turns = np.flatnonzero(np.diff(np.sign(np.diff(theta))))
    assert len(turns) == shown["reversals"] == 2 * cycles
    assert shown["rows"] == len(theta) - 1
    assert shown["seconds"] == pytest.approx(len(theta) / rate, rel=0.01)
    assert np.diff(shown["time"]) == pytest.approx(1 / rate, abs=2e-6)


def test_what_limits_a_motion(dahl):
    """Four counts in a presliding length at least, a million rows in a cycle at most, six cycles
    at least.
    """
    known = {"sigma0": SIGMA0, "fc": FC, "counts_per_turn": 16384}
    assert proposed(dahl, **known, within=90)["cycles"] == FEWEST
    for counts, refused in ((4.1, False), (3.9, True)):
        coarse = {**known, "counts_per_turn": counts * A * 2 * np.pi}
        words = [
            part for key, one in coarse.items() for part in (f"--{key.replace('_', '-')}", one)
        ]
        if refused:
            code, line = complaint(dahl("excite", *words))
            assert code == 2 and "3.9" in line and "4" in line
        else:
            proposed(dahl, **coarse, within=50)
    words = ("--sigma0", SIGMA0, "--fc", FC, "--counts-per-turn", 16384, "--speed", 1e-5)
    code, line = complaint(dahl("excite", *words))
    assert code == 2 and "9.42e+06" in line and "1000000" in line


@modes(short=3, long=60)
def test_more_noise_or_a_narrower_interval_takes_longer(dahl, examples):
    """And the torque's unit changes no motion."""

    def law(sigma0: float, Fc: float, noise: float, within: float) -> None:  # noqa: N803
        known = {"sigma0": sigma0, "fc": Fc, "counts_per_turn": 131072}
        usual = proposed(dahl, **known, noise=noise, within=within)
        assert usual["within"][0] <= 1.001 * within
        for harder in ({"noise": 2 * noise}, {"within": within / 2}):
            words = {"noise": noise, "within": within, **harder}
            assert proposed(dahl, **known, **words)["seconds"] >= usual["seconds"]
        louder = {**known, "sigma0": 8 * sigma0, "fc": 8 * Fc}
        other = proposed(dahl, **louder, noise=noise, within=within)
        assert other["theta"] == pytest.approx(usual["theta"], rel=1e-6, abs=1e-9)

    sizes = (st.floats(20, 400), st.floats(0.2, 2), st.floats(0.01, 0.1), st.floats(1, 5))
    holds(law, examples, *sizes)
