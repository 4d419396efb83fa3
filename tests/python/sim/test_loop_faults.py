# SPDX-License-Identifier: MIT
"""Injected faults: the log and the undisturbed motion show each fault tick by tick. Each fault is
counted and none changes a torque.

The tables of host_sim/faults.h (effect on frames) and docs/loop.md (reaction of the node) are
written again here and in loop_model.py.
"""

from __future__ import annotations

import configparser
import functools
from collections import Counter, defaultdict
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest
from crccheck.crc import Crc8Autosar
from loop_model import (
    BUS_OFF,
    ENCODER,
    Q30_BOUND,
    RESET,
    Node,
    Steering,
    check_node,
    is_good,
    travel_per_count,
)
from loop_tools import SCENES, Logged, Run, read_log, run, setting, word

STORM = SCENES / "fault-storm.ini"
TRAVEL = travel_per_count(120, 1.8, 2.396844981071314e-05)
KINDS = "drop duplicate reorder delay corrupt length id extended invalid glitch".split()
KINDS += ["babble", "silence", "bus_off", "restart"]
LATE = {"reorder": [1], "delay": [2, 3, 4, 5, 6, 7]}  # ticks
OFF_TICKS = 110  # of silence and bus_off, at a timeout of 100 ms


def storm(folder: Path, *options: object, **rates: float) -> Run:
    """Run the scene, with these rates instead of its own if any are given."""
    rates = dict.fromkeys(KINDS, 0) | rates if rates else {}
    sets = (f"faults.{kind}={rate}" for kind, rate in rates.items())
    result = run(folder, STORM, "--virtual", *options, *setting(*sets))
    assert (result.code, result.err) == (0, "")
    return result


def check_counters(summary: dict) -> None:
    """The counters of the node are those that the faults predict."""
    expected = summary["faults"]["expected"]
    assert {name: summary["node"][name] for name in expected} == expected


def sums(injected: dict) -> dict:
    """The table of faults.h: the counters of each fault."""
    late = injected["reorder"] + injected["delay"]
    form = injected["length"] + injected["extended"]
    return {
        "lost": injected["drop"] + injected["corrupt"] + injected["id"] + form + late,
        "repeated": injected["duplicate"],
        "wrong_sequence": late,
        "crc": injected["corrupt"],
        "format": form,
        "ignored": injected["id"] + 8 * injected["babble"],
        "invalid": injected["invalid"],
        "jump": injected["glitch"],
        "stale": injected["silence"],
        "rearm": 2 * (injected["silence"] + injected["bus_off"]),
        "bus_off": injected["bus_off"],
        "resets": injected["restart"],
    }


# --- tick by tick ---------------------------------------------------------------------------------


@dataclass
class Seen:
    """Faults that a log shows, and their sizes."""

    kinds: Counter = field(default_factory=Counter)
    late: Counter = field(default_factory=Counter)
    flips: Counter = field(default_factory=Counter)
    lengths: Counter = field(default_factory=Counter)
    ids: Counter = field(default_factory=Counter)
    away: list[int] = field(default_factory=list)  # counts of a glitch
    quiet: list[int] = field(default_factory=list)  # ticks without a frame


def distance(a: bytes, b: bytes) -> int:
    return (int.from_bytes(a, "big") ^ int.from_bytes(b, "big")).bit_count()


def kind_of(frame: Logged, clean: bytes, seen: Seen) -> str:
    """The fault of the only frame of a tick."""
    if frame.is_extended:
        assert (frame.id, frame.data) == (ENCODER, clean)
        return "extended"
    if frame.id != ENCODER:
        assert 0x700 <= frame.id < 0x7FF and frame.data == clean
        seen.ids[frame.id] += 1
        return "id"
    if len(frame.data) < 8:
        assert clean.startswith(frame.data)
        seen.lengths[len(frame.data)] += 1
        return "length"
    if not is_good(frame, 3):
        seen.flips[distance(frame.data, clean)] += 1
        return "corrupt"
    if word(frame.data, 2) == word(clean, 2):
        assert distance(frame.data[1:], clean[1:]) == 1 and frame.data[1] ^ clean[1] == 16
        return "invalid"
    assert frame.data[1] == clean[1]
    away = (word(frame.data, 2) - word(clean, 2) + 2**31) % 2**32 - 2**31
    seen.away.append(away)
    return "glitch"


