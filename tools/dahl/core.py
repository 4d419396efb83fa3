# SPDX-License-Identifier: MIT
"""The C library by ctypes: same names, units and bits as lib/dahl.h, whose comments are the manual.

Parameters are checked by dahl_prepare() itself; only to say which one is out of range, and which
limit it passed, are the limits of the header known here (a test compares the two).
"""

from __future__ import annotations

import ctypes
import math
from collections.abc import Sequence
from functools import cache

import numpy as np
from numpy.typing import ArrayLike

from dahl import Error, arrays, paths
from dahl.arrays import INT32_MAX, INT32_MIN

TORQUE_MIN, TORQUE_MAX = 2.0**-64, 2.0**64  # DAHL_TORQUE_MIN, _MAX: sigma0 in N m/rad and Fc in N m
TRAVEL_MIN, TRAVEL_MAX = 2.0**-30, 2.0**20  # DAHL_TRAVEL_MIN, _MAX: sigma0/Fc * theta_per_count
PLAN_ROOM = (
    128  # 8-byte words kept for a dahl_plan_t (38 are used): its inside is the library's business
)


class State(ctypes.Structure):
    """dahl_state_t: w = F/Fc in Q62, 0 is relaxed."""

    _fields_ = [("w", ctypes.c_int64)]


class _Params(ctypes.Structure):
    _fields_ = [
        ("sigma0", ctypes.c_float),
        ("Fc", ctypes.c_float),
        ("theta_per_count", ctypes.c_float),
    ]


@cache
def library() -> ctypes.CDLL:
    """libdahl.so with the types of its functions. Raises dahl.RunError when it is not built."""
    lib = ctypes.CDLL(str(paths.library()))
    plan, state, f32, i32 = ctypes.c_void_p, ctypes.POINTER(State), ctypes.c_float, ctypes.c_int32
    array, size, many = ctypes.c_void_p, ctypes.c_size_t, ctypes.c_void_p
    for name, result, *arguments in (
        ("dahl_prepare", ctypes.c_int, plan, ctypes.POINTER(_Params)),
        ("dahl_step_counts", f32, plan, state, i32),
        ("dahl_step_counts_q30", i32, plan, state, i32),
        ("dahl_step", f32, plan, state, f32),
        ("dahl_torque", f32, plan, state),
        ("dahl_set_torque", None, plan, state, f32),
        ("dahl_change_plan", None, plan, plan, state),
        ("dahl_counts_between", i32, ctypes.c_uint32, ctypes.c_uint32, ctypes.c_uint32),
        ("dahl_batch_counts", None, plan, state, array, array, size),
        ("dahl_batch", None, plan, state, array, array, size),
        ("dahl_throughput_counts", ctypes.c_int, many, state, array, array, size),
        ("dahl_throughput", ctypes.c_int, many, state, array, array, size),
        ("dahl_throughput_counts_channels", ctypes.c_int, many, state, size, array, array, size),
        ("dahl_throughput_channels", ctypes.c_int, many, state, size, array, array, size),
    ):
        function = getattr(lib, name)
        function.restype, function.argtypes = result, arguments
    return lib


def _float32(name: str, value: float) -> float:
    """The float nearest to value, as C will see it."""
    try:
        return ctypes.c_float(value).value
    except TypeError:
        raise Error(f"{name} = {value!r} is not a number") from None


def _int32(name: str, value: int) -> int:
    """value as a C int32_t, which ctypes would wrap without a word."""
    if int(value) != value or not INT32_MIN <= value <= INT32_MAX:
        raise Error(f"{name} = {value!r} is not a whole number from {INT32_MIN} to {INT32_MAX}")
    return int(value)


def _refusal(plan: Plan | Throughput) -> str:
    """Which parameter dahl_prepare() did not like, and its limit."""
    for name in ("sigma0", "Fc"):
        value = getattr(plan, name)
        if not TORQUE_MIN <= value < TORQUE_MAX:
            return f"{name} = {value:g} is outside 2^-64 <= {name} < 2^64"
    if not 0 <= plan.theta_per_count < math.inf:
        return f"theta_per_count = {plan.theta_per_count:g} is not a finite number >= 0 (rad/count)"
    if (
        isinstance(plan, Plan)
        and plan.theta_per_count
        and not (TORQUE_MIN <= plan.theta_per_count < TORQUE_MAX)
    ):
        return (
            f"theta_per_count = {plan.theta_per_count:g} is neither 0 nor in"
            " 2^-64 <= theta_per_count < 2^64 (rad/count)"
        )
    return (
        f"travel of one count sigma0/Fc*theta_per_count = {plan.travel_per_count:g}"
        f" is outside 2^-30 <= travel < 2^20 (sigma0 = {plan.sigma0:g}, Fc = {plan.Fc:g},"
        f" theta_per_count = {plan.theta_per_count:g})"
    )


