# SPDX-License-Identifier: MIT
"""
Record a bus into a candump log that canplayer can replay.

Works with any interface that python-can has. Ends with Ctrl-C, or after --frames or --seconds; the
file holds whole lines at any moment.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from dahl.arguments import add_limits
from dahl.bus import add_bus_arguments

HELP = "record any python-can bus into a candump log"
EXAMPLE = """examples:
  dahl record -i socketcan -c vcan0 -o run.log --seconds 10
  dahl record -i socketcand -c vcan0 --host 127.0.0.1 --port 29536 -o run.log"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_bus_arguments(parser)
    parser.add_argument(
        "-o", "--output", type=Path, required=True, metavar="RUN.log", help="file to write"
    )
    add_limits(parser)


def run(args: argparse.Namespace) -> None:
    from dahl.bus import candump_line, open_from, received
    from dahl.interrupt import Stop

    frames = 0
    with open_from(args) as bus, Stop() as stop, args.output.open("w", buffering=1) as log:
        for message in received(bus, stop, args.seconds, args.frames):
            if message is not None:
                log.write(candump_line(message))
                frames += 1
    print(f"{frames} frames in {args.output}")
