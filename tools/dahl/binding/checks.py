# SPDX-License-Identifier: MIT
"""What callers of the Python API may pass: each refusal is a dahl.Error with name, value and
limit.
"""

from __future__ import annotations

import inspect
import math
import reprlib
from collections.abc import Callable
from functools import wraps
from numbers import Integral, Real
from types import FunctionType
from typing import Any, ParamSpec, TypeVar

from dahl.errors import Error

P = ParamSpec("P")
R = TypeVar("R")
T = TypeVar("T")


def shown(value: object) -> str:
    """A value as a complaint names it: on one line, cut where it is long."""
    try:
        return " ".join(reprlib.repr(value).split())
    except ValueError:  # an integer of more than 4300 digits
        return f"an {type(value).__name__} of many digits"


def real(name: str, value: object, limit: str = "finite") -> float:
    """Any real number as a float, NaN and infinities too. No bool, no text, no array."""
    if type(value) is float:  # quick: once a tick
        return value
    if isinstance(value, bool) or not isinstance(value, Real) or _is_duration(value):
        raise Error(f"{name} = {shown(value)} is not a number; {limit} was expected")
    try:
        return float(value)
    except OverflowError:
        return -math.inf if value < 0 else math.inf


def _is_duration(value: object) -> bool:
    """numpy's timedelta64, which it registers as a whole number."""
    return getattr(getattr(value, "dtype", None), "kind", "") == "m"


def finite(name: str, value: object, unit: str) -> float:
    """As real(), without NaN and infinities."""
    number = real(name, value, f"a finite number of {unit}")
    if not math.isfinite(number):
        raise Error(f"{name} = {number} is not a finite number of {unit}")
    return number


def whole(name: str, value: object, least: int, most: int) -> int:
    """A whole number from least to most, also one that is written as a float; no bool."""
    if type(value) is int and least <= value <= most:
        return value
    number = real(name, value, f"a whole number from {least} to {most}")
    exact = int(value) if isinstance(value, Integral) else number
    if not (least <= exact <= most and exact == math.trunc(exact)):
        raise Error(f"{name} = {shown(value)} is not a whole number from {least} to {most}")
    return math.trunc(exact)


def instance(name: str, value: object, wanted: type[T]) -> T:
    """`value`, if it is of the wanted type."""
    if not isinstance(value, wanted):
        raise Error(f"{name} = {shown(value)} is not a {wanted.__name__}")
    return value


def names_checked(function: Callable[P, R]) -> Callable[P, R]:
    """A call that does not fit the signature is a dahl.Error that says what would fit."""

    @wraps(function)
    def call(*args: P.args, **kwargs: P.kwargs) -> R:
        try:
            return function(*args, **kwargs)
        except TypeError:
            _refuse_misfit(function, args, kwargs)
            raise

    return call


def calls_checked(cls: type[T]) -> type[T]:
    """names_checked() for all that users call of a class."""
    for name, member in list(vars(cls).items()):
        public = name == "__init__" or not name.startswith("_")
        if public and isinstance(member, FunctionType):
            setattr(cls, name, names_checked(member))
        elif public and isinstance(member, staticmethod):
            setattr(cls, name, staticmethod(names_checked(member.__func__)))
    return cls


def _refuse_misfit(function: Callable[..., Any], args: Any, kwargs: dict[str, Any]) -> None:
    """Raise dahl.Error if the arguments do not fit the signature."""
    name, signature = function.__qualname__, inspect.signature(function)
    wanted = [each for each in signature.parameters if each != "self"]
    if "self" in signature.parameters and args:  # of the class that users know, not of its base
        name = f"{type(args[0]).__name__}.{function.__name__}"
    name = name.removesuffix(".__init__")
    for key, value in kwargs.items():
        if key not in wanted:
            raise Error(
                f"{name}: {key} = {shown(value)}: no such argument (there are: {', '.join(wanted)})"
            ) from None
    try:
        signature.bind(*args, **kwargs)
    except TypeError as error:
        raise Error(f"{name}: {error} (arguments: {', '.join(wanted)})") from None
