# SPDX-License-Identifier: MIT
"""
Watch a friction node live in the terminal: torque over angle, both over time, and the counters.

Frames are decoded with port/dahl.dbc (or --dbc). Works with any interface that python-can has. Ends
with Ctrl-C, or after --frames or --seconds. Without a terminal it prints one picture of the state
at the end.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

from dahl.bus import add_bus_arguments

HELP = "live view of a node in the terminal"
EXAMPLE = """examples:
  dahl monitor -i socketcan -c vcan0
  dahl monitor -i socketcand -c vcan0 --host 127.0.0.1 --port 29536 --seconds 5"""

REDRAW = 0.25  # s


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_bus_arguments(parser)
    parser.add_argument("--node", type=int, default=0, metavar="N", help="node number, 0 to 15")
    parser.add_argument("--dbc", type=Path, help="bus description, if not port/dahl.dbc")
    parser.add_argument(
        "--window", type=int, default=4000, metavar="TICKS", help="ticks that are shown"
    )
    parser.add_argument("--frames", type=int, metavar="N", help="end after N frames")
    parser.add_argument("--seconds", type=float, metavar="S", help="end after S seconds")


def run(args: argparse.Namespace) -> None:
    from rich.console import Console
    from rich.live import Live

    from dahl.bus import open_from
    from dahl.loop import Stop
    from dahl.view import View

    console = Console()
    view = View(args.node, args.window, args.dbc)
    with open_from(args) as bus, Stop() as stop:
        if not console.is_terminal:
            for _ in _frames(bus, view, args, stop):
                pass
        else:
            with Live(view, console=console, screen=True, auto_refresh=False) as live:
                for _ in _frames(bus, view, args, stop):
                    live.refresh()
    console.print(view)


def _frames(bus, view, args: argparse.Namespace, stop):
    """Feed the view until the end; yields whenever it is time to draw."""
    until = time.monotonic() + args.seconds if args.seconds else None
    drawn = 0.0
    while (
        not stop.asked
        and view.frames != args.frames
        and (until is None or time.monotonic() < until)
    ):
        message = bus.recv(0.1)
        if message is not None:
            view.feed(message)
        if time.monotonic() - drawn > REDRAW:
            drawn = time.monotonic()
            yield
