# SPDX-License-Identifier: MIT
"""The base of the elements with the state of one bristle, a dahl_state_t."""

from __future__ import annotations

from typing import Any, ClassVar

from dahl.binding import parameters
from dahl.binding.elements import RatioElement
from dahl.binding.friction import State
from dahl.binding.library import c
from dahl.binding.parameters import Parameter
from dahl.errors import InputError


class Bristle(RatioElement):
    """An element with parameters, each rounded to float, and the state of one bristle."""

    _limits: ClassVar[dict[str, str]]  # of each parameter, in the order of __init__
    _values: dict[str, float]

    def __init_subclass__(cls) -> None:
        found = {k: v.limit for k, v in vars(cls).items() if isinstance(v, Parameter)}
        cls._limits = found or cls._limits

    def _set(self, *values: float) -> None:
        self._values = {
            name: parameters.parameter(name, value, limit)
            for (name, limit), value in zip(self._limits.items(), values, strict=True)
        }
        self._state = State()
        self._prepare()

    def _prepare(self) -> None:
        self._prepared = c.new(f"dahl_{self._kind}plan_t *")
        if getattr(c, f"dahl_{self._kind}prepare")(self._prepared, *self._params()) != 0:
            raise InputError(self._refusal())

    def _params(self) -> tuple[Any, ...]:
        """Return the arguments of dahl_.._prepare after the plan."""
        raise NotImplementedError

    def _refusal(self) -> str:
        raise NotImplementedError

    def _arguments(self) -> tuple[Any, ...]:
        return self._prepared, self._state._c

    @property
    def state(self) -> State:
        """The state, live: a whole number, 0 is relaxed, +-2^62 is +-Fc (the larger Fc)."""
        return self._state

    def __eq__(self, other: object) -> bool:
        if type(other) is not type(self):
            return NotImplemented
        return (self._values, self._state) == (other._values, other._state)

    __hash__ = None  # type: ignore[assignment]  # it changes with each step

    def __repr__(self) -> str:
        named = (f"{name}={parameters.digits(value)}" for name, value in self._values.items())
        return f"{type(self).__name__}({', '.join(named)})"
