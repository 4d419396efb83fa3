# SPDX-License-Identifier: MIT
"""dahl.codec against the DBC by cantools and against autosar-e2e, and what it refuses."""

from __future__ import annotations

import pickle
import random

import can
import cantools
import dahl
import pytest
from codec_tools import KINDS, data_ids, signals_of
from dahl import Error, codec
from e2e import p02

ROUNDS = 500
FRAMES = {kind.__name__: kind for kind in codec.KINDS.values()}


@pytest.fixture(scope="module")
def database(dbc):
    return cantools.database.load_file(dbc)


def any_of(kind: str, rng: random.Random) -> codec.Frame:
    """A frame of this kind with any values, corners more often than chance would have it."""
    values = {}
    for name, limit in FRAMES[kind]._limits.items():
        if isinstance(limit, tuple):
            values[name] = rng.choice([*limit, rng.randint(*limit)])
        elif limit is codec.Errors:
            values[name] = rng.randrange(256)
        else:
            known = [False, True] if limit is bool else list(limit)
            values[name] = rng.choice([one for one in known if one is not codec.Param.NONE])
    return FRAMES[kind](**values)


def test_every_message_of_the_dbc_has_a_frame(database):
    assert {one.name: one.frame_id for one in database.messages} == {
        name: kind.base for name, kind in FRAMES.items()
    }


