# SPDX-License-Identifier: MIT
"""Residual observer. Same names, units and bits as dahl_compensator.h."""

from __future__ import annotations

import math

from dahl.binding import checks, parameters
from dahl.binding.checks import INT32_MAX, INT32_MIN, ONE_Q30
from dahl.binding.compensator import FRICTION, OPTIONAL, POSITIVE, Compensator, need_reference
from dahl.binding.copies import Copied, content
from dahl.binding.library import c
from dahl.binding.parameters import HasParameters, Parameter
from dahl.errors import InputError

MAX_CORNER_HZ = 15.0  # suits most axes
NOISY_CORNER_HZ = 10.0  # a loop without an integral then holds as without an observer within 20 %
MAX_LIMIT_SHARE = 0.6400001  # limit over Fc, if the loop has an integral; 0.6400002 is refused


class Residual(HasParameters, Copied):
    """Add the torque that the friction model lacks (dahl_residual_t), for a Compensator with
    reference=True: a low-pass of the motor torque that neither a feed-forward nor the inertia
    explains. It follows a wrong or drifting Fc, viscous friction and a constant load.

    sigma0, Fc, theta_per_count, period, slew  those of the compensator
    inertia     kg m2      lower bound of all that moves: rotor and load
    corner      Hz         of the low-pass, at most 0.05/period
    limit       N m        largest torque: Fc/2, at most 0.64 Fc; with no_integral gain*Fc and load
    speed_gain  N m s/rad  torque per speed of the loop, at least 4*pi*corner*inertia; 0: unknown
    resonance   Hz         of the axis, at least 10*corner; unused with a speed_gain
    delay       ticks      from the command to its torque, 0 .. 3
    no_integral            True if the loop has no integral

    Objects are equal if parameters and state are. They can be pickled; a copy has a separate state.
    A tick costs about 2 us. Raises dahl.Error with the parameter, its value and its limit.

    >>> friction = (100.0, 0.5, 3.8e-4)
    >>> tick = {"slew": 50, "period": 1e-3}  # N m/s, s
    >>> compensator = dahl.Compensator(*friction, reference=True, limit=1.0, **tick)
    >>> residual = dahl.Residual(
    ...     *friction, inertia=0.002, corner=15.0, limit=0.25, speed_gain=0.4, **tick)
    >>> for _ in range(100):  # at rest against 0.1 N m that no feed-forward explains
    ...     _ = compensator.move(0)
    ...     torque = residual.torque(compensator, 0)  # N m, to add to the command
    ...     residual.note(0.1)
    >>> round(torque, 4)
    0.1
    """

    sigma0 = Parameter(parameters.SIGMA0)
    Fc = Parameter(parameters.FC)
    theta_per_count = Parameter(parameters.COUNTED)
    inertia = Parameter(POSITIVE.format("inertia", "kg m2"))
    corner = Parameter(POSITIVE.format("corner", "Hz"))
    limit = Parameter(POSITIVE.format("limit", "N m"))
    speed_gain = Parameter(OPTIONAL.format("speed_gain", "N m s/rad"))
    resonance = Parameter(OPTIONAL.format("resonance", "Hz"))
    slew = Parameter(POSITIVE.format("slew", "N m/s"))
    period = Parameter(POSITIVE.format("period", "s"))

    def __init__(
        self,
        sigma0: float,
        Fc: float,  # noqa: N803 (the field's name)
        theta_per_count: float,
        *,
        inertia: float,
        corner: float,
        limit: float,
        slew: float,
        period: float,
        speed_gain: float = 0.0,
        resonance: float = 0.0,
        delay: int = 1,
        no_integral: bool = False,
    ) -> None:
        given = {"sigma0": sigma0, "Fc": Fc, "theta_per_count": theta_per_count}
        given |= {"inertia": inertia, "corner": corner, "limit": limit, "slew": slew}
        given |= {"speed_gain": speed_gain, "resonance": resonance, "period": period}
        self._set_values(given)
        self._delay = checks.whole("delay", delay, 0, c.DAHL_RESIDUAL_TICKS - 1)
        self._no_integral = checks.instance("no_integral", no_integral, bool)
        self._state = c.new("dahl_residual_t *")
        self._prepare()

    @classmethod
    def for_compensator(
        cls,
        compensator: Compensator,
        *,
        inertia: float,
        speed_gain: float = 0.0,
        resonance: float = 0.0,
        corner: float | None = None,
        limit: float | None = None,
        delay: int = 1,
        no_integral: bool = False,
    ) -> Residual:
        """Return an observer with friction, period and slew of a compensator. Without a corner, the
        highest one that the rule allows is used, up to 15 Hz. If the loop has no integral and the
        noise is above a quarter of the presliding length, it is up to 10 Hz. Without a limit, it is
        Fc/2, or Fc if the loop has no integral. Raises as the constructor, and dahl.Error for a
        compensator of the measured law.
        """
        checks.instance("compensator", compensator, Compensator)
        if corner is None:
            corner = _highest_corner(compensator, inertia, speed_gain, resonance)
            if no_integral and _is_noisy(compensator):
                corner = min(corner, NOISY_CORNER_HZ)
        if limit is None:
            limit = compensator.Fc if no_integral else compensator.Fc / 2
        friction = {name: getattr(compensator, name) for name in FRICTION}
        made = cls(
            **friction,
            inertia=inertia,
            corner=corner,
            limit=limit,
            slew=compensator.slew,
            period=compensator.period,
            speed_gain=speed_gain,
            resonance=resonance,
            delay=delay,
            no_integral=no_integral,
        )
        need_reference(compensator, made._values)
        return made

    def _prepare(self) -> None:
        self._prepared = c.new("dahl_residual_plan_t *")
        own = dict(self._values)
        friction = {name: own.pop(name) for name in FRICTION}
        given = {"friction": friction, "period": own.pop("period"), "slew": own.pop("slew")}
        given["law"] = c.DAHL_COMPENSATOR_REFERENCE
        params = c.new("dahl_compensator_params_t *", given)
        own |= {"delay": self._delay, "no_integral": self._no_integral}
        residual = c.new("dahl_residual_params_t *", own)
        code = c.dahl_residual_prepare(self._prepared, params, residual)
        if code != c.DAHL_COMPENSATOR_OK:
            raise InputError(self._refusal(code))

    def _refusal(self, code: int) -> str:
        """Return the value and the limit that the library refused."""
        v = self._values
        if code == c.DAHL_COMPENSATOR_CORNER and v["speed_gain"] == 0:
            return f"corner = {v['corner']:g} Hz is above resonance/10"
        if code == c.DAHL_COMPENSATOR_CORNER:
            most = v["speed_gain"] / (4 * math.pi * v["inertia"])
            return f"corner = {v['corner']:.9g} Hz is above speed_gain/(4*pi*inertia) = {most:.9g}"
        for name, value in v.items():
            if name not in FRICTION and not _is_in_range(name, value):
                return f"{name} = {value:g} is outside {self._limits[name]}"
        if v["speed_gain"] == v["resonance"] == 0:
            return "speed_gain = resonance = 0: one of them must be known"
        parameters.need_counted(v["theta_per_count"])
        are_in_range = all(_is_in_range(name, v[name]) for name in FRICTION)
        return (self._refusal_of_tick() if are_in_range else "") or parameters.refusal(
            *(v[name] for name in FRICTION)
        )

    def _refusal_of_tick(self) -> str:
        """Return the refusal of a limit or of a value at this period, or ""."""
        v = self._values
        if v["limit"] > MAX_LIMIT_SHARE * v["Fc"] and not self._no_integral:
            most = f"0.64 Fc = {MAX_LIMIT_SHARE * v['Fc']:g} N m"
            return f"limit = {v['limit']:g} N m is above {most}; no_integral = False"
        if v["slew"] * v["period"] / v["Fc"] < 2.000001 / 2**24:
            return f"slew = {v['slew']:g} N m/s is below 2^-23 Fc in a tick"
        if 20 * v["corner"] * v["period"] > 1:
            return f"corner = {v['corner']:g} Hz is above 0.05/period"
        speed = 2 * v["theta_per_count"] / v["period"]
        if 2 * math.pi * v["corner"] * v["inertia"] * speed > 63.9999 * v["Fc"]:
            return f"inertia = {v['inertia']:g}: 2*pi*corner*inertia of 2 counts is 64 Fc or more"
        return ""

    @property
    def delay(self) -> int:
        """Ticks from the command to its torque."""
        return self._delay

    @property
    def no_integral(self) -> bool:
        """Whether the loop has no integral, so that limit may be above 0.64 Fc."""
        return self._no_integral

    @property
    def terms(self) -> dict[str, float]:
        """The state after the last tick in N m: `raw` before the second low-pass, `filtered` before
        limit, fade and slew, and `torque`.
        """
        state, unit = self._state, self.Fc * 2.0**-56
        terms = {"raw": state.raw_q56 * unit, "filtered": state.filtered_q56 * unit}
        return terms | {"torque": state.torque_q24 * 2.0**-24 * self.Fc}

    def torque_q30(self, compensator: Compensator, dcounts: int) -> int:
        """Return the torque to add to the command over Fc, in Q30. Call it after
        compensator.move(dcounts). Raises dahl.Error for a compensator of another law, Fc, count or
        period, and for counts beyond int32.
        """
        need_reference(compensator, self._values)
        moved, axis = checks.counts(dcounts), compensator._state
        return int(c.dahl_residual_torque(self._prepared, self._state, axis, moved))

    def torque(self, compensator: Compensator, dcounts: int) -> float:
        """Return the torque of torque_q30() in N m."""
        return self.torque_q30(compensator, dcounts) / ONE_Q30 * self.Fc

    def note(self, unexplained: float) -> None:
        """Note the torque of a tick; call it once in a tick, at the end. unexplained is the motor
        torque in N m, as the drive gets it, less the feed-forwards of friction and gravity. That of
        the inertia and the result of torque() stay in it.
        """
        torque = checks.finite("unexplained", unexplained, "N m")
        most = parameters.TORQUE_MAX / 2  # far beyond 64 Fc, and a finite float
        self.note_q24(int(c.dahl_residual_q24(self._prepared, min(max(torque, -most), most))))

    def note_q24(self, unexplained_q24: int) -> None:
        """Do the same as note(). unexplained_q24 is over Fc in Q24, a whole number within int32."""
        unexplained_q24 = checks.whole("unexplained_q24", unexplained_q24, INT32_MIN, INT32_MAX)
        c.dahl_residual_note(self._state, unexplained_q24)

    def change(self, **changed: float) -> None:
        """Change parameters between two ticks, by the names of the constructor, next to
        Compensator.change(). The next torque is within the new limit, and it differs from the last
        one by at most slew*period, both in N m; if the new limit is below the torque, it falls to
        it at once. Raises TypeError or dahl.Error, and changes nothing, for parameters that the
        constructor rejects.
        """
        to = Residual(**{**self._values, **self._counts(), **changed})  # type: ignore[arg-type]
        c.dahl_residual_change(self._prepared, to._prepared, self._state)
        state = self._state
        self.__dict__.update(to.__dict__)
        self._state = state

    def _counts(self) -> dict[str, int]:
        return {"delay": self._delay, "no_integral": self._no_integral}

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Residual):
            return NotImplemented
        same = self._values == other._values and self._counts() == other._counts()
        return same and content(self._state) == content(other._state)

    __hash__ = None  # type: ignore[assignment]  # it changes with each tick

    def __repr__(self) -> str:
        more = ", ".join(f"{name}={value}" for name, value in self._counts().items())
        return f"Residual({self._shown_values()}, {more})"


