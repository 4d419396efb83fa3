# SPDX-License-Identifier: MIT
"""Read logs of CAN frames by python-can. An error names the file, and the line of a candump log."""

from __future__ import annotations

import contextlib
import difflib
import gc
import io
import re
import sys
import traceback
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from dahl.errors import Error
from dahl.io import files

if TYPE_CHECKING:
    import can

MAX_LISTED_NAMES = 30  # in an error
CAN_LOGS = (".asc", ".blf", ".log", ".mf4", ".trc")  # endings that python-can reads and writes
CANDUMP_LINE = re.compile(
    r"\(\d+\.\d+\) +\S+ +([0-9A-Fa-f]{3}|[0-9A-Fa-f]{8})#"
    r"(R\d?|#[0-9A-Fa-f])?([0-9A-Fa-f]{2})*( [RT])?\s*"
)


def meant(name: str, known: Sequence[str]) -> str:
    """Return the end of an error about an unknown name: the nearest known one, and all of them."""
    lower = {word.lower(): word for word in known}
    near = difflib.get_close_matches(name.lower(), lower, n=1, cutoff=0.4)
    hint = f"; did you mean '{lower[near[0]]}'?" if near else ""
    more = len(known) - MAX_LISTED_NAMES
    shown = ", ".join(known[:MAX_LISTED_NAMES]) + (f", and {more} more" if more > 0 else "")
    return f"{hint} (there are: {shown})"


class _CheckedLines(io.StringIO):
    """Lines of a candump log for python-can, each checked and counted."""

    number = 0

    def __next__(self) -> str:  # type: ignore[override]  # typeshed declares bytes for IOBase
        line = super().__next__()
        self.number += 1
        if line.strip() and not CANDUMP_LINE.fullmatch(line):
            raise ValueError(f"'{line.strip()[:60]}'")
        return line


def read_candump(path: Path | str) -> list[can.Message]:
    """Read all frames of a candump log (`(seconds) bus id#data`). Raises dahl.Error."""
    import can

    text = _CheckedLines(files.read_text(Path(path)))
    try:
        messages = list(can.CanutilsLogReader(text))
    except (ValueError, IndexError, AssertionError) as error:
        raise Error(f"{path}:{text.number}: not a line of a candump log ({error})") from None
    if not messages:
        raise Error(f"{path}: no frames in it")
    return messages


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


def frames_of(path: Path) -> Iterator[can.Message]:
    """Yield the frames of a log. Raises dahl.Error if it is cut off or not what its ending says."""
    if path.suffix.lower() == ".log":
        yield from read_candump(path)
        return
    if path.suffix.lower() not in CAN_LOGS:
        raise Error(f"{path}: no log of frames by its ending; {', '.join(CAN_LOGS)} was expected")
    count = 0
    try:
        with discard_broken_readers(), _reader_of(path) as reader:
            for message in reader:
                count += 1
                yield message
            if getattr(reader, "file_size", 0) > path.stat().st_size:  # a BLF has its length
                raise Error("the file is shorter than it says")
    except Exception as error:  # each reader of python-can raises its own kinds
        words = files.one_line(error, 120)
        raise Error(f"{path}: broken or cut off after {count} frames ({words})") from None
    if count == 0:
        raise Error(f"{path}: no frames in it")
