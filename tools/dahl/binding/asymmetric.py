# SPDX-License-Identifier: MIT
"""Asymmetric, with one Fc for each direction (dahl_parts.h)."""

from __future__ import annotations

from typing import Any

from dahl.binding import parameters
from dahl.binding.bristles import Bristle
from dahl.binding.friction import Plan
from dahl.binding.library import c
from dahl.binding.parameters import Parameter
from dahl.errors import Error


class Asymmetric(Bristle):
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
