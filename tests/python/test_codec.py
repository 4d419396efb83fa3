# SPDX-License-Identifier: MIT
"""The C codec against the DBC (cantools), crccheck and autosar-e2e; and the DBC itself."""

from __future__ import annotations

import ctypes
import random
import re
from pathlib import Path
from typing import Any

import cantools
import pytest
from codec_tools import KINDS, PARAMS, EncoderState, Frame, data_ids, signals_of
from conftest import built
from crccheck.crc import Crc8Autosar
from e2e import p02

ROUNDS = 5000


def structure(*names: str, word: Any = None) -> type[ctypes.Structure]:
    """Of bytes; where there is a word, it is the first."""
    first, *others = [(name, ctypes.c_uint8) for name in names]
    head = (first[0], word) if word else first
    return type("Structure", (ctypes.Structure,), {"_fields_": [head, *others]})


COUNTS = ("lost", "corrupt", "out_of_step", "version_major", "version_minor", "timeout")
STRUCTS = {
    "EncoderState": EncoderState,
    "FrictionTorque": structure("torque_q30", "counter", "state", "echo", word=ctypes.c_int32),
    "Status": structure("counter", "state", "errors", *COUNTS),
    "ParamWrite": structure("value", "counter", "param", "write", word=ctypes.c_uint32),
    "ParamReply": structure("value", "counter", "param", "result", word=ctypes.c_uint32),
    "Reset": structure("counter", "what"),
}
ENDS = (["Encoder", "FrictionNode"], ["FrictionNode", "Encoder"])  # of a signal
# Signals whose range the meaning bounds, not the number of bits.
BOUNDED = ("TorqueRatio", "Write", *PARAMS[PARAMS.index("Gain") :], "Param")


@pytest.fixture(scope="module")
def codec() -> ctypes.CDLL:
    return ctypes.CDLL(str(built("tests", "port", "libdahl_frames.so")))


@pytest.fixture(scope="module")
def database(dbc: Path) -> cantools.database.Database:
    return cantools.database.load_file(dbc)


def random_struct(kind: str, rng: random.Random) -> ctypes.Structure:
    """Any values that the signals can hold, corners more often than chance would have it."""
    word = rng.choice([0, -1, 1, 2**31 - 1, -(2**31), rng.randrange(-(2**31), 2**31)])
    nibble, byte = lambda: rng.randrange(16), lambda: rng.randrange(256)
    if kind == "EncoderState":
        return EncoderState(word, nibble(), rng.random() < 0.5)
    if kind == "FrictionTorque":
        return STRUCTS[kind](word, nibble(), nibble(), nibble())
    if kind.startswith("Param"):
        high = rng.randrange(4) if kind == "ParamWrite" else nibble()
        return STRUCTS[kind](word & 0xFFFFFFFF, nibble(), rng.randrange(len(PARAMS)), high)
    if kind == "Reset":
        return STRUCTS[kind](nibble(), nibble())
    counts = [byte() for _ in range(4)]
    return STRUCTS[kind](nibble(), nibble(), *counts, nibble(), nibble(), byte())


def pack(codec: ctypes.CDLL, kind: str, values: ctypes.Structure, node: int = 0) -> Frame:
    frame = Frame()
    getattr(codec, f"dahl_frames_pack_{KINDS[kind][0]}")(
        ctypes.byref(frame), ctypes.c_uint8(node), ctypes.byref(values)
    )
    return frame


def unpack(codec: ctypes.CDLL, kind: str, frame: Frame, into: ctypes.Structure) -> int:
    return getattr(codec, f"dahl_frames_unpack_{KINDS[kind][0]}")(
        ctypes.byref(frame), ctypes.byref(into)
    )


def fields(values: ctypes.Structure) -> list[int]:
    return [getattr(values, name) for name, _ in values._fields_]


@pytest.mark.parametrize("kind", KINDS)
def test_c_and_dbc_agree_bit_for_bit(codec, database, kind):
    rng = random.Random(kind)
    message = database.get_message_by_name(kind)
    for _ in range(ROUNDS):
        values = random_struct(kind, rng)
        frame = pack(codec, kind, values)
        data = bytes(frame.data)
        assert frame.id == message.frame_id
        assert frame.length == message.length
        raw = signals_of(kind, values, data[0])
        assert message.encode(raw, scaling=False, strict=False) == data
        assert message.decode(data, scaling=False, decode_choices=False) == raw


