# SPDX-License-Identifier: MIT
"""The frames of a friction node, packed and unpacked by the C library: same names, units and bits
as dahl_frames.h, whose comments are the manual. Counter and CRC are those of AUTOSAR E2E profile 2.

>>> from dahl import codec
>>> data = codec.to_bytes(codec.EncoderState(count=-7, counter=3))
>>> data.hex()
'4f13f9ffffff0000'
>>> codec.from_bytes(0x100, data)
EncoderState(count=-7, counter=3, valid=True)

pack() and unpack() do the same with python-can's messages. All raise dahl.Error in one line: for a
value out of its range, another length, a wrong CRC, a frame that is none of a node's.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum, IntFlag
from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING, Any, ClassVar, TypeVar, overload

from dahl import dependencies
from dahl.binding import checks
from dahl.binding.checks import INT32_MAX, INT32_MIN, UINT32_MAX
from dahl.binding.library import c
from dahl.errors import Error, RunError

if TYPE_CHECKING:
    import can

__all__ = [
    "KINDS",
    "NODES",
    "OFF_AT_0",
    "ONE_Q30",
    "UNITS",
    "EncoderState",
    "Errors",
    "Frame",
    "FrictionTorque",
    "Param",
    "ParamReply",
    "ParamWrite",
    "Reset",
    "Result",
    "State",
    "Status",
    "What",
    "Write",
    "from_bytes",
    "is_whole",
    "pack",
    "to_bytes",
    "unpack",
]

NODES = 16  # DAHL_FRAMES_NODES: the number of a node is the low 4 bits of an id
ONE_Q30 = 2**30
EXTENDED, REMOTE, ERROR, FD = 1, 2, 4, 8  # DAHL_CAN_FRAME_*
STANDARD_MAX, EXTENDED_MAX = 0x7FF, 0x1FFFFFFF  # the highest ids of 11 and of 29 bits
BYTE, NIBBLE = (0, 255), (0, 15)
COUNTERS = 16  # a frame's counter runs 0 .. 15 and begins again
TIMEOUT_UNIT = 0.01  # s, DAHL_FRAMES_TIMEOUT_US

F = TypeVar("F", bound="Frame")


class State(IntEnum):
    """What a node thinks of its input (dahl_frames_state_t)."""

    OK = 0
    REPEATED = 1
    LOST = 2
    WRONG_SEQUENCE = 3
    CRC = 4
    STALE = 5
    INIT = 6


class Errors(IntFlag):
    """Sticky bits of Status, kept until a Reset."""

    FORMAT = 1
    REPEATED = 2
    LOST = 4
    WRONG_SEQUENCE = 8
    CRC = 16
    STALE = 32
    INVALID = 64
    JUMP = 128


class Param(IntEnum):
    """Parameters of a node, by number (dahl_frames_param_t); UNITS has the unit of each."""

    SIGMA0 = 0
    FC = 1
    THETA = 2
    GAIN = 3
    LIMIT = 4
    RAMP = 5
    TIMEOUT = 6
    STEP = 7
    STATUS = 8
    MODEL = 9
    LOAD = 10
    NONE = 255


OFF_AT_0 = (Param.STEP, Param.STATUS)  # 0: a move of any length; no Status but after an event
UNITS: dict[int, float] = {  # of one raw step
    Param.SIGMA0: 2.0**-10,  # N m/rad
    Param.FC: 2.0**-20,  # N m
    Param.THETA: 2.0**-38,  # rad per count
    Param.GAIN: 2.0**-16,  # part of the torque
    Param.LIMIT: 2.0**-16,  # part of Fc
    Param.RAMP: 1e-3,  # s
    Param.TIMEOUT: 1e-3,  # s
    Param.STEP: 1.0,  # counts per ms
    Param.STATUS: 1e-3,  # s
    Param.MODEL: 1.0,
    Param.LOAD: 2.0**-16,  # part of the load at which Fc holds
    Param.NONE: 1.0,
}


class Write(IntEnum):
    """What a ParamWrite asks."""

    READ = 0
    WRITE = 1
    HOLD = 2


class Result(IntEnum):
    """What became of a ParamWrite."""

    DONE = 0
    OUT_OF_RANGE = 1
    UNKNOWN = 2


class What(IntEnum):
    """What a Reset clears: the errors and counts of Status, or all but the parameters."""

    ERRORS = 1
    RESTART = 2


class Frame:
    """What all frames have in common. Immutable, comparable, picklable."""

    base: ClassVar[int]  # id of node 0
    _calls: ClassVar[str]  # dahl_frames_pack_.., dahl_frames_unpack_..
    _structure: ClassVar[str]  # of C
    _kind: ClassVar[int]  # high half of the data id
    _limits: ClassVar[dict[str, Any]]  # of each field: (least, most), or an enumeration

    def __post_init__(self) -> None:
        for name, limit in self._limits.items():
            object.__setattr__(self, name, _checked(name, getattr(self, name), limit))


def _checked(name: str, value: object, limit: Any) -> Any:
    """A field as it is kept: in its range, a named number by its name."""
    if isinstance(limit, tuple):
        return checks.whole(name, value, *limit)
    if limit is bool:
        return bool(checks.whole(name, int(value) if isinstance(value, bool) else value, 0, 1))
    number = checks.whole(name, value, 0, 255)
    if limit is Param and number not in UNITS:  # a node is asked for any, and says that it is none
        return number
    try:
        return limit(number)
    except ValueError:
        known = ", ".join(f"{one.value} {one.name}" for one in limit)
        raise Error(f"{name} = {number} is none of {known}") from None


@checks.calls_checked
@dataclass(frozen=True)
class EncoderState(Frame):
    """Encoder to node, every ms.

    count    absolute, in counts, -2^31 .. 2^31-1; wraps
    counter  0 .. 15, one more with each frame
    valid    False: the encoder does not stand by this count
    """

    count: int
    counter: int = 0
    valid: bool = True

    base = 0x100
    _calls, _kind, _structure = "encoder", 0x3, "dahl_encoder_state_t"
    _limits: ClassVar[dict[str, Any]] = {
        "count": (INT32_MIN, INT32_MAX),
        "counter": NIBBLE,
        "valid": bool,
    }


@checks.calls_checked
@dataclass(frozen=True)
class FrictionTorque(Frame):
    """The node's answer to an EncoderState.

    torque_q30  F/Fc in Q30, -2^30 .. 2^30; `ratio` is the same as a float
    counter     0 .. 15, one more with each answer
    state       of the node
    echo        counter of the EncoderState answered
    """

    torque_q30: int
    counter: int = 0
    state: State = State.OK
    echo: int = 0

    base = 0x110
    _calls, _kind, _structure = "torque", 0xC, "dahl_friction_torque_t"
    _limits: ClassVar[dict[str, Any]] = {
        "torque_q30": (-ONE_Q30, ONE_Q30),
        "counter": NIBBLE,
        "state": State,
        "echo": NIBBLE,
    }

    @property
    def ratio(self) -> float:
        """F/Fc, -1 .. 1, exactly."""
        return self.torque_q30 / ONE_Q30


@checks.calls_checked
@dataclass(frozen=True)
class Status(Frame):
    """Health of the node, every 100 ms or as Param.STATUS sets; at once after power-on, a timeout,
    a bus-off and a Reset.

    counter        0 .. 15, one more with each Status
    state, errors  of the node now, and since the last Reset
    lost, corrupt, out_of_step   frames since the last Reset, modulo 256
    version_major, version_minor of the firmware, 0 .. 15
    timeout        of the node in steps of 10 ms, rounded up; 255: so long or longer
    """

    counter: int
    state: State
    errors: Errors
    lost: int
    corrupt: int
    out_of_step: int
    version_major: int
    version_minor: int
    timeout: int

    base = 0x120
    _calls, _kind, _structure = "status", 0x5, "dahl_node_status_t"
    _limits: ClassVar[dict[str, Any]] = {
        "counter": NIBBLE,
        "state": State,
        "errors": Errors,
        "lost": BYTE,
        "corrupt": BYTE,
        "out_of_step": BYTE,
        "version_major": NIBBLE,
        "version_minor": NIBBLE,
        "timeout": BYTE,
    }

    @property
    def timeout_s(self) -> float:
        """The timeout in s."""
        return self.timeout * TIMEOUT_UNIT


_VALUED: dict[str, Any] = {"param": Param, "value": (0, UINT32_MAX), "counter": NIBBLE}


class _Valued(Frame):
    """A frame with a parameter's value."""

    param: int
    value: int

    @property
    def si(self) -> float:
        """The value in the unit of its parameter: N m/rad, N m, rad per count, s, or a part."""
        return self.value * UNITS.get(self.param, 1.0)


