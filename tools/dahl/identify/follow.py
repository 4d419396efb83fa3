# SPDX-License-Identifier: MIT
"""A running estimate on a live bus: all that came so far is identified again each time it has grown
by a part, until the intervals are small enough.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING

from dahl import Error
from dahl.identify import pipeline
from dahl.identify.pipeline import Options
from dahl.identify.readers import Signals, Source
from dahl.identify.result import Result

if TYPE_CHECKING:
    import can

FIRST, GROWTH = 500, 1.25  # rows of the first look; how much more for each further one


def follow(
    frames: Iterable[can.Message | None],
    source: Source,
    options: Options,
    within: float,
    show: Callable[[int, Result | None, str], None],
) -> Result:
    """Look again and again; ends when the frames do, or when both parameters are identifiable and
    known to `within` of their value. Raises dahl.Error when nothing could be identified.
    """
    signals, due, rows = signals_of(source), FIRST, signals_rows
    for frame in frames:
        if frame is not None:
            signals.feed(frame)
        if rows(signals) >= due:
            due = int(rows(signals) * GROWTH)
            result, why = _look(signals, source, options)
            show(rows(signals), result, why)
            if result is not None and small_enough(result, within):
                return result
    return pipeline.identify([signals.log("bus", source)], options)


def signals_of(source: Source) -> Signals:
    """What is looked for on the bus. Raises dahl.Error."""
    if source.dbc is None or not (source.angle and source.torque):
        raise Error("--follow needs --dbc FILE, --angle SIGNAL and --torque SIGNAL")
    return Signals(source.dbc, source.angle, source.torque, source.loads)


def signals_rows(signals: Signals) -> int:
    """Frames of the rarer signal."""
    return min(map(len, signals.found.values()))


def _look(signals: Signals, source: Source, options: Options) -> tuple[Result | None, str]:
    try:
        result = pipeline.identify([signals.log("bus", source)], options)
    except Error as error:  # too little motion as yet
        return None, str(error)
    return result, result.verdict.text


def small_enough(result: Result, within: float) -> bool:
    """Whether both parameters are claimed and their intervals are narrow enough."""
    best = result.estimate
    widths = [best.ci95[name].relative(getattr(best, name)) for name in ("sigma0", "Fc")]
    return all(result.verdict.identifiable.values()) and max(widths) <= within
