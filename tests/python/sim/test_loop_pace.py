# SPDX-License-Identifier: MIT
"""Ticks in real time with a replaced clock: the period, and how the loop catches up after a
stall.
"""

import os
import subprocess
from pathlib import Path

import numpy as np
import pytest
from loop_tools import SCENES, Run, command, finished, read_log, spawn

STEERING = SCENES / "steering.ini"
TICK = 1e-3  # s
CLOCK = """
#include <stdlib.h>
#include <time.h>
static long long now = 1000000000000000000;
int clock_gettime(clockid_t id, struct timespec *to)
{
    static long long begun, stalled;
    long long at = atoll(getenv("STALL_AT")), length = atoll(getenv("STALL"));
    (void)id;
    begun = begun == 0 ? now : begun;
    now += 100; /* ns for a reading */
    if (!stalled && now - begun > at) {
        stalled = 1;
        now += length;
    }
    to->tv_sec = now / 1000000000, to->tv_nsec = now % 1000000000;
    return 0;
}
int nanosleep(const struct timespec *want, struct timespec *left)
{
    (void)left;
    now += want->tv_sec * 1000000000LL + want->tv_nsec;
    return 0;
}
"""


@pytest.fixture(scope="module")
def clock(tmp_path_factory) -> Path:
    """A clock for LD_PRELOAD that does not depend on the machine and can jump."""
    path = tmp_path_factory.mktemp("clock") / "clock.so"
    words = ["cc", "-shared", "-fPIC", "-x", "c", "-", "-o", str(path)]
    subprocess.run(words, input=CLOCK, text=True, check=True, timeout=60)
    return path


def timed(folder: Path, clock: Path, stall: float, *options: str) -> Run:
    planted = {"LD_PRELOAD": str(clock), "STALL_AT": "500000000", "STALL": str(int(stall * 1e9))}
    folder.mkdir(exist_ok=True)
    words = command(folder, STEERING, *options)
    return finished(folder, spawn(words, env={**os.environ, **planted}))


def due_times(stall: float, ticks: int) -> tuple[np.ndarray, np.ndarray]:
    """Time and delay of each tick: 3/4 ms or more after the last one, no catching up beyond 1 s."""
    times, late, due, soonest, begins = [], [], 0.0, 0.0, 0.5
    for _ in range(ticks):
        now = max(due, soonest)
        if now > begins:
            now, begins = max(now, begins + stall), np.inf
        times.append(now)
        late.append(now - due)
        due += TICK + (late[-1] if late[-1] > 1 else 0)
        soonest = now + 0.75 * TICK
    return np.array(times), np.array(late)


@pytest.mark.parametrize(("stall", "seconds"), [(0, 3), (0.3, 3), (0.95, 6), (1.5, 2), (3, 2)])
def test_ticks_keep_1_ms_and_catch_up_a_third_faster_after_a_stall(tmp_path, clock, stall, seconds):
    result = timed(tmp_path, clock, stall, "--seconds", str(seconds))
    times = np.array([frame.time for frame in read_log(result.log) if frame.id == 0x100])
    summary = result.summary
    assert len(times) == summary["ticks"] == seconds * 1000
    due, late = due_times(stall, len(times))
    assert np.abs(times - times[0] - due).max() < (2e-3 if 0 < stall < 1 else 2e-4)
    gaps = np.diff(times)
    assert gaps.min() > 0.73 * TICK and np.sort(gaps)[-2] < 1.02 * TICK
    assert summary["beat_late_us"]["max"] == pytest.approx(1e6 * late.max(), rel=0.01, abs=20)
    assert summary["beat_late_us"]["p50"] == pytest.approx(1e6 * np.median(late), rel=0.04, abs=20)
    if 0 < stall < 1:  # each reading of the clock adds to the time that catching up needs
        late = times - times[0] - TICK * np.arange(len(times))
    misses = np.count_nonzero(late > TICK)
    assert summary["late_ticks"] == pytest.approx(misses, abs=3 if 0 < stall < 1 else 0)
    assert summary["deadline_misses"] == summary["late_ticks"] + summary["late_answers"]
    assert summary["realtime_factor"] == pytest.approx(seconds / (due[-1] + TICK), rel=0.01)


@pytest.mark.parametrize(("words", "misses"), [((), 1), (("--lockstep",), 0)])
def test_a_late_tick_of_a_node_misses_its_deadline(tmp_path, clock, words, misses):
    """Not in lockstep, which may wait for an angle."""
    summary = timed(tmp_path, clock, 3, "--role", "node", "--seconds", "1", *words).summary
    assert (summary["late_ticks"], summary["beat_late_us"]["max"] > 2.9e6) == (misses, True)
    assert summary["deadline_misses"] == misses and "late_answers" not in summary


def test_a_run_waits_1_s_for_the_last_answers(tmp_path, clock):
    """An encoder alone waits 0.1 s. The last three frames are lost here."""
    alone = timed(tmp_path / "a", clock, 0, "--role", "encoder", "--seconds", "0.2").summary
    assert alone["wall_s"] == pytest.approx(0.2 + 0.1, abs=2e-3)
    words = ("--set", "faults.drop=1", "--set", "friction.max_step=2000")
    both = timed(tmp_path / "b", clock, 0, "--seconds", "0.2", *words).summary
    assert both["frames_answered"] > 0
    assert both["wall_s"] == pytest.approx(0.2 + 1, abs=2e-3)
