# SPDX-License-Identifier: MIT
"""Test with python-can and pytest: a friction node answers each angle with a torque.

Start a node first, for example the simulated one (examples/README.md), then run
    pytest examples/python_can/test_node.py
"""

import logging
from typing import Any

import can
import pytest
from dahl import codec, node

BUS: dict[str, Any] = {
    "interface": "socketcand",
    "channel": "vcan0",
    "host": "127.0.0.1",
    "port": 28600,
}
logging.getLogger("can").setLevel(logging.ERROR)  # hide the log lines of connection attempts


def ask(bus: can.BusABC, counter: int, count: int) -> float:
    """Return F/Fc after a move to this count of the encoder."""
    return node.ask(bus, codec.EncoderState(count=count, counter=counter)).ratio


def test_torque_follows_the_motion() -> None:
    with can.Bus(**BUS) as bus:
        node.ask(bus, codec.Reset(codec.What.RESTART))  # as after power-on
        assert ask(bus, 0, 1000) == 0.0  # the first count is the starting point
        forward = [ask(bus, counter, 1000 + 200 * counter) for counter in (1, 2)]
        assert 0 < forward[0] < forward[1] <= 1  # towards +Fc
        assert ask(bus, 3, 1200) < forward[1]  # and back
        assert ask(bus, 4, 1200) == pytest.approx(ask(bus, 5, 1200))
