# SPDX-License-Identifier: MIT
"""The lines of `candump -L`, which canplayer replays. Python writes and reads them here only;
dahl-loop writes them in host_sim/candump.c.

    (seconds) bus 123#0011      data; an id of 8 digits is extended, or an error class with bit 29
    (seconds) bus 123#R8        a remote frame and its length
    (seconds) bus 123##10011    CAN FD; the first digit has the flags: 1 BRS, 2 ESI

A direction, R or T, may follow, as `candump -L -x` writes it.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import can

VCAN = "vcan0"  # the bus of a frame without a channel
ERROR, ID_MASK = 0x20000000, 0x1FFFFFFF  # CAN_ERR_FLAG of linux/can.h
BRS, ESI = 1, 2
MAX_DLC = 8  # of a remote frame
LINE = re.compile(
    r"\((?P<time>\d+\.\d+)\) +(?P<bus>\S+) +(?P<id>[0-7][0-9A-F]{2}|[0-3][0-9A-F]{7})#"
    r"(?:(?P<remote>R)(?P<dlc>[0-8])?|#(?P<fd>[0-9A-F])(?P<fd_data>(?:\.?[0-9A-F]{2}){0,64})"
    r"|(?P<data>(?:\.?[0-9A-F]{2}){0,8}))(?:_[9A-F])?(?: (?P<direction>[RT]))?\s*",
    re.IGNORECASE,
)


def candump_line(message: can.Message, with_direction: bool = False) -> str:
    """Return the line of a frame. The time is not below 0."""
    if message.is_error_frame:
        head = f"{message.arbitration_id & ID_MASK | ERROR:08X}#"
    else:
        head = f"{message.arbitration_id:0{8 if message.is_extended_id else 3}X}#"
    if message.is_fd:
        head += f"#{BRS * message.bitrate_switch + ESI * message.error_state_indicator:X}"
    data = message.data.hex().upper()
    if message.is_remote_frame:
        data = f"R{min(message.dlc, MAX_DLC) or ''}"
    direction = (" R" if message.is_rx else " T") * with_direction
    time = max(message.timestamp, 0.0)
    return f"({time:017.6f}) {_bus_name(message.channel)} {head}{data}{direction}\n"


def _bus_name(channel: object) -> str:
    """Return a channel as one word. Interfaces that number their channels get names of Linux."""
    if channel is None:
        return VCAN
    name = "_".join(str(channel).split()) or VCAN
    return f"can{name}" if name.isdigit() else name


def message_of(line: str) -> can.Message | None:
    """Return the frame of a line; None if it is no line of candump."""
    import can

    found = LINE.fullmatch(line)
    if found is None:
        return None
    number, is_long = int(found["id"], 16), len(found["id"]) > 3
    data = bytes.fromhex((found["fd_data"] or found["data"] or "").replace(".", ""))
    flags, bus = int(found["fd"] or "0", 16), found["bus"]
    return can.Message(
        timestamp=float(found["time"]),
        arbitration_id=number & ID_MASK,
        is_extended_id=is_long,
        is_error_frame=bool(number & ERROR),
        is_remote_frame=found["remote"] is not None,
        is_fd=found["fd"] is not None,
        bitrate_switch=bool(flags & BRS),
        error_state_indicator=bool(flags & ESI),
        is_rx=found["direction"] not in ("T", "t"),
        dlc=int(found["dlc"] or 0) if found["remote"] else len(data),
        data=None if found["remote"] else data,
        channel=int(bus) if bus.isdigit() else bus,
    )


class Writer:
    """A log of such lines, with directions. Each line is whole at once."""

    def __init__(self, path: Path) -> None:
        self.file = path.open("w", encoding="utf-8", buffering=1)

    def on_message_received(self, message: can.Message) -> None:
        self.file.write(candump_line(message, with_direction=True))

    def __enter__(self) -> Writer:
        return self

    def __exit__(self, *_: Any) -> None:
        self.file.close()
