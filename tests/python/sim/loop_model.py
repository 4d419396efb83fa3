# SPDX-License-Identifier: MIT
"""Independent reference for differential tests, without the code of dahl-loop and the library:
motions of a scene (test_loop_virtual.py), lengths of frames, and counters and answers of a node by
docs/loop.md (can/test_node_sequences.py). It has no shaft and no controller.
"""

import math
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from crccheck.crc import Crc8Autosar
from loop_tools import ERROR, Logged, word

Q30_BOUND = 9.4e-10  # of F/Fc: half a step of Q30 and the error bound of the library
BUS_OFF = ERROR | 0x40  # and that the controller is off the bus
ENCODER, TORQUE, STATUS, PARAM, RESET = 0x100, 0x110, 0x120, 0x130, 0x150
KINDS = {ENCODER: 3, PARAM: 6, RESET: 10}  # that a node reads: the high half of the data id
OK, REPEATED, LOST, WRONG_SEQUENCE, CRC, STALE, INIT = range(7)  # states, by the DBC


# --- motions --------------------------------------------------------------------------------------


def nearest(value: float) -> int:
    """The nearest integer; halves are rounded away from 0."""
    return int(math.copysign(math.floor(abs(value) + 0.5), value))


def segments(*ends: int, speed: float, hold_s: float = 0) -> list[int]:
    """Counts from 0 from end to end, with a rest at each end."""
    counts, start, tick = [], 0, 0
    for end in ends:
        while (travel := speed * tick / 1000) < abs(end - start):
            counts.append(nearest(start + math.copysign(travel, end - start)))
            tick += 1
        counts += [end] * (1 + nearest(hold_s * 1000))
        start, tick = end, 1
    return counts


class Random:
    """splitmix64 (Steele, Lea, Flood)."""

    def __init__(self, seed: int) -> None:
        self.state = seed

    def between(self, low: float, high: float) -> float:
        mask = 2**64 - 1
        self.state = self.state + 0x9E3779B97F4A7C15 & mask
        z = self.state
        z = (z ^ z >> 30) * 0xBF58476D1CE4E5B9 & mask
        z = (z ^ z >> 27) * 0x94D049BB133111EB & mask
        return low + (high - low) * ((z ^ z >> 31) >> 11) / 2**53


@dataclass
class Steering:
    """Sweeps from side to side with a rest at each end, plus bumps of a hand."""

    amplitude: float
    sweep_s: float
    tremor: float
    tremor_s: float
    seconds: float
    hold_s: float = 0

    def sweeps(self, random: Random) -> Iterator[float]:
        start, side = 0.0, 1
        while True:
            end = side * random.between(0.4, 1.0) * self.amplitude
            ticks = nearest(1000 * self.sweep_s * random.between(0.6, 1.4)) + 1
            rest = nearest(1000 * self.hold_s * random.between(0, 1))
            for x in (tick / ticks for tick in range(ticks + 1)):
                yield start + (end - start) * (x * x * (3 - 2 * x))
            yield from [end] * rest
            start, side = end, -side

    def pause(self, random: Random) -> int:
        return nearest(1000 * random.between(0, 2) * self.tremor_s)

    def bumps(self, random: Random, pause: int) -> Iterator[float]:
        while True:
            yield from [0.0] * pause
            height = random.between(-1, 1) * self.tremor
            ticks = nearest(1000 * random.between(0.02, 0.12))
            yield 0.0
            for x in (tick / ticks for tick in range(1, ticks + 1)):
                pause = self.pause(random) if x == 1 else pause
                yield height * 16 * x * x * (1 - x) * (1 - x)

    def counts(self, seed: int) -> list[int]:
        random = Random(seed)
        parts = self.bumps(random, self.pause(random)), self.sweeps(random)
        ticks = range(1, nearest(1000 * self.seconds))
        return [0, *(nearest(next(parts[1]) + next(parts[0])) for _ in ticks)]


