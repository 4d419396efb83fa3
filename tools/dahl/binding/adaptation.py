# SPDX-License-Identifier: MIT
"""Adaptation of Fc to a drift. Same names, units and bits as dahl_compensator.h."""

from __future__ import annotations

from dahl.binding import checks, parameters
from dahl.binding.checks import INT32_MAX, INT32_MIN
from dahl.binding.compensator import FRICTION, Compensator, need_reference
from dahl.binding.copies import Copied, content
from dahl.binding.library import c
from dahl.binding.parameters import HasParameters, Parameter
from dahl.errors import InputError

ONE_Q24 = 2**24
PERIOD_MAX_S = 0.02
INERTIA = "2^-64 <= inertia < 2^64 (kg m2)"
PERIOD = "2^-64 <= period <= 0.02 (s)"


class Adaptation(HasParameters, Copied):
    """Follow an Fc that drifts with temperature or wear (dahl_adaptation_t), for a Compensator with
    reference=True. Viscous friction and the force of a hand look like Fc to it.

    sigma0, Fc, theta_per_count, period  those of the compensator
    inertia      kg m2  rotor and all that moves with it

    Objects are equal if parameters and state are. They can be pickled; a copy has a separate state.
    A tick costs about 2 us. Raises dahl.Error with the parameter, its value and its limit.

    >>> friction = (100.0, 0.5, 3.8e-4)
    >>> bearing = dahl.Friction(dahl.Plan(*friction))
    >>> compensator = dahl.Compensator(*friction, reference=True, limit=1.0, slew=50, period=1e-3)
    >>> adaptation = dahl.Adaptation(*friction, inertia=0.002, period=1e-3)
    >>> for tick in range(3000):  # to and fro at 0.38 rad/s against 0.6 N m
    ...     move = 1 if tick % 1000 < 500 else -1
    ...     _ = compensator.move(move)
    ...     w = adaptation.apply_q30(bearing.step_counts_q30(move))
    ...     torque = compensator.torque(w)  # N m, to add to the command
    ...     adaptation.step(compensator, 0.6 * move)
    >>> round(adaptation.Fc_estimate, 3)
    0.525
    """

    sigma0 = Parameter(parameters.SIGMA0)
    Fc = Parameter(parameters.FC)
    theta_per_count = Parameter(parameters.COUNTED)
    inertia = Parameter(INERTIA)
    period = Parameter(PERIOD)

    def __init__(
        self,
        sigma0: float,
        Fc: float,  # noqa: N803 (the field's name)
        theta_per_count: float,
        *,
        inertia: float,
        period: float,
    ) -> None:
        given = {"sigma0": sigma0, "Fc": Fc, "theta_per_count": theta_per_count}
        given |= {"inertia": inertia, "period": period}
        self._set_values(given)
        self._state = c.new("dahl_adaptation_t *")
        self._prepare()

    def _prepare(self) -> None:
        self._prepared = c.new("dahl_adaptation_plan_t *")
        friction = {name: self._values[name] for name in FRICTION}
        law = c.DAHL_COMPENSATOR_REFERENCE
        given = {"friction": friction, "law": law, "period": self.period}
        params = c.new("dahl_compensator_params_t *", given)
        code = c.dahl_adaptation_prepare(self._prepared, params, self.inertia)
        if code != c.DAHL_COMPENSATOR_OK:
            raise InputError(self._refusal())

    def _refusal(self) -> str:
        """Return the value and the limit that the library refused."""
        least, most = parameters.TORQUE_MIN, parameters.TORQUE_MAX
        if not least <= self.inertia < most:
            return f"inertia = {self.inertia:g} is outside {INERTIA}"
        if not least <= self.period <= PERIOD_MAX_S:
            return f"period = {self.period:g} is outside {PERIOD}"
        parameters.need_counted(self.theta_per_count)
        return parameters.refusal(*(self._values[name] for name in FRICTION))

    @property
    def Fc_estimate(self) -> float:  # noqa: N802 (the field's name)
        """N m, 0.5 to 1.5 times Fc; Fc at first."""
        change = float(self._state.Fc_change_q16) * 2.0**-16
        return self.Fc * (1 + change)

    @property
    def terms(self) -> dict[str, float]:
        """The state after the last tick: `speed` in rad/s, `friction` of the element in N m, and
        ticks: `sliding_ticks`, `age_ticks`, `samples_forward`, `samples_backward`.
        """
        state = self._state
        return {
            "friction": state.ratio_q30 * 2.0**-30 * self.Fc,
            "speed": state.speed_q20 * 2.0**-20,
            "sliding_ticks": state.sliding_ticks,
            "age_ticks": state.age_ticks,
            "samples_forward": state.samples[0],
            "samples_backward": state.samples[1],
        }

    def apply_q30(self, ratio_q30: int) -> int:
        """Return the torque of the element times Fc_estimate/Fc, in Q30 of Fc, at most 2 Fc. Call
        it before Compensator.torque(). Raises TypeError or dahl.Error unless it is a whole number
        within int32.
        """
        ratio_q30 = checks.whole("ratio_q30", ratio_q30, INT32_MIN, INT32_MAX)
        return int(c.dahl_adaptation_apply(self._state, ratio_q30))

    def step(self, compensator: Compensator, motor: float) -> None:
        """Read one tick; call it after Compensator.torque(). motor is the whole motor torque in
        N m during the last tick. Raises dahl.Error for a compensator of another law, Fc, count or
        period, and for a torque that is not finite.
        """
        ratio = checks.finite("motor", motor, "N m") / self.Fc
        limit = INT32_MAX / ONE_Q24  # far beyond the 4 Fc of a sample
        self.step_q24(compensator, round(min(max(ratio, -limit), limit) * ONE_Q24))

    def step_q24(self, compensator: Compensator, motor_q24: int) -> None:
        """Do the same as step(). motor_q24 is motor over Fc in Q24, a whole number within int32."""
        need_reference(compensator, self._values)
        motor_q24 = checks.whole("motor_q24", motor_q24, INT32_MIN, INT32_MAX)
        c.dahl_adaptation_step(self._prepared, self._state, compensator._state, motor_q24)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Adaptation):
            return NotImplemented
        same = self._values == other._values
        return same and content(self._state) == content(other._state)

    __hash__ = None  # type: ignore[assignment]  # it changes with each tick

    def __repr__(self) -> str:
        return f"Adaptation({self._shown_values()})"
