# SPDX-License-Identifier: MIT
"""The kernel g(u) = 1 - exp(-u): a certificate for each a and each angle."""

import functools
import math
import re
import sys
from pathlib import Path

import dahl
import kernel_certificate as cert
import numpy as np
import pytest
from conftest import ROOT, need
from programs import run
from sources import INCLUDES, number

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
    """The state after dahl_step(u) from rest with sigma0 = Fc: g, cut to Q62."""
    product = (1 << 31 | (bits & 0x7FFFFF) << 8) * c.log2_e
    a_exponent = -31
    m, s = cert.model(c, product >> 32, 94 - a_exponent - (bits >> 23))
    return (m << 30) >> s


@pytest.mark.usefixtures("library")
def test_the_library_computes_the_certified_function(constants: cert.Constants) -> None:
    """Bit for bit, for angles of each exponent."""
    plan = dahl.Plan(1.0, 1.0)
    random = np.random.default_rng(7)
    for exponent in range(1, 140):
        for bits in exponent << 23 | random.integers(0, 2**23, 150):
            bearing = dahl.Friction(plan)
            bearing.step(float(np.uint32(bits).view(np.float32)))
            assert bearing.state.w == model_of_a_step(constants, int(bits)), hex(bits)


def test_certificate_for_every_a(pieces: list[cert.Piece]) -> None:
    """The pieces have no gap and keep the bound of kernel.h."""
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


def slopes(folder: Path, macro: str, most: float) -> list[tuple[float, float]]:
    """Return places up to `most` and the values of a macro of throughput.h there."""
    program = folder / "slope.c"
    program.write_text(
        '#include <stdio.h>\n#include "throughput.h"\nint main(void)\n{\n'
        "    for (int k = 1; k <= 999; k++) {\n"
        f"        double x = {most!r} * k / 999;\n"
        f'        printf("%a\\n", {macro}(x));\n    }}\n}}\n'
    )
    flags = ["-O1", "-ffp-contract=off", *INCLUDES, "-o", folder / "slope", "-lm"]
    run("cc", program, *flags)
    values = map(float.fromhex, run(folder / "slope").split())
    return [(most * k / 999, value) for k, value in enumerate(values, 1)]


def worst_error(pairs: list[tuple[float, float]]) -> float:
    """Return the largest relative error of g = x slope(x)."""
    return max(abs(slope * x / -math.expm1(-x) - 1) for x, slope in pairs)


@pytest.fixture(scope="module")
def generated() -> dict[str, list[float]]:
    """The numbers that the generator prints after each name, and under "errors" its errors."""
    said = run(sys.executable, ROOT / "tools/generators/throughput_kernel.py").splitlines()
    rows = [line.split() for line in said if line.startswith("DAHL_")]
    numbers = {name: [float.fromhex(value) for value in values] for name, *values in rows}
    errors = [float(line.split()[-1]) for line in said if line.startswith("relative")]
    return numbers | {"errors": errors}


def horner(polynomial: list[float], x: float) -> float:
    return functools.reduce(lambda p, c: p * x + c, reversed(polynomial))


def test_the_kernel_of_the_vectors_is_the_one_that_is_generated(tmp_path: Path, generated) -> None:
    """Bit for bit, with the error that the generator prints, within DAHL_G_ERROR."""
    pairs = slopes(tmp_path, "DAHL_SLOPE", math.log(2))
    assert [slope for _, slope in pairs] == [horner(generated["DAHL_SLOPE"], x) for x, _ in pairs]
    assert generated["errors"][0] == pytest.approx(worst_error(pairs), rel=5e-3)
    assert generated["errors"][0] < number("DAHL_G_ERROR", "throughput.h")


def test_the_kernel_of_powers_is_the_one_that_is_generated(tmp_path: Path, generated) -> None:
    """Bit for bit. The error of its slope is the printed one, within DAHL_ROOT_ERROR."""
    pairs = slopes(tmp_path, "DAHL_ROOT_POWER", 1.0)
    polynomial = [1.0, *(-c for c in generated["DAHL_ROOT_POWER"])]
    assert [power for _, power in pairs] == [horner(polynomial, f) for f, _ in pairs]
    exact = [-math.expm1(-f * math.log(2) / 16) for f, _ in pairs]
    worst = max(abs((1 - power) / g - 1) for (_, power), g in zip(pairs, exact, strict=True))
    assert generated["errors"][1] == pytest.approx(worst, rel=2e-2)
    assert generated["errors"][1] < number("DAHL_ROOT_ERROR", "throughput.h")


def test_the_roots_are_the_generated_ones(generated) -> None:
    text = (ROOT / "lib/batch/throughput.h").read_text()
    block = text.partition("#define DAHL_ROOTS ")[2].partition("\n\n")[0]
    found = [float.fromhex(value) for value in re.findall(r"0x[\w.+-]+", block)]
    assert found == generated["DAHL_ROOTS"]


def test_the_kernel_of_short_travel_keeps_its_bound(tmp_path: Path) -> None:
    """The bound is tight: it is nearly reached at the largest travel."""
    worst = worst_error(slopes(tmp_path, "DAHL_TINY_SLOPE", math.log(2) / 128))
    assert 0.9 < worst / number("DAHL_G_ERROR_TINY", "throughput.h") <= 1