def _travel(plan: Plan | Throughput) -> float:
    """sigma0/Fc*theta_per_count, in a Python float."""
    travel: float = plan.sigma0 / plan.Fc * plan.theta_per_count
    return travel


class Plan:
    """Parameters, prepared once (dahl_prepare): shared by any number of Frictions, never changed.

    sigma0           N m/rad  stiffness at rest, 2^-64 <= sigma0 < 2^64                (Eq. 1)
    Fc               N m      Coulomb torque, 2^-64 <= Fc < 2^64                       (Eq. 1)
    theta_per_count  rad      per encoder count, 0: counts unused;
                              sigma0/Fc*theta_per_count in 2^-30 .. 2^20

    Each is rounded to float, as in C, and kept so. Raises dahl.Error naming the parameter, its
    value and its limit.
    """

    def __init__(self, sigma0: float, Fc: float, theta_per_count: float = 0.0) -> None:  # noqa: N803 (the field's name)
        self.sigma0 = _float32("sigma0", sigma0)
        self.Fc = _float32("Fc", Fc)
        self.theta_per_count = _float32("theta_per_count", theta_per_count)
        self._words = (ctypes.c_uint64 * PLAN_ROOM)()
        params = _Params(self.sigma0, self.Fc, self.theta_per_count)
        if library().dahl_prepare(self._words, ctypes.byref(params)) != 0:
            raise Error(_refusal(self))

    @property
    def travel_per_count(self) -> float:
        """a*theta_per_count, the travel of one count in presliding lengths Fc/sigma0."""
        return _travel(self)

    @property
    def ulp(self) -> float:
        """N m from Fc to the next float away from zero; the unit of the library's error bounds."""
        return float(np.spacing(np.float32(self.Fc)))

    def __repr__(self) -> str:
        names = ("sigma0", "Fc", "theta_per_count")
        return f"Plan({', '.join(f'{name}={getattr(self, name):g}' for name in names)})"


class Friction:
    """One bearing: a Plan and its state, relaxed at first. Torques in N m, with the sign of the
    motion.
    """

    def __init__(self, plan: Plan) -> None:
        self.plan = plan
        self.state = State(0)

    def step_counts(self, dcounts: int) -> float:
        """Move by dcounts (int32), return F in N m: within 0.52 ulp of Fc of the exact value (Eqs.
        7, 18, 27).
        """
        torque: float = library().dahl_step_counts(
            self.plan._words, ctypes.byref(self.state), _int32("dcounts", dcounts)
        )
        return torque

    def step_counts_q30(self, dcounts: int) -> int:
        """The same move; returns F/Fc in Q30, -2^30 .. 2^30: what goes over the bus."""
        ratio: int = library().dahl_step_counts_q30(
            self.plan._words, ctypes.byref(self.state), _int32("dcounts", dcounts)
        )
        return ratio

    def step(self, dtheta: float) -> float:
        """Move by dtheta rad (any float; NaN is ignored, Inf saturates), return F in N m within 0.6
        ulp of Fc.
        """
        torque: float = library().dahl_step(
            self.plan._words, ctypes.byref(self.state), _float32("dtheta", dtheta)
        )
        return torque

    @property
    def torque(self) -> float:
        """F in N m, without motion."""
        torque: float = library().dahl_torque(self.plan._words, ctypes.byref(self.state))
        return torque

    @torque.setter
    def torque(self, value: float) -> None:
        self.set_torque(value)

    def set_torque(self, F: float) -> None:  # noqa: N803 (the field's name)
        """Set the state to F in N m, clamped to +-Fc; NaN is ignored."""
        library().dahl_set_torque(self.plan._words, ctypes.byref(self.state), _float32("F", F))

    def change_plan(self, plan: Plan) -> None:
        """Go on with other parameters; the stored energy never grows (see dahl_change_plan)."""
        library().dahl_change_plan(self.plan._words, plan._words, ctypes.byref(self.state))
        self.plan = plan

    def run_counts(self, moves: ArrayLike, out: np.ndarray | None = None) -> np.ndarray:
        """Moves in counts, shape (n,), int32 range -> torques in N m after each, shape (n,),
        float32, into `out` if given: the bits of step_counts(), move by move.

        A C-contiguous int32 array is read in place, anything else of whole numbers is copied first.
        """
        moves = arrays.moves(moves, np.int32)
        out = arrays.out(out, moves)
        library().dahl_batch_counts(
            self.plan._words,
            ctypes.byref(self.state),
            arrays.data(moves),
            arrays.data(out),
            moves.size,
        )
        return out

    def run(self, moves: ArrayLike, out: np.ndarray | None = None) -> np.ndarray:
        """Moves in rad, shape (n,) -> torques in N m after each, shape (n,), float32, into `out` if
        given: the bits of step(), move by move; NaN is no motion.

        A C-contiguous float32 array is read in place, anything else is rounded to float first.
        """
        moves = arrays.moves(moves, np.float32)
        out = arrays.out(out, moves)
        library().dahl_batch(
            self.plan._words,
            ctypes.byref(self.state),
            arrays.data(moves),
            arrays.data(out),
            moves.size,
        )
        return out


