# SPDX-License-Identifier: MIT
"""The node against python-can and autosar-e2e: what is foreign is counted and never used."""

from __future__ import annotations

import contextlib
import signal
import struct
import time
from collections.abc import Iterator
from pathlib import Path

import can
import cantools
import mpmath
import pytest
from e2e import p02
from loop_tools import SCENES, client, finished, serving

SIGMA0, FC, THETA = 50.0, 0.5, 2.0**-14
SCENE = f"[friction]\nsigma0 = {SIGMA0}\nFc = {FC}\ntheta_per_count = {THETA!r}\n"
PATIENT = "timeout_ms = 60000\n"  # of tests that are not about it: Python may be slow
IDS = bytes(0x30 | counter for counter in range(16))
STATES = {"OK": 0, "Repeated": 1, "Lost": 2, "WrongSequence": 3, "Crc": 4, "Stale": 5, "Init": 6}


class Encoder:
    """An encoder of its own: frames by cantools and autosar-e2e, torque in closed form."""

    def __init__(self, bus: can.BusABC, database: cantools.database.Database) -> None:
        self.bus, self.database = bus, database
        self.number = 0  # of the node
        self.w = mpmath.mpf(0)
        self.count = 0

    def frame(self, counter: int, count: int, **changes) -> can.Message:
        message = self.database.get_message_by_name("EncoderState")
        signals = {"Crc": 0, "Counter": (counter - 1) % 16, "Valid": 1, "Count": count}
        data = bytearray(message.encode(signals))
        p02.e2e_p02_protect(data, IDS)  # counts the counter up
        fields = {
            "arbitration_id": message.frame_id | self.number,
            "data": data,
            "is_extended_id": False,
            **changes,
        }
        return can.Message(**fields)

    def move(self, count: int) -> None:
        """The travel that the node should integrate, in its one exponential."""
        travel = count - self.count
        sign = (travel > 0) - (travel < 0)
        gap = mpmath.exp(-mpmath.mpf(SIGMA0) / FC * THETA * abs(travel))
        self.w = sign - (sign - self.w) * gap if sign else self.w
        self.count = count

    def answer(self) -> dict | None:
        """The next FrictionTorque, decoded; None if there is none in time."""
        until = time.monotonic() + 2
        while (message := self.bus.recv(2)) is not None and time.monotonic() < until:
            if message.arbitration_id == 0x110 | self.number:
                return self.database.decode_message("FrictionTorque", message.data)
        return None

    def good(self, counter: int, count: int, state: str = "OK", used: bool = True) -> None:
        """Send a frame that must be answered, and check the answer."""
        self.bus.send(self.frame(counter, count))
        if used:
            self.move(count)
        self.count = count
        answer = self.answer()
        assert answer is not None
        assert (str(answer["State"]), answer["EchoCounter"]) == (state, counter)
        assert abs(answer["TorqueRatio"] - self.w) < 9.4e-10


@contextlib.contextmanager
def node(folder: Path, dbc: Path, extra: str = "") -> Iterator[tuple[Encoder, object]]:
    """A served node, and an encoder that speaks to it; the summary is in the list afterwards."""
    (folder / "scene.ini").write_text(SCENE + ("" if "timeout" in extra else PATIENT) + extra)
    results = []
    with serving(folder, folder / "scene.ini", "--role", "node") as (process, port):
        with client(port) as bus:
            yield Encoder(bus, cantools.database.load_file(dbc)), results
        process.send_signal(signal.SIGTERM)
        results.append(finished(folder, process).summary)


def changed(message: can.Message, byte: int) -> can.Message:
    """The same frame with one byte inverted."""
    message.data[byte] ^= 0xFF
    return message


# What is sent between good frames 0 and 1, by the counter that it adds to.
FOREIGN = {
    "format": [
        lambda e: e.frame(1, 900, data=bytes(e.frame(1, 900).data)[:7]),
        lambda e: e.frame(1, 900, data=b""),
        lambda e: e.frame(1, 900, is_extended_id=True),
        lambda e: e.frame(1, 900, data=bytes(12), is_fd=True),
    ],
    "crc": [lambda e: changed(e.frame(1, 900), 0), lambda e: changed(e.frame(1, 900), 5)],
    "repeated": [lambda e: e.frame(0, 900)],
    "wrong_sequence": [lambda e: e.frame(4, 900), lambda e: e.frame(15, 900)],
    "ignored": [
        lambda e: e.frame(1, 900, arbitration_id=0x101),
        lambda e: e.frame(1, 900, arbitration_id=0x110),
        lambda e: e.frame(1, 900, arbitration_id=1 << 28 | 0x100, is_extended_id=True),
    ],
    "garbage": [lambda e: e.frame(1, 900, data=None, dlc=8, is_remote_frame=True)],
}


@pytest.mark.parametrize("counter", FOREIGN)
def test_foreign_frames_are_counted_and_not_used(tmp_path, dbc, counter):
    with node(tmp_path, dbc) as (encoder, results):
        encoder.good(0, 100, state="Init", used=False)
        for make in FOREIGN[counter]:
            encoder.bus.send(make(encoder))
        encoder.good(1, 140)
        encoder.good(2, 133)
    summary = results[0]
    counts = {**summary["node"], "garbage": summary["bus_counts"]["garbage"]}
    seen = {key: value for key, value in counts.items() if value}
    assert seen == {"ok": 3, counter: len(FOREIGN[counter])}


