# SPDX-License-Identifier: MIT
"""The C library by ctypes: same names, units and bits as dahl.h, whose comments are the manual.

Parameters are checked by the library itself; only to say which one is out of range, and which limit
it passed, are the limits of the header known here (a test compares the two). All that a caller can
get wrong raises dahl.Error in one line with name, value and limit; nothing is taken silently.
"""

from __future__ import annotations

import ctypes
import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dahl import paths
from dahl.binding import arrays, checks, trajectory
from dahl.binding.arrays import INT32_MAX, INT32_MIN
from dahl.binding.copies import Copied
from dahl.errors import Error, RunError

TORQUE_MIN, TORQUE_MAX = 2.0**-64, 2.0**64  # DAHL_TORQUE_MIN, _MAX: sigma0 in N m/rad and Fc in N m
TRAVEL_MIN, TRAVEL_MAX = 2.0**-30, 2.0**20  # DAHL_TRAVEL_MIN, _MAX: sigma0/Fc * theta_per_count
STATE_MIN, STATE_MAX = -(2**62) - 2**31, 2**62 + 2**31 - 1  # of w, what a step can leave
UINT32_MAX = 2**32 - 1
PLAN_ROOM = (
    128  # 8-byte words kept for a dahl_plan_t (38 are used): its inside is the library's business
)


@checks.calls_checked
class State(ctypes.Structure):
    """dahl_state_t, the state of one bearing: w = F/Fc in Q62, a whole number; 0 is relaxed, +-2^62
    is +-Fc. Comparable, picklable; a copy is a state of its own. Raises dahl.Error for a w that no
    step can leave.
    """

    _fields_ = [("_w", ctypes.c_int64)]

    def __init__(self, w: int = 0) -> None:
        super().__init__(checks.whole("w", w, STATE_MIN, STATE_MAX))

    @property
    def w(self) -> int:
        """F/Fc in Q62."""
        return int(self._w)

    @w.setter
    def w(self, value: int) -> None:
        self._w = checks.whole("w", value, STATE_MIN, STATE_MAX)

    def __eq__(self, other: object) -> bool:
        return self.w == other.w if isinstance(other, State) else NotImplemented

    __hash__ = None  # type: ignore[assignment]  # it changes

    def __repr__(self) -> str:
        return f"State(w={self.w})"


class _Params(ctypes.Structure):
    _fields_ = [
        ("sigma0", ctypes.c_float),
        ("Fc", ctypes.c_float),
        ("theta_per_count", ctypes.c_float),
    ]


class _ThroughputParams(ctypes.Structure):
    _fields_ = [
        ("sigma0", ctypes.c_double),
        ("Fc", ctypes.c_double),
        ("theta_per_count", ctypes.c_double),
    ]


class ThroughputElement(ctypes.Structure):
    """dahl_throughput_element_t."""

    _fields_ = [
        ("params", _ThroughputParams),
        ("slips", ctypes.c_int32),
        ("state", State),
        ("x", ctypes.c_double),
    ]


class Part(ctypes.Structure):
    """dahl_part_t; the library fills it in."""

    _fields_ = [
        ("move", ctypes.c_void_p),
        ("plan", ctypes.c_void_p),
        ("state", ctypes.c_void_p),
        ("Fc", ctypes.c_uint32),
    ]


class _Encoder(ctypes.Structure):
    _fields_ = [
        ("last", ctypes.c_uint32),
        ("scale", ctypes.c_uint32),
        ("shift", ctypes.c_uint32),
        ("reach", ctypes.c_uint32),
        ("modulus", ctypes.c_uint32),
        ("largest_step", ctypes.c_uint32),
        ("jumps", ctypes.c_uint32),
        ("sign", ctypes.c_int8),
        ("primed", ctypes.c_uint8),
    ]