def look(came: list[Logged], clean: bytes, seen: Seen) -> None:
    """Classify the frames of one tick, without late ones."""
    babble = [frame for frame in came if 0x0F0 <= frame.id <= 0x0FF]
    resets = [frame for frame in came if frame.id == RESET]
    before = len(babble) + len(resets)
    assert came[:before] == babble + resets and len(babble) in (0, 8) and len(resets) < 2
    seen.kinds["babble"] += len(babble) // 8
    seen.kinds["restart"] += len(resets)
    first, *more = came[before:]
    if first.data == clean and first.id == ENCODER and not first.is_extended:
        assert more in ([], [first])
        seen.kinds["duplicate"] += len(more)
    else:
        assert before == 0 and more == []
        seen.kinds[kind_of(first, clean, seen)] += 1


def lateness(frame: Logged, tick: int, clean: list[bytes]) -> int:
    """Delay of a frame in ticks. The counter is unique within 15 ticks."""
    if frame.id != ENCODER or frame.is_extended:
        return 0
    return next((k for k in range(1, min(tick, 7) + 1) if clean[tick - k] == frame.data), 0)


def look_at_all(log: list[Logged], clean: list[bytes]) -> Seen:
    """Classify every tick of a log. `clean` has the data of each angle."""
    seen, ticks, came_late, bus_offs = Seen(), defaultdict(list), set(), []
    for frame in log:
        tick = round(frame.time * 1000)
        if frame.id == BUS_OFF:
            bus_offs.append(tick)
        elif late := lateness(frame, tick, clean):
            came_late.add((tick - late, tick))
            seen.late[late] += 1
        elif frame.id & ~15 not in (0x110, 0x120):
            assert tick not in {at for _, at in came_late}, "a late frame comes after the present"
            ticks[tick].append(frame)
    for tick, frames in ticks.items():
        look(frames, clean[tick], seen)
    there = ticks.keys() | {of for of, _ in came_late}
    look_at_gaps([tick for tick in range(len(clean)) if tick not in there], bus_offs, seen)
    return seen


def look_at_gaps(empty: list[int], bus_offs: list[int], seen: Seen) -> None:
    """Ticks without a frame: long stretches are silences, the others were dropped."""
    parts = np.split(np.array(empty, int), np.flatnonzero(np.diff(empty) > 1) + 1)
    for part in parts:
        if len(part) < 20:
            seen.kinds["drop"] += len(part)
            continue
        seen.quiet.append(len(part))
        told = [tick for tick in bus_offs if part[0] <= tick <= part[-1]]
        seen.kinds["bus_off" if told else "silence"] += 1
        assert len(told) <= 1 and all(0 < tick - part[0] <= 5 for tick in told)
    assert seen.kinds["bus_off"] == len(bus_offs)


@functools.cache
def angles(seed: int, ticks: int, start: int = 0) -> list[bytes]:
    """Data of each EncoderState of the scene, without faults."""
    found, motion = [], Steering(131072, 1.5, 600, 0.15, ticks / 1000, 0.4)
    for tick, count in enumerate(motion.counts(seed)):
        wrapped = (count + start) % 2**32
        content = bytes([16 | tick & 15]) + wrapped.to_bytes(4, "little") + bytes(2)
        found.append(bytes([Crc8Autosar.calc(content + bytes([0x30 | tick & 15]))]) + content)
    return found


def check_seen(seen: Seen, injected: dict) -> None:
    """Compare the summary with the log. Frames on their way at the end are missing in it."""
    told = {kind: injected[kind] for kind in KINDS if kind not in ("drop", *LATE)}
    assert {kind: seen.kinds[kind] for kind in told} == told
    came = {kind: sum(seen.late[ticks] for ticks in late) for kind, late in LATE.items()}
    on_their_way = sum(injected[kind] - came[kind] for kind in LATE)
    assert all(injected[kind] - 7 <= came[kind] <= injected[kind] for kind in LATE)
    assert seen.kinds["drop"] == injected["drop"] + on_their_way


def check_storm(folder: Path, seconds: int, *options: object, start: int = 0, **rates: float):
    """Run a storm and check every frame, answer and counter."""
    sets = setting(f"motion.seconds={seconds}", f"motion.start_count={start}")
    result = storm(folder, "--seed", 3, *sets, *options, **rates)
    log, told = read_log(result.log), result.summary
    seen = look_at_all(log, angles(3, 1000 * seconds, start))
    check_seen(seen, told["faults"]["injected"])
    check_node(log, Node(TRAVEL, 2000), told["node"])
    check_counters(told)
    return told, seen


