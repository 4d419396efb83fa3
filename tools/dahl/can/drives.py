# SPDX-License-Identifier: MIT
"""Drives on CAN that send their angle and accept a torque: ODrive and moteus.

A drive of your own can use the two frames of ODrive. Both are little-endian floats in classic
frames with an 11-bit identifier, node << 5 | command:

    command  sent by  data
    0x09     drive    float position in turns, float speed in turns/s (not read); once a period
    0x0E     host     float torque in N m
"""

from __future__ import annotations

import math
import struct
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Protocol

from dahl.can.bus import receive, transmit
from dahl.errors import RunError, Timeout

if TYPE_CHECKING:
    import can

NO_OPERATION = b"\x50"  # moteus: fills a frame up to a length of CAN FD
START_S, TIMEOUT_S = 1.0, 0.05  # for the first angle, and for each later one
CHECKED_TICKS = 400  # over which the mean period is checked
MAX_PERIOD_ERROR = 0.05  # of that mean, over the period of the configuration
OFF_FRAMES = 3  # with torque 0, at the end


class Drive(Protocol):
    """Frames of a drive."""

    def turns(self, message: can.Message) -> float | None:
        """Return the angle in turns if a frame has one of this drive, else None."""

    def command(self, torque: float) -> can.Message:
        """Return the frame that sets the torque in N m."""


def float_at(data: bytes | bytearray, place: int) -> float | None:
    """Return a float of a frame, or None if it is missing, infinite or NaN."""
    if len(data) < place + 4:
        return None
    value = float(struct.unpack_from("<f", data, place)[0])
    return value if math.isfinite(value) else None


class ODrive:
    """CAN Simple: Get_Encoder_Estimates (9), which the drive sends each encoder_rate_ms (0.6:
    encoder_msg_rate_ms), and Set_Input_Torque (14), little-endian floats in turns and N m. Checked
    against the protocol table and can_simple.cpp of firmware 0.5.4. The drive must be in torque
    mode, with its loop closed.
    """

    def __init__(self, node: int = 0) -> None:
        self._id = node << 5

    def turns(self, message: can.Message) -> float | None:
        is_estimate = message.arbitration_id == self._id | 0x09
        return float_at(message.data, 0) if is_estimate else None

    def command(self, torque: float) -> can.Message:
        import can

        data = struct.pack("<f", torque)
        return can.Message(arbitration_id=self._id | 0x0E, data=data, is_extended_id=False)


class Moteus:
    """Registers: mode (0) = position (10); position (32) = NaN, velocity (33) = 0, feed-forward
    torque (34) in N m, both gain scales (35, 36) = 0. Each command requests the position (1) in
    turns. Checked against the register reference, and byte for byte against make_position() of the
    Python package moteus 1.1.1.
    """

    def __init__(self, node: int = 1) -> None:
        self._node = node

    def turns(self, message: can.Message) -> float | None:
        is_reply = message.arbitration_id >> 8 == self._node and message.data[:2] == b"\x2d\x01"
        return float_at(message.data, 2) if is_reply else None

    def command(self, torque: float) -> can.Message:
        import can

        written = b"\x01\x00\x0a\x0c\x05\x20" + struct.pack("<5f", math.nan, 0, torque, 0, 0)
        data = (written + b"\x1d\x01").ljust(32, NO_OPERATION)
        return can.Message(
            arbitration_id=0x8000 | self._node, data=data, is_extended_id=True, is_fd=True
        )


DRIVES: dict[str, Callable[[int], Drive]] = {"odrive": ODrive, "moteus": Moteus}
DEFAULT_NODES = {"odrive": 0, "moteus": 1}


class Axis:
    """An axis behind a drive, one tick for each angle. An ODrive sets the pace by its frames. A
    moteus answers each command, so the host sets it: `paced_by_host`.
    """

    def __init__(
        self,
        bus: can.BusABC,
        drive: Drive,
        counts_per_turn: int,
        period: float,
        paced_by_host: bool = False,
    ) -> None:
        self._bus, self._drive, self._per_turn = bus, drive, counts_per_turn
        self._period, self._paced = period, paced_by_host
        self._counts: int | None = None
        self._next = time.monotonic()
        self._first, self._ticks = 0.0, 0

    def move(self, torque: float) -> int:
        """Send a torque in N m and wait for the next angle. Return the counts since the last one.
        Raises dahl.Timeout if no angle comes, and dahl.RunError if the period is wrong.
        """
        if self._paced:
            self._next = max(self._next + self._period, time.monotonic() - self._period)
            time.sleep(max(0.0, self._next - time.monotonic()))
        self._send(torque)
        counts = round(self._wait() * self._per_turn)
        before, self._counts = self._counts, counts
        return 0 if before is None else counts - before

    def stop(self) -> None:
        """Set the torque to 0 by several frames, because one may be lost."""
        for _ in range(OFF_FRAMES):
            self._send(0.0)

    def _send(self, torque: float) -> None:
        transmit(self._bus, self._drive.command(torque), f"a torque of {torque:g} N m")

    def _wait(self) -> float:
        """Return the next angle in turns."""
        patience = START_S if self._counts is None else TIMEOUT_S
        end = time.monotonic() + patience
        while (left := end - time.monotonic()) > 0:
            message = receive(self._bus, left)
            turns = self._drive.turns(message) if message else None
            if message is not None and turns is not None:
                self._check_period(message.timestamp)
                return turns
        raise Timeout(
            f"no angle of the drive in {patience:g} s: is it on, does it send its angle each"
            f" {1e3 * self._period:g} ms, is --node right?"
        )

    def _check_period(self, timestamp: float) -> None:
        self._ticks += 1
        if self._ticks == 1:
            self._first = timestamp
        if self._ticks == CHECKED_TICKS + 1:
            found = (timestamp - self._first) / CHECKED_TICKS
            if abs(found / self._period - 1) > MAX_PERIOD_ERROR:
                raise RunError(
                    f"an angle comes each {1e3 * found:.3g} ms, not each {1e3 * self._period:g} ms:"
                    " set the rate of the drive, or --period"
                )
