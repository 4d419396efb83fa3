# SPDX-License-Identifier: MIT
"""Identify on a live bus, again and again, until the intervals are narrow."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING

from dahl.errors import Error
from dahl.identify import estimate
from dahl.identify.estimate import Options
from dahl.identify.result import Result
from dahl.io.can_signals import Signals
from dahl.io.log import Log
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
    for frame in frames:
        if frame is not None:
            signals.feed(frame)
        if (rows := signals.rows()) >= due:
            due = int(rows * GROWTH)
            result, words = _estimate(signals, source, options)
            show(rows, result, words)
            if result is not None and is_known(result, within):
                return result
    return estimate.identify([_log(signals, source)], options)


def signals_of(source: Source) -> Signals:
    """Return the signals to follow. Raises dahl.Error if the options do not name them."""
    if source.dbc is None or not (source.angle and source.torque):
        raise Error("--follow needs --dbc FILE, --angle SIGNAL and --torque SIGNAL")
    return Signals(source.dbc, source.signals)


def _log(signals: Signals, source: Source) -> Log:
    return to_log("bus", source, (signals.columns, signals.values("bus")))


def _estimate(signals: Signals, source: Source, options: Options) -> tuple[Result | None, str]:
    try:
        result = estimate.identify([_log(signals, source)], options)
    except Error as error:  # too little motion so far
        return None, str(error)
    return result, result.verdict


def is_known(result: Result, within: float) -> bool:
    """Whether both parameters are claimed within this part of their values."""
    widths = [result.sigma0.half_width, result.Fc.half_width]
    return all(result.claimed) and max(widths) <= within
