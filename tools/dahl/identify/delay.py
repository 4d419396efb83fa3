# SPDX-License-Identifier: MIT
"""How late the torque is: delays far and near are tried, each with an a of its own, and those that
explain the cycles as well as the best are all plausible.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from dahl.identify.choices import Trial, fitted
from dahl.identify.cycles import Cut, excess, jackknife
from dahl.identify.terms import TIMED

FAR = (1, 2, 3, 5, 8, 12, 18, 27, 40, 60, 90)  # rows, both ways
HALVINGS, VERTICES, LEAST = 2, 2, 0.01  # steps to the best delay; rows
SKEW = 0.3  # rows; below it two channels are taken as read together
GIVE_UP, CLEARLY = 2, 3.0  # delays in a row; standard errors
LONGEST = float(FAR[-1])


def tried(cut: Cut, trials: Sequence[Trial], least: float = SKEW) -> list[Trial]:
    """Trials with a delay, from the best of `trials`, which have none, that lacks what resembles
    one: viscous friction, inertia and parts that drive the motion; `least` is in rows.
    """
    free = [one for one in trials if not one.active and TIMED.isdisjoint(one.choice.terms)]
    if not free:
        return []
    start = min(free, key=lambda trial: float(trial.cost.sum()))
    far = [*_walk(cut, start, 1), *_walk(cut, start, -1)]
    found = far + _closer(cut, [start, *far])
    return [trial for trial in found if abs(trial.choice.delay) >= least]


def _walk(cut: Cut, base: Trial, side: int) -> list[Trial]:
    """Farther and farther, each from the a that the one before found, until it has become worse
    GIVE_UP times, clearly.
    """
    found, best, worse = list[Trial](), base, 0
    for rows in FAR:
        trial = fitted(cut, (found or [base])[-1].a, replace(base.choice, delay=float(side * rows)))
        if trial is None:
            break
        found.append(trial)
        more, error = excess(trial.cost, best.cost)
        worse = worse + 1 if more > CLEARLY * error else 0
        best = trial if more < 0 else best
        if worse == GIVE_UP:
            break
    return found


def _closer(cut: Cut, trials: list[Trial]) -> list[Trial]:
    """Between the best delay and its neighbours, halving the distance, then where a parabola
    through them is lowest.
    """
    added: list[Trial] = []
    for step in range(HALVINGS + VERTICES):
        near = sorted([*trials, *added], key=lambda trial: trial.choice.delay)
        best = int(np.argmin([float(trial.cost.sum()) for trial in near]))
        around = near[max(best - 1, 0) : best + 2]
        here = near[best].choice.delay
        places = [(here + one.choice.delay) / 2 for one in around if one is not near[best]]
        if step >= HALVINGS:
            places = _vertex(around)
        for delay in places:
            trial = fitted(cut, near[best].a, replace(near[best].choice, delay=delay))
            if trial is not None:
                added.append(trial)
    return added


def _vertex(around: Sequence[Trial]) -> list[float]:
    """Where the cost is lowest, from three delays; nothing at the end of the search or where that
    is known already.
    """
    delays = [trial.choice.delay for trial in around]
    if len(delays) < 3:
        return []
    bend, slope, _ = np.polyfit(delays, [float(trial.cost.sum()) for trial in around], 2)
    place = -slope / (2 * bend) if bend > 0 else delays[1]
    inside = delays[0] < place < delays[2]
    return [float(place)] if inside and abs(place - delays[1]) > LEAST else []


def standard_error(trials: Sequence[Trial], taken: Trial) -> float:
    """Of the delay that was taken, rows: by the best one beside it when each cycle is left out; 0
    where none was taken.
    """
    at = taken.choice
    alike = (one for one in trials if one.choice == replace(at, delay=one.choice.delay))
    same = {one.choice.delay: one for one in alike}
    near = sorted(same.values(), key=lambda one: abs(one.choice.delay - taken.choice.delay))[:3]
    if taken.choice.delay == 0 or len(near) < 3:
        return 0.0
    delays = [one.choice.delay for one in near]
    costs = np.array([one.cost for one in near])
    rest = costs.sum(axis=1, keepdims=True) - costs  # (3, cycles), without each cycle
    bend, slope, _ = np.polyfit(delays, rest, 2)
    places = np.clip(-slope / (2 * bend), min(delays), max(delays))
    return jackknife(np.where(bend > 0, places, taken.choice.delay))


def at_the_end(trials: list[Trial]) -> bool:
    """Whether the best delay is the longest that was tried."""
    best = min(trials, key=lambda trial: float(trial.cost.sum()))
    return abs(best.choice.delay) >= LONGEST
