# SPDX-License-Identifier: MIT
"""Draw loop.png: torque over angle, then over time. Each of measured and computed has a colour."""

from __future__ import annotations

import textwrap
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.legend import Legend

from dahl.facts import PERIOD_US
from dahl.io import can_logs, files, readers
from dahl.report import other_laws, traces
from dahl.sim.replay import Recorded
from dahl.sim.scene import Scene

MEASURED, COMPUTED, MARK, MISSING = "#7c8b9c", "#d1495b", "#e9a23b", "#3d7ea6"
WITHOUT = "#20262c"  # compensation
OTHER_LAWS = MISSING, MARK  # slip elements, sign of the speed
STYLE: Any = {  # rcParams of matplotlib; rc_context() refuses a dict[str, object]
    "font.size": 10,
    "axes.titlesize": 10,
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#e3e6ea",
    "grid.linewidth": 0.8,
    "axes.axisbelow": True,
    "figure.titlesize": 12,
    "figure.titleweight": "bold",
    "figure.facecolor": "white",  # also on a dark page
    "legend.fontsize": 9,
    "legend.frameon": False,
    "legend.handlelength": 1.6,
    "lines.linewidth": 1.2,
    "xtick.labelsize": 9,
    "ytick.labelsize": 9,
}
WIDTH, PIXELS = 7.0, 1400  # inches, pixels; on a phone of 400 px, 9 points are 7 px
TITLE_LETTERS, CAPTION_LETTERS = 62, 90  # that fit into this width
CAPTION: Any = {"fontsize": 9, "color": "#555555"}
LEGEND_ROW = 16.0  # points
LOOP, TRACE = 4.4, 2.0  # inches: height of the loop, of each panel below it
WINDOW_SHARE = 0.08  # of the run, enlarged in a panel
MAX_STROKES = 250  # in a panel
MAX_EFFECT = 0.01  # of Fc; a larger difference from the run without faults is counted


class Curve(NamedTuple):
    """A torque in N m (N) over the angle in rad (m) and over the time in s; shapes (n,)."""

    name: str
    angle: np.ndarray
    time: np.ndarray
    torque: np.ndarray
    color: str = MEASURED
    width: float = 1.1  # points


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
    numbers, folder = numbers or {}, folder or path.parent
    gain = f"gain {scene.friction.get('gain', 1):g}" if scene.compensates else ""
    time, time_label = _time(trace, recorded, trace.time[0])
    name, torque = _name(scene, numbers, gain), traces.modelled_torque(scene, trace)
    computed = Curve(name, trace.angle(scene), time, torque, COMPUTED, 1.4)
    beside, caption = _measured(computed, trace, recorded), _caption(scene, trace, numbers)
    if "faults" in numbers and (folder / traces.FAULTLESS).is_file():
        beside = _faultless(scene, trace, recorded, folder)
        caption += _share_of_equal(computed, beside, scene.Fc)
    curves = [beside, computed] if beside else [computed]
    over_time = partial(_draw_torque, scene=scene, trace=trace, curves=curves)
    panels: list[Callable[[Axes], None]] = [
        partial(_draw_loop, scene=scene, trace=trace, curves=curves, caption=caption),
        *[partial(_draw_angle, folder=folder)] * _shows_angle(scene, numbers, folder),
        partial(over_time, where=slice(None), label=time_label),
        partial(over_time, where=_window(torque), label=f"{time_label}, a part enlarged"),
        *_optional_panels(numbers, folder, gain),
    ]
    heights = [LOOP, *[TRACE] * (len(panels) - 1)]
    with rc_context(STYLE):
        figure = Figure(figsize=(WIDTH, sum(heights)), layout="constrained")
        grid = figure.subplots(len(panels), height_ratios=heights)
        for axes, panel in zip(grid, panels, strict=True):
            panel(axes)
        add_title(figure, scene.title)
        save(figure, path)


def add_title(figure: Figure, words: str) -> None:
    """Write the message of a picture above it."""
    figure.suptitle(escape(textwrap.fill(words, TITLE_LETTERS)), x=0.01, ha="left")


def add_legend(axes: Axes, columns: int) -> Legend:
    """Write the legend above a panel, in the order of drawing."""
    return axes.legend(
        loc="lower left", bbox_to_anchor=(0, 1), ncols=columns, borderaxespad=0.2, columnspacing=1
    )


