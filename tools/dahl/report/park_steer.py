# SPDX-License-Identifier: MIT
"""Draw park-steer.png: torque of the hand over its angle, then all torques over time."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from dahl.report.plots import STYLE, save
from dahl.sim.park_steer import GAIN, Run

WITHOUT, WITH = "#20262c", "#d1495b"
SIZE = (11.0, 4.8)  # inches


def draw(path: Path, plain: Run, assisted: Run) -> None:
    """Write the picture."""
    with rc_context(STYLE):
        figure = Figure(figsize=SIZE, layout="constrained")
        loops, torques = figure.subplots(1, 2)
        _draw_loops(loops, plain, assisted)
        _draw_torques(torques, assisted)
        save(figure, path)


def _draw_loops(axes: Axes, plain: Run, assisted: Run) -> None:
    for run, colour, name in (
        (plain, WITHOUT, "without compensation"),
        (assisted, WITH, f"with gain {GAIN:g}"),
    ):
        axes.plot(np.degrees(run.hand_angle), run.hand, color=colour, linewidth=1.3, label=name)
    axes.set(xlabel="angle of the hand wheel [deg]", ylabel="torque of the hand [N m]")
    _add_legend(axes)


def _draw_torques(axes: Axes, run: Run) -> None:
    for torque, colour, name in (
        (run.tyres, "#3d7ea6", "tyres"),
        (run.assist, "#e9a23b", "assist"),
        (run.hand, WITH, "hand"),
    ):
        axes.plot(run.time, torque, color=colour, linewidth=1.3, label=name)
    axes.set(xlabel="time [s]", ylabel="torque with compensation [N m]")
    _add_legend(axes)


def _add_legend(axes: Axes) -> None:
    axes.legend(loc="lower left", bbox_to_anchor=(0, 1), ncols=3, columnspacing=1)
