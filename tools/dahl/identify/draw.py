# SPDX-License-Identifier: MIT
"""The picture of an identification: the log as it was measured beside the model and Coulomb's, the
residual over angle and speed, Fc and sigma0 cycle by cycle, and how sharply the cost tells sigma0.
"""

from __future__ import annotations

import textwrap
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from dahl import plots
from dahl.identify import carried, clean, load, models_output, plan_quality
from dahl.identify import path as paths
from dahl.identify.fit import dense_of, profile_of
from dahl.identify.log import Log
from dahl.identify.result import Result, titled
from dahl.identify.terms import torque_of
from dahl.plots import COMPUTED, MEASURED

POINTS = 20_000  # drawn of a long log
ODD = 0.5  # weight below which a row is marked
SPEED_ROWS = 9  # over which a speed is taken
HEADLINE = 90  # characters
COULOMB, MARK, CHOSEN = "#3d7ea6", "#e9a23b", "#3c8f5a"


@dataclass(frozen=True)
class Shown:
    """One log for drawing: some of its rows, the angle in a unit for people."""

    log: Log
    raw: Log
    some: slice
    size: float  # of that unit, rad (m)
    unit: str

    @property
    def angle(self) -> np.ndarray:
        """From the start: (some,)."""
        angle: np.ndarray = (self.raw.theta - self.raw.theta[0])[self.some] / self.size
        return angle

    @property
    def speed(self) -> np.ndarray:
        """Per second, or per row of a log without time: (some,)."""
        padded = np.pad(self.log.theta, SPEED_ROWS // 2, mode="edge")
        smooth = np.convolve(padded, np.full(SPEED_ROWS, 1 / SPEED_ROWS), mode="valid")
        rows = np.arange(self.log.rows) if self.log.time is None else self.log.time
        apart = np.maximum(np.gradient(rows), 1e-12)
        return np.asarray((np.gradient(smooth) / apart)[self.some] / self.size)


def draw(path: Path, result: Result) -> None:
    """Write the picture; the old one stays until the new one is whole."""
    index = int(np.argmax([log.rows for log in result.logs]))  # the longest piece
    shown = shown_of(result, index)
    with rc_context(plots.STYLE):
        figure = Figure(figsize=(11, 14), layout="constrained")
        loop, rests, by_cycle, cost = figure.subplots(4, 2, height_ratios=(2.6, 1, 1, 1.1))
        whole = _merged(figure, loop)
        _loop(whole, result, shown, index)
        _residuals(rests, result, shown, index)
        _cycles(by_cycle, result)
        _profile(_merged(figure, cost), result)
        words = plots.literal(result.verdict.text)
        whole.set_title(words, loc="left", fontsize=10, color="#555555", wrap=True)
        numbers = [textwrap.fill(line, HEADLINE) for line in models_output.headlines(result)]
        figure.suptitle(
            "\n".join([plots.literal(titled(result)), *numbers]),
            fontsize=14,
            fontweight="bold",
            x=0.01,
            ha="left",
        )
        plots.save(figure, path)


def shown_of(result: Result, index: int) -> Shown:
    """A log with the unit that suits its motion."""
    log = result.logs[index]
    some = slice(0, log.rows, max(log.rows // POINTS, 1))
    return Shown(log, result.raw[index], some, *log.shown_in)


def _merged(figure: Figure, pair: np.ndarray) -> Axes:
    """One panel in the place of two."""
    place = pair[0].get_gridspec()[pair[0].get_subplotspec().rowspan.start, :]
    for axes in pair:
        axes.remove()
    merged: Axes = figure.add_subplot(place)
    return merged


def _loop(axes: Axes, result: Result, shown: Shown, index: int) -> None:
    """Draw the measured torque over angle with the rows that the fit changed, and the models with
    the delay of the measurement.
    """
    log, some, late = shown.log, shown.some, result.delay
    measured = result.sign * shown.raw.torque
    axes.plot(shown.angle, measured[some], color=MEASURED, linewidth=1.1, label="as measured")
    drawn = result.predicted[index] + load.more(log, result.follows)
    sign = paths.coulomb(log.moves, 0.0) * result.estimate.Fc
    sign = sign + plan_quality.load_of(result, log, result.estimate.terms)
    angle = (log.theta - shown.raw.theta[0])[some] / shown.size
    for curve, color, width, label in (
        (sign, COULOMB, 1.0, "Coulomb"),
        (drawn, COMPUTED, 1.4, f"fitted{models_output.whose(result)}"),
    ):
        axes.plot(angle, _later(curve, late)[some], color=color, linewidth=width, label=label)
    _chosen(axes, result, log, angle, some)
    for label, marks, style in marks_of(shown, late):
        if marks.any():
            words = f"{label}: {100 * marks.mean():.1f} % of the rows"
            axes.plot(shown.angle[marks], measured[some][marks], style, color=MARK, label=words)
    kind = "force" if log.linear else "torque"
    axes.set(xlabel=f"angle from the start [{shown.unit}]", ylabel=f"{kind} [{log.unit}]")
    if log.linear:
        axes.set_xlabel(f"position from the start [{shown.unit}]")
    axes.legend(loc="best", fontsize=9)


def _chosen(axes: Axes, result: Result, log: Log, angle: np.ndarray, some: slice) -> None:
    """The model that header and scene carry, where that is not Dahl's."""
    friction = carried.of(result)
    if friction.model not in ("dahl", "loaded"):
        beside = torque_of(log, friction.terms)
        torque = clean.shifted(log.torque, friction.earlier) - beside
        drawn = plan_quality.drawn(friction, log.moves, torque) + beside
        drawn = _later(drawn, result.delay + friction.earlier)
        models = result.explored.models
        label = f"{models.chosen} ({models.why})"
        axes.plot(angle, drawn[some], color=CHOSEN, linewidth=1.4, label=label)


def _later(curve: np.ndarray, rows: float) -> np.ndarray:
    """Return a curve delayed by so many rows, NaN beyond an end of the log."""
    index = np.arange(len(curve))
    later: np.ndarray = np.interp(index - rows, index, curve, left=np.nan, right=np.nan)
    return later


def marks_of(shown: Shown, late: float) -> list[tuple[str, np.ndarray, str]]:
    """Mark the measured rows that the fit changed: (some,) bool each. Weights belong to the torque
    moved to its angle, from `late` rows behind it.
    """
    log, none = shown.log, np.zeros(shown.log.rows, dtype=bool)
    odd = none if log.weight is None else (log.weight > 0) & (log.weight < ODD)
    odd = _later(odd, round(late)) > ODD
    free = none if log.free_moves is None else np.abs(log.free_moves) < ODD * np.abs(log.moves)
    marks = (("weighs less", odd, "x"), ("travel taken out as backlash", free, "."))
    return [(label, where[shown.some], style) for label, where, style in marks]


def _residuals(pair: np.ndarray, result: Result, shown: Shown, index: int) -> None:
    """What is left, over angle and over speed: structure there is what the model lacks."""
    left = (shown.log.torque - result.predicted[index])[shown.some]
    per = "row" if shown.log.time is None else "s"
    speed = f"speed [{shown.unit}/{per}]"
    where = "position" if shown.log.linear else "angle"
    for axes, x, label in (
        (pair[0], shown.angle, f"{where} from the start [{shown.unit}]"),
        (pair[1], shown.speed, speed),
    ):
        axes.plot(x, left, ".", color=MEASURED, markersize=1.5)
        axes.axhline(0, color=COMPUTED, linewidth=1)
        axes.set(xlabel=label, ylabel=f"residual [{shown.log.unit}]")


def _cycles(pair: np.ndarray, result: Result) -> None:
    """Fc and sigma0 by cycle with the interval of the whole log."""
    log, cycles = result.logs[0], result.cycles
    for axes, name, unit in ((pair[0], "Fc", log.unit), (pair[1], "sigma0", log.slope_unit)):
        interval = result.estimate.ci95[name]
        if np.isfinite(interval.high):
            axes.axhspan(interval.low, interval.high, color=COMPUTED, alpha=0.25)
        axes.axhline(getattr(result.estimate, name), color=COMPUTED, linewidth=1)
        if len(cycles):
            axes.plot(np.arange(len(cycles)) + 1, cycles.value[name], "o", color=MEASURED, ms=4)
        axes.set(xlabel="cycle (shaded: 95 % of the whole log)", ylabel=f"{name} [{unit}]")


def _profile(axes: Axes, result: Result) -> None:
    """Least cost for each sigma0 over the least of all, with the 95 % interval."""
    estimate, log = result.estimate, result.logs[0]
    interval = estimate.ci95["sigma0"]
    low = max(interval.low * 0.7, estimate.sigma0 * 0.2)
    high = min(interval.high * 1.3, estimate.sigma0 * 5)
    values = np.linspace(low, high, 200)
    axes.plot(values, profile_of(dense_of(estimate), values), color=COMPUTED)
    axes.axvspan(max(interval.low, low), min(interval.high, high), color=MEASURED, alpha=0.25)
    axes.set(xlabel=f"sigma0 [{log.slope_unit}]", ylabel="least cost / least of all")
    axes.set_title("shaded: 95 % interval", loc="left", fontsize=10, color="#555555")
