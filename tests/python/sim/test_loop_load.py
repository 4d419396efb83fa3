# SPDX-License-Identifier: MIT
"""A bus that takes time: load, latencies and jitter of the summary against the log; many nodes."""

from __future__ import annotations

import re

import numpy as np
import pytest
from loop_model import bits
from loop_tools import SCENES, Logged, Run, read_log, run, setting

STEERING = SCENES / "steering.ini"
LATE_LINES = re.compile(r"^note: bus load (\d+) % at (\d+) bit/s: above 70 %.*$", re.MULTILINE)


def timed(folder, rate: int, *options: object) -> tuple[Run, list[Logged]]:
    result = run(folder, STEERING, "--virtual", "--bitrate", rate, *options)
    assert result.code == 0
    return result, read_log(result.log)


def latencies_of(log: list[Logged]) -> dict[int, list[int]]:
    """Latencies of each node's answers in us. An angle was asked for at its tick."""
    latencies, sent, ticks = {}, {}, {}
    for frame in log:
        node = frame.id & 15
        if frame.id & ~15 == 0x100:
            ticks[node, frame.data[1] & 15] = sent[node] = sent.get(node, -1) + 1
        elif frame.id & ~15 == 0x110:
            tick = ticks[node, frame.data[2] & 15]
            latencies.setdefault(node, []).append(round(frame.time * 1e6) - 1000 * tick)
    return latencies


def quantile(values: np.ndarray, part: float) -> float:
    return float(np.sort(values)[int(np.ceil(part * len(values))) - 1])


def check_histogram(stated: dict, values: np.ndarray) -> None:
    """Median, 99 % and greatest: the histogram's bins are 1/32 of their place wide."""
    for name, part in (("p50", 0.5), ("p99", 0.99)):
        exact = quantile(values, part)
        assert exact - 1e-3 <= stated[name] <= exact * 33 / 32 + 1e-3, name
    assert stated["max"] == pytest.approx(values.max(), abs=1e-3)


RUNS = [  # bit/s, nodes, s, load above 70 %
    (1_000_000, 1, 2, False),
    (1_000_000, 2, 3, False),
    (1_000_000, 3, 2, True),
    (700_000, 2, 3, False),
    (680_000, 2, 3, True),
    (500_000, 1, 2.5, False),
    (1_000_000, 3, 0.001, True),
    (700_000, 3, 0.05, True),  # answers to two of the encoders come too late
]


@pytest.mark.parametrize(("rate", "nodes", "seconds", "is_high"), RUNS)
def test_the_summary_has_latencies_and_load_of_the_log(tmp_path, rate, nodes, seconds, is_high):
    """Latency, jitter, deadlines and load. Order of the frames: tests/port/test_buses.c."""
    result, log = timed(tmp_path, rate, "--nodes", nodes, "--seconds", seconds)
    latencies = latencies_of(log)
    summary, every = result.summary, np.concatenate([*latencies.values()])
    ticks = round(seconds * 1000)
    assert summary["frames_sent"] == summary["frames_answered"] == len(every) == nodes * ticks
    assert (summary["nodes"], summary["bitrate"], summary["ticks"]) == (nodes, rate, ticks)
    check_histogram(summary["latency_us"], every)
    jitter = np.concatenate([np.abs(np.diff(one)) for one in latencies.values()])
    if len(jitter):
        check_histogram(summary["jitter_us"], jitter)
    assert summary["deadline_misses"] == summary["late_answers"] == np.count_nonzero(every > 1000)
    assert summary["late_ticks"] == 0
    edges, counts = np.array(summary["latency_histogram"]).T
    assert (np.diff(edges) > 0).all() and counts.sum() == len(every)
    below = [np.count_nonzero(every <= edge + 1e-3) for edge in edges]
    assert np.cumsum(counts).tolist() == below
    total = sum(bits(frame) for frame in log if frame.time <= seconds)
    assert summary["bus_load"] == pytest.approx(total / seconds / rate, rel=3e-3)
    assert summary["bus_load_peak"] == pytest.approx(summary["bus_load"], rel=0.05)
    assert round(log[0].time * 1e6) == np.ceil(bits(log[0]) * 1e6 / rate)  # not before its end
    check_note(result, rate, is_high)


def check_note(result: Run, rate: int, is_high: bool) -> None:
    """A load above 70 % is noted once."""
    peak = result.summary["bus_load_peak"]
    noted = [(int(load), int(at)) for load, at in LATE_LINES.findall(result.err)]
    assert (peak > 0.7) == is_high == result.err.count("\n")
    assert noted == [(pytest.approx(100 * peak, abs=1.5), rate)] * is_high