def _measured(computed: Curve, trace: traces.Trace, recorded: Recorded | None) -> Curve | None:
    if recorded is None or recorded.torque is None:
        return None
    torque = recorded.torque[trace.row]
    return computed._replace(name="measured", torque=torque, color=MEASURED, width=1.1)


def _faultless(scene: Scene, trace: traces.Trace, recorded: Recorded | None, folder: Path) -> Curve:
    """Return the torque of the same run without faults, from its frames."""
    other = traces.trace_of(can_logs.read_candump(folder / traces.FAULTLESS), scene.node)
    moved = (other.count[0] - trace.count[0]) * float(np.float32(scene.theta_per_count))
    torque = traces.modelled_torque(scene, other) + scene.measured.spring * moved
    time, _ = _time(other, recorded, trace.time[0])
    return Curve("without faults", other.angle(scene) + moved, time, torque, width=3.0)


def _share_of_equal(computed: Curve, beside: Curve, Fc: float) -> str:  # noqa: N803
    effect = np.abs(computed.torque - np.interp(computed.time, beside.time, beside.torque))
    share = float(np.mean(effect <= MAX_EFFECT * Fc))
    near = f"within {100 * MAX_EFFECT:.0f} % of Fc of those without faults"
    return f"; {100 * share:.1f} % of the answers {near}"


def _shows_angle(scene: Scene, numbers: dict[str, Any], folder: Path) -> bool:
    """Return whether a torque, not a position loop, moved a rotor."""
    is_free = "rotor" in scene.parts and bool(numbers) and "control" not in numbers
    return is_free and (folder / "trace.csv").is_file()


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
        add_legend(axes, 3)


def _strokes(
    axes: Axes,
    times: np.ndarray,
    name: str,
    height: float,
    style: Literal["-", "--"],
    color: str = MARK,
) -> None:
    """Draw a stroke at each time, over this share of the height of the panel, unless they would
    be a solid band.
    """
    if 0 < len(times) <= MAX_STROKES:
        words = f"{name} ({len(times)})"
        drawn = axes.vlines(times, 0, height, colors=color, linestyles=style, label=words)
        drawn.set(transform=axes.get_xaxis_transform(), linewidth=1, zorder=0)


def _caption(scene: Scene, trace: traces.Trace, numbers: dict[str, Any]) -> str:
    """Return parameters, length, bus and offset of a run."""
    units = scene.measured.units
    words = f"sigma0 = {scene.sigma0:g} {units['sigma0']}, Fc = {scene.Fc:g} {units['Fc']}"
    words += f", {len(trace.row)} ticks"
    words += f" over {numbers['bus']}" if "bus" in numbers else ""
    offset = scene.measured.offset
    return words + (f", offset {offset:g} {units['Fc']} added" if offset else "")


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
    axes.xaxis.set_major_formatter("{x:g}")
    axes.yaxis.set_major_formatter("{x:g}")
    quantiles, jitter = numbers["latency_us"], numbers["jitter_us"]
    words = f"p50 {quantiles['p50']:.0f} µs, p99 {quantiles['p99']:.0f} µs, jitter p99"
    words += f" {jitter['p99']:.0f} µs"
    words += "".join(f", {text} {name} late" for name, text in traces.format_late(numbers).items())
    axes.set_title(textwrap.fill(words, CAPTION_LETTERS), **CAPTION)


def _faults(axes: Axes, numbers: dict[str, Any]) -> None:
    injected = numbers["faults"]["injected"]
    names = [escape(traces.words(name)) for name in injected]
    bars = axes.bar(range(len(names)), list(injected.values()), color=COMPUTED)
    axes.bar_label(bars, fmt="%d", fontsize=9)
    axes.set(ylabel="faults injected", yscale="symlog", ymargin=0.15)
    axes.yaxis.set_major_formatter("{x:g}")
    axes.set_xticks(range(len(names)), names, rotation=40, ha="right", rotation_mode="anchor")
    wrong = {traces.words(name): pair for name, pair in traces.disagreements(numbers).items()}
    words = "every one counted by the node" if not wrong else f"counted, due: {wrong}"
    axes.set_title(escape(words), **CAPTION)


