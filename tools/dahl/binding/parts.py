# SPDX-License-Identifier: MIT
"""Parts beside one Dahl element, by the C library: same names, units and bits as dahl_parts.h,
whose comments are the manual.
"""

from __future__ import annotations

import copy
import ctypes
from collections.abc import Sequence
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dahl.binding import arrays, checks, core
from dahl.binding.copies import Copied
from dahl.errors import Error

SLIP_MAX = 8  # DAHL_SLIP_MAX: slip elements side by side
PLAN_ROOM = 32  # 8-byte words kept for a dahl_slip_plan_t (14 are used)


class _SlipParams(ctypes.Structure):
    _fields_ = [
        ("elements", ctypes.c_uint32),
        ("theta_per_count", ctypes.c_float),
        ("sigma0", ctypes.c_float * SLIP_MAX),
        ("Fc", ctypes.c_float * SLIP_MAX),
    ]


class _SlipState(ctypes.Structure):
    _fields_ = [("x", ctypes.c_int32 * SLIP_MAX)]


def _floats(name: str, values: Sequence[float], limit: str) -> tuple[float, ...]:
    """Each as C will see it."""
    if not arrays.is_list(values):
        raise Error(f"{name} = {checks.shown(values)} is not a list of numbers, one an element")
    return tuple(core.parameter(f"{name}[{k}]", value, limit) for k, value in enumerate(values))


@checks.calls_checked
class Element:
    """What every part does with moves in counts; torques in N m, with the sign of the motion."""

    def _step(self, dcounts: int) -> float:
        raise NotImplementedError

    def _batch(self, moves: np.ndarray, out: np.ndarray) -> None:
        raise NotImplementedError

    def step_counts(self, dcounts: int) -> float:
        """Move by dcounts, a whole number within int32; returns F in N m within 0.55 ulp of Fc (of
        the sum of Fc, of the larger Fc) of the exact value. Raises dahl.Error for any other
        dcounts.
        """
        return self._step(checks.whole("dcounts", dcounts, arrays.INT32_MIN, arrays.INT32_MAX))

    @property
    def torque(self) -> float:
        """F in N m, without motion."""
        return self._step(0)

    def run_counts(
        self, moves: ArrayLike, out: NDArray[np.float32] | None = None
    ) -> NDArray[np.float32]:
        """Moves in counts, shape (n,), whole numbers within int32 -> torques in N m after each,
        shape (n,), float32, into `out` if given: the bits of step_counts(), move by move. Raises
        dahl.Error, before any move, as Friction.run_counts() does.
        """
        array = arrays.moves(moves, np.int32)
        result = arrays.out(out, array)
        self._batch(array, result)
        return result


class _SlipParameters(Copied):
    """Of slip elements side by side, exact or fast."""

    _sigma0: tuple[float, ...]
    _Fc: tuple[float, ...]
    _theta_per_count: float

    def _parameters(self) -> tuple[Any, ...]:
        return self._sigma0, self._Fc, self._theta_per_count

    @staticmethod
    def _digits(value: float) -> str:
        """What tells a double."""
        return repr(value)

    @property
    def sigma0(self) -> tuple[float, ...]:
        """N m/rad, one an element."""
        return self._sigma0

    @property
    def Fc(self) -> tuple[float, ...]:  # noqa: N802
        """N m, one an element."""
        return self._Fc

    @property
    def theta_per_count(self) -> float:
        """rad/count"""
        return self._theta_per_count

    def __repr__(self) -> str:
        sigma0, Fc = (", ".join(map(self._digits, values)) for values in (self._sigma0, self._Fc))
        theta = self._digits(self._theta_per_count)
        return f"{type(self).__name__}(sigma0=[{sigma0}], Fc=[{Fc}], theta_per_count={theta})"


