# SPDX-License-Identifier: MIT
"""The frames of a node, by the C of dahl_frames.h and by dahl.codec, against the DBC (cantools) and
autosar-e2e; what dahl.codec refuses; and the DBC itself.
"""

from __future__ import annotations

import ctypes
import pickle
import random
import re
from pathlib import Path
from typing import Any

import can
import cantools
import dahl
import pytest
from codec_tools import KINDS, PARAMS, EncoderState, Frame, data_ids, signals_of
from conftest import built
from dahl import Error, codec
from dahl.codec import Param, Result, State, What, Write
from e2e import p02

pytestmark = pytest.mark.usefixtures("library")

ROUNDS = 1500


@pytest.fixture(scope="module")
def database(dbc: Path) -> cantools.database.Database:
    return cantools.database.load_file(dbc)


def protected(kind: str, data: bytes) -> bytes:
    """With the counter that it has, and the CRC that goes with it."""
    changed = bytearray(data)
    changed[1] = changed[1] & 0xF0 | (changed[1] - 1) & 15  # protect counts up
    p02.e2e_p02_protect(changed, data_ids(kind))
    return bytes(changed)


def encoded(database: cantools.database.Database, kind: str, values: Any) -> bytes:
    message, signals = database.get_message_by_name(kind), signals_of(kind, values, 0)
    return protected(kind, message.encode(signals, scaling=False, strict=False))


# --- the C, with any raw values that its structures can hold --------------------------------------


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
MOST = {"torque_q30": 2**31, "value": 2**32, "count": 2**31, "param": len(PARAMS), "write": 4}
MOST |= {"errors": 256, "lost": 256, "corrupt": 256, "out_of_step": 256, "timeout": 256, "valid": 2}


def random_struct(kind: str, rng: random.Random) -> ctypes.Structure:
    """Any values that the signals can hold, corners more often than chance would have it."""
    made = STRUCTS[kind]()
    for name, _ in made._fields_:
        most = MOST.get(name, 16)
        least = -most if name in ("count", "torque_q30") else 0
        setattr(made, name, rng.choice([least, most - 1, rng.randrange(least, most)]))
    return made


@pytest.mark.parametrize("kind", KINDS)
def test_c_and_dbc_agree_bit_for_bit(database, kind):
    """Both ways; and what autosar-e2e did not protect, or one bit has changed of, is refused."""
    c, name = ctypes.CDLL(str(built("tests", "port", "libdahl_frames.so"))), KINDS[kind][0]
    pack, unpack = (getattr(c, f"dahl_frames_{way}_{name}") for way in ("pack", "unpack"))
    rng, base = random.Random(kind), database.get_message_by_name(kind).frame_id
    for _ in range(ROUNDS):
        values, back, number = random_struct(kind, rng), STRUCTS[kind](), rng.randrange(16)
        frame = Frame()
        pack(ctypes.byref(frame), ctypes.c_uint8(number), ctypes.byref(values))
        assert (frame.id, frame.length) == (base + number, 8)
        assert bytes(frame.data) == encoded(database, kind, values)
        assert unpack(ctypes.byref(frame), ctypes.byref(back)) == 0 and bytes(back) == bytes(values)
        frame.data[rng.randrange(8)] ^= 1 << rng.randrange(8)
        assert unpack(ctypes.byref(frame), ctypes.byref(back)) == -2
        assert bytes(back) == bytes(values)


# --- dahl.codec -----------------------------------------------------------------------------------

FRAMES = {name: getattr(codec, name) for name in KINDS}
NIBBLE, BYTE, I32, U32 = (0, 15), (0, 255), (-(2**31), 2**31 - 1), (0, 2**32 - 1)
KNOWN = [param for param in Param if param != Param.NONE]
FIELDS: dict[str, dict[str, Any]] = {  # of each frame: least and most, or all values
    "EncoderState": {"count": I32, "counter": NIBBLE, "valid": [False, True]},
    "FrictionTorque": {"torque_q30": (-(2**30), 2**30), "counter": NIBBLE, "state": [*State]}
    | {"echo": NIBBLE},
    "Status": {"counter": NIBBLE, "state": [*State], "errors": [*map(codec.Errors, range(256))]}
    | dict.fromkeys(("lost", "corrupt", "out_of_step", "timeout"), BYTE)
    | dict.fromkeys(("version_major", "version_minor"), NIBBLE),
    "ParamWrite": {"param": KNOWN, "value": U32, "write": [*Write], "counter": NIBBLE},
    "ParamReply": {"param": KNOWN, "value": U32, "result": [*Result], "counter": NIBBLE},
    "Reset": {"what": [*What], "counter": NIBBLE},
}


