# SPDX-License-Identifier: MIT
"""The structures of dahl_can_bus.h and dahl_frames.h that several tests pass to the C code."""

from __future__ import annotations

import ctypes


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
