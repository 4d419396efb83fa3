# SPDX-License-Identifier: MIT
"""Draw park-steer.png: torque of the hand over its angle, then all torques over time."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from dahl.report.plots import (
    COMPUTED,
    MARK,
    MISSING,
    STYLE,
    WIDTH,
    WITHOUT,
    add_legend,
    add_title,
    save,
)
from dahl.sim.park_steer import GAIN, Run

HEIGHT = 6.6  # inches


def draw(path: Path, plain: Run, assisted: Run) -> None:
    """Write the picture."""
    with rc_context(STYLE):
        figure = Figure(figsize=(WIDTH, HEIGHT), layout="constrained")
        loops, torques = figure.subplots(2, height_ratios=(3, 2))
        _draw_loops(loops, plain, assisted)
        _draw_torques(torques, assisted)
        largest, less = (run.numbers()["largest_hand_Nm"] for run in (plain, assisted))
        add_title(
            figure, f"The assist lowers the hand's torque from {largest:.3g} to {less:.3g} N m"
        )
        save(figure, path)


def _draw_loops(axes: Axes, plain: Run, assisted: Run) -> None:
    for run, colour, name in (
        (plain, WITHOUT, "without compensation"),
        (assisted, COMPUTED, f"with gain {GAIN:g}"),
    ):
        axes.plot(np.degrees(run.hand_angle), run.hand, color=colour, label=name)
    axes.set(xlabel="angle of the hand wheel [deg]", ylabel="torque of the hand [N m]")
    add_legend(axes, 3)


def _draw_torques(axes: Axes, run: Run) -> None:
    for torque, colour, name in (
        (run.tyres, MISSING, "tyres"),
        (run.assist, MARK, "assist"),
        (run.hand, COMPUTED, "hand"),
    ):
        axes.plot(run.time, torque, color=colour, label=name)
    axes.set(xlabel="time [s]", ylabel="torque with compensation [N m]")
    add_legend(axes, 3)