def any_of(kind: str, rng: random.Random) -> codec.Frame:
    """A frame of this kind with any values, corners more often than chance would have it."""
    values = {
        name: rng.choice([*limit, rng.randint(*limit)] if isinstance(limit, tuple) else limit)
        for name, limit in FIELDS[kind].items()
    }
    return FRAMES[kind](**values)


@pytest.mark.parametrize("kind", KINDS)
def test_frames_are_those_of_the_dbc_protected_by_autosar_e2e(database, kind):
    rng, base = random.Random(kind), database.get_message_by_name(kind).frame_id
    for _ in range(300):
        frame, number = any_of(kind, rng), rng.randrange(16)
        data = encoded(database, kind, frame)
        packed = codec.pack(frame, number)
        assert (packed.arbitration_id, packed.dlc) == (base + number, 8)
        assert bytes(packed.data) == codec.to_bytes(frame) == data
        assert not packed.is_extended_id and not packed.is_rx
        assert codec.unpack(packed, type(frame)) == codec.unpack(packed) == frame
        assert codec.from_bytes(base + number, bytearray(data)) == frame
        assert pickle.loads(pickle.dumps(frame)) == frame and hash(frame) == hash(frame)
        assert codec.is_whole(base + number, data) and not codec.is_whole(0x7F0, data)
        spoiled = bytearray(data)
        spoiled[rng.randrange(8)] ^= 1 << rng.randrange(8)
        assert not codec.is_whole(base + number, spoiled)
        with pytest.raises(Error, match=f"^{kind} 0x1[0-5][0-9a-f]: CRC 0x"):
            codec.from_bytes(base + number, spoiled)


@pytest.mark.parametrize("kind", KINDS)
def test_a_field_has_its_limits(kind):
    """Which are taken, and beyond which it is named."""
    good = any_of(kind, random.Random(1))
    values = {name: getattr(good, name) for name in FIELDS[kind]}
    for name, limit in FIELDS[kind].items():
        ends = limit if isinstance(limit, tuple) else (min(limit), max(limit))
        for value in ends:
            assert getattr(FRAMES[kind](**values | {name: value}), name) == value
        for value in (ends[0] - 1, ends[1] + 1, 0.5, None, "x"):
            if name == "param" and value == ends[1] + 1:
                continue  # any may be asked for: the node says that it is none
            with pytest.raises(Error, match=f"{name} = "):
                FRAMES[kind](**values | {name: value})
    with pytest.raises(Error, match=f"{kind}: x = 2"):
        FRAMES[kind](**values, x=2)


def test_units_are_those_of_the_dbc(database):
    """A parameter in SI is what cantools makes of it, to the nearest step; so are a ratio and a
    timeout.
    """
    message = database.get_message_by_name("ParamWrite")
    for number, name in message.get_signal_by_name("Param").choices.items():
        if str(name) not in {signal.name for signal in message.signals}:
            continue
        signal = message.get_signal_by_name(str(name))
        step = float(signal.scale) * {"ms": 1e-3}.get(signal.unit, 1.0)
        assert codec.UNITS[number] == pytest.approx(step, rel=1e-12)
        for steps, raw in ((2559.6, 2560), (2560.4, 2560), (0, 0), (2**32 - 1, 2**32 - 1)):
            asked = codec.ParamWrite.of_si(number, steps * step, Write.HOLD, counter=7)
            assert asked == codec.ParamWrite(number, raw, Write.HOLD, 7)
            assert asked.si == pytest.approx(raw * step), name
        if Param(number) not in (
            Param.STEP,
            Param.STATUS,
        ):  # a part or a stiffness of nearly 0 is 0
            assert codec.ParamWrite.of_si(number, 0.4 * step).value == 0
        with pytest.raises(Error, match=f"{Param(number).name} is outside 0 .. "):
            codec.ParamWrite.of_si(number, (2**32 - 0.4) * step)
    torque = codec.FrictionTorque(-123456789)
    decoded = database.decode_message("FrictionTorque", codec.to_bytes(torque))
    assert torque.ratio == decoded["TorqueRatio"]
    status = codec.Status(1, State.OK, codec.Errors(0), 0, 0, 0, 0, 2, 25)
    decoded = database.decode_message("Status", codec.to_bytes(status))
    assert status.timeout_s == pytest.approx(decoded["Timeout"] / 1000)


