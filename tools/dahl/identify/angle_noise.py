# SPDX-License-Identifier: MIT
"""Noise of the angle, beyond the rounding to counts: each wiggle is travel that never was, and a
fit answers with a softer bearing.

The noise is taken from third differences, which a smooth motion hardly has. What it does to the fit
is tried out: a log is made of the found parameters and a smooth path, gets this noise, and is
cleaned and fitted in the same way. A parameter that comes back far from where it was, by its
interval, is not claimed.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from scipy.signal import savgol_filter

from dahl.identify import path, trial
from dahl.identify.finding import Finding
from dahl.identify.fit import Estimate
from dahl.identify.log import Log
from dahl.identify.result import Result
from dahl.identify.trial import Refit

LOOKED_AT = 30_000  # rows of each log
MORE_THAN_ROUNDING = 0.3  # counts of noise beside the rounding
SHOWS = 1e-3  # presliding lengths of noise, where the log shows no encoder
BIAS = 0.5  # of the half width of an interval, that may pass unsaid
TOO_MUCH = 0.06  # presliding lengths: from here on the trial tells too little of the error
LEAST_LEFT = 0.1  # of a parameter: farther its interval is not drawn out
STROKE = 0.5  # of the range of the angle, that a stroke covers at least
KEPT, MEAN_OF_KEPT = 0.95, 0.717  # of the sizes, spikes apart; their mean over the standard error
ALTERNATES = -0.3  # correlation of third differences; independent errors give -0.75
SMOOTH = 8  # parts of a stroke over which a path is smoothed


def noise_of(theta: np.ndarray, count: float) -> float:
    """Standard deviation of independent errors of the angle beside its rounding, rad (m); 0 where
    the third differences are those of the motion.
    """
    third = np.diff(theta[:LOOKED_AT], 3)
    if float(third[1:] @ third[:-1]) > ALTERNATES * float(third @ third):
        return 0.0
    sizes = np.sort(np.abs(third))[: int(KEPT * len(third))]
    whole = (float(sizes.mean()) / MEAN_OF_KEPT) ** 2 / 20  # 1 + 9 + 9 + 1 of a row's variance
    return float(np.sqrt(max(whole - count**2 / 12, 0.0)))


def finding(result: Result, refit: Refit) -> list[Finding]:
    """Which parameters the noise of the angle moves beyond their intervals."""
    estimate = result.estimate
    pairs = [(log, noise_of(log.theta, log.resolution)) for log in result.raw]
    if not any(_shows(log, noise, estimate.a) for log, noise in pairs):
        return []
    again = refit([_made(log.head(LOOKED_AT), noise, estimate) for log, noise in pairs])
    shift = {name: getattr(again, name) / getattr(estimate, name) - 1 for name in ("sigma0", "Fc")}
    most = max(noise for _, noise in pairs)
    doubts = _moved(estimate, shift, most)
    return [_told(result, shift, doubts, most)] if doubts else []


def _moved(estimate: Estimate, shift: Mapping[str, float], noise: float) -> tuple[str, ...]:
    """The parameters that are moved by more than a part of their intervals; of much noise the
    slope in any case.
    """
    much = noise * estimate.a > TOO_MUCH
    return tuple(
        name
        for name, part in shift.items()
        if (much and name == "sigma0")
        or abs(part) > BIAS * estimate.ci95[name].relative(getattr(estimate, name))
    )


def _told(
    result: Result, shift: Mapping[str, float], doubts: tuple[str, ...], noise: float
) -> Finding:
    """In words, with where the true parameters may lie."""
    log = result.raw[0]
    moved = ", ".join(f"{name} by {100 * shift[name]:+.1f} %" for name in doubts)
    counts = f" ({noise / log.resolution:.1f} counts)" if log.resolution else ""
    words = f"angle noise of {noise:.3g} {log.angle_unit}{counts} moves {moved}"
    true = {
        name: getattr(result.estimate, name) / max(1 + shift[name], LEAST_LEFT) for name in doubts
    }
    return Finding(words, doubts, {name: (value, value) for name, value in true.items()})


def _shows(log: Log, noise: float, a: float) -> bool:
    """Whether noise is worth a trial."""
    return noise > MORE_THAN_ROUNDING * log.resolution and noise * a > SHOWS


def _made(log: Log, noise: float, estimate: Estimate) -> Log:
    """A log of these parameters on the smoothed path, with noise on its angle; without any on its
    torque, so that what changes comes from the angle.
    """
    true = smoothed(log.theta)
    read = true + noise * np.random.default_rng(0).normal(size=log.rows)
    return replace(trial.made(log, true, estimate), theta=trial.read_by(log, read))


def smoothed(theta: np.ndarray) -> np.ndarray:
    """By local cubics over a part of a stroke."""
    strokes = len(path.reversals(theta, STROKE * float(np.ptp(theta)))) + 1
    rows = max(len(theta) // strokes // SMOOTH | 1, 5)
    smooth: np.ndarray = savgol_filter(theta, min(rows, len(theta) - 1 | 1), 3)
    return smooth
