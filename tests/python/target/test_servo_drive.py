# SPDX-License-Identifier: MIT
"""examples/servo_drive on emulated cores: its reactions, and the numbers of its page."""

import itertools
import math
import re
import struct
import sys
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from conftest import ROOT, need
from dahl import codec
from dahl.codec import EncoderState, FrictionTorque, Param, Result, State, Status, Write
from dahl.sim import axis
from e2e import p02

sys.path[:0] = [str(ROOT / "examples/servo_drive"), str(ROOT / "tools/bench")]
import servo_drive  # noqa: E402
import target  # noqa: E402
from shaft import Bench, Command, spi_frame  # noqa: E402

pytestmark = pytest.mark.checks

FC_UNIT = 2.0**-20
FALL_TICKS, FALL_STEP = 20, 0.251  # N m
RECORD_BYTES = 40
REST = 10  # counts, 1.5 s after a move


def image_of(core: str) -> Path:
    need("arm-none-eabi-gcc", "the servo drive works")
    need("qemu-system-arm", "the servo drive works")
    target.build(target.CORES[core], "servo_drive")
    return target.CORES[core].build / "tests/target/servo_drive"


@pytest.fixture(scope="module")
def commissioned(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """The flash of a drive that has commissioned its axis."""
    with Bench("m4f", image_of("m4f"), tmp_path_factory.mktemp("servo")) as bench:
        commission(bench)
        return bench.flash.read_bytes()


@pytest.fixture
def bench(commissioned: bytes, tmp_path: Path) -> Iterator[Bench]:
    """A commissioned drive on Cortex-M4F, half a second after power on."""
    (tmp_path / "flash.bin").write_bytes(commissioned)
    with Bench("m4f", image_of("m4f"), tmp_path) as bench:
        bench.run(0.5)
        yield bench


def commission(bench: Bench) -> None:
    bench.run(0.3)
    assert (bench.drive["State"], bench.drive["Stored"], bench.torque) == ("Off", "Empty", 0)
    bench.send(Command.COMMISSION)
    assert bench.run(40, lambda: bench.drive["Stored"] == "Good")
    bench.run(0.1)
    assert (bench.drive["State"], bench.drive["Stage"], bench.drive["IsSaved"]) == ("Off", 6, 1)


def Fc_of(bench: Bench) -> float:  # noqa: N802
    return float(bench.write(Param.FC, 0, Write.READ).value * FC_UNIT)


def recover(bench: Bench) -> None:
    bench.encoder = spi_frame
    bench.run(0.2)
    bench.send(Command.CLEAR)
    bench.run(0.15)
    assert (bench.drive["State"], bench.drive["Fault"]) == ("Off", "None")


def steps_of(values: list[float]) -> list[float]:
    return [abs(b - a) for a, b in zip(values, values[1:], strict=False)]


def falls_to_zero(torques: list[float]) -> bool:
    """Return whether a torque falls to 0 without a step or a change of sign, and stays there."""
    is_falling = all(0 <= b / a <= 1 if a else b == 0 for a, b in itertools.pairwise(torques))
    is_slow = torques[3] != 0 and max(steps_of(torques)) <= FALL_STEP
    return is_falling and is_slow and torques[FALL_TICKS] == 0


def pull(bench: Bench, torque: float, target: int) -> None:
    """Let a hand pull with a torque that rises slowly, while the drive holds."""
    for step in range(1, 11):
        bench.shaft.hand = torque * step / 10
        bench.hold(0.1, target)
    assert bench.drive["State"] == "Run" and abs(bench.torque) > 0.7 * torque


def fail_under_torque(bench: Bench) -> None:
    """Let the encoder fail, while the drive holds against a hand."""
    pull(bench, 1.5, 0)
    bench.encoder, bench.shaft.hand = (lambda count: bytes(4)), 0
    before = len(bench.torques)
    bench.run(0.2)
    assert (bench.drive["State"], bench.drive["Fault"]) == ("Fault", "Encoder")
    assert falls_to_zero(bench.torques[before + 4 :])


def next_counts(bench: Bench) -> tuple[int, int]:
    """Return the count of the next EncoderState, and the one that the drive had read for it."""
    counts, before = [], len(bench.frames)

    def look(count: int) -> bytes:
        counts.append(count)
        return spi_frame(count)

    bench.encoder = look
    assert bench.run(
        0.02, lambda: any(isinstance(one, EncoderState) for one in bench.frames[before:])
    )
    bench.encoder = spi_frame
    return bench.last(EncoderState).count, counts[-2]


@pytest.mark.parametrize("core", ["m0", "m4f"])
def test_a_life_of_the_drive(core: str, tmp_path: Path) -> None:
    """Power on, commission, compensate, encoder fault, recovery, new parameter, power cycle."""
    with Bench(core, image_of(core), tmp_path) as bench:
        commission(bench)
        assert Fc_of(bench) == pytest.approx(axis.FC, rel=0.03)

        bench.hold(1.5, 6000)
        assert bench.drive["State"] == "Run" and abs(bench.count - 6000) <= REST
        bench.hold(0.4, 0)
        assert bench.last(FrictionTorque).torque_q30 / 2**30 == pytest.approx(-0.9, abs=0.01)
        bench.hold(1.5, 0)
        assert len(set(next_counts(bench))) == 1 and abs(bench.count) <= REST

        fail_under_torque(bench)
        recover(bench)
        bench.hold(1.5, -3000)
        assert bench.drive["State"] == "Run" and abs(bench.count + 3000) <= REST

        assert bench.write(Param.FC, round(0.6 / FC_UNIT)).result == Result.DONE
        assert bench.drive["State"] == "Run"
        bench.send(Command.STOP)
        bench.send(Command.SAVE)
        bench.run(0.2)
        assert bench.drive["IsSaved"] == 1

        bench.power_cycle()
        bench.run(0.3)
        assert (bench.drive["State"], bench.drive["Stored"], bench.torque) == ("Off", "Good", 0)
        assert Fc_of(bench) == pytest.approx(0.6, abs=1e-6)
        bench.hold(1.5, 0)
        assert bench.drive["State"] == "Run" and abs(bench.count) <= REST


# --- compensation ---------------------------------------------------------------------------------


def ticks_to_move(bench: Bench, gain: float) -> int:
    """Return the ticks from the start of a short move back until the shaft has made 10 counts."""
    assert bench.write(Param.GAIN, round(gain * 65536)).result == Result.DONE
    bench.hold(2, 2000)
    bench.send(Command.MOVE, 1950)
    before = bench.ticks
    assert bench.run(0.15, lambda: bench.count < 1990)
    return bench.ticks - before


def test_the_compensation_shortens_a_reversal(bench: Bench) -> None:
    without, compensated = (ticks_to_move(bench, gain) for gain in (0, 1))
    assert compensated < 0.7 * without


# --- encoder --------------------------------------------------------------------------------------


def test_each_single_bad_frame_is_rejected_and_the_drive_goes_on(bench: Bench) -> None:
    """All single and a few double bit errors; the torque is held."""
    damage = [1 << bit for bit in range(32)] + [3 << bit for bit in range(0, 31, 5)]
    bench.hold(1, 1000)
    for number, bits in enumerate(damage):
        wrong = bits.to_bytes(4, "big")
        bench.encoder = lambda count, wrong=wrong: bytes(
            a ^ b for a, b in zip(spi_frame(count), wrong, strict=True)
        )
        bench.tick()
        bench.encoder = spi_frame
        bench.hold(0.05, 1000)
        assert max(steps_of(bench.torques[-52:])) < 0.1, number
    bench.hold(0.5, 30000)
    bench.encoder = lambda count: bytes(4)
    bench.tick()
    bench.encoder = spi_frame
    bench.run(0.02)
    assert max(steps_of(bench.torques[-22:])) < 0.2  # in motion
    bench.hold(3, 1000)
    status = bench.last(Status)
    assert (status.corrupt, status.errors, status.state) == (
        len(damage) + 1,
        1 << State.CRC,
        State.OK,
    )
    assert bench.drive["State"] == "Run" and abs(bench.count - 1000) <= REST


def crc_of(data: bytes) -> bytes:
    """Divide by the polynomial, then invert the remainder."""
    bits = int.from_bytes(data, "big") << 8
    for place in range(8 * len(data) + 7, 7, -1):
        bits ^= 0x197 << place - 8 if bits >> place & 1 else 0
    return bytes([bits ^ 0xFF])


FAULTS: dict[str, tuple[Callable[[int], bytes], int]] = {  # a frame for a count; bit of Status
    "stuck at 0": (lambda count: bytes(4), 1 << State.CRC),
    "stuck at 1": (lambda count: b"\xff" * 4, 1 << State.CRC),
    "marked as wrong": (lambda count: b"\x12\x34\x01" + crc_of(b"\x12\x34\x01"), 1 << 6),
    "far away": (lambda count: spi_frame(count + 30000), 1 << 7),
}


@pytest.mark.parametrize("name", FAULTS)
def test_three_bad_readings_are_a_fault_and_two_are_none(name: str, bench: Bench) -> None:
    damage, bit = FAULTS[name]
    for number, state in ((2, "Run"), (3, "Fault")):
        bench.hold(0.5, 2000)
        bench.encoder = damage
        bench.run(number / 1000)
        bench.encoder = spi_frame
        bench.hold(0.1, 2000)
        assert bench.drive["State"] == state
    bench.hold(0.2, 2000)
    status = bench.last(Status)
    assert (status.state, status.errors) == (State.STALE, bit | 1 << State.STALE)
    assert bench.drive["State"] == "Fault" and bench.torque == 0
    recover(bench)
    assert bench.last(Status).errors == 0
    bench.hold(1.5, 2000)
    assert abs(bench.count - 2000) <= REST


def test_a_fault_stays_until_the_encoder_is_good_and_a_command_clears_it(bench: Bench) -> None:
    bench.encoder = lambda count: bytes(4)
    bench.run(0.3)
    for command in (Command.CLEAR, Command.MOVE, Command.STOP, Command.COMMISSION):
        bench.send(command)
        bench.run(0.15)
        assert bench.drive["State"] == "Fault"
    bench.encoder = spi_frame
    bench.run(0.05)
    bench.send(Command.CLEAR)
    bench.run(0.3)
    bench.send(Command.STOP)
    bench.run(0.15)
    assert bench.drive["State"] == "Fault"
    recover(bench)


def test_a_frozen_encoder_and_a_blocked_shaft_are_found(bench: Bench) -> None:
    bench.hold(0.3, 0)
    bench.encoder = lambda count, frozen=bench.count: spi_frame(frozen)
    before = bench.ticks
    assert bench.hold(1, 20000, lambda: bench.drive["Fault"] == "Following")
    assert bench.ticks - before < 50 and bench.shaft.rotor.omega < 30
    bench.encoder = lambda count: spi_frame(bench.count)
    recover(bench)
    bench.shaft.hand = -50
    bench.hold(0.5, bench.count)
    assert bench.drive["Fault"] in ("Following", "Encoder") and bench.torque == 0


# --- parameters and store -------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("gain", "param", "raw"),
    [(0.9, Param.FC, 1 / FC_UNIT), (0, Param.FC, 1 / FC_UNIT), (0.9, Param.GAIN, 13107)],
)
def test_new_parameters_act_without_a_step_of_the_torque(gain, param, raw, bench: Bench) -> None:
    """In motion. The slew allows 0.1 N m in a tick, and the counts of the encoder add 0.09."""
    bench.write(Param.GAIN, round(gain * 65536))
    bench.hold(1, 0)
    bench.hold(0.5, 30000)
    before = len(bench.torques)
    assert bench.write(param, round(raw)).result == Result.DONE
    bench.hold(0.15, 30000)
    assert bench.drive["State"] == "Run" and max(steps_of(bench.torques[before - 1 :])) < 0.16


