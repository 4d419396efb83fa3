# SPDX-License-Identifier: MIT
"""Copies and pickles of objects that hold structures of the C library. A copy keeps the current
state, and everything that a subclass adds.
"""

from __future__ import annotations

import copy
from typing import Any, ClassVar, NamedTuple, Self

from dahl.binding.library import c


class _Content(NamedTuple):
    """A C structure in a pickle. It must not hold addresses."""

    type_name: str
    content: bytes


class Copied:
    """Base of classes whose attributes are values or C structures without addresses."""

    _derived_fields: ClassVar[frozenset[str]] = frozenset({"_prepared"})  # _prepare() makes them

    def _prepare(self) -> None:
        """Make the derived fields from the parameters."""

    def __getstate__(self) -> dict[str, Any]:
        kept: Any = super().__getstate__()  # a pair if a subclass has slots
        values = {**(kept[0] or {}), **kept[1]} if isinstance(kept, tuple) else kept
        return {k: _without_address(v) for k, v in values.items() if k not in self._derived_fields}

    def __setstate__(self, kept: dict[str, Any]) -> None:
        for name, value in kept.items():
            object.__setattr__(self, name, _in_c(value))  # a frozen class too
        self._prepare()

    def __copy__(self) -> Self:
        """Share what is constant, and copy the state."""
        other, kept = type(self).__new__(type(self)), self.__getstate__()
        if "_state" in kept:
            kept["_state"] = copy.copy(kept["_state"])
        other.__setstate__(kept)
        return other


def content(structure: Any) -> bytes:
    """The bytes of a C structure."""
    return bytes(c.buffer(structure))


def _without_address(value: Any) -> Any:
    """Return the content of a C structure, and any other value as it is."""
    if isinstance(value, c.CData):
        return _Content(c.typeof(value).item.cname, content(value))
    return value


def _in_c(value: Any) -> Any:
    """Return a new C structure of a content, and any other value as it is."""
    if not isinstance(value, _Content):
        return value
    structure = c.new(f"{value.type_name} *")
    c.memmove(structure, value.content, len(value.content))
    return structure
