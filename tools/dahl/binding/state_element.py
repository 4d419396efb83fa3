# SPDX-License-Identifier: MIT
"""Elements with the state of one bristle, a dahl_state_t, and their base (dahl_parts.h)."""

from __future__ import annotations

from typing import Any

from dahl.binding import parameters
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