@pytest.mark.parametrize("kind", KINDS)
def test_each_fault_alone_does_what_the_table_says(tmp_path, kind):
    """As often as its rate says and within its limits."""
    rate = 0.002 if kind in ("silence", "bus_off", "restart") else 0.05
    told, seen = check_storm(tmp_path, 12, **{kind: rate})
    injected = told["faults"]["injected"]
    assert {name for name, count in injected.items() if count} == {kind}
    due = rate * (12000 - sum(seen.quiet))
    assert abs(injected[kind] - due) < 6 * due**0.5 + 0.1 * due
    counted = {name for name, count in told["node"].items() if count and name != "ok"}
    assert counted == {name for name, count in sums(injected).items() if count}
    assert {*seen.late} == {*LATE.get(kind, ())}
    assert set(seen.quiet[:-1]) <= {OFF_TICKS}
    spread(kind, seen)


def spread(kind: str, seen: Seen) -> None:
    """Each bit, length, identifier and distance occurs about equally often."""
    if kind == "corrupt":
        assert {*seen.flips} == {1, 2, 3} and min(seen.flips.values()) > 0.2 * seen.flips.total()
    if kind == "length":
        assert {*seen.lengths} == set(range(8)) and min(seen.lengths.values()) > 45
    if kind == "id":
        assert len(seen.ids) > 200
    if kind == "glitch":
        assert 2**28 <= min(seen.away) < 2**28 + 2**24 and 2**30 < max(seen.away) < 2**31
    if kind == "delay":
        assert min(seen.late.values()) > 0.1 * seen.late.total()


def test_every_fault_of_a_storm_is_counted(tmp_path):
    """A tenth of all frames is spoiled, while the count wraps."""
    told, _ = check_storm(tmp_path, 40, start=2147483600)
    injected = told["faults"]["injected"]
    assert all(injected.values())
    assert 0.09 < sum(injected.values()) / told["frames_sent"] < 0.11
    for name, wanted in sums(injected).items():
        assert wanted - 8 <= told["node"][name] <= wanted, name


def test_a_fault_in_every_frame_is_counted(tmp_path):
    """Every frame meets a fault, where none would hide another."""
    told, _ = check_storm(tmp_path, 30, **dict.fromkeys(KINDS, 1 / len(KINDS)))
    assert sum(told["faults"]["injected"].values()) > 0.3 * told["node"]["ok"]


@pytest.mark.parametrize(
    "seed", [2, *(pytest.param(seed, marks=pytest.mark.long) for seed in range(3, 6))]
)
def test_a_million_frames(tmp_path, seed):
    options = ("--set", "motion.seconds=1000", "--seed", seed, "--log", "/dev/null")
    summary = storm(tmp_path, *options).summary
    assert summary["frames_sent"] == 1_000_000
    assert sum(summary["faults"]["injected"].values()) > 90_000
    check_counters(summary)
    assert summary["max_rss_kib"] < 16 * 1024


@pytest.mark.parametrize("ms", [30.6, 400])
def test_a_silence_is_reported_in_the_tick_after_the_timeout(tmp_path, ms):
    """The silence of the faults is longer than the timeout."""
    words = setting(f"friction.timeout_ms={ms}")
    result = storm(tmp_path, "--seed", 3, *words, silence=0.002, bus_off=0.002)
    node = Node(TRAVEL, 2000, timeout_us=round(1000 * ms))
    check_node(read_log(result.log), node, result.summary["node"])
    assert node.counts["stale"] > 5 and node.counts["bus_off"] > 5
    check_counters(result.summary)


@pytest.mark.parametrize("kind", ["silence", "bus_off"])
def test_counters_agree_whenever_the_run_ends(tmp_path, kind):
    """In each tick of a silence: before, in and after the tick of the timeout."""
    seen = set()
    for ticks in range(OFF_TICKS - 20, OFF_TICKS + 20):
        summary = storm(tmp_path, "--seconds", ticks / 1000, **{kind: 1}).summary
        check_counters(summary)
        seen.add((summary["node"]["stale"], summary["node"]["bus_off"], summary["node"]["rearm"]))
    told = (1, 0) if kind == "silence" else (0, 1)
    assert {(*told, rearm) for rearm in (0, 1, 2)} <= seen