def _is_in_range(name: str, value: float) -> bool:
    if value == 0:
        return name in ("speed_gain", "resonance")
    return parameters.TORQUE_MIN <= value < parameters.TORQUE_MAX


def _is_noisy(law: Compensator) -> bool:
    """Whether the flicker of the counts is above a quarter of the presliding length."""
    return 4 * (2 * law.noise + 1) * law.theta_per_count * law.sigma0 > law.Fc


def _highest_corner(law: Compensator, inertia: float, speed_gain: float, resonance: float) -> float:
    """Return the highest corner of the rules up to 15 Hz. The constructor refuses wrong values."""
    given = {"inertia": inertia, "speed_gain": speed_gain, "resonance": resonance}
    inertia, speed_gain, resonance = (checks.real(name, value) for name, value in given.items())
    rule = MAX_CORNER_HZ
    if speed_gain > 0 and inertia > 0:
        rule = speed_gain / (4 * math.pi * inertia)
    elif resonance > 0:
        rule = resonance / 10
    below = 1 - 2.0**-20  # for the rounding to float
    if inertia > 0:  # two counts in a tick must not saturate the observer
        speed = 2 * law.theta_per_count / law.period
        rule = min(rule, 63.999 * law.Fc / (2 * math.pi * inertia * speed))
    return below * min(MAX_CORNER_HZ, rule, 0.05 / law.period)