@pytest.mark.parametrize("name", ["Gain", "Limit", "Ramp", "Timeout", "MaxStep"]
                         + ["StatusPeriod", "Load"])  # fmt: skip
def test_a_node_starts_and_ends_where_the_dbc_says(database, name):
    signal = database.get_message_by_name("ParamWrite").get_signal_by_name(name)
    ends = (signal.minimum, signal.maximum, signal.initial)
    least, most, start = (round((value or 0) / signal.scale) for value in ends)
    node, number = dahl.Node(dahl.Loaded(dahl.Plan(100, 0.5, 1e-4))), signal.multiplexer_ids[0]

    def asked(value: int, write: Write) -> codec.ParamReply:
        return codec.unpack(node.receive(codec.pack(codec.ParamWrite(number, value, write))))

    assert asked(0, Write.READ).value == start
    for value in (least, most):
        said = asked(value, Write.WRITE)
        assert (said.value, said.result) == (value, Result.DONE)
    for value in (most + 1, *range(least)):
        assert asked(value, Write.WRITE).result == Result.OUT_OF_RANGE


GOOD = codec.to_bytes(codec.EncoderState(5))


def message(**changes: Any) -> can.Message:
    return can.Message(**{"arbitration_id": 0x100, "is_extended_id": False, "data": GOOD} | changes)


def shortened() -> can.Message:
    """As long as it says, not as its data are."""
    one = message()
    one.dlc = 4
    return one


of_si = codec.ParamWrite.of_si
TORQUE = "FrictionTorque 0x110: "
REFUSED = [
    (lambda: codec.from_bytes(0x100, GOOD[:7]), "EncoderState 0x100: 7 .*8"),
    (lambda: codec.from_bytes(0x105, b""), "EncoderState 0x105: 0 .*8"),
    (lambda: codec.from_bytes(0x100, GOOD + b"1"), "EncoderState 0x100: 9 .*8"),
    (lambda: codec.unpack(shortened()), "EncoderState 0x100: 4 .*8"),
    (lambda: codec.from_bytes(0x110, GOOD), f"{TORQUE}CRC {GOOD[0]:#04x}, "),
    (lambda: codec.from_bytes(0x160, GOOD), "0x160.*0x100 to 0x15f"),
    (lambda: codec.from_bytes(0x800, GOOD), "identifier = 2048"),
    (lambda: codec.from_bytes(0x100, 8), "data = 8"),
    (lambda: codec.from_bytes(0x100, "12345678"), "data = '12345678'"),
    (
        lambda: codec.from_bytes(0x110, protected("FrictionTorque", bytes([0, 0x90, *bytes(6)]))),
        f"{TORQUE}state = 9 .*6 INIT",
    ),
    (
        lambda: codec.from_bytes(0x110, protected("FrictionTorque", b"\0\0\0\0\1\0\0\x40")),
        f"{TORQUE}torque_q30 = 1073741825",
    ),
    (lambda: codec.unpack(message(is_extended_id=True)), "EncoderState 0x100: .*extended"),
    (lambda: codec.unpack(message(is_remote_frame=True, data=None, dlc=8)), "0x100: .*remote"),
    (lambda: codec.unpack(message(is_fd=True)), "0x100: .*CAN FD"),
    (lambda: codec.unpack(message(is_error_frame=True)), "0x100: .*error"),
    (lambda: codec.unpack(GOOD), "message = b'"),
    (lambda: codec.unpack(message(), codec.Status), "EncoderState 0x100: Status"),
    (lambda: codec.unpack(message(), int), "kind = <class 'int'>"),
    (lambda: codec.pack(GOOD), "frame = b'"),
    (lambda: codec.pack(codec.EncoderState(1), 16), "node = 16"),
    (lambda: of_si(Param.FC, -1), "value = -1 of parameter FC .*0 .. 4096"),
    (lambda: of_si(Param.FC, float("nan")), "value = nan"),
    (lambda: of_si(Param.STATUS, 4e-4), "value = 0.0004 of parameter STATUS .*0.001"),
    (lambda: of_si(Param.STEP, 0.4), "value = 0.4 of parameter STEP .* step of 1"),
]


