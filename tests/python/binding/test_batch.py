# SPDX-License-Identifier: MIT
"""The fast forms of dahl.Throughput against the exact form: threads, channels, and the arrays that
C reads and writes.
"""

import threading

import dahl
import numpy as np
import pytest
from conftest import need
from hypothesis import given, settings
from hypothesis import strategies as st
from programs import run
from sources import with_main
from strategies import STEPS, parameters

ULP_COUNTS = 0.52
EXPONENTS = 20  # of Fc and theta_per_count


def fast_and_exact(sigma0: float, Fc: float, theta: float) -> tuple[dahl.Throughput, dahl.Friction]:  # noqa: N803
    plan = dahl.Plan(sigma0, Fc, theta)
    return dahl.Throughput(plan.sigma0, plan.Fc, plan.theta_per_count), dahl.Friction(plan)


def spread(torques: np.ndarray, exact: np.ndarray, Fc: float) -> float:  # noqa: N803
    """Largest difference of two logs in ulp of Fc."""
    return np.abs(torques - exact.astype(float)).max(initial=0) / np.spacing(np.float32(Fc))


@given(parameters(EXPONENTS), st.lists(STEPS, max_size=60), st.data())
def test_the_fast_form_is_within_the_bound_and_continues_from_a_torque(one, moves, data):
    fast, exact = fast_and_exact(*one)
    torques, plan = exact.run_counts(moves), exact.plan
    assert spread(fast.run_counts(moves), torques, plan.Fc) <= 2 * ULP_COUNTS
    cut = data.draw(st.integers(0, len(moves)))
    start = float(torques[cut - 1]) if cut else 0.0
    rest = fast.run_counts(moves[cut:], F=start)
    assert spread(rest, torques[cut:], plan.Fc) <= 2 * ULP_COUNTS + 1
    for beyond in (9, -9):
        assert fast.run_counts([0], F=beyond * plan.Fc)[0] == np.sign(beyond) * plan.Fc


@settings(max_examples=25)
@given(st.integers(1, 40), st.integers(0, 150), st.integers(0, 2**32 - 1))
def test_channels_give_what_each_gives_alone(channels, ticks, seed):
    random = np.random.default_rng(seed)
    path = random.integers(-300, 301, (ticks, channels)).astype(np.int32)
    params = [
        dahl.Throughput(random.uniform(1, 9), random.uniform(1, 9), 0.01) for _ in range(channels)
    ]
    got = dahl.Throughput.run_counts_channels(params, path)
    by_angle = dahl.Throughput.run_channels(params, path * 0.01)
    assert got.shape == by_angle.shape == path.shape
    for c, one in enumerate(params):
        alone = one.run_counts(path[:, c])
        assert spread(got[:, c], alone, one.Fc) <= 1.1
        assert spread(by_angle[:, c], alone, one.Fc) <= 2.1


# --- threads -------------------------------------------------------------------------------------

