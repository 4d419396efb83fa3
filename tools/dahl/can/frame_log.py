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

from dahl.binding.checks import shown
from dahl.can import codec
from dahl.errors import BusError, Error, hide
from dahl.io.candump import candump_line

if TYPE_CHECKING:
    import can

__tracebackhide__ = hide
MAX_REPORTED_FRAMES = 200  # newest frames in the report of a test
MAX_SHOWN = 300  # characters of a frame in the report
MAX_DROP_S = 1.0  # for the frames that wait, on a busy bus


class FrameLog:
    """Log each frame that is sent and received through a bus of python-can, whose send() and recv()
    are replaced. `listeners` are called with each received message.
    """

    def __init__(self, bus: can.BusABC) -> None:
        self.listeners: list[Callable[[can.Message], None]] = []
        self.bus, self._send, self._recv = bus, bus.send, bus.recv
        self._lock = threading.Lock()
        self._lines: deque[str] = deque(maxlen=MAX_REPORTED_FRAMES)
        self._ahead: deque[can.Message] = deque()
        self._clear()
        for name in ("send", "recv"):
            setattr(bus, name, getattr(self, name))

    def _clear(self) -> None:
        self._lines.clear()
        self._frames, self._set_up, self._begin = 0, 0, time.monotonic()

    def start_again(self) -> None:
        """Begin the log of another test: drop the frames that wait, and forget earlier ones."""
        self.listeners.clear()
        until = time.monotonic() + MAX_DROP_S
        with contextlib.suppress(BusError):
            while self.read_ahead(0, lambda _: True) and time.monotonic() < until:
                pass
        self._ahead.clear()
        self._clear()

    def end_set_up(self) -> None:
        """Draw a line below the frames so far, which the set-up of a test sent and received."""
        self._set_up = self._frames

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
        lines = list(self._lines)
        if self._set_up > left_out:
            lines.insert(self._set_up - left_out, "--- end of the set-up ---")
        head = [f"({left_out} earlier frames are left out)"] if left_out else []
        return "\n".join([*head, *lines])

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
        text = f"{time.monotonic() - self._begin:10.6f} {arrow} {_shown(message)}"
        self._lines.append(text if len(text) <= MAX_SHOWN else f"{text[:MAX_SHOWN]}...")


def attach(bus: can.BusABC) -> FrameLog:
    """Return a new log of a bus. A bus of several tests has one already, which starts again."""
    log = getattr(bus.send, "__self__", None)
    if not isinstance(log, FrameLog):
        return FrameLog(bus)
    log.start_again()
    return log


def _shown(message: Any) -> str:
    """Return id and bytes in the format of candump, and their meaning if a node uses this id."""
    if not hasattr(message, "arbitration_id"):
        return shown(message)  # the bus refuses it
    text = candump_line(message).split()[2]
    if message.arbitration_id & ~15 not in codec.KINDS:
        return text
    try:
        return f"{text}  {codec.unpack(message)}"
    except Error as error:
        return f"{text}  {error}"
