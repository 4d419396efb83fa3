# SPDX-License-Identifier: MIT
"""The command `dahl`: each sub-command is a module of dahl.commands; each error is one line
`error: ...`.

Exit codes: 0 success; 1 a failed run (lost bus, program not built); 2 bad input; 130 ended by
Ctrl-C, after one line, with complete files. Without a command it prints the help and exits with 2.
"""

from __future__ import annotations

import argparse
import inspect
import io
import logging
import os
import sys
from collections.abc import Callable, Iterator
from typing import Any, NoReturn, TextIO

from dahl import dependencies, interrupt, paths
from dahl.commands import (
    commission,
    complete,
    data,
    dbc,
    demo,
    excite,
    fmu,
    identify,
    loop,
    monitor,
    node,
    plan,
    plot,
    record,
    report,
)
from dahl.errors import Error, RunError, nearest, printable
from dahl.version import __version__


class Parser(argparse.ArgumentParser):
    """A parser that prints an error in one line and refers to --help. `fill` adds the arguments
    only when they are needed: bus arguments import python-can, and `dahl --help` must be quick.
    """

    def __init__(self, *args: Any, fill: Callable[[Parser], None] | None = None, **kwargs: Any):
        super().__init__(*args, **kwargs)
        self._fill = fill
        self._words: list[str] = []

    def fill(self) -> None:
        """Add the arguments, once."""
        fill, self._fill = self._fill, None
        if fill is not None:
            fill(self)

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        self.fill()
        self._words = list(args or [])
        return super().parse_known_args(args, namespace)

    def error(self, message: str) -> NoReturn:
        pairs = ((word, nearest(word, known, 0.7)) for word, known in self._unknown_words())
        message += "".join(f"; {word}: did you mean {near}?" for word, near in pairs if near)
        self.exit(2, f"error: {printable(message)} (see {self.prog} --help)\n")

    def _unknown_words(self) -> Iterator[tuple[str, list[str]]]:
        """Yield each long option that this parser does not know, also with a single dash, and a
        command that does not exist, each with the known ones. Another error, such as a missing
        option, may be due to it.
        """
        options = list(self._option_string_actions)
        for word in self._words[: (*self._words, "--").index("--")]:
            if self._subparsers is not None and not word.startswith("-"):
                if word not in COMMANDS:
                    yield word, list(COMMANDS)
                return  # the following options are those of the command
            name = word.partition("=")[0]
            is_long = name.startswith("-") and len(name) > 2
            if is_long and not any(one.startswith(name) for one in options):
                yield name, [one for one in options if one.startswith("--")]

    def exit(self, status: int = 0, message: str | None = None) -> NoReturn:
        sys.stdout.flush()  # a closed pipe or a full disk must be an error here
        super().exit(status, message)

    def _print_message(self, message: str, file: Any = None) -> None:
        """Write the message as argparse does, but raise an error if that fails."""
        (file or sys.stderr).write(message or "")


COMMANDS = {
    "demo": demo,
    "loop": loop,
    "identify": identify,
    "commission": commission,
    "excite": excite,
    "plan": plan,
    "fmu": fmu,
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
    """Return the parser with all sub-commands."""
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
            description=_with_output_folder(inspect.cleandoc(module.__doc__ or "")),
            epilog=_with_output_folder(module.EXAMPLE),
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        sub.set_defaults(run=module.run, parser=parser, command_parser=sub)
    return parser


def _with_output_folder(text: str) -> str:
    """Return the text with the folder of outputs that an installed package uses."""
    return text.replace(" build/", f" {paths.OUTPUT}/") if paths.INSTALLED else text


def main(argv: list[str] | None = None) -> int:
    """Run one command and return its exit code, also if Ctrl-C ends it."""
    return interrupt.run_guarded(lambda: _run(argv))


def _run(argv: list[str] | None) -> int:
    _open_streams()
    try:
        code = _run_command(sys.argv[1:] if argv is None else argv, is_only_command=argv is None)
        sys.stdout.flush()  # report a full disk while that is still possible
        return code
    except Error as error:
        return _print_error(error, 1 if isinstance(error, RunError) else 2)
    except BrokenPipeError:  # the reader of the output closed the pipe (| head)
        _discard(sys.stdout)
        return 0
    except OSError as error:  # a file that cannot be written; without a name it is the output
        if error.filename is None and error.errno is None:
            raise
        if error.filename is None:
            _discard(sys.stdout)
        return _print_error(Error(f"{error.filename or 'output'}: {error.strerror or error}"), 1)
    except MemoryError:
        return _print_error("not enough memory", 1)


def _run_command(words: list[str], is_only_command: bool) -> int:
    command = next((word for word in words if word in COMMANDS), "")
    if is_only_command:
        dependencies.block_mf4_import(command, words)
    if not words:
        print(build_parser().format_help(), end="", file=sys.stderr)
        return 2
    try:
        args, unknown = build_parser().parse_known_args(words)
        if unknown:
            args.command_parser.error(f"unrecognized arguments: {' '.join(unknown)}")
        args.words = words
        dependencies.require(args.command)
        # a command prints its own errors
        logging.getLogger("can").setLevel(logging.ERROR)
        return int(args.run(args) or 0)
    except ModuleNotFoundError as error:
        if not dependencies.is_lacking(command, error.name):
            raise
        raise dependencies.refusal(command, str(error.name)) from None


def _open_streams() -> None:
    """Let stdout and stderr print any text on any terminal, even if the caller closed them."""
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None:
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))  # noqa: SIM115
        elif isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")


def _discard(stream: TextIO) -> None:
    """Discard further output of a stream, also at the end of the program."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


def _print_error(error: object, code: int) -> int:
    if interrupt.is_asked():  # an interrupted run may fail in any way
        return code
    try:
        print(f"error: {error}", file=sys.stderr, flush=True)
    except OSError:  # stderr is closed too
        _discard(sys.stderr)
    return code
