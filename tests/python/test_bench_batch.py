# SPDX-License-Identifier: MIT
"""Batches from Python: bitwise ones against single calls, throughput against the exact reference in
100 bits, and arrays that C cannot take.
"""

from __future__ import annotations

import re
import subprocess
import threading

import dahl
import numpy as np
import pytest
from dahl import reference
from hypothesis import given, settings
from hypothesis import strategies as st
from sources import with_main

pytestmark = pytest.mark.usefixtures("library")

ULP_COUNTS = 0.52
torques = st.floats(2.0**-20, 2.0**20, width=32)
travels = st.floats(-29, 4.3).map(lambda exponent: 2.0**exponent)
any_move = st.one_of(st.integers(-9, 9), st.integers(-(2**31), 2**31 - 1))
moves = st.lists(any_move, max_size=60)
angles = st.lists(st.floats(width=32), max_size=60)


@given(torques, travels, moves)
def test_counts_have_the_bits_of_single_calls(Fc, travel, path):  # noqa: N803
    plan = dahl.Plan(Fc, Fc, travel)
    one, batch = dahl.Friction(plan), dahl.Friction(plan)
    single = np.array([one.step_counts(move) for move in path], np.float32)
    assert np.array_equal(batch.run_counts(path).view(np.uint32), single.view(np.uint32))
    assert one.state.w == batch.state.w


@given(torques, angles)
def test_angles_have_the_bits_of_single_calls(Fc, path):  # noqa: N803
    """NaN, infinities and subnormal angles among them."""
    one, batch = dahl.Friction(dahl.Plan(Fc, Fc)), dahl.Friction(dahl.Plan(Fc, Fc))
    single = np.array([one.step(move) for move in path], np.float32)
    assert np.array_equal(batch.run(path).view(np.uint32), single.view(np.uint32))
    assert one.state.w == batch.state.w


@given(torques, travels, moves)
def test_throughput_is_within_the_bound(Fc, travel, path):  # noqa: N803
    exact = reference.exact_ratios(path, reference.travel_per_count(Fc, Fc, travel))
    params = dahl.Plan(Fc, Fc, travel)
    got = dahl.Throughput(params.sigma0, params.Fc, params.theta_per_count).run_counts(path)
    assert len(got) == 0 or reference.error_in_ulp(got, exact, Fc).max() <= ULP_COUNTS


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
    for c, one in enumerate(params):
        ulp = np.spacing(np.float32(one.Fc))
        alone = one.run_counts(path[:, c]).astype(float)
        assert (np.abs(got[:, c] - alone) <= 1.1 * ulp).all()
        assert (np.abs(by_angle[:, c] - alone) <= 2.1 * ulp).all()


def test_throughput_goes_on_from_a_torque():
    params = dahl.Throughput(100.0, 0.5, 1e-4)
    whole = params.run_counts([5] * 2000)
    rest = params.run_counts([5] * 1000, F=float(whole[999]))
    assert rest == pytest.approx(whole[1000:], abs=1e-7)
    assert params.run_counts([0], F=9.0)[0] == np.float32(0.5)
    assert params.run_counts([0], F=-9.0)[0] == np.float32(-0.5)


LONG = 3 * 2**18 + 777  # three parts, the last one with a rest


