# SPDX-License-Identifier: MIT
"""Print text with rich exactly as it is: names from files must not act as markup, emoji or terminal
commands.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NoReturn

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn
from rich.table import Table as RichTable
from rich.text import Text

from dahl.errors import printable
from dahl.report.simulated import Table


class PlainConsole(Console):
    """A console that prints every string as plain text, also in titles and cells of tables."""

    def render_str(self, text: str, **how: Any) -> Text:
        lines = (printable(line) for line in text.split("\n"))
        return super().render_str("\n".join(lines), **{**how, "markup": False, "emoji": False})

    def on_broken_pipe(self) -> NoReturn:
        """Leave it to dahl.cli, as for every other output."""
        raise BrokenPipeError


def console(stderr: bool = False, soft_wrap: bool = False) -> Console:
    """Standard output, or standard error; soft_wrap leaves the folding of lines to the terminal."""
    return PlainConsole(stderr=stderr, highlight=False, soft_wrap=soft_wrap)


class Bar(Progress):
    """A progress bar with the number of steps done. The description of its task is their unit. If
    `leaves_nothing`, it shows on a terminal only, and disappears.
    """

    def __init__(self, console: Console, leaves_nothing: bool = False) -> None:
        steps = TextColumn("{task.completed:.0f} {task.description}")
        bar = TextColumn("run    "), BarColumn(), TaskProgressColumn(), steps
        hidden = leaves_nothing and not console.is_terminal
        how: Any = {"console": console, "transient": leaves_nothing, "disable": hidden}
        super().__init__(*bar, TimeElapsedColumn(), **how)

    def begin(self, steps: int, unit: str) -> Callable[[], None]:
        """Show a bar of this length. Return the call that advances it by a step."""
        task = self.add_task(unit, total=steps)
        return lambda: self.advance(task)


def table(shown: Table) -> RichTable:
    """Return a table for the terminal."""
    found = RichTable(title=shown.title or None, title_justify="left")
    for number, name in enumerate(shown.head):
        found.add_column(name, justify="left" if number < shown.names else "right")
    for row in shown.rows:
        found.add_row(*row)
    return found
