# SPDX-License-Identifier: MIT
"""Draw docs/pictures/arcs.png: the three arcs of the paper, each with its equation."""

import dahl
import numpy as np
from dahl.paths import ROOT
from dahl.report import plots
from matplotlib import rc_context
from matplotlib.figure import Figure

SIGMA0, FC = 50.0, 0.5  # N m/rad, N m
TURNS = (0.0, 0.02, -0.01, 0.03)  # rad: theta0, theta1, theta2, and the end


def main() -> None:
    theta = np.concatenate([np.linspace(*pair) for pair in zip(TURNS, TURNS[1:], strict=False)])
    torque = dahl.Friction(dahl.Plan(SIGMA0, FC)).run_path(theta)
    with rc_context(plots.STYLE):
        figure = Figure(figsize=(7, 4.4), layout="constrained")
        axes = figure.add_subplot()
        axes.plot(theta, torque, color=plots.COMPUTED)
        plots.label_arcs(axes, theta, torque)
        for sign in (-1, 1):
            axes.axhline(sign * FC, color=plots.MEASURED, linewidth=1, linestyle=":")
        axes.set(xlabel="theta [rad]", ylabel="F [N m]")
        axes.text(TURNS[3], FC, "Fc", ha="right", va="bottom")
        axes.plot([0, FC / SIGMA0], [0, FC], color=plots.MEASURED, linewidth=1)
        axes.text(0.0095, 0.5, "slope sigma0", ha="right", va="bottom")
        plots.save(figure, ROOT / "docs/pictures/arcs.png")


main()