@pytest.mark.parametrize("kind", KINDS)
def test_c_reads_what_the_dbc_writes(codec, database, kind):
    rng = random.Random(kind + "back")
    message = database.get_message_by_name(kind)
    for _ in range(ROUNDS):
        values, back = random_struct(kind, rng), STRUCTS[kind]()
        data = bytearray(message.encode(signals_of(kind, values, 0), scaling=False, strict=False))
        data[0] = Crc8Autosar.calc(data[1:] + data_ids(kind)[data[1] & 15 :][:1])
        frame = Frame(id=message.frame_id, length=8, data=(ctypes.c_uint8 * 8)(*data))
        assert unpack(codec, kind, frame, back) == 0
        assert fields(back) == fields(values)


@pytest.mark.parametrize("kind", KINDS)
def test_c_accepts_what_autosar_e2e_protects_and_nothing_else(codec, kind):
    rng = random.Random(kind + "protect")
    for _ in range(ROUNDS):
        data = bytearray(rng.randbytes(8))
        p02.e2e_p02_protect(data, data_ids(kind))
        frame = Frame(length=8, data=(ctypes.c_uint8 * 8)(*data))
        assert unpack(codec, kind, frame, STRUCTS[kind]()) == 0
        frame.data[rng.randrange(8)] ^= 1 << rng.randrange(8)
        assert unpack(codec, kind, frame, STRUCTS[kind]()) == -2


def test_node_number_is_the_low_half_of_the_id(codec, database):
    for kind in KINDS:
        base = database.get_message_by_name(kind).frame_id
        assert [pack(codec, kind, STRUCTS[kind](), node).id for node in range(16)] == list(
            range(base, base + 16)
        )


def test_dbc_ranges_are_what_the_raw_values_can_hold(database):
    for message in database.messages:
        for signal in message.signals:
            bits = signal.length - signal.is_signed
            top = (2**bits - 1) * signal.scale
            assert signal.maximum <= top or signal.name == "TorqueRatio", signal.name
            if not signal.choices and signal.name not in BOUNDED:
                assert signal.maximum == top, signal.name


def test_dbc_assigns_cycle_time_and_send_type_to_every_message(database):
    times = {message.name: message.cycle_time for message in database.messages}
    cyclic = {"EncoderState": 1, "FrictionTorque": 1, "Status": 100}
    assert times == {name: cyclic.get(name) for name in KINDS}
    types = {message.name: message.send_type for message in database.messages}
    assert types == {
        "EncoderState": "Cyclic",
        "FrictionTorque": "OnReception",
        "Status": "Cyclic",
        "ParamWrite": "OnRequest",
        "ParamReply": "OnReception",
        "Reset": "OnRequest",
    }
    senders = {
        one.name: one.senders for one in database.messages if one.senders != ["FrictionNode"]
    }
    assert senders == dict.fromkeys(("EncoderState", "ParamWrite", "Reset"), ["Encoder"])
    for message in database.messages:
        assert all([*one.receivers, *message.senders] in ENDS for one in message.signals), message


def test_dbc_names_every_state(database, root):
    header = (root / "lib" / "include" / "dahl_frames.h").read_text(encoding="utf-8")
    enum = re.search(r"typedef enum \{([^}]*)\} dahl_frames_state_t", header).group(1)
    codes = {
        name.replace("_", ""): int(code) for name, code in re.findall(r"FRAMES_(\w+) = (\d+)", enum)
    }
    for kind in ("FrictionTorque", "Status"):
        choices = database.get_message_by_name(kind).get_signal_by_name("State").choices
        assert {str(name).upper(): code for code, name in choices.items()} == codes


@pytest.mark.parametrize(
    ("kind", "signals", "names"),
    [
        ("EncoderState", "Valid", ["Invalid", "Valid"]),
        ("Status", "Error", ["None", "Seen"]),
        ("ParamWrite", "Write", ["Read", "Write", "Hold"]),
        ("ParamReply", "Result", ["Done", "OutOfRange", "Unknown"]),
        ("Reset", "What", ["", "Errors", "Restart"]),
    ],
)
def test_dbc_names_what_a_code_means(database, kind, signals, names):
    for signal in database.get_message_by_name(kind).signals:
        if signal.name.startswith(signals):
            choices = {int(code): str(name) for code, name in signal.choices.items()}
            assert choices == {code: name for code, name in enumerate(names) if name}, signal.name


def test_dbc_has_no_bit_timing_and_no_overlap(dbc, database):
    assert re.search(r"^BS_:\s*$", dbc.read_text(encoding="utf-8"), re.M)
    for message in database.messages:
        assert message.length == 8
        assert not message.is_extended_frame
        message.refresh(strict=True)  # raises on overlap or signals past the end
