# SPDX-License-Identifier: MIT
"""What is refused, with its value and its place, and what just passes beside each limit."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from dahl import Error
from dahl.identify.log import Log
from identify_cases import FC, in_steps, shaft, wrapping
from identify_tools import dahl_torque, seen, sine, synthetic

pytestmark = pytest.mark.usefixtures("library")


def changed(**columns: float) -> Log:
    """A log with a column that never changes."""
    log = shaft(rows=300, cycles=3)
    return replace(log, **{name: np.full(300, value) for name, value in columns.items()})


def clipped(part: float, rows: int = 4000, side: int = 1, moving: float = 1.0) -> Log:
    """A noisy torque whose sensor is at its end for a part of the rows, in part of which the shaft
    moves.
    """
    log = synthetic(1, rows=rows, cycles=4)
    start, count = rows // 4, int(part * rows)
    log.torque[start : start + count] = 1.01 * log.torque.max()
    rest = slice(start, start + int(count * (1 - moving)))
    log.theta[rest] = log.theta[start]
    return replace(log, torque=side * log.torque)


def creeping(end: float) -> Log:
    """A shaft that takes six rows and more for a count, and a sensor that ends at a part of Fc."""
    log = synthetic(1, rows=8000, cycles=4, amplitude=0.02)
    return replace(log, torque=np.clip(log.torque, -end * FC, end * FC))


def spanning(span: float, linear: bool) -> Log:
    log = synthetic(1, rows=400, cycles=3)
    return replace(
        log, theta=log.theta * span / np.ptp(log.theta), linear=linear, resolution=0.0, time=None
    )


def in_other_unit(counts: float, linear: bool = False, to_deg: bool = True) -> Log:
    """An angle in deg of an encoder of so many counts, taken for rad; or the reverse."""
    log = synthetic(1, rows=400, cycles=3, amplitude=0.6)
    step, turn = (360 / counts, np.degrees) if to_deg else (2 * np.pi / counts, lambda x: x)
    theta = np.round(turn(log.theta) / step) * step
    if not to_deg:
        theta, step = np.radians(theta), np.radians(step)
    return replace(log, theta=theta, resolution=step, linear=linear)


def short_pieces(rows: int) -> Log:
    """Ten pieces of so many rows between gaps of the clock."""
    log = synthetic(1, rows=10 * rows, cycles=4)
    return replace(log, time=log.time + 0.02 * (np.arange(10 * rows) // rows))


def swapped(noise: float) -> Log:
    """Angle for torque: the other way round draws the loop."""
    theta = sine(1, rows=2000, cycles=6)
    torque = dahl_torque(theta) + noise * FC * np.random.default_rng(1).normal(size=2000)
    return Log("x", torque, theta, np.arange(2000) * 1e-3)


def turning_in_mm(linear: bool) -> Log:
    theta = (3.0 * np.sin(np.linspace(0, 40, 4000)) + 3) * 1.5
    log = Log("x", theta % (2 * np.pi), dahl_torque(theta, 2.0, 1.0), linear=linear)
    return replace(log, torque=log.torque + 0.02 * np.random.default_rng(1).normal(size=4000))


REFUSED: dict[str, tuple[Callable[[], Log], str]] = {
    "angle at rest": (lambda: changed(theta=0.25), r"angle .*0\.25 .*300"),
    "torque at rest": (lambda: changed(torque=-1.5), r"torque .*-1\.5 .*300"),
    "29 rows": (lambda: synthetic(1, rows=29), "29 rows.* 30"),
    "30 rows": (lambda: synthetic(1, rows=30), ""),
    "clipped": (lambda: clipped(0.03), r"clipped at 0\.\d+ N m .120 of 4000 rows.* row 1001"),
    "hardly clipped": (lambda: clipped(0.019), ""),
    "clipped below": (lambda: clipped(0.03, side=-1), r"clipped at -0\.\d+ N m .120 of 4000"),
    "clipped while it rests": (lambda: clipped(0.03, moving=0.1), ""),
    "clipped, a third moves": (lambda: clipped(0.03, moving=0.35), "clipped"),
    "few clipped rows": (lambda: clipped(0.05, rows=380), ""),
    "22 clipped rows": (lambda: clipped(0.058, rows=380), "clipped .*22 of 380"),
    "creeping, clipped": (lambda: creeping(0.9), r"clipped at -?0\.45 N m"),
    "creeping": (lambda: creeping(2), ""),
    "coarse torque": (lambda: in_steps(4, 0.0), ""),
    "110 m": (lambda: spanning(1.1e2, True), "110 m.*100 "),
    "90 m": (lambda: spanning(0.9e2, True), ""),
    "9 nm": (lambda: spanning(0.9e-8, True), "9e-09 m.*1e-08"),
    "11 nm": (lambda: spanning(1.1e-8, True), ""),
    "11000 rad": (lambda: spanning(1.1e4, False), "11000 rad.*10000"),
    "9000 rad": (lambda: spanning(0.9e4, False), ""),
    "90 nrad": (lambda: spanning(0.9e-7, False), "9e-08 rad.*1e-07"),
    "110 nrad": (lambda: spanning(1.1e-7, False), ""),
    "deg of 4096": (lambda: in_other_unit(4096), "0878906 rad .*71\\.5 .*4096 in deg"),
    "deg of 256": (lambda: in_other_unit(256), "256 in deg"),
    "deg of 128": (lambda: in_other_unit(128), ""),
    "deg of 4096, a bit off": (lambda: in_other_unit(4096 * 1.0004), "4098 in deg"),
    "deg of another number": (lambda: in_other_unit(4096 * 1.0006), ""),
    "mm of 4096": (lambda: in_other_unit(4096, linear=True), ""),
    "rad of 4096": (lambda: in_other_unit(4096, to_deg=False), "4096 in rad"),
    "pieces of 29 rows": (lambda: short_pieces(29), "9 gaps.* 0 pieces.* 290 rows"),
    "pieces of 30 rows": (lambda: short_pieces(30), ""),
    "wrap at no period": (lambda: wrapping(200), " 16 times"),
    "wrap at a turn": (lambda: turning_in_mm(False), ""),
    "wrap at a turn, in m": (lambda: turning_in_mm(True), "unwrap"),
    "swapped": (lambda: swapped(0.02), "swapped"),
    "swapped, of noise": (lambda: swapped(3.0), ""),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_refused_and_what_just_passes(name):
    """With its value and place; what is a matter of units passes where these are trusted."""
    make, words = REFUSED[name]
    if not words:
        seen(make())
        return
    with pytest.raises(Error, match=words) as said:
        seen(make())
    assert "\n" not in str(said.value)
    if re.search("trust-units", str(said.value)):
        seen(make(), trust_units=True)


def test_a_wrap_is_undone():
    facts = seen(turning_in_mm(False))
    assert facts["sigma0"] == pytest.approx(2.0, rel=0.05)
    assert any("6.28319 rad" in note for note in facts["notes"])