def test_a_new_Fc_keeps_the_torque_at_rest(bench: Bench) -> None:  # noqa: N802
    bench.hold(3, 1000)
    torques = []
    for raw in (0.5, 0.75, 0.5):
        bench.write(Param.FC, round(raw / FC_UNIT))
        bench.hold(0.3, 1000)
        torques.append(raw * bench.last(FrictionTorque).torque_q30 / 2**30)
    assert torques == pytest.approx([torques[0]] * 3, rel=0.05) and torques[0] > 0.3


REFUSED = [
    (Param.FC, 0, Write.WRITE, Result.OUT_OF_RANGE),
    (Param.FC, round(0.04 / FC_UNIT), Write.WRITE, Result.OUT_OF_RANGE),
    (Param.FC, 2**32 - 1, Write.WRITE, Result.OUT_OF_RANGE),
    (Param.GAIN, 65537, Write.WRITE, Result.OUT_OF_RANGE),
    (Param.GAIN, 2**32 - 1, Write.WRITE, Result.OUT_OF_RANGE),
    (Param.FC, round(1 / FC_UNIT), Write.HOLD, Result.OUT_OF_RANGE),
    (Param.SIGMA0, 1000, Write.WRITE, Result.UNKNOWN),
    (Param.LOAD, 1, Write.WRITE, Result.UNKNOWN),
]


