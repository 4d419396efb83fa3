# SPDX-License-Identifier: MIT
"""Read logs of CAN frames by python-can. An error names the file, and the line of a text.

A line that is no line of a candump log is left out and named in a note. Times in which each frame
has the time since the frame before are refused, unless an ASC log says that it has such times.
"""

from __future__ import annotations

import contextlib
import gc
import io
import re
import sys
import traceback
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, TextIO, TypeVar, cast

from dahl.errors import Error, InputError, printable
from dahl.io import candump, files

if TYPE_CHECKING:
    import can

T = TypeVar("T")
CAN_LOGS = (".asc", ".blf", ".log", ".mf4", ".trc")  # endings that python-can reads and writes
BACKWARD_PART = 1 / 8  # of the frames; with more, times are differences (buses reorder few frames)
DELTA_TIME = re.compile(r"\s*\(0\d\d\.")  # begins a line of candump -td or -tz; else 10 digits
ASC_HEADER = re.compile(r"date\s|base\s|//|(no\s+)?internal\s+events", re.IGNORECASE)
ASC_RELATIVE = re.compile(r"base\s+(hex|dec)\s+timestamps\s+relative", re.IGNORECASE)
ASC_FD, ASC_REMOTE = 0x1000, 0x10  # flags of a CANFD line
ASC_TIME = re.compile(r"\s*(-?\d+\.\d+)(\s.*)", re.DOTALL)


class _Clock:
    """Counts the times that go back, to find times that are differences to the frame before."""

    def __init__(self) -> None:
        self.frames, self._back, self._place, self._last = 0, 0, "", 0.0

    def feed(self, time: float, place: str, is_delta: bool = False) -> None:
        """Count a frame. `is_delta`: its time looks like a difference, so it must go forward."""
        if self.frames and (time < self._last or (is_delta and time == self._last)):
            self._back += 1
            self._place = self._place or place
        self.frames, self._last = self.frames + 1, time

    def check(self) -> None:
        """Raise dahl.Error, with the first place, if too many times go back."""
        if self._back > BACKWARD_PART * self.frames:
            raise InputError(
                f"{self._place}: the time goes back here and in {self._back} of {self.frames}"
                " frames: is each the time since the frame before (candump -td)?"
                " Record again with absolute times (candump -L)"
            )


def read_candump(path: Path | str) -> list[can.Message]:
    """Read all frames of a candump log (`(seconds) bus id#data`). Raises dahl.Error, also for a
    line that is none.
    """
    notes: list[str] = []
    messages = list(frames_of(Path(path), notes))
    if notes:
        raise InputError(notes[0])
    return messages


def _candump_frames(path: Path, notes: list[str], clock: _Clock) -> Iterator[can.Message]:
    bad, first = 0, ""
    with files.open_text(path) as text:
        for number, line in enumerate(text, 1):
            message = candump.message_of(line)
            if message is not None:
                clock.feed(message.timestamp, f"{path}:{number}", bool(DELTA_TIME.match(line)))
                yield message
            elif line.strip():
                bad += 1
                first = first or f"{path}:{number}: not a line of a candump log ('{_shown(line)}')"
    if bad:
        note = f"{first}; bad lines: {bad} of {bad + clock.frames}"
        if bad > clock.frames:
            raise InputError(note)
        notes.append(f"{note}, left out")


def _shown(line: str) -> str:
    return printable(line.strip()[:60])


class _AscLines:
    """The lines of an ASC log, prepared for python-can. It would read relative times as absolute
    ones, and skip lines with a negative time. Without `Begin Triggerblock` it would skip the first
    frame.
    """

    def __init__(self, text: TextIO) -> None:
        self.number, self.line, self.time = 0, "", 0.0  # the time in s
        self._text, self._lines = text, self._prepared(text)

    def __iter__(self) -> Iterator[str]:
        return self._lines

    def close(self) -> None:
        self._text.close()

    def _prepared(self, text: TextIO) -> Iterator[str]:
        is_header, is_relative = True, False
        for self.number, line in enumerate(text, 1):
            if not line.strip():
                continue
            if is_header and not ASC_HEADER.match(line.lstrip()):
                is_header = False
                yield "internal events logged\n"  # ends the header
            is_relative = is_relative or ASC_RELATIVE.match(line.lstrip()) is not None
            self.line, timed = line, ASC_TIME.match(line)
            if timed:
                self.time = float(timed[1]) + (self.time if is_relative else 0.0)
            yield f"0.0{timed[2]}" if timed else line.lower() if is_header else line


def _set_kind(message: can.Message, words: list[str]) -> None:
    """Set the kind of a frame of a CANFD line by its flags, if it has them: log2asc -f and Vector's
    programs write classic frames too. python-can takes each for CAN FD, without data for remote.
    """
    try:
        brs = 5 if words[5].isdigit() else 6  # after time, CANFD, channel, direction, id and name
        flags = int(words[brs + 6 + int(words[brs + 3])], 16)
    except (IndexError, ValueError):  # an old line, or an error frame
        flags = 0 if message.is_error_frame else ASC_FD
    message.is_fd, message.is_remote_frame = bool(flags & ASC_FD), bool(flags & ASC_REMOTE)


def _need_all_bytes(message: can.Message) -> None:
    """Raise ValueError for a frame of a line that is cut off within its bytes."""
    wanted = message.dlc if message.is_fd else min(message.dlc, candump.MAX_DLC)
    if len(message.data) < wanted and not (message.is_remote_frame or message.is_error_frame):
        raise ValueError(f"{len(message.data)} of {wanted} bytes")


def _asc_frames(path: Path, clock: _Clock) -> Iterator[can.Message]:
    import can

    lines = _AscLines(files.open_text(path))
    try:
        with can.ASCReader(cast("TextIO", lines)) as reader:
            for message in reader:
                message.timestamp = lines.time
                if message.is_fd:
                    _set_kind(message, lines.line.split())
                _need_all_bytes(message)
                clock.feed(message.timestamp, f"{path}:{lines.number}")
                yield message
    except ValueError as error:
        raise InputError(f"line {lines.number}: {error}") from None


@contextlib.contextmanager
def discard_broken_readers() -> Iterator[None]:
    """On an error, collect asammdf's reader of a broken MF4 quietly, since it cannot be closed."""
    hook = sys.unraisablehook
    try:
        yield
    except BaseException as error:
        sys.unraisablehook = lambda _: None
        traceback.clear_frames(error.__traceback__)
        gc.collect()
        raise
    finally:
        sys.unraisablehook = hook


def mf4_in_memory(path: Path) -> io.BytesIO:
    """Return the content of an MF4. From a path, asammdf copies an unfinished file to the disk."""
    return io.BytesIO(path.read_bytes())


def _reader_of(path: Path) -> can.io.generic.MessageReader:
    import can

    is_mf4 = path.suffix.lower() == ".mf4"
    return can.MF4Reader(mf4_in_memory(path)) if is_mf4 else can.LogReader(path)


def _binary_frames(path: Path, clock: _Clock) -> Iterator[can.Message]:
    with discard_broken_readers(), _reader_of(path) as reader:
        for message in reader:
            clock.frames += 1  # programs that write these files have absolute times
            yield message
        if getattr(reader, "file_size", 0) > path.stat().st_size:  # a BLF has its length
            raise InputError("the file is shorter than it says")


def with_notes(notes: Sequence[str], work: Callable[[], T]) -> T:
    """Return work(). If it fails, the notes of frames_of() are part of the error."""
    try:
        return work()
    except Error as error:
        raise InputError("; ".join([*notes, str(error)])) from None


def frames_of(path: Path, notes: list[str]) -> Iterator[can.Message]:
    """Yield the frames of a log, and note lines of a candump log that are left out. Raises
    dahl.Error if it is cut off or not what its ending says.
    """
    ending, clock = path.suffix.lower(), _Clock()
    if ending not in CAN_LOGS:
        raise InputError(
            f"{path}: no log of frames by its ending; {', '.join(CAN_LOGS)} was expected"
        )
    if ending == ".log":
        yield from _candump_frames(path, notes, clock)
    else:
        frames = _asc_frames(path, clock) if ending == ".asc" else _binary_frames(path, clock)
        try:
            yield from frames
        except Exception as error:  # each reader of python-can raises its own kinds
            words = files.one_line(error, 120)
            place = f"broken or cut off after {clock.frames} frames"
            raise InputError(f"{path}: {place} ({words})") from None
    clock.check()
    if clock.frames == 0:
        raise InputError(f"{path}: no frames in it")
