# SPDX-License-Identifier: MIT
"""All that may be chosen beside sigma0 and Fc (the terms, the delay of the torque, whether backlash
is travel), each choice fitted and scored by cycles left out.

The simplest choice within one standard error of the best is taken. All choices within it are
plausible, and the interval of a parameter goes over all of them: by how much a choice moves it, and
how surely, is known from the cycles.

A choice is fitted by Gauss and Newton: beside w stands its change with log a; what the fit takes of
it says how a has to change.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.stats import t as student

from dahl.identify import path
from dahl.identify.cycles import Cut, LeftOut, excess, jackknife, least_squares, left_out
from dahl.identify.fit import Estimate, Interval
from dahl.identify.terms import TERMS, places_of

APART = 0.02  # of log a: where the change with it is taken
STEPS, LONGEST = 6, 0.4  # of Gauss and Newton; of log a
RELUCTANT = 2.0  # standard errors: what is not there is not put in for less
PAYS, MUCH = 0.03, 1.4  # of a cost
DOUBT = 1 / 2  # of what another model makes a number move: it is but one of many
STILL = 2e-3  # of log a, from where on a step ends the search


@dataclass(frozen=True)
class Choice:
    """One way to see the logs."""

    terms: tuple[str, ...] = ()
    delay: float = 0.0  # rows, the torque late where above 0
    backlash: bool = False  # counted as travel, where the one that was cleaned leaves it out
    model: str = "Dahl"

    @property
    def size(self) -> int:
        """How much was put in."""
        return len(self.terms) + (self.delay != 0)

    @property
    def plain(self) -> bool:
        """Nothing beside friction but an offset."""
        return self.delay == 0 and not set(self.terms) - {"offset"}

    @property
    def kinds(self) -> dict[str, object]:
        """What was chosen, by the name under which a verdict speaks of it."""
        return {
            "the delay": self.delay,
            "the terms": self.terms,
            "the backlash": self.backlash,
            "the model": self.model,
        }


@dataclass
class Trial:
    """A choice with what it makes of the logs."""

    choice: Choice
    a: float
    value: dict[str, float]  # sigma0, Fc
    without: dict[str, np.ndarray]  # the same with each cycle left out, (cycles,)
    cost: np.ndarray  # (cycles,), each as it was left out
    plausible: bool = field(default=False, kw_only=True)
    step: float = 0.0  # of log a, that was still to go
    terms: dict[str, float] = field(default_factory=dict)  # N m (N) and so on
    errors: dict[str, float] = field(default_factory=dict)  # standard errors of the terms

    @classmethod
    def unscored(cls, choice: Choice, point: Estimate, plausible: bool) -> Trial:
        """A fit of all rows, of which no cycle was left out."""
        value = {name: float(getattr(point, name)) for name in ("sigma0", "Fc")}
        without = {name: np.array([number]) for name, number in value.items()}
        cost = np.array([point.sse])
        return cls(choice, point.a, value, without, cost, plausible=plausible, terms=point.terms)

    @property
    def active(self) -> bool:
        """Whether one of its terms drives the motion."""
        return any(value < 0 and TERMS[name].drives for name, value in self.terms.items())


def fitted(cut: Cut, a: float, choice: Choice) -> Trial | None:
    """Fit a choice, from a on; nothing where there is no friction in it."""
    last = None
    for _ in range(STEPS):
        grams = grams_at(cut, a, choice.delay)
        last = read(cut, grams, a, choice)
        if last is None or abs(last.step) < STILL:
            return last
        a *= float(np.exp(np.clip(last.step, -LONGEST, LONGEST)))
    return last


def grams_at(cut: Cut, a: float, delay: float) -> np.ndarray:
    """Of w, its change with log a and all terms, late by so many rows: (cycles, 7, 7)."""
    above, below = (cut.drawn(path.dahl, a * np.exp(side * APART)) for side in (1, -1))
    change = (above - below) / (2 * APART)
    columns = np.column_stack((cut.drawn(path.dahl, a), change, cut.terms))
    return cut.grams(cut.moved(columns, delay))


def columns_for(terms: Iterable[str]) -> list[int]:
    """Where w, its change, the terms and the torque stand."""
    return [0, 1, *(2 + place for place in places_of(terms)), -1]


def read(cut: Cut, grams: np.ndarray, a: float, choice: Choice) -> Trial | None:
    """A choice of terms from products at an a near its best; nothing where that is no friction, or
    where a term has a size that nothing has, such as a mass below 0.
    """
    used = columns_for(choice.terms)
    some = grams[:, used][:, :, used]
    best = least_squares(some.sum(axis=0))
    Fc, change = best[:2]  # noqa: N806
    sizes = zip(choice.terms, best[2:], strict=True)
    if not Fc > 0 or any(size < 0 and TERMS[term].impossible for term, size in sizes):
        return None
    result: LeftOut = left_out(some, cut.fold)
    step = float(change / Fc)
    part = result.found[:, 0]
    value = {"sigma0": a * (Fc + change), "Fc": float(Fc)}
    without = {"sigma0": a * (part + result.found[:, 1]), "Fc": part}
    named = dict(zip(choice.terms, map(float, best[2:]), strict=True))
    apart = dict(zip(choice.terms, map(jackknife, result.found[:, 2:].T), strict=True))
    return Trial(choice, a, value, without, result.cost, step, named, apart)


def of_terms(
    cut: Cut, a: float, sets: Sequence[tuple[str, ...]], delay: float = 0.0
) -> list[Trial]:
    """Each of these sets of terms."""
    tried = (fitted(cut, a, Choice(terms, delay)) for terms in sets)
    first = next((trial for trial in tried if trial is not None), None)
    if first is None:
        return []
    grams = grams_at(cut, first.a, delay)
    trials = []
    for terms in sets:
        trial = read(cut, grams, first.a, Choice(terms, delay))
        if trial is not None and abs(trial.step) > APART:
            trial = fitted(cut, first.a, Choice(terms, delay))
        trials.append(trial)
    return [trial for trial in trials if trial is not None]


def simplest(trials: Sequence[Trial]) -> Trial:
    """The simplest from which the best is not clearly away; of equals the better one. Marks as
    plausible those within one standard error of the best.
    """
    trials = passive(trials)
    best = min(trials, key=lambda trial: float(trial.cost.sum()))
    for trial in trials:
        more, error = excess(trial.cost, best.cost)
        trial.plausible = more <= error
    near = [trial for trial in trials if not clearly_better(best, trial, extra(best, trial))]
    return min(near, key=lambda trial: (trial.choice.size, float(trial.cost.sum())))


def extra(one: Trial, other: Trial) -> int:
    """How much more was put into one than into the other."""
    return max(one.choice.size - other.choice.size, 0)


def clearly_better(one: Trial, other: Trial, added: int) -> bool:
    """Beyond chance, and by PAYS for each of the things that were added."""
    more, error = excess(other.cost, one.cost)
    return more > RELUCTANT * error and more > PAYS * added * float(one.cost.sum())


def passive(trials: Sequence[Trial]) -> Sequence[Trial]:
    """Without those that drive the motion, unless they explain much more than all others."""
    damped = [trial for trial in trials if not trial.active]
    least, best = (
        min((float(trial.cost.sum()) for trial in some), default=np.inf)
        for some in (damped, trials)
    )
    if least > MUCH * best:
        return trials
    for trial in trials:
        trial.plausible = False
    return damped


def over(
    trials: Sequence[Trial], base: Trial, value: dict[str, float], ci95: dict[str, Interval]
) -> dict[str, Interval]:
    """The intervals of `base` drawn out over the plausible trials."""
    return {
        name: _over(name, trials, base, value[name], ends) if name in base.value else ends
        for name, ends in ci95.items()
    }


def _over(
    name: str, trials: Sequence[Trial], base: Trial, value: float, ends: Interval
) -> Interval:
    low, high = ends.low, ends.high
    quantile = float(student.ppf(0.975, max(len(base.cost) - 1, 1)))
    for trial in trials:
        if trial.plausible and trial is not base:
            ratio = np.log(np.maximum(trial.without[name] / base.without[name], 1e-9))
            shift = float(np.log(max(trial.value[name] / base.value[name], 1e-9)))
            apart = quantile * jackknife(ratio)
            if trial.choice.model != base.choice.model:
                apart += DOUBT * abs(shift)
            below = np.hypot(np.log(max(value / max(ends.low, 1e-300), 1.0)), apart)
            above = np.hypot(np.log(max(ends.high / value, 1.0)), apart)
            low = min(low, value * float(np.exp(shift - below)))
            high = max(high, value * float(np.exp(shift + above)))
    return Interval(low, high)


def hangs_on(trials: Sequence[Trial], base: Trial, name: str) -> tuple[str, float, float]:
    """What moves a parameter most among the plausible choices, and from where to where."""
    widest = ("", base.value[name], base.value[name])
    for kind, own in base.choice.kinds.items():
        values = [
            trial.value[name]
            for trial in trials
            if trial is base or (trial.plausible and trial.choice.kinds[kind] != own)
        ]
        if max(values) - min(values) > widest[2] - widest[1]:
            widest = (kind, min(values), max(values))
    return widest
