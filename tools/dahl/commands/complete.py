# SPDX-License-Identifier: MIT
"""Print a script that completes commands, options and their values in a shell."""

from __future__ import annotations

import argparse
import contextlib

HELP = "completion for bash and zsh"
EXAMPLE = """examples:
  source <(dahl complete)       # bash, in ~/.bashrc
  eval "$(dahl complete zsh)"   # zsh, in ~/.zshrc after compinit"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "shell",
        nargs="?",
        choices=("bash", "zsh"),
        default="bash",
        help="shell that reads the script (default: bash)",
    )


def run(args: argparse.Namespace) -> None:
    import shtab

    _fill_all(args.parser)
    print(shtab.complete(args.parser, shell=args.shell))


def _fill_all(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of each command, with scenes, choices or files as their values."""
    import shtab

    from dahl import paths
    from dahl.report import simulated

    scenes = sorted(path.stem for path in paths.SCENES.glob("*.ini"))
    (commands,) = (one for one in parser._actions if isinstance(one, argparse._SubParsersAction))
    for name, command in commands.choices.items():
        with contextlib.suppress(ModuleNotFoundError):  # options of a bus, without python-can
            command.fill()
        for action in command._actions:
            if action.dest == "scene":
                action.choices = scenes + [*simulated.SCENES] * (name == "demo")
            if action.nargs != 0 and not action.choices:
                action.complete = shtab.FILE
