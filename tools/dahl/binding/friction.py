# SPDX-License-Identifier: MIT
"""One Dahl element (dahl.h): Plan, State, Friction."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dahl.binding import arrays, checks, parameters
from dahl.binding.checks import UINT32_MAX
from dahl.binding.copies import Copied
from dahl.binding.elements import Element, RatioElement
from dahl.binding.library import c
from dahl.errors import InputError

STATE_MIN, STATE_MAX = -(2**62) - 2**31, 2**62 + 2**31 - 1  # of w after any step


class State(Copied):
    """State of an element (dahl_state_t): w = F/Fc in Q62, a whole number; 0 is relaxed, +-2^62 is
    +-Fc. w must be in the range that a step can leave.
    """

    def __init__(self, w: int = 0) -> None:
        self._c = c.new("dahl_state_t *", (checks.whole("w", w, STATE_MIN, STATE_MAX),))

    @property
    def w(self) -> int:
        """F/Fc in Q62."""
        return int(self._c.w)

    @w.setter
    def w(self, value: int) -> None:
        self._c.w = checks.whole("w", value, STATE_MIN, STATE_MAX)

    def __eq__(self, other: object) -> bool:
        return self.w == other.w if isinstance(other, State) else NotImplemented

    __hash__ = None  # type: ignore[assignment]  # it changes

    def __repr__(self) -> str:
        return f"State(w={self.w})"


@dataclass(frozen=True, repr=False)
class Plan(parameters.Counts, Copied):
    """Parameters, prepared once (dahl_prepare). Any number of Frictions may share a plan.

    sigma0           N m/rad  stiffness at rest, 2^-64 <= sigma0 < 2^64                (Eq. 1)
    Fc               N m      Coulomb torque, 2^-64 <= Fc < 2^64                       (Eq. 1)
    theta_per_count  rad      per encoder count, 2^-64 <= theta_per_count < 2^64, with
                              2^-30 <= sigma0/Fc*theta_per_count < 2^20; 0: no encoder

    Each is rounded to float, as in C. A plan is immutable and has a hash. Cost: 10 us.
    """

    sigma0: float
    Fc: float
    theta_per_count: float = 0.0
    _prepared: Any = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        for name, limit in parameters.LIMITS.items():
            rounded = parameters.parameter(name, getattr(self, name), limit)
            object.__setattr__(self, name, rounded)
        self._prepare()

    def _prepare(self) -> None:
        object.__setattr__(self, "_prepared", c.new("dahl_plan_t *"))
        if c.dahl_prepare(self._prepared, self._params()) != 0:
            raise InputError(parameters.refusal(self.sigma0, self.Fc, self.theta_per_count))

    def _params(self) -> Any:
        return c.new("dahl_params_t *", (self.sigma0, self.Fc, self.theta_per_count))

    @property
    def ulp(self) -> float:
        """N m from Fc to the next float away from zero: the unit of the error bounds."""
        return float(np.spacing(np.float32(self.Fc)))

    def tip_torque(self, stroke: int) -> float:
        """Return the torque in N m at the tips of the steady loop of a constant stroke: Fc
        tanh(u/2), u the travel of the stroke. stroke is in counts from end to end, a whole number
        from 0 to 2^32-1. Error: 2^-30 of the torque, and one rounding.
        """
        self._need_counts()
        stroke = checks.whole("stroke", stroke, 0, UINT32_MAX)
        return float(c.dahl_tip_torque(self._prepared, stroke))

    def __repr__(self) -> str:
        named = (f"{name}={parameters.digits(getattr(self, name))}" for name in parameters.LIMITS)
        return f"Plan({', '.join(named)})"


class PlanAndState(Element):
    """Base of elements with a Plan and a State."""

    _plan: Plan
    _state: State

    @property
    def plan(self) -> Plan:
        """The parameters."""
        return self._plan

    @property
    def state(self) -> State:
        """The state, live: w = F/Fc in Q62."""
        return self._state


class Friction(PlanAndState, RatioElement):
    """One Dahl element: a Plan and a State (Eqs. 7, 18, 27). Cost: 0.3 us a step, 10 ns a tick of
    run_counts().
    """

    _derived_fields = frozenset({"_step"})

    def __init__(self, plan: Plan) -> None:
        self._plan = checks.instance("plan", plan, Plan)
        self._state = State()
        self._prepare()

    def _prepare(self) -> None:
        arguments = self._plan._prepared, self._state._c
        self._step: Callable[[int], float] = partial(c.dahl_step_counts, *arguments)
        if self._plan.theta_per_count == 0:
            self._step = super().step_counts  # raises dahl.Error

    def _arguments(self) -> tuple[Any, ...]:
        plan = self._plan
        if plan.theta_per_count == 0:
            plan._need_counts()  # raises dahl.Error
        return plan._prepared, self._state._c

    @checks.quick_counts
    def step_counts(self, dcounts: int) -> float:
        """Move by dcounts, a whole number within int32, and return F in N m. Error: 0.52 ulp of Fc,
        or 0.6 ulp if step() has moved the state. The plan must have theta_per_count.
        """
        return super().step_counts(dcounts)

    def step(self, dtheta: float) -> float:
        """Move by dtheta rad and return F in N m. Error: 0.6 ulp of Fc. As in C, NaN is no motion
        and an infinite angle saturates at +-Fc.
        """
        angle = checks.real("dtheta", dtheta, "an angle in rad")
        return float(c.dahl_step(self._plan._prepared, self._state._c, angle))

    @property
    def torque(self) -> float:
        """F in N m, without motion. Setting it is set_torque()."""
        return float(c.dahl_torque(self._plan._prepared, self._state._c))

    @torque.setter
    def torque(self, value: float) -> None:
        self.set_torque(value)

    def set_torque(self, F: float) -> None:  # noqa: N803 (the field's name)
        """Set the state to F in N m. As in C, F is clamped to +-Fc and NaN has no effect."""
        torque = checks.real("F", F, "a torque in N m")
        c.dahl_set_torque(self._plan._prepared, self._state._c, torque)

    def counts_to_torque(self, F: float) -> int:  # noqa: N803 (the field's name)
        """Return a move in counts after which step_counts() returns F in N m or a torque beyond F,
        seen from the present one. The state does not move. One count less does not reach F; see
        dahl_counts_to_torque. A move of 2^31-1 counts must reach F.
        """
        wanted, found = checks.finite("F", F, "N m"), c.new("int32_t *")
        if c.dahl_counts_to_torque(*self._arguments(), wanted, found) != 0:
            limit = f"a move of 2^31-1 counts reaches at most {self._plan.Fc:g} N m"
            raise InputError(f"F = {wanted!r} N m is reached by no move: {limit}")
        return int(found[0])

    def change_plan(self, plan: Plan) -> None:
        """Continue with other parameters. The torque is kept if the new bristle can carry it; the
        stored energy F^2/(2 sigma0) never grows (see dahl_change_plan).
        """
        checks.instance("plan", plan, Plan)
        c.dahl_change_plan(self._plan._prepared, plan._prepared, self._state._c)
        self._plan = plan
        self._prepare()

    def run(self, moves: ArrayLike, out: NDArray[np.float32] | None = None) -> NDArray[np.float32]:
        """Moves in rad, shape (n,) -> torques in N m after each, shape (n,), float32, into `out` if
        given: the bits of step(). A C-contiguous float32 array is read in place, other values are
        rounded to float32 first.
        """
        plan, state = self._plan._prepared, self._state._c
        return arrays.run(c.dahl_batch, (plan, state), arrays.moves(moves, arrays.FLOAT32), out)

    def run_path(
        self, theta: ArrayLike, out: NDArray[np.float32] | None = None
    ) -> NDArray[np.float32]:
        """Angles in rad, shape (n,), finite -> torques in N m at each, shape (n,), float32, into
        `out` if given: run() of the moves between them. The shaft is at theta[0] already, so the
        first torque is the present one.
        """
        return self.run(arrays.moves_of_path(theta), out)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Friction):
            return NotImplemented
        return self.plan == other.plan and self.state == other.state

    __hash__ = None  # type: ignore[assignment]  # it changes with each step

    def __repr__(self) -> str:
        return f"<Friction {self.plan!r}, torque={self.torque:g} N m>"