LONG = 3 * 2**18 + 777  # ticks: three parts, the last one longer
WALK = np.random.default_rng(7).integers(-9, 10, LONG)
DITHER = (np.arange(LONG) // 3) % 5 - 2
PATHS = {  # moves and the travel of a count: each part forgets its start soon, late, or not at all
    "walk": (WALK, 1e-2),
    "jumps": (np.where(WALK > 7, -(2**31), 3 * WALK), 0.3),
    "dither": (DITHER, 1e-5),
    "first moves, then dither": (np.where(np.arange(LONG) < 2**18, WALK, DITHER), 1e-7),
    "one way, slowly": (np.ones(LONG, int), 2e-6),
}


@pytest.mark.parametrize("kind", PATHS)
def test_threads_are_within_the_bound(kind):
    path, travel = PATHS[kind]
    fast, bearing = fast_and_exact(2.0, 0.5, travel / 4)
    bearing.set_torque(0.3)
    exact = bearing.run_counts(path)
    for threads in (2, 3, 64):
        assert spread(fast.run_counts(path, 0.3, threads=threads), exact, 0.5) <= 2 * ULP_COUNTS
    by_angle = fast.run(path * fast.theta_per_count, 0.3, threads=3)
    assert spread(by_angle, exact, 0.5) <= 2


def test_threads_accept_angles_that_are_not_finite():
    turns = np.full(LONG, 1e-9, np.float32)
    turns[2**18 + 9] = np.nan
    turns[2**19 + 9] = -np.inf
    fast = dahl.Throughput(1, 1)
    one, three = fast.run(turns, 0.7), fast.run(turns, 0.7, threads=3)
    assert three[2**19 + 8] == one[2**19 + 8] > 0.69 and three[2**19 + 9] == -1
    assert spread(three, one, 1) <= 1


def test_threads_start_for_long_logs_only(monkeypatch):
    started = []
    start = threading.Thread.start
    monkeypatch.setattr(threading.Thread, "start", lambda one: (started.append(one), start(one)))
    fast = dahl.Throughput(1, 1, 0.1)
    fast.run_counts(np.ones(2**19 - 1, np.int32), threads=8)
    fast.run_counts(np.ones(2**20, np.int32))
    assert not started
    fast.run_counts(np.ones(2**19, np.int32), threads=8)
    assert 1 <= len(started) <= 2  # one may compute both parts


# --- arrays --------------------------------------------------------------------------------------

MOVES = np.array([1, 0, 3, 2, 7, 120, 5, 0, 9] * 3)


@pytest.mark.parametrize("dtype", ["i1", "u2", "i4", ">i4", "i8", "f2", "f8"])
@pytest.mark.parametrize("stride", [1, 3, -1])
def test_arrays_of_any_type_stride_and_alignment_give_the_same(dtype, stride):
    moves = MOVES[::stride]
    fast, bearing = fast_and_exact(1.0, 1.0, 0.01)
    wanted = np.array([bearing.step_counts(int(move)) for move in moves], np.float32)
    unaligned = np.frombuffer(b"x" + moves.astype(dtype).tobytes(), dtype, offset=1)
    for given_moves in (MOVES.astype(dtype)[::stride], unaligned):
        out = np.full(len(moves), -1, np.float32)
        assert dahl.Friction(bearing.plan).run_counts(given_moves, out) is out
        assert np.array_equal(out, wanted)
        assert fast.run_counts(given_moves, out=out) is out
        assert spread(out, wanted, 1) <= 1


@pytest.mark.checks
@pytest.mark.parametrize(
    "command", ["gcc -O0", "gcc -m32 -O2", "gcc -O3 -ffast-math", "clang -O3 -ffast-math"]
)
def test_the_c_tests_of_batches_pass_with_other_compilers_and_flags(command, root, tmp_path):
    """Without the flags that the build gives to these files."""
    unity, program = root / "build/deps/unity", tmp_path / "test_batch"
    if not (unity / "unity.c").exists():
        pytest.skip("unproven: batches by other compilers: no build/deps/unity (tools/setup.sh)")
    compiler, *flags = command.split()
    includes = [f"-I{folder}" for folder in (root / "lib/include", root / "tests/lib", unity)]
    words = [need(compiler, "batches by other compilers"), *flags, "-std=c99", *includes]
    words += ["-DUNITY_INCLUDE_DOUBLE", "-DTEST_TICKS=20000", "-lm", "-o", program]
    files = [with_main(root / "tests/lib/test_batch.c", tmp_path), unity / "unity.c"]
    run(*words, *files, *sorted((root / "lib").glob("*/*.c")), "-lm")
    run(program)


def test_a_path_starts_where_the_shaft_is() -> None:
    """Against Eq. 1 by its closed form in double: first forward, then back."""
    theta = np.array([0.3, 0.3, 0.302, 0.31, 0.305])
    up = 0.5 * -np.expm1(-200 * 0.01)
    back = -0.5 + (up + 0.5) * np.exp(-200 * 0.005)
    wanted = [0, 0, 0.5 * -np.expm1(-200 * 0.002), up, back]
    bearing, fast = dahl.Friction(dahl.Plan(100, 0.5)), dahl.Throughput(100, 0.5)
    for torques in (bearing.run_path(theta), fast.run_path(theta), fast.run_path(theta, threads=2)):
        assert torques == pytest.approx(wanted, abs=1e-6)
    assert bearing.run_path([7.0, 7.001])[0] == pytest.approx(back, abs=1e-6)  # the state stays
    assert fast.run_path([7.0], F=0.2) == pytest.approx([0.2])
    assert fast.run_path([]).shape == (0,)


@pytest.mark.parametrize(
    ("theta", "words"),
    [([0.0, np.nan], r"theta\[1\] = nan"), ([np.inf], r"theta\[0\]"), ([[1.0]], r"\(1, 1\)")],
)
def test_a_path_with_a_bad_angle_is_refused(theta, words) -> None:
    for element in (dahl.Friction(dahl.Plan(1, 1)), dahl.Throughput(1, 1)):
        with pytest.raises(dahl.InputError, match=words):
            element.run_path(theta)


@pytest.mark.parametrize("element", [dahl.Friction(dahl.Plan(1, 1)), dahl.Throughput(1, 1)])
def test_an_array_is_not_its_own_output(element) -> None:
    """Neither as a whole nor in part, whichever array owns the memory."""
    moves = np.ones(8, np.float32)
    same = np.frombuffer(memoryview(moves), np.float32)
    shared = [(moves, moves), (moves, moves[:]), (moves[:], moves), (moves, same), (same, moves)]
    shared += [(moves[:5], moves[3:]), (moves[:5], same[3:]), (same[:5], moves[3:])]
    for read, out in shared:
        with pytest.raises(dahl.InputError, match="share memory"):
            element.run(read, out=out)
    assert (moves == 1).all()
    assert element.run(moves[:4], out=moves[4:]) is not None
    assert (moves[:4] == 1).all()
    assert (moves[4:] != 1).all()
