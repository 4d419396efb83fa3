# SPDX-License-Identifier: MIT
"""What several tests know of frames: structures of dahl_can_bus.h and dahl_frames.h, and names in
the DBC.
"""

from __future__ import annotations

import ctypes
from typing import Any

KINDS = {
    "EncoderState": ("encoder", 0x3),
    "FrictionTorque": ("torque", 0xC),
    "Status": ("status", 0x5),
    "ParamWrite": ("param_write", 0x6),
    "ParamReply": ("param_reply", 0x9),
    "Reset": ("reset", 0xA),
}
ERRORS = ("Format", "Repeated", "Lost", "Sequence", "Crc", "Stale", "Invalid", "Jump")
PARAMS = ["Sigma0", "Fc", "ThetaPerCount", "Gain", "Limit", "Ramp", "Timeout", "MaxStep"]
PARAMS += ["StatusPeriod", "Model", "Load"]


class Frame(ctypes.Structure):
    """dahl_can_frame_t."""

    _fields_ = [
        ("time_us", ctypes.c_uint64),
        ("id", ctypes.c_uint32),
        ("flags", ctypes.c_uint8),
        ("length", ctypes.c_uint8),
        ("data", ctypes.c_uint8 * 8),
    ]


class EncoderState(ctypes.Structure):
    """dahl_encoder_state_t."""

    _fields_ = [("count", ctypes.c_int32), ("counter", ctypes.c_uint8), ("valid", ctypes.c_bool)]


def signals_of(kind: str, s: Any, crc: int) -> dict[str, int]:
    """Raw signal values by their names in the DBC."""
    head = {"Crc": crc, "Counter": s.counter}
    if kind == "EncoderState":
        return {**head, "Valid": int(s.valid), "Count": s.count}
    if kind == "FrictionTorque":
        return {**head, "State": s.state, "EchoCounter": s.echo, "TorqueRatio": s.torque_q30}
    if kind.startswith("Param"):
        high = {"Write": s.write} if kind == "ParamWrite" else {"Result": s.result}
        return {**head, **high, "Param": s.param, PARAMS[s.param]: s.value}
    if kind == "Reset":
        return {**head, "What": s.what}
    errors = {f"Error{name}": s.errors >> bit & 1 for bit, name in enumerate(ERRORS)}
    return {
        **head,
        "State": s.state,
        **errors,
        "Lost": s.lost,
        "Corrupt": s.corrupt,
        "OutOfStep": s.out_of_step,
        "VersionMajor": s.version_major,
        "VersionMinor": s.version_minor,
        "Timeout": s.timeout,
    }


def data_ids(kind: str) -> bytes:
    return bytes(KINDS[kind][1] << 4 | counter for counter in range(16))
