# SPDX-License-Identifier: MIT
"""Draw NAME.png: the fit over the measurement, and the residual."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from dahl.identify.result import NAMES, Result
from dahl.report import plots
from dahl.report.plots import COMPUTED, MARK, MEASURED

PANELS: Any = [  # matplotlib has no exported type of it
    ["loop", "loop"],
    ["by angle", "by speed"],
    ["autocorrelation", "plausible"],
    ["sigma0", "Fc"],
]
MAX_LAG = 60  # samples of the autocorrelation
CORRELATED_SAMPLES = 20_000  # from the start
OUTLIER_WEIGHT = 0.5  # samples of less weight are marked


def draw(path: Path, result: Result, title: str) -> None:
    """Write the picture; an old file stays until the new one is complete."""
    with rc_context(plots.STYLE):
        figure = Figure(figsize=(11, 14), layout="constrained")
        panels = figure.subplot_mosaic(PANELS, height_ratios=(2.6, 1, 1, 1))
        size, unit = result.logs[0].shown_in
        angle = result.samples.angles[result.hypothesis.angle]
        from_start = (angle - angle[0]) / size
        name = "position" if result.logs[0].linear else "angle"
        label = f"{name} from the start [{unit}]"
        _draw_loop(panels["loop"], result, from_start, label)
        _draw_residual(panels["by angle"], result, from_start, label)
        speed = result.samples.speed / size * (1.0 if result.samples.timed else 1e-3)
        label = f"speed [{unit}/{'s' if result.samples.timed else 'row'}]"
        _draw_residual(panels["by speed"], result, speed, label)
        _draw_autocorrelation(panels["autocorrelation"], result)
        _draw_hypotheses(panels["plausible"], result)
        for name, values in result.by_cycle().items():
            if name in NAMES:
                _draw_cycles(panels[name], result, name, values)
        found = {
            name: f"{name} = {getattr(result, name).value:.4g} {result.units[name]}"
            for name, is_claimed in zip(NAMES, result.claimed, strict=True)
            if is_claimed
        }
        numbers = ", ".join(found.get(name, f"{name} not known") for name in NAMES)
        words = f"{plots.escape(title)}\n{result.hypothesis.law.label}: {numbers}"
        figure.suptitle(words, fontsize=14, fontweight="bold", x=0.01, ha="left")
        plots.save(figure, path)


def _draw_loop(axes: Axes, result: Result, angle: np.ndarray, label: str) -> None:
    """Draw torque over angle, measured and fitted; each piece is a line.

    If other torques are larger than friction, draw friction alone over the travel since the turn.
    The fit begins when the unknown torque at the start of a piece is forgotten.
    """
    log, other = result.logs[0], np.zeros(result.samples.rows)
    what = "force" if log.linear else "torque"
    if max(result.other_torques.values(), default=0.0) > result.Fc.value:
        size, unit = log.shown_in
        angle, other = result.samples.from_turn(result.a.value) / size, result.other_torque
        what, label = "friction", f"travel since the turn [{unit}]"
    measured, predicted = result.samples.torque - other, result.predicted - other
    for k, rows in enumerate(result.samples.pieces):
        words = ("measured", f"fitted: {result.hypothesis.law.label}") if k == 0 else ("", "")
        axes.plot(angle[rows], measured[rows], color=MEASURED, linewidth=1.1, label=words[0])
        start = rows.start + int(np.argmax(result.samples.used[rows] > 0))
        settled = slice(start, rows.stop)
        axes.plot(angle[settled], predicted[settled], color=COMPUTED, linewidth=1.4, label=words[1])
    weight = result.samples.weight
    is_outlier = (weight > 0) & (weight < OUTLIER_WEIGHT)
    if is_outlier.any():
        label_outliers = f"outliers, {100 * is_outlier.mean():.1f} % of the samples"
        axes.plot(angle[is_outlier], measured[is_outlier], "x", color=MARK, label=label_outliers)
    axes.set(xlabel=label, ylabel=f"{what} [{log.unit}]")
    axes.legend(loc="best", fontsize=9)
    verdict = plots.escape(result.verdict)
    axes.set_title(verdict, loc="left", fontsize=10, color="#555555", wrap=True)


def _draw_residual(axes: Axes, result: Result, x: np.ndarray, label: str) -> None:
    """Draw the residual over a column; structure there is lack of fit."""
    used = result.samples.used > 0
    axes.plot(x[used], result.residual[used], ".", color=MEASURED, markersize=1.5)
    axes.axhline(0, color=COMPUTED, linewidth=1)
    axes.set(xlabel=label, ylabel=f"residual [{result.logs[0].unit}]")


def _draw_autocorrelation(axes: Axes, result: Result) -> None:
    """Draw the autocorrelation of the residual, with the band of white noise."""
    x = (result.residual * (result.samples.used > 0))[:CORRELATED_SAMPLES]
    power = float(x @ x) or 1.0
    lags = np.arange(1, min(MAX_LAG, len(x) // 4) + 1)
    axes.bar(lags, [float(x[k:] @ x[:-k]) / power for k in lags], width=0.8, color=MEASURED)
    white = 1.96 / np.sqrt(len(x))
    axes.axhspan(-white, white, color=COMPUTED, alpha=0.25)
    axes.set(xlabel="lag [samples] (shaded: white noise)", ylabel="autocorrelation of the residual")


def _draw_hypotheses(axes: Axes, result: Result) -> None:
    """Draw sigma0 and Fc of all plausible hypotheses in their intervals."""
    log = result.logs[0]
    for fit in result.plausible.fits:
        axes.plot(*fit.value, "o", color=MEASURED, markersize=4)
    axes.plot(*result.chosen.value, "o", color=COMPUTED, markersize=7, label="chosen")
    if np.isfinite([result.sigma0.high, result.Fc.high]).all():
        axes.axvspan(result.sigma0.low, result.sigma0.high, color=COMPUTED, alpha=0.15)
        axes.axhspan(result.Fc.low, result.Fc.high, color=COMPUTED, alpha=0.15)
    axes.set(xlabel=f"sigma0 [{log.slope_unit}] of plausible hypotheses", ylabel=f"Fc [{log.unit}]")
    axes.legend(loc="best", fontsize=9)


def _draw_cycles(axes: Axes, result: Result, name: str, values: np.ndarray) -> None:
    """Draw sigma0 or Fc cycle by cycle with its interval."""
    p = getattr(result, name)
    if np.isfinite(p.high):
        axes.axhspan(p.low, p.high, color=COMPUTED, alpha=0.25)
    axes.axhline(p.value, color=COMPUTED, linewidth=1)
    axes.plot(np.arange(len(values)) + 1, values, "o", color=MEASURED, ms=4)
    axes.set(
        xlabel="cycle (shaded: 95 % of the whole log)", ylabel=f"{name} [{result.units[name]}]"
    )
