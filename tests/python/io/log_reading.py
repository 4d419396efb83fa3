# SPDX-License-Identifier: MIT
"""Run `dahl` in this process: its output, its figures, and the log that `dahl identify` passes to
estimate.identify(), without a fit, or the one line of its error.
"""

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
    """Run `dahl WORDS`; its tables are 250 columns wide."""
    out, err = io.StringIO(), io.StringIO()
    wide = mock.patch.dict("os.environ", COLUMNS="250")
    with wide, contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            code = main([str(word) for word in words])
        except SystemExit as end:  # from argparse
            code = end.code
    return subprocess.CompletedProcess(words, code, out.getvalue(), err.getvalue())


@contextlib.contextmanager
def drawing(rendered: bool = True) -> Iterator[list[Figure]]:
    """Collect the figures that matplotlib saves; if not `rendered`, their files are empty."""
    drawn: list[Figure] = []
    save = Figure.savefig

    def keep(figure: Figure, path: Path, **how: object) -> None:
        drawn.append(figure)
        save(figure, path, **how) if rendered else path.touch()

    with mock.patch.object(Figure, "savefig", keep):
        yield drawn


class Handed(BaseException):
    """End the command before the fit; no `except Exception` catches it."""

    def __init__(self, log: Log, options: Options) -> None:
        self.log, self.options = log, options


def hand_over(logs: list[Log], options: Options) -> None:
    raise Handed(logs[0], options)


class RefusedError(Exception):
    """The line of the error."""


def read(*words: object) -> Log:
    return handed(*words).log


def asked(*words: object) -> Options:
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
    try:
        read(*words)
    except RefusedError as error:
        return str(error)
    raise AssertionError(f"not refused: {words}")


def signals(folder: Path, *more: object, dbc: str = DBC) -> tuple[object, ...]:
    """Return the options to read frames of log_writers, with a DBC in this folder."""
    path = folder / "bus.dbc"
    path.write_text(dbc, encoding="cp1252")
    return ("--dbc", path, "--angle", "Angle", "--torque", "Torque", *more)
