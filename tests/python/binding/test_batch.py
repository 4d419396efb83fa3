# SPDX-License-Identifier: MIT
"""Batches from Python: bitwise ones against single calls, throughput against the exact recursion in
100 bits, threads, and arrays that C cannot take.
"""

from __future__ import annotations

import re
import subprocess
import threading

import dahl
import mpmath
import numpy as np
import pytest
from conftest import need
from hypothesis import given, settings
from hypothesis import strategies as st
from sources import with_main

pytestmark = pytest.mark.usefixtures("library")

ULP_COUNTS = 0.52
torques = st.floats(2.0**-20, 2.0**20, width=32)
travels = st.floats(-29, 4.3).map(lambda exponent: 2.0**exponent)
any_move = st.one_of(st.integers(-9, 9), st.integers(-(2**31), 2**31 - 1))
moves = st.lists(any_move, max_size=60)
angles = st.lists(st.floats(width=32), max_size=60)  # NaN, infinities and subnormals among them


@given(torques, travels, moves, angles)
def test_batches_have_the_bits_of_single_calls(Fc, travel, path, turns):  # noqa: N803
    plan = dahl.Plan(Fc, Fc, travel)
    one, batch = dahl.Friction(plan), dahl.Friction(plan)
    for single, run, steps in (
        (one.step_counts, batch.run_counts, path),
        (one.step, batch.run, turns),
    ):
        wanted = np.array([single(move) for move in steps], np.float32)
        assert np.array_equal(run(steps).view(np.uint32), wanted.view(np.uint32))
        assert one.state.w == batch.state.w


@given(torques, travels, moves)
def test_throughput_is_within_the_bound(Fc, travel, path):  # noqa: N803
    plan = dahl.Plan(Fc, Fc, travel)
    got = dahl.Throughput(plan.sigma0, plan.Fc, plan.theta_per_count).run_counts(path)
    w = mpmath.mpf(0)
    with mpmath.workprec(100):
        for move, F in zip(path, got.tolist(), strict=True):
            s, u = (1 if move > 0 else -1), abs(move) * mpmath.mpf(plan.theta_per_count)
            w = s + (w - s) * mpmath.exp(-u * plan.sigma0 / plan.Fc)
            assert abs(F - w * plan.Fc) <= ULP_COUNTS * float(np.spacing(np.float32(plan.Fc)))


@settings(max_examples=25)
@given(st.integers(1, 40), st.integers(0, 150), st.integers(0, 2**32 - 1))
def test_channels_are_as_one_by_one(channels, ticks, seed):
    random = np.random.default_rng(seed)
    path = random.integers(-300, 301, (ticks, channels)).astype(np.int32)
    params = [
        dahl.Throughput(random.uniform(1, 9), random.uniform(1, 9), 0.01) for _ in range(channels)
    ]
    got = dahl.Throughput.run_counts_channels(params, path)
    by_angle = dahl.Throughput.run_channels(params, path * 0.01)
    assert got.shape == by_angle.shape == path.shape
    for c, one in enumerate(params):
        ulp = np.spacing(np.float32(one.Fc))
        alone = one.run_counts(path[:, c]).astype(float)
        assert (np.abs(got[:, c] - alone) <= 1.1 * ulp).all()
        assert (np.abs(by_angle[:, c] - alone) <= 2.1 * ulp).all()


def test_throughput_goes_on_from_a_torque():
    fast = dahl.Throughput(100.0, 0.5, 1e-4)
    whole = fast.run_counts([5] * 2000)
    rest = fast.run_counts([5] * 1000, F=float(whole[999]))
    assert rest == pytest.approx(whole[1000:], abs=1e-7)
    for beyond in (9.0, -9.0):
        assert fast.run_counts([0], F=beyond)[0] == np.copysign(np.float32(0.5), beyond)


# --- threads -------------------------------------------------------------------------------------

