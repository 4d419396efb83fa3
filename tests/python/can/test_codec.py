# SPDX-License-Identifier: MIT
"""Frames of a node by dahl.codec, which packs them with the C of dahl_frames.h, against the DBC
(cantools) and autosar-e2e. Then what dahl.codec refuses, and the DBC itself.
"""

import itertools
import pickle
from pathlib import Path
from typing import Any

import can
import cantools
import dahl
import pytest
from dahl import InputError, codec
from dahl.codec import Param, Result, State, What, Write
from e2e import p02
from hypothesis import given, settings
from hypothesis import strategies as st

DATA_IDS = {  # high half of the data id of each frame
    "EncoderState": 0x3,
    "FrictionTorque": 0xC,
    "Status": 0x5,
    "ParamWrite": 0x6,
    "ParamReply": 0x9,
    "Reset": 0xA,
}
FRAMES = {name: getattr(codec, name) for name in DATA_IDS}
ERRORS = ("Format", "Repeated", "Lost", "Sequence", "Crc", "Stale", "Invalid", "Jump")
PARAMS = ["Sigma0", "Fc", "ThetaPerCount", "Gain", "Limit", "Ramp", "Timeout", "MaxStep"]
PARAMS += ["StatusPeriod", "Model", "Load"]
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


def frames(kind: str) -> st.SearchStrategy[codec.Frame]:
    fields = {
        name: st.integers(*limit) if isinstance(limit, tuple) else st.sampled_from(limit)
        for name, limit in FIELDS[kind].items()
    }
    return st.builds(FRAMES[kind], **fields)


@pytest.fixture(scope="module")
def database(dbc: Path) -> cantools.database.Database:
    return cantools.database.load_file(dbc)


def protected(kind: str, data: bytes) -> bytes:
    """Set the CRC for the counter in the data."""
    changed = bytearray(data)
    changed[1] = changed[1] & 0xF0 | (changed[1] - 1) & 15  # protect counts up
    ids = bytes(DATA_IDS[kind] << 4 | counter for counter in range(16))
    p02.e2e_p02_protect(changed, ids)
    return bytes(changed)


def signals_of(kind: str, frame: Any) -> dict[str, int]:
    named = {name.title().replace("_", ""): int(getattr(frame, name)) for name in FIELDS[kind]}
    if kind == "FrictionTorque":
        named |= {"TorqueRatio": frame.torque_q30, "EchoCounter": frame.echo}
    if kind.startswith("Param"):
        named[PARAMS[frame.param]] = frame.value
    if kind == "Status":
        named |= {f"Error{name}": frame.errors >> bit & 1 for bit, name in enumerate(ERRORS)}
    return {"Crc": 0, **named}


def encoded(database: cantools.database.Database, kind: str, frame: Any) -> bytes:
    message = database.get_message_by_name(kind)
    return protected(kind, message.encode(signals_of(kind, frame), scaling=False, strict=False))


@pytest.mark.parametrize("kind", FIELDS)
@settings(max_examples=150)
@given(data=st.data())
def test_frames_are_those_of_the_dbc_protected_by_autosar_e2e(database, kind, data):
    """A frame with any bit changed is refused."""
    frame, number = data.draw(frames(kind)), data.draw(st.integers(0, 15))
    wanted, identifier = encoded(database, kind, frame), FRAMES[kind].base + number
    packed = codec.pack(frame, number)
    assert identifier == database.get_message_by_name(kind).frame_id + number
    assert (packed.arbitration_id, packed.dlc) == (identifier, 8)
    assert bytes(packed.data) == codec.to_bytes(frame) == wanted
    assert not packed.is_extended_id and not packed.is_rx
    assert codec.unpack(packed, type(frame)) == codec.unpack(packed) == frame
    assert codec.from_bytes(identifier, bytearray(wanted)) == frame
    plain = type(frame)(**{name: int(getattr(frame, name)) for name in FIELDS[kind]})
    assert repr(plain) == repr(codec.unpack(packed)) == repr(frame)  # enumerations have names
    assert pickle.loads(pickle.dumps(frame)) == frame and hash(frame) == hash(plain)
    assert codec.is_whole(identifier, wanted) and not codec.is_whole(0x7F0, wanted)
    spoiled = bytearray(wanted)
    spoiled[data.draw(st.integers(0, 7))] ^= 1 << data.draw(st.integers(0, 7))
    assert not codec.is_whole(identifier, spoiled)
    with pytest.raises(InputError, match=f"^{kind} 0x1[0-5][0-9a-f]: CRC 0x"):
        codec.from_bytes(identifier, spoiled)


