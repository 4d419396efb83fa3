# SPDX-License-Identifier: MIT
"""Each row of the fault table over a bus: a simulated node, or one on a rig (--dahl-interface).

The C test of the node plays the rows of a bus-off, which needs a controller. A rig of classic CAN
needs `-k "not FD"`.
"""

from __future__ import annotations

import re
import time
from pathlib import Path

import can
import dahl
import pytest
from dahl import codec
from dahl.can import pytest_plugin, rig
from dahl.codec import EncoderState, FrictionTorque, Param, ParamReply, ParamWrite, State, Write

BUSY_S = 30.0  # longest time to an answer, on a machine that emulates the bus
SHORT_S = 0.05  # a timeout to wait for
TABLE = (Path(__file__).parents[3] / "lib/node/fault_table.h").read_text()
ROWS = re.findall(r'ROW\((\w+), ".*?", "(.*?)", (\w+), "(\w+)", (true|false)\)', TABLE)
COUNTED = {name for row in ROWS for name in row[1].split(", ")}


def good(counter: int, count: int = 70) -> can.Message:
    return codec.pack(EncoderState(count, counter))


def invalid(counter: int) -> can.Message:
    return codec.pack(EncoderState(70, counter, valid=False))


def corrupt(counter: int) -> can.Message:
    message = good(counter)
    message.data[0] ^= 1
    return message


def changed(**fields: object) -> can.Message:
    message = good(1)
    for name, value in fields.items():
        setattr(message, name, value)
    return message


def with_max_step(counts: int) -> can.Message:
    return codec.pack(ParamWrite(Param.STEP, counts, Write.WRITE))


def with_timeout(seconds: float) -> can.Message:
    return codec.pack(ParamWrite.of_si(Param.TIMEOUT, seconds))


FIRST = good(0, 0)
THIRD_OF_OTHERS = (FIRST, good(9, 60), good(10, 65), good(11))
SILENT = (FIRST, State.STALE)  # a State: shorten the timeout and wait until the node has it
BACK = (*SILENT, with_timeout(BUSY_S), good(1, 60), good(2, 65))
PLAYS: dict[str, tuple[can.Message | State, ...]] = {
    "FIRST": (good(7),),
    "NEXT": (FIRST, good(1)),
    "GAP": (FIRST, good(3)),
    "LONG_GAP": (with_max_step(100), FIRST, good(8)),
    "AGAIN": (FIRST, good(0)),
    "OTHER": (FIRST, good(9)),
    "FAR": (with_max_step(10), FIRST, good(1, 70000)),
    "FAR_GAP": (with_max_step(10), FIRST, good(8, 70000)),
    "THIRD": THIRD_OF_OTHERS,
    "THIRD_FAR": (with_max_step(10), FIRST, good(1, 70000), good(2, 70005), good(3, 70010)),
    "THIRD_NEAR": (with_max_step(100), *THIRD_OF_OTHERS),
    "DISOWNED": (FIRST, invalid(1)),
    "DISOWNED_GAP": (FIRST, invalid(3)),
    "DISOWNED_FIRST": (invalid(1),),
    "BAD_CRC": (FIRST, corrupt(1)),
    "BAD_LENGTH": (FIRST, changed(dlc=7, data=good(1).data[:7])),
    "EXTENDED": (FIRST, changed(is_extended_id=True)),
    "REMOTE": (FIRST, changed(is_remote_frame=True, data=b"")),
    "FD": (FIRST, changed(is_fd=True)),
    "SILENCE": SILENT,
    "BACK_TWO": BACK,
    "BACK_THREE": (*BACK, good(3)),
}


@pytest.fixture(autouse=True)
def patient(monkeypatch):
    for module, name in ((pytest_plugin, "FIRST_ANSWER_TIMEOUT_S"), (rig, "ANSWER_TIMEOUT_S")):
        monkeypatch.setattr(module, name, BUSY_S)


@pytest.fixture
def dahl_node_settings():
    return {"timeout": BUSY_S, "max_step": 0}


def play(bus: can.BusABC, one: dahl.Node, beat: can.Message | State) -> list[FrictionTorque]:
    """Send a frame or wait for a state; return the torques that came before the node's next
    ParamReply.
    """
    torques = []
    bus.send(with_timeout(SHORT_S) if isinstance(beat, State) else beat)
    while isinstance(beat, State) and one.state != beat:
        time.sleep(SHORT_S)
    bus.send(codec.pack(ParamWrite(Param.FC)))
    while True:
        answer = bus.recv(BUSY_S)
        assert answer is not None
        if answer.is_error_frame:
            continue
        frame = codec.unpack(answer)
        if isinstance(frame, FrictionTorque):
            torques.append(frame)
        if isinstance(frame, ParamReply) and frame.param == Param.FC:
            return torques


def known(one: dahl.Node) -> dict[str, int]:
    """Counts of the node. A rig does not have all of them."""
    counts, found = one.counts, {}
    for name in COUNTED:
        try:
            found[name] = getattr(counts, name)
        except dahl.RunError:
            assert isinstance(counts, rig.RigCounts)
    return found


@pytest.mark.parametrize("row", [pytest.param(row, id=row[0]) for row in ROWS if row[0] in PLAYS])
def test_each_row_of_the_fault_table(dahl_bus, dahl_node, row):
    name, counted, state, bristle, answered = row
    *earlier, last = PLAYS[name]
    torques = [torque for beat in earlier for torque in play(dahl_bus, dahl_node, beat)]
    before = known(dahl_node)
    new = play(dahl_bus, dahl_node, last)
    after = known(dahl_node)
    grown = {one for one in before.keys() & after.keys() if after[one] > before[one]}
    assert grown == set(counted.split(", ")) & before.keys() & after.keys()
    assert dahl_node.state == State[state]
    assert len(new) == (answered == "true")
    if new:
        earlier_q30 = torques[-1].torque_q30 if torques else 0
        assert (new[0].torque_q30 != earlier_q30) == (bristle == "moved")


def test_the_rows_that_are_not_here_are_those_of_a_bus_off():
    assert {row[0] for row in ROWS} - PLAYS.keys() == {
        "GONE_OFF", "OFF_HELD", "OFF_BACK", "OFF_LATCHED",
    }  # fmt: skip
