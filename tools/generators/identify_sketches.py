# SPDX-License-Identifier: MIT
"""Draw the sketches of docs/identify.md with the code of `dahl identify`.

docs/pictures/identify-laws.png    a loop of each friction law
docs/pictures/identify-lags.png    a slow and a fast loop of each lag
docs/pictures/identify-angles.png  the angle between counts, by three treatments
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from dahl.identify.angle import between_counts, with_sharp_turns
from dahl.identify.lags import LAGS
from dahl.identify.laws import LAWS
from dahl.identify.samples import Reference, Samples, samples_of
from dahl.io.log import Log
from dahl.paths import ROOT
from dahl.report import plots
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.optimize import least_squares

LENGTHS = 4.0  # presliding lengths from the middle to a turn
FAST, SLOW = 200, 2000  # rows of a stroke
LAWS_SHOWN: dict[str, tuple[str, list[float]]] = {  # title; ln a of each element and the shape
    "dahl": ("Dahl", [0]),
    "slip": ("1 slip element", [-0.4]),
    "3 slip": ("2 to 4 slip elements", [0.9, -0.2, -1.2]),
    "2 dahl": ("two Dahl elements", [1.2, -1.0]),
    "mixed": ("Dahl and slip mixed", [0.4, -1.0]),
    "exponent": ("general exponent", [0, 0.4]),
    "bouc-wen": ("Bouc-Wen", [0, 2.5]),
    "soft shaft": ("soft shaft", [0, 0.5]),
    "asymmetric": ("asymmetric", [0, 0.3]),
    "stribeck": ("Stribeck", [0, 0.8, np.log(0.7)]),
    "log speed": ("logarithm of speed", [0, 0.15]),
    "breakaway": ("breakaway after rests", [0, 1.0, np.log(3)]),
}
LAGS_SHOWN: dict[str, tuple[str, list[float], list[float]]] = {  # title; rows; parts of columns
    "none": ("none", [], []),
    "delay": ("delay", [16], []),
    "low pass": ("low pass", [16], []),
    "zero-phase filter": ("low pass, to and fro", [16], []),
    "damped low pass": ("low pass and damping", [16], [0.3, 0]),
    "delay+filter": ("delay, short filter", [10], [25, 0]),
    "damping": ("damping (sigma1)", [], [0.6]),
    "play": ("play", [np.log(0.8)], []),  # ln of presliding lengths
}


def strokes(rows: int, *, rest: bool = False, reference: Reference | None = None) -> Samples:
    """Return two cycles of smooth strokes, with a rest at each turn if asked for. `reference` has
    the speed in which columns are measured.
    """
    stroke = LENGTHS * np.sin(np.linspace(-np.pi / 2, np.pi / 2, rows))
    forward = np.append(stroke, np.full(rows // 3 if rest else 0, LENGTHS))
    theta = np.concatenate([forward, -forward, forward, -forward])
    log = Log("sketch", theta, 0 * theta, np.arange(len(theta)) * 1e-3)
    return samples_of([log], block=1, reference=reference)


def torque_of(
    samples: Samples, law: str, p: Sequence[float] | np.ndarray, lag: str = "none"
) -> np.ndarray:
    """Return F over Fc of a law behind a lag, each with its parameters in LAGS_SHOWN."""
    _, late, parts = LAGS_SHOWN.get(lag, ("", [], []))
    angle, sensor = "between counts", LAGS[lag]
    moves = sensor.moves(samples, samples.moves(samples.angles[angle]), angle, np.array(late))
    each = LAWS[law].ratios(samples, moves, np.array(p, dtype=float))
    shown = sensor.apply(samples, np.mean(each, axis=0), np.array(late))
    columns = sensor.derivatives(samples, shown)
    shown = shown + sum(part * column for part, column in zip(parts, columns, strict=True))
    return shown + p[1] if law == "asymmetric" else shown


def draw_loop(axes: Axes, samples: Samples, torque: np.ndarray, color: str, **style: Any) -> None:
    """Draw the second cycle: the first one begins at rest."""
    last = slice(samples.rows // 2, None)
    axes.plot(samples.angles["between counts"][last], torque[last], color=color, **style)


def draw_laws(figure: Figure) -> None:
    samples = strokes(FAST, rest=True)
    panels = figure.subplots(4, 3, sharex=True, sharey=True).flat
    for axes, (law, (title, p)) in zip(panels, LAWS_SHOWN.items(), strict=True):
        draw_loop(axes, samples, torque_of(samples, "dahl", [0]), plots.MEASURED, linewidth=1)
        draw_loop(axes, samples, torque_of(samples, law, p), plots.COMPUTED)
        name_panel(axes, title)


def draw_lags(figure: Figure) -> None:
    fast = strokes(FAST)
    slow = strokes(SLOW, reference=fast.reference)
    panels = list(figure.subplots(3, 3, sharex=True, sharey=True).flat)
    for axes, (lag, (title, _, _)) in zip(panels, LAGS_SHOWN.items(), strict=False):
        draw_loop(axes, slow, torque_of(slow, "dahl", [0], lag), plots.MEASURED, linewidth=1.2)
        draw_loop(axes, fast, torque_of(fast, "dahl", [0], lag), plots.COMPUTED)
        name_panel(axes, title)
    late = torque_of(fast, "dahl", [0], "low pass")

    def difference(p: np.ndarray) -> np.ndarray:
        off: np.ndarray = torque_of(fast, "soft shaft", p) - late
        return off

    soft = least_squares(difference, [-0.2, 0.3]).x
    draw_loop(panels[-1], fast, late, plots.COMPUTED)
    draw_loop(panels[-1], fast, torque_of(fast, "soft shaft", soft), "black", linestyle=":")
    name_panel(panels[-1], "low pass, soft shaft")


def name_panel(axes: Axes, title: str) -> None:
    axes.set_title(title, fontsize=11)
    axes.set(xticks=[0], yticks=[-1, 0, 1], xticklabels=[], yticklabels=["-Fc", "0", "Fc"])


def draw_angles(figure: Figure) -> None:
    rows = np.arange(-200.0, 201.0)
    step, part = np.divmod(rows, 40)  # a quick step of 1.3 counts, then a rest
    rests = 1.3 * np.abs(step + np.clip(part / 8 - 2, 0, 1))
    shown: list[tuple[str, np.ndarray, Callable[[np.ndarray, float], np.ndarray]]] = [
        ("smooth motion: between the counts", 5.4 - rows**2 / 1800, between_counts),
        ("strokes that end at speed: sharp turns", 5.4 - np.abs(rows) / 15, with_sharp_turns),
        ("steps and rests: as read", 5.4 - rests, lambda theta, _: theta),
    ]
    for axes, (title, true, treat) in zip(figure.subplots(3, 1, sharex=True), shown, strict=True):
        counts = np.round(true)
        axes.step(rows, counts, color=plots.MEASURED, linewidth=1, where="mid", label="counts")
        axes.plot(rows, treat(counts, 1.0), color=plots.COMPUTED, label="angle used")
        axes.plot(rows, true, "k:", label="shaft")
        axes.set(title=title, xlim=(-90, 90), ylim=(0, 7), yticks=range(0, 7, 2), ylabel="counts")
        axes.title.set_size(11)
    axes.set(xlabel="rows from the turn")
    figure.axes[0].legend(loc="upper right", ncols=3, fontsize=10)


def main() -> None:
    for draw, height in ((draw_laws, 7.6), (draw_lags, 5.7), (draw_angles, 6.4)):
        with rc_context(plots.STYLE):
            figure = Figure(figsize=(6.6, height), layout="constrained")
            draw(figure)
            name = draw.__name__.removeprefix("draw_")
            plots.save(figure, ROOT / f"docs/pictures/identify-{name}.png")


if __name__ == "__main__":
    main()