class Throughput(ctypes.Structure):
    """dahl_throughput_params_t: parameters in double, for logs of millions of ticks.

    The same model and limits as Plan and the same 0.52 ulp of Fc, but not the same bits: computed
    in double, in vectors, 3 to 10 times as fast as Friction.run_counts. Nothing is prepared, so new
    parameters for every call cost nothing. `F` is the torque before the first move, in N m.

    >>> Throughput(100.0, 0.5, 2 * 3.14159265 / 16384).run_counts([3])
    array([0.10277194], dtype=float32)
    """

    _fields_ = [
        ("sigma0", ctypes.c_double),
        ("Fc", ctypes.c_double),
        ("theta_per_count", ctypes.c_double),
    ]

    def run_counts(
        self,
        moves: ArrayLike,
        F: float = 0.0,  # noqa: N803
        out: np.ndarray | None = None,
    ) -> np.ndarray:
        """Moves in counts (int32), shape (n,) -> torques in N m after each, shape (n,), float32."""
        return self._run("dahl_throughput_counts", arrays.moves(moves, np.int32), F, out)

    def run(
        self,
        moves: ArrayLike,
        F: float = 0.0,  # noqa: N803
        out: np.ndarray | None = None,
    ) -> np.ndarray:
        """Moves in rad (float32), shape (n,) -> torques in N m after each, shape (n,), float32."""
        return self._run("dahl_throughput", arrays.moves(moves, np.float32), F, out)

    def _run(self, name: str, moves: np.ndarray, F: float, out: np.ndarray | None) -> np.ndarray:  # noqa: N803
        out = arrays.out(out, moves)
        state = _state_of(F, self.Fc)
        code = getattr(library(), name)(
            ctypes.byref(self),
            ctypes.byref(state),
            arrays.data(moves),
            arrays.data(out),
            moves.size,
        )
        if code != 0:
            raise Error(_refusal(self))
        return out

    @staticmethod
    def run_counts_channels(
        params: Sequence[Throughput], moves: ArrayLike, out: np.ndarray | None = None
    ) -> np.ndarray:
        """Moves in counts, shape (n, channels), a Throughput for each channel -> torques in N m,
        same shape, float32; all channels start relaxed.
        """
        moves = arrays.moves(moves, np.int32, len(params))
        return Throughput._run_channels("dahl_throughput_counts_channels", params, moves, out)

    @staticmethod
    def run_channels(
        params: Sequence[Throughput], moves: ArrayLike, out: np.ndarray | None = None
    ) -> np.ndarray:
        """Moves in rad, shape (n, channels) -> torques in N m, same shape, float32."""
        moves = arrays.moves(moves, np.float32, len(params))
        return Throughput._run_channels("dahl_throughput_channels", params, moves, out)

    @staticmethod
    def _run_channels(
        name: str, params: Sequence[Throughput], moves: np.ndarray, out: np.ndarray | None
    ) -> np.ndarray:
        out, count = arrays.out(out, moves), len(params)
        states, together = (State * count)(), (Throughput * count)(*params)
        code = getattr(library(), name)(
            together, states, count, arrays.data(moves), arrays.data(out), len(moves)
        )
        if code != 0:
            raise Error(next(filter(None, map(_throughput_fault, params)), "parameters refused"))
        return out

    @property
    def travel_per_count(self) -> float:
        """As that of a Plan."""
        return _travel(self)


def _throughput_fault(params: Throughput) -> str:
    """What is wrong with one of many, or nothing."""
    sound = all(TORQUE_MIN <= v < TORQUE_MAX for v in (params.sigma0, params.Fc))
    if sound and TRAVEL_MIN <= params.travel_per_count < TRAVEL_MAX:
        return ""
    return _refusal(params)


def _state_of(F: float, Fc: float) -> State:  # noqa: N803
    """The state of torque F, clamped to +-Fc; relaxed where that has no meaning."""
    ratio = F / Fc if Fc > 0 and not math.isnan(F) else 0.0
    return State(round(max(-1.0, min(1.0, ratio)) * 2.0**62))


def counts_between(before: int, now: int, counts_per_turn: int = 0) -> int:
    """Shortest signed way from one encoder reading to the next; 0 counts per turn is a full 32-bit
    counter.
    """
    readings = before & 0xFFFFFFFF, now & 0xFFFFFFFF
    moved: int = library().dahl_counts_between(*readings, counts_per_turn)
    return moved
