# SPDX-License-Identifier: MIT
"""Identify on a live bus, again and again, until the intervals are narrow."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING

from dahl.errors import Error, InputError
from dahl.identify.estimate import Options, identify
from dahl.identify.result import Result
from dahl.io.can_signals import Signals
from dahl.io.readers import Source, to_log

if TYPE_CHECKING:
    import can

FIRST_ROWS = 500  # of the first estimate
GROWTH = 1.25  # of the log from one estimate to the next


def follow(
    frames: Iterable[can.Message | None],
    source: Source,
    options: Options,
    within: float,
    show: Callable[[int, Result | None, str], None],
) -> Result:
    """Identify again and again, until is_known() or until the frames end.

    Raises dahl.Error if the log could not be identified by then.
    """
    signals, due = signals_of(source), FIRST_ROWS

    def estimate() -> Result:
        columns = signals.columns, signals.values("bus")
        return identify([to_log("bus", source, columns)], options)

    for frame in frames:
        if frame is not None:
            signals.feed(frame)
        if (rows := signals.rows()) < due:
            continue
        due = int(rows * GROWTH)
        try:
            result = estimate()
        except Error as error:  # too little motion so far
            show(rows, None, str(error))
            continue
        show(rows, result, result.verdict)
        if is_known(result, within):
            return result
    return estimate()


def signals_of(source: Source) -> Signals:
    """Return the signals to follow. Raises dahl.Error if the options do not name them."""
    if source.dbc is None or not (source.angle and source.torque):
        raise InputError("--follow needs --dbc FILE, --angle SIGNAL and --torque SIGNAL")
    return Signals(source.dbc, source.signals)


def is_known(result: Result, within: float) -> bool:
    """Whether both parameters are claimed within this part of their values."""
    widths = [result.sigma0.half_width, result.Fc.half_width]
    return all(result.claimed) and max(widths) <= within
