# SPDX-License-Identifier: MIT
"""Draw pictures of docs/pictures: scenes of the demo, arcs of the paper, block diagrams.

Default: all; example: pictures.py arcs commission. The demo must be built (tools/demo.sh).
loop.png shows latencies: draw it on an idle machine.
"""

import argparse
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import dahl
import numpy as np
from dahl.paths import ROOT
from dahl.report import plots
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Rectangle

PICTURES = ROOT / "docs/pictures"
SCENES = {  # picture: options of `dahl demo`, its picture
    "loop": ((), "loop"),
    "fault-storm": (("--scene", "fault-storm"), "loop"),
    "creep": (("--scene", "creep"), "loop"),
    "park-steer": (("--scene", "park-steer"), "park-steer"),
    "compensation": (("--scene", "compensation"), "compensation"),
    "commission": (("--scene", "commission"), "commission"),
}
SIGMA0, FC = 50.0, 0.5  # N m/rad, N m
TURNS = (0.0, 0.02, -0.01, 0.03)  # rad: theta0, theta1, theta2, and the end
Point = tuple[float, float]


def draw_scene(name: str) -> None:
    words, picture = SCENES[name]
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run(
            [Path(sys.executable).with_name("dahl"), "demo", *words, "-o", folder], check=True
        )
        (PICTURES / f"{name}.png").write_bytes(Path(folder, f"{picture}.png").read_bytes())


def draw_arcs() -> None:
    """Draw the three arcs of the paper, each with its equation."""
    theta = np.concatenate([np.linspace(*pair) for pair in zip(TURNS, TURNS[1:], strict=False)])
    torque = dahl.Friction(dahl.Plan(SIGMA0, FC)).run_path(theta)
    figure = Figure(figsize=(plots.WIDTH, 4.4), layout="constrained")
    axes = figure.add_subplot()
    axes.plot(theta, torque, color=plots.COMPUTED)
    plots.label_arcs(axes, theta, torque)
    for sign in (-1, 1):
        axes.axhline(sign * FC, color=plots.MEASURED, linewidth=1, linestyle=":")
    axes.set(xlabel="theta [rad]", ylabel="F [N m]")
    axes.text(TURNS[3], FC, "Fc", ha="right", va="bottom")
    axes.plot([0, FC / SIGMA0], [0, FC], color=plots.MEASURED, linewidth=1)
    axes.text(0.0095, 0.5, "slope sigma0", ha="right", va="bottom")
    plots.save(figure, PICTURES / "arcs.png")


def block(axes: Axes, middle: Point, words: str, is_ours: bool = True, width: float = 1.3) -> None:
    """Draw a box. The first line of its words is its name."""
    name, _, text = words.partition("\n")
    x, y = middle
    colour = plots.COMPUTED if is_ours else plots.MEASURED
    look: Any = {"facecolor": "white", "edgecolor": colour, "linewidth": 1.5}
    axes.add_patch(Rectangle((x - width / 2, y - 0.38), width, 0.76, **look))
    axes.text(x, y + 0.2 * bool(text), name, ha="center", va="center", weight="bold")
    axes.text(x, y - 0.1, text, ha="center", va="center", linespacing=1.1)


def arrow(axes: Axes, *way: Point, style: str = "-", words: str = "", at: Point = (0, 0)) -> None:
    """Draw a line with an arrow at its end, and its words at another place."""
    x, y = zip(*way, strict=True)
    look: Any = {"color": plots.WITHOUT, "linewidth": 1.1, "linestyle": style}
    axes.plot(x[:-1], y[:-1], **look)
    axes.annotate(
        "", way[-1], way[-2], arrowprops={"arrowstyle": "-|>", "shrinkA": 0, "shrinkB": 0, **look}
    )
    axes.text(*at, words)


def add(axes: Axes, middle: Point) -> None:
    """Draw a sum."""
    axes.add_patch(Circle(middle, 0.13, facecolor="white", edgecolor=plots.WITHOUT, zorder=3))
    axes.text(*middle, "+", ha="center", va="center_baseline", zorder=4)


