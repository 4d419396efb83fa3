# SPDX-License-Identifier: MIT
"""A drive with a simulated axis on a bus, to try `dahl commission` without hardware.

It has the frames of an ODrive or a moteus (dahl.can.drives), 65536 counts in a turn, 0.002 kg m2,
and a friction of 0.5 N m. If no torque comes for 50 ms, the motor is off, as by a watchdog.

    ip link add dev vcan0 type vcan && ip link set vcan0 up    # as root
    simulated_drive.py odrive vcan0 &
    dahl commission -i socketcan -c vcan0 --drive odrive --counts-per-turn 65536
        --inertia 0.0024 --torque-limit 5
"""

import argparse
import struct
import sys
import time

import can
from dahl.sim.axis import COUNTS_PER_TURN, PERIOD_S, Shaft

WATCHDOG_S = 0.05


class SimulatedDrive:
    """Frames of a drive, and its axis. sign: -1 for a motor that turns against its encoder."""

    def __init__(self, kind: str, node: int, sign: int = 1) -> None:
        self.kind, self._node, self._sign = kind, node, sign
        self._shaft, self._counts = Shaft(), 0

    def torque(self, message: can.Message) -> float | None:
        """Return the torque of a frame in N m, None if it is no command for this drive."""
        if self.kind == "odrive":
            is_mine = message.arbitration_id == self._node << 5 | 0x0E and len(message.data) == 4
            return float(struct.unpack("<f", message.data)[0]) if is_mine else None
        is_mine = message.arbitration_id == 0x8000 | self._node and len(message.data) == 32
        return float(struct.unpack_from("<f", message.data, 14)[0]) if is_mine else None

    def move(self, torque: float) -> can.Message:
        """Advance by a period under a torque in N m. Return the frame with the angle."""
        self._counts += self._shaft.move(self._sign * torque)
        turns = struct.pack("<f", self._counts / COUNTS_PER_TURN)
        if self.kind == "odrive":
            number, data = self._node << 5 | 0x09, turns + bytes(4)
            return can.Message(arbitration_id=number, data=data, is_extended_id=False)
        data = b"\x2d\x01" + turns  # a reply with register 1
        return can.Message(arbitration_id=self._node << 8, data=data, is_fd=True)


def serve(bus: can.BusABC, drive: SimulatedDrive) -> None:
    """Send the angle: as an ODrive each millisecond, as a moteus after each command."""
    torque, last, next_tick = 0.0, time.monotonic(), time.monotonic()
    while True:
        wait = 1.0 if drive.kind == "moteus" else max(0.0, next_tick - time.monotonic())
        message = bus.recv(wait)
        asked = drive.torque(message) if message else None
        if asked is not None:
            torque, last = asked, time.monotonic()
        is_due = time.monotonic() >= next_tick if drive.kind == "odrive" else asked is not None
        if is_due:
            next_tick += PERIOD_S
            bus.send(drive.move(torque if time.monotonic() - last < WATCHDOG_S else 0.0))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="A drive with a simulated axis.")
    parser.add_argument("drive", choices=["odrive", "moteus"])
    parser.add_argument("channel", help="an interface of SocketCAN")
    parser.add_argument("--node", type=int, help="number of the drive (default 0; moteus 1)")
    args = parser.parse_args()
    node = args.node if args.node is not None else int(args.drive == "moteus")
    is_fd = args.drive == "moteus"
    try:
        opened = can.Bus(interface="socketcan", channel=args.channel, fd=is_fd)
    except (OSError, can.CanError) as error:
        sys.exit(f"error: cannot open {args.channel}: {error}")
    with opened:
        serve(opened, SimulatedDrive(args.drive, node))