@checks.calls_checked
@dataclass(frozen=True)
class ParamWrite(_Valued):
    """Anybody to node: set or read one parameter.

    param    which one
    value    raw, 0 .. 2^32-1, in steps of UNITS[param]; of_si() takes it in SI units
    write    READ, WRITE, or HOLD for the next WRITE
    counter  0 .. 15; the reply repeats it
    """

    param: int
    value: int = 0
    write: Write = Write.READ
    counter: int = 0

    base = 0x130
    _calls, _kind, _structure = "param_write", 0x6, "dahl_param_write_t"
    _limits: ClassVar[dict[str, Any]] = _VALUED | {"write": Write}

    @staticmethod
    def of_si(
        param: Param, value: float, write: Write = Write.WRITE, counter: int = 0
    ) -> ParamWrite:
        """A value in N m/rad, N m, rad per count, s, or a part, to the nearest step."""
        known = _checked("param", param, Param)
        unit = UNITS.get(known, 1.0)
        steps = checks.finite("value", value, "the parameter's unit") / unit
        shown = f"value = {value:g} of parameter {getattr(known, 'name', known)}"
        if not 0 <= steps <= UINT32_MAX:
            raise Error(f"{shown} is outside 0 .. {UINT32_MAX * unit:g}")
        if known in OFF_AT_0 and steps and not round(steps):
            raise Error(f"{shown} is less than half a step of {unit:g}: 0 would switch it off")
        return ParamWrite(known, round(steps), write, counter)


