# SPDX-License-Identifier: MIT
"""Cancel friction from a host: read the angle of an ODrive or a moteus, send a feed-forward torque.

An ODrive must be in torque mode and send its estimates every 2 ms: its default of 10 ms would count
as a fault. Enable its watchdog: without it, the last torque stays if this program ends. A moteus is
set to its position mode without gains. A host adds delay and jitter: prefer the current loop of the
drive if you can change it. The turns are floats, so that 1/16384 turn is lost beyond 512 turns.

    dahl commission -i socketcan -c can0 --drive odrive --period 2e-3 --counts-per-turn 16384
        --inertia 2e-4 --torque-limit 0.3 --name rig          # the axis measures its own friction
    feed_forward.py odrive can0 --from build/identify/rig.json
    feed_forward.py odrive can0 --Fc-low 0.045 --length-long 0.0055 --sigma0-high 9 --inertia 2e-4
        --delay 4e-3 --limit 0.06 --fade-speed 5

Without --from, the first three are by dahl identify. An axis with less friction than Fc-low runs
away up to twice the fade speed: docs/compensation.md has how to find each bound, and how to switch
on.
"""

import argparse
import json
import math
import sys
import time
from pathlib import Path
from typing import Any

import can
import dahl
from dahl.can.drives import Drive, Moteus, ODrive

PERIOD_S = 2e-3  # of the drive's estimates
TIMEOUT_S = 3 * PERIOD_S
COUNTS_PER_TURN = 16384
JUMP = 500  # counts in a tick


class FeedForward:
    """Compensate by the measured law. The bounds are those of dahl.Compensator."""

    def __init__(
        self,
        drive: Drive,
        *,
        Fc_low: float,
        length_long: float,
        elastic: bool = False,
        **bounds: Any,
    ) -> None:
        theta_per_count = 2 * math.pi / COUNTS_PER_TURN
        length = 4 * length_long if elastic else length_long
        plan = dahl.Plan(Fc_low / length, Fc_low, theta_per_count)
        self._drive, self._element = drive, dahl.Friction(plan)
        self._counts: int | None = None
        self._compensator = dahl.Compensator(
            *(plan.sigma0, plan.Fc, plan.theta_per_count),
            Fc_low=Fc_low,
            length_long=length_long,
            elastic=elastic,
            slew=200 * Fc_low,  # N m/s
            period=PERIOD_S,
            rise=0.5,  # s
            fall=0.02,  # s
            noise=1,  # counts
            play=4,
            jump=JUMP,
            **bounds,
        )

    def tick(self, bus: can.BusABC) -> float:
        """Wait for an angle, send the torque, return it in N m. Without angles it fades out."""
        turns = self._wait(bus)
        counts = self._counts if turns is None else round(turns * COUNTS_PER_TURN)
        moved = 0 if counts is None or self._counts is None else counts - self._counts
        self._counts = counts
        moved = max(-JUMP - 1, min(moved, JUMP + 1))  # a longer one is rejected
        move = self._compensator.move(moved, is_good=turns is not None)
        torque = self._compensator.torque(self._element.step_counts_q30(move))
        bus.send(self._drive.command(torque))
        return torque

    def _wait(self, bus: can.BusABC) -> float | None:
        """Return the next angle in turns, or None after TIMEOUT_S."""
        end = time.monotonic() + TIMEOUT_S
        while (left := end - time.monotonic()) > 0:
            message = bus.recv(left)
            turns = self._drive.turns(message) if message else None
            if turns is not None:
                return turns
        return None


def open_bus(channel: str, is_fd: bool) -> can.BusABC:
    """Open an interface of SocketCAN, or end the program with a message."""
    try:
        return can.Bus(interface="socketcan", channel=channel, fd=is_fd)
    except (OSError, can.CanError) as error:
        sys.exit(f"error: cannot open {channel}: {error}")


BOUNDS = {"Fc-low": "N m", "length-long": "rad", "sigma0-high": "N m/rad", "inertia": "kg m2"}
BOUNDS |= {"delay": "s", "limit": "N m", "fade-speed": "rad/s"}


def options() -> dict[str, Any]:
    """Each bound must be given: one of another axis is unsafe."""
    parser = argparse.ArgumentParser(description="Cancel friction by a feed-forward torque.")
    parser.add_argument("drive", choices=["odrive", "moteus"])
    parser.add_argument("channel", help="an interface of SocketCAN")
    parser.add_argument("--from", dest="known", type=Path, help="JSON by dahl commission")
    for name, unit in BOUNDS.items():
        parser.add_argument(f"--{name}", type=float, help=unit)
    parser.add_argument("--load", type=float, default=0.0, help="N m, constant from outside")
    parser.add_argument("--elastic", action="store_true", help="a gear, belt or coupling")
    given = vars(parser.parse_args())
    known = given.pop("known")
    names = [name.replace("-", "_") for name in BOUNDS]
    if known is None:
        missing = ", ".join(f"--{name}" for name in BOUNDS if given[name.replace("-", "_")] is None)
        if missing:
            parser.error(f"required: {missing}, or --from")
        return given
    try:
        axis = json.loads(known.read_text())["compensator_without_load_table"]
    except (OSError, ValueError, KeyError, TypeError):
        parser.error(f"{known}: no file of dahl commission")
    if axis is None:
        parser.error(f"{known}: the axis was refused, or its recording shows no bounds")
    bounds = {name: axis[name] for name in (*names, "load", "gain")}
    return given | bounds | {"elastic": bool(axis["elastic"])}


if __name__ == "__main__":
    bounds = options()
    kind, channel = bounds.pop("drive"), bounds.pop("channel")
    drive: ODrive | Moteus = ODrive() if kind == "odrive" else Moteus()
    try:
        feed = FeedForward(drive, **bounds)
    except dahl.Error as error:
        sys.exit(f"error: {error}")
    with open_bus(channel, kind == "moteus") as opened:
        while True:
            feed.tick(opened)
            time.sleep(PERIOD_S if kind == "moteus" else 0)  # it sends an angle on request
