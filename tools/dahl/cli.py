# SPDX-License-Identifier: MIT
"""The command `dahl`: one module of dahl.commands per sub-command, one line `error: ...` for
whatever goes wrong.

Exit codes: 0 done, 1 the run failed (bus gone, program not built), 2 bad input, 130
ended by Ctrl-C, after one line and with whole files.
"""

from __future__ import annotations

import argparse
import io
import os
import sys
from collections.abc import Callable
from typing import Any, NoReturn, TextIO

from dahl import dependencies, interrupt, paths
from dahl.commands import (
    complete,
    data,
    dbc,
    demo,
    excite,
    identify,
    monitor,
    node,
    plan,
    plot,
    record,
    report,
)
from dahl.errors import Error, RunError, printable
from dahl.version import __version__


class Parser(argparse.ArgumentParser):
    """Complains in one line, as everything here does, and names where the options are told. `fill`
    adds the arguments when they are needed: those of a bus take python-can, and --help is quick.
    """

    def __init__(self, *args: Any, fill: Callable[[Parser], None] | None = None, **kwargs: Any):
        super().__init__(*args, **kwargs)
        self._fill = fill

    def fill(self) -> None:
        """Add the arguments, once."""
        fill, self._fill = self._fill, None
        if fill is not None:
            fill(self)

    def parse_known_args(self, *args: Any, **kwargs: Any) -> Any:
        self.fill()
        return super().parse_known_args(*args, **kwargs)

    def error(self, message: str) -> NoReturn:
        self.exit(2, f"error: {printable(message)} (see {self.prog} --help)\n")

    def exit(self, status: int = 0, message: str | None = None) -> NoReturn:
        sys.stdout.flush()  # of --help: its reader may have gone, or the disk be full
        super().exit(status, message)

    def _print_message(self, message: str, file: Any = None) -> None:
        """As argparse does, but what cannot be written is an error."""
        (file or sys.stderr).write(message or "")


COMMANDS = {
    "demo": demo,
    "identify": identify,
    "excite": excite,
    "plan": plan,
    "node": node,
    "monitor": monitor,
    "record": record,
    "plot": plot,
    "report": report,
    "data": data,
    "dbc": dbc,
    "complete": complete,
}


def build_parser() -> argparse.ArgumentParser:
    """All sub-commands, each with its own example."""
    parser = Parser(
        prog="dahl",
        description="Friction torque by Dahl's model, exact at every encoder tick.",
        epilog="example: dahl demo --scene steering",
    )
    parser.add_argument("--version", action="version", version=f"dahl {__version__}")
    commands = parser.add_subparsers(dest="command", metavar="COMMAND", required=True)
    for name, module in COMMANDS.items():
        sub = commands.add_parser(
            name,
            fill=module.add_arguments,
            help=module.HELP,
            description=_as_here((module.__doc__ or "").partition("\n")[2].strip()),
            epilog=_as_here(module.EXAMPLE),
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        sub.set_defaults(run=module.run, parser=parser, command_parser=sub)
    return parser


def _as_here(text: str) -> str:
    """The folder where commands leave files is another where there is no checkout."""
    return text.replace(" build/", f" {paths.OUTPUT}/") if paths.INSTALLED else text


def main(argv: list[str] | None = None) -> int:
    """Run one command; returns the exit code, also where Ctrl-C ends it."""
    return interrupt.guarded(lambda: _run(argv))


def _run(argv: list[str] | None) -> int:
    _open_streams()
    try:
        code = _run_command(sys.argv[1:] if argv is None else argv, alone=argv is None)
        sys.stdout.flush()  # here a full disk can still be told
        return code
    except Error as error:
        return _complain(error, 1 if isinstance(error, RunError) else 2)
    except BrokenPipeError:  # the reader of our output has gone (| head)
        _drop(sys.stdout)
        return 0
    except OSError as error:  # a file that cannot be written; without a name it was our output
        if error.filename is None and error.errno is None:
            raise
        if error.filename is None:
            _drop(sys.stdout)
        return _complain(Error(f"{error.filename or 'output'}: {error.strerror or error}"), 1)
    except MemoryError:
        return _complain("not enough memory", 1)


def _run_command(words: list[str], alone: bool) -> int:
    """The exit code of one command; `alone` in this program."""
    command = next((word for word in words if word in COMMANDS), "")
    if alone:
        dependencies.spare_mf4(command, words)
    try:
        args, unknown = build_parser().parse_known_args(words)
        if unknown:
            args.command_parser.error(f"unrecognized arguments: {' '.join(unknown)}")
        args.words = words
        dependencies.bring(args.command, words)
        return int(args.run(args) or 0)
    except ModuleNotFoundError as error:
        if not dependencies.is_lacking(command, error.name):
            raise
        raise dependencies.refusal(command, str(error.name)) from None


def _open_streams() -> None:
    """Output that holds any text on any terminal, also where the caller has closed it."""
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None:
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))  # noqa: SIM115
        elif isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")


def _drop(stream: TextIO) -> None:
    """Let nothing more be written to a stream, not at the end of the program either."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


def _complain(error: object, code: int) -> int:
    if interrupt.is_asked():  # what an early end made of a run is no news
        return code
    try:
        print(f"error: {error}", file=sys.stderr, flush=True)
    except OSError:  # nobody reads that either
        _drop(sys.stderr)
    return code
