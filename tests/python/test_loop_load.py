# SPDX-License-Identifier: MIT
"""A bus that takes time: lengths of frames, arbitration by id, load, latency; up to 16 nodes."""

from __future__ import annotations

import re

import pytest
from loop_tools import SCENES, read_log, run, setting

STEERING = SCENES / "steering.ini"


def bits(identifier: int, data: bytes, extended: bool = False) -> int:
    """Bits of a classic frame, from the standard: stuffed up to the CRC, then 13."""
    low = f"{identifier & 0x3FFFF:018b}"
    head = f"{identifier >> 18:011b}11{low}000" if extended else f"{identifier:011b}000"
    body = f"0{head}{len(data):04b}" + "".join(f"{byte:08b}" for byte in data)
    crc = 0
    for bit in body:
        crc = crc << 1 ^ (0x4599 if (crc >> 14 & 1) != int(bit) else 0)
        crc &= 0x7FFF
    body += f"{crc:015b}"
    count, run_of, last = 0, 0, ""
    for bit in body:
        run_of = run_of + 1 if bit == last else 1
        last, count = bit, count + 1
        if run_of == 5:
            last, run_of, count = str(1 - int(bit)), 1, count + 1
    return count + 13


def test_frames_take_their_bits_and_follow_each_other(tmp_path):
    """Each line of the log ends a frame. With one node the bus is free when its encoder sends."""
    rate = 1_000_000
    log = read_log(run(tmp_path, STEERING, "--virtual", "--seconds", "2", "--bitrate", rate).log)
    free = total = 0
    for frame in log:
        length = bits(frame.id, frame.data)
        assert 111 <= length <= 135
        tick = round(frame.time * 1e6) // 1000 * 1000
        free = max(free, tick) + length
        assert round(frame.time * 1e6) == free, frame
        total += length
    summary = run(tmp_path, STEERING, "--virtual", "--seconds", "2", "--bitrate", rate).summary
    assert summary["bus_load"] == pytest.approx(total / 2 / rate, rel=1e-9)
    assert 0.22 <= summary["bus_load"] <= 0.27
    assert summary["frames_lost"] == summary["deadline_misses"] == 0
    assert 220 <= summary["latency_us"]["p50"] <= 270


@pytest.mark.parametrize("seconds", [0.02, 0.5, 2])
def test_a_bus_is_full_at_most(tmp_path, seconds):
    """Frames that still wait at the end are not of the run. One below a second has a peak."""
    options = ("--virtual", "--bitrate", 50000, "--seconds", seconds)
    result = run(tmp_path, STEERING, *options)
    full = 1 - 0.003 / seconds  # a frame, of up to 135 bits, that is not over at the end
    assert full < result.summary["bus_load"] <= 1
    assert full < result.summary["bus_load_peak"] <= 1.003
    assert result.err.count("note: bus load") == 1
    light = run(tmp_path, STEERING, "--virtual", "--bitrate", 1000000, "--seconds", 0.5).summary
    assert 0.22 < light["bus_load"] == light["bus_load_peak"] < 0.27


@pytest.mark.parametrize(
    ("nodes", "rate", "warned"),
    [(2, 1000000, False), (3, 1000000, True), (2, 700000, False), (2, 680000, True)],
)
def test_a_load_above_70_percent_is_said_once(tmp_path, nodes, rate, warned):
    options = ("--virtual", "--nodes", nodes, "--bitrate", rate, "--seconds", "3")
    result = run(tmp_path, STEERING, *options)
    assert result.code == 0
    assert (result.summary["bus_load_peak"] > 0.7) == warned
    assert result.summary["bus_load_peak"] == pytest.approx(result.summary["bus_load"], rel=0.05)
    words = f"% at {rate} bit/s: above 70 %, frames will wait for each other"
    told = [int(load) for load in re.findall(rf"^note: bus load (\d+) {words}$", result.err, re.M)]
    assert told == [pytest.approx(100 * result.summary["bus_load_peak"], abs=1.5)] * warned
    assert result.err.count("\n") == warned
    assert result.summary["frames_lost"] == 0


