# SPDX-License-Identifier: MIT
"""A torque that comes in steps: without noise over a step, rounding is no noise that goes out in
the mean, and Fc may be up to half a step off, sigma0 by up to twice that part of it (tried on steps
from Fc/32 to Fc/1.5).

A mean of readings that are rounded to steps of q errs, beneath independent errors of standard
deviation s, as the sawtooth of rounding smoothed by a normal distribution: its first harmonic falls
as exp(-2 pi^2 s^2/q^2), the others faster. So q/2 times that stands for the most that it errs.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dahl.identify import angle_noise
from dahl.identify.finding import Finding
from dahl.identify.fit import Estimate
from dahl.identify.log import Log, resolution_of

FEW = 3  # levels of the torque: too few gaps to tell a grid
SHOWS = 0.2  # of the half width of the interval of Fc: less is not said


def finding(logs: Sequence[Log], estimate: Estimate) -> list[Finding]:
    """How far the parameters may be off by the steps of the torque, where that is worth a word."""
    step, error = max((_step_and_error(log) for log in logs), key=lambda pair: pair[1])
    part = error / estimate.Fc if estimate.Fc > 0 else 0.0
    if part <= SHOWS * estimate.ci95["Fc"].relative(estimate.Fc):
        return []
    words = (
        f"torque comes in steps of {step:.3g} {logs[0].unit} with little noise over them: Fc may be"
        f" {100 * part:.2g} % off, sigma0 {200 * part:.2g} %"
    )
    reach = {
        name: (value * max(1 - off, 0.0), value * (1 + off))
        for name, value, off in (
            ("Fc", estimate.Fc, part),
            ("sigma0", estimate.sigma0, 2 * part),
        )
    }
    return [Finding(words, reach=reach)]


def _step_and_error(log: Log) -> tuple[float, float]:
    """N m (N): the step of the torque, and the most that a mean errs by it."""
    step = resolution_of(log.torque)
    if step == 0:
        levels = np.unique(log.torque)
        step = float(np.diff(levels).min()) if 1 < len(levels) <= FEW else 0.0
    if step == 0:
        return 0.0, 0.0
    noise = angle_noise.noise_of(log.torque, step)
    return step, step / 2 * float(np.exp(-2 * (np.pi * noise / step) ** 2))
