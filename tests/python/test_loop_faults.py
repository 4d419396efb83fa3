# SPDX-License-Identifier: MIT
"""Faults on the way to the node: each one is counted, none becomes a torque, all totals agree."""

from __future__ import annotations

import configparser
from pathlib import Path

import numpy as np
import pytest
from crccheck.crc import Crc8Autosar
from dahl import reference
from loop_tools import SCENES, Logged, read_log, run, setting

STORM = SCENES / "fault-storm.ini"
SIGMA0, FC, THETA = 120.0, 1.8, 2.396844981071314e-05
KINDS = "drop duplicate reorder delay corrupt length id extended invalid glitch".split()
KINDS += ["babble", "silence", "bus_off", "restart"]
BOUND = 0.52  # ulp of Fc
ONLY = {f"faults.{kind}": 0 for kind in KINDS}


def storm(folder: Path, *options: str, **rates: float):
    """The scene, with these rates instead of its own where any are given."""
    rates = {**ONLY, **{f"faults.{kind}": rate for kind, rate in rates.items()}} if rates else {}
    sets = (f"{key}={rate}" for key, rate in rates.items())
    result = run(folder, STORM, "--virtual", *options, *setting(*sets))
    assert result.code == 0, result.err
    return result


def agreement(summary: dict) -> None:
    """What the node counted is what the faults say that it must have, to the last one."""
    expected = summary["faults"]["expected"]
    assert {name: summary["node"][name] for name in expected} == expected


def sums(injected: dict) -> dict:
    """faults.h's table: which counters each fault adds to."""
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


def test_a_tenth_of_all_frames_spoiled_and_every_one_counted(tmp_path):
    """By the faults' own book, and by plain sums; at the end a few may be on their way."""
    summary = storm(tmp_path, "--set", "motion.seconds=100").summary
    agreement(summary)
    injected = summary["faults"]["injected"]
    assert all(injected.values())
    assert 0.09 < sum(injected.values()) / summary["frames_sent"] < 0.11
    for name, wanted in sums(injected).items():
        assert wanted - 8 <= summary["node"][name] <= wanted, name


@pytest.mark.parametrize(
    "seed", [2, *(pytest.param(seed, marks=pytest.mark.long) for seed in range(3, 6))]
)
def test_a_million_frames(tmp_path, seed):
    summary = storm(tmp_path, "--set", "motion.seconds=1000", "--seed", str(seed)).summary
    assert summary["frames_sent"] == 1_000_000
    assert sum(summary["faults"]["injected"].values()) > 90_000
    agreement(summary)
    assert summary["max_rss_kib"] < 16 * 1024


@pytest.mark.parametrize("kind", KINDS)
def test_each_fault_alone(tmp_path, kind):
    summary = storm(tmp_path, "--seconds", "20", **{kind: 0.002}).summary
    injected = summary["faults"]["injected"]
    assert injected[kind] > 3
    assert {name for name, count in injected.items() if count} == {kind}
    agreement(summary)
    wanted = {name: count for name, count in sums(injected).items() if count}
    seen = {name: count for name, count in summary["node"].items() if count and name != "ok"}
    assert seen.keys() == wanted.keys()


def test_an_encoder_alone_knows_what_a_node_must_have_counted(tmp_path):
    alone = storm(tmp_path / "a", "--role", "encoder", "--seconds", "5").summary
    both = storm(tmp_path / "b", "--seconds", "5").summary
    assert alone["faults"] == both["faults"]
    assert both["faults"]["expected"]["ok"] > 4000


def test_the_worst_mixture(tmp_path):
    """Every frame meets a fault, where none would hide another."""
    summary = storm(tmp_path, **dict.fromkeys(KINDS, 1 / len(KINDS))).summary
    assert sum(summary["faults"]["injected"].values()) > 0.3 * summary["node"]["ok"]
    agreement(summary)


# --- what the bus carried, read by somebody else --------------------------------------------------


def good(frame: Logged, kind: int) -> bool:
    data = frame.data
    if len(data) != 8:
        return False
    return Crc8Autosar.calc(data[1:] + bytes([kind << 4 | data[1] & 15])) == data[0]


def word(data: bytes, at: int) -> int:
    return int.from_bytes(data[at : at + 4], "little", signed=True)


def answered(log: list[Logged]) -> list[tuple[int, int, int, bool]]:
    """(count, state, F/Fc in Q30, restarted before) of each answer.

    An answer belongs to the last good frame with the counter that it echoes.
    """
    found, counts, restarted = [], {}, False
    for frame in log:
        if frame.id == 0x100 and good(frame, 0x3):
            counts[frame.data[1] & 15] = word(frame.data, 2)
        elif frame.id == 0x150:
            restarted = True
        elif frame.id == 0x110:
            assert good(frame, 0xC)
            count = counts[frame.data[2] & 15]
            found.append((count, frame.data[1] >> 4, word(frame.data, 4), restarted))
            restarted = False
    return found


def pieces(answers: list) -> list[list]:
    """Parted where the node was restarted, and relaxed."""
    parts: list[list] = [[]]
    for answer in answers:
        if answer[3]:
            parts.append([])
        parts[-1].append(answer)
    return parts


@pytest.fixture(scope="module")
def stormy(tmp_path_factory):
    return read_log(storm(tmp_path_factory.mktemp("storm"), "--set", "motion.seconds=100").log)


