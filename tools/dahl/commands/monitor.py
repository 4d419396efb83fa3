# SPDX-License-Identifier: MIT
"""
Watch a friction node live in the terminal: torque over angle, both over time, and the counters.

Frames are decoded with lib/node/dahl.dbc (or --dbc). Works with any interface that python-can has.
Ends with Ctrl-C, or after --frames or --seconds. Without a terminal it prints one picture of the
state at the end.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from dahl.arguments import add_limits, whole
from dahl.bus import add_bus_arguments

if TYPE_CHECKING:
    import can

    from dahl.monitor_view import View

HELP = "live view of a node in the terminal"
EXAMPLE = """examples:
  dahl monitor -i socketcan -c vcan0
  dahl monitor -i socketcand -c vcan0 --host 127.0.0.1 --port 29536 --seconds 5"""

REDRAW = 0.25  # s


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--node", type=whole(0, 15), default=0, metavar="N", help="node number, 0 to 15"
    )
    parser.add_argument("--dbc", type=Path, help="bus description, if not lib/node/dahl.dbc")
    parser.add_argument(
        "--window",
        type=whole(2, 1000000),
        default=4000,
        metavar="TICKS",
        help="ticks that are shown",
    )
    add_limits(parser)
    add_bus_arguments(parser)


def run(args: argparse.Namespace) -> None:
    from rich.live import Live

    from dahl import terminal
    from dahl.bus import open_from, received, silent
    from dahl.interrupt import Stop
    from dahl.monitor_view import View

    console = terminal.console()
    view = View(args.node, args.window, args.dbc)
    begin = time.monotonic()
    try:
        with open_from(args) as bus, Stop() as stop:
            frames = received(bus, stop, args.seconds, args.frames)
            if console.is_terminal:
                with Live(view, console=console, screen=True, auto_refresh=False) as live:
                    _watch(frames, view, live.refresh)
            else:
                _watch(frames, view, lambda: None)
    finally:
        if view.frames:
            console.print(view)
    if not view.frames:
        raise silent(args, time.monotonic() - begin)


def _watch(frames: Iterable[can.Message | None], view: View, draw: Callable[[], None]) -> None:
    """Feed the view until the end, and draw it from time to time."""
    drawn = 0.0
    for frame in frames:
        if frame is not None:
            view.feed(frame)
        if time.monotonic() - drawn > REDRAW:
            drawn = time.monotonic()
            draw()
