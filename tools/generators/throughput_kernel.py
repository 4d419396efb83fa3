# SPDX-License-Identifier: MIT
"""Compute the coefficients of lib/batch/throughput.h (needs mpmath).

    build/venv/bin/python tools/generators/throughput_kernel.py

They approximate (1 - exp(-x))/x on [0, ln 2] by a polynomial of degree 6 with the least *relative*
error, by Remez' exchange in 40 digits. If the kernel has the relative error r, the torque has an
error of at most 2 r Fc, for any number of ticks.
"""

from __future__ import annotations

import mpmath
from mpmath import mpf

DEGREE, SAMPLES = 6, 4000
TOP = mpmath.log(2) * (
    1 + mpf(2) ** -20
)  # slightly more than ln 2, because the limit is rounded to float


def slope(x: mpf) -> mpf:
    return -mpmath.expm1(-x) / x if x else mpf(1)


def fit(points: list[mpf]) -> list[mpf]:
    """Return the polynomial with equal and alternating relative errors at all points."""
    rows = [
        [x**k / slope(x) for k in range(DEGREE + 1)] + [(-1) ** i] for i, x in enumerate(points)
    ]
    solution = mpmath.lu_solve(mpmath.matrix(rows), mpmath.ones(len(points), 1))
    return [solution[k] for k in range(DEGREE + 1)]


def extremes(errors: list[mpf]) -> list[int]:
    """Return the place of the largest error in each run of one sign."""
    places: list[int] = []
    for i, error in enumerate(errors):
        if not places or (error > 0) != (errors[places[-1]] > 0):
            places.append(i)
        elif abs(error) > abs(errors[places[-1]]):
            places[-1] = i
    return places


def main() -> None:
    mpmath.mp.dps = 40
    grid = [TOP * i / SAMPLES for i in range(SAMPLES + 1)]
    count = DEGREE + 2
    points = [TOP * (1 - mpmath.cos(mpmath.pi * i / (count - 1))) / 2 for i in range(count)]
    for _ in range(12):
        coefficients = fit(points)
        errors = [mpmath.polyval(coefficients[::-1], x) / slope(x) - 1 for x in grid]
        points = [grid[i] for i in extremes(errors)]
    for coefficient in coefficients:
        print(float(coefficient).hex())
    print("relative error at most", mpmath.nstr(max(map(abs, errors)), 3))


if __name__ == "__main__":
    main()
