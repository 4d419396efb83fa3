# SPDX-License-Identifier: MIT
"""Torque that cancels friction. Same names, units and bits as dahl_compensator.h."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dahl.binding import arrays, checks, parameters
from dahl.binding.bristles import Bristle
from dahl.binding.checks import INT32_MAX, INT32_MIN, ONE_Q30
from dahl.binding.copies import Copied, content
from dahl.binding.elements import RatioElement
from dahl.binding.friction import Friction
from dahl.binding.library import c
from dahl.binding.parameters import Parameter
from dahl.errors import Error

FRICTION = ("sigma0", "Fc", "theta_per_count")
BOUNDS = ("Fc_low", "length_long")  # the reference law needs none
POSITIVE, OPTIONAL = "2^-64 <= {} < 2^64 ({})", "0, or 2^-64 <= {} < 2^64 ({})"


@checks.calls_checked
class Compensator(Copied):
    """Feed-forward torque that cancels friction (dahl_compensator_t), faded out at first. It needs
    an element: call move() before the step of the element, torque() after it.

    sigma0, Fc, theta_per_count  of the element: steepest stiffness and torque of the ratio 1
    reference    False: the measured counts step the element; True: those of the reference do
    Fc_low       N m    lower bound of the true Fc; 0 with reference: no check
    length_long  rad    upper bound of the true presliding length; 0 with reference: no check
    gain         0 .. 1, gain*Fc <= Fc_low
    limit        N m    largest torque, > 0
    slew         N m/s  largest change of the torque, > 0
    period       s      of a tick
    rise, fall   s      to fade in, and to fade out while the encoder is bad; 0: at once
    fade_speed   rad/s  no torque from twice this speed; 0: no fade over speed
    pull         Hz     corner frequency of draw(); 0: none
    noise, play, jump   counts: +-noise of the encoder, width of the play >= 2*noise and >= 1
                        (2*noise + 2 is safe), longest move of a tick, below 1000 times that of
                        fade_speed

    Two are equal if parameters and state are; picklable; a copy has a state of its own. A tick
    costs about 2 us from Python. Raises dahl.Error with the parameter, its value and its limit.

    >>> plan = dahl.Plan(sigma0=100.0, Fc=0.5, theta_per_count=3.8e-4)
    >>> bearing = dahl.Friction(plan)
    >>> compensator = dahl.Compensator(
    ...     100.0, 0.5, 3.8e-4, Fc_low=0.5, length_long=0.005, gain=0.9, limit=1.0, slew=50.0,
    ...     period=1e-3, play=2, noise=1)
    >>> w = bearing.step_counts_q30(compensator.move(902))
    >>> round(compensator.torque(w), 6), compensator.terms["move"]  # N m, counts
    (0.05, 900)
    """

    sigma0 = Parameter(parameters.SIGMA0)
    Fc = Parameter(parameters.FC)
    theta_per_count = Parameter(parameters.COUNTED)
    Fc_low = Parameter(OPTIONAL.format("Fc_low", "N m"))
    length_long = Parameter(OPTIONAL.format("length_long", "rad"))
    gain = Parameter("0, or 2^-64 <= gain <= 1")
    limit = Parameter(POSITIVE.format("limit", "N m"))
    slew = Parameter(POSITIVE.format("slew", "N m/s"))
    period = Parameter(POSITIVE.format("period", "s"))
    rise = Parameter(OPTIONAL.format("rise", "s"))
    fall = Parameter(OPTIONAL.format("fall", "s"))
    fade_speed = Parameter(OPTIONAL.format("fade_speed", "rad/s"))
    pull = Parameter(OPTIONAL.format("pull", "Hz"))

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
        reference: bool = False,
        rise: float = 0.0,
        fall: float = 0.0,
        fade_speed: float = 0.0,
        pull: float = 0.0,
        noise: int = 0,
        play: int = 1,
        jump: int = 1000,
    ) -> None:
        given = dict(sigma0=sigma0, Fc=Fc, theta_per_count=theta_per_count, Fc_low=Fc_low)
        given |= dict(length_long=length_long, gain=gain, limit=limit, slew=slew, period=period)
        given |= dict(rise=rise, fall=fall, fade_speed=fade_speed, pull=pull)
        self._values = {k: parameters.parameter(k, v, _limit(k)) for k, v in given.items()}
        self._reference = checks.instance("reference", reference, bool)
        self._noise = checks.whole("noise", noise, 0, c.DAHL_COMPENSATOR_PLAY_MAX // 2)
        self._play = checks.whole("play", play, 1, c.DAHL_COMPENSATOR_PLAY_MAX)
        self._jump = checks.whole("jump", jump, 1, c.DAHL_COMPENSATOR_JUMP_MAX)
        self._state = c.new("dahl_compensator_t *")
        self._prepare()

    def _prepare(self) -> None:
        self._prepared = c.new("dahl_compensator_plan_t *")
        code = c.dahl_compensator_prepare(self._prepared, self._params())
        if code != c.DAHL_COMPENSATOR_OK:
            raise Error(self._refusal(code))

    def _params(self) -> object:
        values = dict(self._values)
        friction = {name: values.pop(name) for name in FRICTION}
        law = c.DAHL_COMPENSATOR_REFERENCE if self._reference else c.DAHL_COMPENSATOR_MEASURED
        counts = {"noise": self._noise, "play": self._play, "jump": self._jump}
        given = {"friction": friction, "law": law, **values, **counts}
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
        v = self._values
        if code == c.DAHL_COMPENSATOR_GAIN:
            torque = f"gain*Fc = {v['gain'] * v['Fc']:.9g} N m"
            return f"{torque} is above Fc_low = {v['Fc_low']:.9g} N m"
        if code == c.DAHL_COMPENSATOR_SLOPE:
            length = f"Fc/sigma0 = {v['Fc'] / v['sigma0']:.9g} rad"
            return f"{length} is below length_long = {v['length_long']:.9g} rad"
        if code == c.DAHL_COMPENSATOR_PLAY:
            return f"play = {self._play} is below 2*noise = {2 * self._noise} counts"
        for name, value in v.items():
            if name not in FRICTION and not _is_in_range(name, value, self._reference):
                limit = _limit(name)
                if name in BOUNDS and not self._reference:
                    limit = limit.removeprefix("0, or ") + " with reference = False"
                return f"{name} = {value:g} is outside {limit}"
        parameters.need_counted(v["theta_per_count"])
        counts = v["fade_speed"] * v["period"] / v["theta_per_count"]
        friction_is_good = all(_is_in_range(name, v[name], False) for name in FRICTION)
        is_fine = counts > c.DAHL_COMPENSATOR_FINE_COUNTS
        most = c.DAHL_COMPENSATOR_JUMP_SPEEDS // (2 if is_fine else 1)
        if friction_is_good and 0 < most * counts < 1.1 * self._jump:
            limit = f"{most} times the {counts:g} counts of a tick at fade_speed"
            return f"jump = {self._jump} is not below {limit}"
        return parameters.refusal(*(v[name] for name in FRICTION))

    @property
    def reference(self) -> bool:
        """Whether the reference steps the element."""
        return self._reference

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
        step the element of the measured law. dcounts is a whole number within int32; is_good is
        False for a bad or stale reading. Raises dahl.Error for any other dcounts or flag.
        """
        moved, flag = checks.counts(dcounts), checks.flag("is_good", is_good)
        return int(c.dahl_compensator_move(self._prepared, self._state, moved, flag))

    def torque_q30(self, ratio_q30: int) -> int:
        """Return the torque to add to the command over Fc, in Q30, from that of the element: the
        result of its step_counts_q30(). Raises dahl.Error unless it is a whole number within int32.
        """
        ratio_q30 = checks.whole("ratio_q30", ratio_q30, INT32_MIN, INT32_MAX)
        return int(c.dahl_compensator_torque(self._prepared, self._state, ratio_q30))

    def torque(self, ratio_q30: int) -> float:
        """Return that torque in N m."""
        return self.torque_q30(ratio_q30) / ONE_Q30 * self.Fc

    def draw(self, element: Friction | Bristle, measured: Friction | Bristle) -> None:
        """Draw the state of `element`, which the reference steps, to that of `measured`, which the
        results of move() step. Raises dahl.Error for elements that have no State.
        """
        for name, one in (("element", element), ("measured", measured)):
            if not isinstance(one, (Friction, Bristle)):
                raise Error(f"{name} = {checks.shown(one)} has no State")
        c.dahl_compensator_pull(self._prepared, element.state._c, measured.state._c)

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
        tick; both have the shape of moves. Raises dahl.Error, before any move, for another shape or
        type, for a missing or surplus reference_moves, and for another kind of element.
        """
        checks.instance("element", element, RatioElement)
        array = arrays.moves(moves, np.int32)
        if (reference_moves is not None) != self._reference:
            needed = "the counts of the reference" if self._reference else "None"
            raise Error(f"reference = {self._reference} needs reference_moves = {needed}")
        steps = array if reference_moves is None else arrays.moves(reference_moves, np.int32)
        flags = np.ones(len(array), bool) if is_good is None else arrays.flags("is_good", is_good)
        for name, one in (("reference_moves", steps), ("is_good", flags)):
            if one.shape != array.shape:
                raise Error(f"{name} has shape {one.shape}, not {array.shape} as moves has")
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
        counts = self._reference, self._noise, self._play, self._jump
        return self._values, counts, content(self._state)

    __hash__ = None  # type: ignore[assignment]  # it changes with each tick

    def __repr__(self) -> str:
        named = [f"{name}={parameters.digits(value)}" for name, value in self._values.items()]
        named += [f"reference={self._reference}", f"noise={self._noise}"]
        return f"Compensator({', '.join(named)}, play={self._play}, jump={self._jump})"


def _limit(name: str) -> str:
    return str(vars(Compensator)[name].limit)


def _is_in_range(name: str, value: float, reference: bool) -> bool:
    may_be_zero = name in ("gain", "rise", "fall", "fade_speed", "pull")
    may_be_zero |= reference and name in BOUNDS
    if value == 0:
        return may_be_zero
    most = math.nextafter(1, 2) if name == "gain" else parameters.TORQUE_MAX
    return parameters.TORQUE_MIN <= value < most