def test_a_parameter_out_of_range_changes_nothing(bench: Bench) -> None:
    before = Fc_of(bench), bench.write(Param.GAIN, 0, Write.READ).value
    for param, raw, how, result in REFUSED:
        assert raw_write(bench, param, raw, how).result == result, param
        assert (Fc_of(bench), bench.write(Param.GAIN, 0, Write.READ).value) == before
    bench.run(0.2)
    assert bench.drive["IsSaved"] == 1 and bench.last(Status).errors == 0


def raw_write(bench: Bench, param: int, raw: int, how: int) -> Any:
    """A ParamWrite with any value, which the codec of Python refuses to pack."""
    data = bytearray(struct.pack("<4BI", 0, how << 4, param, 0, raw))
    p02.e2e_p02_protect(data, bytes(range(0x60, 0x70)))
    bench.send_raw(0x130, bytes(data))
    bench.run(0.005)
    return bench.last(codec.ParamReply)


def test_damaged_frames_do_nothing(bench: Bench) -> None:
    """One bit of a command or a parameter is wrong."""
    write = codec.pack(codec.ParamWrite(Param.GAIN, 30000, Write.WRITE))
    bench.send(Command.MOVE, 3000)
    for identifier, data in (bench.queue.pop(), (write.arbitration_id, write.data)):
        for bit in range(64):
            damaged = int.from_bytes(data, "little") ^ 1 << bit
            bench.send_raw(identifier, damaged.to_bytes(8, "little"))
    bench.run(0.3)
    assert (bench.drive["State"], bench.last(Status).errors) == ("Off", 1)
    assert not any(isinstance(frame, codec.ParamReply) for frame in bench.frames)
    bench.send(Command.CLEAR)
    bench.run(0.2)
    assert bench.last(Status).errors == 0


