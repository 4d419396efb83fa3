# SPDX-License-Identifier: MIT
"""Pack and unpack the frames of a friction node (dahl.dbc), in the C library.

>>> from dahl import codec
>>> data = codec.to_bytes(codec.EncoderState(count=-7, counter=3))
>>> data.hex()
'4f13f9ffffff0000'
>>> codec.from_bytes(0x100, data)
EncoderState(count=-7, counter=3, valid=True)

pack() and unpack() do the same with python-can's messages. All raise dahl.Error for a value out of
its range, another length, a wrong CRC, or an id that no frame of a node has.
"""

from __future__ import annotations

from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING, Any, TypeVar, overload

from dahl import dependencies
from dahl.binding import checks
from dahl.binding.checks import ONE_Q30
from dahl.binding.library import c
from dahl.can.frame import Frame
from dahl.can.frames import (
    KINDS,
    OFF_AT_0,
    UNITS,
    EncoderState,
    Errors,
    FrictionTorque,
    Param,
    ParamReply,
    ParamWrite,
    Reset,
    Result,
    State,
    Status,
    What,
    Write,
)
from dahl.errors import Error, InputError, RunError, hide

if TYPE_CHECKING:
    import can

__tracebackhide__ = hide
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
EXTENDED, REMOTE, ERROR, FD = 1, 2, 4, 8  # DAHL_CAN_FRAME_*
STANDARD_MAX, EXTENDED_MAX = 0x7FF, 0x1FFFFFFF  # the highest ids of 11 and of 29 bits
COUNTERS = 16  # a frame's counter runs 0 .. 15 and begins again

F = TypeVar("F", bound="Frame")


def to_bytes(frame: Frame) -> bytes:
    """Return the 8 bytes of a frame, with CRC and counter."""
    return _pack_raw(frame, 0).data()


def from_bytes(identifier: int, data: bytes | bytearray) -> Frame:
    """Return the frame of an 11-bit id and 8 bytes."""
    identifier = checks.whole("identifier", identifier, 0, STANDARD_MAX)
    if not isinstance(data, (bytes, bytearray)):
        raise TypeError(f"data = {checks.shown(data)} is neither bytes nor a bytearray")
    if len(data) != 8:
        raise InputError(f"{_name_of(identifier)}: {len(data)} bytes, 8 were expected")
    raw = RawFrame()
    raw.c.id, raw.c.length, raw.c.data = identifier, 8, list(data)
    return _unpack_raw(raw)


def pack(frame: Frame, node: int = 0) -> can.Message:
    """Return a message of python-can with the id of a node, 0 .. 15."""
    return _pack_raw(frame, number_of(node)).message()


def number_of(node: int, name: str = "node") -> int:
    """Return the number of a node. Raises dahl.Error unless it is 0 .. 15."""
    return checks.whole(name, node, 0, NODES - 1)


@overload
def unpack(message: can.Message) -> Frame: ...
@overload
def unpack(message: can.Message, kind: type[F]) -> F: ...
def unpack(message: can.Message, kind: type[Frame] = Frame) -> Frame:
    """Return the frame in a message of python-can; its node is arbitration_id & 15. Raises
    dahl.Error also if the message is no classic data frame, or the frame not of this kind.
    """
    raw = RawFrame()
    raw.read(message)
    identifier, flags = raw.c.id, raw.c.flags
    if flags:
        names = ("an extended id", "a remote frame", "an error frame", "a CAN FD frame")
        what = next(name for bit, name in enumerate(names) if flags & 1 << bit)
        raise InputError(f"{_name_of(identifier)}: {what}; a classic data frame was expected")
    if not any(kind is known for known in (Frame, *KINDS.values())):
        raise TypeError(f"kind = {checks.shown(kind)} is no kind of frame, such as FrictionTorque")
    frame = from_bytes(identifier, bytes(message.data[: max(message.dlc, 0)]))
    if not isinstance(frame, kind):
        raise InputError(f"{_name_of(identifier)}: {kind.__name__} was expected")
    return frame


def python_can() -> ModuleType:
    """Return the package `can`. Raises dahl.RunError if it is missing."""
    try:
        return import_module("can")
    except ImportError:
        raise RunError(f"python-can is missing; {dependencies.hint(['can'], 'can')}") from None


class RawFrame:
    """A dahl_can_frame_t that converts from and to messages of python-can. Quick: once a tick."""

    def __init__(self) -> None:
        self.c = c.new("dahl_can_frame_t *")
        self._data = c.buffer(self.c.data)
        self._make: Any = None  # can.Message, imported when it is first used

    def read(self, message: can.Message) -> None:
        """Copy a message of python-can: of CAN FD the first 8 bytes. Others: TypeError."""
        try:
            identifier, length = message.arbitration_id, message.dlc
            data: bytes | bytearray = message.data
        except AttributeError:
            raise TypeError(f"message = {checks.shown(message)} is not a can.Message") from None
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
    """Return whether these are the 8 bytes of a frame of a node, with the right CRC."""
    kind = KINDS.get(identifier & ~15)
    return kind is not None and len(data) == 8 and _crc(data, kind) == data[0]


def _crc(data: bytes | bytearray, kind: type[Frame]) -> int:
    return int(c.dahl_frames_crc(bytes(data), kind._kind))


def _name_of(identifier: int) -> str:
    kind = KINDS.get(identifier & ~15)
    return f"{kind.__name__} {identifier:#05x}" if kind else f"id {identifier:#05x}"


def _pack_raw(frame: Frame, node: int) -> RawFrame:
    if not isinstance(frame, Frame):
        raise TypeError(f"frame = {checks.shown(frame)} is no frame of a node")
    values = {name: int(getattr(frame, name)) for name in frame._limits}
    raw, call = RawFrame(), f"dahl_frames_pack_{frame._calls}"
    getattr(c, call)(raw.c, node, c.new(f"{frame._structure} *", values))
    return raw


def _unpack_raw(raw: RawFrame) -> Frame:
    identifier, data = raw.c.id, raw.data()
    kind = KINDS.get(identifier & ~15)
    if kind is None:
        raise InputError(
            f"{_name_of(identifier)}: no frame of a node; those have ids 0x100 to 0x15f"
        )
    values = c.new(f"{kind._structure} *")
    if getattr(c, f"dahl_frames_unpack_{kind._calls}")(raw.c, values) != 0:
        due = _crc(data, kind)
        raise InputError(f"{_name_of(identifier)}: CRC {data[0]:#04x}, {due:#04x} was expected")
    try:
        return kind(**{name: getattr(values, name) for name in kind._limits})
    except Error as error:
        raise InputError(f"{_name_of(identifier)}: {error}") from None
