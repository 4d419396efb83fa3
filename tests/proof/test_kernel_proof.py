# SPDX-License-Identifier: MIT
"""The kernel g(u) = 1 - exp(-u): every float against MPFR; certificates for every a and angle."""

from __future__ import annotations

import math
import re
import subprocess
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import dahl
import kernel_certificate as cert
import kernel_tools as tools
import numpy as np
import pytest
from conftest import ROOT, built, need
from sources import number

GENERATOR = next(path for part in ("lib", "tools") for path in (ROOT / part).rglob("kernel.sollya"))
LIMIT = number("DAHL_KERNEL_ERROR", "kernel.h")
ALL = 0x8000_0000  # bit patterns of the non-negative floats, NaN included
MIDDLE = 0x4000_0000  # 2.0f: the kernel's work is below, so the parts take 45 s and 30 s
SKIPPED = 77


def all_floats(program: Path, first: int, last: int, stride: int) -> tuple[int, dict[str, float]]:
    """kernel_all on a range of bit patterns: exit code and the numbers it printed."""
    command = [str(program), *(hex(value) for value in (first, last, stride))]
    done = subprocess.run(command, capture_output=True, text=True, timeout=1800, check=False)
    if done.returncode == SKIPPED:
        pytest.skip(done.stdout.strip())
    pairs = re.findall(r"(\w[\w ]*?) (-?[\d.]+(?:e[+-]\d+)?|-?0x\S+)(?:,|\n| at)", done.stdout)
    numbers = {name: float.fromhex(n) if "x" in n else float(n) for name, n in pairs}
    return done.returncode, numbers


def assert_sound(numbers: dict[str, float], floats: int) -> None:
    assert numbers["floats"] >= floats
    assert numbers["bound"] == LIMIT
    for name in ("beyond the bound", "falls", "one too early or late", "steps of another g"):
        assert numbers[name] == 0, name
    # As MPFR alone has it, from the worst float that was found: the comparison does compare.
    worst = max(-numbers["lowest"], numbers["highest"])
    assert 0.5 * numbers["bound"] < worst <= numbers["bound"]


def test_floats_with_a_stride() -> None:
    """Every 499th float: error, monotony, g = 1, both signs through dahl_step; NaN, subnormals."""
    code, numbers = all_floats(built("tests", "lib", "kernel_all"), 0, ALL, 499)
    assert code == 0
    assert_sound(numbers, ALL // 499)
    # All ones from the first float with v = u/ln 2 >= 32 on: 32 ln 2 = 22.1807.
    assert abs(numbers["ones from"] - 22.18071) < 1e-2


@pytest.mark.long
@pytest.mark.timeout(1800)
def test_every_float() -> None:
    """All 2^31 of them, on two processes."""
    program = built("tests", "lib", "kernel_all")
    with ThreadPoolExecutor(2) as pool:
        parts = [
            pool.submit(all_floats, program, *part, 1) for part in ((0, MIDDLE), (MIDDLE, ALL))
        ]
        results = [part.result() for part in parts]
    assert [code for code, _ in results] == [0, 0]
    assert sum(numbers["floats"] for _, numbers in results) == ALL
    assert_sound(results[0][1], MIDDLE)
    assert 22.1807 < results[1][1]["ones from"] < 22.1808


def test_without_mpfr_it_is_said(tmp_path: Path) -> None:
    """What CMake builds in place of kernel_all then."""
    program = tools.build(tmp_path, "tests/lib/kernel_all_unproven.c")
    with pytest.raises(pytest.skip.Exception, match="unproven: relative error"):
        all_floats(program, 0, ALL, 1)


@pytest.fixture(scope="module")
def solvers() -> tuple[str, str]:
    claim = "relative error of the kernel for every a and every angle"
    return need("sollya", claim), need("gappa", claim)


@pytest.fixture(scope="module")
def constants(solvers: tuple[str, str]) -> cert.Constants:
    return cert.constants_of(solvers[0], GENERATOR)


@pytest.fixture(scope="module")
def pieces(constants: cert.Constants, solvers: tuple[str, str]) -> list[cert.Piece]:
    return cert.certificate(constants, *solvers)


def model_of_a_step(c: cert.Constants, bits: int) -> int:
    """The state after dahl_step(u) from rest with sigma0 = Fc, u of these bits: g, cut to Q62."""
    product = (1 << 31 | (bits & 0x7FFFFF) << 8) * c.log2_e
    beyond = product.bit_length() - 32
    shift = 157 - (bits >> 23) - beyond
    return cert.model(c, product >> beyond, shift) >> 2


@pytest.mark.usefixtures("library")
def test_the_library_computes_the_function_that_is_certified(constants: cert.Constants) -> None:
    """Bit for bit, for angles of each exponent, each sixteenth of a doubling among them."""
    plan = dahl.Plan(1.0, 1.0)
    random = np.random.default_rng(7)
    for exponent in range(1, 140):
        for bits in exponent << 23 | random.integers(0, 2**23, 150):
            bearing = dahl.Friction(plan)
            bearing.step(float(np.uint32(bits).view(np.float32)))
            assert bearing.state.w == model_of_a_step(constants, int(bits)), hex(bits)


def test_certificate_for_every_a(pieces: list[cert.Piece]) -> None:
    """No gap between the pieces, and no piece beyond the bound of kernel.h."""
    ends = sorted((piece.low, piece.high) for piece in pieces)
    reached = ends[0][0]
    for low, high in ends:
        assert low <= reached
        reached = max(reached, high)
    assert reached == cert.mp.inf
    worst = cert.worst(pieces)
    print(f"{len(pieces)} pieces, worst {worst.name}: {worst.error}")
    assert -LIMIT <= worst.error.a
    assert worst.error.b <= LIMIT


def random_errors(samples: int) -> Iterator[tuple[float, float, float]]:
    """v, the relative error of g at it, and what rounding of the state leaves uncertain of that.

    The kernel as dahl_step runs it from rest: the state is g, cut to Q62.
    """
    random = np.random.default_rng(1)
    for _ in range(samples):
        sigma0, Fc, mantissa = (1 + random.random(3)).astype(np.float32)
        exponent = int(random.choice([random.integers(-20, 6), random.integers(-4, 0)]))
        angle = np.float32(math.ldexp(mantissa, exponent))
        bearing = dahl.Friction(dahl.Plan(float(sigma0), float(Fc)))
        bearing.step(float(angle))
        u = cert.mpf(float(sigma0)) / cert.mpf(float(Fc)) * cert.mpf(float(angle))
        g = -cert.mp.expm1(-u)
        error = (cert.mpf(bearing.state.w) / 2**62 - g) / g
        yield float(u / cert.mp.ln2), float(error), float(8 / g / 2**64)


@pytest.mark.usefixtures("library")
def test_certificate_is_of_this_kernel(pieces: list[cert.Piece]) -> None:
    """What is measured for random a and angles lies in the certified ranges, and nearly fills
    them.
    """
    lowest = 0.0
    ranges = [(float(p.low), float(p.high), float(p.error.a), float(p.error.b)) for p in pieces]
    for v, error, rounding in random_errors(3000):
        here = [(least, most) for low, high, least, most in ranges if low <= v <= high]
        assert min(least for least, _ in here) - rounding <= error
        assert error <= max(most for _, most in here) + rounding
        lowest = min(lowest, error)
    assert lowest < 0.7 * cert.worst(pieces).error.a
