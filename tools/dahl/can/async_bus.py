# SPDX-License-Identifier: MIT
"""The client's side of a bus for code within asyncio."""

from __future__ import annotations

import asyncio
import contextlib
import math
import threading
import time
from collections import deque
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING, Any, TypeVar, overload
from weakref import WeakKeyDictionary

from dahl.can import bus as buses
from dahl.can import codec
from dahl.can.node import ask, check_bus, check_span, expect_silence, send, turn_of
from dahl.errors import Error, hide

if TYPE_CHECKING:
    import can

__tracebackhide__ = hide
T = TypeVar("T")
MAX_WAIT_S = 0.01  # from the cancellation of a call until its thread stops reading


class AsyncBus:
    """A bus of python-can that asyncio does not wait for: each call works in a thread, one after
    the other. `bus` is the bus itself.

    A call may be cancelled, for example by asyncio.timeout(). It has then stopped reading, and the
    next call gets its own answer, if its frame has another counter. A frame that a call had sent
    stays sent.
    """

    def __init__(self, bus: can.BusABC) -> None:
        check_bus(bus, "send", "recv")
        self.bus = bus
        self._turns = WeakKeyDictionary[asyncio.AbstractEventLoop, asyncio.Lock]()
        self._threads = ThreadPoolExecutor()  # those of asyncio are few, and belong to the caller
        self._unread: deque[can.Message] = deque()  # received by a recv() that was cancelled

    @overload
    async def ask(
        self, frame: codec.EncoderState, node: int = 0, timeout: float = 1.0
    ) -> codec.FrictionTorque: ...
    @overload
    async def ask(
        self, frame: codec.ParamWrite, node: int = 0, timeout: float = 1.0
    ) -> codec.ParamReply: ...
    @overload
    async def ask(
        self, frame: codec.Reset, node: int = 0, timeout: float = 1.0
    ) -> codec.Status: ...
    async def ask(
        self,
        frame: codec.EncoderState | codec.ParamWrite | codec.Reset,
        node: int = 0,
        timeout: float = 1.0,
    ) -> codec.Frame:
        """Send a frame and return the answer, as node.ask() does."""
        return await self._call(ask, frame, node, timeout)

    async def expect_silence(
        self,
        frame: codec.Frame | can.Message | None = None,
        node: int = 0,
        seconds: float = 0.1,
    ) -> None:
        """Send a frame that must not be answered, as node.expect_silence() does."""
        await self._call(expect_silence, frame, node, seconds)

    async def send(self, frame: codec.Frame | can.Message, node: int = 0) -> None:
        """Send a frame to a node, or a message as it is."""
        await self._call(send, frame, node)

    async def recv(self, timeout: float | None = 1.0) -> can.Message | None:
        """Return the next message, None after `timeout` s; a timeout of None is endless."""
        seconds = math.inf if timeout is None else check_span("timeout", timeout)
        return await self._call(self._receive, seconds)

    def _receive(self, bus: can.BusABC, timeout: float) -> can.Message | None:
        return self._unread.popleft() if self._unread else buses.receive(bus, timeout)

    async def _call(self, function: Callable[..., T], *arguments: Any) -> T:
        """Call function(bus, *arguments) in a thread, and wait for its end, also if cancelled."""
        loop = asyncio.get_running_loop()
        async with self._turns.setdefault(loop, asyncio.Lock()):
            if function in (ask, expect_silence):  # they drop the frames that wait
                self._unread.clear()
            link = _CancellableBus(self.bus)
            work = loop.run_in_executor(self._threads, link.call, function, arguments)
            try:
                return await asyncio.shield(work)
            except Error as error:  # without the frames of its thread
                raise error.with_traceback(None) from None
            except asyncio.CancelledError:
                link.cancelled.set()
                while not work.done():  # a further cancellation changes nothing
                    with contextlib.suppress(asyncio.CancelledError):
                        await asyncio.wait([work])
                has_received = work.exception() is None and function == self._receive
                if has_received and (message := work.result()) is not None:
                    self._unread.append(message)  # type: ignore[arg-type]  # _receive() returned it
                raise


class _Cancelled(Exception):  # noqa: N818 (nobody sees it)
    pass


class _CancellableBus:
    """The bus of one call: recv() raises _Cancelled soon after `cancelled` is set."""

    def __init__(self, bus: can.BusABC) -> None:
        self._bus, self.cancelled = bus, threading.Event()

    def call(self, function: Callable[..., T], arguments: tuple[Any, ...]) -> T:
        """Call function(self, *arguments) when no other thread asks on the bus."""
        turn = turn_of(self._bus)
        while not turn.acquire(timeout=MAX_WAIT_S):
            self._check()
        try:
            return function(self, *arguments)
        finally:
            turn.release()

    def recv(self, timeout: float) -> can.Message | None:
        """Receive as the bus does."""
        until = time.monotonic() + timeout
        while True:
            self._check()
            left = until - time.monotonic()
            message = self._bus.recv(max(0.0, min(left, MAX_WAIT_S)))
            if message is not None or left <= MAX_WAIT_S:
                return message

    def _check(self) -> None:
        if self.cancelled.is_set():
            raise _Cancelled

    def __getattr__(self, name: str) -> Any:
        return getattr(self._bus, name)
