# SPDX-License-Identifier: MIT
"""Frames by cantools and crccheck alone, and a bus inside this process."""

import contextlib
import itertools
import threading
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

import can
import cantools
from can.interfaces.virtual import channels
from crccheck.crc import Crc8Autosar
from loop_tools import wait_until

KINDS = {"EncoderState": 0x3, "FrictionTorque": 0xC, "Status": 0x5, "ParamReply": 0x9}
ANGLE = {"Valid": 1, "Count": 0}  # signals of an EncoderState
ERRORS = ("Format", "Repeated", "Lost", "Sequence", "Crc", "Stale", "Invalid", "Jump")
_numbers = itertools.count()


def frames(dbc: Path, *messages: tuple[str, float, dict[str, Any]]) -> Iterator[can.Message]:
    """python-can messages of (name, time, signals), encoded by cantools, protected by crccheck."""
    database = cantools.database.load_file(dbc)
    for name, moment, signals in messages:
        message = database.get_message_by_name(name)
        data = bytearray(message.encode({"Crc": 0, **signals}, strict=False))
        data[0] = Crc8Autosar.calc(data[1:] + bytes([KINDS[name] << 4 | data[1] & 15]))
        yield can.Message(
            timestamp=moment, arbitration_id=message.frame_id, data=data, is_extended_id=False
        )


@contextlib.contextmanager
def two_ends() -> Iterator[tuple[can.BusABC, can.BusABC]]:
    """Two clients of a bus of this process."""
    settings = {"interface": "virtual", "channel": new_channel()}
    with can.Bus(**settings) as one, can.Bus(**settings) as other:
        yield one, other


def is_joined(channel: str) -> bool:
    return len(channels[channel]) == 2


@contextlib.contextmanager
def sending(
    channel: str,
    messages: Iterable[can.Message],
    ready: Callable[[], bool] | None = None,
    before_last: Callable[[], object] = lambda: None,
) -> Iterator[None]:
    """Send frames over python-can's own bus of this process once a client is ready."""

    def send() -> None:
        with can.Bus(interface="virtual", channel=channel, preserve_timestamps=True) as bus:
            wait_until(ready or (lambda: is_joined(channel)), 60)
            *first, last = messages
            for message in first:
                bus.send(message)
            try:
                before_last()
            finally:  # the client waits for it
                bus.send(last)

    sender = threading.Thread(target=send)
    sender.start()
    yield
    sender.join()


def new_channel() -> str:
    return f"test-{next(_numbers)}"


def bus_of(port: int) -> list[str]:
    return ["-i", "socketcand", "-c", "vcan0", "--host", "127.0.0.1", "--port", str(port)]