@pytest.mark.parametrize(("call", "complaint"), REFUSED)
def test_a_refusal_is_one_line_with_value_and_limit(call, complaint):
    with pytest.raises(Error, match=complaint) as caught:
        call()
    assert "\n" not in str(caught.value)


# --- the DBC --------------------------------------------------------------------------------------

CYCLES = {  # of each message: ms from one to the next, send type, sender
    "EncoderState": (1, "Cyclic", "Encoder"),
    "FrictionTorque": (1, "OnReception", "FrictionNode"),
    "Status": (100, "Cyclic", "FrictionNode"),
    "ParamWrite": (None, "OnRequest", "Encoder"),
    "ParamReply": (None, "OnReception", "FrictionNode"),
    "Reset": (None, "OnRequest", "Encoder"),
}
CHOICES = [
    ("EncoderState", "Valid", ["Invalid", "Valid"]),
    ("FrictionTorque", "State", [state.name for state in State]),
    ("Status", "State", [state.name for state in State]),
    ("Status", "Error", ["None", "Seen"]),
    ("ParamWrite", "Write", ["Read", "Write", "Hold"]),
    ("ParamReply", "Result", ["Done", "OutOfRange", "Unknown"]),
    ("Reset", "What", ["", "Errors", "Restart"]),
]
BOUNDED = ("TorqueRatio", "Write", *PARAMS[PARAMS.index("Gain") :], "Param")  # by their meaning
SAME = ("multiplexer_ids", "start", "length", "is_signed", "scale", "minimum", "maximum", "unit")
SAME += ("choices", "initial")


def test_the_dbc_says_who_sends_what_and_how_often(dbc, database):
    """In 8 bytes of a standard frame without an overlap, and with no bit timing of its own."""
    found = {one.name: (one.cycle_time, one.send_type, *one.senders) for one in database.messages}
    assert found == CYCLES
    assert {one.name: one.frame_id for one in database.messages} == {
        name: kind.base for name, kind in FRAMES.items()
    }
    for one in database.messages:
        (receiver,) = {"Encoder", "FrictionNode"} - {*one.senders}
        assert all(signal.receivers == [receiver] for signal in one.signals)
        assert (one.length, one.is_extended_frame) == (8, False)
        one.refresh(strict=True)  # raises on overlap or signals past the end
    assert re.search(r"^BS_:\s*$", dbc.read_text(encoding="utf-8"), re.M)


def test_the_dbc_has_the_range_and_the_words_of_each_signal(database):
    for one in database.messages:
        for signal in one.signals:
            top = (2 ** (signal.length - signal.is_signed) - 1) * signal.scale
            assert signal.maximum <= top or signal.name == "TorqueRatio", signal.name
            if not signal.choices and signal.name not in BOUNDED:
                assert signal.maximum == top, signal.name
    ratio = database.get_message_by_name("FrictionTorque").get_signal_by_name("TorqueRatio")
    assert (ratio.minimum, ratio.maximum, ratio.scale) == (-1, 1, 2.0**-30)
    for kind, signals, names in CHOICES:
        for signal in database.get_message_by_name(kind).signals:
            if signal.name.startswith(signals):
                told = {int(code): str(name).upper() for code, name in signal.choices.items()}
                wanted = {k: name.upper().replace("_", "") for k, name in enumerate(names) if name}
                assert told == wanted, signal.name


def test_a_parameter_is_answered_as_it_is_asked(database):
    """Under one number, in one unit, within one range; and that number has its name."""
    request, reply = map(database.get_message_by_name, ("ParamWrite", "ParamReply"))
    for signal in request.signals[4:]:
        twin = reply.get_signal_by_name(signal.name)
        assert [getattr(twin, what) for what in SAME] == [getattr(signal, what) for what in SAME]
        for one in (request, reply):
            choices = one.get_signal_by_name("Param").choices
            assert [str(choices[number]) for number in signal.multiplexer_ids] == [signal.name]
