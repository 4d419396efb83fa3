# SPDX-License-Identifier: MIT
"""Draw the picture of an identification: the fit over the measurement, and the residual."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from dahl.identify.result import NAMES, Result
from dahl.report import plots
from dahl.report.plots import COMPUTED, MEASURED

MAX_LAG = 60  # samples of the autocorrelation
CORRELATED_SAMPLES = 20_000  # from the start
OUTLIER_WEIGHT = 0.5  # samples of less weight are marked
MARK = "#e9a23b"


def draw(path: Path, result: Result, title: str) -> None:
    """Write the picture; an old file stays until the new one is complete."""
    with rc_context(plots.STYLE):
        figure = Figure(figsize=(11, 14), layout="constrained")
        axes = figure.subplots(4, 2, height_ratios=(2.6, 1, 1, 1))
        loop = _merge(figure, axes[0])
        _draw_loop(loop, result)
        _draw_residual(axes[1], result)
        _draw_autocorrelation(axes[2, 0], result)
        _draw_hypotheses(axes[2, 1], result)
        _draw_cycles(axes[3], result)
        loop.set_title(
            plots.escape(result.verdict),
            loc="left",
            fontsize=10,
            color="#555555",
            wrap=True,
        )
        found = {name: f"{getattr(result, name).value:.4g} {result.units[name]}" for name in NAMES}
        numbers = ", ".join(f"{name} = {words}" for name, words in found.items())
        words = f"{plots.escape(title)}\n{result.hypothesis.friction.label}: {numbers}"
        figure.suptitle(words, fontsize=14, fontweight="bold", x=0.01, ha="left")
        plots.save(figure, path)


def _merge(figure: Figure, pair: np.ndarray) -> Axes:
    """Return one panel in the place of two."""
    place = pair[0].get_gridspec()[pair[0].get_subplotspec().rowspan.start, :]
    for axes in pair:
        axes.remove()
    merged: Axes = figure.add_subplot(place)
    return merged


def _angle(result: Result) -> tuple[np.ndarray, str]:
    """Return the angle of the samples from the start, and its label."""
    log = result.logs[0]
    size, unit = log.shown_in
    angle = result.samples.angles[result.hypothesis.angle]
    name = "position" if log.linear else "angle"
    return (angle - angle[0]) / size, f"{name} from the start [{unit}]"


def _draw_loop(axes: Axes, result: Result) -> None:
    """Draw torque over angle, measured and fitted; each piece is a line.

    The fit begins when the unknown torque at the start of a piece is forgotten.
    """
    angle, label = _angle(result)
    measured, log = result.samples.torque, result.logs[0]
    for k, rows in enumerate(result.samples.pieces):
        words = ("measured", f"fitted: {result.hypothesis.friction.label}") if k == 0 else ("", "")
        axes.plot(angle[rows], measured[rows], color=MEASURED, linewidth=1.1, label=words[0])
        start = rows.start + int(np.argmax(result.samples.used[rows] > 0))
        settled = slice(start, rows.stop)
        axes.plot(
            angle[settled], result.predicted[settled], color=COMPUTED, linewidth=1.4, label=words[1]
        )
    weight = result.samples.weight
    is_outlier = (weight > 0) & (weight < OUTLIER_WEIGHT)
    if is_outlier.any():
        label_outliers = f"outliers, {100 * is_outlier.mean():.1f} % of the samples"
        axes.plot(angle[is_outlier], measured[is_outlier], "x", color=MARK, label=label_outliers)
    kind = "force" if log.linear else "torque"
    axes.set(xlabel=label, ylabel=f"{kind} [{log.unit}]")
    axes.legend(loc="best", fontsize=9)


def _draw_residual(pair: np.ndarray, result: Result) -> None:
    """Draw the residual over angle and over speed; structure there is lack of fit."""
    log = result.logs[0]
    size, unit = log.shown_in
    angle, label = _angle(result)
    speed_label = f"speed [{unit}/{'s' if result.samples.timed else 'row'}]"
    speed = result.samples.speed / size * (1.0 if result.samples.timed else 1e-3)
    used = result.samples.used > 0
    for axes, x, words in ((pair[0], angle, label), (pair[1], speed, speed_label)):
        axes.plot(x[used], result.residual[used], ".", color=MEASURED, markersize=1.5)
        axes.axhline(0, color=COMPUTED, linewidth=1)
        axes.set(xlabel=words, ylabel=f"residual [{log.unit}]")


def _draw_autocorrelation(axes: Axes, result: Result) -> None:
    """Draw the autocorrelation of the residual, with the band of white noise."""
    x = (result.residual * (result.samples.used > 0))[:CORRELATED_SAMPLES]
    n = len(x)
    most = min(MAX_LAG, n // 4)
    power = float(x @ x) or 1.0
    lags = np.arange(1, most + 1)
    axes.bar(lags, [float(x[k:] @ x[:-k]) / power for k in lags], width=0.8, color=MEASURED)
    axes.axhspan(-1.96 / np.sqrt(n), 1.96 / np.sqrt(n), color=COMPUTED, alpha=0.25)
    axes.set(xlabel="lag [samples] (shaded: white noise)", ylabel="autocorrelation of the residual")


def _draw_hypotheses(axes: Axes, result: Result) -> None:
    """Draw sigma0 and Fc of all plausible hypotheses in their intervals."""
    log = result.logs[0]
    for fit in result.plausible.fits:
        axes.plot(*fit.value, "o", color=MEASURED, markersize=4)
    axes.plot(*result.chosen.value, "o", color=COMPUTED, markersize=7, label="chosen")
    ends = [(result.sigma0.low, result.sigma0.high), (result.Fc.low, result.Fc.high)]
    if np.isfinite(ends).all():
        axes.axvspan(*ends[0], color=COMPUTED, alpha=0.15)
        axes.axhspan(*ends[1], color=COMPUTED, alpha=0.15)
    axes.set(xlabel=f"sigma0 [{log.slope_unit}] of plausible hypotheses", ylabel=f"Fc [{log.unit}]")
    axes.legend(loc="best", fontsize=9)


def _draw_cycles(pair: np.ndarray, result: Result) -> None:
    """Draw sigma0 and Fc cycle by cycle with their intervals."""
    cycles = result.by_cycle()
    for axes, name in zip(pair, NAMES, strict=True):
        p = getattr(result, name)
        if np.isfinite(p.high):
            axes.axhspan(p.low, p.high, color=COMPUTED, alpha=0.25)
        axes.axhline(p.value, color=COMPUTED, linewidth=1)
        axes.plot(np.arange(len(cycles[name])) + 1, cycles[name], "o", color=MEASURED, ms=4)
        axes.set(xlabel="cycle (shaded: 95 % of the whole log)")
        axes.set_ylabel(f"{name} [{result.units[name]}]")
