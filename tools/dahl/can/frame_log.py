# SPDX-License-Identifier: MIT
"""The frames of a bus, logged for the report of a failed test. They can be read ahead of the test,
which then receives them in the same order.
"""

from __future__ import annotations

import contextlib
import threading
import time
from collections import deque
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from dahl.can import codec
from dahl.can.bus import candump_line
from dahl.errors import BusError, Error

if TYPE_CHECKING:
    import can

MAX_REPORTED_FRAMES = 200  # newest frames in the report of a test


class FrameLog:
    """Log each frame that is sent and received through a bus of python-can, whose send() and recv()
    are replaced. `listeners` are called with each received message.
    """

    def __init__(self, bus: can.BusABC) -> None:
        self.listeners: list[Callable[[can.Message], None]] = []
        self._send, self._recv, self._lock = bus.send, bus.recv, threading.Lock()
        self._lines: deque[str] = deque(maxlen=MAX_REPORTED_FRAMES)
        self._frames, self._begin = 0, time.monotonic()
        self._ahead: deque[can.Message] = deque()
        for name in ("send", "recv"):
            setattr(bus, name, getattr(self, name))

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Send as the bus does."""
        self._note("->", msg)
        self._send(msg, timeout)

    def recv(self, timeout: float | None = None) -> can.Message | None:
        """Receive as the bus does; first the frames that were read ahead."""
        return self._ahead.popleft() if self._ahead else self._read(timeout)

    def read_ahead(self, timeout: float, drop: Callable[[can.Message], bool]) -> bool:
        """Wait for one frame, and keep it for recv() unless drop() is true. Return False if no
        frame came. Raises dahl.BusError if the bus goes away.
        """
        try:
            message = self._read(timeout)
        except (codec.python_can().CanError, OSError) as error:
            raise BusError(f"the bus has gone: {error}") from None
        if message is not None and not drop(message):
            self._ahead.append(message)
        return message is not None

    def read_rest(self) -> None:
        """Log the frames that wait on the bus."""
        with contextlib.suppress(BusError):
            for _ in range(MAX_REPORTED_FRAMES):
                if not self.read_ahead(0, lambda _: False):
                    return

    def text(self) -> str:
        """Return one line for each frame: seconds, direction, id, bytes and their meaning."""
        left_out = self._frames - len(self._lines)
        head = [f"({left_out} earlier frames are left out)"] if left_out else []
        return "\n".join([*head, *self._lines])

    def _read(self, timeout: float | None) -> can.Message | None:
        with self._lock:  # a can.Notifier may read at the same time
            message = self._recv(timeout)
        if message is not None:
            self._note("<-", message)
            for listener in self.listeners:
                listener(message)
        return message

    def _note(self, arrow: str, message: Any) -> None:
        self._frames += 1
        self._lines.append(f"{time.monotonic() - self._begin:10.6f} {arrow} {_shown(message)}")


def _shown(message: Any) -> str:
    """Return id and bytes in the format of candump, and their meaning if a node uses this id."""
    if not hasattr(message, "arbitration_id"):
        return repr(message)  # the bus refuses it
    text = candump_line(message).split()[2]
    if message.arbitration_id & ~15 not in codec.KINDS:
        return text
    try:
        return f"{text}  {codec.unpack(message)}"
    except Error as error:
        return f"{text}  {error}"
