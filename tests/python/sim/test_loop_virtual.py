# SPDX-License-Identifier: MIT
"""dahl-loop in virtual time: counts against a model of the motion (loop_model.py), answers against
a dahl.Node; determinism, memory, absent parts, logs that are replayed.
"""

import random
import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from loop_model import Steering, nearest, segments
from loop_tools import SCENES, check_node, counts_of, read_log, run, scene_with, setting

FRICTION = "[friction]\nsigma0 = 50\nFc = 0.5\ntheta_per_count = 1e-4\n"
MOTION = "[motion]\nkind = segments\ntheta1 = 200\ntheta2 = -100\ntheta3 = 300\nspeed = 2000\n"
STATUS = "[status]\nperiod_ms = 100\n"
REPLAY = "[motion]\nkind = log\nfile = log.csv\nangle = {}\ncounts_per_unit = {}\n"
BIG = 2147483600  # a count that wraps soon


def scene(folder: Path, *parts: str) -> Path:
    path = folder / "scene.ini"
    path.write_text("\n".join(parts), encoding="utf-8")
    return path


def wrapped(counts: list[int], start: int = 0) -> list[int]:
    return [(count + start + 2**31) % 2**32 - 2**31 for count in counts]


STEER = Steering(131072, 2.5, 600, 0.15, 30, 0.8)
VARIED = {"amplitude": 9e5, "sweep_s": 0.3, "tremor": 0, "tremor_s": 1, "seconds": 20, "hold_s": 1}
TREMOR = {"amplitude": 0, "tremor": 5e4, "tremor_s": 0.5}
ENDS = {"theta1": 0, "theta2": 7, "theta3": 7, "hold_s": 0}
QUICK = {"speed": 1e3, "hold_s": 0.05}
PLAYED = [  # scene, keys of [motion], seed, counts
    ("segments", {}, 1, segments(209, -104, 313, speed=200, hold_s=0.2)),
    ("segments", QUICK, 5, segments(209, -104, 313, **QUICK)),
    ("segments", ENDS, 1, segments(0, 7, 7, speed=200)),
    ("steering", {"start_count": BIG}, 2**64 - 1, wrapped(STEER.counts(2**64 - 1), BIG)),
    ("steering", VARIED, 7, Steering(**VARIED).counts(7)),
    ("steering", TREMOR, 3, Steering(0, 2.5, 5e4, 0.5, 30, 0.8).counts(3)),
]


@pytest.mark.parametrize(("name", "keys", "seed", "counts"), PLAYED)
def test_counts_follow_the_scene_and_the_answers_those_of_a_node(
    tmp_path, name, keys, seed, counts
):
    path = scene_with(tmp_path, name, *(f"motion.{key}={value}" for key, value in keys.items()))
    result = run(tmp_path, path, "--virtual", "--seed", seed)
    assert (result.code, result.err) == (0, "")
    check_node(result, path)
    log, summary = read_log(result.log), result.summary
    assert counts_of(log) == counts
    assert [frame.id for frame in log if frame.id != 0x120] == [0x100, 0x110] * len(counts)
    assert summary["frames_sent"] == summary["frames_answered"] == summary["ticks"] == len(counts)
    assert summary["frames_lost"] == summary["answers_unmatched"] == summary["answers_corrupt"] == 0
    assert {*summary["bus_counts"].values()} == {0}
    assert [f.time for f in log if f.id == 0x100] == [tick / 1000 for tick in range(len(counts))]


@pytest.mark.parametrize("name", ["segments", "steering", "parking", "fault-storm"])
def test_same_seed_same_bytes(tmp_path, name):
    words = (SCENES / f"{name}.ini", "--virtual")
    seeds = ("--seed", 7), ("--seed", 7), ("--seed", 1), ()
    first, again, other, none = (run(tmp_path, *words, *s).log.read_bytes() for s in seeds)
    assert first == again and other == none
    assert (first == other) == (name == "segments")


def test_measured_log_is_complete(tmp_path, measured_file):
    file = measured_file("tribometer", "reciprocating.tsv")
    result = run(tmp_path, SCENES / "tribometer.ini", "--virtual", "--data", file.parents[1])
    position = np.loadtxt(file, skiprows=1, usecols=2, delimiter="\t")
    due = np.rint((position - position[0]) * 10000).astype(int).tolist()
    assert counts_of(read_log(result.log)) == due
    check_node(result, SCENES / "tribometer.ini")


def test_memory_does_not_grow_with_the_log_file(tmp_path):
    rows = "".join(f"{i % 1000}\n" for i in range(2_000_000))
    (tmp_path / "log.csv").write_text("angle\n" + rows)
    path = scene(tmp_path, FRICTION, REPLAY.format("angle", 1))
    summary = run(tmp_path, path, "--virtual", "--log", "/dev/null").summary
    assert summary["frames_answered"] == 2_000_000
    assert 512 < summary["max_rss_kib"] < 8 * 1024


PARTS = [  # of the scene, options, identifiers on the bus
    ((MOTION,), (), {0x100}),
    ((FRICTION, MOTION, STATUS), ("--role", "encoder"), {0x100}),
    ((FRICTION, STATUS), ("--seconds", "2"), {0x120}),
    ((FRICTION, MOTION, STATUS), ("--role", "node", "--seconds", "2"), {0x120}),
    ((FRICTION, "node = 9", MOTION, STATUS), (), {0x109, 0x119, 0x129}),
]