@cache
def library() -> ctypes.CDLL:
    """The shared library ($DAHL_LIBRARY, else that of the build) with the types of its functions.
    Raises dahl.RunError when there is none, or when the file is another one.
    """
    path = paths.library()
    try:
        return _typed(ctypes.CDLL(str(path)))
    except (OSError, AttributeError) as error:
        raise RunError(f"{path}: not the shared library of dahl ({error})") from None


def _typed(lib: ctypes.CDLL) -> ctypes.CDLL:
    plan, state, f32, i32 = ctypes.c_void_p, ctypes.POINTER(State), ctypes.c_float, ctypes.c_int32
    array, size, many = ctypes.c_void_p, ctypes.c_size_t, ctypes.c_void_p
    encoder = ctypes.POINTER(_Encoder)
    for name, result, *arguments in (
        ("dahl_prepare", ctypes.c_int, plan, ctypes.POINTER(_Params)),
        ("dahl_step_counts", f32, plan, state, i32),
        ("dahl_step_counts_q30", i32, plan, state, i32),
        ("dahl_step", f32, plan, state, f32),
        ("dahl_torque", f32, plan, state),
        ("dahl_set_torque", None, plan, state, f32),
        ("dahl_change_plan", None, plan, plan, state),
        ("dahl_counts_between", i32, ctypes.c_uint32, ctypes.c_uint32, ctypes.c_uint32),
        ("dahl_to_units", i32, i32, ctypes.c_uint32),
        (
            "dahl_encoder_init",
            ctypes.c_int,
            encoder,
            ctypes.c_uint32,
            ctypes.c_int,
            ctypes.c_uint32,
        ),
        ("dahl_encoder_move", i32, encoder, ctypes.c_uint32),
        ("dahl_encoder_home", None, encoder, ctypes.c_uint32),
        ("dahl_batch_counts", None, plan, state, array, array, size),
        ("dahl_batch", None, plan, state, array, array, size),
        ("dahl_throughput_counts", ctypes.c_int, many, state, array, array, size),
        ("dahl_throughput", ctypes.c_int, many, state, array, array, size),
        ("dahl_throughput_counts_channels", ctypes.c_int, many, state, size, array, array, size),
        ("dahl_throughput_channels", ctypes.c_int, many, state, size, array, array, size),
    ):
        function = getattr(lib, name)
        function.restype, function.argtypes = result, arguments
    return _typed_parts(lib)


def _typed_parts(lib: ctypes.CDLL) -> ctypes.CDLL:
    f32, i32, size, u32 = ctypes.c_float, ctypes.c_int32, ctypes.c_size_t, ctypes.c_uint32
    code, plan = ctypes.c_int, ctypes.c_void_p
    params = state = parts = array = work = velocity = ctypes.c_void_p
    for name, result, *arguments in (
        ("batch_part", Part, plan, ctypes.POINTER(State)),
        ("batch_slip_part", Part, plan, state),
        ("throughput_parallel_counts", code, array, size, array, array, size),
        ("slip_prepare", code, plan, params),
        ("slip_step_counts", f32, plan, state, i32),
        ("slip_step_counts_q30", i32, plan, state, i32),
        ("batch_slip_counts", None, plan, state, array, array, size),
        ("parallel_step_counts", f32, parts, u32, i32),
        ("parallel_shares", None, array, parts, u32),
        ("parallel_step_counts_q30", i32, parts, array, u32, i32),
        ("batch_parallel_counts", None, parts, u32, array, array, size),
        ("asymmetric_prepare", code, plan, params),
        ("asymmetric_step_counts", f32, plan, state, i32),
        ("asymmetric_step_counts_q30", i32, plan, state, i32),
        ("batch_asymmetric_counts", None, plan, state, array, array, size),
        ("elastoplastic_prepare", code, plan, params, f32),
        ("elastoplastic_step_counts", f32, plan, state, i32),
        ("elastoplastic_step_counts_q30", i32, plan, state, i32),
        ("batch_elastoplastic_counts", None, plan, state, array, array, size),
        ("loaded_step_counts", f32, plan, state, i32, u32),
        ("loaded_step_counts_q30", i32, plan, state, i32, u32),
        ("batch_loaded_counts", None, plan, state, array, array, array, size),
        ("clamped_step", f32, plan, state, f32, u32),
        ("work_step_counts", f32, plan, state, work, i32),
        ("batch_work_counts", None, plan, state, work, array, array, size),
        ("work", f32, params, work),
        ("counts_to_torque", code, plan, state, f32, ctypes.POINTER(i32)),
        ("tip_torque", f32, plan, u32),
        ("velocity_prepare", code, velocity, params),
        ("velocity_torque", f32, velocity, i32),
        ("batch_velocity", None, velocity, array, array, size),
    ):
        function = getattr(lib, f"dahl_{name}")
        function.restype, function.argtypes = result, arguments
    return lib


