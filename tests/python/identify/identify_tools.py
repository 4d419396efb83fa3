# SPDX-License-Identifier: MIT
"""Synthetic logs for the tests of identification. The torque comes from the closed form of Eq. 1
between reversals, with no code of the package in it; the encoder rounds a motion that is smooth.
"""

from __future__ import annotations

import json
import re
import subprocess
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from dahl.io.log import Log

SIGMA0, FC = 100.0, 0.5  # N m/rad, N m
COUNT = 2 * np.pi / 2**14  # rad


def springs(theta: np.ndarray, *parts: tuple[float, float]) -> np.ndarray:
    """Springs that slip, (sigma0, Fc) each, row by row."""
    forces, drawn = np.zeros(len(parts)), []
    stiffness, limits = np.array(parts).T
    for move in np.diff(theta, prepend=theta[0]):
        forces = np.clip(forces + stiffness * move, -limits, limits)
        drawn.append(forces.sum())
    return np.array(drawn)


def dahl_torque(theta: np.ndarray, sigma0: float = SIGMA0, Fc: float = FC):  # noqa: N803
    """Torque on a path that turns at its rows: anchored at each reversal, from rest."""
    moves = np.diff(theta, prepend=theta[0])
    a, ratio = sigma0 / Fc, np.zeros(len(theta))
    moving = np.flatnonzero(moves)
    turns = moving[1:][np.diff(np.sign(moves[moving])) != 0]  # the first row of each new direction
    for start, end in zip([0, *turns], [*turns, len(theta)], strict=True):
        before = ratio[start - 1] if start else 0.0
        side = np.sign(moves[start:end].sum())
        travel = np.cumsum(np.abs(moves[start:end]))
        ratio[start:end] = side - (side - before) * np.exp(-a * travel)
    return Fc * ratio


def behind_play(theta: np.ndarray, width: float) -> np.ndarray:
    """The angle behind a play, row by row."""
    position, behind = theta[0], []
    for ahead in theta.tolist():
        position = min(max(position, ahead - width / 2), ahead + width / 2)
        behind.append(position)
    return np.array(behind)


def varying_torque(
    theta: np.ndarray,
    sigma0: np.ndarray,
    Fc: np.ndarray,  # noqa: N803
    is_reduced: bool = False,
) -> np.ndarray:
    """Torque with parameters of each row's own: the exact step from row to row, in long double.

    If `is_reduced`, a falling Fc reduces the torque at once, as a falling load does.
    """
    torque, F, before = [], np.longdouble(0), Fc[0]  # noqa: N806
    for move, stiffness, limit in zip(np.diff(theta, prepend=theta[0]), sigma0, Fc, strict=True):
        F *= min(limit / before, 1.0) if is_reduced else 1.0  # noqa: N806
        share = -np.expm1(-np.longdouble(stiffness) * abs(move) / limit)
        F += (np.sign(move) * limit - F) * share  # noqa: N806
        torque.append(float(F))
        before = limit
    return np.array(torque)


def sine(
    seed: int = 0, rows: int = 10_000, cycles: float = 10, amplitude: float = 0.05
) -> np.ndarray:
    """A smooth motion, rad."""
    phase = np.random.default_rng(seed).uniform(0, 2 * np.pi)
    return amplitude * np.sin(2 * np.pi * cycles * np.arange(rows) / rows + phase)


def noise_of(seed: int, rows: int, shared: float = 0.0) -> np.ndarray:
    """Unit variance; `shared` correlates neighbouring rows."""
    from scipy.signal import lfilter

    white = np.random.default_rng([seed, 1]).normal(size=rows)
    return lfilter([np.sqrt(1 - shared**2)], [1, -shared], white) if shared else white


def synthetic(seed: int = 0, part: float = 0.05, shared: float = 0.0, **motion: float) -> Log:
    """14 bits, noise of `part` of Fc, 1 kHz."""
    theta = sine(seed, **motion)
    offset = np.random.default_rng([seed, 2]).uniform()
    read = np.floor(theta / COUNT + offset) * COUNT
    torque = dahl_torque(theta) + part * FC * noise_of(seed, len(theta), shared)
    return Log(f"seed {seed}", read, torque, np.arange(len(theta)) * 1e-3, resolution=COUNT)


def shaft(seed: int = 3, noise: float = 0.02, rows: int = 2400, cycles: float = 8, **more) -> Log:
    return synthetic(seed, noise, rows=rows, cycles=cycles, **more)


def log_of(theta: np.ndarray, torque: np.ndarray, noise: float = 0.02, count: float = COUNT) -> Log:
    """The log of a motion and its torque; with count 0 its angle has no encoder."""
    read = np.floor(theta / count + 0.3) * count if count else theta
    noisy = torque + noise * FC * noise_of(3, len(theta))
    return Log("rig", read, noisy, np.arange(len(theta)) * 1e-3, resolution=count)


def chirp(rows: int = 3000, amplitude: float = 0.05, first: float = 4, last: float = 14):
    """A motion of many speeds, rad."""
    x = np.linspace(0, 1, rows)
    return amplitude * np.sin(2 * np.pi * (first * x + (last - first) / 2 * x**2))


def turns_of(theta: np.ndarray) -> np.ndarray:
    """The rows at which a smooth motion turns."""
    return np.flatnonzero(np.diff(np.sign(np.diff(theta)))) + 1


def with_gaps(log: Log, *cuts: tuple[int, int]) -> Log:
    """Without the rows of these cuts; the clock goes on."""
    kept = np.ones(log.rows, dtype=bool)
    for start, end in cuts:
        kept[start:end] = False
    return log.part(kept)


def caller(capsys: pytest.CaptureFixture) -> Callable[..., subprocess.CompletedProcess]:
    """The command `dahl` in this process, which has its imports behind it: as run_dahl of conftest,
    several times as quick.
    """
    from dahl.cli import main

    def run(*words: object, **_: object) -> subprocess.CompletedProcess:
        try:
            code = main([str(word) for word in words])
        except SystemExit as end:  # argparse's way
            code = end.code
        out, err = capsys.readouterr()
        return subprocess.CompletedProcess(words, code, out, err)

    return run


def complaint(done: subprocess.CompletedProcess) -> tuple[int, str]:
    """The exit code of a verb that ended in one line, and that line."""
    found = re.fullmatch(r"error: ([^\n]+)\n", done.stderr)
    assert found, done.stderr
    return done.returncode, found[1]


def write_csv(path, theta: np.ndarray, torque: np.ndarray, header: str = "t,angle_deg,torque_Nm"):
    """A log as a file: time in s at 1 kHz, angle in deg."""
    table = np.column_stack((np.arange(len(theta)) * 1e-3, np.degrees(theta), torque))
    np.savetxt(path, table, fmt="%.9g", delimiter=",", header=header, comments="")
    return path


# --- the JSON of an identification ----------------------------------------------------------------


def seen(*logs: Log, **options: object) -> dict[str, Any]:
    """The numbers that `dahl identify --json -` prints, of logs in memory."""
    from dahl.identify import Options, identify, report

    return json.loads(report.as_json(identify(logs, Options(**options))))


def width(facts: dict[str, Any], name: str) -> float:
    """Half the interval of a parameter, in parts of it."""
    low, high = facts["ci95"][name]
    return (high - low) / 2 / facts[name] if high is not None else np.inf
