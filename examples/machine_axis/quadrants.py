# SPDX-License-Identifier: MIT
"""Build and run circle.c, print the table of docs/quadrants.md, and draw its picture.

Usage: python examples/machine_axis/quadrants.py [PICTURE], with CMake and a C compiler,
after pip install '.[plot]'
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from numpy.typing import NDArray

FEEDS = (0.3, 1.0, 3.0)  # m/min
FRICTIONS = {"dahl": "Dahl", "lugre": "LuGre, Stribeck 30 %"}
NONE, REVERSAL, DAHL, OBSERVER = "none", "reversal rule", "reference law", "with observer"
CASES = {  # LAW, FC in N m, LENGTH in um, SECONDS of circle.c
    NONE: ("none",),
    REVERSAL: ("reversal",),
    DAHL: ("dahl",),
    OBSERVER: ("observer",),
    "Fc 20 % low": ("observer", 0.8),
    "Fc 20 % high": ("observer", 1.2),
    "length 50 % long": ("observer", 1.0, 22.5),
}
BEST_SECONDS = {0.3: 0.15, 1.0: 0.045, 3.0: 0.015}  # of the reversal rule, for each feed
DRAWN = {NONE: "#1f2933", REVERSAL: "#3d7ea6", OBSERVER: "#d1495b"}
RADIUS_MM, MAGNIFIED = 25.0, 700.0


def build(folder: Path) -> Path:
    """Return the program of circle.c."""
    here = Path(__file__).parent
    for words in (("-S", here, "-B", folder), ("--build", folder)):
        subprocess.run(["cmake", *map(str, words)], check=True, stdout=subprocess.DEVNULL)
    return folder / "circle"


def errors(program: Path, *words: object) -> NDArray[np.float64]:
    """Return rows of the angle in degrees and the error of the radius in um, less its mean."""
    command = [str(program), *map(str, words)]
    text = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    angle, error = np.array([line.split() for line in text.splitlines()], float).T
    return np.column_stack((angle, error - error.mean()))


def largest(program: Path, *words: object) -> float:
    return float(np.abs(errors(program, *words)[:, 1]).max())


def table(program: Path) -> str:
    """Return the largest errors as Markdown."""
    rows = [f"| friction | feed | {' | '.join(CASES)} |", "|---|---|" + "---:|" * len(CASES)]
    for friction, name in FRICTIONS.items():
        for feed in FEEDS:
            found = [largest(program, feed, friction, *case) for case in CASES.values()]
            name_once = name if feed == FEEDS[0] else ""
            rows.append(f"| {name_once} | {feed:g} | {' | '.join(f'{x:.2f}' for x in found)} |")
    return "\n".join(rows)


def best_reversal(program: Path, friction: str) -> list[float]:
    """Return the largest errors of the reversal rule with the best time constant of each feed."""
    return [
        largest(program, feed, friction, "reversal", 1.0, 15, seconds)
        for feed, seconds in BEST_SECONDS.items()
    ]


def draw(program: Path, picture: Path) -> None:
    """Draw the circles of LuGre friction with magnified errors."""
    circles = {"projection": "polar"}
    figure, panels = plt.subplots(1, 3, figsize=(7, 3), subplot_kw=circles, layout="constrained")
    for panel, feed in zip(panels, FEEDS, strict=True):
        for case, colour in DRAWN.items():
            angle, error = errors(program, feed, "lugre", *CASES[case]).T
            way = RADIUS_MM + MAGNIFIED * 1e-3 * error
            panel.plot(np.radians(angle), way, color=colour, linewidth=1.3, label=case)
        ticks = np.array([-10, 10])  # um
        panel.set_rticks(RADIUS_MM + MAGNIFIED * 1e-3 * ticks, ["", "±10 µm"])
        panel.set_rlabel_position(45)
        panel.spines["polar"].set_visible(False)
        panel.set(title=f"{feed:g} m/min", ylim=(0, 36))
        panel.set_thetagrids((0, 90, 180, 270), ["", "", "", ""])
    handles, names = panels[0].get_legend_handles_labels()
    figure.legend(handles, names, loc="outside upper center", ncols=len(DRAWN), frameon=False)
    figure.savefig(picture, dpi=200)


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as made:
        circle = build(Path(made))
        print(table(circle))
        for one in FRICTIONS:
            found = ", ".join(f"{x:.2f}" for x in best_reversal(circle, one))
            print(f"{one}: reversal rule with the best time constant of each feed: {found}")
        if len(sys.argv) > 1:
            draw(circle, Path(sys.argv[1]))
