# SPDX-License-Identifier: MIT
"""Fc and sigma0 by cycle: a trend, a step, and cycles that disagree with the others. One pair of
numbers for the whole log is no answer then.

Between two reversals of the same kind the torque is drawn with what the fit found, its change with
log a, and a constant: torque = F w + G dw/dlog a + c. Then Fc = F and sigma0 = a (F + G) of that
cycle, as far as one step of Newton goes, and G and c take what does not belong to Fc.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.stats import t as student

from dahl.identify import path
from dahl.identify.finding import Finding
from dahl.identify.fit import Estimate
from dahl.identify.log import Log
from dahl.identify.result import Cycles

APART = 0.02  # of log a: where the change with it is taken
LEAST_CYCLES = 5
LEAST_ROWS = 12  # of a cycle
SURE = 5e-3  # chance of a false word, of a trend or of a step anywhere
NAMES = ("Fc", "sigma0", "offset")
MATTERS = {"Fc": 0.03, "sigma0": 0.1, "offset": 0.05}  # change worth a word; of an offset: in Fc
DOUBTS = {"Fc": ("sigma0", "Fc"), "sigma0": ("sigma0",), "offset": ()}
ODD, ODD_PART = 6.0, 0.1  # robust standard errors; part of the cycles that takes the claim away


def cycles_of(
    logs: Sequence[Log], predicted: Sequence[np.ndarray], estimate: Estimate, least_turn: float
) -> Cycles:
    """Fit each whole cycle of the logs, for which `predicted` is the torque that Dahl's model draws
    for them, N m (N); `least_turn` in rad (m) is what a reversal has to turn by.
    """
    parts, rows, before = [], [], 0
    for log, drawn in zip(logs, predicted, strict=True):
        starts = path.reversals(log.theta, least_turn)[::2]
        cut = [(i, j) for i, j in zip(starts, starts[1:], strict=False) if j - i >= LEAST_ROWS]
        curve, left = _curve(log, estimate.a), log.torque - drawn
        for i, j in cut:
            weight = None if log.weight is None else log.weight[i:j]
            parts.append(_fitted(curve[:, i:j], left[i:j], weight, estimate))
            rows.append(before + i)
        before += log.rows
    table = np.array(parts).reshape(-1, 2 * len(NAMES)).T
    value, error = (dict(zip(NAMES, half, strict=True)) for half in np.split(table, 2))
    return Cycles(value, error, np.array(rows, dtype=int))


def _curve(log: Log, a: float) -> np.ndarray:
    """w and its change with log a: (2, rows)."""
    moves = log.moves_of(slice(0, log.rows))
    above, below = (path.dahl(moves, a * np.exp(side * APART)) for side in (1, -1))
    return np.array((path.dahl(moves, a), (above - below) / (2 * APART)))


def _fitted(
    curve: np.ndarray, left: np.ndarray, weight: np.ndarray | None, estimate: Estimate
) -> np.ndarray:
    """Fc, sigma0 and the constant of one cycle, then their standard errors for a residual of 1."""
    a, x = estimate.a, np.vstack((curve, np.ones_like(left)))
    weighed = x if weight is None else x * weight
    inverse = np.linalg.pinv(weighed @ x.T)
    F, G, c = inverse @ (weighed @ (left + estimate.Fc * x[0]))  # noqa: N806
    both = inverse[0, 0] + inverse[1, 1] + 2 * inverse[0, 1]
    variance = np.array((inverse[0, 0], a**2 * both, inverse[2, 2]))
    return np.concatenate(((F, a * (F + G), c), np.sqrt(variance)))


def findings(cycles: Cycles) -> list[Finding]:
    """What is to be said of each parameter over the cycles."""
    if len(cycles) < LEAST_CYCLES:
        return []
    Fc = float(np.median(np.abs(cycles.value["Fc"])))  # noqa: N806
    sigma0 = float(np.median(np.abs(cycles.value["sigma0"])))
    scale = {"Fc": Fc, "sigma0": sigma0, "offset": Fc}
    return [found for name in NAMES for found in _of_one(cycles, name, scale[name])]


def _of_one(cycles: Cycles, name: str, scale: float) -> list[Finding]:
    """A trend or a step, whichever draws the cycles better, and those that are off beside it;
    changes are told in parts of `scale`.
    """
    value, error, found = cycles.value[name] / scale, cycles.error[name] / scale, []
    shape, change, drawn = _best_shape(value, 1 / error**2)
    if shape and abs(change) > MATTERS[name]:
        found.append(Finding(_words(name, shape, change, cycles), DOUBTS[name]))
    else:
        drawn = np.full_like(value, np.average(value, weights=1 / error**2))
    odd = _odd(value - drawn, error, 2 * MATTERS[name])
    if len(odd):
        numbers = ", ".join(str(i + 1) for i in odd[:8]) + (" ..." if len(odd) > 8 else "")
        doubts = DOUBTS[name] if len(odd) > ODD_PART * len(value) else ()
        found.append(Finding(f"{name} of cycle {numbers} disagrees with the others", doubts))
    return found


def _best_shape(value: np.ndarray, weight: np.ndarray) -> tuple[str, float, np.ndarray]:
    """The trend or step that draws the values best, its height, and what it draws; no name where
    chance might as well have made it.
    """
    shapes = {"trend": np.linspace(-0.5, 0.5, len(value)), **_steps(len(value))}
    fits = {shape: _drawn(column, value, weight) for shape, column in shapes.items()}
    costs = {shape: float(weight @ (value - drawn) ** 2) for shape, (_, drawn) in fits.items()}
    best, freedom = min(costs, key=costs.__getitem__), len(value) - 2
    whole = float(weight @ (value - np.average(value, weights=weight)) ** 2)
    limit = float(student.ppf(1 - SURE / 2 / len(value), freedom)) ** 2
    surely = (whole - costs[best]) * freedom > costs[best] * limit
    return (best if surely else "", *fits[best])


def _steps(count: int) -> dict[str, np.ndarray]:
    """-1/2 before, 1/2 after each place with two cycles on either side."""
    places = np.arange(count)
    return {f"{k}": np.where(places < k, -0.5, 0.5) for k in range(2, count - 1)}


def _drawn(column: np.ndarray, value: np.ndarray, weight: np.ndarray) -> tuple[float, np.ndarray]:
    """The change that a shape of height 1 needs, and what it then draws."""
    x = column - np.average(column, weights=weight)
    mean = np.average(value, weights=weight)
    change = float(weight @ (x * (value - mean)) / (weight @ x**2))
    return change, mean + change * x


def _odd(rest: np.ndarray, error: np.ndarray, least: float) -> np.ndarray:
    """Which cycles are far off, in robust standard errors and by at least so much."""
    ratio = rest / error
    usual = 1.4826 * float(np.median(np.abs(ratio - np.median(ratio))))
    return np.flatnonzero((np.abs(ratio) > ODD * usual) & (np.abs(rest) > least))


def _words(name: str, shape: str, part: float, cycles: Cycles) -> str:
    way = f"{100 * part:+.0f} %" + " of Fc" * (name == "offset")
    if shape == "trend":
        return f"{name} drifts by {way} over {len(cycles)} cycles"
    place = int(shape)
    return f"{name} steps by {way} at cycle {place + 1} (row {cycles.rows[place] + 1})"
