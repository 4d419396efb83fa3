# SPDX-License-Identifier: MIT
"""A Dahl element that adds up the energy that it absorbs (dahl_parts.h)."""

from __future__ import annotations

from typing import Any

from dahl.binding import checks
from dahl.binding.copies import content
from dahl.binding.friction import Plan, PlanAndState, State
from dahl.binding.library import c


class Work(PlanAndState):
    """One Dahl element that adds up its work (dahl_work_t): the torques of Friction(plan), bit for
    bit, and the work along the path in J. The sums are integers that do not overflow for 2^63
    ticks. The plan must have theta_per_count. Cost: 1 us a step, 10 ns a tick of run_counts().

    >>> bearing = dahl.Work(dahl.Plan(100.0, 0.5, 1e-3))
    >>> torques = bearing.run_counts([10**6, -(10**6)])
    >>> round(bearing.work)  # 2000 rad at 0.5 N m, less the bends
    1000
    """

    _kind = "work_"

    def __init__(self, plan: Plan) -> None:
        self._plan = checks.instance("plan", plan, Plan)
        self._plan._need_counts()
        self._state, self._sums = State(), c.new("dahl_work_t *")

    @property
    def work(self) -> float:
        """J so far, the sum of F dtheta along the path: positive if the element absorbed energy.
        Infinite beyond a float. Error: half an ulp, and for each reversal 2^-30 of Fc^2/sigma0.
        """
        return float(c.dahl_work(self._plan._params(), self._sums))

    def _arguments(self) -> tuple[Any, ...]:
        return self._plan._prepared, self._state._c, self._sums

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Work):
            return NotImplemented
        same = (self._plan, self._state) == (other._plan, other._state)
        return same and content(self._sums) == content(other._sums)

    __hash__ = None  # type: ignore[assignment]  # it changes with each step

    def __repr__(self) -> str:
        return f"<Work {self._plan!r}, torque={self.torque:g} N m, work={self.work:g} J>"
