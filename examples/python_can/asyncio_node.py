# SPDX-License-Identifier: MIT
"""Ask a friction node from asyncio: each angle awaits its torque while other frames are handled.

Start a node first (examples/README.md), then run, with its TCP port if that is not 28600,
    python examples/python_can/asyncio_node.py [PORT]
"""

import asyncio
import math
import sys

import can
import cantools
from dahl.e2e import checksum
from dahl.paths import DBC

ENCODER_STATE, FRICTION_TORQUE, STATUS = 0x100, 0x110, 0x120  # of node 0
PATIENCE = 1.0  # s for an answer


class Node:
    """The client's side of one node on a bus that is open."""

    def __init__(self, bus: can.BusABC) -> None:
        self.bus, self.database = bus, cantools.database.load_file(DBC)
        self.counter, self.waiting, self.states = 0, {}, []

    def receive(self, message: can.Message) -> None:
        """A listener of can.Notifier: it is called in the loop, frame by frame."""
        if message.arbitration_id not in (FRICTION_TORQUE, STATUS):
            return
        signals = self.database.decode_message(message.arbitration_id, message.data)
        if message.arbitration_id == STATUS:
            self.states.append(str(signals["State"]))
        elif answer := self.waiting.pop(signals["EchoCounter"], None):
            answer.set_result(signals["TorqueRatio"])

    async def torque_ratio(self, count: int) -> float:
        """F/Fc after the shaft has moved to this count of the encoder."""
        counter, self.counter = self.counter, (self.counter + 1) % 16
        signals = {"Crc": 0, "Counter": counter, "Valid": 1, "Count": count}
        data = bytearray(self.database.encode_message("EncoderState", signals))
        data[0] = checksum(ENCODER_STATE, data)
        self.waiting[counter] = asyncio.get_running_loop().create_future()
        answer = self.waiting[counter]
        self.bus.send(can.Message(arbitration_id=ENCODER_STATE, data=data, is_extended_id=False))
        return await asyncio.wait_for(answer, PATIENCE)


async def main(port: int) -> None:
    bus = can.Bus(interface="socketcand", channel="vcan0", host="127.0.0.1", port=port)
    node = Node(bus)
    notifier = can.Notifier(bus, [node.receive], loop=asyncio.get_running_loop())
    try:
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