def test_no_wrong_torque(stormy):
    """Each answer is the exact torque for the counts that the node accepted, whatever came between.

    After a timeout (state Stale) and at a start the count is a new start, without travel.
    """
    travel = reference.travel_per_count(SIGMA0, FC, THETA)
    worst = 0.0
    for part in pieces(answered(stormy)):
        counts, states, ratios, _ = (np.array(column) for column in zip(*part, strict=True))
        moves = np.diff(counts, prepend=counts[:1])
        moves[np.isin(states, (3, 5, 6))] = 0
        exact = reference.exact_ratios(moves, travel)
        torque = reference.received_torque(ratios, FC)
        worst = max(worst, reference.error_in_ulp(torque, exact, FC).max())
    assert worst <= BOUND


@pytest.mark.parametrize(
    "seconds",
    [30, pytest.param(100, marks=pytest.mark.checks), pytest.param(1000, marks=pytest.mark.long)],
)
def test_torque_is_back_with_the_next_good_frame(tmp_path, seconds):
    """Where no reversal was hidden, the exact path torque is back with the next good frame.

    The path is the encoder's own, from a run with the same seed and no faults. What a hidden
    reversal leaves is gone once the bristle has saturated.
    """
    options = ("--set", f"motion.seconds={seconds}", "--seed", "3")
    calm = storm(tmp_path / "calm", *options, drop=0)
    rough = storm(
        tmp_path / "rough", *options, drop=0.03, corrupt=0.03, delay=0.02, glitch=0.01, reorder=0.01
    )
    counts = np.array(
        [word(frame.data, 2) for frame in read_log(calm.log) if frame.id == 0x100], np.int64
    )
    travel = reference.travel_per_count(SIGMA0, FC, THETA)
    exact = reference.exact_ratios(np.diff(counts, prepend=counts[:1]), travel)
    frames = (frame for frame in read_log(rough.log) if frame.id in (0x100, 0x110))
    rows, ratios = answered_rows(frames)
    assert len(rows) > 0.85 * len(counts)
    assert (counts[rows[1:]] != counts[rows[:-1]]).any()
    here = [exact[row] for row in rows]
    error = reference.error_in_ulp(reference.received_torque(ratios, FC), here, FC)
    clean = ~hidden(counts, rows, np.abs(np.array(here, float)))
    assert clean.mean() > 0.5
    assert error[clean].max() <= BOUND
    assert error[~clean].max() > BOUND  # a hidden reversal does cost something, as the header says


def answered_rows(frames) -> tuple[np.ndarray, np.ndarray]:
    """Tick of each answer, from the time of its frame (one a millisecond), and F/Fc in Q30."""
    rows, ratios = [], []
    for frame in frames:
        if frame.id == 0x110:
            rows.append(round(frame.time * 1000))
            ratios.append(word(frame.data, 4))
    return np.array(rows), np.array(ratios)


def hidden(counts: np.ndarray, rows: np.ndarray, ratio: np.ndarray) -> np.ndarray:
    """True where a reversal inside a gap may still be felt: until |F| has been Fc again."""
    felt, answer = False, np.zeros(len(rows), bool)
    for i in range(1, len(rows)):
        if rows[i] - rows[i - 1] > 1:
            moves = np.diff(counts[rows[i - 1] : rows[i] + 1])
            felt |= (moves > 0).any() and (moves < 0).any()
        felt &= ratio[i] < 1 - 1e-12
        answer[i] = felt
    return answer


def test_the_shipped_scene_spoils_a_tenth():
    parser = configparser.ConfigParser(inline_comment_prefixes=(";",))
    parser.read(STORM)
    assert sum(map(float, parser["faults"].values())) == pytest.approx(0.1)
    assert list(parser["faults"]) == KINDS


def test_a_storm_while_the_count_wraps(tmp_path):
    """The counter of frames wraps every 16 ms anyway; here the 32-bit angle does too."""
    result = storm(tmp_path, "--set", "motion.start_count=2147483600")
    agreement(result.summary)
    good_counts = {
        word(frame.data, 2) > 0
        for frame in read_log(result.log)
        if frame.id == 0x100 and good(frame, 0x3)
    }
    assert good_counts == {True, False}
    assert result.summary["node"]["jump"] == result.summary["faults"]["injected"]["glitch"]


@pytest.mark.parametrize("rate", ["500000", "1000000"])
def test_a_storm_on_a_bus_that_takes_time(tmp_path, rate):
    agreement(storm(tmp_path, "--bitrate", rate).summary)


def test_what_befalls_one_node_is_that_of_this_node(tmp_path):
    """Three nodes that do not begin at 0: each has its own bus-offs, restarts, glitches alone."""
    options = ("--nodes", "3", "--set", "friction.node=5", "--seconds", "20")
    result = storm(tmp_path, *options, bus_off=0.002, restart=0.002, glitch=0.002)
    assert result.summary["node"]["bus_off"] > 3
    assert result.summary["faults"]["injected"]["restart"] == result.summary["node"]["resets"] > 3
    agreement(result.summary)


def test_the_log_shows_each_bus_off(tmp_path):
    """As candump writes an error frame; after it no answer for as long as the timeout."""
    result = storm(tmp_path, bus_off=0.001)
    log = read_log(result.log)
    events = [i for i, frame in enumerate(log) if frame.id == 0x20000040]
    assert len(events) == result.summary["faults"]["expected"]["bus_off"] > 10
    assert result.summary["bus_counts"]["error_frames"] == len(events)
    answers = np.array([frame.time for frame in log if frame.id == 0x110])
    status = np.array([frame.time for frame in log if frame.id == 0x120])
    for event in (log[i].time for i in events):
        assert not ((answers > event) & (answers < event + 0.1)).any()
        assert ((status >= event) & (status <= event + 0.0011)).any()
