# SPDX-License-Identifier: MIT
"""
Record a bus into a log: candump (.log, which canplayer can replay), ASC, BLF, TRC or MF4, by the
ending of its name.

Works with any interface that python-can has. Ends with Ctrl-C, or after --frames or --seconds. A
.log, .asc or .trc holds whole lines at any moment; .blf and .mf4 are whole once it has ended. A
.trc holds no CAN FD, remote or error frames: they are left out, and how many is said at the end.
"""

from __future__ import annotations

import argparse
import errno
import io
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from dahl import Error, RunError
from dahl.arguments import add_limits
from dahl.bus import add_bus_arguments

if TYPE_CHECKING:
    import can

HELP = "record any python-can bus into a log"
EXAMPLE = """examples:
  dahl record -i socketcan -c vcan0 -o run.log --seconds 10
  dahl record -i socketcan -c can0 --fd -o run.blf
  dahl record -i socketcand -c vcan0 --host 127.0.0.1 --port 29536 -o run.log"""

FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)  # of a file, never of a bus
TRC = ".trc"  # the one format that cannot hold every frame
PATIENCE = 3.0  # s without a frame, after which one waits knowingly


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        required=True,
        metavar="RUN",
        help="file: RUN.log, RUN.blf, ...",
    )
    parser.add_argument("--force", action="store_true", help="overwrite a file that is there")
    add_limits(parser)
    add_bus_arguments(parser)


def run(args: argparse.Namespace) -> None:
    from dahl.bus import open_from, received, silent
    from dahl.interrupt import Stop

    existed = _check(args.output, args.force, bool(getattr(args, "fd", False)))
    held = Held(args.output)
    begin = time.monotonic()
    try:
        with open_from(args) as bus, Stop() as stop:
            args.output.open("ab").close()  # it can be written
            messages = received(bus, stop, args.seconds, args.frames)
            frames = _write(args.output, held.among(messages))
    finally:
        if not existed and args.output.exists() and args.output.stat().st_size == 0:
            args.output.unlink()
    if frames == 0 and held.left_out:
        raise RunError(f"{args.output}: {held.told()}")
    if frames == 0:
        raise silent(args, time.monotonic() - begin)
    print(f"{frames} frames in {args.output}")
    if held.left_out:
        print(held.told())


class Held:
    """Takes out the frames that the format of a log cannot hold, and counts them: python-can's
    writer of TRC would drop them with no more than a warning.
    """

    def __init__(self, path: Path) -> None:
        self.left_out, self._is_trc = 0, path.suffix.lower() == TRC

    def among(self, messages: Iterator[can.Message | None]) -> Iterator[can.Message | None]:
        """The messages without those frames."""
        for message in messages:
            if message is not None and self._is_trc and _is_special(message):
                self.left_out += 1
            else:
                yield message

    def told(self) -> str:
        """How many were left out, and what holds them."""
        return f"{self.left_out} frames that {TRC} cannot hold were left out; .blf holds them"


def _is_special(message: can.Message) -> bool:
    return message.is_fd or message.is_remote_frame or message.is_error_frame


def _check(path: Path, force: bool, fd: bool) -> bool:
    """Whether the file is there. Raises dahl.Error for one that is not to be written."""
    from dahl.logs import CAN_LOGS

    if path.suffix.lower() not in CAN_LOGS:
        raise Error(f"{path}: {', '.join(CAN_LOGS)} was expected as its ending")
    if fd and path.suffix.lower() == TRC:
        raise Error(f"{path}: {TRC} holds no CAN FD frames, so it does not go with --fd; .blf does")
    if path.exists() and not force:
        raise Error(f"{path}: there already; --force overwrites it")
    return path.exists()


def _write(path: Path, messages: Iterator[can.Message | None]) -> int:
    """Write each frame; what was there before goes with the first one. Returns how many."""
    first = _first(messages)
    if first is None:
        return 0
    frames = 1
    try:
        with _writer(path) as writer:
            writer.on_message_received(first)
            for message in messages:
                if message is not None:
                    writer.on_message_received(message)
                    frames += 1
    except OSError as error:
        if error.errno in FULL and error.filename is None:
            error.filename = str(path)
        raise
    return frames


def _first(messages: Iterator[can.Message | None]) -> can.Message | None:
    """The first frame, None where none comes; says so while it waits."""
    until = time.monotonic() + PATIENCE
    for message in messages:
        if message is not None:
            return message
        if time.monotonic() > until:
            print("no frame so far, still waiting; Ctrl-C ends", file=sys.stderr, flush=True)
            until = float("inf")
    return None


def _writer(path: Path) -> can.io.generic.MessageWriter:
    import can

    writer = can.Logger(path)
    file = getattr(writer, "file", None)
    if isinstance(file, io.TextIOWrapper):
        file.reconfigure(line_buffering=True)
    return writer
