# SPDX-License-Identifier: MIT
"""Draw loop.png: torque over angle, then over time. Each of measured and computed has a colour."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from dahl.facts import PERIOD_US
from dahl.io import files, readers
from dahl.report import other_laws, traces
from dahl.sim.replay import Recorded
from dahl.sim.scene import Scene

MEASURED, COMPUTED, MARK, MISSING = "#7c8b9c", "#d1495b", "#e9a23b", "#3d7ea6"
OTHER_LAWS = MISSING, MARK  # slip elements, sign of the speed
STYLE: Any = {  # rcParams of matplotlib; rc_context() refuses a dict[str, object]
    "font.size": 11,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#e3e6ea",
    "grid.linewidth": 0.8,
    "axes.axisbelow": True,
    "legend.frameon": False,
    "figure.facecolor": "white",
}
WINDOW_SHARE = 0.08  # of the run, enlarged in the last panel
WIDTH, ABOVE, BELOW, BETWEEN = (
    11.0,
    1.6,
    0.65,
    0.9,
)  # inches: width; space above, below, between panels
LEFT, RIGHT = 1.0, 0.35  # inches: margins
LOOP, TRACE = 4.9, 2.0  # inches: height of the loop, of each panel below it


def draw(
    path: Path,
    scene: Scene,
    trace: traces.Trace,
    recorded: Recorded | None,
    numbers: dict[str, Any] | None = None,
    folder: Path | None = None,
) -> None:
    """Write the picture of a run. `numbers`: its summary; `folder`: its files, if they are not in
    the folder of the picture. The old picture stays until the new one is complete.
    """
    numbers = numbers or {}
    measured = (
        recorded.torque[trace.row] if recorded is not None and recorded.torque is not None else None
    )
    computed = traces.modelled_torque(scene, trace)
    time, time_label = _time(trace, recorded)
    gain = f"gain {scene.friction.get('gain', 1):g}" if scene.compensates else ""
    more = _optional_panels(numbers, folder or path.parent, gain)
    with rc_context(STYLE):
        figure = Figure()
        panels = _stack_panels(figure, (LOOP, TRACE, TRACE, *(TRACE for _ in more)))
        loop, whole, part = panels[:3]
        _draw_loop(loop, scene, trace, measured, computed, _name(scene, numbers, gain))
        for axes, where in ((whole, slice(None)), (part, _window(computed))):
            shown = None if measured is None else measured[where]
            _panel(axes, time[where], shown, computed[where], "")
            _mark_events(axes, trace, time, where)
            axes.set(xlabel=time_label, ylabel=escape(_short_label(scene.measured.label_torque)))
            axes.margins(x=0.01)
        part.set_title("a part of it, enlarged", loc="left", fontsize=10, color="#555555")
        for axes, panel in zip(panels[3:], more, strict=True):
            panel(axes)
        _draw_header(figure, loop, escape(scene.title), escape(_caption(scene, trace, numbers)))
        save(figure, path)


def _stack_panels(figure: Figure, heights: tuple[float, ...]) -> list[Axes]:
    """Return panels of these heights in inches, one below the other, with space for labels."""
    whole = ABOVE + sum(heights) + BETWEEN * (len(heights) - 1) + BELOW
    figure.set_size_inches(WIDTH, whole)
    grid = figure.add_gridspec(
        len(heights),
        1,
        height_ratios=heights,
        left=LEFT / WIDTH,
        right=1 - RIGHT / WIDTH,
        top=1 - ABOVE / whole,
        bottom=BELOW / whole,
        hspace=BETWEEN * len(heights) / sum(heights),
    )
    return [figure.add_subplot(grid[row]) for row in range(len(heights))]


def _draw_header(figure: Figure, loop: Axes, title: str, caption: str) -> None:
    """Write title, caption and legend in separate lines above the loop."""
    height = figure.get_size_inches()[1]
    figure.suptitle(
        title, fontsize=15, fontweight="bold", x=0.01, y=1 - 0.2 / height, ha="left", va="top"
    )
    loop.set_title(caption, loc="left", fontsize=10, color="#555555", pad=56)
    loop.legend(
        loc="lower left", bbox_to_anchor=(0, 1.005), ncols=2, borderaxespad=0.3, handlelength=1.6
    )


def _mark_events(axes: Axes, trace: traces.Trace, time: np.ndarray, where: slice) -> None:
    """Mark new starts after a fault and relaxing Resets by lines, unanswered ticks by short
    strokes. The first tick, a new start in every run, is not marked.
    """
    later = np.arange(len(time)) > 0
    skipped = np.diff(trace.row, prepend=trace.row[:1]) > 1
    _strokes(axes, time[where][skipped[where]], "no answer just before", 0.08, "-", MISSING)
    started = trace.fresh & later & ~trace.relaxed
    _strokes(axes, time[where][started[where]], "new start", 1.0, "--")
    relaxed = trace.relaxed & later
    _strokes(axes, time[where][relaxed[where]], "restart, relaxed", 1.0, "-")
    if axes.collections:
        handles = list(axes.collections)
        axes.legend(handles=handles, loc="lower right", bbox_to_anchor=(1, 1), ncols=3, fontsize=9)


def _strokes(
    axes: Axes,
    times: np.ndarray,
    name: str,
    height: float,
    style: Literal["-", "--"],
    color: str = MARK,
) -> None:
    """Draw a stroke at each time, over this share of the height of the panel."""
    if len(times):
        words = f"{name} ({len(times)})"
        drawn = axes.vlines(times, 0, height, colors=color, linestyles=style, label=words)
        drawn.set(transform=axes.get_xaxis_transform(), linewidth=1, zorder=0)


def _caption(scene: Scene, trace: traces.Trace, numbers: dict[str, Any]) -> str:
    """Return parameters, length, bus and fit of a run as one line."""
    units = scene.measured.units
    words = f"sigma0 = {scene.sigma0:g} {units['sigma0']}, Fc = {scene.Fc:g} {units['Fc']}"
    words += f", {len(trace.row)} ticks"
    words += f" over {numbers['bus']}" if "bus" in numbers else ""
    offset = scene.measured.offset
    return words + (f", offset {offset:g} {units['Fc']}" if offset else "")


def _optional_panels(
    numbers: dict[str, Any], folder: Path, gain: str
) -> list[Callable[[Axes], None]]:
    """Return the panels that only some runs have: latencies, faults, tracking error."""
    panels = []
    if numbers.get("latency_histogram") and numbers["latency_us"]["max"] > 0:
        panels.append(lambda axes: _latencies(axes, numbers))
    if "faults" in numbers:
        panels.append(lambda axes: _faults(axes, numbers))
    if "control" in numbers and (folder / "trace.csv").is_file():
        panels.append(lambda axes: _tracking(axes, folder, gain))
    return panels


def _latencies(axes: Axes, numbers: dict[str, Any]) -> None:
    edges, counts = np.array(numbers["latency_histogram"]).T
    axes.bar(edges, counts, width=-edges / 33, align="edge", color=COMPUTED)
    axes.axvline(PERIOD_US, color=MEASURED, linewidth=1)
    axes.set(xlabel="latency of an answer [µs]; the line is one period", ylabel="answers")
    axes.set(xscale="log", yscale="log")
    quantiles, jitter = numbers["latency_us"], numbers["jitter_us"]
    words = f"p50 {quantiles['p50']:.0f} µs, p99 {quantiles['p99']:.0f} µs, jitter p99"
    words += f" {jitter['p99']:.0f} µs"
    words += "".join(f", {text} {name} late" for name, text in traces.format_late(numbers).items())
    axes.set_title(words, loc="left", fontsize=10, color="#555555")


def _faults(axes: Axes, numbers: dict[str, Any]) -> None:
    injected = numbers["faults"]["injected"]
    names = [escape(traces.words(name)) for name in injected]
    bars = axes.bar(names, list(injected.values()), color=COMPUTED)
    axes.bar_label(bars, fmt="%d", fontsize=9)
    axes.set(ylabel="faults injected", yscale="symlog", ymargin=0.15)
    axes.tick_params(axis="x", labelsize=9)
    wrong = {traces.words(name): pair for name, pair in traces.disagreements(numbers).items()}
    words = "every one counted by the node" if not wrong else f"counted, due: {wrong}"
    axes.set_title(escape(words), loc="left", fontsize=10, color="#555555")


def _tracking(axes: Axes, folder: Path, gain: str) -> None:
    """Draw the tracking error, and that of the run without compensation."""
    time, error = _tracking_error(folder / "trace.csv")
    axes.plot(time, error, color=COMPUTED, linewidth=1.2, label=gain)
    axes.set(xlabel="time [s]", ylabel="tracking error [rad]")
    axes.margins(x=0.01)
    if not (gain and (folder / traces.UNCOMPENSATED).is_file()):
        return
    time, plain = _tracking_error(folder / traces.UNCOMPENSATED)
    axes.plot(time, plain, color=MEASURED, linewidth=1.2, label="gain 0: without compensation")
    rms, more = (float(np.sqrt(np.mean(one**2))) for one in (error, plain))
    words = f"rms {rms:.3g} rad, without compensation {more:.3g} rad"
    words += f" ({more / rms:.3g} times as large)" if rms else ""
    axes.set_title(words, loc="left", fontsize=10, color="#555555")
    axes.legend(loc="lower right", bbox_to_anchor=(1, 1), ncols=2, fontsize=9)


def _tracking_error(trace: Path) -> tuple[np.ndarray, np.ndarray]:
    """Return time in s and tracking error in rad of the trace of a rotor."""
    names = ("time_s", "reference_rad", "angle_rad")
    _, table = readers.read_columns(trace, {name: name for name in names})
    return table["time_s"], table["reference_rad"] - table["angle_rad"]


def _panel(
    axes: Axes, x: np.ndarray, measured: np.ndarray | None, computed: np.ndarray, name: str
) -> None:
    if measured is not None:
        axes.plot(x, measured, color=MEASURED, linewidth=1.1, label="measured")
    axes.plot(x, computed, color=COMPUTED, linewidth=1.4, label=name)


def _draw_loop(
    axes: Axes,
    scene: Scene,
    trace: traces.Trace,
    measured: np.ndarray | None,
    computed: np.ndarray,
    name: str,
) -> None:
    """Draw the torque over the angle, with other laws or with the equations of the paper."""
    angle = trace.angle(scene) * scene.measured.angle_scale
    _panel(axes, angle, measured, computed, name)
    if measured is not None and not scene.compensates:
        laws = other_laws.fitted(scene, trace, measured)
        for law, color in zip(laws, OTHER_LAWS, strict=False):
            words = f"{law.name}, fitted: R² {law.r2:.4f}"
            axes.plot(angle, law.torque, color=color, linewidth=1.0, label=words)
    if scene.file.text("motion", "kind") == "segments" and scene.model == "dahl":
        label_arcs(axes, angle, computed)
    axes.set(
        xlabel=escape(scene.measured.label_angle),
        ylabel=escape(scene.measured.label_torque),
    )


def _name(scene: Scene, numbers: dict[str, Any], gain: str) -> str:
    """Return what the computed line is, with its fit."""
    words = f"{scene.model}, as received over the bus" + f", {gain}" * bool(gain)
    fit = numbers.get("r2_measured")
    return words if fit is None else f"{words}: R² {fit:.4f}"


def label_arcs(axes: Axes, angle: np.ndarray, torque: np.ndarray) -> None:
    """Write the equations of the paper at its arcs: forward from rest, back, forward again."""
    moves = np.diff(angle)
    turns = np.flatnonzero(np.diff(np.sign(moves[moves != 0]))) + 1
    arcs = np.split(np.flatnonzero(moves), turns)
    for arc, name, share in zip(arcs, ("Eq. 7", "Eq. 18", "Eq. 27"), (0.5, 0.5, 0.3), strict=False):
        place, outside = arc[int(share * len(arc))], name == "Eq. 27"
        axes.annotate(
            name,
            (angle[place], torque[place]),
            xytext=(-8, 4) if outside else (8, -4),
            textcoords="offset points",
            ha="right" if outside else "left",
            va="bottom" if outside else "top",
        )


def _time(trace: traces.Trace, recorded: Recorded | None) -> tuple[np.ndarray, str]:
    if recorded is not None and recorded.time is not None:
        return recorded.time[trace.row], "time in the log [s]"
    return trace.time - trace.time[0], "time on the bus [s]"


def _window(torque: np.ndarray) -> slice:
    """Return the window in which the torque changes most, of at least 200 ticks if possible."""
    width = min(max(int(len(torque) * WINDOW_SHARE), 200), len(torque))
    moved = np.concatenate(([0.0], np.cumsum(np.abs(np.diff(torque)))))
    start = int(np.argmax(moved[width - 1 :] - moved[: len(torque) - width + 1]))
    return slice(start, start + width)


def _short_label(label: str) -> str:
    """Return the label without its first words: 'friction torque [N m]' gives 'torque [N m]'."""
    words, _, unit = label.partition(" [")
    return f"{words.split()[-1] if words.split() else ''} [{unit}" if unit else label


PICTURES = (".png", ".svg", ".pdf", "")  # endings; "" means PNG


def escape(text: str) -> str:
    """Return a text for matplotlib in which a dollar sign does not start a formula."""
    return text.replace("$", r"\$")


def save(figure: Figure, path: Path) -> None:
    """Write a picture in the format of its ending. The old one stays until the new one is
    complete.
    """
    with files.replace_atomic(path) as part:
        figure.savefig(part, dpi=130, format=path.suffix[1:].lower() or "png")