def long_path(kind):
    """Moves and the travel of a count: every part forgets soon; none does; one does, others not."""
    walk = np.random.default_rng(7).integers(-9, 10, LONG)
    dither = (np.arange(LONG) // 3) % 5 - 2
    if kind == "jumps":
        return np.where(walk > 7, -(2**31), 3 * walk), 0.3
    if kind == "first moves, then dither":
        return np.where(np.arange(LONG) < 2**18, walk, dither), 1e-7
    if kind == "one way":  # the first look finds a third of what forgets
        return np.ones(LONG, int), 45 / 3 / 4096
    return (walk, 1e-2) if kind == "walk" else (dither, 1e-5 if kind == "dither" else 2.0**-29)


@pytest.mark.parametrize(
    "kind", ["walk", "jumps", "dither", "first moves, then dither", "hardly moves", "one way"]
)
def test_threads_are_within_the_bound(kind):
    path, travel = long_path(kind)
    plan = dahl.Plan(2.0, 0.5, travel / 4)
    bearing, fast = dahl.Friction(plan), dahl.Throughput(2.0, 0.5, plan.theta_per_count)
    bearing.set_torque(0.3)
    exact = bearing.run_counts(path).astype(float)
    for threads in (2, 3, 64):
        got = fast.run_counts(path, 0.3, threads=threads)
        assert np.abs(got - exact).max() <= 2 * ULP_COUNTS * np.spacing(np.float32(0.5))
    by_angle = fast.run(path * plan.theta_per_count, 0.3, threads=3)
    assert np.abs(by_angle - exact).max() <= 2 * np.spacing(np.float32(0.5))


def test_threads_take_angles_that_are_no_numbers():
    angles = np.full(LONG, 1e-9, np.float32)
    angles[2**18 + 9] = np.nan
    angles[2**19 + 9] = -np.inf
    fast = dahl.Throughput(1, 1)
    one, three = fast.run(angles, 0.7), fast.run(angles, 0.7, threads=3)
    assert three[2**19 + 8] == one[2**19 + 8] > 0.69 and three[2**19 + 9] == -1
    assert np.abs(three - one).max() <= np.spacing(np.float32(1))


def test_threads_are_started_for_long_logs_alone(monkeypatch):
    started = []
    start = threading.Thread.start
    ours = lambda thread: thread.name.startswith("ThreadPoolExecutor")  # noqa: E731
    note = lambda thread: (started.extend([thread] * ours(thread)), start(thread))  # noqa: E731
    monkeypatch.setattr(threading.Thread, "start", note)
    fast = dahl.Throughput(1, 1, 0.1)
    fast.run_counts(np.ones(2**19 - 1, np.int32), threads=8)
    fast.run_counts(np.ones(2**20, np.int32))
    assert not started
    fast.run_counts(np.ones(2**19, np.int32), threads=8)
    assert 1 <= len(started) <= 2  # the pool may use one twice


@pytest.mark.parametrize("threads", [0, -1, 1.5, True, "2", None, 1025])
def test_threads_that_are_no_number_of_threads_are_named(threads):
    with pytest.raises(dahl.Error, match=re.escape(f"threads = {threads!r} is not a")):
        dahl.Throughput(1, 1, 0.1).run_counts([1], threads=threads)


def test_arrays_of_the_right_kind_are_not_copied():
    path, out = np.ones(1000, np.int32), np.full(1000, -1, np.float32)
    bearing = dahl.Friction(dahl.Plan(1.0, 1.0, 0.1))
    assert bearing.run_counts(path, out) is out and out[-1] == 1
    assert dahl.Throughput(1, 1, 0.1).run_counts(path, out=out) is out
    assert dahl.arrays.moves(path, np.int32) is path


@pytest.mark.parametrize("dtype", ["i1", "u2", ">i4", "i8", "f8"])
@pytest.mark.parametrize("stride", [1, 3, -1])
def test_other_types_and_strides_give_the_same(dtype, stride):
    wide = np.array([1, 0, 3, 2, 7, 120, 5, 0, 9] * 3)
    plan = dahl.Plan(1.0, 1.0, 0.01)
    wanted = dahl.Friction(plan).run_counts(wide[::stride].astype(np.int32))
    assert np.array_equal(dahl.Friction(plan).run_counts(wide.astype(dtype)[::stride]), wanted)


def off_by_a_byte(dtype):
    """Four zeros, as they lie behind the odd header of a file that was read as a whole."""
    return np.frombuffer(bytearray(17), dtype, offset=1)


def test_moves_between_words_are_copied_to_where_c_may_read_them():
    for dtype, run in ((np.int32, "run_counts"), (np.float32, "run")):
        moves = off_by_a_byte(dtype)
        taken = dahl.arrays.moves(moves, dtype)
        assert taken.flags.aligned and not moves.flags.aligned
        assert not getattr(dahl.Friction(dahl.Plan(1.0, 1.0, 0.1)), run)(moves).any()


def test_nothing_in_nothing_out():
    params = dahl.Throughput(1, 1, 0.1)
    for got in (params.run_counts([]), params.run([]), dahl.Friction(dahl.Plan(1, 1)).run([])):
        assert got.dtype == np.float32 and got.shape == (0,)
    assert dahl.Throughput.run_counts_channels([params], np.empty((0, 1))).shape == (0, 1)


COUNTS = np.ones(4, np.int32)


@pytest.mark.parametrize(
    ("out", "words"),
    [
        (np.empty(4), "out is float64 (4,), not float32 (4,)"),
        (np.empty(5, np.float32), "out is float32 (5,), not float32 (4,)"),
        (np.empty(8, np.float32)[::2], "out is not C-contiguous, aligned and writable"),
        (off_by_a_byte(np.float32), "out is not C-contiguous, aligned and writable"),
        (np.frombuffer(bytes(16), np.float32), "out is not C-contiguous, aligned and writable"),
        ([0.0] * 4, "out is a list"),
        (COUNTS.view(np.float32), "out and moves share memory"),
    ],
)
def test_an_out_that_c_cannot_fill_is_named(out, words):
    bearing = dahl.Friction(dahl.Plan(1.0, 1.0, 0.1))
    for run in (bearing.run_counts, lambda m, o: dahl.Throughput(1, 1, 0.1).run_counts(m, out=o)):
        with pytest.raises(dahl.Error, match=re.escape(words)):
            run(COUNTS, out)
    assert bearing.state.w == 0


def test_channels_of_another_number_are_refused():
    with pytest.raises(dahl.Error, match=re.escape("moves has shape (1, 3), not (n, 2)")):
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
        pytest.skip("no build/deps/unity (tools/setup.sh fetches it)")
    words = [
        *command.split(),
        "-std=c99",
        f"-I{root}/lib/include",
        f"-I{root}/tests/lib",
        f"-I{unity}",
    ]
    words += ["-DUNITY_INCLUDE_DOUBLE", "-DTEST_TICKS=20000"]
    words += [with_main(root / "tests/lib/test_batch.c", tmp_path)]
    words += [unity / "unity.c", *sorted((root / "lib").glob("*/*.c")), "-lm", "-o", program]
    subprocess.run(words, check=True)
    done = subprocess.run([program], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout
