# SPDX-License-Identifier: MIT
"""The tick in real time, by a clock that is planted: the beat, and how stalls of the machine are
made up for.
"""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import numpy as np
import pytest
from loop_tools import SCENES, Run, command, finished, read_log

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
    now += 100; /* ns that a look takes */
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
    """A clock for LD_PRELOAD that does not depend on this machine, and can leap."""
    path = tmp_path_factory.mktemp("clock") / "clock.so"
    words = ["cc", "-shared", "-fPIC", "-x", "c", "-", "-o", str(path)]
    subprocess.run(words, input=CLOCK, text=True, check=True, timeout=60)
    return path


def timed(folder: Path, clock: Path, stall: float, *options: str) -> Run:
    """A run by that clock, which stands still for a while, half a second after its start."""
    planted = {"LD_PRELOAD": str(clock), "STALL_AT": "500000000", "STALL": str(int(stall * 1e9))}
    folder.mkdir(exist_ok=True)
    process = subprocess.Popen(
        command(folder, STEERING, *options),
        env={**os.environ, **planted},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    return finished(folder, process)


def due_times(stall: float, ticks: int) -> tuple[np.ndarray, np.ndarray]:
    """When each tick comes, and how late that is: as soon as it is due, but never sooner than three
    quarters of a millisecond after the one before; more than a second is not made up for.
    """
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
def test_the_beat_is_a_millisecond_and_a_stall_is_made_up_for_a_third_faster(
    tmp_path, clock, stall, seconds
):
    """None is skipped, and they are never bunched."""
    result = timed(tmp_path, clock, stall, "--seconds", str(seconds))
    times = np.array([frame.time for frame in read_log(result.log) if frame.id == 0x100])
    told = result.summary
    assert len(times) == told["ticks"] == seconds * 1000
    due, late = due_times(stall, len(times))
    assert np.abs(times - times[0] - due).max() < 2e-3
    gaps = np.diff(times)
    assert gaps.min() > 0.73 * TICK and np.sort(gaps)[-2] < 1.02 * TICK
    assert told["beat_late_us"]["max"] == pytest.approx(1e6 * late.max(), rel=0.01, abs=20)
    assert told["beat_late_us"]["p50"] == pytest.approx(1e6 * np.median(late), rel=0.04, abs=20)
    misses = np.count_nonzero(late > TICK)
    assert told["deadline_misses"] == pytest.approx(misses, abs=3 if 0 < stall < 1 else 0)
    assert told["realtime_factor"] == pytest.approx(seconds / (due[-1] + TICK), rel=0.01)


@pytest.mark.parametrize(
    ("words", "misses"), [(("--role", "node"), 1), (("--role", "node", "--lockstep"), 0)]
)
def test_a_tick_of_a_node_that_comes_late_has_missed_its_deadline(tmp_path, clock, words, misses):
    """But in lockstep, where it may have waited for an angle."""
    told = timed(tmp_path, clock, 3, "--seconds", "1", *words).summary
    assert (told["deadline_misses"], told["beat_late_us"]["max"] > 2.9e6) == (misses, True)


def test_the_last_answers_have_a_second_where_somebody_answers(tmp_path, clock):
    """Else a tenth: an encoder alone does not linger. Here the last three frames are lost."""
    alone = timed(tmp_path / "a", clock, 0, "--role", "encoder", "--seconds", "0.2").summary
    assert alone["wall_s"] == pytest.approx(0.2 + 0.1, abs=2e-3)
    words = ("--set", "faults.drop=1", "--set", "friction.max_step=2000")
    both = timed(tmp_path / "b", clock, 0, "--seconds", "0.2", *words).summary
    assert both["frames_answered"] > 0
    assert both["wall_s"] == pytest.approx(0.2 + 1, abs=2e-3)
