# SPDX-License-Identifier: MIT
"""Record a bus into a log: candump (.log, which canplayer can replay), ASC, BLF, TRC or MF4, by the
ending of its name.

Stop it with Ctrl-C, or give --frames or --seconds. A .log, .asc or .trc holds whole lines at any
moment; .blf and .mf4 are whole once it has ended. A .trc cannot hold CAN FD, remote or error
frames, and a .asc holds an error frame without its class and data; their number is printed at the
end. If the disk is full, it prints how many frames the log holds and exits with 1.

If the log lacks frames of a friction node, because this program read too slowly, it prints how many
and exits with 1. They are counted by the 4-bit sequence counters of EncoderState, FrictionTorque
and Status; with SocketCAN also by the kernel. "3 to 1987" means 3 by the counters and 1987 by the
time stamps. A gap of 16, 32, ... frames looks like a pause of the sender and is not counted. A
sender counts as a node after four good frames in a row: CRC right, most counters one higher.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import sys
import time
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from dahl.commands.arguments import add_limits
from dahl.commands.bus_arguments import add_bus_arguments
from dahl.errors import Error, InputError, RunError
from dahl.io import candump
from dahl.io.can_logs import CAN_LOGS, frames_of
from dahl.io.files import FULL, whole_lines

if TYPE_CHECKING:
    import can

HELP = "record a python-can bus into a log"
EXAMPLE = """examples:
  dahl record -i socketcan -c vcan0 -o run.log --seconds 10
  dahl record -i socketcan -c can0 --fd -o run.blf
  dahl record -i socketcand -c vcan0 --host 127.0.0.1 --port 29536 -o run.log"""

TRC, ASC = ".trc", ".asc"  # formats that cannot hold every frame
LOG, BLF, MF4 = ".log", ".blf", ".mf4"
SILENCE_NOTICE_S = 3.0  # without a frame; then a line reports that it waits


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        required=True,
        metavar="RUN",
        help="file: RUN.log, RUN.blf, ...",
    )
    parser.add_argument("--force", action="store_true", help="overwrite an existing file")
    add_limits(parser)
    add_bus_arguments(parser)


def run(args: argparse.Namespace) -> None:
    from dahl.can.bus import Reception, lost_in_kernel, open_from, silent
    from dahl.interrupt import Stop

    existed = _check(args.output, args.force, bool(getattr(args, "fd", False)))
    tally, gone = Tally(args.output), ""
    begin = time.monotonic()
    try:
        with open_from(args) as bus, Stop(is_its_end=True) as stop:
            args.output.open("ab").close()  # raises if it cannot be written
            messages = Reception(bus, stop, args.seconds, args.frames)
            try:
                _write(args.output, tally.storable(messages))
            except RunError as error:
                gone = str(error)
            except OSError as error:
                raise _add_held_frames(error, tally) from None
            tally.lost_in_kernel = lost_in_kernel(bus)
    finally:
        if not existed and args.output.exists() and args.output.stat().st_size == 0:
            args.output.unlink()
    if tally.frames == 0 and not tally.left_out and not gone:
        raise silent(args, time.monotonic() - begin)
    tally.report(gone)


def _add_held_frames(error: OSError, tally: Tally) -> OSError:
    """Return the error of a full disk with the number of frames that the log holds."""
    if error.errno in FULL:
        error.strerror = f"{error.strerror}; {tally.held()} frames are in it"
    return error


class Tally:
    """Count the frames that a log holds and those that it lacks.

    Frames that the format cannot hold are left out here: python-can's writer of TRC would drop them
    with no more than a warning.
    """

    def __init__(self, path: Path) -> None:
        from dahl.can.missing import Missing

        self.frames = self.left_out = self.reduced = self.lost_in_kernel = 0
        self._path, self._ending = path, path.suffix.lower()
        self._missing = Missing()

    def storable(self, messages: Iterable[can.Message | None]) -> Iterator[can.Message | None]:
        """Yield the messages that the log can hold; each counts once the next one is requested."""
        for message in messages:
            if message is None:
                yield None
            elif self._ending == TRC and _is_special(message):
                self.left_out += 1
            else:
                self._missing.feed(message)
                yield message
                self.frames += 1
                self.reduced += self._ending == ASC and message.is_error_frame

    def held(self) -> int:
        """Return how many frames the log holds after a write has failed: a BLF is read again, and
        an MF4 is written when it is closed.
        """
        if self._ending != BLF:
            return 0 if self._ending == MF4 else self.frames
        count = 0
        with contextlib.suppress(Error):
            for _ in frames_of(self._path, []):
                count += 1
        return count

    def report(self, gone: str) -> None:
        """Print the counts. Raises RunError if frames are missing or the bus has gone."""
        special = f"{self.left_out} frames that {TRC} cannot hold were left out; .blf holds them"
        gap = self._missing.count().at_least(self.lost_in_kernel)
        wrong = [f"{self._path}: {gap} frames are missing"] * (gap.most > 0) + [gone] * bool(gone)
        if self.frames:
            print(f"{self.frames} frames in {self._path}")
        elif self.left_out:
            wrong.append(f"{self._path}: {special}")
        if self.frames and self.left_out:
            print(special)
        if self.reduced:
            print(f"{self.reduced} error frames have no class and no data in {ASC}; .blf has them")
        if wrong:
            sys.stdout.flush()  # before the error
            raise RunError("; ".join(wrong))


def _is_special(message: can.Message) -> bool:
    return message.is_fd or message.is_remote_frame or message.is_error_frame


def _check(path: Path, force: bool, fd: bool) -> bool:
    """Return whether the file exists. Raises dahl.Error if it must not be written."""
    if path.suffix.lower() not in CAN_LOGS:
        raise InputError(f"{path}: {', '.join(CAN_LOGS)} was expected as its ending")
    if fd and path.suffix.lower() == TRC:
        raise InputError(
            f"{path}: {TRC} holds no CAN FD frames, so it does not go with --fd; .blf does"
        )
    if path.exists() and not force:
        raise InputError(f"{path}: exists; --force overwrites it")
    return path.exists()


def _write(path: Path, messages: Iterator[can.Message | None]) -> None:
    """Write each frame; the first one replaces an earlier log."""
    first = _first(messages)
    if first is None:
        return
    writer = _writer(path)
    with whole_lines(path, getattr(writer, "file", None)), writer:
        writer.on_message_received(first)
        for message in messages:
            if message is not None:
                if path.suffix.lower() == ASC:  # python-can would write an earlier time as a date
                    message.timestamp = max(message.timestamp, first.timestamp)
                writer.on_message_received(message)


def _first(messages: Iterator[can.Message | None]) -> can.Message | None:
    """Return the first frame, None if the bus ends first. Print a line while it waits."""
    until = time.monotonic() + SILENCE_NOTICE_S
    for message in messages:
        if message is not None:
            return message
        if time.monotonic() > until:
            print("no frame so far, still waiting; Ctrl-C ends", file=sys.stderr, flush=True)
            until = float("inf")
    return None


def _writer(path: Path) -> can.io.generic.MessageWriter | candump.Writer:
    import can

    if path.suffix.lower() == LOG:
        return candump.Writer(path)
    writer = can.Logger(path)
    file = getattr(writer, "file", None)
    if isinstance(file, io.TextIOWrapper):
        file.reconfigure(line_buffering=True)
    return writer
