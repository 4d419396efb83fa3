# SPDX-License-Identifier: MIT
"""Friction that depends on speed (dahl_parts.h)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dahl.binding import arrays, checks, parameters
from dahl.binding.copies import Copied
from dahl.binding.library import c
from dahl.errors import InputError

SEGMENTS = 16  # DAHL_VELOCITY_SEGMENTS: torques of a table over speed
SEGMENT_BITS_MAX = 24
TORQUES = "0, or 2^-64 <= |torque| < 2^64 (N m)"


class VelocityTable(Copied):
    """Friction that depends on speed (viscous, Stribeck; dahl_velocity_plan_t): an odd table over
    the counts of one tick, linear in between, the last value beyond. Add its torques to those of an
    element that depends on the path. It is immutable and has no state.

    torque        N m  16 values: torque[k] at (k + 1) 2^segment_bits counts a tick forward, its
                       negative backward; each 0, or 2^-64 <= |torque| < 2^64
    segment_bits       0 .. 24

    Error: 1.5 2^-30 of the largest torque, and one rounding. Cost: 1 us a step, 5 ns a tick of
    run_counts().

    >>> viscous = dahl.VelocityTable(torque=[0.01 * (k + 1) for k in range(16)], segment_bits=2)
    >>> viscous.step_counts(-8), viscous.step_counts(0)
    (-0.019999999552965164, 0.0)
    """

    def __init__(self, torque: Sequence[float], segment_bits: int) -> None:
        if not arrays.is_list(torque):
            raise TypeError(f"torque = {checks.shown(torque)} is not a list of numbers")
        if len(torque) != SEGMENTS:
            raise InputError(f"torque has {len(torque)} values; {SEGMENTS} were expected")
        self._torque = tuple(
            parameters.parameter(f"torque[{k}]", value, TORQUES) for k, value in enumerate(torque)
        )
        self._segment_bits = checks.whole("segment_bits", segment_bits, 0, SEGMENT_BITS_MAX)
        self._prepare()

    def _prepare(self) -> None:
        self._prepared = c.new("dahl_velocity_plan_t *")
        params = c.new("dahl_velocity_params_t *", (self._segment_bits, self._torque))
        if c.dahl_velocity_prepare(self._prepared, params) == 0:
            return
        for k, value in enumerate(self._torque):
            if value != 0 and not parameters.TORQUE_MIN <= abs(value) < parameters.TORQUE_MAX:
                shown = parameters.digits(value)
                raise InputError(f"torque[{k}] = {shown} is outside {TORQUES}")
        raise InputError(f"{self!r} is refused by dahl_velocity_prepare")

    @property
    def torque(self) -> tuple[float, ...]:
        """N m, at (k + 1) 2^segment_bits counts a tick."""
        return self._torque

    @property
    def segment_bits(self) -> int:
        """2^segment_bits counts a tick from one value to the next."""
        return self._segment_bits

    def step_counts(self, dcounts: int) -> float:
        """Return the torque in N m of a tick that moves by dcounts, a whole number within int32."""
        return float(c.dahl_velocity_torque(self._prepared, checks.counts(dcounts)))

    def run_counts(
        self, moves: ArrayLike, out: NDArray[np.float32] | None = None
    ) -> NDArray[np.float32]:
        """Moves in counts of each tick, shape (n,), whole numbers within int32 -> torques in N m,
        shape (n,), float32, into `out` if given: the bits of step_counts().
        """
        array = arrays.moves(moves, arrays.INT32)
        return arrays.run(c.dahl_batch_velocity, (self._prepared,), array, out)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, VelocityTable):
            return NotImplemented
        return (self._torque, self._segment_bits) == (other._torque, other._segment_bits)

    def __hash__(self) -> int:
        return hash((self._torque, self._segment_bits))

    def __repr__(self) -> str:
        torques = ", ".join(map(parameters.digits, self._torque))
        return f"VelocityTable(torque=[{torques}], segment_bits={self._segment_bits})"
