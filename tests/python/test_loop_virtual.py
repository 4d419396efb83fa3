# SPDX-License-Identifier: MIT
"""dahl-loop in virtual time: determinism, exact torque, speed, memory, parts that are not run."""

from __future__ import annotations

import struct
import subprocess
import zlib
from pathlib import Path

import mpmath
import numpy as np
import pytest
from loop_tools import SCENES, Logged, counts_of, program, read_log, run, torques_of

SHIPPED = ("segments", "steering")
FRICTION = "[friction]\nsigma0 = 50\nFc = 0.5\ntheta_per_count = 1e-4\n"
MOTION = "[motion]\nkind = segments\ntheta1 = 200\ntheta2 = -100\ntheta3 = 300\nspeed = 2000\n"
STATUS = "[status]\nperiod_ms = 100\n"


def scene(folder: Path, *parts: str) -> Path:
    path = folder / "scene.ini"
    path.write_text("\n".join(parts), encoding="utf-8")
    return path


def exact_ratios(counts: list[int], sigma0: float, Fc: float, theta: float) -> list[mpmath.mpf]:
    """F/Fc after each count from rest: Eq. 1 in closed form between reversals, in 120 bits."""
    ratios = []
    with mpmath.workprec(120):
        a = (
            mpmath.mpf(float(np.float32(sigma0)))
            / mpmath.mpf(float(np.float32(Fc)))
            * float(np.float32(theta))
        )
        w = start = mpmath.mpf(0)
        side, run_of = 0, 0
        for before, now in zip([counts[0], *counts[:-1]], counts, strict=True):
            move = (now - before + 2**31) % 2**32 - 2**31
            sign = (move > 0) - (move < 0)
            if sign not in (0, side):
                side, start, run_of = sign, w, 0
            run_of += abs(move)
            if sign:
                w = side - (side - start) * mpmath.exp(-a * run_of)
            ratios.append(w)
    return ratios


def check_exact(log: list[Logged], sigma0: float, Fc: float, theta: float) -> None:
    """Each answer within 9.4e-10 of Fc (Q30), its torque within 0.52 ulp of Fc."""
    answers, exact = torques_of(log), exact_ratios(counts_of(log), sigma0, Fc, theta)
    assert [state for state, _ in answers] == [6] + [0] * (len(answers) - 1)
    assert len(answers) == len(exact)
    limit = np.float32(Fc)
    ulp = float(np.spacing(limit))
    for (_, ratio), want in zip(answers, exact, strict=True):
        assert abs(mpmath.mpf(ratio) / 2**30 - want) < 9.4e-10
        torque = np.float32(ratio * 2.0**-30 * float(limit))
        assert abs(float(torque) - want * float(limit)) <= 0.52 * ulp


@pytest.mark.parametrize("name", [*SHIPPED, "parking", "fault-storm"])
def test_same_seed_same_bytes(tmp_path, name):
    """And another seed is another run, but for a motion without chance."""
    words = (SCENES / f"{name}.ini", "--virtual", "--seed")
    runs = (run(tmp_path, *words, seed) for seed in (7, 7, 8))
    first, again, other = ((result.code, result.log.read_bytes()) for result in runs)
    assert first[0] == 0
    assert first == again
    assert (first == other) == (name == "segments")


def test_a_seed_means_the_same_motion_on_every_machine(tmp_path):
    log = read_log(run(tmp_path, SCENES / "steering.ini", "--virtual", "--seed", "1").log)
    assert zlib.crc32(np.array(counts_of(log), "<i4").tobytes()) == 4068242989


@pytest.mark.parametrize(
    ("name", "sigma0", "Fc", "theta"),
    [("segments", 50, 0.5, 9.587379924285257e-05), ("steering", 120, 1.8, 2.396844981071314e-05)],
)
def test_a_shipped_motion_is_exact(tmp_path, name, sigma0, Fc, theta):
    result = run(tmp_path, SCENES / f"{name}.ini", "--virtual", "--seconds", "10")
    check_exact(read_log(result.log), sigma0, Fc, theta)


def test_count_that_wraps_at_32_bits_is_exact(tmp_path):
    path = scene(tmp_path, FRICTION, MOTION, "start_count = 2147483600")
    log = read_log(run(tmp_path, path, "--virtual").log)
    counts = counts_of(log)
    assert counts[0] == 2147483600 and min(counts) < -(2**31) + 300
    check_exact(log, 50, 0.5, 1e-4)


def test_measured_log_is_exact_and_complete(tmp_path, measured_file):
    file = measured_file("tribometer", "reciprocating.tsv")
    result = run(tmp_path, SCENES / "tribometer.ini", "--virtual", "--data", str(file.parents[1]))
    assert result.code == 0, result.err
    log = read_log(result.log)
    position = np.loadtxt(file, skiprows=1, usecols=2, delimiter="\t")
    assert counts_of(log) == np.rint((position - position[0]) * 10000).astype(int).tolist()
    check_exact(log, 36500, 2.70, 1e-7)


