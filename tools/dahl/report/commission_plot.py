# SPDX-License-Identifier: MIT
"""Draw a commissioning: its motion, friction and load over the angle, friction over the speed,
torque since the turn, kicks; and the tracking error before and after compensation.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from dahl.binding.commission import Commission
from dahl.report.plots import (
    COMPUTED,
    MARK,
    MEASURED,
    MISSING,
    STYLE,
    WIDTH,
    WITHOUT,
    add_legend,
    add_title,
    save,
)
from dahl.sim.axis import Commissioned, Trace, Tracking

MILLI = 1e3
COLOURS = dict(rest=WITHOUT, sweeps=MISSING, cycle=MARK, breakaway=COMPUTED)
COLOURS |= dict(inertia=MEASURED, kick="#5b8c5a")  # of a stage
PANEL_HEIGHT, TITLE_HEIGHT = 2.4, 0.3  # inches
MAX_TURN_LENGTHS = 3.0  # shown of the travel since the turn


def draw(path: Path, done: Commissioned, tracking: tuple[Tracking, ...] = ()) -> None:
    """Write the picture. Panels without data are left out. `tracking`: without and with."""
    axis, is_done = done.axis, done.axis.stage == "done"
    panels = [["motion", "motion"]]
    panels += [["angle", "speed"]] * axis.has_sweeps
    panels += [["turn", "kicks"]] * is_done
    panels += [["tracking", "tracking"]] * bool(tracking)
    with rc_context(STYLE):
        size = WIDTH, PANEL_HEIGHT * len(panels) + TITLE_HEIGHT
        figure = Figure(figsize=size, layout="constrained")
        axes = figure.subplot_mosaic(panels)  # type: ignore[arg-type]
        _draw_motion(axes["motion"], done.trace)
        if axis.has_sweeps:
            _draw_angle(axes["angle"], axis)
            _draw_speed(axes["speed"], axis)
        if is_done:
            _draw_turn(axes["turn"], axis, done.trace)
            _draw_kicks(axes["kicks"], done.trace)
        if tracking:
            _draw_tracking(axes["tracking"], *tracking)
        add_title(figure, _title(done, tracking))
        save(figure, path)


def _title(done: Commissioned, tracking: tuple[Tracking, ...]) -> str:
    if not tracking:
        return f"Commissioning of an axis: {done.axis.stage}"
    before, after = (f"{MILLI * one.rms:.3g}" for one in tracking)
    return f"An axis measures its friction: error {after}, not {before} mrad"


def _draw_motion(axes: Axes, trace: Trace) -> None:
    stages, angle = np.array(trace.stage), np.array(trace.angle)
    time = np.arange(len(angle)) * trace.period
    for stage, colour in COLOURS.items():
        rows = stages == stage
        if rows.any():
            shown = np.where(rows, angle, np.nan)
            axes.plot(time, shown, color=colour, label=stage)
    axes.set(xlabel="time [s]", ylabel="angle [rad]")
    add_legend(axes, len(COLOURS))


def _draw_angle(axes: Axes, axis: Commission) -> None:
    found = axis.sweeps
    axes.plot(
        found["angle"], found["friction"], "o-", markersize=4, color=COMPUTED, label="friction"
    )
    axes.plot(found["angle"], found["load"], "o-", markersize=4, color=MEASURED, label="load")
    if axis.stage == "done":
        result = axis.result
        band = found["load"] - result["load_error"], found["load"] + result["load_error"]
        axes.fill_between(found["angle"], *band, color=MEASURED, alpha=0.2, linewidth=0)
        axes.axhline(result["Fc"].least, color=COMPUTED, linestyle=":", label="Fc_low")
    axes.set(xlabel="angle [rad]", ylabel="torque [N m]")
    add_legend(axes, 3)


def _draw_speed(axes: Axes, axis: Commission) -> None:
    found = axis.sweeps
    speed, level = np.array(found["friction_at_speed"]).T
    axes.plot(speed, level, "o", markersize=4, color=COMPUTED, label="measured")
    line = np.array([0.0, speed.max()])
    viscous = found["viscous"]
    axes.plot(line, found["Fc"].best + viscous.best * line, color=MEASURED, label="Fc and viscous")
    axes.set(xlabel="speed [rad/s]", ylabel="friction [N m]", ylim=(0, 1.2 * level.max()))
    add_legend(axes, 2)


def _draw_turn(axes: Axes, axis: Commission, trace: Trace) -> None:
    """Draw both ramps of the stage breakaway, Dahl's curve, and the slope of the bounds."""
    result, load = axis.result, axis.load(0.0)
    for k, rows in enumerate(_ramps(trace)):
        torque, angle = np.array(trace.torque)[rows] - load, np.array(trace.angle)[rows]
        sign = np.sign(torque[-1])
        label = "measured" if k == 0 else ""
        axes.plot(MILLI * sign * (angle - angle[0]), sign * torque, color=MEASURED, label=label)
    far = MAX_TURN_LENGTHS * result["length"].most
    travel = np.linspace(0, far, 200)
    Fc, sigma0 = result["Fc"].best, result["sigma0"].best  # noqa: N806
    dahl = Fc * (1 - np.exp(-sigma0 * travel / Fc))
    axes.plot(MILLI * travel, dahl, color=COMPUTED, label="Dahl, best values")
    low = np.minimum(result["Fc"].least / result["length"].most * travel, result["Fc"].least)
    axes.plot(MILLI * travel, low, color=COMPUTED, linestyle=":", label="bounds")
    axes.set(xlabel="travel since the turn [mrad]", ylabel="torque over the load [N m]")
    axes.set_xlim(0, MILLI * far)
    add_legend(axes, 2)


def _ramps(trace: Trace) -> list[np.ndarray]:
    """Return the rows of each ramp: torque mode of the stage breakaway, while the torque rises."""
    stage, mode = np.array(trace.stage), np.array(trace.mode)
    rows = np.flatnonzero((stage == "breakaway") & (mode == "torque"))
    runs = np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1)
    torque = np.array(trace.torque)
    return [
        run[np.flatnonzero(torque[run] != torque[run[0]])] for run in runs if np.ptp(torque[run])
    ]


def _draw_kicks(axes: Axes, trace: Trace) -> None:
    """Draw the angle after the start of each kick, over time."""
    stage, mode = np.array(trace.stage), np.array(trace.mode)
    rows = np.flatnonzero((stage == "kick") & (mode == "torque"))
    angle = MILLI * np.array(trace.angle)
    for run in np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1):
        time = (run - run[0]) * trace.period
        axes.plot(time, angle[run] - angle[run[0]], color=COLOURS["kick"])
    axes.set(xlabel="time since a kick [s]", ylabel="angle [mrad]")


def _draw_tracking(axes: Axes, without: Tracking, with_it: Tracking) -> None:
    for one, colour, label in (
        (without, WITHOUT, "without compensation"),
        (with_it, COMPUTED, "with compensation"),
    ):
        words = f"{label}: rms {MILLI * one.rms:.3g} mrad"
        axes.plot(one.time, MILLI * one.error, color=colour, label=words)
    axes.set(xlabel="time [s]", ylabel="tracking error [mrad]")
    add_legend(axes, 2)
