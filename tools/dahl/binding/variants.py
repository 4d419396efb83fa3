# SPDX-License-Identifier: MIT
"""Variants of Dahl's element, by the C library: friction that differs with the direction, follows a
load, does not creep, adds up its work, or depends on speed. Same names, units and bits as
dahl_parts.h, whose comments are the manual.
"""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dahl.binding import arrays, checks, core
from dahl.binding.copies import Copied
from dahl.binding.parts import Element
from dahl.errors import Error

PLAN_ROOM = 128  # 8-byte words kept for any plan of dahl_parts.h (54 are used at most)
VELOCITY_SEGMENTS = 16  # DAHL_VELOCITY_SEGMENTS: torques of a table over speed
SEGMENT_BITS_MAX = 24
LOAD_ONE = 2**30  # a load of 1, as C has it


def _shown(value: float) -> str:
    """The digits that make this float again."""
    return str(np.float32(value))


@checks.calls_checked
class _Bristle(Element, Copied):
    """An element of parameters, each a float as C has it, and of one bristle's state. dahl_KIND_..
    are its calls.
    """

    _kind: ClassVar[str]
    _limits: ClassVar[dict[str, str]]  # of each parameter, in the order of __init__

    def _make(self, *values: float) -> None:
        self._values = tuple(
            core.parameter(name, value, limit)
            for (name, limit), value in zip(self._limits.items(), values, strict=True)
        )
        self._state = core.State()
        self._prepare()

    def _prepare(self) -> None:
        self._words = (ctypes.c_uint64 * PLAN_ROOM)()
        if self._prepare_words() != 0:
            raise Error(self._refusal())

    def _prepare_words(self) -> int:
        raise NotImplementedError

    def _refusal(self) -> str:
        raise NotImplementedError

    @property
    def state(self) -> core.State:
        """The state, live: a whole number, 0 is relaxed, +-2^62 is +-Fc (the larger Fc)."""
        return self._state

    def step_counts_q30(self, dcounts: int) -> int:
        """The same move, the same errors; returns F over Fc (over the larger Fc) in Q30."""
        moved = checks.whole("dcounts", dcounts, arrays.INT32_MIN, arrays.INT32_MAX)
        call = getattr(core.library(), f"dahl_{self._kind}_step_counts_q30")
        ratio: int = call(self._words, ctypes.byref(self._state), moved)
        return ratio

    def _step(self, dcounts: int) -> float:
        call = getattr(core.library(), f"dahl_{self._kind}_step_counts")
        torque: float = call(self._words, ctypes.byref(self._state), dcounts)
        return torque

    def _batch(self, moves: np.ndarray, out: np.ndarray) -> None:
        call = getattr(core.library(), f"dahl_batch_{self._kind}_counts")
        state = ctypes.byref(self._state)
        call(self._words, state, arrays.data(moves), arrays.data(out), moves.size)

    def __eq__(self, other: object) -> bool:
        if type(other) is not type(self):
            return NotImplemented
        return (self._values, self._state) == (other._values, other._state)

    __hash__ = None  # type: ignore[assignment]  # it changes with each step

    def __repr__(self) -> str:
        named = zip(self._limits, self._values, strict=True)
        return f"{type(self).__name__}({', '.join(f'{n}={_shown(v)}' for n, v in named)})"