@pytest.mark.parametrize("options", [(), ("--bitrate", 500000), ("--bitrate", 1000000)])
def test_each_node_has_its_own_faults(tmp_path, options):
    """Three nodes from number 5 on, or one node on a bus that takes time."""
    words = () if options else ("--nodes", 3, *setting("friction.node=5"))
    rates = {"bus_off": 0.002, "restart": 0.002, "glitch": 0.002}
    rates |= {"babble": 0.01} if options else {}  # each node counts the babble of its number
    summary = storm(tmp_path, *options, *words, "--seconds", 20, **rates).summary
    node, injected = summary["node"], summary["faults"]["injected"]
    counted = {"bus_off": node["bus_off"], "restart": node["resets"], "glitch": node["jump"]}
    assert {kind: injected[kind] for kind in counted} == counted and min(counted.values()) > 3
    check_counters(summary)
    errors = summary["bus_counts"]["error_frames"]
    assert errors == summary["faults"]["expected"]["bus_off"]


def test_an_encoder_alone_predicts_the_counters_of_the_node(tmp_path):
    alone = storm(tmp_path / "a", "--role", "encoder", "--seconds", "5").summary
    both = storm(tmp_path / "b", "--seconds", "5").summary
    assert alone["faults"] == both["faults"]
    assert both["faults"]["expected"]["ok"] > 4000


FULL = [  # kinds of which every frame meets one, ticks from answer to answer
    (("drop",), 7),
    (("drop", "corrupt", "length", "id", "extended"), 7),
    (("glitch",), 2),
    (("reorder",), 2),
    (("delay",), 2),
]


@pytest.mark.parametrize(("kinds", "ticks"), FULL)
def test_faults_keep_apart(tmp_path, kinds, ticks):
    """At most six frames in a row are missing. A late frame or a glitch is followed by a good
    one.
    """
    rates = dict.fromkeys(kinds, 1 / len(kinds))
    log = read_log(storm(tmp_path, "--seconds", 2, **rates).log)
    answers = [round(frame.time * 1000) for frame in log if frame.id == 0x110]
    assert set(np.diff(answers)) == {ticks} and len(answers) > 280


@pytest.mark.parametrize(
    "seconds",
    [30, pytest.param(100, marks=pytest.mark.checks), pytest.param(1000, marks=pytest.mark.long)],
)
def test_the_torque_is_exact_after_the_next_good_frame(tmp_path, seconds):
    """Unless a reversal was hidden. That error ends when the bristle has saturated."""
    rates = {"drop": 0.03, "corrupt": 0.03, "delay": 0.02, "glitch": 0.01, "reorder": 0.01}
    words = ("--seed", 3, *setting(f"motion.seconds={seconds}"))
    log = read_log(storm(tmp_path, *words, **rates).log)
    counts = np.array([word(data, 2) for data in angles(3, 1000 * seconds)])
    exact, w = [], 0.0
    for move in np.diff(counts, prepend=0):
        w = np.sign(move) - (np.sign(move) - w) * np.exp(-TRAVEL * abs(move)) if move else w
        exact.append(w)
    answers = [frame for frame in log if frame.id == 0x110]
    rows = np.array([round(frame.time * 1000) for frame in answers])
    assert len(rows) > 0.85 * len(counts)
    here = np.array(exact)[rows]
    error = np.abs(np.array([word(frame.data, 4) for frame in answers]) / 2**30 - here)
    clean = ~hidden(counts, rows, np.abs(here))
    assert clean.mean() > 0.5
    assert error[clean].max() <= Q30_BOUND
    assert error[~clean].max() > Q30_BOUND  # a hidden reversal leaves an error, as the header says


def hidden(counts: np.ndarray, rows: np.ndarray, ratio: np.ndarray) -> np.ndarray:
    """True if a reversal inside a gap may still have an effect: until |F| has been Fc again."""
    felt, answer = False, np.zeros(len(rows), bool)
    for i in range(1, len(rows)):
        if rows[i] - rows[i - 1] > 1:
            moves = np.diff(counts[rows[i - 1] : rows[i] + 1])
            felt |= bool((moves > 0).any() and (moves < 0).any())
        felt &= bool(ratio[i] < 1 - 1e-12)
        answer[i] = felt
    return answer


def test_the_shipped_scene_spoils_a_tenth():
    parser = configparser.ConfigParser(inline_comment_prefixes=(";",))
    parser.read(STORM)
    assert sum(map(float, parser["faults"].values())) == pytest.approx(0.1)
    assert list(parser["faults"]) == KINDS
