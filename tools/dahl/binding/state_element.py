# SPDX-License-Identifier: MIT
"""Elements with the state of one bristle, a dahl_state_t, and their base (dahl_parts.h)."""

from __future__ import annotations

import math
from typing import Any

from dahl.binding import checks, parameters
from dahl.binding.elements import RatioElement
from dahl.binding.friction import Plan, State
from dahl.binding.library import c
from dahl.binding.parameters import HasParameters, Parameter
from dahl.errors import Error, InputError


class StateElement(HasParameters, RatioElement):
    """An element with parameters, in the order of __init__, and the state of one bristle."""

    def _set(self, *values: float) -> None:
        self._set_values(dict(zip(self._limits, values, strict=True)))
        self._state = State()
        self._prepare()

    def _prepare(self) -> None:
        self._prepared = c.new(f"dahl_{self._kind}plan_t *")
        if getattr(c, f"dahl_{self._kind}prepare")(self._prepared, *self._params()) != 0:
            raise InputError(self._refusal())

    def _params(self) -> tuple[Any, ...]:
        """Return the arguments of dahl_.._prepare after the plan."""
        raise NotImplementedError

    def _refusal(self) -> str:
        raise NotImplementedError

    def _arguments(self) -> tuple[Any, ...]:
        return self._prepared, self._state._c

    @property
    def state(self) -> State:
        """The state, live: a whole number, 0 is relaxed, +-2^62 is +-Fc (the larger Fc)."""
        return self._state

    def __eq__(self, other: object) -> bool:
        if type(other) is not type(self):
            return NotImplemented
        return (self._values, self._state) == (other._values, other._state)

    __hash__ = None  # type: ignore[assignment]  # it changes with each step

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self._shown_values()})"


class Asymmetric(StateElement):
    """Friction with one Fc for each direction (dahl_asymmetric_plan_t): dF/dtheta =
    sigma0 (1 - F/Fc_forward) forward, sigma0 (1 + F/Fc_backward) backward.

    sigma0           N m/rad  stiffness at F = 0 in both directions, range as in Plan
    Fc_forward       N m      F after a long move forward, range of Fc in Plan
    Fc_backward      N m      -F after a long move backward, the same range
    theta_per_count  rad      per encoder count; sigma0/Fc*theta_per_count in the range of Plan for
                              either Fc

    Cost: 1 us a step, 10 ns a tick of run_counts().

    >>> seal = dahl.Asymmetric(sigma0=100.0, Fc_forward=0.5, Fc_backward=0.25, theta_per_count=1e-3)
    >>> seal.step_counts(10**6), seal.step_counts(-(10**6))
    (0.5, -0.25)
    """

    _kind = "asymmetric_"
    sigma0 = Parameter(parameters.SIGMA0)
    Fc_forward = Parameter(parameters.FC.replace("Fc", "Fc_forward"))
    Fc_backward = Parameter(parameters.FC.replace("Fc", "Fc_backward"))
    theta_per_count = Parameter(parameters.COUNTED)

    def __init__(
        self,
        sigma0: float,
        Fc_forward: float,  # noqa: N803 (the field's name)
        Fc_backward: float,  # noqa: N803
        theta_per_count: float,
    ) -> None:
        self._set(sigma0, Fc_forward, Fc_backward, theta_per_count)

    def _params(self) -> tuple[Any, ...]:
        return (c.new("dahl_asymmetric_params_t *", self._values),)

    def _refusal(self) -> str:
        parameters.need_counted(self.theta_per_count)
        for name in ("Fc_forward", "Fc_backward"):
            try:
                Plan(self.sigma0, self._values[name], self.theta_per_count)
            except Error as error:
                return str(error).replace("Fc", name)
        return f"{self!r} is refused by dahl_asymmetric_prepare"


class ElastoPlastic(StateElement):
    """Elasto-plastic friction (Dupont 2002; over space as in Hayward 2009;
    dahl_elastoplastic_plan_t): a spring without creep up to F = breakaway*Fc in the direction of
    motion, then Dahl's curve with a continuous slope.

    sigma0           N m/rad  stiffness of the spring, range as in Plan
    Fc               N m      Coulomb torque, range as in Plan
    theta_per_count  rad      per encoder count, range as in Plan, not 0
    breakaway        fraction of Fc at which it begins to slide, 0 < breakaway < 1

    Cost: 1 us a step, 10 ns a tick of run_counts().

    >>> bearing = dahl.ElastoPlastic(sigma0=128.0, Fc=0.5, theta_per_count=2**-13, breakaway=0.7)
    >>> bearing.step_counts(16), bearing.step_counts(-16)
    (0.25, 0.0)
    """

    _kind = "elastoplastic_"
    sigma0 = Parameter(parameters.SIGMA0)
    Fc = Parameter(parameters.FC)
    theta_per_count = Parameter(parameters.COUNTED)
    breakaway = Parameter("0 < breakaway < 1 (part of Fc)")

    def __init__(
        self,
        sigma0: float,
        Fc: float,  # noqa: N803 (the field's name)
        theta_per_count: float,
        breakaway: float,
    ) -> None:
        self._set(sigma0, Fc, theta_per_count, breakaway)

    def _params(self) -> tuple[Any, ...]:
        *dahl, breakaway = self._values.values()
        return c.new("dahl_params_t *", dahl), breakaway

    def _refusal(self) -> str:
        parameters.need_counted(self.theta_per_count)
        Plan(self.sigma0, self.Fc, self.theta_per_count)
        shown, limit = parameters.digits(self.breakaway), self._limits["breakaway"]
        return f"breakaway = {shown} is outside {limit}"


