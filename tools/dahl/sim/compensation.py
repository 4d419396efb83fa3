# SPDX-License-Identifier: MIT
"""Compare laws of friction compensation on two simulated axes: one with a position loop, one that
a hand leads along a path. Each law has at most one free parameter, its knob. tune() sets the knobs
of all laws by the same procedure.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cache

from dahl.sim.compensation_axis import FC, Case, Run, learn, run

TUNING_SEED, LEARNING_SEED = 10**6, 2 * 10**6  # apart from the seed of the comparison
TUNING_FC = (0.7, 1.0, 1.3)  # assumed over true
TUNING_HOLD_S = 10.0
NOISE_SHARE, NOISE_FLOOR = 1.1, 0.02 * FC  # bound of the noise: of that without a law, and N m
OTHER_MOTION = 0.2  # share of the third harmonic in the motion of `learned elsewhere`

POSITION_CASES = (
    Case("17 bits"),
    Case("14 bits, noise 2", 14, noise=2),
    Case("14 bits, noise 2, delay 3", 14, noise=2, delay=3),
    Case("17 bits, integral", loop="PID"),
    Case("17 bits, cascade", loop="cascade"),
    Case("14 bits, noise 2, cascade", 14, noise=2, loop="cascade"),
    Case("Fc 10 % low", Fc=0.9),
    Case("Fc 10 % high", Fc=1.1),
    Case("Fc 30 % low", Fc=0.7),
    Case("Fc 30 % high", Fc=1.3),
    Case("Fc 30 % low, cascade", Fc=0.7, loop="cascade"),
    Case("Fc 30 % high, cascade", Fc=1.3, loop="cascade"),
    Case("Fc fell by 30 %", fallen_to=0.7),
    Case("sigma0 / 3", sigma0=1 / 3),
    Case("sigma0 x 3", sigma0=3),
    Case("LuGre with Stribeck", friction="LUGRE"),
    Case("Maxwell slip", friction="MAXWELL"),
    Case("10 mrad to and fro", amplitude=0.005),
)
_HAND = Case("", loop="hand", second=0.2)
HAND_CASES = (
    replace(_HAND, name="17 bits, noise 1"),
    replace(_HAND, name="14 bits, noise 2, delay 3", bits=14, noise=2, delay=3),
    replace(_HAND, name="12 bits, noise 1", bits=12),
    replace(_HAND, name="Fc 30 % low, sigma0 / 4", bits=14, Fc=0.7, sigma0=0.25),
    replace(_HAND, name="LuGre with Stribeck", friction="LUGRE"),
    replace(_HAND, name="Maxwell slip, sigma0 / 3", friction="MAXWELL", sigma0=1 / 3),
    replace(_HAND, name="5 mrad to and fro", bits=14, noise=2, amplitude=0.0025),
)
CASES = {"position": POSITION_CASES, "hand": HAND_CASES}
SHOWN_POSITION, SHOWN_HAND = POSITION_CASES[-1], HAND_CASES[-1]  # cases of the picture


@dataclass(frozen=True)
class Law:
    """A law of compensation."""

    kind: str  # in law_t
    knobs: tuple[float, ...] = (0.0,)  # that tune() tries
    needs_reference: bool = False


CORNERS = (3.0, 5.0, 8.0, 11.0, 15.9)  # Hz; the rule of stability of the observers ends there
ONE_OR_TWO_POLES = (*CORNERS, *(-corner for corner in CORNERS))  # rivals.c
LEARNED = Law("LEARNED", (5.0, 10.0, 20.0, 40.0, 60.0), needs_reference=True)  # Hz
ELSEWHERE = "learned elsewhere"
LAWS = {
    "none": Law("NONE"),
    "sign": Law("SIGN"),
    "tanh": Law("TANH", (0.01, 0.03, 0.1, 0.3, 1.0, 3.0)),  # rad/s
    "dead band": Law("DEAD_BAND", (0.05, 0.1, 0.2, 0.3, 0.4, 0.8)),  # rad/s
    "reversal rule": Law("REVERSAL", (0.01, 0.02, 0.03, 0.04, 0.05, 0.07), True),  # s
    "learned": LEARNED,
    ELSEWHERE: LEARNED,
    "LuGre observer": Law("LUGRE", (5.0, 10.0, 20.0, 40.0, 80.0, 150.0, 300.0)),  # Hz
    "disturbance observer": Law("DISTURBANCE", ONE_OR_TWO_POLES, needs_reference=True),
    "dahl": Law("DAHL"),
    "dahl + observer": Law("DAHL_OBSERVER", CORNERS, needs_reference=True),
}


def laws_of(axis: str) -> dict[str, Law]:
    """Return the laws of an axis by name; "none" is first."""
    return {
        name: law for name, law in LAWS.items() if axis == "position" or not law.needs_reference
    }


def setting_of(case: Case) -> Case:
    """Return the case to which laws are tuned: loop, encoder and delay of a case, with Dahl's
    friction and the motion of the case `17 bits`, or of a hand.
    """
    usual = Case("", hold_s=TUNING_HOLD_S, second=case.second)
    return replace(usual, bits=case.bits, noise=case.noise, delay=case.delay, loop=case.loop)


@cache
def tune(setting: Case, law: Law) -> float:
    """Return the knob with the least mean RMS error for an Fc that is 30 % low, right and 30 %
    high, among those within the bound of noise at rest. If none is, return the one with the least
    noise.
    """
    if len(law.knobs) == 1:
        return law.knobs[0]
    bound = NOISE_SHARE * run(setting, "NONE", 0.0, TUNING_SEED).noise + NOISE_FLOOR
    found = []
    for knob in law.knobs:
        runs = [run_law(replace(setting, Fc=Fc), law, knob, TUNING_SEED) for Fc in TUNING_FC]
        loudest = max(one.noise for one in runs)
        found.append((max(bound, loudest), sum(one.rms for one in runs), knob))
    return min(found)[2]


def run_law(case: Case, law: Law, knob: float, seed: int, is_elsewhere: bool = False) -> Run:
    """Run a law. `learned` learns with other noise before, with is_elsewhere in another motion."""
    if law is not LEARNED:
        return run(case, law.kind, knob, seed)
    lesson = replace(case, name="", Fc=1.0, sigma0=1.0, hold_s=0.0, fallen_to=1.0)
    lesson = replace(lesson, second=OTHER_MOTION) if is_elsewhere else lesson
    return run(case, law.kind, knob, seed, _learn(lesson, knob, LEARNING_SEED + seed))


_learn = cache(learn)


Numbers = dict[str, dict[str, dict[str, dict[str, float]]]]  # by axis, case, law and name


@dataclass(frozen=True)
class Comparison:
    """All numbers; the runs of the two cases of the picture by law."""

    numbers: Numbers
    position: dict[str, Run]
    hand: dict[str, Run]


def count_steps() -> int:
    """Return how often compare() calls progress()."""
    return len(_tunings()) + sum(len(laws_of(axis)) * len(cases) for axis, cases in CASES.items())


def compare(seed: int = 1, progress: Callable[[], None] = lambda: None) -> Comparison:
    """Tune each law, then run it in each case. Call progress() after each step. The numbers of a
    law:

    rms     RMS of the tracking error in rad, or of the torque of the hand in N m, in the motion
    ratio   rms over that without a law
    hold    largest of these errors in the last 15 s of a hold of 30 s
    noise   standard deviation of the motor torque in N m, in the same time
    knob    the tuned value; 0 if the law has none
    sign_changes_per_s  of the added torque in the hold; only with a position loop
    """
    numbers: Numbers = {axis: {} for axis in CASES}
    shown: dict[str, dict[str, Run]] = {}
    jobs = [(axis, case, seed) for axis, cases in CASES.items() for case in cases]
    with ThreadPoolExecutor(os.cpu_count()) as pool:  # a run releases the lock of Python
        for _ in pool.map(tune, *zip(*_tunings(), strict=True)):  # before a case needs it
            progress()
        for (axis, case, _), (found, runs) in zip(jobs, pool.map(_run_case, jobs), strict=True):
            numbers[axis][case.name] = found
            for _ in found:
                progress()
            shown[axis] = runs  # of the last case
    return Comparison(numbers, **shown)


def _tunings() -> list[tuple[Case, Law]]:
    """Return each setting with each of its laws once."""
    pairs = [
        (setting_of(case), law)
        for axis, cases in CASES.items()
        for case in cases
        for law in laws_of(axis).values()
    ]
    return list(dict.fromkeys(pairs))


def _run_case(job: tuple[str, Case, int]) -> tuple[dict[str, dict[str, float]], dict[str, Run]]:
    """Return numbers and runs of all laws. The runs are kept for the cases of the picture only."""
    axis, case, seed = job
    knobs = {name: tune(setting_of(case), law) for name, law in laws_of(axis).items()}
    runs = {
        name: run_law(case, LAWS[name], knob, seed, name == ELSEWHERE)
        for name, knob in knobs.items()
    }
    found = {
        name: _numbers(axis, one, runs["none"]) | {"knob": knobs[name]}
        for name, one in runs.items()
    }
    return found, runs if case in (SHOWN_POSITION, SHOWN_HAND) else {}


def _numbers(axis: str, trace: Run, without: Run) -> dict[str, float]:
    found = {"rms": trace.rms, "ratio": trace.rms / without.rms}
    found |= {"hold": trace.hold, "noise": trace.noise}
    if axis == "position":  # a hand does not hold the counts of the encoder still
        found["sign_changes_per_s"] = trace.sign_changes_per_s
    return found
