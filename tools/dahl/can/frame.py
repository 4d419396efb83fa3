# SPDX-License-Identifier: MIT
"""Base classes of the frames in dahl.can.frames: checks of fields, and values in SI units."""

from __future__ import annotations

from typing import Any, ClassVar, Self

from dahl.binding import checks
from dahl.binding.checks import ONE_Q30, UINT32_MAX
from dahl.errors import InputError


class Frame:
    """Base of all frames. Immutable, comparable, picklable."""

    base: ClassVar[int]  # id of node 0
    _calls: ClassVar[str]  # dahl_frames_pack_.., dahl_frames_unpack_..
    _structure: ClassVar[str]  # of C
    _kind: ClassVar[int]  # high half of the data id
    _limits: ClassVar[dict[str, Any]]  # of each field: (least, most), or an enumeration

    def __post_init__(self) -> None:
        for name, limit in self._limits.items():
            object.__setattr__(self, name, check_field(name, getattr(self, name), limit))


def check_field(name: str, value: object, limit: Any) -> Any:
    """Return a field if it is in its range; a number of an enumeration becomes its member."""
    if isinstance(limit, tuple):
        return checks.whole(name, value, *limit)
    if limit is bool:
        return bool(checks.whole(name, int(value) if isinstance(value, bool) else value, 0, 1))
    number = checks.whole(name, value, 0, 255)
    try:
        return limit(number)
    except ValueError:
        if name == "param":  # a node answers that it has no such parameter
            return number
        known = ", ".join(f"{one.value} {one.name}" for one in limit)
        raise InputError(f"{name} = {number} is none of {known}") from None


class TorqueFrame(Frame):
    """A frame with a torque."""

    torque_q30: int

    @property
    def ratio(self) -> float:
        """F/Fc, -1 .. 1, exactly."""
        return self.torque_q30 / ONE_Q30


class StatusFrame(Frame):
    """A frame with the timeout of the node."""

    timeout: int
    _timeout_unit: ClassVar[float]

    @property
    def timeout_s(self) -> float:
        """The timeout in s."""
        return self.timeout * self._timeout_unit


class ParamFrame(Frame):
    """A frame with a parameter's value."""

    param: int
    value: int
    _units: ClassVar[dict[int, float]]
    _off_at_0: ClassVar[tuple[int, ...]]

    @property
    def si(self) -> float:
        """The value in the unit of its parameter: N m/rad, N m, rad per count, s, or a fraction."""
        return self.value * self._units.get(self.param, 1.0)


class ParamWriteFrame(ParamFrame):
    """A frame that asks for a parameter or sets it."""

    @classmethod
    def of_si(cls, param: int, value: float, write: int = 1, counter: int = 0) -> Self:
        """Return the frame that writes a value in N m/rad, N m, rad per count, s, or a fraction,
        rounded to the nearest step. `write` may also be READ or HOLD. Raises dahl.Error for a value
        out of range, and for one that rounding would make a 0 that means "off".
        """
        known = check_field("param", param, cls._limits["param"])
        unit = cls._units.get(known, 1.0)
        steps = checks.finite("value", value, "the parameter's unit") / unit
        shown = f"value = {value:g} of parameter {getattr(known, 'name', known)}"
        if not 0 <= steps <= UINT32_MAX:
            raise InputError(f"{shown} is outside 0 .. {UINT32_MAX * unit:g}")
        if known in cls._off_at_0 and steps and not round(steps):
            raise InputError(f"{shown} is less than half a step of {unit:g}: 0 would switch it off")
        values = {"param": known, "value": round(steps), "write": write, "counter": counter}
        return cls(**values)
