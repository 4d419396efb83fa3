# SPDX-License-Identifier: MIT
"""Simulate and refit: the effect of counts, rounding, sampling and angle noise on the estimate.

Logs are made from the fitted parameters on the same motion, with known truth. The distance of their
refits from the truth is the bias and the spread of the method on this log.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from dahl.identify import models
from dahl.identify.fit import Fit, Fitter, Hypothesis
from dahl.identify.least_squares import jackknife, solve
from dahl.identify.samples import MIN_TURN_LENGTHS, Samples, samples_of
from dahl.io.log import Log, resolution_of

DRAWS = 8  # in mirrored pairs, so that a log and its mirror image agree
HIDDEN_COUNTS = 0.2  # standard error of the travel at a turn that is extrapolated from edges
MIN_HIDDEN = 0.5  # standard errors, however well the torque fits
REFIT_ROUNDS = 5  # a refit starts at the truth
MAX_LEVELS = 400  # a torque sensor of more levels is not coarse
GOLDEN, SILVER = 0.618, 0.414  # steps of a sequence that fills an interval evenly


def torque_step(torque: np.ndarray) -> float:
    """The step of a coarse torque sensor, N m (N); 0 if noise hides it or there is none."""
    return 0.0 if len(np.unique(torque)) > MAX_LEVELS else resolution_of(torque)


def refit_errors(fitter: Fitter, fit: Fit) -> np.ndarray:
    """Return the sizes of the relative errors of refits of simulated logs, without the largest.

    Shape (refits, 2), in ascending order.
    """
    random = np.random.default_rng(0)
    refits = [_refit(fitter, fit, k, random) for k in range(DRAWS)]
    errors = np.array([np.abs(one.value / fit.value - 1) for one in refits if one is not None])
    errors = np.sort(errors.reshape(-1, 2), axis=0)
    return errors[:-1] if len(errors) >= 4 else errors


def _refit(fitter: Fitter, fit: Fit, draw: int, random: np.random.Generator) -> Fit | None:
    """Simulate one log and fit the same hypothesis to it."""
    samples, h = fitter.samples, fit.hypothesis
    true = _other_phase(samples, h, draw)
    exact = Fitter(samples.with_angle(h.angle, true)).predicted(fit)
    torque = _measure(fitter, fit, exact, random)
    theta = true + (random.normal(size=samples.rows) * samples.noise if samples.noise else 0.0)
    if samples.count:
        theta = np.round(theta / samples.count) * samples.count
    logs = [
        Log(str(k), theta[rows], torque[rows], samples.time[rows], resolution=samples.count)
        for k, rows in zip(samples.log_of, samples.pieces, strict=True)
    ]
    made = samples_of(logs, block=1, reference=samples.reference, angles=(h.angle,))
    kept = {name: getattr(samples, name) for name in ("noise", "load", "used", "folds", "cycles")}
    made = replace(made, **kept)
    if h.angle not in made.angles:
        made = made.with_angle(h.angle, made.angles["between counts"])
    return Fitter(made).fit(h, fit.p, REFIT_ROUNDS)


def _other_phase(samples: Samples, h: Hypothesis, draw: int) -> np.ndarray:
    """The motion of the log with its counts at other places, and half a count longer or shorter."""
    angle = samples.angles[h.angle if h.angle != "as read" else "between counts"]
    pair, side = draw // 2, 1 - 2 * (draw % 2)
    shift = side * ((pair + 0.5) * GOLDEN % 1 - 0.5)
    stretch = (pair + 0.5) * SILVER % 1 - 0.5
    around = angle - angle.mean()
    moved: np.ndarray = angle + samples.count * (shift + stretch * around / np.abs(around).max())
    return moved


def _measure(
    fitter: Fitter, fit: Fit, torque: np.ndarray, random: np.random.Generator
) -> np.ndarray:
    """The torque as a coarse sensor reads it. White noise is left to the jackknife."""
    step = torque_step(fitter.samples.torque)
    if not step:
        return torque
    residual = fitter.samples.torque - fitter.predicted(fit)
    noise = min(float(np.std(residual)), 0.3 * step) * random.normal(size=len(torque))
    shift = random.uniform() * step
    gain = 1 + 0.5 * step / np.ptp(torque) * random.uniform(-1, 1)
    measured: np.ndarray = np.round(((torque + noise) * gain + shift) / step) * step - shift
    return measured


def hidden_travel(fitter: Fitter, fit: Fit) -> np.ndarray:
    """Return the relative half widths by the travel that a count hides at each turn: (2,).

    The angle within the last count is extrapolated, with an error of HIDDEN_COUNTS. The torque
    shows a part of this error, so that only the rest is unknown: half a standard error at least.
    """
    samples, h = fitter.samples, fit.hypothesis
    bent = samples.angles[h.angle].copy()
    for rows in samples.pieces:
        bent[rows] += _bump_at_turns(bent[rows], samples.count, float(np.exp(fit.p[0])))
    again = Fitter(samples.with_angle(h.angle, bent))
    one = again.fit(h, fit.p, REFIT_ROUNDS - 1)
    if one is None:
        return np.full(2, np.inf)
    seen, error = _amplitude(fitter, fit, again.predicted(fit) - fitter.predicted(fit))
    shrink = 1 / (1 + error**2)  # the posterior of a normal prior of standard deviation 1
    unknown = max(abs(seen) * shrink + 2 * error * np.sqrt(shrink), MIN_HIDDEN)
    reach: np.ndarray = np.abs(one.value / fit.value - 1) * unknown
    return reach


def _amplitude(fitter: Fitter, fit: Fit, change: np.ndarray) -> tuple[float, float]:
    """Return how much of a change of the torque the log shows, and its standard error."""
    h = fit.hypothesis
    base, _ = fitter.columns(h, fit.p, fit.limits, h.terms)
    grams = fitter.samples.grams(np.column_stack((base, change)))
    whole, columns = grams.sum(axis=0), range(base.shape[1] + 1)
    left = solve(whole - grams, columns)[:, -1:]
    return float(solve(whole, columns)[-1]), float(jackknife(left)[0])


def _bump_at_turns(angle: np.ndarray, count: float, a: float) -> np.ndarray:
    """Return the change of an angle that goes HIDDEN_COUNTS further at each turn.

    It fades over two counts before and after the turn.
    """
    turns = models.turning_points(angle, MIN_TURN_LENGTHS / a)
    if len(turns) == 0:
        return np.zeros(len(angle))
    places = np.arange(len(angle))
    between = (turns[1:] + turns[:-1]) / 2
    nearest = turns[np.searchsorted(between, places)]
    away = np.abs(angle[nearest] - angle)
    before = np.maximum(nearest - max(len(angle) // len(turns) // 8, 2), 0)
    direction = np.sign(angle[nearest] - angle[before])
    bump: np.ndarray = np.maximum(1 - away / (2 * count), 0.0) * direction
    return HIDDEN_COUNTS * count * bump