LONG = 3 * 2**18 + 777  # three parts, the last one with a rest
WALK = np.random.default_rng(7).integers(-9, 10, LONG)
DITHER = (np.arange(LONG) // 3) % 5 - 2
PATHS = {  # moves and the travel of a count: parts that forget soon, that do not, and both
    "walk": (WALK, 1e-2),
    "jumps": (np.where(WALK > 7, -(2**31), 3 * WALK), 0.3),
    "dither": (DITHER, 1e-5),
    "first moves, then dither": (np.where(np.arange(LONG) < 2**18, WALK, DITHER), 1e-7),
    "hardly moves": (DITHER, 2.0**-29),
    "one way": (np.ones(LONG, int), 45 / 3 / 4096),  # the first look finds a third of what forgets
}


@pytest.mark.parametrize("kind", PATHS)
def test_threads_are_within_the_bound(kind):
    path, travel = PATHS[kind]
    plan = dahl.Plan(2.0, 0.5, travel / 4)
    bearing, fast = dahl.Friction(plan), dahl.Throughput(2.0, 0.5, plan.theta_per_count)
    bearing.set_torque(0.3)
    exact, ulp = bearing.run_counts(path).astype(float), np.spacing(np.float32(0.5))
    for threads in (2, 3, 64):
        got = fast.run_counts(path, 0.3, threads=threads)
        assert np.abs(got - exact).max() <= 2 * ULP_COUNTS * ulp
    by_angle = fast.run(path * plan.theta_per_count, 0.3, threads=3)
    assert np.abs(by_angle - exact).max() <= 2 * ulp


def test_threads_take_angles_that_are_no_numbers():
    turns = np.full(LONG, 1e-9, np.float32)
    turns[2**18 + 9] = np.nan
    turns[2**19 + 9] = -np.inf
    fast = dahl.Throughput(1, 1)
    one, three = fast.run(turns, 0.7), fast.run(turns, 0.7, threads=3)
    assert three[2**19 + 8] == one[2**19 + 8] > 0.69 and three[2**19 + 9] == -1
    assert np.abs(three - one).max() <= np.spacing(np.float32(1))


def test_threads_are_started_for_long_logs_alone(monkeypatch):
    started = []
    start = threading.Thread.start
    monkeypatch.setattr(threading.Thread, "start", lambda one: (started.append(one), start(one)))
    fast = dahl.Throughput(1, 1, 0.1)
    fast.run_counts(np.ones(2**19 - 1, np.int32), threads=8)
    fast.run_counts(np.ones(2**20, np.int32))
    assert not started
    fast.run_counts(np.ones(2**19, np.int32), threads=8)
    assert 1 <= len(started) <= 2  # one may do both parts


@pytest.mark.parametrize("threads", [0, -1, 1.5, True, "2", None, 1025])
def test_threads_that_are_no_number_of_threads_are_named(threads):
    with pytest.raises(dahl.Error, match=re.escape(f"threads = {threads!r}")):
        dahl.Throughput(1, 1, 0.1).run_counts([1], threads=threads)


# --- arrays --------------------------------------------------------------------------------------


@pytest.mark.parametrize("dtype", ["i1", "u2", "i4", ">i4", "i8", "f8"])
@pytest.mark.parametrize("stride", [1, 3, -1])
def test_other_types_and_strides_give_the_same(dtype, stride):
    """Into an array of one's own, which is what comes back; moves may lie between words."""
    path = np.array([1, 0, 3, 2, 7, 120, 5, 0, 9] * 3)[::stride]
    bearing = dahl.Friction(dahl.Plan(1.0, 1.0, 0.01))
    wanted = np.array([bearing.step_counts(int(move)) for move in path], np.float32)
    data = b"x" + path.astype(dtype).tobytes()
    between = np.frombuffer(data, dtype, offset=1)
    for moved in (np.array([1, 0, 3, 2, 7, 120, 5, 0, 9] * 3).astype(dtype)[::stride], between):
        out = np.full(len(path), -1, np.float32)
        assert dahl.Friction(dahl.Plan(1.0, 1.0, 0.01)).run_counts(moved, out) is out
        assert np.array_equal(out, wanted)
        fast = dahl.Throughput(1.0, 1.0, 0.01)
        assert fast.run_counts(moved, out=out) is out
        assert out == pytest.approx(wanted, abs=1e-7)


def test_nothing_in_nothing_out():
    fast = dahl.Throughput(1, 1, 0.1)
    for got in (fast.run_counts([]), fast.run([]), dahl.Friction(dahl.Plan(1, 1)).run([])):
        assert got.dtype == np.float32 and got.shape == (0,)
    assert dahl.Throughput.run_counts_channels([fast], np.empty((0, 1))).shape == (0, 1)


COUNTS = np.ones(4, np.int32)


@pytest.mark.parametrize(
    ("out", "named"),
    [
        (np.empty(4), "float64 (4,)"),
        (np.empty(5, np.float32), "float32 (5,)"),
        (np.empty(8, np.float32)[::2], "contiguous"),
        (np.frombuffer(bytearray(17), np.float32, offset=1), "aligned"),
        (np.frombuffer(bytes(16), np.float32), "writable"),
        ([0.0] * 4, "list"),
        (COUNTS.view(np.float32), "share memory"),
    ],
)
def test_an_out_that_c_cannot_fill_is_named(out, named):
    bearing = dahl.Friction(dahl.Plan(1.0, 1.0, 0.1))
    for run in (bearing.run_counts, lambda m, o: dahl.Throughput(1, 1, 0.1).run_counts(m, out=o)):
        with pytest.raises(dahl.Error, match=re.escape(named)):
            run(COUNTS, out)
    assert bearing.state.w == 0


def test_channels_of_another_number_are_refused():
    with pytest.raises(dahl.Error, match=re.escape("(1, 3), not (n, 2)")):
        dahl.Throughput.run_counts_channels([dahl.Throughput(1, 1, 1)] * 2, [[1, 2, 3]])


@pytest.mark.checks
@pytest.mark.parametrize(
    "command", ["gcc -O0", "gcc -m32 -O2", "gcc -O3 -ffast-math", "clang -O3 -ffast-math"]
)
def test_the_c_tests_hold_with_other_compilers_and_flags(command, root, tmp_path):
    """Bits of single steps, bounds and bad input, without the flags that the build gives to these
    files.
    """
    unity, program = root / "build/deps/unity", tmp_path / "test_batch"
    if not (unity / "unity.c").exists():
        pytest.skip("unproven: batches by other compilers: no build/deps/unity (tools/setup.sh)")
    compiler, *flags = command.split()
    includes = [f"-I{folder}" for folder in (root / "lib/include", root / "tests/lib", unity)]
    words = [need(compiler, "batches by other compilers"), *flags, "-std=c99", *includes]
    words += ["-DUNITY_INCLUDE_DOUBLE", "-DTEST_TICKS=20000", "-lm", "-o", program]
    files = [with_main(root / "tests/lib/test_batch.c", tmp_path), unity / "unity.c"]
    subprocess.run([*words, *files, *sorted((root / "lib").glob("*/*.c")), "-lm"], check=True)
    done = subprocess.run([program], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout
