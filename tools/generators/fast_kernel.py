# SPDX-License-Identifier: MIT
"""Coefficients of lib/batch/fast.h (needs mpmath).

    build/venv/bin/python tools/generators/fast_kernel.py

(1 - exp(-x))/x on [0, ln 2] by a polynomial of degree 6 whose *relative* error is least:
Remez' exchange in 40 digits.
A kernel that errs by r, relative, errs by at most 2 r Fc in torque, for ever.
"""

from __future__ import annotations

import mpmath
from mpmath import mpf

DEGREE, SAMPLES = 6, 4000
TOP = mpmath.log(2) * (
    1 + mpf(2) ** -20
)  # a little more than ln 2, for a limit that is rounded to float


def slope(x: mpf) -> mpf:
    return -mpmath.expm1(-x) / x if x else mpf(1)


def fit(points: list[mpf]) -> list[mpf]:
    """The polynomial whose relative error is the same at all points, with alternating signs."""
    rows = [
        [x**k / slope(x) for k in range(DEGREE + 1)] + [(-1) ** i] for i, x in enumerate(points)
    ]
    solution = mpmath.lu_solve(mpmath.matrix(rows), mpmath.ones(len(points), 1))
    return [solution[k] for k in range(DEGREE + 1)]


def extremes(errors: list[mpf]) -> list[int]:
    """The place of the largest error of each run of one sign."""
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
