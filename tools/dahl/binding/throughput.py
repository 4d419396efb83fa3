# SPDX-License-Identifier: MIT
"""The fast form for long logs, in double and in vectors (dahl_batch.h)."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dahl.binding import arrays, checks, parameters, trajectory
from dahl.binding.copies import Copied
from dahl.binding.library import c
from dahl.errors import InputError


@dataclass(frozen=True)
class Throughput(parameters.Counts, Copied):
    """Parameters in double (sigma0 in N m/rad, Fc in N m, theta_per_count in rad), for logs of
    millions of ticks (dahl_throughput_params_t).

    The model, limits and 0.52 ulp of Fc are those of Friction, but not the bits: computed in
    double, in vectors, by counts about 20 times as fast with AVX2 or AVX-512 (docs/speed.md). It
    is immutable and prepares no plan, so new parameters for every call cost no time.

    >>> dahl.Throughput(100.0, 0.5, 2 * 3.14159265 / 16384).run_counts([3])
    array([0.10277178], dtype=float32)
    """

    sigma0: float
    Fc: float
    theta_per_count: float = 0.0
    _prepared: Any = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        for name, limit in parameters.LIMITS.items():
            object.__setattr__(self, name, checks.real(name, getattr(self, name), limit))
        self._prepare()
        check = c.dahl_throughput_counts if self.theta_per_count else c.dahl_throughput
        if check(self._prepared, c.NULL, c.NULL, c.NULL, 0) != 0:
            raise InputError(parameters.refusal(self.sigma0, self.Fc, self.theta_per_count))

    def _prepare(self) -> None:
        values = self.sigma0, self.Fc, self.theta_per_count
        object.__setattr__(self, "_prepared", c.new("dahl_throughput_params_t *", values))

    def run_counts(
        self,
        moves: ArrayLike,
        F: float = 0.0,  # noqa: N803
        out: NDArray[np.float32] | None = None,
        *,
        threads: int = 1,
    ) -> NDArray[np.float32]:
        """Moves in counts, shape (n,), whole numbers within int32 -> torques in N m after each,
        shape (n,), float32, into `out` if given. F in N m is the torque before the first move, a
        finite number, clamped to +-Fc.

        threads, 1 to 1024, compute parts of 2^18 ticks or more at once: the same bound, and nearly
        always the same bits. A part that moves less than 45 presliding lengths needs twice the
        work.
        """
        self._need_counts()
        moves = arrays.moves(moves, arrays.INT32)
        return self._run(c.dahl_throughput_counts, moves, self.theta_per_count, F, out, threads)

    def run(
        self,
        moves: ArrayLike,
        F: float = 0.0,  # noqa: N803
        out: NDArray[np.float32] | None = None,
        *,
        threads: int = 1,
    ) -> NDArray[np.float32]:
        """Do the same for moves in rad, rounded to float32. NaN is no motion, inf saturates."""
        moves = arrays.moves(moves, arrays.FLOAT32)
        return self._run(c.dahl_throughput, moves, 1.0, F, out, threads)

    def run_path(
        self,
        theta: ArrayLike,
        F: float = 0.0,  # noqa: N803
        out: NDArray[np.float32] | None = None,
        *,
        threads: int = 1,
    ) -> NDArray[np.float32]:
        """Angles in rad, shape (n,), finite -> torques in N m at each: run() of the moves between
        them. The shaft is at theta[0] already, so the first torque is F.
        """
        return self.run(arrays.moves_of_path(theta), F, out, threads=threads)

    def _run(
        self,
        batch: Callable[..., object],
        moves: np.ndarray,
        theta_of_unit: float,
        F: float,  # noqa: N803
        out: np.ndarray | None,
        threads: int,
    ) -> np.ndarray:
        first_state, count = _state_of(F, self.Fc), checks.whole("threads", threads, 1, 1024)
        if count == 1:
            state = c.new("dahl_state_t *", (first_state,))
            return arrays.run(batch, (self._prepared, state), moves, out)
        out = arrays.output(out, moves)

        def move(first: int, last: int, w: int) -> int:
            state, span = c.new("dahl_state_t *", (w,)), slice(first, last)
            arrays.run(batch, (self._prepared, state), moves[span], out[span])
            return int(state.w)

        def travel(first: int, last: int) -> float:
            ways = np.abs(moves[first:last], dtype=np.float64)
            way = float(ways.sum())
            way = float(np.nansum(ways)) if math.isnan(way) else way
            return self.sigma0 / self.Fc * theta_of_unit * way

        trajectory.run(trajectory.Trajectory(moves.size, move, travel), first_state, count)
        return out

    @staticmethod
    def run_counts_channels(
        params: Iterable[Throughput], moves: ArrayLike, out: NDArray[np.float32] | None = None
    ) -> NDArray[np.float32]:
        """Moves in counts, shape (n, channels), a Throughput for each channel -> torques in N m,
        same shape, float32, into `out` if given. All channels start relaxed.
        """
        channels = _channels(params)
        for each in channels:
            each._need_counts()
        moves = arrays.moves(moves, arrays.INT32, len(channels))
        return _run_channels(c.dahl_throughput_counts_channels, channels, moves, out)

    @staticmethod
    def run_channels(
        params: Iterable[Throughput], moves: ArrayLike, out: NDArray[np.float32] | None = None
    ) -> NDArray[np.float32]:
        """Do the same for moves in rad."""
        channels = _channels(params)
        moves = arrays.moves(moves, arrays.FLOAT32, len(channels))
        return _run_channels(c.dahl_throughput_channels, channels, moves, out)


def _channels(params: Iterable[Throughput]) -> list[Throughput]:
    if not arrays.is_iterable(params):
        raise TypeError(f"params = {checks.shown(params)} is not a list of Throughput")
    return [checks.instance(f"params[{i}]", each, Throughput) for i, each in enumerate(params)]


def _run_channels(
    batch: Callable[..., object],
    channels: list[Throughput],
    moves: np.ndarray,
    out: np.ndarray | None,
) -> np.ndarray:
    count = len(channels)
    params = c.new("dahl_throughput_params_t[]", [each._prepared[0] for each in channels])
    states = c.new("dahl_state_t[]", count)
    return arrays.run(batch, (params, states, count), moves, out)


def _state_of(F: float, Fc: float) -> int:  # noqa: N803
    """The state w in Q62 of torque F, clamped to +-Fc."""
    if type(F) is float and F == 0.0:  # quick: the default
        return 0
    ratio = checks.finite("F", F, "N m") / Fc
    return round(max(-1.0, min(1.0, ratio)) * 2.0**62)
