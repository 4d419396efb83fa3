# SPDX-License-Identifier: MIT
"""Presliding damping. Same names, units and bits as dahl_parts.h."""

from __future__ import annotations

from dahl.binding import checks, parameters
from dahl.binding.checks import INT32_MAX, INT32_MIN, ONE_Q30
from dahl.binding.copies import Copied, content
from dahl.binding.library import c
from dahl.binding.parameters import HasParameters, Parameter
from dahl.errors import InputError

SIGMA1 = "2^-64 <= sigma1 < 2^64 (N m s/rad)"
PERIOD = "2^-64 <= period < 2^64 (s)"


class Damping(HasParameters, Copied):
    """Damp an element whose torque a motor renders (dahl_damping_t): a knob, a wheel of a
    simulator. It adds sigma1/sigma0*dF of a tick, so it acts by travel only.

    sigma0, Fc  of the element: steepest stiffness and torque of the ratio 1
    sigma1      N m s/rad  2*zeta*sqrt(inertia*sigma0), with zeta 0.2 to 0.3 and all that the motor
                           turns as inertia
    period      s          of a tick

    Objects are equal if parameters and state are. They can be pickled; a copy has a separate state.
    Raises dahl.Error with the parameter, its value and its limit.

    >>> knob = dahl.Friction(dahl.Plan(500.0, 1.0, 3.8e-4))
    >>> damping = dahl.Damping(500.0, 1.0, sigma1=1.9, period=1e-3)
    >>> [round(damping.apply(knob.step_counts_q30(move)), 3) for move in (1, 1, 0)]  # N m
    [0.831, 0.86, 0.316]
    """

    sigma0 = Parameter(parameters.SIGMA0)
    Fc = Parameter(parameters.FC)
    sigma1 = Parameter(SIGMA1)
    period = Parameter(PERIOD)

    def __init__(
        self,
        sigma0: float,
        Fc: float,  # noqa: N803 (the field's name)
        *,
        sigma1: float,
        period: float,
    ) -> None:
        self._set_values({"sigma0": sigma0, "Fc": Fc, "sigma1": sigma1, "period": period})
        self._state = c.new("dahl_damping_t *")
        self._prepare()

    def _prepare(self) -> None:
        self._prepared = c.new("dahl_damping_plan_t *")
        params = c.new("dahl_params_t *", [self.sigma0, self.Fc, 0.0])
        if c.dahl_damping_prepare(self._prepared, params, self.sigma1, self.period) != c.DAHL_OK:
            raise InputError(self._refusal())

    def _refusal(self) -> str:
        """Return the value and the limit that the library refused."""
        least, most = parameters.TORQUE_MIN, parameters.TORQUE_MAX
        is_bad = {name: not least <= value < most for name, value in self._values.items()}
        if is_bad["sigma0"] or is_bad["Fc"]:
            return parameters.refusal(self.sigma0, self.Fc, 0.0)
        for name in ("sigma1", "period"):
            if is_bad[name]:
                return f"{name} = {self._values[name]:g} is outside {self._limits[name]}"
        gain = self.sigma1 / (self.sigma0 * self.period)
        return f"sigma1/(sigma0*period) = {gain:g} is outside 2^-16 .. 32767"

    def apply_q30(self, ratio_q30: int) -> int:
        """Return the torque of the element with damping over Fc, in Q30, at most 2 Fc. Call it once
        in each tick with the result of the element's step_counts_q30(). Raises TypeError or
        dahl.Error unless it is a whole number within int32.
        """
        ratio_q30 = checks.whole("ratio_q30", ratio_q30, INT32_MIN, INT32_MAX)
        return int(c.dahl_damping_apply(self._prepared, self._state, ratio_q30))

    def apply(self, ratio_q30: int) -> float:
        """Return the torque of apply_q30() in N m."""
        return self.apply_q30(ratio_q30) / ONE_Q30 * self.Fc

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Damping):
            return NotImplemented
        same = self._values == other._values
        return same and content(self._state) == content(other._state)

    __hash__ = None  # type: ignore[assignment]  # it changes with each tick

    def __repr__(self) -> str:
        return f"Damping({self._shown_values()})"