@pytest.mark.parametrize(("parts", "options", "ids"), PARTS)
def test_an_absent_part_sends_no_frame(tmp_path, parts, options, ids):
    result = run(tmp_path, scene(tmp_path, *parts), "--virtual", *options)
    log, summary = read_log(result.log), result.summary
    assert (result.code, {frame.id for frame in log}) == (0, ids), result.err
    assert ("node" in summary, "frames_sent" in summary) == (ids != {0x100}, ids != {0x120})
    assert not {"control", "faults", "latency_us"} & summary.keys()
    if len(ids) < 3:
        period = 0.1 if ids == {0x120} else 0.001
        assert [f.time for f in log] == pytest.approx(np.arange(len(log)) * period, abs=1e-9)


ANGLE = "angle of the steering wheel, absolute [deg]"


def test_a_log_is_replayed_to_the_nearest_count(tmp_path):
    """Counts start at the first row or at start_count, and wrap. Forms of logs: tests/python/io."""
    rng = random.Random(1)
    for scale, start in [(10, 0), (-10, 0), (10, BIG), (-1e7, -BIG)]:
        angles = [rng.randrange(-800, 800) / 8 for _ in range(200)]
        times = sorted(rng.choice(range(300)) / 1000 for _ in angles)
        path = scene(tmp_path, FRICTION, REPLAY.format(ANGLE, scale), "time = t [s]\n")
        table = pd.DataFrame({"t [s]": times, "note": 9, ANGLE: angles})
        table.to_csv(tmp_path / "log.csv", index=False, sep=rng.choice(",;\t"))
        result = run(tmp_path, path, "--virtual", *setting(f"motion.start_count={start}"))
        assert (result.code, result.err) == (0, "")
        due = wrapped([nearest(scale * angle - scale * angles[0]) for angle in angles], start)
        assert counts_of(read_log(result.log)) == due, scale


def test_a_log_is_searched_next_to_the_scene_then_in_data(tmp_path, monkeypatch):
    for end, name in enumerate(("beside", "data", "own")):
        (tmp_path / name).mkdir()
        (tmp_path / name / "log.csv").write_text(f"a\n0\n{end}\n")
    own = str(tmp_path / "own" / "log.csv")
    data = ("--data", str(tmp_path / "data"))
    for file, options, end in (
        ("log.csv", (), 0),
        ("log.csv", data, 1),
        (own, data, 2),
        ("log.csv", (*data, "--log-file", own), 2),
    ):
        text = REPLAY.format("a", 1).replace("log.csv", file)
        path = scene(tmp_path / "beside", FRICTION, text)
        result = run(tmp_path, path, "--virtual", *options)
        assert counts_of(read_log(result.log)) == [0, end], (file, options)
    scene(tmp_path / "beside", FRICTION, REPLAY.format("a", 1))
    monkeypatch.chdir(tmp_path / "beside")
    for name in ("scene.ini", "./scene.ini", "../beside/scene.ini"):
        for options, end in ((), 0), (("--log-file", "../own/log.csv"), 2):
            log = run(tmp_path, name, "--virtual", *options).log
            assert counts_of(read_log(log)) == [0, end], (name, options)


@pytest.mark.parametrize(("seconds", "ticks"), [("0.001", 1), ("1.2346", 1235), ("0.0015", 2)])
def test_seconds_are_rounded_to_ticks(tmp_path, seconds, ticks):
    path = SCENES / "steering.ini"
    whole = run(tmp_path, path, "--virtual", "--seconds", seconds)
    assert (whole.summary["ticks"], whole.err) == (ticks, "")
    short = setting(f"motion.seconds={seconds}")
    ended = run(tmp_path, path, "--virtual", "--nodes", 16, "--seconds", 9, *short)
    assert ended.summary["ticks"] == ticks
    assert re.fullmatch(rf"note: .*\b9\b.*\b{ticks / 1000} s\n", ended.err)
    assert run(tmp_path, path, "--virtual", *short).err == ""


def test_the_summary_describes_the_run(tmp_path):
    """Of two settings of one key the last one counts."""
    path = scene(tmp_path, "[scene]\ntitle = A shaft", FRICTION, MOTION, STATUS)
    seed = 2**64 - 59  # more than a double holds
    words = ("--seed", seed, "--seconds", "0.02", *setting("scene.title=x", "scene.title=a = b; c"))
    served = ("--virtual", "--bus", "socketcand:0")
    for time, bus, options in (("real", "loopback", ()), ("virtual", "socketcand:0", served)):
        summary = run(tmp_path / time, path, *words, *options).summary
        facts = {"time": time, "bus": bus, "seed": seed, "ticks": 20, "nodes": 1}
        assert summary == summary | facts | {"title": "a = b; c", "scene": str(path)}
        assert ("beat_late_us" in summary) == ("latency_us" in summary) == (time == "real")
        assert 0 < summary["wall_s"] < 5 and 512 < summary["max_rss_kib"] < 16 * 1024
        assert summary["realtime_factor"] == pytest.approx(0.02 / summary["wall_s"], rel=1e-6)


def test_a_time_is_rounded_to_the_next_microsecond(tmp_path):
    """1.001 ms is 1000.9999 us in double. It is longer than a tick, so every second tick is due."""
    path = scene(tmp_path, FRICTION, MOTION, "[status]\nperiod_ms = 1.001\n")
    ids = [frame.id for frame in read_log(run(tmp_path, path, "--virtual").log)]
    assert ids.count(0x120) == (ids.count(0x100) + 1) // 2
