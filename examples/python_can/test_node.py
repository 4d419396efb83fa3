# SPDX-License-Identifier: MIT
"""A friction node answers each angle with a torque: a test with python-can, cantools and pytest.

Start a node first, for instance the one on the desk (examples/README.md), then run
    pytest examples/python_can/test_node.py
"""

import can
import cantools
import pytest
from dahl.e2e import checksum

BUS = {"interface": "socketcand", "channel": "vcan0", "host": "127.0.0.1", "port": 28600}
DBC = cantools.database.load_file("lib/node/dahl.dbc")


def ask(bus: can.BusABC, counter: int, count: int) -> dict:
    """Send one EncoderState; the FrictionTorque that echoes its counter."""
    signals = {"Crc": 0, "Counter": counter, "Valid": 1, "Count": count}
    data = bytearray(DBC.encode_message("EncoderState", signals))
    data[0] = checksum(0x100, data)
    bus.send(can.Message(arbitration_id=0x100, data=data, is_extended_id=False))
    while True:
        answer = bus.recv(1.0)
        assert answer is not None, "no FrictionTorque within a second"
        if answer.arbitration_id == 0x110:
            torque = DBC.decode_message(answer.arbitration_id, answer.data)
            if torque["EchoCounter"] == counter:
                return torque


def test_torque_follows_the_motion() -> None:
    with can.Bus(**BUS) as bus:
        assert ask(bus, 0, 1000)["TorqueRatio"] == 0.0  # the first count is where it starts
        forward = [ask(bus, counter, 1000 + 200 * counter)["TorqueRatio"] for counter in (1, 2)]
        assert 0 < forward[0] < forward[1] <= 1  # towards +Fc
        assert ask(bus, 3, 1200)["TorqueRatio"] < forward[1]  # and back
        assert ask(bus, 4, 1200)["TorqueRatio"] == pytest.approx(ask(bus, 5, 1200)["TorqueRatio"])