@checks.calls_checked
class Asymmetric(_Bristle):
    """Friction with an Fc of each direction its own (dahl_asymmetric_plan_t), relaxed at first:
    dF/dtheta = sigma0 (1 - F/Fc_forward) forward, sigma0 (1 + F/Fc_backward) backward. Passive over
    every closed cycle, within rounding.

    sigma0           N m/rad  stiffness at F = 0, both ways, range as in Plan
    Fc_forward       N m      F after a long way forward, range of Fc in Plan
    Fc_backward      N m      -F after a long way backward, the same range
    theta_per_count  rad      per encoder count; sigma0/Fc*theta_per_count in the range of Plan for
                              either Fc

    Torques are within 0.55 ulp of the larger Fc. A step costs about 1 us from Python, a tick in
    run_counts() about 10 ns. Two are equal where parameters and state are; picklable; a copy has a
    state of its own. Raises dahl.Error naming the parameter, its value and its limit.

    >>> seal = dahl.Asymmetric(sigma0=100.0, Fc_forward=0.5, Fc_backward=0.25, theta_per_count=1e-3)
    >>> seal.step_counts(10**6), seal.step_counts(-(10**6))
    (0.5, -0.25)
    """

    _kind = "asymmetric"
    _limits: ClassVar[dict[str, str]] = {
        "sigma0": core.SIGMA0,
        "Fc_forward": core.FC.replace("Fc", "Fc_forward"),
        "Fc_backward": core.FC.replace("Fc", "Fc_backward"),
        "theta_per_count": core.COUNTED,
    }

    def __init__(
        self,
        sigma0: float,
        Fc_forward: float,  # noqa: N803 (the field's name)
        Fc_backward: float,  # noqa: N803
        theta_per_count: float,
    ) -> None:
        self._make(sigma0, Fc_forward, Fc_backward, theta_per_count)

    def _prepare_words(self) -> int:
        params = (ctypes.c_float * 4)(*self._values)
        return int(core.library().dahl_asymmetric_prepare(self._words, params))

    def _refusal(self) -> str:
        core.need_counted(self.theta_per_count)
        for name, value in (("Fc_forward", self.Fc_forward), ("Fc_backward", self.Fc_backward)):
            try:
                core.Plan(self.sigma0, value, self.theta_per_count)
            except Error as error:
                return str(error).replace("Fc", name)
        return f"{self!r} is refused by dahl_asymmetric_prepare"

    @property
    def sigma0(self) -> float:
        """N m/rad"""
        return self._values[0]

    @property
    def Fc_forward(self) -> float:  # noqa: N802
        """N m"""
        return self._values[1]

    @property
    def Fc_backward(self) -> float:  # noqa: N802
        """N m"""
        return self._values[2]

    @property
    def theta_per_count(self) -> float:
        """rad/count"""
        return self._values[3]


@checks.calls_checked
class ElastoPlastic(_Bristle):
    """Elasto-plastic friction (Dupont 2002; over space as in Hayward 2009;
    dahl_elastoplastic_plan_t), with its state, relaxed at first: a spring up to F = breakaway*Fc in
    the direction of motion, which creeps by nothing however often it goes to and fro, and then
    Dahl's curve, without a corner.

    sigma0           N m/rad  stiffness of the spring, range as in Plan
    Fc               N m      Coulomb torque, range as in Plan
    theta_per_count  rad      per encoder count, range as in Plan, not 0
    breakaway        part of Fc at which it begins to slide, 0 < breakaway < 1

    Torques are within 0.55 ulp of Fc. A step costs about 1 us from Python, a tick in run_counts()
    about 10 ns. Two are equal where parameters and state are; picklable; a copy has a state of its
    own. Raises dahl.Error naming the parameter, its value and its limit.

    >>> bearing = dahl.ElastoPlastic(sigma0=128.0, Fc=0.5, theta_per_count=2**-13, breakaway=0.7)
    >>> bearing.step_counts(16), bearing.step_counts(-16)
    (0.25, 0.0)
    """

    _kind = "elastoplastic"
    _limits: ClassVar[dict[str, str]] = {
        "sigma0": core.SIGMA0,
        "Fc": core.FC,
        "theta_per_count": core.COUNTED,
        "breakaway": "0 < breakaway < 1 (part of Fc)",
    }

    def __init__(
        self,
        sigma0: float,
        Fc: float,  # noqa: N803 (the field's name)
        theta_per_count: float,
        breakaway: float,
    ) -> None:
        self._make(sigma0, Fc, theta_per_count, breakaway)

    def _prepare_words(self) -> int:
        params = (ctypes.c_float * 3)(*self._values[:3])
        return int(core.library().dahl_elastoplastic_prepare(self._words, params, self._values[3]))

    def _refusal(self) -> str:
        core.need_counted(self.theta_per_count)
        core.Plan(*self._values[:3])
        return f"breakaway = {_shown(self.breakaway)} is outside {self._limits['breakaway']}"

    @property
    def sigma0(self) -> float:
        """N m/rad"""
        return self._values[0]

    @property
    def Fc(self) -> float:  # noqa: N802
        """N m"""
        return self._values[1]

    @property
    def theta_per_count(self) -> float:
        """rad/count"""
        return self._values[2]

    @property
    def breakaway(self) -> float:
        """Part of Fc."""
        return self._values[3]


class _LoadedState(ctypes.Structure):
    _fields_ = [("w", ctypes.c_int64), ("load_q30", ctypes.c_uint32)]