def test_a_parameter_is_saved_on_command_only_and_with_the_motor_off(bench: Bench) -> None:
    old = Fc_of(bench)
    for is_running in (True, False):
        bench.write(Param.FC, round(0.4 / FC_UNIT))
        if is_running:
            bench.hold(0.2, 0)
            bench.send(Command.SAVE)
            bench.hold(0.2, 0)
            assert bench.drive["IsSaved"] == 0
        bench.power_cycle()
        bench.run(0.2)
        assert Fc_of(bench) == old and bench.drive["IsSaved"] == 1


def test_a_save_waits_until_the_torque_is_0(bench: Bench, monkeypatch) -> None:
    """The flash may stop the ticks, so a torque would stay."""
    pull(bench, 1.5, 0)
    before, move, torques_at_a_change = bench.flash.read_bytes(), bench.shaft.move, []

    def look(torque: float) -> int:  # the drive waits for the next encoder frame
        if bench.flash.read_bytes() != before:
            torques_at_a_change.append(torque)
        return move(torque)

    monkeypatch.setattr(bench.shaft, "move", look)
    bench.write(Param.GAIN, 30000)
    bench.send(Command.STOP)
    bench.send(Command.SAVE)
    bench.run(0.3)
    assert torques_at_a_change and torques_at_a_change[0] == 0
    assert (bench.drive["State"], bench.drive["IsSaved"]) == ("Off", 1)


def test_each_save_replaces_the_one_before(bench: Bench) -> None:
    for number in range(3):
        bench.write(Param.FC, round((0.4 + number / 10) / FC_UNIT))
        bench.send(Command.SAVE)
        bench.run(0.1)
        bench.power_cycle()
        bench.run(0.2)
        assert Fc_of(bench) == pytest.approx(0.4 + number / 10, abs=1e-6)
        assert (bench.drive["Stored"], bench.drive["IsSaved"]) == ("Good", 1)


