# SPDX-License-Identifier: MIT
"""
Print a script that completes commands and options of `dahl` in a shell: bash, or zsh by its
bashcompinit.
"""

from __future__ import annotations

import argparse
import contextlib
from collections.abc import Iterator

HELP = "completion for bash and zsh"
EXAMPLE = """examples:
  source <(dahl complete)                                   # bash, in ~/.bashrc
  autoload -U bashcompinit; bashcompinit; source <(dahl complete)   # zsh, in ~/.zshrc"""

SCRIPT = """_dahl() {{
    local word=${{COMP_WORDS[COMP_CWORD]}} before=${{COMP_WORDS[COMP_CWORD-1]}} words=
    if [ "$COMP_CWORD" = 1 ]; then
        words='{verbs}'
    else
        case "${{COMP_WORDS[1]}} $before" in
{values}
        *) case "$word" in -*) case "${{COMP_WORDS[1]}}" in
{options}
            esac;; esac;;
        esac
    fi
    COMPREPLY=($(compgen -W "$words" -- "$word"))
}}
complete -o default -F _dahl dahl
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add no arguments."""


def run(args: argparse.Namespace) -> None:
    from dahl import paths

    verbs = dict(_verbs(args.parser))
    scenes = sorted(path.stem for path in paths.SCENES.glob("*.ini"))
    values, options = [], []
    for verb, actions in verbs.items():
        for action in actions:
            known = scenes if action.dest == "scene" else action.choices or ()
            choices = [str(choice) for choice in known]
            if choices and action.option_strings:
                cases = "|".join(f"'{verb} {option}'" for option in action.option_strings)
                values.append(f"        {cases}) words='{' '.join(choices)}';;")
        words = " ".join(option for action in actions for option in action.option_strings)
        options.append(f"            {verb}) words='{words}';;")
    print(
        SCRIPT.format(
            verbs=" ".join([*verbs, "--help", "--version"]),
            values="\n".join(values),
            options="\n".join(options),
        ),
        end="",
    )


def _verbs(parser: argparse.ArgumentParser) -> Iterator[tuple[str, list[argparse.Action]]]:
    """Yield each command and its options."""
    (commands,) = (one for one in parser._actions if isinstance(one, argparse._SubParsersAction))
    for verb, sub in commands.choices.items():
        fill = getattr(sub, "fill", None)
        if fill is not None:
            with contextlib.suppress(ModuleNotFoundError):  # options of a bus, without python-can
                fill()
        yield verb, sub._actions
