# SPDX-License-Identifier: MIT
"""Read JSON that may hold anything, and write files that are either whole or absent."""

from __future__ import annotations

import contextlib
import errno
import io
import json
import os
import re
import shutil
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, TextIO

from dahl.errors import InputError, RunError

# First bytes of the scenes and tables that dahl writes.
OURS = re.compile(
    rb"; written by dahl |time_s,(theta,counts|angle_rad,speed_rad_s,acceleration_rad_s2)\r?\n"
    rb"|theta_(rad|m),torque_Nm?(,load)?\r?\n"
)

FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)  # errors of a file; a bus never raises them
MAX_LINE_BYTES = 4096  # longer than any line of a frame log


@contextlib.contextmanager
def whole_lines(path: Path, file: object) -> Iterator[None]:
    """Keep whole lines in a log: if the disk is full, name the log in the error and remove a half
    line from a text file. An MF4 is written when it is closed, so the error says that it is lost.
    """
    try:
        yield
    except OSError as error:
        if error.errno in FULL and error.filename is None:
            error.filename = str(path)
            if path.suffix.lower() == ".mf4":
                error.strerror = f"{error.strerror}; an MF4 is written at its close: all is lost"
            if isinstance(file, io.IOBase):
                with contextlib.suppress(OSError):
                    file.close()  # else the rest may still be written
            if isinstance(file, io.TextIOBase) and path.is_file():
                _cut_half_line(path)
        raise


def _cut_half_line(path: Path) -> None:
    with path.open("rb+") as log:
        begin = max(path.stat().st_size - MAX_LINE_BYTES, 0)
        log.seek(begin)
        log.truncate(begin + log.read().rfind(b"\n") + 1)


def refuse_foreign_files(paths: Iterable[Path], hint: str) -> None:
    """Raise dahl.Error if one of these files exists and dahl did not write it; `hint` is the advice
    in the message.
    """
    for path in paths:
        if path.is_file() and not _is_ours(path):
            raise InputError(f"{path}: exists, and dahl did not write it; {hint}")


def _is_ours(path: Path) -> bool:
    try:
        with path.open("rb") as file:
            return OURS.match(file.read(80)) is not None
    except OSError as error:
        raise InputError(f"{path}: {error.strerror}") from None


def read_text(path: Path, hint: str = "") -> str:
    """Return the text of a file. Raises dahl.Error; `hint` names the origin of the file."""
    try:
        return path.read_text(encoding="utf-8-sig")
    except FileNotFoundError:
        raise InputError(f"{path}: no such file{hint}") from None
    except OSError as error:
        raise InputError(f"{path}: {error.strerror}") from None
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: not a text file (byte {error.start})") from None


def open_text(path: Path) -> TextIO:
    """Open a text file whose bytes may be damaged. Raises dahl.Error."""
    try:
        return path.open(encoding="utf-8-sig", errors="replace")
    except OSError as error:
        raise InputError(f"{path}: {error.strerror}") from None


def read_json(path: Path, hint: str = "") -> Any:
    """Return the content of a JSON file. Raises dahl.Error; `hint` as in read_text()."""
    text = read_text(path, hint)
    try:
        return json.loads(text)
    except json.JSONDecodeError as error:
        raise InputError(f"{path}:{error.lineno}: not JSON, or cut off ({error.msg})") from None
    except (ValueError, RecursionError) as error:  # a number of 5000 digits, lists in lists
        raise InputError(f"{path}: not JSON that can be read ({error})") from None


def one_line(error: Exception, most: int = 160) -> str:
    """Return the message of another library's error in one line."""
    return " ".join(str(error).split())[:most] or type(error).__name__


@contextlib.contextmanager
def replace_atomic(path: Path) -> Iterator[Path]:
    """Yield a temporary path that replaces the file at the end, with its mode. On an error the old
    file stays. A device or a pipe is written directly. Raises dahl.RunError.
    """
    try:
        if path.is_dir():
            raise InputError(f"{path}: a folder; the name of a file was expected")
        if path.exists() and not path.is_file():
            yield path
            return
        with contextlib.suppress(FileNotFoundError):
            path.stat()  # a loop of links is an error here, not a missing file
        part = path.resolve().with_name(f".{os.getpid()}.part")
        try:
            yield part
            if path.exists():
                shutil.copymode(path, part)
            part.replace(path.resolve())
        finally:
            part.unlink(missing_ok=True)
    except OSError as error:
        raise RunError(f"{path}: {error.strerror or error}") from None


def write_atomic(path: Path, text: str) -> None:
    """Write a text file; the old file stays until the new one is complete."""
    with replace_atomic(path) as part:
        part.write_text(text, encoding="utf-8", errors="replace")