@checks.calls_checked
class Loaded(Copied):
    """A bearing of a Plan whose Fc follows a load, given with each tick: normal force, torque
    through a gear, preload, temperature. By default sigma0 follows it too (dahl_loaded_state_t):
    where the load falls F falls with it, where it grows F is kept. With fixed_stiffness sigma0
    stays (dahl_clamped_step): a load that falls cuts F off at load*Fc, one that grows leaves it,
    and ticks are by angle. By either rule no closed cycle of motion and load gives energy.

    plan             of the bearing at a load of 1
    load             0 <= load < 2, rounded to 2^-30; at 1 the torques have the bits of
                     Friction(plan)
    fixed_stiffness  True: step() and run(), in rad; False: step_counts() and the like, in counts

    Torques are within 0.55 ulp of load*Fc, -load*Fc .. load*Fc; with fixed_stiffness within 0.6 ulp
    of Fc, or of load*Fc where that is more. A step costs about 1 us from Python, and so does a tick
    in run(); a tick in run_counts() about 20 ns. Relaxed and without load at first. Two are equal
    where plan, rule and state are; picklable; a copy has a state of its own. Raises dahl.Error for
    anything that is no Plan or no rule, for a plan without theta_per_count where counts are wanted,
    and for a move of the other rule's kind.

    >>> gear = dahl.Loaded(dahl.Plan(100.0, 0.5, 1e-3))
    >>> gear.step_counts(10**6, load=1.5), gear.step_counts(0, load=0.5)
    (0.75, 0.25)
    >>> seat = dahl.Loaded(dahl.Plan(100.0, 0.5), fixed_stiffness=True)
    >>> seat.step(1e6, load=0.5), seat.step(0.0, load=1.5)
    (0.25, 0.25)
    """

    def __init__(self, plan: core.Plan, fixed_stiffness: bool = False) -> None:
        self._plan = checks.instance("plan", plan, core.Plan)
        self._fixed_stiffness = checks.instance("fixed_stiffness", fixed_stiffness, bool)
        if not fixed_stiffness:
            self._plan._need_counts()
        self._state = _LoadedState()

    @property
    def plan(self) -> core.Plan:
        """The parameters at a load of 1."""
        return self._plan

    @property
    def fixed_stiffness(self) -> bool:
        """Whether sigma0 stays when the load changes; moves are then in rad."""
        return self._fixed_stiffness

    @property
    def load(self) -> float:
        """Of the last tick; 0 at first."""
        return float(self._state.load_q30 / LOAD_ONE)

    @property
    def torque(self) -> float:
        """F in N m at the last load, without motion."""
        step = self._clamped if self._fixed_stiffness else self._step
        return step(0, self._state.load_q30)

    def step_counts(self, dcounts: int, load: float) -> float:
        """Take the load, then move by dcounts, a whole number within int32; returns F in N m.
        Raises dahl.Error for any other dcounts, for a load outside 0 <= load < 2, and with
        fixed_stiffness.
        """
        self._need_rule(False, "step_counts")
        return self._step(_moved(dcounts), _load_q30(load))

    def step(self, dtheta: float, load: float) -> float:
        """Take the load, then move by dtheta rad, with fixed_stiffness; returns F in N m. As in C,
        NaN is no motion and an infinite angle saturates at +-load*Fc. Raises dahl.Error for what is
        no number, for a load outside 0 <= load < 2, and without fixed_stiffness.
        """
        self._need_rule(True, "step")
        angle = checks.real("dtheta", dtheta, "an angle in rad")
        return self._clamped(angle, _load_q30(load))

    def run(
        self, moves: ArrayLike, loads: ArrayLike, out: NDArray[np.float32] | None = None
    ) -> NDArray[np.float32]:
        """Moves in rad and a load for each, both of shape (n,), with fixed_stiffness -> torques in
        N m after each, shape (n,), float32, into `out` if given: the bits of step(), move by move.
        Raises dahl.Error, before any move, as Friction.run() does, for the first load outside
        0 <= load < 2, and without fixed_stiffness.
        """
        self._need_rule(True, "run")
        array = arrays.moves(moves, np.float32)
        given, result = arrays.loads(loads, array), arrays.out(out, array)
        for k, (angle, load) in enumerate(zip(array.tolist(), given.tolist(), strict=True)):
            result[k] = self._clamped(angle, load)
        return result

    def step_counts_q30(self, dcounts: int, load: float) -> int:
        """The same move, the same errors; returns F/Fc in Q30, -2^31 .. 2^31: beyond 2^30 at a load
        above 1.
        """
        self._need_rule(False, "step_counts_q30")
        moved, load_q30 = _moved(dcounts), _load_q30(load)
        call, state = core.library().dahl_loaded_step_counts_q30, ctypes.byref(self._state)
        ratio: int = call(self._plan._words, state, moved, load_q30)
        return ratio

    def run_counts(
        self, moves: ArrayLike, loads: ArrayLike, out: NDArray[np.float32] | None = None
    ) -> NDArray[np.float32]:
        """Moves in counts and a load for each, both of shape (n,) -> torques in N m after each,
        shape (n,), float32, into `out` if given: the bits of step_counts(), move by move. Raises
        dahl.Error, before any move, as Friction.run_counts() does, and for the first load outside
        0 <= load < 2.
        """
        self._need_rule(False, "run_counts")
        array = arrays.moves(moves, np.int32)
        given, result = arrays.loads(loads, array), arrays.out(out, array)
        core.library().dahl_batch_loaded_counts(
            self._plan._words,
            ctypes.byref(self._state),
            *map(arrays.data, (array, given, result)),
            array.size,
        )
        return result

    def _step(self, dcounts: int, load_q30: int) -> float:
        call, state = core.library().dahl_loaded_step_counts, ctypes.byref(self._state)
        torque: float = call(self._plan._words, state, dcounts, load_q30)
        return torque

    def _clamped(self, dtheta: float, load_q30: int) -> float:
        """The rule of fixed_stiffness, whose state in C has no load: F/Fc in Q62 alone."""
        self._state.load_q30 = load_q30
        torque: float = core.library().dahl_clamped_step(
            self._plan._words, ctypes.byref(self._state), dtheta, load_q30
        )
        return torque

    def _need_rule(self, fixed: bool, call: str) -> None:
        if self._fixed_stiffness != fixed:
            there = "step(), run()" if self._fixed_stiffness else "step_counts(), run_counts()"
            raise Error(
                f"Loaded.{call}: fixed_stiffness = {self._fixed_stiffness} moves by {there}"
            )

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Loaded):
            return NotImplemented
        return self._compared() == other._compared()

    def _compared(self) -> tuple[core.Plan, bool, int, int]:
        return self._plan, self._fixed_stiffness, self._state.w, self._state.load_q30

    __hash__ = None  # type: ignore[assignment]  # it changes with each step

    def __repr__(self) -> str:
        rule = ", fixed_stiffness=True" if self._fixed_stiffness else ""
        return f"Loaded({self._plan!r}{rule})"


