# SPDX-License-Identifier: MIT
"""dahl.Commission on a drive in Python: a rotor with Dahl's friction and a position loop."""

from __future__ import annotations

import math
from typing import Any

import dahl
import pytest
from dahl.binding.commission import Command

PERIOD, COUNT, INERTIA, FC, SIGMA0, LOAD = 1e-3, 2 * math.pi / 2**16, 0.002, 0.5, 100.0, 0.1
SUBSTEPS, BANDWIDTH = 10, 2 * math.pi * 35


class Drive:
    """One axis. The command of a tick acts in the next one."""

    def __init__(self, sign: float = 1.0) -> None:
        self.sign, self.theta, self.speed, self.friction = sign, 0.0, 0.0, 0.0
        self.torque = self.next_torque = self.integral = 0.0
        self.mode, self.counts, self.commands = "off", 0, 0

    def __call__(self, command: Command) -> tuple[int, float]:
        loop = self._loop(command) if command.mode == "track" else command.torque
        self.mode, self.commands = command.mode, self.commands + 1
        acting, self.next_torque = self.next_torque, loop
        for _ in range(SUBSTEPS):
            self._move(acting * self.sign, PERIOD / SUBSTEPS)
        before, self.counts = self.counts, math.floor(self.theta / COUNT)
        return self.counts - before, loop

    def _loop(self, command: Command) -> float:
        error = command.angle - self.counts * COUNT
        wanted = BANDWIDTH / 5 * error + command.speed - self.speed
        gain = INERTIA * BANDWIDTH
        if self.mode != "track":
            self.integral = self.next_torque - gain * wanted
        self.integral += gain * BANDWIDTH / 6 * wanted * PERIOD
        torque = self.integral + gain * wanted + INERTIA * command.acceleration
        return min(max(torque, -command.torque_limit), command.torque_limit)

    def _move(self, torque: float, dt: float) -> None:
        moved = self.speed * dt
        goal = math.copysign(FC, moved) if moved else self.friction
        self.friction = goal + (self.friction - goal) * math.exp(-SIGMA0 * abs(moved) / FC)
        self.theta += moved
        self.speed += dt * (torque - self.friction - LOAD) / INERTIA


def new(**other: float) -> dahl.Commission:
    given = dict(period=PERIOD, theta_per_count=COUNT, inertia=1.2 * INERTIA, torque_limit=10 * FC)
    return dahl.Commission(**{**given, **other})


def test_an_axis_commissions_itself() -> None:
    axis, drive = new(), Drive()
    result = axis.run(drive)
    assert axis.stage == "done" and drive.mode == "off"
    truths = dict(Fc=FC, length=FC / SIGMA0, sigma0=SIGMA0, inertia=INERTIA, delay=PERIOD)
    for name, truth in {**truths, "viscous": 0.0}.items():
        assert result[name].least <= truth <= result[name].most, name
    assert result["load"] == pytest.approx(LOAD, abs=result["load_error"])
    assert axis.load(0.1) == pytest.approx(LOAD, abs=0.02)
    assert axis.compensator().gain == pytest.approx(result["gain"])
    assert axis.compensator(has_load=True).gain < result["gain"]


def test_a_wrong_sign_is_refused_with_the_next_step() -> None:
    axis, drive = new(), Drive(sign=-1.0)
    with pytest.raises(dahl.RunError, match="swap the sign"):
        axis.run(drive)
    assert axis.stage == "refused" and drive.mode == "off"


def test_a_drive_that_raises_is_switched_off() -> None:
    axis, modes = new(), []

    def drive(command: Command) -> tuple[int, float]:
        modes.append(command.mode)
        if len(modes) == 540:
            raise OSError("unplugged")
        return 0, 0.0

    with pytest.raises(OSError, match="unplugged"):
        axis.run(drive)
    assert modes[-2:] == ["track", "off"] and "aborted" in axis.refusal


def test_a_drive_that_returns_no_pair_is_named() -> None:
    def drive(command: Command) -> Any:
        """Forget to return."""

    with pytest.raises(TypeError, match=r"drive\(command\) returned None; \(counts moved"):
        new().run(drive)


@pytest.mark.parametrize("name", ["period", "inertia", "torque_limit", "travel", "speed_limit"])
def test_values_out_of_range_are_named(name: str) -> None:
    with pytest.raises(dahl.InputError, match=name):
        new(**{name: 0.0})
