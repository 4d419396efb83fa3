# SPDX-License-Identifier: MIT
"""Curves for a terminal, by plotext: one panel of a given size, with ticks at round numbers."""

from __future__ import annotations

import math
from collections.abc import Collection

from rich.text import Text

COLUMNS_PER_TICK, ROWS_PER_TICK = 12, 3


def even_ticks(low: float, high: float, most: int) -> list[float]:
    """Return ticks from at most `low` to at least `high`: about `most` steps of 1, 2 or 5 times a
    power of ten.
    """
    if low == high:
        low, high = low - (abs(low) or 1) / 10, high + (abs(high) or 1) / 10
    rough = (high - low) / max(most, 1)
    power = math.floor(math.log10(rough))
    step = next(k for k in (1, 2, 5, 10) if k * 10.0**power >= rough * (1 - 1e-9))
    size = step * 10.0**power
    first, last = math.floor(low / size + 1e-9), math.ceil(high / size - 1e-9)
    return [round(k * size, max(0, -power)) for k in range(first, last + 1)]


def panel(
    x: Collection[float], y: Collection[float], title: str, width: int, height: int, colour: str
) -> Text:
    """Draw y over x in `width` columns and `height` rows; empty axes without points."""
    import plotext

    plotext.clear_figure()
    plotext.theme("clear")
    plotext.plotsize(width, height)
    plotext.title(title)
    if x:
        across = even_ticks(min(x), max(x), width // COLUMNS_PER_TICK)
        up = even_ticks(min(y), max(y), height // ROWS_PER_TICK)
        plotext.xlim(across[0], across[-1])
        plotext.ylim(up[0], up[-1])
        plotext.xticks(across, [f"{tick:.10g}" for tick in across])
        plotext.yticks(up, [f"{tick:.10g}" for tick in up])
        plotext.plot(list(x), list(y), marker="braille", color=colour)
    return Text.from_ansi(plotext.build().rstrip("\n"), no_wrap=True, overflow="crop")
