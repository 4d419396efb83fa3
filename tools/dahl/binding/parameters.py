# SPDX-License-Identifier: MIT
"""Ranges of sigma0, Fc and theta_per_count. The library checks them; this module names the
parameter that is out of range and its limit. A test compares the limits with dahl.h.
"""

from __future__ import annotations

import math
from typing import Any, ClassVar, overload

import numpy as np

from dahl.binding import checks
from dahl.binding.library import c
from dahl.errors import InputError

TORQUE_MIN, TORQUE_MAX = 2.0**-64, 2.0**64  # DAHL_TORQUE_MIN, _MAX: sigma0 in N m/rad and Fc in N m
TRAVEL_MIN, TRAVEL_MAX = 2.0**-30, 2.0**20  # DAHL_TRAVEL_MIN, _MAX: sigma0/Fc * theta_per_count
SIGMA0 = "2^-64 <= sigma0 < 2^64 (N m/rad)"
FC = "2^-64 <= Fc < 2^64 (N m)"
COUNTED = "2^-64 <= theta_per_count < 2^64 (rad/count)"
THETA_PER_COUNT = f"{COUNTED}, or 0 for no encoder"
LIMITS = {"sigma0": SIGMA0, "Fc": FC, "theta_per_count": THETA_PER_COUNT}


class Counts:
    """Parameters of one Dahl element, with or without an encoder."""

    sigma0: float
    Fc: float
    theta_per_count: float

    @property
    def travel_per_count(self) -> float:
        """sigma0/Fc*theta_per_count: travel of one count in presliding lengths Fc/sigma0, 0 without
        encoder.
        """
        return self.sigma0 / self.Fc * self.theta_per_count

    def _need_counts(self) -> None:
        """Raise dahl.Error without an encoder: C would read each count as no motion."""
        if self.theta_per_count == 0:
            raise InputError(
                "theta_per_count = 0: no encoder, so only moves in rad; for counts"
                f" {COUNTED} is needed"
            )


class Parameter:
    """A read-only parameter of a class with `_values`; its limit is its documentation."""

    def __init__(self, limit: str) -> None:
        self.limit = self.__doc__ = limit

    def __set_name__(self, owner: type, name: str) -> None:
        self._name = name

    @overload
    def __get__(self, one: None, owner: type) -> Parameter: ...
    @overload
    def __get__(self, one: Any, owner: type) -> float: ...
    def __get__(self, one: Any, owner: type) -> Parameter | float:
        return self if one is None else one._values[self._name]

    def __set__(self, one: Any, value: float) -> None:
        raise AttributeError(f"{self._name} cannot be changed")


class HasParameters:
    """Base of a class with parameters, each rounded to float."""

    _limits: ClassVar[dict[str, str]] = {}  # of each Parameter, in the order of the class
    _values: dict[str, float]

    def __init_subclass__(cls) -> None:
        found = {k: v.limit for k, v in vars(cls).items() if isinstance(v, Parameter)}
        cls._limits = found or cls._limits

    def _set_values(self, given: dict[str, float]) -> None:
        self._values = {k: parameter(k, value, self._limits[k]) for k, value in given.items()}

    def _shown_values(self) -> str:
        return ", ".join(f"{name}={digits(value)}" for name, value in self._values.items())


def parameter(name: str, value: float, limit: str) -> float:
    """Round a parameter to float, as in C. Raises dahl.Error if that makes it 0 or infinite."""
    number = checks.real(name, value, limit)
    rounded = float(c.cast("float", number))
    if (rounded == 0 and number != 0) or (math.isinf(rounded) and not math.isinf(number)):
        raise InputError(f"{name} = {checks.shown(value)} is outside {limit}")
    return rounded


def digits(value: float) -> str:
    """Return the fewest digits that make this float again: 0.3, not 0.30000001192092896."""
    return str(np.float32(value))


def need_counted(theta_per_count: float) -> None:
    """Raise dahl.Error for no encoder and for one out of range."""
    if not TORQUE_MIN <= theta_per_count < TORQUE_MAX:
        shown = _shown(theta_per_count, TORQUE_MIN, TORQUE_MAX)
        raise InputError(f"theta_per_count = {shown} is outside {COUNTED}")


def refusal(sigma0: float, Fc: float, theta_per_count: float) -> str:  # noqa: N803
    """Return the name and the limit of the parameter that the library refused."""
    for (name, limit), value in zip(LIMITS.items(), (sigma0, Fc, theta_per_count), strict=True):
        if not TORQUE_MIN <= value < TORQUE_MAX and (name != "theta_per_count" or value != 0):
            return f"{name} = {_shown(value, TORQUE_MIN, TORQUE_MAX)} is outside {limit}"
    travel = sigma0 / Fc * theta_per_count
    return (
        f"travel of one count sigma0/Fc*theta_per_count = {_shown(travel, TRAVEL_MIN, TRAVEL_MAX)}"
        f" is outside 2^-30 <= travel < 2^20 (sigma0 = {sigma0:g}, Fc = {Fc:g},"
        f" theta_per_count = {theta_per_count:g})"
    )


def _shown(value: float, low: float, high: float) -> str:
    """Return six digits, or all if six would look as if they were within the limits."""
    short = f"{value:g}"
    return repr(value) if low <= float(short) < high else short
