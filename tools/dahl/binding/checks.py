# SPDX-License-Identifier: MIT
"""Checks of the arguments of the Python API. Each raises TypeError for a wrong type and
dahl.InputError for a wrong value, with name, value and limit.
"""

from __future__ import annotations

import math
import reprlib
from collections.abc import Callable
from functools import wraps
from numbers import Integral, Real
from typing import Any, TypeVar, cast

from dahl.errors import InputError

INT32_MIN, INT32_MAX = -(1 << 31), (1 << 31) - 1
UINT32_MAX = 2**32 - 1
ONE_Q30 = 2**30  # 1 in Q30
MISSING: Any = object()  # an argument that was not given

F = TypeVar("F", bound=Callable[..., Any])
T = TypeVar("T")


def shown(value: object) -> str:
    """Return a value for an error message: one line, cut if it is long."""
    try:
        return " ".join(reprlib.repr(value).split())
    except ValueError:  # an integer of more than 4300 digits
        return f"an {type(value).__name__} of many digits"


def real(name: str, value: object, limit: str = "finite") -> float:
    """Return any real number as a float, NaN and infinities too; no bool, text or array."""
    if type(value) is float:  # quick: once a tick
        return value
    if isinstance(value, bool) or not isinstance(value, Real) or _is_duration(value):
        raise TypeError(f"{name} = {shown(value)} is not a number; {limit} was expected")
    try:
        return float(value)
    except OverflowError:
        return -math.inf if value < 0 else math.inf


def _is_duration(value: object) -> bool:
    """Return whether this is numpy's timedelta64, which numpy registers as a whole number."""
    return getattr(getattr(value, "dtype", None), "kind", "") == "m"


def finite(name: str, value: object, unit: str) -> float:
    """Return as real() does, without NaN and infinities."""
    number = real(name, value, f"a finite number of {unit}")
    if not math.isfinite(number):
        raise InputError(f"{name} = {number} is not a finite number of {unit}")
    return number


def whole(name: str, value: object, least: int, most: int) -> int:
    """Return a whole number from least to most, also one that is written as a float; no bool."""
    if type(value) is int and least <= value <= most:
        return value
    number = real(name, value, f"a whole number from {least} to {most}")
    exact = int(value) if isinstance(value, Integral) else number
    if not (least <= exact <= most and exact == math.trunc(exact)):
        raise InputError(f"{name} = {shown(value)} is not a whole number from {least} to {most}")
    return math.trunc(exact)


def counts(dcounts: int) -> int:
    """Return a move in counts, a whole number within int32."""
    return whole("dcounts", dcounts, INT32_MIN, INT32_MAX)


def flag(name: str, value: object) -> bool:
    """Return a bool, also one of numpy or a whole number; no text, NaN or array."""
    if value is True or value is False:
        return value
    is_numpy_bool = str(getattr(value, "dtype", "")) == "bool" and getattr(value, "ndim", 1) == 0
    if is_numpy_bool or (isinstance(value, Integral) and not _is_duration(value)):
        return bool(value)
    raise TypeError(f"{name} = {shown(value)} is not a bool")


def instance(name: str, value: object, wanted: type[T]) -> T:
    """Return `value` if it is of the wanted type."""
    if not isinstance(value, wanted):
        raise TypeError(f"{name} = {shown(value)} is not a {wanted.__name__}")
    return value


def quick_counts(method: F) -> F:
    """Call self._step, a C function that is bound to plan and state, for an int within int32. All
    other arguments go to the method. Such a call packs no tuple and makes no second Python call.
    """

    @wraps(method)
    def call(self: Any, dcounts: Any = MISSING, /, *more: Any, **named: Any) -> Any:
        if type(dcounts) is int and not more and not named:
            try:
                return self._step(dcounts)
            except OverflowError:
                pass
        given = () if dcounts is MISSING else (dcounts,)
        return method(self, *given, *more, **named)

    return cast(F, call)
