# SPDX-License-Identifier: MIT
"""ElastoPlastic, without creep below breakaway (dahl_parts.h)."""

from __future__ import annotations

from typing import Any

from dahl.binding import parameters
from dahl.binding.bristles import Bristle
from dahl.binding.friction import Plan
from dahl.binding.library import c
from dahl.binding.parameters import Parameter


class ElastoPlastic(Bristle):
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
