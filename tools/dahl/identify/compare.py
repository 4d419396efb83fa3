# SPDX-License-Identifier: MIT
"""Dahl's model beside others: the sign of the motion alone, slip elements, Dahl and slip elements
side by side, another limit each way; and, since nobody knows what a bearing does, a general
exponent and a friction that falls with the speed, which only say how far the numbers may be off.

For elements with given a all is linear, and no element pushes: non-negative least squares over a
dictionary of a. Elements are added one by one, each where it lowers the cost most.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import combinations

import numpy as np
from scipy.optimize import nnls

from dahl.identify import elements, path
from dahl.identify.choices import Choice, Trial
from dahl.identify.cycles import Cut, cost_of, least_squares, left_out
from dahl.identify.terms import places_of

NODES = 1.25 ** np.arange(-6.0, 9.0)  # of a, in the dictionary
FINER = (1.12, 1.06, 1.03, 1.015)  # of a, for one element alone
MOST = 4  # elements side by side
EXPONENTS = (0.3, 0.6, 1.4, 2.0)
PARTS = (0.0, 0.1, 0.2, 0.4, 0.7)  # of the mean of both Fc, that each is off
HALVED = 4  # times between the best of them and its neighbours
SLOW = (0.1, 0.2, 0.4)  # of the highest speed: where friction has fallen by a third
ROUNDS = 4  # of Newton's steps to the best a
APART = 0.02  # of log a


Part = dict[str, float | str]  # kind, sigma0, Fc of an element


@dataclass(frozen=True)
class Key:
    """One column of the dictionary."""

    kind: str  # dahl, slip
    a: float


@dataclass
class Candidate:
    """One model as fitted."""

    name: str
    trial: Trial
    parts: list[Part] = field(default_factory=list)
    size: int = 0  # parameters
    product: bool = True  # whether the library has it


class Dictionary:
    """Columns of elements with the products that a fit needs."""

    def __init__(
        self,
        cut: Cut,
        a: float,
        terms: Sequence[str],
        delay: float,
        unnamed: Sequence[np.ndarray] = (),
    ) -> None:
        """`unnamed` are columns of any size that stand beside the terms."""
        self.cut, self.a, self.terms, self.delay = cut, a, tuple(terms), delay
        moved = cut.moved(cut.terms[:, places_of(terms)], delay)
        self.beside = np.column_stack((moved, *unnamed))
        self.known: dict[Key, np.ndarray] = {}

    def column(self, key: Key) -> np.ndarray:
        if key not in self.known:
            model = path.dahl if key.kind == "dahl" else path.bilinear
            self.known[key] = self.of(model, key.a)
        return self.known[key]

    def of(self, model: elements.Element, a: float) -> np.ndarray:
        """A column of any element, late as all."""
        return self.cut.moved(self.cut.drawn(model, a), self.delay)

    def grams(self, columns: Sequence[np.ndarray]) -> np.ndarray:
        return self.cut.grams(np.column_stack((*columns, self.beside)))


def constrained(gram: np.ndarray, count: int) -> np.ndarray:
    """Least squares with the first `count` coefficients not below 0."""
    inner = slice(count, -1)
    if count == len(gram) - 1:
        return _not_negative(gram[:-1, :-1], gram[:-1, -1])
    across, right = gram[:count, inner], gram[inner, -1]
    within = gram[inner, inner]
    within = within + np.diag(1e-10 * np.diag(within) + 1e-30)
    drawn = np.linalg.solve(within, np.column_stack((across.T, right)))
    matrix = gram[:count, :count] - across @ drawn[:, :-1]
    first = _not_negative(matrix, gram[:count, -1] - across @ drawn[:, -1])
    return np.concatenate((first, drawn[:, -1] - drawn[:, :-1] @ first))


def _not_negative(matrix: np.ndarray, right: np.ndarray) -> np.ndarray:
    values, vectors = np.linalg.eigh(matrix)
    values = np.maximum(values, 1e-9 * values[-1] + 1e-300)
    root = np.sqrt(values)
    solution: np.ndarray = nnls(root[:, None] * vectors.T, (vectors.T @ right) / root)[0]
    return solution


# --- elements side by side ------------------------------------------------------------------------


def side_by_side(
    book: Dictionary, kinds: Sequence[str], name: str, most: int = MOST
) -> list[Candidate]:
    """1 .. `most` elements of these kinds, as long as one more lowers the cost."""
    keys = [Key(kind, float(book.a * node)) for kind in kinds for node in NODES]
    grams = book.grams([book.column(key) for key in keys])
    whole, count = grams.sum(axis=0), len(keys)
    found, chosen = [], list[int]()
    for _ in range(most):
        costs = {k: _cost(whole, [*chosen, k], count) for k in range(count) if k not in chosen}
        best = min(costs, key=costs.__getitem__)
        if chosen and costs[best] > (1 - 1e-6) * _cost(whole, chosen, count):
            break
        chosen.append(best)
        used = [*chosen, *range(count, len(whole))]
        some = grams[:, used][:, :, used]
        found.append(_candidate(book, name, [keys[k] for k in chosen], some))
    return found


def pair(book: Dictionary, kind: str, name: str, promising: float) -> Candidate:
    """The best two elements of one kind, every pair of the dictionary tried; each a is then made
    finer where the cost is below `promising`.
    """
    keys = [Key(kind, float(book.a * node)) for node in NODES]
    whole, count = book.grams([book.column(key) for key in keys]).sum(axis=0), len(keys)
    costs = {both: _cost(whole, list(both), count) for both in combinations(range(count), 2)}
    best = min(costs, key=costs.__getitem__)
    both = [keys[k] for k in best]
    if costs[best] < promising:
        both = _finer(book, both)
    return _candidate(book, name, both, book.grams([book.column(key) for key in both]))


def _finer(book: Dictionary, keys: list[Key]) -> list[Key]:
    """Each a moved up and down by ever smaller steps, as long as that lowers the cost."""

    def cost(tried: list[Key]) -> float:
        whole = book.grams([book.column(key) for key in tried]).sum(axis=0)
        return cost_of(whole, constrained(whole, len(tried)))

    least = cost(keys)
    for step in FINER:
        for place, key in enumerate(keys):
            for factor in (step, 1 / step):
                tried = [*keys]
                tried[place] = Key(key.kind, key.a * factor)
                if (here := cost(tried)) < least:
                    least, keys = here, tried
    return keys


def _cost(whole: np.ndarray, chosen: list[int], count: int) -> float:
    used = [*chosen, *range(count, len(whole))]
    some = whole[np.ix_(used, used)]
    return cost_of(some, constrained(some, len(chosen)))


def _candidate(book: Dictionary, name: str, keys: list[Key], grams: np.ndarray) -> Candidate:
    count = len(keys)
    solve = partial(constrained, count=count)
    result, best = left_out(grams, book.cut.fold, solve), solve(grams.sum(axis=0))
    Fc, named = best[:count], dict(zip(book.terms, map(float, best[count:]), strict=True))  # noqa: N806
    a = np.array([key.a for key in keys])
    value = {"sigma0": float(a @ Fc), "Fc": float(Fc.sum())}
    without = {"sigma0": result.found[:, :count] @ a, "Fc": result.found[:, :count].sum(axis=1)}
    title = name if name == "Coulomb" else f"{name} K={count}"
    choice = Choice(book.terms, book.delay, model=title)
    parts: list[Part] = [
        {"kind": key.kind, "sigma0": float(key.a * force), "Fc": float(force)}
        for key, force in zip(keys, Fc, strict=True)
        if force > 0
    ]
    slope = value["sigma0"] / max(value["Fc"], 1e-300)
    trial = Trial(choice, slope, value, without, result.cost, terms=named)
    return Candidate(title, trial, parts, 2 * count + choice.size)


def one(book: Dictionary, kind: str, name: str) -> Candidate:
    """One element, its a as fine as FINER."""
    keys = [Key(kind, float(book.a * node)) for node in NODES]
    for finer in FINER:
        costs = {key: _alone(book, key) for key in keys}
        best = min(costs, key=costs.__getitem__)
        keys = [best, Key(kind, best.a * finer), Key(kind, best.a / finer)]
    best = min(keys, key=lambda key: _alone(book, key))
    return _candidate(book, name, [best], book.grams([book.column(best)]))


def _alone(book: Dictionary, key: Key) -> float:
    whole = book.grams([book.column(key)]).sum(axis=0)
    return cost_of(whole, constrained(whole, 1))


def coulomb(book: Dictionary) -> Candidate:
    """The sign of the motion alone."""
    found = _candidate(book, "Coulomb", [Key("sign", 1.0)], book.grams([book.of(path.coulomb, 1)]))
    found.size = 1 + found.trial.choice.size
    return found


# --- one element of another shape -----------------------------------------------------------------


def shaped(
    book: Dictionary, model: elements.Element, name: str, beside: Sequence[np.ndarray] = ()
) -> Candidate | None:
    """One element with the best a; `beside` are factors on w that stand as columns of their own."""
    a = book.a
    for _ in range(ROUNDS):
        w = book.of(model, a)
        above, below = (book.of(model, a * np.exp(side * APART)) for side in (1, -1))
        grams = book.grams([w, (above - below) / (2 * APART), *(factor * w for factor in beside)])
        result = left_out(grams, book.cut.fold)
        best = least_squares(grams.sum(axis=0))
        Fc, change = best[:2]  # noqa: N806
        if not Fc > 0:
            return None
        last, step = a, float(np.clip(change / Fc, -0.4, 0.4))
        a *= float(np.exp(step))
        if abs(step) < APART / 10:
            break
    value = {"sigma0": float(last * (Fc + change)), "Fc": float(Fc)}
    part = result.found
    without = {"sigma0": last * (part[:, 0] + part[:, 1]), "Fc": part[:, 0]}
    choice = Choice(book.terms, book.delay, model=name)
    sizes = best[2 + len(beside) :][: len(book.terms)]
    named = dict(zip(book.terms, map(float, sizes), strict=True))
    trial = Trial(choice, last, value, without, result.cost, terms=named)
    size = 3 + len(beside) + choice.size
    parts: list[Part] = [{"kind": name, **value}]
    return Candidate(name, trial, parts, size, product=False)