def _float32(name: str, value: float, limit: str) -> float:
    """The float nearest to value, as C will see it."""
    return ctypes.c_float(checks.real(name, value, limit)).value


def parameter(name: str, value: float, limit: str) -> float:
    """A parameter as C will see it. One that is too small for a float is not taken for 0, which
    means something else, and one that is too large is named as it was given.
    """
    number = checks.real(name, value, limit)
    rounded = ctypes.c_float(number).value
    if (rounded == 0 and number != 0) or (math.isinf(rounded) and not math.isinf(number)):
        raise Error(f"{name} = {checks.shown(value)} is outside {limit}")
    return rounded


def _dcounts(dcounts: int) -> int:
    """A move as a C int32_t, which ctypes would wrap without a word."""
    return checks.whole("dcounts", dcounts, INT32_MIN, INT32_MAX)


def _shown(value: float, low: float, high: float) -> str:
    """Six digits, or all of them where six would look as if they were within the limits."""
    short = f"{value:g}"
    return repr(value) if low <= float(short) < high else short


def _refusal(sigma0: float, Fc: float, theta_per_count: float) -> str:  # noqa: N803
    """Which parameter the library did not like, and its limit."""
    for name, value, limit in (
        ("sigma0", sigma0, SIGMA0),
        ("Fc", Fc, FC),
        ("theta_per_count", theta_per_count, THETA_PER_COUNT),
    ):
        if not TORQUE_MIN <= value < TORQUE_MAX and (name != "theta_per_count" or value != 0):
            return f"{name} = {_shown(value, TORQUE_MIN, TORQUE_MAX)} is outside {limit}"
    travel = sigma0 / Fc * theta_per_count
    return (
        f"travel of one count sigma0/Fc*theta_per_count = {_shown(travel, TRAVEL_MIN, TRAVEL_MAX)}"
        f" is outside 2^-30 <= travel < 2^20 (sigma0 = {sigma0:g}, Fc = {Fc:g},"
        f" theta_per_count = {theta_per_count:g})"
    )


SIGMA0 = "2^-64 <= sigma0 < 2^64 (N m/rad)"
FC = "2^-64 <= Fc < 2^64 (N m)"
COUNTED = "2^-64 <= theta_per_count < 2^64 (rad/count)"  # where counts are moves
THETA_PER_COUNT = f"{COUNTED}, or 0 for no encoder"


def need_counted(theta_per_count: float) -> None:
    """Raise dahl.Error for no encoder, and for one out of range, where there is no other way."""
    if not TORQUE_MIN <= theta_per_count < TORQUE_MAX:
        shown = _shown(theta_per_count, TORQUE_MIN, TORQUE_MAX)
        raise Error(f"theta_per_count = {shown} is outside {COUNTED}")