@pytest.mark.parametrize("name", SHIPPED)
def test_virtual_time_is_200_times_real_time_and_nothing_is_lost(tmp_path, name):
    """In the memory of a small machine. The best of five runs, as this one has other work too."""
    summaries = [run(tmp_path, SCENES / f"{name}.ini", "--virtual").summary for _ in range(5)]
    assert max(summary["realtime_factor"] for summary in summaries) >= 200
    for said in summaries:
        sent, answered, ok = said["frames_sent"], said["frames_answered"], said["node"]["ok"]
        assert sent == answered == ok == said["ticks"] and said["frames_lost"] == 0
        assert said["time"] == "virtual" and said["max_rss_kib"] < 16 * 1024


def test_memory_does_not_grow_with_the_log_file(tmp_path):
    rows = "".join(f"{i % 1000}\n" for i in range(2_000_000))
    (tmp_path / "big.csv").write_text("angle\n" + rows)
    motion = "[motion]\nkind = log\nfile = big.csv\nangle = angle\ncounts_per_unit = 1\n"
    summary = run(tmp_path, scene(tmp_path, FRICTION, motion), "--virtual").summary
    assert summary["frames_answered"] == 2_000_000
    assert 512 < summary["max_rss_kib"] < 16 * 1024


@pytest.mark.parametrize(
    ("parts", "options", "ids"),
    [
        ((MOTION,), (), {0x100}),
        ((FRICTION, MOTION, STATUS), ("--role", "encoder"), {0x100}),
        ((FRICTION, STATUS), ("--seconds", "2"), {0x120}),
        ((FRICTION, MOTION, STATUS), ("--role", "node", "--seconds", "2"), {0x120}),
    ],
)
def test_a_part_that_is_not_there_is_not_run(tmp_path, parts, options, ids):
    result = run(tmp_path, scene(tmp_path, *parts), "--virtual", *options)
    log = read_log(result.log)
    assert (result.code, {frame.id for frame in log}) == (0, ids), result.err
    assert ("node" in result.summary, result.summary.get("frames_answered")) == (
        (True, None) if ids == {0x120} else (False, 0)
    )
    period = 0.1 if ids == {0x120} else 0.001
    assert [frame.time for frame in log] == pytest.approx(np.arange(len(log)) * period, abs=1e-9)


def test_without_status_only_news_is_told(tmp_path):
    """That of power-on, in the first tick."""
    result = run(tmp_path, scene(tmp_path, FRICTION, MOTION), "--virtual")
    ids = [frame.id for frame in read_log(result.log)]
    assert set(ids) == {0x100, 0x110, 0x120}
    assert (ids.count(0x120), ids[0]) == (1, 0x120)


def test_node_number_is_used_by_both(tmp_path):
    result = run(tmp_path, scene(tmp_path, FRICTION, "node = 9", MOTION, STATUS), "--virtual")
    assert {frame.id for frame in read_log(result.log)} == {0x109, 0x119, 0x129}
    assert result.summary["frames_lost"] == 0


def test_answers_follow_their_frames_and_echo_them(tmp_path):
    log = [
        frame
        for frame in read_log(run(tmp_path, SCENES / "segments.ini", "--virtual").log)
        if frame.id < 0x120
    ]
    for question, answer in zip(log[::2], log[1::2], strict=True):
        assert (question.id, answer.id) == (0x100, 0x110)
        assert answer.data[2] == question.data[1] & 15


@pytest.mark.parametrize("delimiter", [",", ";", "\t"])
@pytest.mark.parametrize("end", ["\n", "\r\n"])
@pytest.mark.parametrize("first", ["t [s]", '"t [s]"'])
def test_log_files_of_many_shapes(tmp_path, delimiter, end, first):
    """With a column without a name, a long name, long rows, and no end of the last row, or two."""
    name = "angle of the steering wheel, absolute [deg]"
    values = [(0, 1.5), (0.001, 1.6), (0.001, 1.4), (5, -2.0)]
    rows = [
        [first, "", f'"{name}"', "note"],
        *([str(t), "9", str(v), "x" * 60000] for t, v in values),
    ]
    text = "\ufeff" + end.join(delimiter.join(row) for row in rows)
    (tmp_path / "log.csv").write_bytes((text if end == "\n" else text + end + end).encode())
    motion = f"[motion]\nkind = log\nfile = log.csv\nangle = {name}\ntime = t [s]\n"
    motion += "counts_per_unit = 10\n"
    result = run(tmp_path, scene(tmp_path, FRICTION, motion), "--virtual")
    assert result.code == 0, result.err
    assert counts_of(read_log(result.log)) == [0, 1, -1, -35]


