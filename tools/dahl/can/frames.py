# SPDX-License-Identifier: MIT
# Written from lib/node/dahl.dbc by tools/generators/frames.py.
"""The frames of a friction node: numbers, units, and a class for each frame."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum, IntFlag
from typing import Any, ClassVar

from dahl.can.frame import Frame, ParamFrame, ParamWriteFrame, StatusFrame, TorqueFrame


class State(IntEnum):
    """State of the receiver."""

    OK = 0
    REPEATED = 1
    LOST = 2
    WRONG_SEQUENCE = 3
    CRC = 4
    STALE = 5
    INIT = 6


class Param(IntEnum):
    """Parameters by number. UNITS has the unit."""

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


class Write(IntEnum):
    """Purpose of a ParamWrite."""

    READ = 0
    WRITE = 1
    HOLD = 2


class Result(IntEnum):
    """Result of a ParamWrite."""

    DONE = 0
    OUT_OF_RANGE = 1
    UNKNOWN = 2


class What(IntEnum):
    """Extent of a Reset."""

    ERRORS = 1
    RESTART = 2


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


OFF_AT_0 = (Param.STEP, Param.STATUS)  # 0: a move of any length; no Status but after an event
UNITS: dict[int, float] = {  # of one raw step
    Param.SIGMA0: 0.0009765625,  # N m/rad
    Param.FC: 9.5367431640625e-07,  # N m
    Param.THETA: 3.637978807091713e-12,  # rad
    Param.GAIN: 1.52587890625e-05,
    Param.LIMIT: 1.52587890625e-05,
    Param.RAMP: 0.001,  # s
    Param.TIMEOUT: 0.001,  # s
    Param.STEP: 1.0,  # count/ms
    Param.STATUS: 0.001,  # s
    Param.MODEL: 1.0,
    Param.LOAD: 1.52587890625e-05,
    Param.NONE: 1.0,
}


@dataclass(frozen=True)
class EncoderState(Frame):
    """Absolute encoder count, every 1 ms.

    count    Absolute position in counts, wraps at 32 bits.
    counter  Increases by 1 with each frame, 15 is followed by 0.
    valid    0: the encoder marks this count as invalid; the node does not use it.
    """

    count: int
    counter: int = 0
    valid: bool = True

    base = 0x100
    _calls, _structure = "encoder", "dahl_encoder_state_t"
    _kind = 0x3
    _limits: ClassVar[dict[str, Any]] = {
        "count": (-2147483648, 2147483647),
        "counter": (0, 15),
        "valid": bool,
    }


@dataclass(frozen=True)
class FrictionTorque(TorqueFrame):
    """Answer to each EncoderState that the node accepted, sent on its reception.

    torque_q30  In 2^-30. Friction torque with the sign of the motion, as a fraction of the Coulomb
                torque: F [N m] = TorqueRatio * Fc, times Gain and clamped to Limit.
    counter     Increases by 1 with each frame, 15 is followed by 0.
    state       State of the node for the frame that it answers.
    echo        Counter of the EncoderState that it answers.
    """

    torque_q30: int
    counter: int = 0
    state: State = State.OK
    echo: int = 0

    base = 0x110
    _calls, _structure = "torque", "dahl_friction_torque_t"
    _kind = 0xC
    _limits: ClassVar[dict[str, Any]] = {
        "torque_q30": (-1073741824, 1073741824),
        "counter": (0, 15),
        "state": State,
        "echo": (0, 15),
    }


@dataclass(frozen=True)
class Status(StatusFrame):
    """Health of the node, every StatusPeriod, and at once after power-on, a timeout, a bus-off and
    a Reset.

    counter        Increases by 1 with each frame, 15 is followed by 0.
    state          Present state of the input.
    errors         Sticky bits: 1 << State, FORMAT, INVALID, JUMP.
    lost           Frames missing by the counter since the last Reset, modulo 256.
    corrupt        Frames with wrong CRC or form since the last Reset, modulo 256.
    out_of_step    Frames repeated, out of sequence or too far away, timeouts and bus-offs since the
                   last Reset, modulo 256.
    version_major  Version of the library, first number.
    version_minor  Version of the library, second number.
    timeout        In 10 ms. Timeout after which the node is Stale, rounded up; 2550: this or
                   longer.
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
    _calls, _structure = "status", "dahl_node_status_t"
    _kind = 0x5
    _limits: ClassVar[dict[str, Any]] = {
        "counter": (0, 15),
        "state": State,
        "errors": Errors,
        "lost": (0, 255),
        "corrupt": (0, 255),
        "out_of_step": (0, 255),
        "version_major": (0, 15),
        "version_minor": (0, 15),
        "timeout": (0, 255),
    }
    _timeout_unit = 0.01  # s


@dataclass(frozen=True)
class ParamWrite(ParamWriteFrame):
    """Sets or reads one parameter, selected by Param.

    param    Number of the parameter.
    value    Raw value of the parameter, in steps of its unit.
    write    Read: answer only.
    counter  Any value; the answer repeats it.
    """

    param: int
    value: int = 0
    write: Write = Write.READ
    counter: int = 0

    base = 0x130
    _calls, _structure = "param_write", "dahl_param_write_t"
    _kind = 0x6
    _limits: ClassVar[dict[str, Any]] = {
        "param": Param,
        "value": (0, 4294967295),
        "write": Write,
        "counter": (0, 15),
    }
    _units, _off_at_0 = UNITS, OFF_AT_0


@dataclass(frozen=True)
class ParamReply(ParamFrame):
    """Answer to each ParamWrite: the present value.

    param    Number of the parameter.
    value    Raw value of the parameter, in steps of its unit.
    result   Result of the ParamWrite.
    counter  Counter of the ParamWrite that it answers.
    """

    param: int
    value: int
    result: Result = Result.DONE
    counter: int = 0

    base = 0x140
    _calls, _structure = "param_reply", "dahl_param_reply_t"
    _kind = 0x9
    _limits: ClassVar[dict[str, Any]] = {
        "param": Param,
        "value": (0, 4294967295),
        "result": Result,
        "counter": (0, 15),
    }
    _units, _off_at_0 = UNITS, OFF_AT_0


@dataclass(frozen=True)
class Reset(Frame):
    """Answered by Status.

    what     Errors: clear the sticky errors and counts of Status.
    counter  Any value.
    """

    what: What
    counter: int = 0

    base = 0x150
    _calls, _structure = "reset", "dahl_node_reset_t"
    _kind = 0xA
    _limits: ClassVar[dict[str, Any]] = {
        "what": What,
        "counter": (0, 15),
    }


KINDS: dict[int, type[Frame]] = {
    kind.base: kind
    for kind in (EncoderState, FrictionTorque, Status, ParamWrite, ParamReply, Reset)
}