class _Parameters:
    """What both kinds of parameters know."""

    sigma0: float
    Fc: float
    theta_per_count: float

    @property
    def travel_per_count(self) -> float:
        """sigma0/Fc*theta_per_count: travel of one count in presliding lengths Fc/sigma0, 0 without
        encoder.
        """
        return self.sigma0 / self.Fc * self.theta_per_count

    def _need_counts(self) -> None:
        """Raise dahl.Error where counts have no meaning; C would take each for no motion."""
        if self.theta_per_count == 0:
            raise Error(
                "theta_per_count = 0: no encoder, so only moves in rad; for counts"
                f" {COUNTED} is needed"
            )


@checks.calls_checked
@dataclass(frozen=True, repr=False)
class Plan(_Parameters, Copied):
    """Parameters, prepared once (dahl_prepare): shared by any number of Frictions, never changed.

    sigma0           N m/rad  stiffness at rest, 2^-64 <= sigma0 < 2^64                (Eq. 1)
    Fc               N m      Coulomb torque, 2^-64 <= Fc < 2^64                       (Eq. 1)
    theta_per_count  rad      per encoder count, 2^-64 <= theta_per_count < 2^64, with
                              2^-30 <= sigma0/Fc*theta_per_count < 2^20; 0: no encoder

    For linear motion read m and N. Each is rounded to float, as in C, and kept so. Immutable;
    plans of equal parameters are equal and have one hash; picklable; its repr makes it again. About
    10 us to make. Raises dahl.Error naming the parameter, its value and its limit.
    """

    sigma0: float
    Fc: float
    theta_per_count: float = 0.0
    _words: Any = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        for name, limit in (("sigma0", SIGMA0), ("Fc", FC), ("theta_per_count", THETA_PER_COUNT)):
            object.__setattr__(self, name, parameter(name, getattr(self, name), limit))
        self._prepare()

    def _prepare(self) -> None:
        object.__setattr__(self, "_words", (ctypes.c_uint64 * PLAN_ROOM)())
        params = _Params(self.sigma0, self.Fc, self.theta_per_count)
        if library().dahl_prepare(self._words, ctypes.byref(params)) != 0:
            raise Error(_refusal(self.sigma0, self.Fc, self.theta_per_count))

    @property
    def ulp(self) -> float:
        """N m from Fc to the next float away from zero; the unit of the library's error bounds."""
        return float(np.spacing(np.float32(self.Fc)))

    def tip_torque(self, stroke: int) -> float:
        """The torque in N m at the tips of the loop that a shaft runs when it goes to and fro by
        the same stroke for ever: Fc tanh(u/2), u the travel of the stroke. stroke is in counts from
        end to end, a whole number from 0 to 2^32-1. Error: 2^-30 of the torque, and one rounding.
        Raises dahl.Error for any other stroke, and without theta_per_count.
        """
        self._need_counts()
        torque: float = library().dahl_tip_torque(
            self._words, checks.whole("stroke", stroke, 0, UINT32_MAX)
        )
        return torque

    def __repr__(self) -> str:
        names = ("sigma0", "Fc", "theta_per_count")
        digits = (f"{name}={np.float32(getattr(self, name))!s}" for name in names)
        return f"Plan({', '.join(digits)})"


