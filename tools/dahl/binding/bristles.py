# SPDX-License-Identifier: MIT
"""The base of the elements with the state of one bristle, a dahl_state_t."""

from __future__ import annotations

from typing import Any

from dahl.binding.elements import RatioElement
from dahl.binding.friction import State
from dahl.binding.library import c
from dahl.binding.parameters import HasParameters
from dahl.errors import InputError


class Bristle(HasParameters, RatioElement):
    """An element with parameters, in the order of __init__, and the state of one bristle."""

    def _set(self, *values: float) -> None:
        self._set_values(dict(zip(self._limits, values, strict=True)))
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
        return f"{type(self).__name__}({self._shown_values()})"