@checks.calls_checked
@dataclass(frozen=True)
class ParamReply(_Valued):
    """The node's answer to a ParamWrite.

    param    the same, or NONE where there is no such parameter; the value is then its number
    value    raw, as it holds now, in steps of UNITS[param]
    result   what became of it
    counter  of the ParamWrite answered
    """

    param: int
    value: int
    result: Result = Result.DONE
    counter: int = 0

    base = 0x140
    _calls, _kind, _structure = "param_reply", 0x9, "dahl_param_reply_t"
    _limits: ClassVar[dict[str, Any]] = _VALUED | {"result": Result}


@checks.calls_checked
@dataclass(frozen=True)
class Reset(Frame):
    """Anybody to node: clear the errors, or start anew; answered by Status.

    what     ERRORS or RESTART
    counter  0 .. 15
    """

    what: What
    counter: int = 0

    base = 0x150
    _calls, _kind, _structure = "reset", 0xA, "dahl_node_reset_t"
    _limits: ClassVar[dict[str, Any]] = {"what": What, "counter": NIBBLE}


KINDS: dict[int, type[Frame]] = {
    kind.base: kind
    for kind in (EncoderState, FrictionTorque, Status, ParamWrite, ParamReply, Reset)
}


@checks.names_checked
def to_bytes(frame: Frame) -> bytes:
    """The 8 bytes of a frame, CRC and counter included."""
    return _packed(frame, 0).data()


@checks.names_checked
def from_bytes(identifier: int, data: bytes | bytearray) -> Frame:
    """The frame of an 11-bit id and its bytes. Raises dahl.Error unless it is whole."""
    identifier = checks.whole("identifier", identifier, 0, STANDARD_MAX)
    if not isinstance(data, (bytes, bytearray)):
        raise Error(f"data = {checks.shown(data)} is neither bytes nor a bytearray")
    if len(data) != 8:
        raise Error(f"{_named(identifier)}: {len(data)} bytes, 8 were expected")
    raw = RawFrame()
    raw.c.id, raw.c.length, raw.c.data = identifier, 8, list(data)
    return _unpacked(raw)


@checks.names_checked
def pack(frame: Frame, node: int = 0) -> can.Message:
    """A message of python-can, of the node's id."""
    return _packed(frame, number_of(node)).message()


def number_of(node: int, name: str = "node") -> int:
    """The number of a node, 0 .. 15. Raises dahl.Error."""
    return checks.whole(name, node, 0, NODES - 1)


@overload
def unpack(message: can.Message) -> Frame: ...
@overload
def unpack(message: can.Message, kind: type[F]) -> F: ...
@checks.names_checked
def unpack(message: can.Message, kind: type[Frame] = Frame) -> Frame:
    """The frame in a message of python-can, whose node is arbitration_id & 15. Raises dahl.Error
    unless it is a whole one, and of this kind where one is given, such as FrictionTorque.
    """
    raw = RawFrame()
    raw.read(message)
    identifier, flags = raw.c.id, raw.c.flags
    if flags:
        names = ("an extended id", "a remote frame", "an error frame", "a CAN FD frame")
        what = next(name for bit, name in enumerate(names) if flags & 1 << bit)
        raise Error(f"{_named(identifier)}: {what}; a classic data frame was expected")
    if not any(kind is known for known in (Frame, *KINDS.values())):
        raise Error(f"kind = {checks.shown(kind)} is no kind of frame, such as FrictionTorque")
    frame = from_bytes(identifier, bytes(message.data[: max(message.dlc, 0)]))
    if not isinstance(frame, kind):
        raise Error(f"{_named(identifier)}: {kind.__name__} was expected")
    return frame