@checks.calls_checked
class Slip(_SlipParameters, Element):
    """Slip elements side by side (Maxwell slip, Prandtl-Ishlinskii; dahl_slip_plan_t), with their
    state, relaxed at first: F = sum of springs sigma0 that slip at Fc.

    sigma0           N m/rad  one an element, 1 to 8 of them; ranges as in Plan
    Fc               N m      torque at which each slips, as many
    theta_per_count  rad      per encoder count; sigma0/Fc*theta_per_count in the range of Plan for
                              each element

    Two are equal where parameters and deflections are; picklable; a copy has a state of its own.
    Raises dahl.Error naming the parameter, its value and its limit.

    >>> dahl.Slip(sigma0=[100.0, 50.0], Fc=[0.5, 1.0], theta_per_count=1e-3).step_counts(10)
    1.0
    """

    @staticmethod
    def _digits(value: float) -> str:
        """As few as tell the float that C takes: 0.3, not 0.30000001192092896."""
        return str(np.float32(value))

    def __init__(
        self,
        sigma0: Sequence[float],
        Fc: Sequence[float],  # noqa: N803 (the field's name)
        theta_per_count: float,
    ) -> None:
        self._sigma0 = _floats("sigma0", sigma0, core.SIGMA0)
        self._Fc = _floats("Fc", Fc, core.FC)
        self._theta_per_count = core.parameter("theta_per_count", theta_per_count, core.COUNTED)
        self._state = _SlipState()
        self._prepare()

    def _prepare(self) -> None:
        self._words = (ctypes.c_uint64 * PLAN_ROOM)()
        count = len(self._sigma0)
        if not 1 <= count <= SLIP_MAX or len(self._Fc) != count:
            raise Error(
                f"sigma0 has {count} elements and Fc {len(self._Fc)}; as many of each, 1 to"
                f" {SLIP_MAX}, were expected"
            )
        params = _SlipParams(count, self._theta_per_count)
        params.sigma0[:count], params.Fc[:count] = self._sigma0, self._Fc
        if core.library().dahl_slip_prepare(self._words, ctypes.byref(params)) != 0:
            raise Error(self._refusal())

    def _refusal(self) -> str:
        """Which element the library did not like, in the words of Plan."""
        core.need_counted(self._theta_per_count)
        for k, (sigma0, torque) in enumerate(zip(self._sigma0, self._Fc, strict=True)):
            try:
                core.Plan(sigma0, torque, self._theta_per_count)
            except Error as error:
                return f"element {k}: {error}"
        return f"{self!r} is refused by dahl_slip_prepare"

    def step_counts_q30(self, dcounts: int) -> int:
        """The same move, the same errors; returns F over the sum of Fc in Q30, -2^30 .. 2^30."""
        moved = checks.whole("dcounts", dcounts, arrays.INT32_MIN, arrays.INT32_MAX)
        ratio: int = core.library().dahl_slip_step_counts_q30(
            self._words, ctypes.byref(self._state), moved
        )
        return ratio

    def _step(self, dcounts: int) -> float:
        torque: float = core.library().dahl_slip_step_counts(
            self._words, ctypes.byref(self._state), dcounts
        )
        return torque

    def _batch(self, moves: np.ndarray, out: np.ndarray) -> None:
        state = ctypes.byref(self._state)
        core.library().dahl_batch_slip_counts(
            self._words, state, arrays.data(moves), arrays.data(out), moves.size
        )

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Slip):
            return NotImplemented
        alike = self._parameters() == other._parameters()
        return alike and bytes(self._state) == bytes(other._state)

    __hash__ = None  # type: ignore[assignment]  # it changes with each step


@checks.calls_checked
class Parallel(Element, Copied):
    """Elements on one shaft, whose torques add (dahl_part_t): any mix of Friction and Slip, each
    with a state of its own, which moves with this. The sum in N m is rounded once, within 0.55 ulp
    of the sum of all Fc.

    Equal where all parts are; picklable; a copy has parts of its own. Raises dahl.Error for what is
    no part, for a part that stands there twice, and for a Friction without theta_per_count.

    >>> bearing = dahl.Friction(dahl.Plan(100.0, 0.5, 1e-3))
    >>> dahl.Parallel(bearing, dahl.Slip([20.0], [1.0], 1e-3)).step_counts(10**6)
    1.5
    """

    def __init__(self, *parts: core.Friction | Slip) -> None:
        for k, part in enumerate(parts):
            if not isinstance(part, (core.Friction, Slip)):
                raise Error(f"parts[{k}] = {checks.shown(part)} is neither a Friction nor a Slip")
            if any(part is other for other in parts[:k]):
                raise Error(f"parts[{k}] stands there twice: it would move twice")
        self._parts = parts

    @property
    def parts(self) -> tuple[core.Friction | Slip, ...]:
        """As they were given; they move with this."""
        return self._parts

    def step_counts_q30(self, dcounts: int) -> int:
        """The same move, the same errors; returns F over the sum of Fc in Q30, -2^30 .. 2^30: the
        bits of a firmware that took its shares from the plans that the parts have now.
        """
        moved = checks.whole("dcounts", dcounts, arrays.INT32_MIN, arrays.INT32_MAX)
        parts, count, lib = self._c_parts(), len(self._parts), core.library()
        shares = (ctypes.c_int32 * count)()
        lib.dahl_parallel_shares(shares, parts, count)
        ratio: int = lib.dahl_parallel_step_counts_q30(parts, shares, count, moved)
        return ratio

    def _c_parts(self) -> Any:
        return (core.Part * len(self._parts))(*map(_part_of, self._parts))

    def _step(self, dcounts: int) -> float:
        torque: float = core.library().dahl_parallel_step_counts(
            self._c_parts(), len(self._parts), dcounts
        )
        return torque

    def _batch(self, moves: np.ndarray, out: np.ndarray) -> None:
        core.library().dahl_batch_parallel_counts(
            self._c_parts(), len(self._parts), arrays.data(moves), arrays.data(out), moves.size
        )

    def __copy__(self) -> Self:
        other = super().__copy__()
        other._parts = tuple(map(copy.copy, self._parts))
        return other

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Parallel):
            return NotImplemented
        return self._parts == other._parts

    __hash__ = None  # type: ignore[assignment]  # it changes with each step

    def __repr__(self) -> str:
        return f"Parallel({', '.join(map(repr, self._parts))})"


