# SPDX-License-Identifier: MIT
"""Compute the coefficients of lib/batch/throughput.h (needs mpmath).

    build/venv/bin/python tools/generators/throughput_kernel.py

- DAHL_SLOPE is (1 - exp(-x))/x on [0, ln 2], by a polynomial of degree 6.
- DAHL_ROOT_POWER is 2^-(f/16) on [0, 1]: 1 - f slope, with a slope of degree 3.
- DAHL_ROOTS are 2^-(j/16).

Each polynomial has the least *relative* error, by Remez' exchange in 40 digits. If the kernel has
the relative error r, the torque has an error of at most 2 r Fc, for any number of ticks.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import mpmath
from mpmath import mpf

SAMPLES, EXCHANGES, ROOTS = 4000, 12, 16


@dataclass(frozen=True)
class Kernel:
    """A function on [0, top], approximated by a polynomial."""

    name: str
    function: Callable[[mpf], mpf]
    top: mpf
    degree: int


def slope(x: mpf, rate: mpf = 1) -> mpf:
    """Return (1 - exp(-rate x))/x."""
    return -mpmath.expm1(-rate * x) / x if x else mpf(rate)


def kernels() -> tuple[Kernel, Kernel]:
    log2 = mpmath.log(2)
    top = log2 * (1 + mpf(2) ** -20)  # more than ln 2, because the limit is rounded to float
    return (
        Kernel("DAHL_SLOPE", slope, top, 6),
        Kernel("DAHL_ROOT_POWER", lambda f: slope(f, log2 / ROOTS), mpf(1), 3),
    )


def fit(kernel: Kernel, points: list[mpf]) -> list[mpf]:
    """Return the polynomial with equal and alternating relative errors at all points."""
    powers = range(kernel.degree + 1)
    rows = [[x**k / kernel.function(x) for k in powers] + [(-1) ** i] for i, x in enumerate(points)]
    solution = mpmath.lu_solve(mpmath.matrix(rows), mpmath.ones(len(points), 1))
    return [solution[k] for k in powers]


def extremes(errors: list[mpf]) -> list[int]:
    """Return the place of the largest error in each run of one sign."""
    places: list[int] = []
    for i, error in enumerate(errors):
        if not places or (error > 0) != (errors[places[-1]] > 0):
            places.append(i)
        elif abs(error) > abs(errors[places[-1]]):
            places[-1] = i
    return places


def best(kernel: Kernel) -> tuple[list[mpf], mpf]:
    """Return the coefficients of a kernel, and its largest relative error."""
    grid = [kernel.top * i / SAMPLES for i in range(SAMPLES + 1)]
    last = kernel.degree + 1
    points = [kernel.top * (1 - mpmath.cos(mpmath.pi * i / last)) / 2 for i in range(last + 1)]
    for _ in range(EXCHANGES):
        coefficients = fit(kernel, points)
        errors = [mpmath.polyval(coefficients[::-1], x) / kernel.function(x) - 1 for x in grid]
        points = [grid[i] for i in extremes(errors)]
    return coefficients, max(map(abs, errors))


def main() -> None:
    mpmath.mp.dps = 40
    for kernel in kernels():
        coefficients, error = best(kernel)
        print(kernel.name, *(float(coefficient).hex() for coefficient in coefficients))
        print("relative error at most", mpmath.nstr(error, 3))
    print("DAHL_ROOTS", *(float(mpf(2) ** (-mpf(j) / ROOTS)).hex() for j in range(ROOTS)))


if __name__ == "__main__":
    main()
