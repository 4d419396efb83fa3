# SPDX-License-Identifier: MIT
"""Draw compensation.png: errors and torques of some laws over time, the effect of a wrong Fc, and
the ratios of all laws.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from dahl.report.plots import STYLE, save
from dahl.sim import compensation
from dahl.sim.compensation import Comparison
from dahl.sim.compensation_axis import FC, PERIOD_S

COLOURS = {  # in the order of drawing, so that the library is on top
    "none": "#20262c",
    "sign": "#9fb0c0",
    "dead band": "#3d7ea6",
    "tanh": "#e9a23b",
    "reversal rule": "#6a994e",
    "learned": "#9d6bb3",
    "learned elsewhere": "#cdb4db",
    "disturbance observer": "#8c564b",
    "LuGre observer": "#2a9d8f",
    "dahl": "#f08a97",
    "dahl + observer": "#c1121f",
}
OURS = ("dahl", "dahl + observer")
POSITION_LAWS = ("none", "tanh", "reversal rule", "disturbance observer", *OURS)
HAND_LAWS = ("none", "sign", "LuGre observer", "dahl")
WRONG_FC = {-30: "Fc 30 % low", -10: "Fc 10 % low", 0: "17 bits"}  # %: case
WRONG_FC |= {10: "Fc 10 % high", 30: "Fc 30 % high"}
SIZE = (9.0, 14.0)  # inches
PANEL, ROW = 1.9, 0.27  # inches, about: height of an upper panel, of a case below
WINDOW_S = (1.0, 3.5)  # part of the motion that is drawn
CHATTER_S = (2.4, 2.46)  # part of it of which each tick is drawn
CHATTERING = ("sign", "tanh", "LuGre observer", "dahl")
BIN_S = 0.02  # a line goes through the means of bins, so that noise does not cover the others
MILLI = 1e3


def draw(path: Path, comparison: Comparison) -> None:
    """Write the picture."""
    with rc_context(STYLE):
        figure = Figure(figsize=SIZE, layout="constrained")
        rows = [ROW * (len(cases) + 1) for cases in comparison.numbers.values()]
        grid = figure.add_gridspec(4, 2, height_ratios=[PANEL, PANEL, *rows])
        _errors(figure.add_subplot(grid[0, 0]), comparison)
        _wrong_Fc(figure.add_subplot(grid[0, 1]), comparison)
        _hand(figure.add_subplot(grid[1, 0]), comparison)
        _chatter(figure.add_subplot(grid[1, 1]), comparison)
        for row, axis in ((2, "position"), (3, "hand")):
            _ratios(figure.add_subplot(grid[row, :]), axis, comparison)
        handles, labels = figure.axes[4].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper center", ncols=4)
        save(figure, path)


def _line(axes: Axes, x: np.ndarray, y: np.ndarray, law: str, marker: str = "") -> None:
    width = 2.0 if law in OURS else 1.3
    axes.plot(x, y, color=COLOURS[law], linewidth=width, marker=marker, markersize=4, label=law)


def _means(axes: Axes, trace: np.ndarray, law: str) -> None:
    size = round(BIN_S / PERIOD_S)
    first, last = (round(time / BIN_S) for time in WINDOW_S)
    bins = trace[first * size : last * size].reshape(-1, size)
    _line(axes, (np.arange(first, last) + 0.5) * BIN_S, bins.mean(axis=1), law)


def _errors(axes: Axes, comparison: Comparison) -> None:
    for law in POSITION_LAWS:
        _means(axes, comparison.position[law].error * MILLI, law)
    _label(axes, f"Position loop: {compensation.SHOWN_POSITION.name}", "time [s]", "error [mrad]")


def _hand(axes: Axes, comparison: Comparison) -> None:
    for law in HAND_LAWS:
        _means(axes, comparison.hand[law].error, law)
    title = f"Hand: {compensation.SHOWN_HAND.name}"
    _label(axes, title, "time [s]", "torque of the hand [N m]")


def _chatter(axes: Axes, comparison: Comparison) -> None:
    part = slice(*(round(time / PERIOD_S) for time in CHATTER_S))
    for law in CHATTERING:
        motor = comparison.hand[law].motor[part]
        _line(axes, np.arange(part.start, part.stop) * PERIOD_S, motor, law)
    axes.set_ylim(-1.3 * FC, 1.3 * FC)
    _label(axes, "Hand: motor torque, each tick", "time [s]", "torque [N m]")


def _wrong_Fc(axes: Axes, comparison: Comparison) -> None:  # noqa: N802
    cases = comparison.numbers["position"]
    for law in COLOURS:
        if law not in ("none", "dead band", "sign", "learned elsewhere"):
            ratios = [cases[case][law]["ratio"] for case in WRONG_FC.values()]
            _line(axes, np.array([*WRONG_FC]), np.array(ratios), law, "o")
    axes.set(yscale="log", xticks=[*WRONG_FC])
    _label(axes, "Position loop: a wrong Fc", "error of the assumed Fc [%]", "ratio")


def _label(axes: Axes, title: str, x: str, y: str) -> None:
    axes.set_title(title, loc="left", fontsize=11)
    axes.set(xlabel=x, ylabel=y)


def _ratios(axes: Axes, axis: str, comparison: Comparison) -> None:
    """Draw a row for each case and a dot for each law."""
    cases = comparison.numbers[axis]
    for law, colour in COLOURS.items():
        rows = [(k, laws[law]["ratio"]) for k, laws in enumerate(cases.values()) if law in laws]
        if law != "none" and rows:
            places, ratios = zip(*rows, strict=True)
            marker, size = ("D", 7) if law in OURS else ("o", 6)
            axes.plot(ratios, places, marker, markersize=size, color=colour, label=law)
    axes.axvline(1, color=COLOURS["none"], linewidth=1.3, label="none")
    axes.set_xscale("log")
    axes.set_yticks(np.arange(len(cases)), list(cases))
    axes.invert_yaxis()
    axes.set_xlabel(f"{axis}: error over that without compensation")
