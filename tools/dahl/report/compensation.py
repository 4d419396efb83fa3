# SPDX-License-Identifier: MIT
"""Draw compensation.png: errors and torques of some laws over time, the effect of a wrong Fc, and
the ratios of all laws.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from dahl.report.plots import COMPUTED, STYLE, WIDTH, WITHOUT, save
from dahl.sim import compensation
from dahl.sim.compensation import Comparison
from dahl.sim.compensation_axis import FC, PERIOD_S

COLOURS = {  # in the order of the tables, so that the library is drawn last
    "none": WITHOUT,
    "sign": "#9fb0c0",
    "tanh": "#e9a23b",
    "dead band": "#3d7ea6",
    "reversal rule": "#6a994e",
    "learned": "#9d6bb3",
    "learned elsewhere": "#cdb4db",
    "LuGre observer": "#2a9d8f",
    "disturbance observer": "#8c564b",
    "dahl": "#f08a97",
    "dahl + observer": COMPUTED,
}
NAMES = {"sign": "sign(v)", "tanh": "tanh(v)"}  # of the others: the key
OURS = ("dahl", "dahl + observer")
POSITION_LAWS = ("none", "tanh", "reversal rule", "disturbance observer", *OURS)
HAND_LAWS = ("none", "sign", "LuGre observer", "dahl")
WRONG_FC = {-30: "Fc 30 % low", -10: "Fc 10 % low", 0: "17 bits"}  # %: case
WRONG_FC |= {10: "Fc 10 % high", 30: "Fc 30 % high"}
PANEL, ROW, LEGEND = 2.1, 0.24, 1.1  # inches: height of a panel, of a case of the lower panels
TITLE = "The error that each law of friction compensation leaves"
WINDOW_S = (1.0, 3.5)  # part of the motion that is drawn
CHATTER_S = (2.4, 2.46)  # part of it of which each tick is drawn
CHATTERING = ("sign", "tanh", "LuGre observer", "dahl")
BIN_S = 0.02  # a line goes through the means of bins, so that noise does not cover the others
MILLI = 1e3


def draw(path: Path, comparison: Comparison) -> None:
    """Write the picture."""
    with rc_context(STYLE):
        rows = [ROW * (len(cases) + 3) for cases in comparison.numbers.values()]
        upper = 2 * PANEL + LEGEND
        figure = Figure(figsize=(WIDTH, upper + sum(rows)), layout="constrained")
        parts: Any = figure.subfigures(2, height_ratios=(upper, sum(rows)))
        top, bottom = parts
        panels = top.subplots(2, 2).flat
        for panel, axes in zip((_errors, _wrong_Fc, _hand, _chatter), panels, strict=True):
            panel(axes, comparison)
        lower = bottom.subplots(2, height_ratios=rows)
        for axis, axes in zip(("position", "hand"), lower, strict=True):
            _ratios(axes, axis, comparison)
        handles, labels = lower[0].get_legend_handles_labels()
        place: Any = {"loc": "outside upper left", "ncols": 4, "alignment": "left"}
        font = {"weight": STYLE["figure.titleweight"], "size": STYLE["figure.titlesize"]}
        top.legend(handles, labels, title=TITLE, title_fontproperties=font, **place)
        save(figure, path)


def _line(axes: Axes, x: np.ndarray, y: np.ndarray, law: str, marker: str = "") -> None:
    width = 2.0 if law in OURS else 1.3
    axes.plot(x, y, color=COLOURS[law], linewidth=width, marker=marker, markersize=4)


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
    axes.locator_params(axis="x", nbins=4)
    _label(axes, "Hand: motor torque, each tick", "time [s]", "torque [N m]")


def _wrong_Fc(axes: Axes, comparison: Comparison) -> None:  # noqa: N802
    cases = comparison.numbers["position"]
    for law in COLOURS:
        if law not in ("none", "dead band", "sign", "learned elsewhere"):
            ratios = [cases[case][law]["ratio"] for case in WRONG_FC.values()]
            _line(axes, np.array([*WRONG_FC]), np.array(ratios), law, "o")
    axes.set(yscale="log", xticks=[*WRONG_FC])
    axes.yaxis.set_major_formatter("{x:g}")
    _label(axes, "Position loop: a wrong Fc", "error of the assumed Fc [%]", "ratio")


def _label(axes: Axes, title: str, x: str, y: str) -> None:
    axes.set_title(title)
    axes.set(xlabel=x, ylabel=y)


def _ratios(axes: Axes, axis: str, comparison: Comparison) -> None:
    """Draw a row for each case and a dot for each law."""
    cases = comparison.numbers[axis]
    axes.axvline(1, color=COLOURS["none"], linewidth=1.3, label="none")
    for law, colour in COLOURS.items():
        rows = [(k, laws[law]["ratio"]) for k, laws in enumerate(cases.values()) if law in laws]
        if law != "none" and rows:
            places, ratios = zip(*rows, strict=True)
            marker, size = ("D", 7) if law in OURS else ("o", 6)
            axes.plot(
                ratios, places, marker, markersize=size, color=colour, label=NAMES.get(law, law)
            )
    axes.set_xscale("log")
    axes.xaxis.set_major_formatter("{x:g}")
    axes.set_yticks(np.arange(len(cases)), list(cases))
    axes.invert_yaxis()
    axes.set_xlabel(f"{axis}: error over that without compensation")
