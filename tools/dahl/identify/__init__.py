# SPDX-License-Identifier: MIT
"""Identify sigma0 and Fc from measured logs, with intervals and a verdict.

    from pathlib import Path
    from dahl.identify import Options, Source, identify, read
    result = identify([read(Path("shaft.csv"), Source())], Options())
    print(result.verdict, result.sigma0, result.Fc)
    result.to_dataframe()

readers -> preprocess -> samples -> laws, lags -> fit -> start -> select -> diagnose, simulate ->
result; estimate runs them in this order, and no module imports a later one. export, report and plot
write what was found. The command is
`dahl identify` (dahl.commands.identify).
"""

from __future__ import annotations

from typing import Any

_HOMES = {
    "Log": "io.log",
    "Options": "identify.estimate",
    "Result": "identify.result",
    "Source": "io.readers",
    "check": "identify.estimate",
    "identify": "identify.estimate",
    "read": "io.readers",
}
__all__ = sorted(_HOMES)  # noqa: PLE0605  (names of the table above)


def __getattr__(name: str) -> Any:
    """Import on first use: scipy and pandas take a second that other commands do not need."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from importlib import import_module

    return getattr(import_module(f"dahl.{_HOMES[name]}"), name)
