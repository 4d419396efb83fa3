# SPDX-License-Identifier: MIT
"""The options with which a command names its CAN bus."""

from __future__ import annotations

import argparse

from dahl import dependencies
from dahl.can.bus import FLAGS
from dahl.commands.arguments import whole


def add_bus_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of python-can (-i, -c, -b, --fd, --bus-kwargs, ...), --host and --port.

    Without them, the settings of python-can (~/.canrc) are used.
    """
    try:
        import can.cli
    except ModuleNotFoundError:
        _add_bus_names(parser)
    else:
        can.cli.add_bus_arguments(parser)
    parser.add_argument("--host", help="socketcand: host of the server")
    parser.add_argument(
        "--port", type=whole(0, 65535), metavar="N", help="socketcand: TCP port of the server"
    )


def _add_bus_names(parser: argparse.ArgumentParser) -> None:
    """Add the names of python-can's options while it is missing, so that any other option is
    reported as unknown.
    """
    missing = f"python-can is missing: {dependencies.hint(['can'], 'can')}"
    group = parser.add_argument_group("bus arguments", missing)
    for key, flag in FLAGS.items():
        words = dict.fromkeys((flag, "--" + key.replace("_", "-")))
        if key == "fd":
            group.add_argument(*words, action="store_true", default=argparse.SUPPRESS)
        elif key not in ("host", "port"):
            many = "+" if key in ("timing", "bus_kwargs") else None
            group.add_argument(*words, dest=key, nargs=many, default=argparse.SUPPRESS)