@checks.calls_checked
class Friction(Copied):
    """One bearing: a Plan and its state, relaxed at first (dahl_plan_t, dahl_state_t; Eqs. 7, 18,
    27). Torques in N m, with the sign of the motion.

    Two are equal where plan and state are; picklable; a copy shares the plan and has a state of its
    own. One thread at a time. A single step costs about 1 us from Python, a tick in a batch about
    10 ns. Raises dahl.Error for anything that is no Plan.
    """

    def __init__(self, plan: Plan) -> None:
        self._plan = checks.instance("plan", plan, Plan)
        self._state = State()

    @property
    def plan(self) -> Plan:
        """The parameters; change_plan() goes on with others."""
        return self._plan

    @property
    def state(self) -> State:
        """The state, live: w = F/Fc in Q62."""
        return self._state

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Friction):
            return NotImplemented
        return self.plan == other.plan and self.state == other.state

    __hash__ = None  # type: ignore[assignment]  # it changes with each step

    def __repr__(self) -> str:
        return f"<Friction {self.plan!r}, torque={self.torque:g} N m>"

    def step_counts(self, dcounts: int) -> float:
        """Move by dcounts, a whole number within int32; returns F in N m within 0.52 ulp of Fc of
        the exact value (Eqs. 7, 18, 27), within 0.6 ulp once step() has moved it. Raises dahl.Error
        for any other dcounts, and for a plan without theta_per_count.
        """
        self._plan._need_counts()
        torque: float = library().dahl_step_counts(
            self._plan._words, ctypes.byref(self._state), _dcounts(dcounts)
        )
        return torque

    def step_counts_q30(self, dcounts: int) -> int:
        """The same move, the same errors; returns F/Fc in Q30, -2^30 .. 2^30: what goes over the
        bus.
        """
        self._plan._need_counts()
        ratio: int = library().dahl_step_counts_q30(
            self._plan._words, ctypes.byref(self._state), _dcounts(dcounts)
        )
        return ratio

    def step(self, dtheta: float) -> float:
        """Move by dtheta rad; returns F in N m within 0.6 ulp of Fc. As in C, NaN is no motion and
        an infinite angle saturates at +-Fc. Raises dahl.Error for what is no number.
        """
        torque: float = library().dahl_step(
            self._plan._words,
            ctypes.byref(self._state),
            _float32("dtheta", dtheta, "an angle in rad"),
        )
        return torque

    @property
    def torque(self) -> float:
        """F in N m, without motion. Setting it is set_torque()."""
        torque: float = library().dahl_torque(self._plan._words, ctypes.byref(self._state))
        return torque

    @torque.setter
    def torque(self, value: float) -> None:
        self.set_torque(value)

    def set_torque(self, F: float) -> None:  # noqa: N803 (the field's name)
        """Set the state to F in N m. As in C, F is clamped to +-Fc and NaN changes nothing. Raises
        dahl.Error for what is no number.
        """
        library().dahl_set_torque(
            self._plan._words, ctypes.byref(self._state), _float32("F", F, "a torque in N m")
        )

    def counts_to_torque(self, F: float) -> int:  # noqa: N803 (the field's name)
        """A move in counts after which step_counts() returns a torque that has reached F in N m: F
        or beyond, seen from the torque now; 0 if that is F. Nothing moves. One count less does not
        reach F; dahl_parts.h bounds by how much a move that is shorter still may. Raises dahl.Error
        for an F that is no finite number, that is beyond Fc or that a move of 2^31-1 counts does
        not reach, and for a plan without theta_per_count.
        """
        self._plan._need_counts()
        wanted, found = _float32("F", checks.finite("F", F, "N m"), "N m"), ctypes.c_int32()
        code = library().dahl_counts_to_torque(
            self._plan._words, ctypes.byref(self._state), wanted, ctypes.byref(found)
        )
        if code != 0:
            limit = f"a move of 2^31-1 counts reaches at most {self._plan.Fc:g} N m"
            raise Error(f"F = {wanted!r} N m is reached by no move: {limit}")
        return found.value

    def change_plan(self, plan: Plan) -> None:
        """Go on with other parameters. The torque is kept while the new bristle can carry it; the
        stored energy F^2/(2 sigma0) never grows (see dahl_change_plan). Raises dahl.Error for
        anything that is no Plan.
        """
        checks.instance("plan", plan, Plan)
        library().dahl_change_plan(self._plan._words, plan._words, ctypes.byref(self._state))
        self._plan = plan

    def run_counts(
        self, moves: ArrayLike, out: NDArray[np.float32] | None = None
    ) -> NDArray[np.float32]:
        """Moves in counts, shape (n,), whole numbers within int32 -> torques in N m after each,
        shape (n,), float32, into `out` if given: the bits of step_counts(), move by move.

        A C-contiguous int32 array is read in place, anything else of whole numbers is copied first.
        Raises dahl.Error, before any move, for another shape or type, for the first value that is
        not whole or beyond int32, for masked values, for an `out` that C cannot fill, and for a
        plan without theta_per_count.
        """
        self._plan._need_counts()
        return self._run(library().dahl_batch_counts, arrays.moves(moves, np.int32), out)

    def run(self, moves: ArrayLike, out: NDArray[np.float32] | None = None) -> NDArray[np.float32]:
        """Moves in rad, shape (n,) -> torques in N m after each, shape (n,), float32, into `out` if
        given: the bits of step(), move by move. As in C, NaN is no motion, infinite saturates.

        A C-contiguous float32 array is read in place, anything else is rounded to float first.
        Raises dahl.Error, before any move, for another shape or type, for masked values, and for an
        `out` that C cannot fill.
        """
        return self._run(library().dahl_batch, arrays.moves(moves, np.float32), out)

    def _run(self, batch: Any, moves: np.ndarray, out: np.ndarray | None) -> np.ndarray:
        out = arrays.out(out, moves)
        batch(
            self._plan._words,
            ctypes.byref(self._state),
            arrays.data(moves),
            arrays.data(out),
            moves.size,
        )
        return out


