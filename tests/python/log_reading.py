# SPDX-License-Identifier: MIT
"""`dahl` in this process: what a verb says and leaves, what it draws, and what `dahl identify`
reads of a file, by its options: the log that it hands to estimate.identify(), where nothing is
fitted, or the one line with which it refuses.
"""

from __future__ import annotations

import contextlib
import io
import re
import subprocess
from collections.abc import Iterator
from pathlib import Path
from unittest import mock

from dahl.cli import main
from dahl.identify import Log, Options, estimate
from log_writers import DBC
from matplotlib.figure import Figure


def run(*words: object) -> subprocess.CompletedProcess:
    """`dahl WORDS`, as a finished process with its text; its tables are 250 columns wide."""
    out, err = io.StringIO(), io.StringIO()
    wide = mock.patch.dict("os.environ", COLUMNS="250")
    with wide, contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            code = main([str(word) for word in words])
        except SystemExit as end:  # argparse's way
            code = end.code
    return subprocess.CompletedProcess(words, code, out.getvalue(), err.getvalue())


@contextlib.contextmanager
def drawing(rendered: bool = True) -> Iterator[list[Figure]]:
    """The figures that matplotlib saves meanwhile, whoever draws them; not `rendered` they are
    empty files, for tests of what is in them.
    """
    drawn: list[Figure] = []
    save = Figure.savefig

    def keep(figure: Figure, path: Path, **how: object) -> None:
        drawn.append(figure)
        save(figure, path, **how) if rendered else path.touch()

    with mock.patch.object(Figure, "savefig", keep):
        yield drawn


class Handed(BaseException):
    """Ends the command where the fit would begin; no `except Exception` takes it for a fault."""

    def __init__(self, log: Log, options: Options) -> None:
        self.log, self.options = log, options


def hand_over(logs: list[Log], options: Options) -> None:
    raise Handed(logs[0], options)


class RefusedError(Exception):
    """The line that was said."""


def read(*words: object) -> Log:
    """The log of `dahl identify WORDS`. Raises RefusedError with the one line of complaint."""
    return handed(*words).log


def asked(*words: object) -> Options:
    """What the fit of `dahl identify WORDS` is asked for."""
    return handed(*words).options


def handed(*words: object) -> Handed:
    with mock.patch.object(estimate, "identify", hand_over):
        try:
            done = run("identify", *words, "--no-files")
        except Handed as found:
            return found
    assert (done.returncode, done.stdout) == (2, ""), done
    found = re.fullmatch(r"error: ([^\r\n]+)\n", done.stderr)
    assert found, repr(done.stderr)
    raise RefusedError(found[1])


def refused(*words: object) -> str:
    """The line with which `dahl identify WORDS` ends."""
    try:
        read(*words)
    except RefusedError as error:
        return str(error)
    raise AssertionError(f"taken: {words}")


def signals(folder: Path, *more: object, dbc: str = DBC) -> tuple[object, ...]:
    """The options with which frames of log_writers are read, the DBC in this folder."""
    path = folder / "bus.dbc"
    path.write_text(dbc, encoding="cp1252")
    return ("--dbc", path, "--angle", "Angle", "--torque", "Torque", *more)
