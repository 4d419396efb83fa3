# SPDX-License-Identifier: MIT
"""Synthetic logs for the tests of identification. The torque comes from recurrences of this file,
with no code of the package in it; the encoder rounds a motion that is smooth.
"""

import json
import re
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
import pytest
from dahl.io.log import Log
from matplotlib.figure import Figure

if TYPE_CHECKING:
    from dahl.identify.fit import Hypothesis

SIGMA0, FC = 100.0, 0.5  # N m/rad, N m
COUNT = 2 * np.pi / 2**14  # rad
SCALE = {"sigma0": 1.0, "Fc": 1.0}  # factors of all friction of this file (true_law.py)


def springs(theta: np.ndarray, *parts: tuple[float, float]) -> np.ndarray:
    """Springs that slip, (sigma0, Fc) each, row by row."""
    forces, drawn = np.zeros(len(parts)), []
    stiffness, limits = np.array(parts).T * [[SCALE["sigma0"]], [SCALE["Fc"]]]
    for move in np.diff(theta, prepend=theta[0]):
        forces = np.clip(forces + stiffness * move, -limits, limits)
        drawn.append(forces.sum())
    return np.array(drawn)


def dahl_torque(
    theta: np.ndarray,
    sigma0: np.ndarray | float = SIGMA0,
    Fc: np.ndarray | float = FC,  # noqa: N803
    is_reduced: bool = False,
) -> np.ndarray:
    """Torque by the exact step of Eq. 1 from row to row, from rest, with parameters for each row.

    If `is_reduced`, a falling Fc reduces the torque at once, as a falling load does.
    """
    scaled = SCALE["sigma0"] * np.asarray(sigma0, float), SCALE["Fc"] * np.asarray(Fc, float)
    stiffness, limits = (np.broadcast_to(x, theta.shape) for x in scaled)
    torque, F, before = [], 0.0, limits[0]  # noqa: N806
    moves = np.diff(theta, prepend=theta[0])
    for move, k, limit in zip(moves.tolist(), stiffness.tolist(), limits.tolist(), strict=True):
        F *= min(limit / before, 1.0) if is_reduced else 1.0  # noqa: N806
        end = limit if move > 0 else -limit
        F += (end - F) * -np.expm1(-k * abs(move) / limit)  # noqa: N806
        torque.append(F)
        before = limit
    return np.array(torque)


def behind_play(theta: np.ndarray, width: float) -> np.ndarray:
    """The angle behind a play, row by row."""
    position, behind = theta[0], []
    for ahead in theta.tolist():
        position = min(max(position, ahead - width / 2), ahead + width / 2)
        behind.append(position)
    return np.array(behind)


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


def write_csv(
    path: Path, theta: np.ndarray, torque: np.ndarray, header: str = "t,angle_deg,torque_Nm"
) -> Path:
    """A log as a file: time in s at 1 kHz, angle in deg."""
    columns = (np.arange(len(theta)) * 1e-3, np.degrees(theta), torque)
    return write_table(path, dict(zip(header.split(","), columns, strict=True)))


def write_table(path: Path, columns: dict[str, np.ndarray]) -> Path:
    pd.DataFrame(columns).to_csv(path, index=False, float_format="%.12g")
    return path


def seen(*logs: Log, **options: object) -> dict[str, Any]:
    """The numbers that `dahl identify --json -` prints, of logs in memory."""
    from dahl.identify import Options, identify, report

    return json.loads(report.as_json(identify(logs, Options(**options))))


def described(
    law: str = "dahl", lag: str = "none", *more: object, **others: object
) -> "Hypothesis":
    """A hypothesis by the names of its law and lag."""
    from dahl.identify.fit import Hypothesis
    from dahl.identify.lags import lag_of
    from dahl.identify.laws import law_of

    return Hypothesis(law_of(law), lag_of(lag), *more, **others)


def replayed(scene: Path, folder: Path, *words: object) -> Figure:
    """The picture of `dahl plot` after a node has played a scene."""
    from log_reading import drawing, run

    record = folder / "run.log"
    play = ["loop", "--scene", scene, "--virtual", "--log", record, *words]
    assert run(*play).returncode == 0
    with drawing(rendered=False) as figures:
        assert run("plot", record, "--scene", scene).returncode == 0
    return figures[0]


def replayed_r2(scene: Path, folder: Path) -> float:
    """R2 of the torque of that node, as the picture states it."""
    legend = replayed(scene, folder, "--seconds", 4).axes[0].get_legend().get_texts()
    return float(re.search(r"R² (\S+)", legend[1].get_text())[1])