def test_the_crc_detects_the_documented_bit_errors():
    """Each single and double one. Of 41,664 triples it misses 48, all with bits of the counter."""
    good = int.from_bytes(codec.to_bytes(codec.EncoderState(0x12345678, 9)), "little")
    bits, counter = [1 << k for k in range(64)], 0xF00

    def is_missed(mask: int) -> bool:
        return codec.is_whole(0x100, (good ^ mask).to_bytes(8, "little"))

    assert not any(is_missed(a | b) for a, b in itertools.product(bits, bits))
    missed = [sum(triple) for triple in itertools.combinations(bits, 3) if is_missed(sum(triple))]
    assert len(missed) == 48 and all(mask & counter for mask in missed)


@pytest.mark.parametrize("kind", FIELDS)
def test_a_field_accepts_its_limits_and_names_what_is_beyond(kind):
    fields = {name: limit[0] for name, limit in FIELDS[kind].items()}
    for name, limit in FIELDS[kind].items():
        ends = limit if isinstance(limit, tuple) else (min(limit), max(limit))
        for value in ends:
            assert getattr(FRAMES[kind](**fields | {name: value}), name) == value
        for value in (ends[0] - 1, ends[1] + 1, 0.5, None, "x"):
            if name == "param" and value == ends[1] + 1:
                continue  # a client may ask for any; the node answers that it has none
            wrong = InputError if isinstance(value, (int, float)) else TypeError
            with pytest.raises(wrong, match=f"{name} = "):
                FRAMES[kind](**fields | {name: value})
    with pytest.raises(TypeError, match=f"{kind}.*'x'"):
        FRAMES[kind](**fields, x=2)


def test_units_are_those_of_the_dbc(database):
    """Parameters to the nearest step, a ratio, and a timeout, in SI as cantools decodes them."""
    message = database.get_message_by_name("ParamWrite")
    for signal in message.signals[4:]:
        (number,) = signal.multiplexer_ids
        step = float(signal.scale) * {"ms": 1e-3}.get(signal.unit, 1.0)
        assert codec.UNITS[number] == pytest.approx(step, rel=1e-12)
        for steps, raw in ((2559.6, 2560), (2560.4, 2560), (0, 0), (2**32 - 1, 2**32 - 1)):
            write = codec.ParamWrite.of_si(number, steps * step, Write.HOLD, counter=7)
            assert write == codec.ParamWrite(number, raw, Write.HOLD, 7)
            assert write.si == pytest.approx(raw * step), signal.name
        if Param(number) not in (Param.STEP, Param.STATUS):  # their 0 switches something off
            assert codec.ParamWrite.of_si(number, 0.4 * step).value == 0
        with pytest.raises(InputError, match=f"{Param(number).name} is outside 0 .. "):
            codec.ParamWrite.of_si(number, (2**32 - 0.4) * step)
    torque = codec.FrictionTorque(-123456789)
    decoded = database.decode_message("FrictionTorque", codec.to_bytes(torque))
    assert torque.ratio == decoded["TorqueRatio"]
    status = codec.Status(1, State.OK, codec.Errors(0), 0, 0, 0, 0, 2, 25)
    decoded = database.decode_message("Status", codec.to_bytes(status))
    assert status.timeout_s == pytest.approx(decoded["Timeout"] / 1000)


@pytest.mark.parametrize(
    "name", ["Gain", "Limit", "Ramp", "Timeout", "MaxStep", "StatusPeriod", "Load"]
)
def test_a_parameter_of_a_node_has_the_default_and_the_limits_of_the_dbc(database, name):
    signal = database.get_message_by_name("ParamWrite").get_signal_by_name(name)
    ends = (signal.minimum, signal.maximum, signal.initial)
    least, most, default = (round((value or 0) / signal.scale) for value in ends)
    node, number = dahl.Node(dahl.Loaded(dahl.Plan(100, 0.5, 1e-4))), signal.multiplexer_ids[0]

    def answer_to(value: int, write: Write) -> codec.ParamReply:
        return codec.unpack(node.receive(codec.pack(codec.ParamWrite(number, value, write))))

    assert answer_to(0, Write.READ).value == default
    for value in (least, most):
        reply = answer_to(value, Write.WRITE)
        assert (reply.value, reply.result) == (value, Result.DONE)
    for value in (most + 1, *range(least)):
        assert answer_to(value, Write.WRITE).result == Result.OUT_OF_RANGE