@checks.calls_checked
@dataclass(frozen=True)
class Throughput(_Parameters):
    """dahl_throughput_params_t: parameters in double (sigma0 in N m/rad, Fc in N m, theta_per_count
    in rad), for logs of millions of ticks.

    The same model, parameters and limits as Plan and the same 0.52 ulp of Fc, but not the
    same bits: computed in double, in vectors, 3 to 10 times as fast as Friction.run_counts. Nothing
    is prepared, so new parameters for every call cost nothing. Immutable, comparable, picklable.
    Raises dahl.Error naming the parameter, its value and its limit.

    >>> dahl.Throughput(100.0, 0.5, 2 * 3.14159265 / 16384).run_counts([3])
    array([0.10277178], dtype=float32)
    """

    sigma0: float
    Fc: float
    theta_per_count: float = 0.0

    def __post_init__(self) -> None:
        for name, limit in (("sigma0", SIGMA0), ("Fc", FC), ("theta_per_count", THETA_PER_COUNT)):
            object.__setattr__(self, name, checks.real(name, getattr(self, name), limit))
        lib, nothing = library(), (None, None, None, 0)
        check = lib.dahl_throughput_counts if self.theta_per_count else lib.dahl_throughput
        if check(ctypes.byref(self._params), *nothing) != 0:
            raise Error(_refusal(self.sigma0, self.Fc, self.theta_per_count))

    @property
    def _params(self) -> _ThroughputParams:
        return _ThroughputParams(self.sigma0, self.Fc, self.theta_per_count)

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
        finite number, clamped to +-Fc. Raises dahl.Error as Friction.run_counts() does, and for F
        and threads.

        threads, 1 to 1024: a log of 2^19 ticks and more is computed in as many parts at once as it
        has threads, of 2^18 ticks or more each: the same bound, and nearly always the same bits.
        A part whose motion is less than 45 presliding lengths takes twice the work.
        """
        self._need_counts()
        moves, scale = arrays.moves(moves, np.int32), self.sigma0 / self.Fc * self.theta_per_count
        return self._run("dahl_throughput_counts", moves, scale, F, out, threads)

    def run(
        self,
        moves: ArrayLike,
        F: float = 0.0,  # noqa: N803
        out: NDArray[np.float32] | None = None,
        *,
        threads: int = 1,
    ) -> NDArray[np.float32]:
        """As run_counts(), with moves in rad (rounded to float32; NaN is no motion, infinite
        saturates); theta_per_count is not used.
        """
        moves = arrays.moves(moves, np.float32)
        return self._run("dahl_throughput", moves, self.sigma0 / self.Fc, F, out, threads)

    def _run(
        self,
        name: str,
        moves: np.ndarray,
        travel_of_unit: float,
        F: float,  # noqa: N803
        out: np.ndarray | None,
        threads: int,
    ) -> np.ndarray:
        out = arrays.out(out, moves)
        state, params, batch = _state_of(F, self.Fc), self._params, getattr(library(), name)

        def move(first: int, last: int, w: int) -> int:
            at, here, to = State(w), moves[first:last], out[first:last]
            batch(
                ctypes.byref(params),
                ctypes.byref(at),
                arrays.data(here),
                arrays.data(to),
                last - first,
            )
            return int(at.w)

        def travel(first: int, last: int) -> float:
            ways = np.abs(moves[first:last], dtype=np.float64)
            way = float(ways.sum())
            return travel_of_unit * (float(np.nansum(ways)) if math.isnan(way) else way)

        count = checks.whole("threads", threads, 1, 1024)
        trajectory.run(trajectory.Trajectory(moves.size, move, travel), state.w, count)
        return out

    @staticmethod
    def run_counts_channels(
        params: Iterable[Throughput], moves: ArrayLike, out: NDArray[np.float32] | None = None
    ) -> NDArray[np.float32]:
        """Moves in counts, shape (n, channels), a Throughput for each channel -> torques in N m,
        same shape, float32, into `out` if given; all channels start relaxed. Raises dahl.Error as
        Friction.run_counts() does, and for params that are no Throughputs.
        """
        params = _channels(params)
        for each in params:
            each._need_counts()
        moves = arrays.moves(moves, np.int32, len(params))
        return _run_channels(library().dahl_throughput_counts_channels, params, moves, out)

    @staticmethod
    def run_channels(
        params: Iterable[Throughput], moves: ArrayLike, out: NDArray[np.float32] | None = None
    ) -> NDArray[np.float32]:
        """As run_counts_channels(), with moves in rad."""
        params = _channels(params)
        moves = arrays.moves(moves, np.float32, len(params))
        return _run_channels(library().dahl_throughput_channels, params, moves, out)


def _has_elements(values: object) -> bool:
    """Not a number, nor an array without dimensions."""
    return isinstance(values, Iterable) and getattr(values, "ndim", 1) > 0


def _channels(params: Iterable[Throughput]) -> list[Throughput]:
    if not _has_elements(params):
        raise Error(f"params = {checks.shown(params)} is not a list of Throughput")
    return [checks.instance(f"params[{i}]", each, Throughput) for i, each in enumerate(params)]


def _run_channels(
    batch: Any, params: list[Throughput], moves: np.ndarray, out: np.ndarray | None
) -> np.ndarray:
    out, count = arrays.out(out, moves), len(params)
    states = (State * count)()
    together = (_ThroughputParams * count)(*(each._params for each in params))
    batch(together, states, count, arrays.data(moves), arrays.data(out), len(moves))
    return out


def _state_of(F: float, Fc: float) -> State:  # noqa: N803
    """The state of torque F, clamped to +-Fc."""
    ratio = checks.finite("F", F, "N m") / Fc
    return State(round(max(-1.0, min(1.0, ratio)) * 2.0**62))


@checks.names_checked
def counts_between(before: int, now: int, modulus: int = 0) -> int:
    """Shortest signed way from one reading of a counter to the next (dahl_counts_between), in
    counts: -modulus/2 <= way < modulus/2, so that exactly half way round counts as backward.

    modulus is where the reading itself wraps, 0 for a full 32-bit counter: 65536 for a 16-bit
    timer, the counts of a turn for an absolute encoder. Whole numbers: modulus from 0 to 2^32-1,
    both readings from 0 to modulus-1. Raises dahl.Error for any other, so that a reading that does
    not wrap at modulus is not taken for one that does.
    """
    modulus = checks.whole("modulus", modulus, 0, UINT32_MAX)
    most = modulus - 1 if modulus else UINT32_MAX
    readings = (
        checks.whole(name, value, 0, most) for name, value in (("before", before), ("now", now))
    )
    moved: int = library().dahl_counts_between(*readings, modulus)
    return moved


@checks.names_checked
def to_units(ratio_q30: int, Fc_units: int) -> int:  # noqa: N803
    """A torque in whole units of your own (dahl_to_units), as a firmware without floats adds it up:
    ratio_q30 2^-30 Fc_units, rounded to the nearest, a half up.

    ratio_q30 is F/Fc in Q30 as step_counts_q30() returns it, from -2^31 to 2^31-1; Fc_units is Fc
    in that unit (uN m, counts of a drive's current), a whole number from 0 to 2^30. Raises
    dahl.Error for any other.
    """
    ratio_q30 = checks.whole("ratio_q30", ratio_q30, INT32_MIN, INT32_MAX)
    Fc_units = checks.whole("Fc_units", Fc_units, 0, 2**30)  # noqa: N806
    units: int = library().dahl_to_units(ratio_q30, Fc_units)
    return units


@checks.calls_checked
class Encoder(Copied):
    """dahl_encoder_t: from the readings of a counter to the counts of each tick, wherever it wraps.

    modulus       of the reading: 65536 for a 16-bit timer, 0 for all 32 bits, the counts of a turn
                  for an absolute encoder; 0, or 3 .. 2^32-1
    sign          of the mounting: +1, or -1 where it counts down while the shaft turns forward
    largest_step  counts; a longer move is a jump (an index pulse, a spoiled reading) and no motion;
                  below half of the modulus, 0: no limit

    Comparable, picklable; a copy goes its own way. Raises dahl.Error naming the argument, its value
    and its limit.

    >>> timer = dahl.Encoder(modulus=65536)
    >>> timer.move(65535), timer.move(2)
    (0, 3)
    """

    def __init__(self, modulus: int = 0, sign: int = 1, largest_step: int = 0) -> None:
        modulus = checks.whole("modulus", modulus, 0, UINT32_MAX)
        if modulus in (1, 2):
            raise Error(f"modulus = {modulus} tells no direction; 0, or 3 to {UINT32_MAX} does")
        most = ((modulus or 2**32) - 1) // 2
        largest_step = checks.whole("largest_step", largest_step, 0, most)
        if checks.whole("sign", sign, -1, 1) == 0:
            raise Error("sign = 0 is neither 1 nor -1")
        self._encoder = _Encoder()
        library().dahl_encoder_init(ctypes.byref(self._encoder), modulus, int(sign), largest_step)

    def move(self, reading: int) -> int:
        """Counts since the last reading, the shortest way (exactly half of the modulus is taken as
        backward); 0 for the first one and for a jump. A reading is a whole number from 0 to
        modulus-1; dahl.Error for any other.
        """
        moved: int = library().dahl_encoder_move(
            ctypes.byref(self._encoder), self._checked(reading)
        )
        return moved

    def home(self, reading: int) -> None:
        """The counter was set to `reading`, in counts as in move(), without motion; the next move
        starts there. The same errors as move().
        """
        library().dahl_encoder_home(ctypes.byref(self._encoder), self._checked(reading))

    @property
    def jumps(self) -> int:
        """Moves refused since the beginning: longer than largest_step."""
        return int(self._encoder.jumps)

    def _checked(self, reading: int) -> int:
        modulus = self._encoder.modulus
        return checks.whole("reading", reading, 0, modulus - 1 if modulus else UINT32_MAX)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Encoder):
            return NotImplemented
        return bytes(self._encoder) == bytes(other._encoder)

    __hash__ = None  # type: ignore[assignment]  # it changes with each reading

    def __repr__(self) -> str:
        names = ("modulus", "sign", "largest_step")
        return f"Encoder({', '.join(f'{name}={getattr(self._encoder, name)}' for name in names)})"
