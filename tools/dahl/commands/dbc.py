# SPDX-License-Identifier: MIT
"""Write the bus description (DBC) of a bus with N friction nodes.

Node 0 has the names of dahl.dbc; node n has the same frames at id + n, and its number behind each
name: FrictionTorque_3. Counter and CRC are the same for all nodes.
"""

from __future__ import annotations

import argparse
import copy
from pathlib import Path
from typing import TYPE_CHECKING

from dahl.commands.arguments import whole
from dahl.errors import InputError
from dahl.io import files

if TYPE_CHECKING:
    from cantools.database.can import Message, Node

HELP = "bus description for N nodes"
EXAMPLE = "example: dahl dbc --nodes 4 -o four.dbc"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--nodes", type=whole(1, 16), default=1, metavar="N", help="how many, numbered from 0"
    )
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        metavar="FILE",
        help="file to write (default, and -: standard output)",
    )
    parser.add_argument("--force", action="store_true", help="overwrite an existing file")


def run(args: argparse.Namespace) -> None:
    output = None if args.output == Path("-") else args.output
    if output and output.is_file() and not args.force:
        raise InputError(f"{output}: exists; --force overwrites it")
    text = describe(args.nodes)
    if output:
        files.write_atomic(output, text)
    else:
        print(text, end="")


def describe(nodes: int) -> str:
    """Return a DBC with the frames of nodes 0 to nodes - 1."""
    from cantools.database.can import Database
    from cantools.database.utils import sort_signals_by_start_bit

    from dahl.report.traces import database

    one = database()
    every = Database(
        [_message_of(message, number) for number in range(nodes) for message in one.messages],
        [_node_of(node, number) for number in range(nodes) for node in one.nodes],
        version=one.version,
        dbc_specifics=one.dbc,
    )
    return every.as_dbc_string(sort_signals=sort_signals_by_start_bit).replace("\r\n", "\n")


def _named(name: str, number: int) -> str:
    return f"{name}_{number}" if number else name


def _node_of(node: Node, number: int) -> Node:
    mine = copy.deepcopy(node)
    mine.name = _named(node.name, number)
    return mine


def _message_of(message: Message, number: int) -> Message:
    mine = copy.deepcopy(message)
    mine.name = _named(message.name, number)
    mine.frame_id = message.frame_id + number
    mine.senders[:] = [_named(sender, number) for sender in message.senders]
    for signal in mine.signals:
        signal.receivers[:] = [_named(receiver, number) for receiver in signal.receivers]
    return mine
