# SPDX-License-Identifier: MIT
"""The client's side of a bus for code within asyncio."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING, overload

from dahl.can import bus as buses
from dahl.can import codec
from dahl.can.node import ask, expect_silence

if TYPE_CHECKING:
    import can


class AsyncBus:
    """A bus of python-can that asyncio does not wait for: each call works in a thread, one after
    the other. `bus` is the bus itself, for a can.Notifier of your own.
    """

    def __init__(self, bus: can.BusABC) -> None:
        self.bus, self._turn = bus, asyncio.Lock()

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
        async with self._turn:
            return await asyncio.to_thread(ask, self.bus, frame, node, timeout)

    async def expect_silence(
        self,
        frame: codec.Frame | can.Message | None = None,
        node: int = 0,
        seconds: float = 0.1,
    ) -> None:
        """Send a frame that must not be answered, as node.expect_silence() does."""
        async with self._turn:
            await asyncio.to_thread(expect_silence, self.bus, frame, node, seconds)

    async def send(self, frame: codec.Frame | can.Message, node: int = 0) -> None:
        """Send a frame to a node, or a message as it is."""
        message = codec.pack(frame, node) if isinstance(frame, codec.Frame) else frame
        async with self._turn:
            await asyncio.to_thread(self.bus.send, message)

    async def recv(self, timeout: float = 1.0) -> can.Message | None:
        """Return the next message, None after `timeout` s."""
        async with self._turn:
            return await asyncio.to_thread(buses.receive, self.bus, timeout)