def test_two_saves_use_both_pages(bench: Bench) -> None:
    before = bench.flash.read_bytes()
    for Fc in (0.4, 0.5):  # noqa: N806
        bench.write(Param.FC, round(Fc / FC_UNIT))
        bench.send(Command.SAVE)
        bench.run(0.1)
    after = bench.flash.read_bytes()
    assert before[:256] != after[:256] and before[256:] != after[256:]


def test_a_power_loss_during_a_save_keeps_the_older_set(bench: Bench) -> None:
    old, before = Fc_of(bench), bench.flash.read_bytes()
    bench.write(Param.FC, round(0.4 / FC_UNIT))
    bench.send(Command.SAVE)
    bench.run(0.1)
    after = bench.flash.read_bytes()
    (slot,) = [at for at in (0, 256) if after[at : at + 256] != before[at : at + 256]]
    for written in (0, 1, 4, 7, 8, 12, 30, RECORD_BYTES - 1, RECORD_BYTES):
        page = after[slot : slot + written] + b"\xff" * (256 - written)
        bench.flash.write_bytes(after[:slot] + page + after[slot + 256 :])
        bench.power_cycle()
        bench.run(0.2)
        is_whole = written == RECORD_BYTES
        assert Fc_of(bench) == pytest.approx(0.4 if is_whole else old, abs=1e-6)
        assert bench.drive["Stored"] == ("Good" if is_whole or written == 0 else "Torn")


@pytest.mark.parametrize("place", [0, 5, 9, 20, 38])
def test_a_corrupt_store_gives_defaults_and_a_flag(place: int, bench: Bench) -> None:
    bench.write(Param.FC, round(0.4 / FC_UNIT))
    bench.send(Command.SAVE)
    bench.run(0.1)
    flash = bytearray(bench.flash.read_bytes())
    for slot in (0, 256):
        flash[slot + place] ^= 0x10
    bench.flash.write_bytes(flash)
    bench.power_cycle()
    bench.run(0.2)
    assert (bench.drive["Stored"], bench.drive["IsSaved"]) == ("Corrupt", 0)
    assert Fc_of(bench) == pytest.approx(0.3, abs=1e-6)


@pytest.mark.parametrize("word", [b"\x02\0\x56\x53", math.nan, -0.5, 100.0])
def test_stored_numbers_of_no_drive_give_defaults(word: float | bytes, bench: Bench) -> None:
    """Another layout, or a wrong Fc, with a good CRC as of another firmware."""
    record = bytearray(bench.flash.read_bytes()[: RECORD_BYTES - 4])
    if isinstance(word, bytes):
        record[:4] = word
    else:
        struct.pack_into("<f", record, 8, word)
    record += struct.pack("<I", zlib.crc32(record))
    bench.flash.write_bytes(record + b"\xff" * (512 - RECORD_BYTES))
    bench.power_cycle()
    bench.run(0.2)
    assert (bench.drive["Stored"], bench.drive["IsSaved"]) == ("Corrupt", 0)
    assert Fc_of(bench) == pytest.approx(0.3, abs=1e-6)


# --- watchdog, bus, commissioning -----------------------------------------------------------------


def start_reset(bench: Bench, how: str) -> None:
    """Start to damage a running drive."""
    at = target.symbols(target.CORES["m4f"], image_of("m4f"))["loop"][0]
    if how == "the main program hangs":
        bench.is_stalled = True
    elif how == "a bit of a plan":
        bench.poke(at + 40, bench.peek(at + 40) ^ 0x100)
    else:
        bench.poke(at + 324, 0x7FFFFFFF)  # the upper word of the bristle


@pytest.mark.parametrize("how", ["the main program hangs", "a bit of a plan", "the state"])
def test_the_watchdog_resets_a_drive_that_is_not_sound(how: str, bench: Bench) -> None:
    """The torque is 0 within 65 ms, and a reset follows. Then nothing moves before two commands."""
    bench.hold(0.5, 1000)
    bench.shaft.hand = 0.4  # the drive must hold against it
    bench.hold(0.3, 1000)
    assert bench.torque < -0.1
    start_reset(bench, how)
    before = len(bench.torques)
    for _ in range(100):
        bench.send(Command.MOVE, 1000)
        bench.tick()
        if bench.resets:
            break
    bench.is_stalled = False
    assert bench.resets == 1 and not any(bench.torques[before + 65 :])
    bench.hold(0.3, 1000)
    assert (bench.drive["State"], bench.drive["Fault"], bench.torque) == ("Fault", "Reset", 0)
    recover(bench)
    bench.hold(0.3, 1000)
    assert bench.drive["State"] == "Run" and bench.resets == 1


