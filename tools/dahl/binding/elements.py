# SPDX-License-Identifier: MIT
"""The interface of all elements that move by encoder counts."""

from __future__ import annotations

from functools import cache
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dahl.binding import arrays, checks
from dahl.binding.copies import Copied
from dahl.binding.library import c


@cache  # quick: a name is joined once
def _log_call(kind: str) -> Any:
    return getattr(c, f"dahl_batch_{kind}counts")


class Element(Copied):
    """An element with a state; torques in N m, with the sign of the motion."""

    _kind: ClassVar[str] = ""  # in the names of its C functions, with "_" at its end

    def _arguments(self) -> tuple[Any, ...]:
        """The first arguments of each of its C functions: plan and state."""
        raise NotImplementedError

    def step_counts(self, dcounts: int) -> float:
        """Move by dcounts, a whole number within int32, and return F in N m. Error: 0.55 ulp of Fc
        (of the sum of Fc, of the larger Fc).
        """
        step = getattr(c, f"dahl_{self._kind}step_counts")
        return float(step(*self._arguments(), checks.counts(dcounts)))

    @property
    def torque(self) -> float:
        """F in N m, without motion."""
        return self.step_counts(0)

    def run_counts(
        self, moves: ArrayLike, out: NDArray[np.float32] | None = None
    ) -> NDArray[np.float32]:
        """Moves in counts, shape (n,), whole numbers within int32 -> torques in N m after each,
        shape (n,), float32, into `out` if given: the bits of step_counts(). A C-contiguous int32
        array is read in place, other whole numbers are copied first. No value may be masked.
        """
        batch = _log_call(self._kind)
        return arrays.run(batch, self._arguments(), arrays.moves(moves, arrays.INT32), out)


class RatioElement(Element):
    """An element that also returns its torque in whole numbers."""

    def step_counts_q30(self, dcounts: int) -> int:
        """Move as step_counts() does and return the torque in Q30, -2^30 .. 2^30, as a fraction of
        Fc (of the larger Fc, of the sum of Fc). FrictionTorque frames carry this number.
        """
        step = getattr(c, f"dahl_{self._kind}step_counts_q30")
        return int(step(*self._arguments(), checks.counts(dcounts)))
