# SPDX-License-Identifier: MIT
"""The encoder example is built as a user builds it, and prints what the model says."""

from __future__ import annotations

import math
import re
import subprocess
from pathlib import Path

import pytest
from conftest import ROOT


def run(*command: object) -> str:
    words = [str(word) for word in command]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def output_of(example: str, folder: Path) -> str:
    flags = "-DCMAKE_C_FLAGS=-Wall -Wextra -pedantic -Werror"
    run("cmake", "-S", ROOT / "examples" / example, "-B", folder, "-G", "Ninja", flags)
    run("cmake", "--build", folder)
    return run(folder / example)


def torque_after(moves: list[int], travel: float) -> float:
    """F/Fc by the paper's recursion, from a relaxed bristle."""
    w = 0.0
    for move in moves:
        w += (math.copysign(1, move) - w) * -math.expm1(-travel * abs(move))
    return w


def test_encoder_16bit_timer(tmp_path: Path) -> None:
    """Over the wrap of the timer and back; the jump at its index pulse leaves the torque."""
    printed = output_of("encoder_16bit_timer", tmp_path)
    rows = re.findall(r"timer +(\d+) +([+-][\d.]+) N m", printed)
    readings = [int(reading) for reading, _ in rows]
    moves = [(b - a + 32768) % 65536 - 32768 for a, b in zip(readings, readings[1:], strict=False)]
    assert max(readings) > 65000 and min(readings[:-1]) < 100, "the motion passes the wrap"
    for n, (_, torque) in enumerate(rows[:-1]):
        expected = 0.5 * torque_after(moves[:n], 100 / 0.5 * 2 * math.pi / 10000)
        assert float(torque) == pytest.approx(expected, abs=1e-4)
    assert rows[-1][1] == rows[-2][1] and printed.strip().endswith("jumps 1")