def test_a_bus_that_is_too_slow_loses_frames_and_says_so(tmp_path):
    options = ("--virtual", "--nodes", "4", "--bitrate", "500000", "--seconds", "2")
    summary = run(tmp_path, STEERING, *options).summary
    assert summary["bus_load_peak"] > 0.99
    assert summary["deadline_misses"] > 0
    assert summary["frames_lost"] > 0
    assert summary["bus_counts"]["dropped"] > 0


@pytest.mark.parametrize(("nodes", "seconds"), [(3, 5), (3, 0.001), (1, 0.001)])
def test_the_histogram_is_the_latencies(tmp_path, nodes, seconds):
    """Of many answers, and of one that stands alone."""
    options = ("--virtual", "--nodes", nodes, "--bitrate", "1000000", "--seconds", seconds)
    summary = run(tmp_path, STEERING, *options).summary
    edges, counts = zip(*summary["latency_histogram"], strict=True)
    assert list(edges) == sorted(edges)
    assert sum(counts) == summary["frames_answered"] == nodes * round(seconds * 1000)
    assert edges[-1] >= summary["latency_us"]["max"] > (edges[-2] if len(edges) > 1 else 0)
    late = sum(count for edge, count in summary["latency_histogram"] if edge > 1032)
    assert late <= summary["deadline_misses"]
    assert summary["jitter_us"]["max"] <= summary["latency_us"]["max"]


def test_sixteen_nodes_in_virtual_time(tmp_path):
    """Every node has its own encoder and its own torque."""
    options = ("--virtual", "--nodes", "16", "--seconds", "5")
    result = run(tmp_path, STEERING, *options)
    summary = result.summary
    assert summary["frames_sent"] == summary["frames_answered"] == summary["node"]["ok"] == 80_000
    assert summary["max_rss_kib"] < 16 * 1024
    assert summary["node"]["ignored"] == 0
    ids = {frame.id for frame in read_log(result.log)}
    assert ids == {kind + node for kind in (0x100, 0x110, 0x120) for node in range(16)}
    runs = (run(tmp_path, STEERING, *options).summary for _ in range(5))  # the best of them
    assert any(summary["realtime_factor"] >= 20 for summary in runs)


@pytest.mark.parametrize("model", ["dahl", "slip"])
def test_each_of_many_runs_as_it_would_alone(tmp_path, model):
    """Seeds go on from the first one's: motion, faults and bristles are each node's own."""
    many = {"sigma0": "100 60", "Fc": "1 0.5", "model": "slip"} if model == "slip" else {}
    words = setting(*(f"friction.{key}={value}" for key, value in many.items()))
    storm = SCENES / "fault-storm.ini"
    common = ("--virtual", "--seconds", "4", "--set", "faults.bus_off=0", *words)
    three = run(tmp_path / "three", storm, *common, "--nodes", "3", "--set", "friction.node=4")
    log = [frame for frame in read_log(three.log) if 0x100 <= frame.id < 0x160]
    for i in range(3):
        alone = ("--seed", str(1 + i), "--set", f"friction.node={4 + i}")
        one = run(tmp_path / f"{i}", storm, *common, *alone)
        own = [frame for frame in read_log(one.log) if 0x100 <= frame.id < 0x160]
        assert [frame for frame in log if frame.id & 15 == 4 + i] == own
        assert len(own) > 7000


def test_of_a_bus_that_has_its_own_time_only_the_load_is_told(tmp_path):
    """--bitrate beside a served bus changes no frame; in virtual time there are no latencies."""
    words = ("--virtual", "--seconds", "2")
    served = run(tmp_path / "s", STEERING, *words, "--bus", "socketcand:0", "--bitrate", "1000000")
    alone = run(tmp_path / "a", STEERING, *words)
    assert served.code == 0, served.err
    assert served.log.read_bytes() == alone.log.read_bytes()
    total = sum(bits(frame.id, frame.data) for frame in read_log(served.log))
    assert served.summary["bus_load"] == pytest.approx(total / 2 / 1e6, rel=1e-9)
    assert not {"latency_us", "deadline_misses", "jitter_us"} & served.summary.keys()
    assert not {"latency_us", "bitrate", "bus_load"} & alone.summary.keys()


