# SPDX-License-Identifier: MIT
"""The sweeps of a commissioning as a table for a drive, and the recording of that table.

The later stages need the torque mode of the drive, and the kicks need the compensator in it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dahl.binding.commission import Command, Commission
from dahl.errors import InputError
from dahl.io.log import Log
from dahl.sim import axis as simulation
from dahl.sim.axis import Commissioned, Trace

MAX_ERROR = 0.06  # RMS distance of a recording from its table over the travel; Fc is then 2 % low


@dataclass(frozen=True)
class Motion:
    """Rows of a table, one each period."""

    period: float  # s
    travel: float  # rad
    angle: np.ndarray  # rad
    speed: np.ndarray  # rad/s
    acceleration: np.ndarray  # rad/s2
    sweeps: int  # rows up to the end of the sweeps

    @property
    def time(self) -> np.ndarray:
        """s."""
        return np.arange(len(self.angle)) * self.period


def motion(travel: float) -> Motion:
    """Return the motion for a travel in rad, as the library makes it for an axis without load."""
    axis = simulation.simulated(travel)
    commands: list[Command] = []
    simulation.commission(axis, simulation.Shaft(gravity=0.0), watch=commands.append)
    stages = [one.stage for one in commands]
    sweeps = stages.index("cycle")
    is_back = [one.mode != "track" for one in commands[sweeps:]]  # the way back to the middle
    rows = commands[: sweeps + is_back.index(True)]
    angle, speed, acceleration = np.array([one[1:4] for one in rows]).T
    return Motion(axis.period, travel, angle, speed, acceleration, sweeps)


@dataclass(frozen=True)
class Placed:
    """A recording on the clock of its table: row k belongs to row k of the table."""

    angle: np.ndarray  # rad from the first angle of the table
    torque: np.ndarray  # N m
    start: float  # s, of the table in the recording


def place(log: Log, table: Motion) -> Placed:
    """Find the motion of the table in a recording. Raises dahl.Error if it is not there."""
    if log.time is None or log.linear:
        raise InputError(f"{log.name}: a recording needs times, and an angle that turns")
    time = log.time - log.time[0]
    grid = np.arange(0.0, float(time[-1]), table.period)
    if len(grid) < table.sweeps:
        seconds = table.sweeps * table.period
        raise InputError(f"{log.name}: {time[-1]:.3g} s; the sweeps alone take {seconds:.3g} s")
    theta, torque = (np.interp(grid, time, values) for values in (log.theta, log.torque))
    wanted = table.angle[: table.sweeps]
    errors = _distances(theta, wanted)
    first = int(np.argmin(errors))
    if errors[first] > MAX_ERROR * table.travel:
        raise InputError(
            f"{log.name}: the angle is {errors[first]:.2g} rad (RMS) away from the table: is it a"
            " recording of this --travel from its start, with its unit and sign, by a loop that"
            " follows?"
        )
    moved = theta[first : first + table.sweeps]
    theta = theta[first:] - np.mean(moved - wanted)
    work = np.sum(torque[first : first + table.sweeps - 1] * np.diff(moved))
    if not np.any(torque):
        raise InputError(f"{log.name}: the torque is 0 in all rows: is it the right column?")
    if work < 0:
        raise InputError(f"{log.name}: the torque pushes against the motion: negate it")
    return Placed(theta, torque[first:], first * table.period)


def _distances(theta: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Return the RMS distance of each window of theta from the wanted angles, less its mean."""
    rows, centred = len(wanted), wanted - wanted.mean()
    theta = theta - theta.mean()
    size = len(theta) + rows
    spectrum = np.fft.rfft(theta, size) * np.conj(np.fft.rfft(centred, size))
    product = np.fft.irfft(spectrum, size)[: len(theta) - rows + 1]
    sums = (np.concatenate(([0.0], np.cumsum(values))) for values in (theta, theta**2))
    first, second = (values[rows:] - values[:-rows] for values in sums)
    square = second - first**2 / rows - 2 * product + np.sum(centred**2)
    root: np.ndarray = np.sqrt(np.maximum(square, 0.0) / rows)
    return root


def replay(axis: Commission, placed: Placed) -> Commissioned:
    """Give a recording to the library, up to the end of the sweeps. A refusal is not raised."""
    counts = np.rint(placed.angle / axis.theta_per_count).astype(int).tolist()
    torques, trace = [0.0, *placed.torque.tolist()], Trace(axis.period)
    before = counts[0]
    for now, torque in zip(counts, torques, strict=False):
        command = axis.tick(now - before, torque)
        before = now
        if command.stage not in ("rest", "sweeps"):
            break
        trace.append(command, now * axis.theta_per_count, torque)
    return Commissioned(axis, trace)
