# SPDX-License-Identifier: MIT
"""Copies and pickles of what the C library keeps: they go on where it stands, and hold all that a
subclass adds.
"""

from __future__ import annotations

import copy
import ctypes
from typing import Any, ClassVar, Self


class Copied:
    """Its state is in attributes that are values, or ctypes structures without addresses."""

    _made_again: ClassVar[frozenset[str]] = frozenset({"_words"})  # in no copy, by _prepare()

    def _prepare(self) -> None:
        """Make from the parameters what the C library makes of them, where there is any."""

    def __getstate__(self) -> dict[str, Any]:
        kept: Any = super().__getstate__()  # a pair where a subclass has slots
        values = {**(kept[0] or {}), **kept[1]} if isinstance(kept, tuple) else kept
        return {name: value for name, value in values.items() if name not in self._made_again}

    def __setstate__(self, kept: dict[str, Any]) -> None:
        for name, value in kept.items():
            object.__setattr__(self, name, value)  # also of what is frozen
        self._prepare()

    def __copy__(self) -> Self:
        """It shares what does not change, and has a state of its own."""
        kept, other = self.__getstate__(), type(self).__new__(type(self))
        states = {k: copy.copy(v) for k, v in kept.items() if isinstance(v, ctypes.Structure)}
        other.__setstate__(kept | states)
        return other