def _tracking(axes: Axes, folder: Path, gain: str) -> None:
    """Draw the tracking error, and that of the run without compensation."""
    time, error = _tracking_error(folder / "trace.csv")
    axes.plot(time, error, color=COMPUTED, linewidth=1.2, label=gain)
    axes.set(xlabel="time [s]", ylabel="tracking error [rad]")
    axes.margins(x=0.01)
    if not (gain and (folder / traces.UNCOMPENSATED).is_file()):
        return
    time, plain = _tracking_error(folder / traces.UNCOMPENSATED)
    axes.plot(time, plain, color=WITHOUT, linewidth=1.2, label="gain 0: without compensation")
    rms, more = (float(np.sqrt(np.mean(one**2))) for one in (error, plain))
    words = f"rms {rms:.3g} rad, without compensation {more:.3g} rad"
    words += f" ({more / rms:.3g} times as large)" if rms else ""
    axes.set_title(words, pad=LEGEND_ROW + 4, **CAPTION)
    add_legend(axes, 2)


def _tracking_error(trace: Path) -> tuple[np.ndarray, np.ndarray]:
    """Return time in s and tracking error in rad of the trace of a rotor."""
    names = ("time_s", "reference_rad", "angle_rad")
    _, table = readers.read_columns(trace, {name: name for name in names})
    return table["time_s"], table["reference_rad"] - table["angle_rad"]


def _draw_angle(axes: Axes, folder: Path) -> None:
    """Draw the angle of a rotor that is free."""
    names = ("time_s", "angle_rad")
    _, table = readers.read_columns(folder / "trace.csv", {name: name for name in names})
    axes.plot(table["time_s"], table["angle_rad"], color=COMPUTED, linewidth=1.4)
    axes.set(xlabel="time [s]", ylabel="angle [rad]")
    axes.margins(x=0.01)


def _draw_torque(
    axes: Axes, scene: Scene, trace: traces.Trace, curves: list[Curve], where: slice, label: str
) -> None:
    """Draw the torque over the time of these answers."""
    time = curves[-1].time[where]
    for curve in curves:
        shown = (curve.time >= time.min()) & (curve.time <= time.max())
        x, y = curve.time[shown], curve.torque[shown]
        axes.plot(x, y, color=curve.color, linewidth=curve.width)
    _mark_events(axes, trace, curves[-1].time, where)
    axes.set(xlabel=label, ylabel=escape(_short_label(scene.measured.label_torque)))
    axes.margins(x=0.01)


def _draw_loop(
    axes: Axes, scene: Scene, trace: traces.Trace, curves: list[Curve], caption: str
) -> None:
    """Draw the torque over the angle, with other laws or with the equations of the paper."""
    scale = scene.measured.angle_scale
    for curve in curves:
        look: Any = {"color": curve.color, "linewidth": curve.width, "label": curve.name}
        axes.plot(curve.angle * scale, curve.torque, **look)
    computed = curves[-1]
    if curves[0].name == "measured" and not scene.compensates:
        laws = other_laws.fitted(scene, trace, curves[0].torque)
        for law, color in zip(laws, OTHER_LAWS, strict=False):
            words = f"{law.name}, fitted: R² {law.r2:.4f}"
            axes.plot(computed.angle * scale, law.torque, color=color, linewidth=0.8, label=words)
    if scene.file.text("motion", "kind") == "segments" and scene.model == "dahl":
        label_arcs(axes, computed.angle * scale, computed.torque)
    measured = scene.measured
    axes.set(xlabel=escape(measured.label_angle), ylabel=escape(measured.label_torque))
    rows = -(-len(add_legend(axes, 2).get_texts()) // 2)
    words = escape(textwrap.fill(caption, CAPTION_LETTERS))
    axes.set_title(words, pad=LEGEND_ROW * rows + 6, **CAPTION)


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


def _time(trace: traces.Trace, recorded: Recorded | None, start: float) -> tuple[np.ndarray, str]:
    """Return the time in the log, or on the bus since `start`, and its label."""
    if recorded is not None and recorded.time is not None:
        return recorded.time[trace.row], "time in the log [s]"
    return trace.time - start, "time on the bus [s]"


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
        size = PIXELS / figure.get_figwidth()
        figure.savefig(part, dpi=size, format=path.suffix[1:].lower() or "png")
