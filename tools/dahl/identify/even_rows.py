# SPDX-License-Identifier: MIT
"""A log without times has no speed, so a viscous torque or an inertia goes into sigma0 and Fc
unseen. Most such logs were written in even steps all the same: what the fit finds with rows for
times says whether there is such a part, and how far it changes the parameters.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dahl.identify import recording
from dahl.identify.finding import Finding
from dahl.identify.fit import Estimate
from dahl.identify.log import Log
from dahl.identify.result import Result
from dahl.identify.terms import UNTIMED

NAMES, VISCOUS = ("sigma0", "Fc"), "viscous"
Fitted = Callable[[Sequence[Log], Sequence[str] | None], Estimate]  # None: the terms that pay


@dataclass(frozen=True)
class Change:
    """Terms with the speed that pay in one log with rows for times, and what these and a viscous
    part, which is seldom nothing at all, do to the fit.
    """

    terms: list[str]
    ratio: dict[str, float]  # of each parameter with them to that without


def finding(result: Result, fitted: Fitted) -> list[Finding]:
    """The parameters that a part with the speed changes, if the rows came in even steps."""
    unclocked = [log for log in result.logs if log.time is None and not recording.by_event(log)]
    if not unclocked:
        return []
    changes = [_changed(log, fitted) for log in unclocked]
    values = {name: _furthest(changes, name) * getattr(result.estimate, name) for name in NAMES}
    ends = result.estimate.ci95
    outside = [name for name in NAMES if not ends[name].low <= values[name] <= ends[name].high]
    if not outside:
        return []
    units = {"sigma0": result.logs[0].slope_unit, "Fc": result.logs[0].unit}
    told = ", ".join(f"{name} {values[name]:.4g} {units[name]}" for name in outside)
    terms = ", ".join(sorted({term for change in changes for term in change.terms}))
    text = (
        f"no usable times: with rows in even steps and a part with the speed ({terms or VISCOUS})"
    )
    reach = {name: (values[name], values[name]) for name in outside}
    return [Finding(f"{text} {told} (--time)", tuple(outside) if terms else (), reach)]


def _changed(log: Log, fitted: Fitted) -> Change:
    """One log alone, since the rows of another may last longer."""
    clocked, plain = replace(log, time=np.arange(float(log.rows))), fitted([log], None)
    pays = [term for term in fitted([clocked], None).terms if term not in UNTIMED]
    resting = [term for term in plain.terms if term in UNTIMED]
    timed = fitted([clocked], [*resting, *(pays or [VISCOUS])])
    ratio = {name: float(getattr(timed, name) / getattr(plain, name)) for name in NAMES}
    return Change(pays, ratio)


def _furthest(changes: Sequence[Change], name: str) -> float:
    return max((change.ratio[name] for change in changes), key=lambda ratio: abs(ratio - 1))
