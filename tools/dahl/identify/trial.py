# SPDX-License-Identifier: MIT
"""Logs that are made of the found parameters, to try out what something does to the fit: how far
the parameters come back from where they were says how far they may be off.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from dahl.identify import path
from dahl.identify.finding import Finding
from dahl.identify.fit import Estimate
from dahl.identify.log import Log

NAMES = ("sigma0", "Fc")
SHOWS = 0.2  # of the half width of an interval: less is not said
EXPLAINS = 0.5  # of a trial's squares: with less left in the log, what is tried is not in it

Refit = Callable[[Sequence[Log]], Estimate]  # cleans and fits in the way of the result


def made(log: Log, true: np.ndarray, estimate: Estimate, parts: int = 1) -> Log:
    """A log with the torque of these parameters on a path that has so many parts for each row, and
    without noise; the angle stays as it was read.
    """
    torque = estimate.Fc * path.dahl(np.diff(true, prepend=true[:1]), estimate.a)
    return replace(log, torque=torque[::parts].astype(float), notes=[])


def read_by(log: Log, theta: np.ndarray) -> np.ndarray:
    """The angle as the encoder of a log would show it."""
    return np.round(theta / log.resolution) * log.resolution if log.resolution else theta


def is_in(estimate: Estimate, trials: Sequence[Estimate]) -> bool:
    """Whether a fit leaves as much as the trials do, by and large. A simulated shaft that moves by
    whole counts leaves less than their rounding would.
    """
    shown = float(np.median([one.sse / one.rows for one in trials]))
    return estimate.sse / estimate.rows >= EXPLAINS * shown


def widening(
    text: str, estimate: Estimate, off: Mapping[str, float], ends: Mapping[str, tuple[float, float]]
) -> list[Finding]:
    """That parameters may be off by these parts of them, and then have values up to these ends; of
    those of which it shows beside the interval that they have.
    """
    told = [
        name
        for name, part in off.items()
        if abs(part) > SHOWS * estimate.ci95[name].relative(getattr(estimate, name))
    ]
    words = ", ".join(f"{name} may be {100 * abs(off[name]):.2g} % off" for name in told)
    return [Finding(f"{text}: {words}", reach={name: ends[name] for name in told})] if told else []