def draw_measured_law(axes: Axes) -> None:
    block(axes, (0.75, 1.3), "move()\nfaults, speed,\nplay")
    block(axes, (2.4, 1.3), "element\nsigma0, Fc")
    block(axes, (4.05, 1.3), "torque()\ngain, fades,\nslew, limit")
    block(axes, (6.3, 1.3), "motor, axis", False, 1.1)
    add(axes, (5.25, 1.3))
    arrow(axes, (1.4, 1.3), (1.75, 1.3))
    arrow(axes, (3.05, 1.3), (3.4, 1.3), words="w", at=(3.15, 1.36))
    arrow(axes, (4.7, 1.3), (5.12, 1.3))
    arrow(axes, (5.38, 1.3), (5.75, 1.3))
    arrow(axes, (5.25, 2.1), (5.25, 1.43), words="your\ncommand", at=(5.32, 1.75))
    arrow(axes, (6.3, 2.1), (6.3, 1.68), words="hand", at=(6.37, 1.9))
    arrow(
        axes,
        (6.3, 0.92),
        (6.3, 0.45),
        (0.75, 0.45),
        (0.75, 0.92),
        words="counts of the encoder",
        at=(2.6, 0.52),
    )
    arrow(
        axes,
        (0.75, 1.68),
        (0.75, 1.95),
        (4.05, 1.95),
        (4.05, 1.68),
        style="--",
        words="speed, faults",
        at=(1.9, 2.02),
    )
    axes.set(ylim=(0.3, 2.3), title="Measured law: a hand or a wheel moves the axis")


def draw_reference_law(axes: Axes) -> None:
    block(axes, (2.4, 2.6), "element\nsigma0, Fc")
    block(axes, (4.05, 2.6), "torque()\ngain, fades,\nslew, limit")
    block(axes, (3.225, 3.8), "position loop\nof your drive", False, 2.95)
    block(axes, (2.4, 1.3), "move()\nfaults, speed")
    block(axes, (4.05, 1.3), "observer\nwhat the model\nlacks")
    block(axes, (6.3, 2.6), "motor, axis", False, 1.1)
    add(axes, (5.25, 2.6))
    axes.text(0.1, 3.2, "reference", va="center")
    arrow(axes, (0.85, 3.2), (1.2, 3.2), (1.2, 3.8), (1.75, 3.8))
    arrow(axes, (1.2, 3.2), (1.2, 2.6), (1.75, 2.6), words="move", at=(1.25, 2.66))
    arrow(axes, (3.05, 2.6), (3.4, 2.6), words="w", at=(3.15, 2.66))
    arrow(axes, (4.7, 2.6), (5.12, 2.6))
    arrow(axes, (4.7, 3.8), (5.25, 3.8), (5.25, 2.73))
    arrow(axes, (4.7, 1.3), (5.25, 1.3), (5.25, 2.47))
    arrow(axes, (5.38, 2.6), (5.75, 2.6))
    arrow(axes, (5.55, 2.6), (5.55, 0.7), (4.4, 0.7), (4.4, 0.92), words="command", at=(4.6, 0.76))
    arrow(
        axes,
        (3.05, 1.3),
        (3.25, 1.3),
        (3.25, 1.95),
        (4.05, 1.95),
        (4.05, 2.22),
        style="--",
        words="speed, faults",
        at=(3.3, 1.75),
    )
    arrow(
        axes, (6.3, 2.98), (6.3, 4.4), (3.225, 4.4), (3.225, 4.18), words="counts", at=(4.6, 4.46)
    )
    arrow(
        axes,
        (6.3, 2.22),
        (6.3, 0.4),
        (2.4, 0.4),
        (2.4, 0.92),
        words="counts of the encoder",
        at=(4.4, 0.46),
    )
    arrow(axes, (3.7, 0.4), (3.7, 0.92))
    axes.set(ylim=(0.3, 4.7), title="Reference law: the axis has a position loop")


def draw_laws() -> None:
    """Draw both laws of dahl_compensator.h as block diagrams."""
    figure = Figure(figsize=(plots.WIDTH, 7.2), layout="constrained")
    upper, lower = figure.subplots(2, height_ratios=(2.0, 4.4))
    for axes, draw in ((upper, draw_measured_law), (lower, draw_reference_law)):
        draw(axes)
        axes.set(xlim=(0, 7), aspect="equal")
        axes.axis("off")
    plots.save(figure, PICTURES / "laws.svg")


def main() -> None:
    drawn = {"arcs": draw_arcs, "laws": draw_laws}
    known = [*drawn, *SCENES]
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("names", nargs="*", metavar="NAME", help=", ".join(known))
    names = parser.parse_args().names
    if unknown := set(names) - set(known):
        parser.error(f"no picture {', '.join(sorted(unknown))}; known are {', '.join(known)}")
    os.environ.setdefault("SOURCE_DATE_EPOCH", "0")  # the date in laws.svg
    for name in names or known:
        with rc_context(plots.STYLE | {"svg.hashsalt": "dahl"}):
            drawn[name]() if name in drawn else draw_scene(name)


if __name__ == "__main__":
    main()
