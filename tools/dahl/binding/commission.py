# SPDX-License-Identifier: MIT
"""An axis measures its own friction. Same names, units and bits as dahl_commission.h."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dahl.binding import checks
from dahl.binding.compensator import Compensator
from dahl.binding.copies import Copied, content
from dahl.binding.library import c
from dahl.binding.parameters import HasParameters, Parameter
from dahl.errors import InputError, RunError

MODES = ("off", "track", "torque")
STAGES = ("rest", "sweeps", "cycle", "breakaway", "inertia", "kick", "done", "refused")
RANGES = ("Fc", "length", "sigma0", "inertia", "delay", "viscous")
COMPENSATOR_PARAMETERS = (
    *("Fc_low", "length_long", "sigma0_high", "load", "inertia", "delay", "gain", "limit", "slew"),
    *("period", "rise", "fall", "fade_speed", "noise", "play", "jump"),
)
SWEEP_SPEEDS = (0.6, 1.2, 2.5)  # rad/s, of lib/commission/sweeps.c
UNEQUAL_SHARE = 0.15  # of Fc: largest difference of the directions
HIDDEN_LOAD_RAD = 0.8  # mean of a load over its slope, if unequal friction cancels the load
VALUES = ("load_error", "load_most", "breakaway", "gain", "seconds")
RANGES_OF_VALUES = {  # of dahl_commission_start()
    "period": (5e-5, 2e-3),
    "theta_per_count": (1e-9, 0.01),
    "inertia": (1e-9, 1e9),
    "torque_limit": (1e-9, 1e9),
    "travel": (0.2, 3.0),
    "speed_limit": (5.0, 1000.0),
}
REASONS = {  # of each refusal: what happened, and the next step; docs/commissioning.md has them too
    "ABORTED": ("it was aborted", "run it again"),
    "ANGLE": ("the angle left angle_limit", "hold the load, or clear a wider range"),
    "SPEED": ("the speed exceeded speed_limit", "halve the bandwidth of the loop"),
    "UNLIMITED": ("the drive applied more than torque_limit", "limit the whole command"),
    "SATURATED": ("the torque stayed at its limit", "raise torque_limit, or free the axis"),
    "TRACKING": ("the position loop does not follow", "look for an end stop, then tune the loop"),
    "ENCODER": ("no counts came while the axis had to move", "check the encoder"),
    "SIGN": (
        "the axis moves against the command",
        "swap the sign of the torque or of the counts",
    ),
    "DISTURBED": ("the axis moved when it had to rest", "keep hands away, then run it again"),
    "TIMEOUT": ("a stage took too long", "check the drive, then run it again"),
    "NO_DATA": (
        "the bins of angle have too few samples",
        "widen travel, or check the position loop",
    ),
    "VARIES": (
        "the loop shakes the axis, or the friction differs between two passes",
        "check the inertia, then halve the bandwidth of the loop",
    ),
    "BAD_INERTIA": ("the inertia cannot be fitted", "correct the inertia of the configuration"),
    "COARSE": ("the presliding cannot be measured", "use an encoder with more counts"),
    "LIGHT": ("the rotor is too light for period and delay", "shorten period and delay"),
    "SWINGS": ("the axis swings with each gain", "stiffen the shaft"),
}


class Range(NamedTuple):
    """Estimate with its interval."""

    least: float
    best: float
    most: float


class Command(NamedTuple):
    """Command to the drive for one tick."""

    mode: str  # "off"; "track": position loop on the next three; "torque": no loop
    angle: float  # rad from the first angle
    speed: float  # rad/s
    acceleration: float  # rad/s2
    torque: float  # N m with "torque", else 0
    torque_limit: float  # N m, of the whole torque
    stage: str


Drive = Callable[[Command], tuple[int, float]]


class Commission(HasParameters, Copied):
    """Measure the friction of an axis with its own motor and encoder (dahl_commission_t).

    period           s      of a tick
    theta_per_count  rad
    inertia          kg m2  of the axis, within a factor of 1.5
    torque_limit     N m    largest torque: 4 times the friction is enough
    travel           rad    the axis moves by +-travel about its first angle
    angle_limit      rad    largest angle from the first one, at least 1.5 travel; None: 2 travel
    speed_limit      rad/s  at least 5

    Give run() a drive: a function that takes a Command, applies it for one tick, and returns the
    counts moved in the tick and the torque that acted in N m. Or call tick() yourself. Raises
    dahl.Error for a value out of range.

    >>> axis = dahl.Commission(period=1e-3, theta_per_count=1e-4, inertia=0.002, torque_limit=3.0)
    >>> axis.tick(0, 0.0).mode, axis.stage
    ('off', 'rest')
    """

    period = Parameter("5e-5 <= period <= 2e-3 (s)")
    theta_per_count = Parameter("1e-9 <= theta_per_count <= 0.01 (rad)")
    inertia = Parameter("1e-9 <= inertia <= 1e9 (kg m2)")
    torque_limit = Parameter("1e-9 <= torque_limit <= 1e9 (N m)")
    travel = Parameter("0.2 <= travel <= 3 (rad)")
    angle_limit = Parameter("1.5 travel <= angle_limit <= 100 (rad), 2e9 theta_per_count")
    speed_limit = Parameter("5 <= speed_limit <= 1000 (rad/s)")

    def __init__(
        self,
        *,
        period: float,
        theta_per_count: float,
        inertia: float,
        torque_limit: float,
        travel: float = 0.35,
        angle_limit: float | None = None,
        speed_limit: float = 10.0,
    ) -> None:
        given = dict(period=period, theta_per_count=theta_per_count, inertia=inertia)
        given |= dict(torque_limit=torque_limit, travel=travel)
        given["angle_limit"] = 2 * travel if angle_limit is None else angle_limit
        self._set_values(given | {"speed_limit": speed_limit})
        self._state = c.new("dahl_commission_t *")
        self._command = c.new("dahl_commission_command_t *")
        config = c.new("dahl_commission_config_t *", self._values)
        if c.dahl_commission_start(self._state, config) != c.DAHL_COMMISSION_OK:
            raise InputError(self._refusal())

    def _refusal(self) -> str:
        """Return the value and the limit that the library refused."""
        most_angle = min(100.0, 2e9 * self.theta_per_count)
        ranges = {**RANGES_OF_VALUES, "angle_limit": (1.5 * self.travel, most_angle)}
        for name, (least, most) in ranges.items():
            if not np.float32(least) <= np.float32(self._values[name]) <= np.float32(most):
                return f"{name} = {self._values[name]:g} is outside {self._limits[name]}"
        return f"{self._shown_values()} is outside the limits of the library"

    @property
    def stage(self) -> str:
        """One of rest, sweeps, cycle, breakaway, inertia, kick, done, refused."""
        return STAGES[self._state.command.stage]

    @property
    def refusal_code(self) -> str:
        """Name of the refusal without DAHL_COMMISSION_, a key of REASONS, or ""."""
        code = self._state.command.refusal
        names = (name for name in REASONS if code == getattr(c, f"DAHL_COMMISSION_{name}"))
        return next(names, "")

    @property
    def refusal(self) -> str:
        """Why it was refused and what to change, or ""."""
        return "; ".join(REASONS.get(self.refusal_code, ()))

    def tick(self, dcounts: int, torque: float) -> Command:
        """Return the command of this tick. dcounts and torque (N m) are those of the last tick: 0
        and 0 in the first one. Raises TypeError or dahl.Error for another dcounts or torque.
        """
        moved, acted = checks.counts(dcounts), checks.real("torque", torque)
        c.dahl_commission_tick(self._state, moved, acted, self._command)
        command = self._command
        numbers = command.angle, command.speed, command.acceleration
        torques = command.torque, command.torque_limit
        return Command(MODES[command.mode], *numbers, *torques, STAGES[command.stage])

    def abort(self) -> None:
        """Stop at once: the next command is "off"."""
        c.dahl_commission_abort(self._state)

    def run(self, drive: Drive) -> dict[str, Any]:
        """Commission the axis behind `drive`, and return its result. The last command is "off",
        also if the drive raises. Raises dahl.RunError if the axis is refused.
        """
        command = self.tick(0, 0.0)
        try:
            while command.stage not in ("done", "refused"):
                command = self.tick(*_answer(drive(command)))
        finally:
            self.abort()
            drive(self.tick(0, 0.0))
        return self.result

    @property
    def result(self) -> dict[str, Any]:
        """Fc, length, sigma0, inertia, delay and viscous as Range; load (N m) at the middles of its
        bins; load_error, load_most, breakaway, gain, seconds, noise, play, elastic: as in
        dahl_commission.h. Raises dahl.RunError unless the stage is done.
        """
        self._need_done()
        values = self._state.result
        ranges = {name: getattr(values, name) for name in RANGES}
        return {
            **{name: Range(one.least, one.best, one.most) for name, one in ranges.items()},
            **{name: getattr(values, name) for name in VALUES},
            "load": self._loads(),
            "noise": values.noise,
            "play": values.play,
            "elastic": bool(values.elastic),
        }

    def _loads(self) -> NDArray[np.float64]:
        return np.array(list(self._state.result.load))

    @property
    def has_sweeps(self) -> bool:
        """Whether the sweeps have ended, also if a later stage was refused."""
        return bool(self._state.result.Fc.best > 0)

    @property
    def sweeps(self) -> dict[str, Any]:
        """Measurements of the sweeps alone: Fc and viscous as Range, `friction` and `load` (N m,
        +-`load_error`) at `angle` (rad), and `friction_at_speed` in pairs of rad/s and N m. Raises
        dahl.RunError before the end of the sweeps.
        """
        state = self._state
        if not self.has_sweeps:
            raise RunError(f"the sweeps have not ended: {self.refusal or self.stage}")
        friction, viscous = np.array(list(state.table.friction)), state.result.viscous
        levels = zip(SWEEP_SPEEDS, state.table.level, strict=True)
        best = state.result.Fc.best
        error = (viscous.most - viscous.best) * float(np.mean(SWEEP_SPEEDS))
        bins = len(friction)
        angle = self.travel * ((2 * np.arange(bins) + 1) / bins - 1)
        return {
            "Fc": Range(best - error, best, best + error),
            "viscous": Range(viscous.least, viscous.best, viscous.most),
            "angle": angle,
            "friction": friction,
            "load": self._loads(),
            "load_error": state.table.scatter + self._load_error(angle, friction),
            "friction_at_speed": [(speed, level) for speed, level in levels if level > 0],
        }

    def _load_error(self, angle: NDArray[np.float64], friction: NDArray[np.float64]) -> float:
        """Return the error of the load after the sweeps, as breakaway.c adds it up: friction that
        differs between the directions, friction that has not grown to Fc near the ends, noise.
        """
        Fc = self._state.result.Fc.best
        slope, mean = np.polyfit(angle, self._loads(), 1)
        unequal = min(UNEQUAL_SHARE * Fc, abs(mean) + HIDDEN_LOAD_RAD * abs(slope))
        return float(unequal + np.abs(np.diff(friction)).max() / 2 + 0.03 * Fc)

    def _need_done(self) -> None:
        if self.stage != "done":
            reason = self.refusal or f"it is in the stage {self.stage}"
            raise RunError(f"the axis is not commissioned: {reason}")

    def load(self, angle: float) -> float:
        """Return the torque in N m that holds the axis at an angle in rad, +-load_error."""
        return float(c.dahl_commission_load(self._state, checks.finite("angle", angle, "rad")))

    def c_params(self, has_load: bool = False) -> Any:
        """Return the parameters of compensator() as a dahl_compensator_params_t."""
        self._need_done()
        params = c.new("dahl_compensator_params_t *")
        flag = checks.flag("has_load", has_load)
        code = c.dahl_commission_params(self._state, params, flag)
        if code != c.DAHL_COMPENSATOR_OK:
            raise RunError(f"the library rejects the parameters: code {code}")
        return params[0]

    def compensator(self, has_load: bool = False) -> Compensator:
        """Return a Compensator with the bounds and the gain of the result. If the drive adds load()
        to the command, pass False. If it does not, pass True: a load lowers the gain. Step an
        element of the same sigma0 and Fc. Raises dahl.RunError unless the stage is done.
        """
        params = self.c_params(has_load)
        friction = params.friction
        return Compensator(
            friction.sigma0,
            friction.Fc,
            friction.theta_per_count,
            elastic=bool(params.elastic),
            **{name: getattr(params, name) for name in COMPENSATOR_PARAMETERS},
        )

    def reference_compensator(self) -> Compensator:
        """Return a Compensator for an axis that a position loop moves: reference law, gain 1, best
        values of Fc and sigma0. Step its element by the counts of the reference. Raises
        dahl.RunError unless the stage is done.
        """
        params, result = self.c_params(), self._state.result
        Fc, sigma0 = result.Fc.best, result.sigma0.best  # noqa: N806
        given = {name: getattr(params, name) for name in COMPENSATOR_PARAMETERS}
        given |= {"Fc_low": Fc, "length_long": 0.999 * Fc / sigma0, "gain": 1.0, "limit": 1.2 * Fc}
        return Compensator(sigma0, Fc, params.friction.theta_per_count, reference=True, **given)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Commission):
            return NotImplemented
        return content(self._state) == content(other._state)

    __hash__ = None  # type: ignore[assignment]  # it changes with each tick

    def __repr__(self) -> str:
        return f"Commission({self._shown_values()})"


def _answer(found: Any) -> tuple[int, float]:
    """Return what a drive returned. Raises TypeError if it is no pair."""
    try:
        moved, torque = found
    except (TypeError, ValueError):
        words = f"drive(command) returned {found!r}; (counts moved, torque) was expected"
        raise TypeError(words) from None
    return moved, torque