# --- the node -------------------------------------------------------------------------------------


def is_good(frame: Logged, kind: int) -> bool:
    """Whether the CRC is right (AUTOSAR's profile 2)."""
    identifier = bytes([kind << 4 | frame.data[1] & 15])
    return Crc8Autosar.calc(frame.data[1:] + identifier) == frame.data[0]


def travel_per_count(sigma0: float, Fc: float, theta: float) -> float:  # noqa: N803
    """sigma0 / Fc * theta from 32-bit floats, as a node has them."""
    stiffness, limit, angle = map(float, map(np.float32, (sigma0, Fc, theta)))
    return stiffness / limit * angle


@dataclass
class Answer:
    """A FrictionTorque."""

    time: float
    state: int
    echo: int
    ratio: float  # F/Fc, times the gain and clamped
    counter: int


class Status(NamedTuple):
    time: float
    counter: int
    state: int
    errors: int
    lost: int
    corrupt: int
    out_of_step: int
    timeout: int


class Reply(NamedTuple):
    """A ParamReply."""

    counter: int
    result: int
    param: int
    value: int


SUMS = {  # of Status: the counts in each
    "lost": ("lost",),
    "corrupt": ("crc", "format"),
    "out_of_step": ("repeated", "wrong_sequence", "jump", "stale", "bus_off"),
}
UNITS = (2.0**-10, 2.0**-20, 2.0**-38)  # of Sigma0, Fc and ThetaPerCount
SETTINGS = {  # parameters by number: member, least, most, us or counts of a step
    3: ("gain", 0, 65536, 1),
    4: ("limit", 0, 65536, 1),
    5: ("ramp_us", 0, 60000, 1000),
    6: ("timeout_us", 1, 60000, 1000),
    7: ("max_step", 0, 2**31 - 1, 1),
    8: ("status_us", 0, 60000, 1000),
}
DONE, OUT_OF_RANGE, UNKNOWN = range(3)
READ, WRITE, HOLD = range(3)


