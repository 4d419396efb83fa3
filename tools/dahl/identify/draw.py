# SPDX-License-Identifier: MIT
"""The picture of an identification: loops measured and fitted, residuals, and how sharply the cost
tells sigma0.
"""

from __future__ import annotations

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes

from dahl import plots
from dahl.identify.fit import dense_of, profile_of
from dahl.identify.result import Result
from dahl.plots import COMPUTED, MEASURED

POINTS = 20_000  # drawn of a long log


def draw(path: Path, result: Result) -> None:
    """Write the picture; the old one stays until the new one is whole."""
    log, estimate = result.logs[0], result.estimate
    predicted = result.predicted[0]
    some = slice(0, log.rows, max(log.rows // POINTS, 1))
    with plt.rc_context(plots.STYLE):
        figure = plt.figure(figsize=(11, 11), layout="constrained")
        loop, rest, cost = figure.subplots(3, 1, height_ratios=(2.4, 1, 1.2))
        angle = (log.theta - log.theta[0])[some]
        loop.plot(angle, log.torque[some], color=MEASURED, linewidth=1.1, label="measured")
        loop.plot(angle, predicted[some], color=COMPUTED, linewidth=1.4, label="fitted")
        kind = "force" if log.linear else "torque"
        loop.set(xlabel=f"angle from the start [{log.angle_unit}]", ylabel=f"{kind} [{log.unit}]")
        loop.legend(loc="upper left")
        x = np.arange(log.rows) if log.time is None else log.time
        rest.plot(x[some], (log.torque - predicted)[some], color=MEASURED, linewidth=0.8)
        rest.set(xlabel="row" if log.time is None else "time [s]", ylabel=f"residual [{log.unit}]")
        _profile(cost, result)
        loop.set_title(result.verdict.text, loc="left", fontsize=10, color="#555555")
        title = (
            f"sigma0 = {estimate.sigma0:.4g} {log.slope_unit}, Fc = {estimate.Fc:.4g} {log.unit}"
        )
        figure.suptitle(title, fontsize=15, fontweight="bold", x=0.01, ha="left")
        plots.save(figure, path)


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