@pytest.mark.parametrize("kind", KINDS)
def test_a_frame_is_whole_where_autosar_e2e_says_so(kind):
    """Of its own id at any node, with 8 bytes; any bit that flips is seen."""
    rng = random.Random(f"whole {kind}")
    identifier = FRAMES[kind].base + 7
    for _ in range(20):
        data = bytearray(rng.randbytes(8))
        p02.e2e_p02_protect(data, data_ids(kind))
        assert codec.is_whole(identifier, data) and codec.is_whole(identifier, bytes(data))
        assert not codec.is_whole(identifier, data[:7]) and not codec.is_whole(0x7F0, data)
        for bit in range(64):
            flipped = bytearray(data)
            flipped[bit // 8] ^= 1 << bit % 8
            assert not codec.is_whole(identifier, flipped)


@pytest.mark.parametrize("kind", KINDS)
def test_frames_are_those_of_the_dbc_protected_by_autosar_e2e(database, kind):
    rng = random.Random(kind)
    message = database.get_message_by_name(kind)
    for _ in range(ROUNDS):
        frame, node = any_of(kind, rng), rng.randrange(16)
        signals = signals_of(kind, frame, 0)
        data = bytearray(message.encode(signals, scaling=False, strict=False))
        data[1] = data[1] & 0xF0 | (data[1] - 1) & 15  # protect counts up
        p02.e2e_p02_protect(data, data_ids(kind))
        packed = codec.pack(frame, node)
        assert (bytes(packed.data), packed.dlc) == (bytes(data), 8)
        assert packed.arbitration_id == message.frame_id + node
        assert not packed.is_extended_id and not packed.is_rx
        assert codec.unpack(packed, type(frame)) == codec.unpack(packed) == frame
        assert frame == codec.from_bytes(packed.arbitration_id, data)
        assert pickle.loads(pickle.dumps(frame)) == frame
        data[rng.randrange(8)] ^= 1 << rng.randrange(8)
        with pytest.raises(Error, match=f"^{kind} 0x1[0-5][0-9a-f]: CRC 0x"):
            codec.from_bytes(message.frame_id + node, data)


def test_units_are_those_of_the_dbc(database):
    """A parameter in SI is what cantools makes of it, at the steps of both."""
    message = database.get_message_by_name("ParamWrite")
    scale = {"ms": 1e-3}
    for number, name in message.get_signal_by_name("Param").choices.items():
        if str(name) not in {signal.name for signal in message.signals}:
            continue
        signal = message.get_signal_by_name(str(name))
        value = 2559.6 * codec.UNITS[number]  # to the nearest step
        asked = codec.ParamWrite.of_si(number, value, codec.Write.HOLD, counter=7)
        decoded = message.decode(codec.to_bytes(asked))[str(name)]
        assert asked.si == pytest.approx(decoded * scale.get(signal.unit, 1.0)), name
        assert asked == codec.ParamWrite(number, 2560, codec.Write.HOLD, 7)
    most = codec.ParamWrite.of_si(codec.Param.STEP, 2**32 - 1)
    assert most == codec.ParamWrite(codec.Param.STEP, 2**32 - 1, codec.Write.WRITE, 0)
    assert codec.ParamReply(0, 5) == codec.ParamReply(0, 5, codec.Result.DONE, 0)


SAME = ("multiplexer_ids", "start", "length", "is_signed", "scale", "minimum", "maximum", "unit")
SAME += ("choices", "initial")


def test_a_parameter_is_answered_as_it_is_asked(database):
    """Under one number, in one unit, within one range; and that number has its name."""
    request, reply = map(database.get_message_by_name, ("ParamWrite", "ParamReply"))
    for signal in request.signals[4:]:
        twin = reply.get_signal_by_name(signal.name)
        assert {what: getattr(twin, what) for what in SAME} == {
            what: getattr(signal, what) for what in SAME
        }
        for message in (request, reply):
            choices = message.get_signal_by_name("Param").choices
            assert [str(choices[number]) for number in signal.multiplexer_ids] == [signal.name]


@pytest.mark.parametrize("name", [*"Gain Limit Ramp Timeout MaxStep StatusPeriod Load".split()])
def test_a_node_starts_and_ends_where_the_dbc_says(database, name):
    signal = database.get_message_by_name("ParamWrite").get_signal_by_name(name)
    least, most, start = (
        round((value or 0) / signal.scale)
        for value in (signal.minimum, signal.maximum, signal.initial)
    )
    node, number = dahl.Node(dahl.Loaded(dahl.Plan(100, 0.5, 1e-4))), signal.multiplexer_ids[0]

    def asked(value: int, write: codec.Write) -> codec.ParamReply:
        return codec.unpack(node.receive(codec.pack(codec.ParamWrite(number, value, write))))

    assert asked(0, codec.Write.READ).value == start
    for value in (least, most):
        said = asked(value, codec.Write.WRITE)
        assert (said.value, said.result) == (value, codec.Result.DONE)
    for value in (most + 1, *range(least)):
        assert asked(value, codec.Write.WRITE).result == codec.Result.OUT_OF_RANGE


def test_a_ratio_and_a_timeout_are_those_of_the_dbc(database):
    torque = codec.FrictionTorque(-123456789)
    decoded = database.decode_message("FrictionTorque", codec.to_bytes(torque))
    assert torque.ratio == decoded["TorqueRatio"]
    signal = database.get_message_by_name("FrictionTorque").get_signal_by_name("TorqueRatio")
    assert (signal.minimum, signal.maximum, signal.scale) == (-1, 1, 2.0**-30)
    status = codec.Status(1, codec.State.OK, codec.Errors(0), 0, 0, 0, 0, 2, 25)
    decoded = database.decode_message("Status", codec.to_bytes(status))
    assert status.timeout_s == pytest.approx(decoded["Timeout"] / 1000)


GOOD = codec.to_bytes(codec.EncoderState(5))


def sealed(kind: str, data: bytes) -> bytes:
    """With a CRC that is right."""
    changed = bytearray(data)
    p02.e2e_p02_protect(changed, data_ids(kind))
    return bytes(changed)


def message(**changes) -> can.Message:
    return can.Message(**{"arbitration_id": 0x100, "is_extended_id": False, "data": GOOD} | changes)


of_si, Param = codec.ParamWrite.of_si, codec.Param
REFUSED = [
    (lambda: codec.from_bytes(0x100, GOOD[:7]), "EncoderState 0x100: 7 bytes, 8 were"),
    (lambda: codec.from_bytes(0x105, b""), "EncoderState 0x105: 0 bytes, 8 were expected"),
    (lambda: codec.from_bytes(0x100, GOOD + b"1"), "EncoderState 0x100: 9 bytes"),
    (lambda: codec.from_bytes(0x110, GOOD), f"FrictionTorque 0x110: CRC {GOOD[0]:#04x}, "),
    (
        lambda: codec.from_bytes(0x160, GOOD),
        "id 0x160: no frame of a node; those have ids 0x100 to 0x15f",
    ),
    (lambda: codec.from_bytes(0x800, GOOD), "identifier = 2048 is not a whole number"),
    (lambda: codec.from_bytes(0x100, 8), "data = 8 is neither bytes nor a bytearray"),
    (lambda: codec.from_bytes(0x100, "12345678"), "data = '12345678' is neither bytes"),
    (
        lambda: codec.from_bytes(0x110, sealed("FrictionTorque", bytes([0, 0x90, *bytes(6)]))),
        "FrictionTorque 0x110: state = 9 is none of 0 OK, 1 REPEATED",
    ),
    (
        lambda: codec.from_bytes(0x110, sealed("FrictionTorque", b"\0\0\0\0\1\0\0\x40")),
        "FrictionTorque 0x110: torque_q30 = 1073741825 is not a whole number from",
    ),
    (lambda: codec.unpack(message(is_extended_id=True)), "EncoderState 0x100: an ext"),
    (
        lambda: codec.unpack(message(is_remote_frame=True, data=None, dlc=8)),
        "EncoderState 0x100: a remote frame; a classic data frame was expected",
    ),
    (lambda: codec.unpack(message(is_fd=True)), "EncoderState 0x100: a CAN FD frame"),
    (lambda: codec.unpack(message(is_error_frame=True)), "EncoderState 0x100: an error"),
    (lambda: codec.unpack(GOOD), "message = b'"),
    (lambda: codec.unpack(message(), codec.Status), "EncoderState 0x100: Status was expected"),
    (lambda: codec.unpack(message(), int), "kind = <class 'int'> is no kind of frame"),
    (lambda: codec.pack(GOOD), "frame = b'"),
    (lambda: codec.pack(codec.EncoderState(1), 16), "node = 16 is not a whole number"),
    (lambda: codec.EncoderState(2**31), "count = 2147483648 is not a whole number"),
    (lambda: codec.EncoderState(1, counter=16), "counter = 16 is not a whole number"),
    (lambda: codec.EncoderState(1, valid=2), "valid = 2 is not a whole number"),
    (lambda: codec.EncoderState(1, x=2), "EncoderState: x = 2: no such argument"),
    (lambda: codec.Reset(3), "what = 3 is none of 1 ERRORS, 2 RESTART"),
    (lambda: of_si(Param.FC, 4096.5), "value = 4096.5 of parameter FC is outside 0 .. 4096"),
    (
        lambda: of_si(Param.THETA, 1e300),
        "value = 1e+300 of parameter THETA is outside 0 .. 0.015625",
    ),
    (lambda: of_si(Param.FC, -1), "value = -1 of parameter FC"),
    (lambda: of_si(Param.FC, float("nan")), "value = nan is not a finite number"),
]


@pytest.mark.parametrize(("call", "complaint"), REFUSED)
def test_a_refusal_is_one_line_with_value_and_limit(call, complaint):
    with pytest.raises(Error) as caught:
        call()
    assert str(caught.value).startswith(complaint)
    assert "\n" not in str(caught.value)
