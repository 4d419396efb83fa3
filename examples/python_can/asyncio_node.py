# SPDX-License-Identifier: MIT
"""Query a friction node from asyncio: each angle awaits its torque while other frames are handled.

Start a node first (examples/README.md), then run
    python examples/python_can/asyncio_node.py [PORT]
PORT is the node's TCP port, 28600 by default.
"""

import asyncio
import logging
import math
import sys

import can
from dahl import Error, codec

ANSWER_TIMEOUT_S = 1.0


class Node:
    """Client of node 0 on an open bus."""

    def __init__(self, bus: can.BusABC) -> None:
        self.bus, self.counter = bus, 0
        self.waiting: dict[int, asyncio.Future[float]] = {}  # by the counter of the angle
        self.states: list[str] = []

    def receive(self, message: can.Message) -> None:
        """Listener of can.Notifier, called in the event loop for each frame."""
        try:
            frame = codec.unpack(message)
        except Error:
            return  # a foreign or damaged frame
        if isinstance(frame, codec.Status):
            self.states.append(frame.state.name)
        elif isinstance(frame, codec.FrictionTorque) and frame.echo in self.waiting:
            self.waiting.pop(frame.echo).set_result(frame.ratio)

    async def torque_ratio(self, count: int) -> float:
        """Return F/Fc after a move to this count of the encoder."""
        counter, self.counter = self.counter, (self.counter + 1) % 16
        self.waiting[counter] = answer = asyncio.get_running_loop().create_future()
        self.bus.send(codec.pack(codec.EncoderState(count=count, counter=counter)))
        return await asyncio.wait_for(answer, ANSWER_TIMEOUT_S)


def open_bus(port: int) -> can.BusABC:
    logging.getLogger("can").setLevel(logging.ERROR)  # hide the log lines of connection attempts
    try:
        return can.Bus(interface="socketcand", channel="vcan0", host="127.0.0.1", port=port)
    except OSError as error:
        sys.exit(f"no node on port {port}: {error}; examples/README.md starts one")


async def main(port: int) -> None:
    bus = open_bus(port)
    node = Node(bus)
    notifier = can.Notifier(bus, [node.receive], loop=asyncio.get_running_loop())
    try:
        bus.send(codec.pack(codec.Reset(codec.What.RESTART)))  # forget an earlier client
        for tick in range(100):
            ratio = await node.torque_ratio(round(500 * math.sin(tick / 10)))
            if tick % 10 == 0:
                print(f"tick {tick:3}  F/Fc {ratio:+.6f}")
            await asyncio.sleep(0.002)
        print("states:", ", ".join(dict.fromkeys(node.states)) or "none so far")
    finally:
        notifier.stop()
        bus.shutdown()


if __name__ == "__main__":
    asyncio.run(main(int(sys.argv[1]) if len(sys.argv) > 1 else 28600))