def python_can() -> ModuleType:
    """The package `can`. Raises dahl.RunError if it is missing."""
    try:
        return import_module("can")
    except ImportError:
        raise RunError(f"python-can is missing; {dependencies.hint(['can'], 'can')}") from None


class RawFrame:
    """A dahl_can_frame_t, and the way from and to messages of python-can. Quick: once a tick."""

    def __init__(self) -> None:
        self.c = c.new("dahl_can_frame_t *")
        self._data = c.buffer(self.c.data)
        self._make: Any = None  # can.Message, imported with the first

    def read(self, message: can.Message) -> None:
        """Copy a message of python-can: of CAN FD the first 8 bytes. Raises dahl.Error."""
        try:
            identifier, data, length = message.arbitration_id, message.data, message.dlc
        except AttributeError:
            raise Error(f"message = {checks.shown(message)} is not a can.Message") from None
        if type(identifier) is not int or not 0 <= identifier <= EXTENDED_MAX:
            identifier = checks.whole("arbitration_id", identifier, 0, EXTENDED_MAX)
        if type(data) is not bytearray or length != 8 or len(data) != 8:
            length, data = min(length, 8) & 0xFF, bytes(data[:8]).ljust(8, b"\0")
        raw = self.c
        raw.id, raw.flags, raw.length, self._data[:] = identifier, _flags(message), length, data

    def data(self) -> bytes:
        """All 8 bytes."""
        return self._data[:]  # type: ignore[no-any-return]

    def message(self) -> can.Message:
        """The message of python-can for a frame that a node made."""
        if self._make is None:
            self._make = python_can().Message
        message: can.Message = self._make(
            arbitration_id=self.c.id, data=self._data[:], is_extended_id=False, is_rx=False
        )
        return message


def _flags(message: can.Message) -> int:
    flags = EXTENDED if message.is_extended_id else 0
    if message.is_remote_frame or message.is_error_frame or message.is_fd:
        flags |= REMOTE * message.is_remote_frame | ERROR * message.is_error_frame
        flags |= FD * message.is_fd
    return flags


def is_whole(identifier: int, data: bytes | bytearray) -> bool:
    """True for 8 bytes of one of a node's frames, with the CRC that they need."""
    kind = KINDS.get(identifier & ~15)
    return kind is not None and len(data) == 8 and _crc(data, kind) == data[0]


def _crc(data: bytes | bytearray, kind: type[Frame]) -> int:
    return int(c.dahl_frames_crc(bytes(data), kind._kind))


def _named(identifier: int) -> str:
    kind = KINDS.get(identifier & ~15)
    return f"{kind.__name__} {identifier:#05x}" if kind else f"id {identifier:#05x}"


def _packed(frame: Frame, node: int) -> RawFrame:
    if not isinstance(frame, Frame):
        raise Error(f"frame = {checks.shown(frame)} is none of a node's frames")
    values = {name: int(getattr(frame, name)) for name in frame._limits}
    raw, call = RawFrame(), f"dahl_frames_pack_{frame._calls}"
    getattr(c, call)(raw.c, node, c.new(f"{frame._structure} *", values))
    return raw


def _unpacked(raw: RawFrame) -> Frame:
    identifier, data = raw.c.id, raw.data()
    kind = KINDS.get(identifier & ~15)
    if kind is None:
        raise Error(f"{_named(identifier)}: no frame of a node; those have ids 0x100 to 0x15f")
    values = c.new(f"{kind._structure} *")
    if getattr(c, f"dahl_frames_unpack_{kind._calls}")(raw.c, values) != 0:
        due = _crc(data, kind)
        raise Error(f"{_named(identifier)}: CRC {data[0]:#04x}, {due:#04x} was expected")
    try:
        return kind(**{name: getattr(values, name) for name in kind._limits})
    except Error as error:
        raise Error(f"{_named(identifier)}: {error}") from None
