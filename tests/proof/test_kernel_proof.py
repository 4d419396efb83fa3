# SPDX-License-Identifier: MIT
"""The kernel g(u) = 1 - exp(-u): a certificate for every a and angle."""

from __future__ import annotations

import math
from collections.abc import Iterator

import dahl
import kernel_certificate as cert
import numpy as np
import pytest
from conftest import ROOT, need
from sources import number

GENERATOR = next(path for part in ("lib", "tools") for path in (ROOT / part).rglob("kernel.sollya"))
LIMIT = number("DAHL_KERNEL_ERROR", "kernel.h")


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
