# SPDX-License-Identifier: MIT
"""The tick in real time: how stalls of the machine are made up for; what a slow reader costs."""

from __future__ import annotations

import os
import socket
import subprocess
import time
from pathlib import Path

import can
import numpy as np
import pytest
from loop_tools import SCENES, Run, client, command, finished, raw_client, read_log, run, serving

STEERING = SCENES / "steering.ini"
TICK = 1e-3  # s


def angles(log: Path) -> np.ndarray:
    """Times of all EncoderState frames in s, shape (ticks,)."""
    return np.array([frame.time for frame in read_log(log) if frame.id == 0x100])


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


def stalled(folder: Path, clock: Path, stall: float, seconds: float) -> tuple[np.ndarray, dict]:
    """Times of the angles, and the summary."""
    result = timed(folder, clock, stall, "--seconds", str(seconds))
    times = angles(result.log)
    assert len(times) == result.summary["ticks"] == round(seconds / TICK)  # none is skipped
    return times, result.summary


def test_a_short_stall_is_made_up_for_a_third_faster(tmp_path, clock):
    times, summary = stalled(tmp_path, clock, 0.3, 3.0)
    gaps = np.diff(times)
    stop = int(gaps.argmax())
    assert gaps[stop] == pytest.approx(0.3, abs=2e-3)
    chasing = gaps[stop + 1 : stop + 1195]
    assert np.abs(chasing / TICK - 0.75).max() < 0.02  # never bunched
    assert np.abs(gaps[stop + 1210 :] / TICK - 1).max() < 0.02
    assert times[-1] - times[0] == pytest.approx(2.999, abs=2e-3)
    assert summary["beat_late_us"]["max"] == pytest.approx(0.3e6, rel=0.01)
    assert summary["beat_late_us"]["p50"] < 2.25e5


def test_a_stall_of_more_than_a_second_is_not_made_up_for(tmp_path, clock):
    times, summary = stalled(tmp_path, clock, 1.5, 2.0)
    gaps = np.diff(times)
    stop = int(gaps.argmax())
    assert gaps[stop] == pytest.approx(1.5, abs=2e-3)
    assert np.abs(gaps[stop + 1 :] / TICK - 1).max() < 0.02
    assert times[-1] - times[0] == pytest.approx(1.999 + 1.5, abs=3e-3)
    assert summary["beat_late_us"]["max"] == pytest.approx(1.5e6, rel=0.01)


def test_a_stall_of_nearly_a_second_is_made_up_for(tmp_path, clock):
    times, _ = stalled(tmp_path, clock, 0.95, 6.0)
    assert times[-1] - times[0] == pytest.approx(5.999, abs=2e-3)


def test_the_beat_is_a_millisecond(tmp_path, clock):
    times, summary = stalled(tmp_path, clock, 0, 3.0)
    assert np.abs(np.diff(times) / TICK - 1).max() < 0.02
    assert summary["beat_late_us"]["max"] < 20
    assert summary["realtime_factor"] == pytest.approx(1, abs=0.01)


def test_the_last_answers_have_a_second_where_somebody_answers(tmp_path, clock):
    """Else a tenth: an encoder alone does not linger. Here the last three frames are lost."""
    alone = timed(tmp_path / "a", clock, 0, "--role", "encoder", "--seconds", "0.2").summary
    assert alone["wall_s"] == pytest.approx(0.2 + 0.1, abs=2e-3)
    words = ("--set", "faults.drop=1", "--set", "friction.max_step=2000")
    both = timed(tmp_path / "b", clock, 0, "--seconds", "0.2", *words).summary
    assert both["frames_answered"] > 0
    assert both["wall_s"] == pytest.approx(0.2 + 1, abs=2e-3)


def trickle(peer: socket.socket, pause: float) -> str:
    """Read all, after a long pause."""
    time.sleep(pause)
    text = b""
    while piece := peer.recv(65536):
        text += piece
    return text.decode("ascii")


@pytest.mark.parametrize(("pause", "seconds"), [(4, 30), (1, 2)])
def test_in_virtual_time_a_slow_client_is_waited_for(tmp_path, pause, seconds):
    """With more frames than any buffer holds, and with what waits when the run has ended."""
    options = ("--virtual", "--wait-clients", "1", "--seconds", seconds)
    with serving(tmp_path, STEERING, *options) as (process, port):
        peer = raw_client(port, receive_buffer=4096)
        text = trickle(peer, pause)
        result = finished(tmp_path, process)
    assert (result.code, result.err) == (0, "")
    assert text.count("< frame ") == len(read_log(result.log)) > 2000 * seconds
    assert result.summary["bus_counts"]["dropped"] == 0


def test_the_wait_for_clients_is_no_part_of_the_run(tmp_path):
    """wall_s, and what realtime_factor is made of, begin with the first tick."""
    options = ("--virtual", "--wait-clients", "1", "--seconds", "0.5")
    with serving(tmp_path, STEERING, *options) as (process, port):
        time.sleep(0.5)
        joined = time.monotonic()
        peer = raw_client(port)
        trickle(peer, 0)
        summary = finished(tmp_path, process).summary
    assert 0 < summary["wall_s"] < time.monotonic() - joined


def test_ends_when_its_time_is_over(tmp_path):
    """--seconds counts ticks, to the nearest one."""
    for seconds, ticks in (("0.001", 1), ("0.2", 200), ("1.2346", 1235), ("0.0015", 2)):
        result = run(tmp_path, STEERING, "--virtual", "--seconds", seconds)
        assert result.summary["ticks"] == ticks


def test_until_idle_waits_for_the_first_client(tmp_path):
    """It does not end before one has come, and ends soon after the last has left."""
    options = ("--role", "node", "--until-idle")
    with serving(tmp_path, STEERING, *options) as (process, port):
        time.sleep(0.5)
        assert process.poll() is None
        one, other = raw_client(port), raw_client(port)
        time.sleep(0.3)
        one.close()
        time.sleep(0.5)
        assert process.poll() is None
        other.close()
        begun = time.monotonic()
        assert finished(tmp_path, process, 10).code == 0
        assert time.monotonic() - begun < 3


def test_frames_of_a_client_come_at_once(tmp_path):
    """A node answers an angle within milliseconds, also when nothing else happens on the bus."""
    recorded = run(tmp_path / "r", STEERING, "--virtual", "--seconds", "0.02").log
    sent = [frame.data for frame in read_log(recorded) if frame.id == 0x100]
    options = ("--role", "node", "--set", "friction.timeout_ms=60000")
    with serving(tmp_path / "node", STEERING, *options) as (_, port), client(port) as bus:
        waits = []
        for data in sent:
            begun = time.monotonic()
            bus.send(can.Message(arbitration_id=0x100, data=data, is_extended_id=False))
            while bus.recv(5).arbitration_id != 0x110:
                pass
            waits.append(time.monotonic() - begun)
    assert np.median(waits) < 0.02 * (1 + os.getloadavg()[0] / (os.cpu_count() or 1))