@checks.calls_checked
class _Fast:
    """What the throughput forms of parts do: in double, in vectors, from rest."""

    def _elements(self) -> list[core.ThroughputElement]:
        raise NotImplementedError

    def run_counts(
        self, moves: ArrayLike, out: NDArray[np.float32] | None = None
    ) -> NDArray[np.float32]:
        """Moves in counts, shape (n,), whole numbers within int32 -> torques in N m after each,
        shape (n,), float32, into `out` if given; all is relaxed before the first one. Raises
        dahl.Error as Friction.run_counts() does.
        """
        array, elements = arrays.moves(moves, np.int32), self._elements()
        result = arrays.out(out, array)
        core.library().dahl_throughput_parallel_counts(
            (core.ThroughputElement * len(elements))(*elements),
            len(elements),
            arrays.data(array),
            arrays.data(result),
            array.size,
        )
        return result


@checks.calls_checked
class ThroughputSlip(_SlipParameters, _Fast):
    """Parameters of slip elements in double, for logs of millions of ticks
    (dahl_throughput_element_t): the model, units and limits of Slip, in vectors, about 5 times as
    fast as Slip.run_counts. Torques in N m are within 0.5001 ulp of the sum of Fc, without end; not
    the bits of Slip. Nothing is prepared, nothing is kept from call to call. Equal where parameters
    are; picklable. Raises dahl.Error as Slip does.

    >>> dahl.ThroughputSlip([100.0, 50.0], [0.5, 1.0], 1e-3).run_counts([10, 10])
    array([1. , 1.5], dtype=float32)
    """

    def __init__(
        self,
        sigma0: Sequence[float],
        Fc: Sequence[float],  # noqa: N803 (the field's name)
        theta_per_count: float,
    ) -> None:
        Slip(sigma0, Fc, theta_per_count)  # says what is wrong
        self._sigma0 = tuple(float(value) for value in sigma0)
        self._Fc = tuple(float(value) for value in Fc)
        self._theta_per_count = float(theta_per_count)
        for k, values in enumerate(zip(self._sigma0, self._Fc, strict=True)):
            try:
                core.Throughput(*values, self._theta_per_count)
            except Error as error:
                raise Error(f"element {k}: {error}") from None

    def _elements(self) -> list[core.ThroughputElement]:
        return [
            core.ThroughputElement((sigma0, torque, self._theta_per_count), 1)
            for sigma0, torque in zip(self._sigma0, self._Fc, strict=True)
        ]

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, ThroughputSlip):
            return NotImplemented
        return self._parameters() == other._parameters()

    def __hash__(self) -> int:
        return hash(self._parameters())


@checks.calls_checked
class ThroughputParallel(_Fast):
    """Elements on one shaft, whose torques in N m add, in double, for long logs
    (dahl_throughput_element_t): any mix of Throughput and ThroughputSlip. Within 0.52 ulp of the
    sum of all Fc, without end; not the bits of Parallel, 5 to 8 times as fast. Equal where all
    parts are; picklable. Raises dahl.Error for what is no part, and for a Throughput without
    theta_per_count.

    >>> bearing, seal = dahl.Throughput(100, 0.5, 1e-3), dahl.ThroughputSlip([20], [1], 1e-3)
    >>> dahl.ThroughputParallel(bearing, seal).run_counts([10**6])
    array([1.5], dtype=float32)
    """

    def __init__(self, *parts: core.Throughput | ThroughputSlip) -> None:
        for k, part in enumerate(parts):
            if not isinstance(part, (core.Throughput, ThroughputSlip)):
                what = f"parts[{k}] = {checks.shown(part)}"
                raise Error(f"{what} is neither a Throughput nor a ThroughputSlip")
            if isinstance(part, core.Throughput):
                part._need_counts()
        self._parts = parts

    @property
    def parts(self) -> tuple[core.Throughput | ThroughputSlip, ...]:
        """As they were given."""
        return self._parts

    def _elements(self) -> list[core.ThroughputElement]:
        return [element for part in self._parts for element in _elements_of(part)]

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, ThroughputParallel):
            return NotImplemented
        return self._parts == other._parts

    def __hash__(self) -> int:
        return hash(self._parts)

    def __repr__(self) -> str:
        return f"ThroughputParallel({', '.join(map(repr, self._parts))})"


def _elements_of(part: core.Throughput | ThroughputSlip) -> list[core.ThroughputElement]:
    if isinstance(part, ThroughputSlip):
        return part._elements()
    return [core.ThroughputElement(part._params, 0)]


def _part_of(part: core.Friction | Slip) -> core.Part:
    made: core.Part
    if isinstance(part, Slip):
        made = core.library().dahl_batch_slip_part(part._words, ctypes.byref(part._state))
        return made
    part.plan._need_counts()  # checked with each move: change_plan() may have taken the counts away
    made = core.library().dahl_batch_part(part.plan._words, ctypes.byref(part.state))
    return made
