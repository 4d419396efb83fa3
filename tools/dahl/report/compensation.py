# SPDX-License-Identifier: MIT
"""Draw compensation.png: error and motor torque of each law side by side, then its ratios."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from dahl.report.plots import STYLE, save
from dahl.sim import compensation
from dahl.sim.compensation import Comparison, Run

COLOURS = {  # in the order of drawing, so that noisy traces stay below
    "sign": "#9fb0c0",
    "dead band": "#3d7ea6",
    "tanh": "#e9a23b",
    "none": "#20262c",
    "dahl": "#d1495b",
}
SIZE = (11.0, 10.5)  # inches
WINDOW_S = (1.0, 3.5)  # part of the motion that is drawn
BIN_S = 0.02  # a law that chatters is drawn as the mean and the range of each bin
BAND_ALPHA = 0.22
MILLI = 1e3


def draw(path: Path, comparison: Comparison) -> None:
    """Write the picture."""
    with rc_context(STYLE):
        figure = Figure(figsize=SIZE, layout="constrained")
        grid = figure.subplots(3, 2)
        _axis_row(grid[0], comparison.position, "tracking error [mrad]", MILLI)
        _axis_row(grid[1], comparison.hand, "torque of the hand [N m]", 1.0)
        shown = compensation.SHOWN_POSITION.name, compensation.SHOWN_HAND.name
        for axes, axis, case in zip(grid[:2, 0], ("Position loop", "Hand"), shown, strict=True):
            axes.set_title(f"{axis}: {case}", loc="left", fontsize=11)
        for axes in grid[:2, 1]:
            axes.set_title("motor torque", loc="left", fontsize=11)
        for axes, name in zip(grid[2], ("position", "hand"), strict=True):
            _ratios(axes, name, comparison)
        handles, labels = grid[1, 0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper center", ncols=len(labels))
        save(figure, path)


def _axis_row(row: np.ndarray, runs: dict[str, Run], label: str, scale: float) -> None:
    for name, colour in COLOURS.items():
        traces = np.array(runs[name].error) * scale, np.array(runs[name].motor)
        for axes, trace in zip(row, traces, strict=True):
            _draw_trace(axes, trace, name, colour)
    row[0].set(xlabel="time [s]", ylabel=label)
    row[1].set(xlabel="time [s]", ylabel="torque [N m]")


def _draw_trace(axes: Axes, trace: np.ndarray, name: str, colour: str) -> None:
    """Draw a line through the means of the bins, and a band from their least to their largest."""
    size = round(BIN_S / compensation.PERIOD_S)
    first, last = (round(time / BIN_S) for time in WINDOW_S)
    bins = trace[first * size : last * size].reshape(-1, size)
    time = (np.arange(first, last) + 0.5) * BIN_S
    band = bins.min(axis=1), bins.max(axis=1)
    axes.fill_between(time, *band, color=colour, alpha=BAND_ALPHA, linewidth=0)
    axes.plot(time, bins.mean(axis=1), color=colour, linewidth=1.3, label=name)


def _ratios(axes: Axes, axis: str, comparison: Comparison) -> None:
    cases = comparison.numbers[axis]
    laws = [law for law in COLOURS if law != "none"]
    height = 0.8 / len(laws)
    for k, law in enumerate(laws):
        places = np.arange(len(cases)) + (k - (len(laws) - 1) / 2) * height
        ratios = [values[law]["ratio"] for values in cases.values()]
        axes.barh(places, ratios, height, color=COLOURS[law])
    axes.axvline(1, color=COLOURS["none"], linewidth=1)
    axes.set_yticks(np.arange(len(cases)), list(cases))
    axes.invert_yaxis()
    axes.set_xlabel(f"{axis}: error over that without compensation")