# --- refusals -------------------------------------------------------------------------------------

GOOD = codec.to_bytes(codec.EncoderState(5))


def message(**changes: Any) -> can.Message:
    return can.Message(**{"arbitration_id": 0x100, "is_extended_id": False, "data": GOOD} | changes)


def shortened() -> can.Message:
    one = message()
    one.dlc = 4
    return one


of_si = codec.ParamWrite.of_si
TORQUE = "FrictionTorque 0x110: "
REFUSED = [
    (lambda: codec.from_bytes(0x100, GOOD[:7]), "EncoderState 0x100: 7 .*8"),
    (lambda: codec.from_bytes(0x100, GOOD + b"1"), "EncoderState 0x100: 9 .*8"),
    (lambda: codec.unpack(shortened()), "EncoderState 0x100: 4 .*8"),
    (lambda: codec.from_bytes(0x110, GOOD), f"{TORQUE}CRC {GOOD[0]:#04x}, "),
    (lambda: codec.from_bytes(0x160, GOOD), "0x160.*0x100 to 0x15f"),
    (lambda: codec.from_bytes(0x800, GOOD), "identifier = 2048"),
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
    (lambda: codec.unpack(message(), codec.Status), "EncoderState 0x100: Status"),
    (lambda: codec.pack(codec.EncoderState(1), 16), "node = 16"),
    (lambda: of_si(Param.FC, -1), "value = -1 of parameter FC .*0 .. 4096"),
    (lambda: of_si(Param.STATUS, 4e-4), "value = 0.0004 of parameter STATUS .*0.001"),
    (lambda: of_si(Param.STEP, 0.4), "value = 0.4 of parameter STEP .* step of 1"),
]


@pytest.mark.parametrize(("call", "complaint"), REFUSED)
def test_a_refusal_is_one_line_with_value_and_limit(call, complaint):
    with pytest.raises(InputError, match=complaint) as caught:
        call()
    assert "\n" not in str(caught.value)


WRONG_TYPES = [
    (lambda: codec.from_bytes(0x100, "12345678"), "data = '12345678'"),
    (lambda: codec.unpack(GOOD), "message = b'"),
    (lambda: codec.unpack(message(), int), "kind = <class 'int'>"),
    (lambda: codec.pack(GOOD), "frame = b'"),
    (lambda: codec.EncoderState("5"), "count = '5'"),
    (lambda: codec.EncoderState(5, turn=1), "turn"),
    (lambda: of_si(Param.FC, "1"), "value = '1'"),
]


@pytest.mark.parametrize(("call", "complaint"), WRONG_TYPES)
def test_a_wrong_type_is_a_type_error(call, complaint):
    with pytest.raises(TypeError, match=complaint):
        call()


# --- what derives from the DBC --------------------------------------------------------------------

SAME = ("multiplexer_ids", "start", "length", "is_signed", "scale", "minimum", "maximum", "unit")
SAME += ("choices", "initial")


def test_the_dbc_has_whole_frames_with_one_sender_and_ranges_that_fit(database):
    for one in database.messages:
        (receiver,) = {"Encoder", "FrictionNode"} - {*one.senders}
        assert all(signal.receivers == [receiver] for signal in one.signals)
        assert (one.length, one.is_extended_frame) == (8, False)
        assert one.frame_id == FRAMES[one.name].base
        one.refresh(strict=True)  # raises on overlap or signals past the end
        for signal in one.signals:
            top = (2 ** (signal.length - signal.is_signed) - 1) * signal.scale
            assert signal.maximum <= top or signal.name == "TorqueRatio", signal.name
    ratio = database.get_message_by_name("FrictionTorque").get_signal_by_name("TorqueRatio")
    assert (ratio.minimum, ratio.maximum, ratio.scale) == (-1, 1, 2.0**-30)


def test_request_and_reply_of_a_parameter_have_one_number_unit_and_range(database):
    request, reply = map(database.get_message_by_name, ("ParamWrite", "ParamReply"))
    for signal in request.signals[4:]:
        twin = reply.get_signal_by_name(signal.name)
        assert [getattr(twin, what) for what in SAME] == [getattr(signal, what) for what in SAME]
        for one in (request, reply):
            choices = one.get_signal_by_name("Param").choices
            assert [str(choices[number]) for number in signal.multiplexer_ids] == [signal.name]
