# SPDX-License-Identifier: MIT
"""A log without times has no speed, so a viscous torque or an inertia goes into sigma0 and Fc
unseen. Most such logs were written in even steps all the same: what the fit finds with rows for
times says whether there is such a part, and which parameters it makes others.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from dahl.identify import recording
from dahl.identify.finding import Finding
from dahl.identify.fit import Estimate
from dahl.identify.log import Log
from dahl.identify.result import Result
from dahl.identify.terms import UNTIMED

NAMES = ("sigma0", "Fc")


def finding(result: Result, fitted: Callable[[Sequence[Log]], Estimate]) -> list[Finding]:
    """The parameters that a part with the speed makes others, were the rows even in time."""
    unclocked = [log for log in result.logs if log.time is None]
    if not unclocked or any(map(recording.by_event, unclocked)):
        return []
    other = fitted([replace(log, time=np.arange(float(log.rows))) for log in result.logs])
    parts = [name for name in other.terms if name not in UNTIMED]
    ends = {name: result.estimate.ci95[name] for name in NAMES}
    values = {name: float(getattr(other, name)) for name in NAMES}
    doubts = tuple(name for name in NAMES if not ends[name].low <= values[name] <= ends[name].high)
    if not parts or not doubts:
        return []
    units = {"sigma0": result.logs[0].slope_unit, "Fc": result.logs[0].unit}
    told = ", ".join(f"{name} {values[name]:.4g} {units[name]}" for name in doubts)
    text = f"no times, and rows in even steps would show a part with the speed ({', '.join(parts)})"
    reach = {name: (values[name], values[name]) for name in doubts}
    return [Finding(f"{text}: {told} then (--time)", doubts, reach)]