def test_angles_between_two_counts_go_to_the_nearest(tmp_path):
    (tmp_path / "log.csv").write_text("a,\n0.5,9\n0.54,8\n0.56,7\n0.46,7\n0.44,7\n1.4999999999,7\n")
    for side in (1, -1):
        motion = f"[motion]\nkind = log\nfile = log.csv\nangle = a\ncounts_per_unit = {side}0\n"
        result = run(tmp_path, scene(tmp_path, FRICTION, motion), "--virtual")
        assert counts_of(read_log(result.log)) == [side * c for c in (0, 0, 1, 0, -1, 10)]


def test_where_a_measured_log_is_looked_for(tmp_path):
    """Beside the scene, else in --data; an absolute path is one; --log-file goes before all."""
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
        motion = f"[motion]\nkind = log\nfile = {file}\nangle = a\ncounts_per_unit = 1\n"
        path = scene(tmp_path / "beside", FRICTION, motion)
        result = run(tmp_path, path, "--virtual", *options)
        assert counts_of(read_log(result.log)) == [0, end], (file, options)


def test_the_summary_says_what_was_run(tmp_path):
    path = scene(tmp_path, "[scene]\ntitle = A shaft", FRICTION, MOTION, STATUS)
    seed = 2**64 - 59  # more than a double holds
    words = ("--seed", seed, "--seconds", "0.02")
    for time, options in (("real", ()), ("virtual", ("--virtual", "--bus", "socketcand:0"))):
        said = run(tmp_path / time, path, *words, *options).summary
        assert (said["time"], said["seed"], said["ticks"]) == (time, seed, 20)
        assert (said["title"], said["scene"]) == ("A shaft", str(path))
        assert said["bus"] == (options[2] if options else "loopback")
        assert ("beat_late_us" in said) == ("latency_us" in said) == (time == "real")
    slow = run(tmp_path / "slow", path, *words, "--virtual", "--bitrate", "250000").summary
    assert (slow["bitrate"], slow["nodes"]) == (250000, 1)
    assert 0 < slow["wall_s"] < 5


def test_a_scene_is_read_whatever_ends_its_lines_and_what_is_for_plots_is_left(tmp_path):
    parts = (FRICTION, MOTION, STATUS, "[measured]\ntorque = Friction [uN]\nspring = none\n")
    plain = run(tmp_path / "plain", scene(tmp_path, FRICTION, MOTION, STATUS), "--virtual")
    path = scene(tmp_path, *parts)
    path.write_bytes(path.read_bytes().replace(b"\n", b"\r\n"))
    same = run(tmp_path / "same", path, "--virtual")
    assert (same.code, same.err) == (0, "")
    assert same.log.read_bytes() == plain.log.read_bytes()


def test_a_setting_may_hold_blanks_and_equals_signs(tmp_path):
    words = ("--set", "scene.title=a = b; c", "--set", "friction.gain=0.5")
    again = ("--set", "friction.gain=1", "--set", "friction.limit= 0.25")  # the last one holds
    path = scene(tmp_path, FRICTION, MOTION)
    result = run(tmp_path / "run", path, "--virtual", *words, *again)
    assert (result.code, result.err) == (0, "")
    assert result.summary["title"] == "a = b; c"
    ratios = [ratio for _, ratio in torques_of(read_log(result.log))]
    assert (max(ratios), min(ratios)) == (2**28, -(2**28))


@pytest.mark.parametrize("name", ["scene.ini", "./scene.ini", "../here/scene.ini"])
def test_a_scene_may_be_named_from_where_one_is(tmp_path, name):
    folder = tmp_path / "here"
    folder.mkdir()
    (folder / "log.csv").write_text("a\n0\n7\n")
    motion = "[motion]\nkind = log\nfile = log.csv\nangle = a\ncounts_per_unit = 1\n"
    scene(folder, FRICTION, motion)
    words = [program(), "--scene", name, "--virtual", "--log", "run.log"]
    subprocess.run(words, cwd=folder, timeout=20, check=True)
    assert counts_of(read_log(folder / "run.log")) == [0, 7]


def test_status_frames_carry_the_version_and_no_error(tmp_path):
    log = read_log(run(tmp_path, SCENES / "steering.ini", "--virtual", "--seconds", "1").log)
    statuses = [frame.data for frame in log if frame.id == 0x120]
    assert len(statuses) == 10
    assert all(struct.unpack("8B", data)[2:6] == (0, 0, 0, 0) for data in statuses)
    said = subprocess.check_output([program(), "--version"], text=True)
    major, minor = map(int, said.split()[1].split(".")[:2])
    assert {data[6] for data in statuses} == {major << 4 | minor}