class Stribeck(StateElement):
    """Dahl's bristle with an Fc that falls with speed v (LuGre without sigma1;
    dahl_stribeck_plan_t): Fc(v) = Fc + (Fs - Fc) exp(-(v/vs)^2), vs the Stribeck speed.

    sigma0           N m/rad  stiffness at F = 0, range as in Plan
    Fs               N m      |F| after a long slow move, range of Fc in Plan
    Fc               N m      |F| after a long fast move, Fs/16 to 16 Fs
    theta_per_count  rad      per encoder count, range as in Plan, not 0
    stribeck         rad      travel of a tick at vs: vs times the period of ticks, at least
                              4 theta_per_count. 0: only step_at_speed() knows fast moves

    step_counts() and run_counts() take the counts of one tick as its speed. The state has the sign
    and size of F over the larger of Fs and Fc. Error: 0.62 ulp of it.

    Cost: 1 us a step, 40 ns a tick of run_counts().

    >>> seal = dahl.Stribeck(sigma0=100, Fs=0.75, Fc=0.5, theta_per_count=1e-4, stribeck=1e-2)
    >>> [seal.step_counts(1) for _ in range(1000)][-1], seal.step_counts(10**6)
    (0.7499737739562988, 0.5)
    """

    _kind = "stribeck_"
    sigma0 = Parameter(parameters.SIGMA0)
    Fs = Parameter(parameters.FC.replace("Fc", "Fs"))
    Fc = Parameter(parameters.FC)
    theta_per_count = Parameter(parameters.COUNTED)
    stribeck = Parameter("4 theta_per_count <= stribeck < 2^64 (rad a tick), or 0")

    def __init__(
        self,
        sigma0: float,
        Fs: float,  # noqa: N803 (the field's name)
        Fc: float,  # noqa: N803
        theta_per_count: float,
        stribeck: float,
    ) -> None:
        self._set(sigma0, Fs, Fc, theta_per_count, stribeck)

    def step_at_speed(self, dcounts: int, speed: float) -> float:
        """Move by dcounts at a speed that the caller knows, in parts of vs, and return F in N m.
        The sign of the speed is ignored; beyond 2047 it counts as 2047.
        """
        return float(c.dahl_stribeck_step_at_speed(*self._at_speed(dcounts, speed)))

    def step_at_speed_q30(self, dcounts: int, speed: float) -> int:
        """Move as step_at_speed() does and return F over the larger of Fs and Fc in Q30."""
        return int(c.dahl_stribeck_step_at_speed_q30(*self._at_speed(dcounts, speed)))

    def _at_speed(self, dcounts: int, speed: float) -> tuple[Any, ...]:
        size = abs(checks.real("speed", speed, "a number (of vs)"))
        if math.isnan(size):
            raise InputError(f"speed = {speed} is no number (of vs)")
        return *self._arguments(), checks.counts(dcounts), round(min(size, 2047.0) * 2**20)

    def _params(self) -> tuple[Any, ...]:
        return (c.new("dahl_stribeck_params_t *", list(self._values.values())),)

    def _refusal(self) -> str:
        parameters.need_counted(self.theta_per_count)
        for name in ("Fs", "Fc"):
            try:
                Plan(self.sigma0, self._values[name], self.theta_per_count)
            except Error as error:
                return str(error).replace("Fc", name)
        if not 1 / 16 <= self.Fs / self.Fc <= 16:
            fs = parameters.digits(self.Fs)
            return f"Fc = {parameters.digits(self.Fc)} is outside Fs/16 .. 16 Fs of Fs = {fs} (N m)"
        shown, least = parameters.digits(self.stribeck), f"{4 * self.theta_per_count:.6g}"
        limit = self._limits["stribeck"].replace("count <", f"count = {least} <")
        return f"stribeck = {shown} is outside {limit}"