def _moved(dcounts: int) -> int:
    return checks.whole("dcounts", dcounts, arrays.INT32_MIN, arrays.INT32_MAX)


def _load_q30(load: float) -> int:
    number = checks.real("load", load, "0 <= load < 2")
    if not 0 <= number < 2:
        raise Error(f"load = {number!r} is outside 0 <= load < 2")
    return min(round(number * LOAD_ONE), 2 * LOAD_ONE - 1)


class _Sums(ctypes.Structure):
    _fields_ = [("counts", ctypes.c_uint32 * 3), ("way", ctypes.c_uint32 * 4)]


@checks.calls_checked
class Work(Element, Copied):
    """One bearing of a Plan that adds up what it takes (dahl_work_t): the torques of
    Friction(plan), bit for bit, and the work along the path in J, in whole numbers that do not
    overflow for 2^63 ticks.

    A step costs about 1 us from Python, a tick in run_counts() about 10 ns. Relaxed at first. Two
    are equal where plan, state and sums are; picklable; a copy goes its own way. Raises dahl.Error
    for anything that is no Plan, and for a plan without theta_per_count.

    >>> bearing = dahl.Work(dahl.Plan(100.0, 0.5, 1e-3))
    >>> torques = bearing.run_counts([10**6, -(10**6)])
    >>> round(bearing.work)  # 2000 rad at 0.5 N m, less the bends
    1000
    """

    def __init__(self, plan: core.Plan) -> None:
        self._plan = checks.instance("plan", plan, core.Plan)
        self._plan._need_counts()
        self._state, self._sums = core.State(), _Sums()

    @property
    def plan(self) -> core.Plan:
        """The parameters."""
        return self._plan

    @property
    def state(self) -> core.State:
        """The state, live: w = F/Fc in Q62. Work counts from the state at the start on."""
        return self._state

    @property
    def work(self) -> float:
        """J (N m rad) so far, the sum of F dtheta along the path: positive where the bearing took
        energy. Infinite beyond a float. Error: half an ulp of it, and for each reversal 2^-30 of
        Fc^2/sigma0.
        """
        plan = self._plan
        params = (ctypes.c_float * 3)(plan.sigma0, plan.Fc, plan.theta_per_count)
        joules: float = core.library().dahl_work(params, ctypes.byref(self._sums))
        return joules

    def _step(self, dcounts: int) -> float:
        torque: float = core.library().dahl_work_step_counts(
            self._plan._words, ctypes.byref(self._state), ctypes.byref(self._sums), dcounts
        )
        return torque

    def _batch(self, moves: np.ndarray, out: np.ndarray) -> None:
        core.library().dahl_batch_work_counts(
            self._plan._words,
            ctypes.byref(self._state),
            ctypes.byref(self._sums),
            arrays.data(moves),
            arrays.data(out),
            moves.size,
        )

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Work):
            return NotImplemented
        return self._compared() == other._compared()

    def _compared(self) -> tuple[core.Plan, int, bytes]:
        return self._plan, self._state.w, bytes(self._sums)

    __hash__ = None  # type: ignore[assignment]  # it changes with each step

    def __repr__(self) -> str:
        return f"<Work {self._plan!r}, torque={self.torque:g} N m, work={self.work:g} J>"


