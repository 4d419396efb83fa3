# SPDX-License-Identifier: MIT
"""Torque that cancels friction. Same names, units and bits as dahl_compensator.h."""

from __future__ import annotations

import math
import os
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dahl.binding import arrays, checks, identified, parameters
from dahl.binding.checks import INT32_MAX, INT32_MIN, ONE_Q30
from dahl.binding.copies import Copied, content
from dahl.binding.elements import RatioElement
from dahl.binding.library import c
from dahl.binding.parameters import HasParameters, Parameter
from dahl.errors import InputError

FRICTION = ("sigma0", "Fc", "theta_per_count")
BOUNDS = ("Fc_low", "length_long")  # the reference law needs none
AXIS = ("sigma0_high", "load", "inertia", "delay")  # the reference law ignores them
NEEDED = {*BOUNDS, *AXIS} - {"load"}  # of the measured law
POSITIVE, OPTIONAL = "2^-64 <= {} < 2^64 ({})", "0, or 2^-64 <= {} < 2^64 ({})"


class Compensator(HasParameters, Copied):
    """Feed-forward torque that cancels friction (dahl_compensator_t), faded out at first. It needs
    an element: call move() before the step of the element, torque() after it.

    sigma0, Fc, theta_per_count  of the element: steepest stiffness and torque of the ratio 1
    reference    False: the measured counts step the element; True: those of the reference do
    Fc_low       N m    lower bound of the true Fc; 0 with reference: no check
    length_long  rad    upper bound of the true presliding length; 0 with reference: no check
    sigma0_high  N m/rad  upper bound of the true steepest stiffness
    load         N m    largest constant torque from outside
    inertia      kg m2  what turns with the encoder; the rotor alone if elastic
    delay        s      from the reading to the torque, with the lag of the current loop
    elastic      True with a gear, belt, coupling or resonance between motor and load
                        These five are for the law of the measured counts, ignored with reference
    gain         0 .. 1, gain*Fc <= 0.95*(Fc_low - load), with reference: <= Fc_low
    limit        N m    largest torque, > 0
    slew         N m/s  largest change of the torque, at least 2^-29 Fc in a tick
    period       s      of a tick
    rise, fall   s      to fade in, and to fade out while the encoder is bad, at most 2^30 ticks;
                        0: at once
    fade_speed   rad/s  no torque from twice this speed; 0: no fade over speed
    noise, play, jump   counts: +-noise of the encoder, width of the play >= 2*noise and >= 1
                        (2*noise + 2 is safe), longest move of a tick, below 1000 times that of
                        fade_speed

    Two are equal if parameters and state are; picklable; a copy has a state of its own. A tick
    costs about 2 us from Python. Raises dahl.Error with the parameter, its value and its limit.

    >>> plan = dahl.Plan(sigma0=100.0, Fc=0.5, theta_per_count=3.8e-4)
    >>> bearing = dahl.Friction(plan)
    >>> compensator = dahl.Compensator(
    ...     100.0, 0.5, 3.8e-4, Fc_low=0.5, length_long=0.005, sigma0_high=120.0, inertia=0.002,
    ...     delay=2e-3, gain=0.9, limit=1.0, slew=50.0, period=1e-3, play=2, noise=1)
    >>> w = bearing.step_counts_q30(compensator.move(902))
    >>> round(compensator.torque(w), 6), compensator.terms["move"]  # N m, counts
    (0.05, 900)
    """

    sigma0 = Parameter(parameters.SIGMA0)
    Fc = Parameter(parameters.FC)
    theta_per_count = Parameter(parameters.COUNTED)
    Fc_low = Parameter(OPTIONAL.format("Fc_low", "N m"))
    length_long = Parameter(OPTIONAL.format("length_long", "rad"))
    sigma0_high = Parameter(POSITIVE.format("sigma0_high", "N m/rad"))
    load = Parameter(OPTIONAL.format("load", "N m"))
    inertia = Parameter(POSITIVE.format("inertia", "kg m2"))
    delay = Parameter(POSITIVE.format("delay", "s"))
    gain = Parameter("0, or 2^-64 <= gain <= 1")
    limit = Parameter(POSITIVE.format("limit", "N m"))
    slew = Parameter(POSITIVE.format("slew", "N m/s"))
    period = Parameter(POSITIVE.format("period", "s"))
    rise = Parameter(OPTIONAL.format("rise", "s"))
    fall = Parameter(OPTIONAL.format("fall", "s"))
    fade_speed = Parameter(OPTIONAL.format("fade_speed", "rad/s"))

    def __init__(
        self,
        sigma0: float,
        Fc: float,  # noqa: N803 (the field's name)
        theta_per_count: float,
        *,
        period: float,
        limit: float,
        slew: float,
        gain: float = 0.9,
        Fc_low: float = 0.0,  # noqa: N803
        length_long: float = 0.0,
        sigma0_high: float = 0.0,
        load: float = 0.0,
        inertia: float = 0.0,
        delay: float = 0.0,
        elastic: bool = False,
        reference: bool = False,
        rise: float = 0.0,
        fall: float = 0.0,
        fade_speed: float = 0.0,
        noise: int = 0,
        play: int = 1,
        jump: int = 1000,
    ) -> None:
        given = dict(sigma0=sigma0, Fc=Fc, theta_per_count=theta_per_count, Fc_low=Fc_low)
        given |= dict(length_long=length_long, sigma0_high=sigma0_high, load=load)
        given |= dict(inertia=inertia, delay=delay, gain=gain, limit=limit, slew=slew)
        given |= dict(period=period, rise=rise, fall=fall, fade_speed=fade_speed)
        self._set_values(given)
        self._reference = checks.instance("reference", reference, bool)
        self._elastic = checks.instance("elastic", elastic, bool)
        self._noise = checks.whole("noise", noise, 0, c.DAHL_COMPENSATOR_PLAY_MAX // 2)
        self._play = checks.whole("play", play, 1, c.DAHL_COMPENSATOR_PLAY_MAX)
        self._jump = checks.whole("jump", jump, 1, c.DAHL_COMPENSATOR_JUMP_MAX)
        self._state = c.new("dahl_compensator_t *")
        self._prepare()

    @classmethod
    def from_identified(
        cls, path: str | os.PathLike[str], *, ratio: float | None = None, **given: Any
    ) -> Compensator:
        """Return a compensator with the bounds of the JSON that `dahl identify` writes.

        sigma0, Fc, Fc_low, length_long and sigma0_high follow from the file; `given` has the other
        parameters of the constructor. Those with a default here may be left out:

        gain     0.9*(Fc_low - load)/Fc_low, with reference: 1
        limit    1.2*Fc_low
        slew     100 Fc_low in a second, or more if a light rotor needs it
        play     2*noise + 2, or 1 without noise
        rise, fall   0.5 s, 0.02 s

        ratio    rad of the motor for one rad of the log: of a gear if the log is from its output; 1
                 if not given. For a log in m: 2*pi/lead (rad/m) for a screw, or 1 for a linear
                 motor, whose parameters are then in N, m and kg.

        Raises dahl.Error, with the next step, if the file has no bounds; if a log in m has no
        ratio; and if a parameter breaks a condition of the guarantee, also one that the
        constructor does not check: play, slew and fade_speed of the measured law.
        """
        is_free = not checks.instance("reference", given.get("reference", False), bool)
        bounds = identified.read_bounds(path, ratio, not is_free)
        return cls(**identified.complete(bounds, is_free, given))

    def _prepare(self) -> None:
        self._prepared = c.new("dahl_compensator_plan_t *")
        code = c.dahl_compensator_prepare(self._prepared, self._params())
        if code != c.DAHL_COMPENSATOR_OK:
            raise InputError(self._refusal(code))

    def _params(self) -> object:
        values = dict(self._values)
        friction = {name: values.pop(name) for name in FRICTION}
        law = c.DAHL_COMPENSATOR_REFERENCE if self._reference else c.DAHL_COMPENSATOR_MEASURED
        given = {"friction": friction, "law": law, "elastic": self._elastic, **values}
        given |= {"noise": self._noise, "play": self._play, "jump": self._jump}
        return c.new("dahl_compensator_params_t *", given)

    @property
    def implausible(self) -> str:
        """The probable mistake with the unit of period or fade_speed, or "" without one. For the
        friction, call dahl.implausible().
        """
        remark = c.dahl_compensator_params_plausible(self._params())
        if remark == c.DAHL_COMPENSATOR_LONG_PERIOD:
            return f"period = {self.period:g} s is above 0.04 s, rise or fall; ms, us or Hz?"
        if remark == c.DAHL_COMPENSATOR_FAST_FADE:
            counts = self.fade_speed * self.period / self.theta_per_count
            speed = f"fade_speed = {self.fade_speed:g} rad/s"
            return f"{speed} is {counts:g} counts a tick, above jump = {self._jump}; deg/s or rpm?"
        return ""

    def _refusal(self, code: int) -> str:
        """Return the value and the limit that the library refused."""
        if code in (c.DAHL_COMPENSATOR_PARAM, c.DAHL_COMPENSATOR_RANGE):
            return self._refusal_of_value()
        return self._refusals_of_rules()[code]

    def _refusals_of_rules(self) -> dict[int, str]:
        """Return the text of each code that compares several parameters."""
        v, is_free = self._values, not self._reference
        torque, length = v["gain"] * v["Fc"], v["Fc"] / v["sigma0"]
        most = 0.95 * (v["Fc_low"] - v["load"]) if is_free else v["Fc_low"]
        most_name = "0.95*(Fc_low - load)" if is_free else "Fc_low"
        lengths = 4 if self._elastic and is_free else 1
        least_name = "4*length_long of an elastic axis" if lengths > 1 else "length_long"
        inertia = v["sigma0_high"] * (v["delay"] + v["period"] / 2) ** 2 / 3
        return {
            c.DAHL_COMPENSATOR_GAIN: f"gain*Fc = {torque:.9g} N m is above {most_name} ="
            f" {most:.9g} N m",
            c.DAHL_COMPENSATOR_SLOPE: f"Fc/sigma0 = {length:.9g} rad is below {least_name} ="
            f" {lengths * v['length_long']:.9g} rad",
            c.DAHL_COMPENSATOR_PLAY: f"play = {self._play} is below 2*noise ="
            f" {2 * self._noise} counts",
            c.DAHL_COMPENSATOR_INERTIA: f"inertia = {parameters.digits(v['inertia'])} is below"
            f" sigma0_high*(delay + period/2)^2/3 = {inertia:.9g} kg m2",
        }

    def _refusal_of_value(self) -> str:
        v = self._values
        for name, value in v.items():
            if name not in FRICTION and not _is_in_range(name, value, self._reference):
                limit = self._limits[name]
                if name in NEEDED and not self._reference:
                    limit = limit.removeprefix("0, or ") + " with reference = False"
                return f"{name} = {value:g} is outside {limit}"
        parameters.need_counted(v["theta_per_count"])
        return self._refusal_of_tick() or parameters.refusal(*(v[name] for name in FRICTION))

    def _refusal_of_tick(self) -> str:
        """Return the slew or jump of a tick that is refused, or ""."""
        v = self._values
        if not all(_is_in_range(name, v[name], False) for name in FRICTION):
            return ""
        if v["slew"] * v["period"] / v["Fc"] < 2.000001 / ONE_Q30:
            return f"slew = {v['slew']:g} N m/s is below 2^-29 Fc in a tick"
        counts = v["fade_speed"] * v["period"] / v["theta_per_count"]
        is_fine = counts > c.DAHL_COMPENSATOR_FINE_COUNTS
        most = c.DAHL_COMPENSATOR_JUMP_SPEEDS // (2 if is_fine else 1)
        if 0 < most * counts < 1.000001 * self._jump:
            limit = f"{most} times the {counts:g} counts of a tick at fade_speed"
            return f"jump = {self._jump} is not below {limit}"
        return ""

    @property
    def reference(self) -> bool:
        """Whether the reference steps the element."""
        return self._reference

    @property
    def elastic(self) -> bool:
        """Whether a resonance is between motor and load."""
        return self._elastic

    @property
    def noise(self) -> int:
        """Counts by which a reading may differ from the truth."""
        return self._noise

    @property
    def play(self) -> int:
        """Width in counts of the dead zone that follows the counts."""
        return self._play

    @property
    def jump(self) -> int:
        """Longest move of a tick in counts; longer ones are rejected."""
        return self._jump

    @property
    def terms(self) -> dict[str, float]:
        """Each term of the last tick. Torques are in N m, `move` and `play_position` in counts,
        `speed` in rad/s; `fade` and `speed_fade` are 0 .. 1.
        """
        state, torque = self._state, self.Fc / ONE_Q30
        return {
            "move": state.move,
            "play_position": state.play_position,
            "bad_ticks": state.bad_ticks,
            "rejected": state.rejected,
            "speed": state.speed_q20 * 2.0**-20 * self.fade_speed,
            "fade": state.fade_q30 / ONE_Q30,
            "speed_fade": state.speed_fade_q15 * 2.0**-15,
            "friction": state.ratio_q30 * torque,
            "wanted": state.wanted_q30 * torque,
            "torque": state.torque_q30 * torque,
        }

    def move(self, dcounts: int, is_good: bool = True) -> int:
        """Read the encoder: reject, fade, play. Call it first in each tick. Returns the counts that
        step the element of the measured law. dcounts is a whole number within int32.

        For a bad or stale reading, pass is_good = False, and do not pass the reading to
        Encoder.move(). A move is used only if the reading before it was accepted too: the first
        good one after a bad one only sets the start of the next move and returns 0. Raises
        TypeError or dahl.Error for any other dcounts or flag.
        """
        moved, flag = checks.counts(dcounts), checks.flag("is_good", is_good)
        return int(c.dahl_compensator_move(self._prepared, self._state, moved, flag))

    def torque_q30(self, ratio_q30: int) -> int:
        """Return the torque to add to the command over Fc, in Q30, from that of the element: the
        result of its step_counts_q30(). Raises TypeError or dahl.Error unless it is a whole number
        within int32.
        """
        ratio_q30 = checks.whole("ratio_q30", ratio_q30, INT32_MIN, INT32_MAX)
        return int(c.dahl_compensator_torque(self._prepared, self._state, ratio_q30))

    def torque(self, ratio_q30: int) -> float:
        """Return that torque in N m."""
        return self.torque_q30(ratio_q30) / ONE_Q30 * self.Fc

    def change(self, **changed: float) -> None:
        """Change parameters between two ticks, by the names of the constructor; the others stay.

        The next torque is within the new limit, and it differs from the last one by at most
        slew*period, both in N m; if the new limit is below the torque, it falls to it at once. If
        the friction changes, call change_plan() of the element too. Raises TypeError or dahl.Error,
        and changes nothing, for parameters that the constructor rejects.
        """
        to = Compensator(**{**self._parameters(), **changed})  # type: ignore[arg-type]
        c.dahl_compensator_change(self._prepared, to._prepared, self._state)
        state = self._state
        self.__dict__.update(to.__dict__)
        self._state = state

    def _parameters(self) -> dict[str, float]:
        flags = {"reference": self._reference, "elastic": self._elastic}
        counts = {"noise": self._noise, "play": self._play, "jump": self._jump}
        return {**self._values, **flags, **counts}

    def run_log(
        self,
        element: RatioElement,
        moves: ArrayLike,
        reference_moves: ArrayLike | None = None,
        is_good: ArrayLike | None = None,
    ) -> NDArray[np.float64]:
        """Measured moves in counts, shape (n,) -> torques in N m, shape (n,): the bits of move(),
        element.step_counts_q30() and torque(), tick by tick. The element keeps its state.

        reference_moves are the counts of the reference law, is_good the encoder's flag of each
        tick; both have the shape of moves. Raises TypeError or dahl.Error, before any move, for
        another shape or type, for a missing or surplus reference_moves, and for another kind of
        element.
        """
        checks.instance("element", element, RatioElement)
        array = arrays.moves(moves, arrays.INT32)
        if (reference_moves is not None) != self._reference:
            needed = "the counts of the reference" if self._reference else "None"
            raise InputError(f"reference = {self._reference} needs reference_moves = {needed}")
        steps = array if reference_moves is None else arrays.moves(reference_moves, arrays.INT32)
        flags = np.ones(len(array), bool) if is_good is None else arrays.flags("is_good", is_good)
        for name, one in (("reference_moves", steps), ("is_good", flags)):
            if one.shape != array.shape:
                raise InputError(f"{name} has shape {one.shape}, not {array.shape} as moves has")
        result, are_good = np.empty(len(array)), flags.tolist()
        for k, (dcounts, step) in enumerate(zip(array.tolist(), steps.tolist(), strict=True)):
            move = self.move(dcounts, are_good[k])
            result[k] = self.torque(element.step_counts_q30(step if self._reference else move))
        return result

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Compensator):
            return NotImplemented
        return self._compared() == other._compared()

    def _compared(self) -> tuple[object, ...]:
        return self._parameters(), content(self._state)

    __hash__ = None  # type: ignore[assignment]  # it changes with each tick

    def __repr__(self) -> str:
        rest = list(self._parameters().items())[len(self._values) :]
        more = "".join(f", {name}={value}" for name, value in rest)
        return f"Compensator({self._shown_values()}{more})"


def need_reference(compensator: Compensator, values: dict[str, float]) -> None:
    """Raise dahl.Error unless the compensator has the law of the reference and these parameters."""
    checks.instance("compensator", compensator, Compensator)
    if not compensator.reference:
        raise InputError("compensator.reference = False: the estimate would see its own output")
    for name in ("Fc", "theta_per_count", "period", "slew"):
        if (other := getattr(compensator, name)) != values[name]:
            wanted = parameters.digits(values[name])
            raise InputError(f"compensator.{name} = {parameters.digits(other)} is not {wanted}")


def _is_in_range(name: str, value: float, reference: bool) -> bool:
    may_be_zero = name in ("load", "gain", "rise", "fall", "fade_speed")
    may_be_zero |= reference and name in BOUNDS
    if reference and name in AXIS:
        return True
    if value == 0:
        return may_be_zero
    most = math.nextafter(1, 2) if name == "gain" else parameters.TORQUE_MAX
    return parameters.TORQUE_MIN <= value < most