def test_frames_take_their_time_by_the_real_clock_too(tmp_path):
    """A second of it: nothing is lost, and no answer comes before two frames have passed."""
    result = run(tmp_path, STEERING, "--bitrate", "500000", "--seconds", "1")
    summary = result.summary
    assert (result.code, summary["frames_sent"], summary["frames_lost"]) == (0, 1000, 0)
    length = [bits(frame.id, frame.data) for frame in read_log(result.log)]
    assert summary["latency_us"]["p50"] > 2 * 2 * min(length)
    assert summary["bus_load"] == pytest.approx(sum(length) / 500000, rel=0.01)


def test_the_last_answers_come_on_a_bus_that_takes_time(tmp_path):
    """Whatever waits when the last angle is sent: here frames of babblers go before it."""
    words = ["--set", "friction.max_step=2000", "--set", "faults.babble=0.15"]
    options = ("--virtual", "--bitrate", "500000", "--seconds", "0.02", *words)
    for seed in range(12):
        summary = run(tmp_path, STEERING, *options, "--seed", str(seed)).summary
        assert (summary["frames_sent"], summary["frames_lost"]) == (20, 0), seed


@pytest.mark.parametrize("seconds", [5, pytest.param(600, marks=pytest.mark.long)])
@pytest.mark.timeout(700)
def test_four_nodes_at_one_kilohertz_lose_nothing(tmp_path, seconds):
    """Real time, on the bus that is the default here: nothing lost, p99 below one period."""
    options = ("--bus", "socketcand:0", "--nodes", "4", *setting(f"motion.seconds={seconds}"))
    result = run(tmp_path, STEERING, *options, timeout=680)
    summary = result.summary
    assert result.code == 0, result.err
    assert summary["frames_sent"] == summary["frames_answered"] == 4000 * seconds
    assert summary["latency_us"]["p99"] < 1000


def test_lengths_of_extended_frames(tmp_path):
    """An angle with an id of 29 bits takes longer than one with 11, by the standard's bits."""
    words = ["--set", "faults.extended=0.3", "--set", "friction.max_step=2000"]
    rate = 1_000_000
    options = ("--virtual", "--bitrate", rate, "--seconds", "1", *words)
    result = run(tmp_path, STEERING, *options)
    lines = result.log.read_text().splitlines()
    seen = 0
    for line, frame in zip(lines, read_log(result.log), strict=True):
        into = round(frame.time * rate) % 1000
        if " 00000100#" in line and into < 200:  # the bus was free when it was sent
            assert into == bits(0x100, frame.data, extended=True)
            seen += 1
    assert seen > 100


def test_the_peak_is_the_fullest_second(tmp_path):
    """With pauses of an encoder the seconds differ; the fullest one is told, also the last."""
    words = setting("faults.silence=0.002", "friction.max_step=2000", "friction.timeout_ms=400")
    rate = 1_000_000
    options = ("--virtual", "--bitrate", rate, *words, "--seconds")
    told = [run(tmp_path, STEERING, *options, seconds).summary for seconds in range(1, 13)]
    loads = [0.0] * 13
    for frame in read_log(tmp_path / "run.log"):
        loads[int(frame.time)] += bits(frame.id, frame.data) / rate
    for i, summary in enumerate(told):
        assert summary["bus_load_peak"] == pytest.approx(max(loads[: i + 1]), rel=0.01)
        assert summary["bus_load"] == pytest.approx(sum(loads[: i + 1]) / (i + 1), rel=0.01)
    rises = [loads[i] > 1.1 * max(loads[:i]) for i in range(1, 12)]
    assert any(rises) and not all(rises), "this seed shows nothing: take another"
