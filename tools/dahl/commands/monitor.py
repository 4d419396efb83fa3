# SPDX-License-Identifier: MIT
"""Watch a friction node live in the terminal: the counters, torque over angle, both over time.

It decodes frames with the DBC of the node, or with --dbc, on any interface of python-can. It needs
60 columns and 18 rows. Torques are in N m if Fc is known: by --fc, by --scene, or by a ParamReply
on the bus. "behind" is the delay of reading; if it grows, the bus drops frames. Stop it with
Ctrl-C, or by --frames or --seconds. Without a terminal it prints the final state, with --json the
numbers.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from dahl.commands.arguments import add_limits, positive, whole
from dahl.commands.bus_arguments import add_bus_arguments

if TYPE_CHECKING:
    from dahl.can.bus import Reception
    from dahl.can.monitor_view import View

HELP = "live view of a node in the terminal"
EXAMPLE = """examples:
  dahl monitor -i socketcan -c vcan0
  dahl monitor -i socketcand -c vcan0 --host 127.0.0.1 --port 29536 --seconds 5"""

REDRAW_PERIOD_S = 0.25


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--node",
        type=whole(0, 15),
        metavar="N",
        help="node number, 0 to 15 (default: that of the scene, else 0)",
    )
    parser.add_argument("--dbc", type=Path, help="bus description, if not that of `dahl dbc`")
    parser.add_argument(
        "--window",
        type=whole(2, 1000000),
        default=4000,
        metavar="TICKS",
        help="number of ticks in the curves",
    )
    known = parser.add_mutually_exclusive_group()
    known.add_argument("--fc", type=positive, metavar="Y", help="Fc of the node, N m")
    known.add_argument("--scene", metavar="NAME", help="scene that gives Fc and number")
    parser.add_argument("--json", action="store_true", help="print the numbers at the end, as JSON")
    add_limits(parser)
    add_bus_arguments(parser)


def run(args: argparse.Namespace) -> None:
    from rich.live import Live

    from dahl.can.bus import Reception, open_from, silent
    from dahl.can.monitor_view import View
    from dahl.interrupt import Stop
    from dahl.report import terminal

    console = terminal.console()
    number, Fc, unit = _known(args)  # noqa: N806 (the field's name)
    view = View(number, args.window, args.dbc, Fc, unit)
    begin = time.monotonic()
    try:
        with open_from(args) as bus, Stop(is_its_end=True) as stop:
            frames = Reception(bus, stop, args.seconds, args.frames)
            if console.is_terminal and not args.json:
                view.fills_screen = True
                with Live(view, console=console, screen=True, auto_refresh=False) as live:
                    _watch(frames, view, live.refresh)
            else:
                _watch(frames, view, lambda: None)
    finally:
        view.fills_screen = False
        if view.frames and args.json:
            print(json.dumps(view.as_dict(), indent=2))
        elif view.frames:
            console.print(view)
    if not view.frames:
        raise silent(args, time.monotonic() - begin)


def _known(args: argparse.Namespace) -> tuple[int, float | None, str]:
    """Return number, Fc (None if unknown) and torque unit of the node."""
    from dahl.sim import scene

    if args.scene is None:
        return args.node or 0, args.fc, "N m"
    found = scene.read(scene.find(args.scene))
    number = found.node if args.node is None else args.node
    return number, found.Fc, found.measured.unit


def _watch(frames: Reception, view: View, draw: Callable[[], None]) -> None:
    """Pass frames to the view until the end, and redraw it periodically."""
    drawn = 0.0
    for frame in frames:
        view.lag_s, view.most_lag_s = frames.lag_s, frames.most_lag_s
        if frame is not None:
            view.feed(frame)
        if time.monotonic() - drawn > REDRAW_PERIOD_S:
            drawn = time.monotonic()
            draw()