class _VelocityParams(ctypes.Structure):
    _fields_ = [
        ("segment_bits", ctypes.c_uint32),
        ("torque", ctypes.c_float * VELOCITY_SEGMENTS),
    ]


TORQUES = "0, or 2^-64 <= |torque| < 2^64 (N m)"


@checks.calls_checked
class VelocityTable(Copied):
    """Friction that depends on speed (viscous, Stribeck; dahl_velocity_plan_t), beside what depends
    on the path: an odd table over the counts of one tick, linear in between, the last value beyond.
    Add its torques to those of a part.

    torque        N m  16 of them: torque[k] at (k + 1) 2^segment_bits counts a tick forward, its
                       negative backward; each 0, or 2^-64 <= |torque| < 2^64
    segment_bits       0 .. 24

    Torques are within 1.5 2^-30 of the largest one of the straight lines, rounded once. About 1 us
    a step from Python, 5 ns a tick in run_counts(). Immutable; equal where torques and segment_bits
    are; picklable. Raises dahl.Error naming the argument, its value and its limit.

    >>> viscous = dahl.VelocityTable(torque=[0.01 * (k + 1) for k in range(16)], segment_bits=2)
    >>> viscous.step_counts(-8), viscous.step_counts(0)
    (-0.019999999552965164, 0.0)
    """

    def __init__(self, torque: Sequence[float], segment_bits: int) -> None:
        if not arrays.is_list(torque):
            raise Error(f"torque = {checks.shown(torque)} is not a list of numbers")
        if len(torque) != VELOCITY_SEGMENTS:
            raise Error(f"torque has {len(torque)} values; {VELOCITY_SEGMENTS} were expected")
        self._torque = tuple(
            core.parameter(f"torque[{k}]", value, TORQUES) for k, value in enumerate(torque)
        )
        self._segment_bits = checks.whole("segment_bits", segment_bits, 0, SEGMENT_BITS_MAX)
        self._prepare()

    def _prepare(self) -> None:
        self._words = (ctypes.c_uint64 * PLAN_ROOM)()
        params = _VelocityParams(self._segment_bits)
        params.torque[:] = self._torque
        if core.library().dahl_velocity_prepare(self._words, ctypes.byref(params)) != 0:
            for k, value in enumerate(self._torque):
                if value != 0 and not core.TORQUE_MIN <= abs(value) < core.TORQUE_MAX:
                    raise Error(f"torque[{k}] = {_shown(value)} is outside {TORQUES}")
            raise Error(f"{self!r} is refused by dahl_velocity_prepare")

    @property
    def torque(self) -> tuple[float, ...]:
        """N m, at (k + 1) 2^segment_bits counts a tick."""
        return self._torque

    @property
    def segment_bits(self) -> int:
        """2^segment_bits counts a tick from one value to the next."""
        return self._segment_bits

    def step_counts(self, dcounts: int) -> float:
        """The torque in N m of a tick that moves by dcounts, a whole number within int32. Nothing
        is kept. Raises dahl.Error for any other dcounts.
        """
        torque: float = core.library().dahl_velocity_torque(self._words, _moved(dcounts))
        return torque

    def run_counts(
        self, moves: ArrayLike, out: NDArray[np.float32] | None = None
    ) -> NDArray[np.float32]:
        """Moves in counts of each tick, shape (n,), whole numbers within int32 -> torques in N m,
        shape (n,), float32, into `out` if given: the bits of step_counts(). Raises dahl.Error as
        Friction.run_counts() does.
        """
        array = arrays.moves(moves, np.int32)
        result = arrays.out(out, array)
        core.library().dahl_batch_velocity(
            self._words, arrays.data(array), arrays.data(result), array.size
        )
        return result

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, VelocityTable):
            return NotImplemented
        return (self._torque, self._segment_bits) == (other._torque, other._segment_bits)

    def __hash__(self) -> int:
        return hash((self._torque, self._segment_bits))

    def __repr__(self) -> str:
        torques = ", ".join(map(_shown, self._torque))
        return f"VelocityTable(torque=[{torques}], segment_bits={self._segment_bits})"