@pytest.mark.parametrize(("rate", "nodes", "seconds"), [(500_000, 4, 2), (50_000, 1, 0.02)])
def test_a_bus_that_is_too_slow_loses_frames_and_counts_them(tmp_path, rate, nodes, seconds):
    """It is full, not fuller: frames that wait do not count."""
    result, log = timed(tmp_path, rate, "--nodes", nodes, "--seconds", seconds)
    summary, counts = result.summary, result.summary["bus_counts"]
    check_note(result, rate, True)
    least = 1 - 0.003 / seconds  # a frame, of up to 135 bits, that is not over at the end
    assert least < summary["bus_load"] <= 1 and least < summary["bus_load_peak"] <= 1.003
    assert (counts["dropped"] > 0) == (seconds == 2) and summary["deadline_misses"] > 0
    assert counts["send_failed"] == counts["dropped"]
    assert summary["frames_lost"] == summary["frames_sent"] - summary["frames_answered"] > 0
    ends = np.array([frame.time for frame in log]) * 1e6
    lengths = np.array([bits(frame) for frame in log]) * 1e6 / rate
    assert (np.diff(ends) >= lengths[1:] - 1).all()


def test_the_peak_is_the_fullest_second(tmp_path):
    """Pauses of an encoder make the seconds differ. The last second counts too."""
    words = setting("faults.silence=0.002", "friction.max_step=2000", "friction.timeout_ms=400")
    rate = 1_000_000
    runs = [timed(tmp_path, rate, *words, "--seconds", seconds) for seconds in range(1, 13)]
    loads = np.zeros(13)
    for frame in runs[-1][1]:
        loads[int(frame.time)] += bits(frame) / rate
    for i, (result, _) in enumerate(runs):
        assert result.summary["bus_load_peak"] == pytest.approx(max(loads[: i + 1]), rel=0.01)
        assert result.summary["bus_load"] == pytest.approx(np.mean(loads[: i + 1]), rel=0.01)
    rises = [loads[i] > 1.1 * max(loads[:i]) for i in range(1, 12)]
    assert any(rises) and not all(rises), "this seed shows nothing: take another"


def test_a_bit_rate_on_a_served_bus_gives_the_load_only(tmp_path):
    """It changes no frame. Virtual time has no latencies."""
    words = ("--virtual", "--seconds", "2")
    served, log = timed(tmp_path / "s", 1_000_000, *words, "--bus", "socketcand:0")
    alone = run(tmp_path / "a", STEERING, *words)
    assert served.log.read_bytes() == alone.log.read_bytes()
    total = sum(map(bits, log))
    assert served.summary["bus_load"] == pytest.approx(total / 2 / 1e6, rel=1e-9)
    assert not {"latency_us", "deadline_misses", "jitter_us"} & served.summary.keys()


# --- many nodes, and real time --------------------------------------------------------------------


SLIP = ("friction.model=slip", "friction.sigma0=100 60", "friction.Fc=1 0.5")


@pytest.mark.parametrize("keys", [(), SLIP], ids=["dahl", "slip"])
def test_each_of_three_nodes_behaves_as_alone(tmp_path, keys):
    """Seeds are consecutive: motion, faults and bristles are separate."""
    common = ("--virtual", "--seconds", "4", *setting("faults.bus_off=0", *keys))
    storm = SCENES / "fault-storm.ini"
    three = run(tmp_path, storm, *common, "--nodes", "3", "--set", "friction.node=4")
    log = [frame for frame in read_log(three.log) if 0x100 <= frame.id < 0x160]
    sums = dict.fromkeys(three.summary["node"], 0)
    for i in range(3):
        alone = ("--seed", 1 + i, "--set", f"friction.node={4 + i}")
        one = run(tmp_path, storm, *common, *alone)
        own = [frame for frame in read_log(one.log) if 0x100 <= frame.id < 0x160]
        assert [frame for frame in log if frame.id & 15 == 4 + i] == own and len(own) > 7000
        sums = {name: sums[name] + count for name, count in one.summary["node"].items()}
    sums["ignored"] = three.summary["node"]["ignored"]  # each node counts the babble of its number
    assert sums == three.summary["node"]


@pytest.mark.parametrize("seconds", [2, pytest.param(600, marks=pytest.mark.long)])
@pytest.mark.timeout(700)
def test_four_nodes_at_one_kilohertz_lose_nothing(tmp_path, seconds):
    options = ("--bus", "socketcand:0", "--nodes", "4", *setting(f"motion.seconds={seconds}"))
    result = run(tmp_path, STEERING, *options, timeout=680)
    summary = result.summary
    assert result.code == 0, result.err
    assert summary["frames_sent"] == summary["frames_answered"] == 4000 * seconds