def test_lost_frames_cost_nothing_and_a_gap_is_a_new_start(tmp_path, dbc):
    with node(tmp_path, dbc) as (encoder, results):
        encoder.good(3, -50, state="Init", used=False)
        encoder.good(5, 10, state="Lost")
        encoder.good(8, 60, state="Lost")
        encoder.bus.send(encoder.frame(15, 4000))
        encoder.bus.send(encoder.frame(0, 4000))
        encoder.good(1, 4001, state="WrongSequence", used=False)
        encoder.good(2, 3990)
    assert results[0]["node"]["lost"] == 3
    assert results[0]["node"]["wrong_sequence"] == 3


def test_silence_makes_it_stale_and_the_status_tells(tmp_path, dbc):
    with node(tmp_path, dbc, "timeout_ms = 150\n[status]\nperiod_ms = 50\n") as (encoder, results):
        encoder.good(0, 0, state="Init", used=False)
        encoder.good(1, 25)
        for _ in range(100):
            message = encoder.bus.recv(2)
            status = encoder.database.decode_message("Status", message.data)
            if str(status["State"]) == "Stale":
                break
        assert (str(status["State"]), str(status["ErrorStale"]), status["OutOfStep"]) == (
            "Stale",
            "Seen",
            1,
        )
        encoder.bus.send(encoder.frame(2, 6000))
        encoder.bus.send(encoder.frame(3, 6500))
        encoder.good(4, 7000, state="Stale", used=False)
        encoder.good(5, 7010)
    assert results[0]["node"]["stale"] == 1


def test_a_running_loop_does_not_take_foreign_answers_for_its_own(tmp_path):
    options = ("--wait-clients", "1", "--seconds", "2")
    with (
        serving(tmp_path, SCENES / "steering.ini", *options) as (process, port),
        client(port) as bus,
    ):
        for i in range(200):
            bus.send(
                can.Message(
                    arbitration_id=0x110,
                    data=struct.pack("<8B", *[i % 256] * 8),
                    is_extended_id=False,
                )
            )
            bus.recv(0.005)
        result = finished(tmp_path, process)
    assert result.summary["frames_lost"] == 0
    assert result.summary["frames_answered"] == 2000
    assert result.summary["answers_corrupt"] > 190


def asked(encoder: Encoder, message: str, **signals) -> dict:
    """What the node answers to a frame of this kind, decoded by the DBC."""
    kinds = {"ParamWrite": ("ParamReply", 0x60), "Reset": ("Status", 0xA0)}
    answer, ids = kinds[message]
    request = encoder.database.get_message_by_name(message)
    data = bytearray(request.encode({"Crc": 0, "Counter": 15, **signals}, strict=False))
    p02.e2e_p02_protect(data, bytes(ids | counter for counter in range(16)))
    encoder.bus.send(can.Message(arbitration_id=request.frame_id, data=data, is_extended_id=False))
    while (said := encoder.bus.recv(2)) is not None:
        name = encoder.database.get_message_by_frame_id(said.arbitration_id).name
        if name == answer:
            return encoder.database.decode_message(name, said.data)
    raise AssertionError(f"no answer to {message}")


def test_parameters_by_the_dbc_alone(tmp_path, dbc):
    """Defaults as its start values say; a joint write; a parameter that there is not."""
    with node(tmp_path, dbc, "[status]\nperiod_ms = 100\n") as (encoder, results):
        write = encoder.database.get_message_by_name("ParamWrite")
        for name in ("Gain", "Limit", "Ramp", "MaxStep", "StatusPeriod"):
            said = asked(encoder, "ParamWrite", Write="Read", Param=name, **{name: 0})
            assert said[name] == (write.get_signal_by_name(name).initial or 0), name
        asked(encoder, "ParamWrite", Write="Hold", Param="Fc", Fc=2 * FC)
        said = asked(encoder, "ParamWrite", Write="Read", Param="Fc", Fc=0)
        assert said["Fc"] == FC
        asked(encoder, "ParamWrite", Write="Write", Param="Sigma0", Sigma0=2 * SIGMA0)
        said = asked(encoder, "ParamWrite", Write="Read", Param="Fc", Fc=0)
        assert said["Fc"] == 2 * FC
        data = bytearray([0, 0x0F, 77, 0, 0, 0, 0, 0])
        p02.e2e_p02_protect(data, bytes(0x60 | counter for counter in range(16)))
        encoder.bus.send(can.Message(arbitration_id=0x130, data=data, is_extended_id=False))
        while (said := encoder.bus.recv(2)).arbitration_id != 0x140:
            pass
        said = encoder.database.decode_message("ParamReply", said.data)
        assert (said["Result"], said["Param"], said["Asked"]) == ("Unknown", "None", 77)
    assert {name: results[0]["node"][name] for name in ("params", "ignored")} == {
        "params": 10,
        "ignored": 0,
    }


@pytest.mark.parametrize("what", ["Errors", "Restart"])
def test_a_clients_reset_clears_status_and_not_the_summary(tmp_path, dbc, what):
    with node(tmp_path, dbc) as (encoder, results):
        encoder.good(0, 0, state="Init", used=False)
        encoder.bus.send(changed(encoder.frame(1, 900), 0))
        encoder.good(2, 40, state="Lost")
        said = asked(encoder, "Reset", What=what)
        assert (said["Lost"], said["Corrupt"], str(said["ErrorCrc"])) == (0, 0, "None")
    counts = results[0]["node"]
    assert {name: counts[name] for name in ("ok", "lost", "crc", "resets")} == {
        "ok": 2,
        "lost": 1,
        "crc": 1,
        "resets": 1,
    }
