#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Measure time and memory of an identification, and the time of the same fit by solve_ivp.

Usage: build/venv/bin/python tools/bench/identify.py [--rows N] [--short N]

Times are processor seconds of one thread. The solve_ivp fit gets a shorter log with the same
parameters sigma0, Fc and F0. scipy.optimize.least_squares starts 20 % off, and solve_ivp (RK45,
rtol 1e-6) integrates Eq. 1 between rows, from reversal to reversal.
"""

from __future__ import annotations

import argparse
import os
import resource
import time
from collections.abc import Callable
from typing import TypeVar

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np  # noqa: E402  (the number of threads comes first)
from dahl.identify import Log, Options, identify, models  # noqa: E402
from scipy.integrate import solve_ivp  # noqa: E402
from scipy.optimize import least_squares  # noqa: E402

SIGMA0, FC, COUNT = 100.0, 0.5, 2 * np.pi / 2**18


def synthetic(rows: int, cycles: float) -> Log:
    """Return a sine on an 18-bit encoder with 5 % noise. Both fits read the same angle."""
    theta = 0.05 * np.sin(2 * np.pi * cycles * np.arange(rows) / rows)
    moves = np.diff(theta, prepend=theta[0])
    torque = FC * models.dahl(moves, [slice(0, rows)], SIGMA0 / FC)
    torque += 0.05 * FC * np.random.default_rng(1).normal(size=rows)
    read = np.floor(theta / COUNT) * COUNT
    return Log("synthetic", read, torque, np.arange(rows) * 1e-3, resolution=COUNT)


def by_solve_ivp(log: Log) -> tuple[float, float, int]:
    """Return sigma0, Fc and the number of right-hand sides of the solve_ivp fit."""
    theta, calls = log.theta, 0
    moves = np.diff(theta)
    ends = [0, *(np.flatnonzero(np.diff(np.sign(moves)) != 0) + 1), len(moves)]

    def torque(p: np.ndarray) -> np.ndarray:
        nonlocal calls
        F, drawn = p[2], [np.array([p[2]])]  # noqa: N806
        for start, end in zip(ends, ends[1:], strict=False):
            side, at = np.sign(moves[start]), np.abs(theta[start : end + 1] - theta[start])
            if side == 0:
                drawn.append(np.full(end - start, F))
                continue
            done = solve_ivp(
                lambda _, y: side * p[0] * (1 - side * y / p[1]),  # noqa: B023
                (0, at[-1]),
                [F],
                t_eval=at[1:],
                rtol=1e-6,
                atol=1e-9,
            )
            calls += done.nfev
            drawn.append(done.y[0])
            F = done.y[0, -1]  # noqa: N806
        return np.concatenate(drawn)

    start = [1.2 * SIGMA0, 0.8 * FC, 0.0]

    def residual(p: np.ndarray) -> np.ndarray:
        return np.asarray(torque(p) - log.torque)

    found = least_squares(residual, start, x_scale=[10, 0.1, 0.1])
    return found.x[0], found.x[1], calls


T = TypeVar("T")


def timed(call: Callable[[], T]) -> tuple[float, T]:
    start = time.process_time()
    result = call()
    return time.process_time() - start, result


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n\n")[0])
    parser.add_argument("--rows", type=int, default=1_000_000, help="of the long log")
    parser.add_argument("--short", type=int, default=5_000, help="of the log of the comparison")
    args = parser.parse_args()
    short = synthetic(args.short, args.short / 1000)
    options = Options(terms=(), delay=False, median=1)
    identify([short], options)  # import all modules before the timed call
    ours, result = timed(lambda: identify([short], options))
    theirs, (sigma0, Fc, calls) = timed(lambda: by_solve_ivp(short))  # noqa: N806
    print(
        f"{args.short} rows: identify {ours:.3f} s, sigma0 {result.sigma0.value:.3f},"
        f" Fc {result.Fc.value:.4f}, with intervals and comparison"
    )
    print(
        f"{args.short} rows: solve_ivp {theirs:.3f} s, sigma0 {sigma0:.3f}, Fc {Fc:.4f},"
        f" {calls} right-hand sides; ratio {theirs / ours:.0f}"
    )
    long = synthetic(args.rows, args.rows / 5000)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    whole, result = timed(lambda: identify([long]))
    more = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
    print(
        f"{args.rows} rows: identify {whole:.2f} s, everything tried,"
        f" {1024 * more / args.rows:.0f} bytes per row beside the log; {result.verdict}"
    )


if __name__ == "__main__":
    main()