def test_a_frame_in_each_tick_does_not_reset_the_drive(bench: Bench) -> None:
    """The check of the plans must not wait for a quiet bus."""
    message = codec.pack(codec.ParamWrite(Param.GAIN, 60000, Write.WRITE))
    for _ in range(400):
        bench.send(Command.MOVE, 1000)
        bench.tick()
    for tick in range(400):
        bench.send(Command.MOVE, 1000) if tick % 50 == 0 else None
        bench.send_raw(message.arbitration_id, bytes(message.data))
        bench.tick()
    assert bench.drive["State"] == "Run" and bench.resets == 0


def test_a_silent_bus_stops_the_drive(bench: Bench) -> None:
    bench.hold(0.3, 1000)
    bench.run(0.15)
    assert bench.drive["State"] == "Run"
    bench.run(0.3)
    assert (bench.drive["State"], bench.drive["Fault"]) == ("Fault", "Bus") and bench.torque == 0
    recover(bench)


@pytest.mark.parametrize("command", [Command.CLEAR, Command.COMMISSION])
def test_only_move_keeps_the_drive_running(command: Command, bench: Bench) -> None:
    bench.hold(0.3, 1000)
    for _ in range(6):
        bench.send(command)
        if bench.run(0.05, lambda: bench.drive["Fault"] == "Bus"):
            return
    pytest.fail(f"the drive is in state {bench.drive['State']}")


def test_a_sender_that_repeats_its_last_frame_is_silent(bench: Bench) -> None:
    bench.hold(0.3, 1000)
    bench.send(Command.MOVE, 1000)
    identifier, data = bench.queue[-1]
    for _ in range(8):
        bench.send_raw(identifier, data)
        bench.run(0.05)
    assert (bench.drive["State"], bench.drive["Fault"]) == ("Fault", "Bus")


@pytest.mark.parametrize("target", [10**9, -(10**9)])
def test_the_farthest_move_has_the_right_direction(target: int, bench: Bench) -> None:
    start = -3000 if target > 0 else 3000
    bench.hold(1, start)
    bench.hold(0.3, target)
    assert bench.drive["State"] == "Run" and (bench.count - start) * target > 0


@pytest.mark.parametrize("target", [10**9 + 1, -(10**9) - 1, 2**31 - 1, -(2**31)])
def test_a_move_that_is_too_far_is_refused(target: int, bench: Bench) -> None:
    bench.send(Command.MOVE, target)
    bench.run(0.2)
    assert (bench.drive["State"], bench.last(Status).errors) == ("Off", 1)


def test_a_refused_commissioning_keeps_the_parameters(bench: Bench) -> None:
    old = Fc_of(bench)
    bench.send(Command.COMMISSION)
    bench.run(3)
    assert bench.drive["State"] == "Commission"
    bench.encoder = lambda count: bytes(4)
    bench.tick()
    bench.encoder = spi_frame
    bench.run(0.15)
    assert (bench.drive["State"], bench.drive["Fault"]) == ("Fault", "Refused")
    recover(bench)
    assert bench.drive["Refusal"] == -42 and Fc_of(bench) == old and bench.drive["IsSaved"] == 1


# --- the page -------------------------------------------------------------------------------------


def test_the_page_has_the_measured_numbers() -> None:
    """tools/bench.sh servo_drive --docs writes them. The motion follows the last bits of cos()."""
    need("arm-none-eabi-gcc", "the page of the servo drive has the measured numbers")
    page = (ROOT / "examples/servo_drive/README.md").read_text()
    (shown,) = re.findall(f"{servo_drive.MARKS[0]}.*{servo_drive.MARKS[1]}", page, re.S)
    stated, found = (
        [int(number) for number in re.findall(r"\b\d+\b", text)]
        for text in (shown, servo_drive.measure_all())
    )
    assert len(found) == 18 and stated == pytest.approx(found, rel=0.01)
