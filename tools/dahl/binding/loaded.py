# SPDX-License-Identifier: MIT
"""A Dahl element whose Fc follows a load (dahl_parts.h)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dahl.binding import arrays, checks
from dahl.binding.checks import ONE_Q30
from dahl.binding.copies import Copied
from dahl.binding.friction import Plan
from dahl.binding.library import c
from dahl.errors import InputError


class Loaded(Copied):
    """A Dahl element whose Fc follows a load, given with each tick: normal force, torque through a
    gear, preload, temperature. By default sigma0 follows it too (dahl_loaded_state_t): F falls with
    the load, and is kept if the load grows. With fixed_stiffness, sigma0 is constant
    (dahl_clamped_step): a load that falls clamps F to load*Fc, and ticks are by angle. By either
    rule no closed cycle of motion and load returns energy.

    plan             of the element at a load of 1
    load             0 <= load < 2, rounded to 2^-30; at 1 the torques have the bits of
                     Friction(plan)
    fixed_stiffness  True: step() and run(), in rad; False: step_counts() and the like, in counts

    Error: 0.55 ulp of load*Fc; with fixed_stiffness 0.6 ulp of Fc, or of load*Fc if that is more,
    if each sigma0*|dtheta| is 0 or at least 2^-30 load*Fc: add up smaller moves before the call.
    Cost: 1 us a step or tick of run(), 20 ns a tick of run_counts(). The load is 0 at first.

    >>> gear = dahl.Loaded(dahl.Plan(100.0, 0.5, 1e-3))
    >>> gear.step_counts(10**6, load=1.5), gear.step_counts(0, load=0.5)
    (0.75, 0.25)
    >>> seat = dahl.Loaded(dahl.Plan(100.0, 0.5), fixed_stiffness=True)
    >>> seat.step(1e6, load=0.5), seat.step(0.0, load=1.5)
    (0.25, 0.25)
    """

    def __init__(self, plan: Plan, fixed_stiffness: bool = False) -> None:
        self._plan = checks.instance("plan", plan, Plan)
        self._fixed_stiffness = checks.instance("fixed_stiffness", fixed_stiffness, bool)
        if not fixed_stiffness:
            self._plan._need_counts()
        self._state = c.new("dahl_loaded_state_t *")

    @property
    def plan(self) -> Plan:
        """The parameters at a load of 1."""
        return self._plan

    @property
    def fixed_stiffness(self) -> bool:
        """Whether sigma0 is constant; moves are then in rad."""
        return self._fixed_stiffness

    @property
    def load(self) -> float:
        """Load of the last tick, 0 <= load < 2; 0 at first."""
        return float(self._state.load_q30 / ONE_Q30)

    @property
    def torque(self) -> float:
        """F in N m at the last load, without motion."""
        step = self._clamped_step if self._fixed_stiffness else self._step
        return step(0, self._state.load_q30)

    def step_counts(self, dcounts: int, load: float) -> float:
        """Apply the load, move by dcounts, a whole number within int32, and return F in N m."""
        self._need_rule(False, "step_counts")
        return self._step(checks.counts(dcounts), _load_q30(load))

    def step(self, dtheta: float, load: float) -> float:
        """Apply the load, then move by dtheta rad, and return F in N m. As in C, NaN is no motion
        and an infinite angle saturates at +-load*Fc.
        """
        self._need_rule(True, "step")
        angle = checks.real("dtheta", dtheta, "an angle in rad")
        return self._clamped_step(angle, _load_q30(load))

    def run(
        self, moves: ArrayLike, loads: ArrayLike, out: NDArray[np.float32] | None = None
    ) -> NDArray[np.float32]:
        """Moves in rad and a load for each, both of shape (n,) -> torques in N m after each, shape
        (n,), float32, into `out` if given: the bits of step().
        """
        self._need_rule(True, "run")
        array = arrays.moves(moves, arrays.FLOAT32)
        given, result = arrays.loads(loads, array), arrays.output(out, array)
        for k, (angle, load) in enumerate(zip(array.tolist(), given.tolist(), strict=True)):
            result[k] = self._clamped_step(angle, load)
        return result

    def step_counts_q30(self, dcounts: int, load: float) -> int:
        """Move as step_counts() does and return F/Fc in Q30, -2^31 .. 2^31: beyond 2^30 at a load
        above 1.
        """
        self._need_rule(False, "step_counts_q30")
        moved, load_q30 = checks.counts(dcounts), _load_q30(load)
        step = c.dahl_loaded_step_counts_q30
        return int(step(self._plan._prepared, self._state, moved, load_q30))

    def run_counts(
        self, moves: ArrayLike, loads: ArrayLike, out: NDArray[np.float32] | None = None
    ) -> NDArray[np.float32]:
        """Moves in counts and a load for each, both of shape (n,) -> torques in N m after each,
        shape (n,), float32, into `out` if given: the bits of step_counts().
        """
        self._need_rule(False, "run_counts")
        array = arrays.moves(moves, arrays.INT32)
        given, arguments = arrays.loads(loads, array), (self._plan._prepared, self._state)
        return arrays.run(c.dahl_batch_loaded_counts, arguments, array, out, given)

    def _step(self, dcounts: int, load_q30: int) -> float:
        step = c.dahl_loaded_step_counts
        return float(step(self._plan._prepared, self._state, dcounts, load_q30))

    def _clamped_step(self, dtheta: float, load_q30: int) -> float:
        """Step by the rule of fixed_stiffness, whose state in C has no load."""
        self._state.load_q30 = load_q30
        bristle = c.addressof(self._state, "bristle")
        return float(c.dahl_clamped_step(self._plan._prepared, bristle, dtheta, load_q30))

    def _need_rule(self, fixed: bool, call: str) -> None:
        if self._fixed_stiffness != fixed:
            there = "step(), run()" if self._fixed_stiffness else "step_counts(), run_counts()"
            rule = f"fixed_stiffness = {self._fixed_stiffness}"
            raise InputError(f"Loaded.{call}: {rule} moves by {there}")

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Loaded):
            return NotImplemented
        same = self._plan == other._plan and self._fixed_stiffness == other._fixed_stiffness
        return same and self._comparable() == other._comparable()

    def _comparable(self) -> tuple[int, int]:
        return self._state.bristle.w, self._state.load_q30

    __hash__ = None  # type: ignore[assignment]  # it changes with each step

    def __repr__(self) -> str:
        rule = ", fixed_stiffness=True" if self._fixed_stiffness else ""
        return f"Loaded({self._plan!r}{rule})"


def _load_q30(load: float) -> int:
    number = checks.real("load", load, "0 <= load < 2")
    if not 0 <= number < 2:
        raise InputError(f"load = {number!r} is outside 0 <= load < 2")
    return min(round(number * ONE_Q30), 2 * ONE_Q30 - 1)