@dataclass
class Node:
    """The table of docs/loop.md row by row, parameters, Status and Reset by dahl_node.h and
    dahl_frames.h, Eq. 1 in closed form. Each call returns the frame that is sent.
    """

    travel: float  # of a count
    max_step: int = 0
    timeout_us: int = 100_000
    status_us: int = 100_000
    number: int = 0
    params: list[float] = field(default_factory=list)  # sigma0, Fc, theta, if a test reads them
    gain: int = 65536
    limit: int = 65536
    ramp_us: int = 0
    counts: Counter = field(default_factory=Counter)
    answers: list[Answer] = field(default_factory=list)
    statuses: list[Status] = field(default_factory=list)
    offs: int = 0
    off_us: int = 0
    sent_us: int = 0
    candidate: int = 0

    def __post_init__(self) -> None:
        self.restart()

    def restart(self) -> None:
        self.w, self.state, self.row, self.offs = 0.0, INIT, 0, 0
        self.runs, self.silenced, self.urgent = False, False, True
        self.gain_now = 0.0 if self.ramp_us else float(self.gain)
        self.answered = self.sent = 0
        self.held = list(self.params)
        self.clear()

    def clear(self) -> None:
        self.errors, self.cleared = 0, self.counts.copy()

    def enter(self, state: int) -> None:
        self.state = state
        self.errors |= 1 << state if state else 0

    def tick(self, now_us: int) -> Status | None:
        self.check_timeout(now_us)
        if self.urgent or (self.status_us and now_us - self.sent_us >= self.status_us):
            return self.send_status(now_us)
        return None

    def send_status(self, now_us: int) -> Status:
        since = {
            name: sum(self.counts[one] - self.cleared[one] for one in names) % 256
            for name, names in SUMS.items()
        }
        timeout = min(255, -(-self.timeout_us // 10_000))
        status = Status(now_us / 1e6, self.sent, self.state, self.errors, timeout=timeout, **since)
        self.statuses.append(status)
        self.urgent, self.sent_us, self.sent = False, now_us, (self.sent + 1) % 16
        return status

    def check_timeout(self, now_us: int) -> None:
        if self.runs and now_us - self.good_us > self.timeout_us:
            self.counts["stale"] += 1
            self.become_stale()

    def become_stale(self) -> None:
        self.runs, self.row, self.silenced, self.urgent = False, 0, True, True
        self.gain_now = 0.0 if self.ramp_us else self.gain_now
        self.enter(STALE)

    def receive(self, frame: Logged, now_us: int) -> Answer | Status | Reply | None:
        kind = frame.id ^ self.number
        if frame.id & BUS_OFF == BUS_OFF:
            self.counts["bus_off"] += 1
            self.offs, self.off_us = self.offs + 1, now_us
            self.become_stale()
        elif kind not in KINDS or frame.id & ERROR:
            self.counts["ignored"] += 1
        elif frame.is_extended or frame.is_foreign or len(frame.data) != 8:
            self.errors |= 1
            self.reject("format")
        elif not is_good(frame, KINDS[kind]):
            self.reject("crc")
        elif kind == RESET:
            return self.reset(frame.data[1] >> 4, now_us)
        elif kind == PARAM:
            return self.param(frame.data)
        else:
            self.check_timeout(now_us)
            before = len(self.answers)
            self.angle(frame.data[1] & 15, bool(frame.data[1] & 16), word(frame.data, 2), now_us)
            return self.answers[-1] if len(self.answers) > before else None
        return None

    def reject(self, why: str) -> None:
        self.counts[why] += 1
        self.enter(CRC)
        self.row = self.row if self.runs else 0

    def reset(self, what: int, now_us: int) -> Status:
        self.counts["resets"] += 1
        if what == 1:
            self.clear()
        if what == 2:
            self.restart()
        return self.send_status(now_us)

    def param(self, data: bytes) -> Reply:
        counter, write, number = data[1] & 15, data[1] >> 4 & 3, data[2]
        self.counts["params"] += 1
        if number > 10:
            return Reply(counter, UNKNOWN, 255, number)
        result = DONE if write == READ else self.write(number, write, word(data, 4) % 2**32)
        return Reply(counter, result, number, self.value(number))

    def write(self, number: int, write: int, value: int) -> int:
        if number < len(UNITS):
            return self.write_model(number, write, value)
        name, least, most, scale = SETTINGS.get(number, ("", 1, 0, 1))
        if write != WRITE or not least <= value <= most:
            return OUT_OF_RANGE
        setattr(self, name, value * scale)
        return DONE

    def write_model(self, number: int, write: int, value: int) -> int:
        """Hold a value for the next joint write. A refused write drops the held values."""
        if write > HOLD or value == 0:
            self.held = list(self.params)
            return OUT_OF_RANGE
        self.held[number] = float(np.float32(np.float32(value) * UNITS[number]))
        if write == WRITE:
            (stiffness, limit, _), self.params = self.params, list(self.held)
            carried = self.w * limit * min(1.0, self.params[0] / stiffness)
            self.w = max(-1.0, min(1.0, carried / self.params[1]))
            self.travel = travel_per_count(*self.params)
        return DONE

    def value(self, number: int) -> int:
        if number < len(UNITS):
            return min(2**32 - 1, math.floor(self.params[number] / UNITS[number] + 0.5))
        if number in SETTINGS:
            name, _, _, scale = SETTINGS[number]
            return math.floor(getattr(self, name) / scale + 0.5)
        return {9: 0, 10: 65536}[number]  # the model Dahl, which follows no load

    def angle(self, counter: int, is_valid: bool, count: int, now_us: int) -> None:
        step = counter - getattr(self, "counter", 0) & 15
        if not self.runs:
            self.first(counter, is_valid, count, now_us)
        elif step == 0:
            self.counts["repeated"] += 1
            self.enter(REPEATED)
        elif step > (8 if self.max_step else 3):
            self.out_of_sequence(counter, is_valid, count, now_us)
        else:
            self.in_sequence(step, counter, is_valid, count, now_us)

    def first(self, counter: int, is_valid: bool, count: int, now_us: int) -> None:
        self.state = STALE if self.silenced else INIT
        if not is_valid:
            self.count_invalid()
            self.row = 0
            return
        is_held = self.offs > 0 and now_us - self.off_us < self.timeout_us
        if is_held or self.offs >= 4:
            self.row = 0
        if self.silenced and (is_held or self.offs >= 4 or not self.is_third_in_row(counter)):
            self.counts["rearm"] += 1
            return
        self.counts["ok"] += 1
        self.answer(counter, count, 0, now_us)

    def count_invalid(self) -> None:
        self.counts["invalid"] += 1
        self.errors |= 64

    def is_third_in_row(self, counter: int) -> bool:
        """Whether this is the third frame in a row with the next counter."""
        self.row = self.row + 1 if counter == (self.candidate + 1) % 16 else 1
        self.candidate = counter
        return self.row >= 3

    def is_near(self, count: int, frames: int, now_us: int) -> bool:
        elapsed = -(-(now_us - self.good_us) // 1000)  # ms, begun ones included
        return abs(self.distance(count)) <= self.max_step * max(frames, elapsed)

    def distance(self, count: int) -> int:
        return (count - self.count + 2**31) % 2**32 - 2**31

    def out_of_sequence(self, counter: int, is_valid: bool, count: int, now_us: int) -> None:
        is_known = self.is_third_in_row(counter) and is_valid
        self.enter(WRONG_SEQUENCE)
        if is_known and self.max_step and self.is_near(count, 1, now_us):
            self.enter(LOST)
            self.counts["ok"] += 1
            self.answer(counter, count, self.distance(count), now_us)
            return
        self.counts["wrong_sequence"] += 1
        if is_known:
            self.answer(counter, count, 0, now_us)

    def in_sequence(self, step: int, counter: int, is_valid: bool, count: int, now_us: int) -> None:
        self.counts["lost"] += step - 1
        self.enter(OK if step == 1 else LOST)
        if not is_valid:
            self.count_invalid()
            self.counter = counter
        elif self.max_step and not self.is_near(count, step, now_us):
            self.counts["jump"] += 1
            self.errors |= 128
            self.counter = counter
            if self.is_third_in_row(counter):
                self.enter(WRONG_SEQUENCE)
                self.answer(counter, count, 0, now_us)
        else:
            self.counts["ok"] += 1
            self.answer(counter, count, self.distance(count), now_us)

    def answer(self, counter: int, count: int, move: int, now_us: int) -> None:
        if move:
            side = math.copysign(1, move)
            self.w = side - (side - self.w) * math.exp(-self.travel * abs(move))
        self.ramp(min(now_us - self.good_us, 65535) if self.runs else 0)
        self.counter, self.count, self.good_us = counter, count, now_us
        self.runs, self.row, self.offs = True, 0, 0
        limit = self.limit / 65536
        ratio = max(-limit, min(limit, self.w * self.gain_now / 65536))
        self.answers.append(Answer(now_us / 1e6, self.state, counter, ratio, self.answered))
        self.answered = (self.answered + 1) % 16

    def ramp(self, elapsed_us: int) -> None:
        """Move the gain towards its target by the time since the last answer."""
        step = 65536 * elapsed_us / self.ramp_us if self.ramp_us else math.inf
        self.gain_now += max(-step, min(step, self.gain - self.gain_now))


def status_in(frame: Logged) -> Status:
    assert is_good(frame, 5)
    first, *sums, _, timeout = frame.data[1:]
    return Status(round(frame.time, 6), first & 15, first >> 4, *sums, timeout)
