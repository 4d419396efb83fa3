# SPDX-License-Identifier: MIT
"""Draw cost against error for each core, and the growth of the error with the cost of sampling.

The background is white, so that pages with a dark theme show the same picture.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt  # noqa: E402  (the backend comes first)
from dahl.report.plots import STYLE  # noqa: E402
from matplotlib.axes import Axes  # noqa: E402
from matplotlib.figure import Figure  # noqa: E402
from results import CORES, Point, core_points, host_points, motions_of  # noqa: E402

OURS, RIVAL, FRONT = "#d1495b", "#5b6b7c", "#e9a3ac"
COLOURS = ["#d1495b", "#8f2d56", "#30638e", "#7c8b9c", "#3c896d", "#b07d2b"]
TITLES = {"m0": "Cortex-M0", "m3": "Cortex-M3", "m4f": "Cortex-M4F", "host": "this host"}
TOP, BOTTOM = 3.0, 1e-10  # drawn errors: diverging methods at the top, exact ones at the bottom
ULP = 2**-24
COUNTED = "instructions"  # unit of the cost on a core


def plain(title: str) -> str:
    return title.replace("`", "")


def drawn_error(point: Point) -> float:
    return min(max(point.worst(), BOTTOM), TOP)


def front(points: list[Point]) -> list[Point]:
    """Return the points that no other point beats in cost and error, cheapest first."""
    kept: list[Point] = []
    for point in sorted(points, key=lambda p: (p.mean_cost(), p.worst())):
        if not kept or point.worst() < kept[-1].worst():
            kept.append(point)
    return kept


def clusters(points: list[Point]) -> list[list[Point]]:
    """Group points that are too close for separate labels."""
    groups: list[list[Point]] = []
    for point in sorted(points, key=lambda p: (p.ours, drawn_error(p), p.mean_cost())):
        for group in groups:
            near = all(
                max(x, y) < limit * min(x, y)
                for x, y, limit in (
                    (group[-1].mean_cost(), point.mean_cost(), 1.6),
                    (drawn_error(group[-1]), drawn_error(point), 1.5),
                )
            )
            if near and group[0].ours == point.ours:
                group.append(point)
                break
        else:
            groups.append([point])
    return groups


def label(axes: Axes, group: list[Point], numbers: dict[str, int]) -> None:
    first = group[0]
    below = -13 if first.ours or first.worst() < 1e-7 else 6
    axes.annotate(
        " ".join(str(n) for n in sorted(numbers[point.title] for point in group)),
        (min(point.mean_cost() for point in group), drawn_error(first)),
        xytext=(-3, below),
        textcoords="offset points",
        fontsize=11,
        color=OURS if first.ours else RIVAL,
        fontweight="bold" if first.ours else "normal",
    )


def key(figure: Figure, titles: dict[str, bool]) -> None:
    """Write number and name of each method below the panels; ours are red."""
    from matplotlib import patches

    handles = [
        patches.Patch(color="none", label=f"{number}  {plain(title)}")
        for number, title in enumerate(titles, 1)
    ]
    legend = figure.legend(
        handles=handles, loc="outside lower center", ncols=4, fontsize=11, handlelength=0
    )
    for text, ours in zip(legend.get_texts(), titles.values(), strict=True):
        text.set_color(OURS if ours else RIVAL)


def panel(
    axes: Axes, points: list[Point], title: str, floor: float, numbers: dict[str, int]
) -> None:
    """Draw cost against error; ours are red."""
    line = front(points)
    axes.plot(
        [p.mean_cost() for p in line],
        [drawn_error(p) for p in line],
        color=FRONT,
        linewidth=3,
        drawstyle="steps-post",
        zorder=1,
    )
    for point in points:
        colour = OURS if point.ours else RIVAL
        marker = "^" if point.worst() > TOP else "o"
        axes.plot(point.mean_cost(), drawn_error(point), marker, color=colour, markersize=7)
    for group in clusters(points):
        label(axes, group, numbers)
    axes.axvline(floor, color="#999999", linestyle=":", linewidth=1.5)
    words = " plain copy" if title.startswith("host") else " load, multiply, store"
    axes.annotate(words, (floor, 5e-11), fontsize=10, color="#777777")
    axes.set(xscale="log", yscale="log")
    axes.set_ylim(BOTTOM / 4, TOP * 4)
    axes.set_title(title, loc="left", fontsize=12, fontweight="bold")


def pareto(
    target: dict[str, Any],
    host: dict[str, Any],
    shown: tuple[str, ...] = CORES,
    unit: str = COUNTED,
) -> Figure:
    cores = [core for core in shown if core in target]
    points = {core: core_points(target, host, core) for core in cores} | {"host": host_points(host)}
    titles = {point.title: point.ours for group in points.values() for point in group}
    titles = dict(sorted(titles.items(), key=lambda item: not item[1]))
    numbers = {title: number for number, title in enumerate(titles, 1)}
    lines = (len(cores) + 2) // 2
    with plt.rc_context(STYLE):
        figure, grid = plt.subplots(lines, 2, figsize=(13, 5.2 * lines + 2.6), layout="constrained")
        axes = list(grid.flat)
        for place, core in zip(axes, cores, strict=False):
            floor = min(ways["floor"] for ways in motions_of(target, core).values())
            panel(place, points[core], TITLES[core], floor, numbers)
            place.set_xlabel(f"{unit} a tick, mean over the hard motions")
        copied = min(ways["copy"] for ways in host["speed"].values())
        panel(axes[-1], points["host"], f"host: {host['cpu']}", copied, numbers)
        axes[-1].set_xlabel("ns a tick, mean over the hard motions")
        for place in axes[len(cores) : -1]:
            place.set_visible(False)  # of a core that was not counted
        for place in axes[::2]:
            place.set_ylabel("worst error of F/Fc (triangle: diverges)")
        key(figure, titles)
        figure.suptitle("Speed against error", fontsize=15, fontweight="bold", x=0.01, ha="left")
    return figure


GROWTH_TITLES = {
    "counts": "dahl_step_counts",
    "throughput_counts": "dahl_throughput_counts",
    "expm1f": "expm1f step",
    "expf": "1 - expf step",
    "anchored": "Eq. 18, anchored",
    "table_counts": "table of g, float state",
}


def growth_panel(axes: Axes, host: dict[str, Any]) -> None:
    for colour, way in zip(COLOURS, GROWTH_TITLES, strict=True):
        rows = [r for r in host["growth"] if r["way"] == way]
        ticks = sorted({r["ticks"] for r in rows})
        worst = [max(r["worst"] for r in rows if r["ticks"] == t) for t in ticks]
        style = "-" if way in ("counts", "throughput_counts") else "--"
        axes.plot(ticks, worst, style, color=colour, linewidth=2, label=GROWTH_TITLES[way])
    axes.axhline(0.52 * 2 * ULP, color="#999999", linestyle=":", linewidth=1.2)
    axes.annotate("0.52 ulp of Fc", (2e6, 0.55 * 2 * ULP), fontsize=8, color="#777777", va="bottom")
    axes.set(xscale="log", yscale="log", xlabel="ticks", ylabel="worst error of F/Fc so far")
    axes.set_title("Error over ticks, worst of five hard motions", loc="left", fontsize=12)
    axes.legend(fontsize=8.5, loc="upper left", bbox_to_anchor=(0.0, 0.86))


def sampling_panel(axes: Axes, target: dict[str, Any], host: dict[str, Any], unit: str) -> None:
    """Draw the cost per second on Cortex-M4F for an error of 1e-3, over the sampling rate."""
    from results import SOLVERS, parts_cost

    counted = motions_of(target, "m4f")["two_one_24"]
    rates = sorted({row["rate"] for row in host["rates"]})
    # A count is 1/2607 of 0.1 rad. Above 205 samples/s, no tick moves more than 8 counts.
    long_moves = motions_of(target, "m4f")["sine_12"]["counts_q30"]
    ours = [r * (counted["counts_q30"] if r > 205 else long_moves) for r in rates]
    axes.plot(rates, ours, "-", color=OURS, linewidth=2.5, label="dahl_step_counts_q30")
    for colour, solver in zip(COLOURS[2:], SOLVERS, strict=False):
        rows = [r for r in host["rates"] if r["way"] == f"{solver}_parts" and r["parts"] > 0]
        single = {"euler": "euler", "rk4": "rk4"}.get(solver, solver)
        costs = [
            r["rate"]
            * (counted[single] if r["parts"] == 1 else parts_cost(counted, solver, r["parts"]))
            for r in rows
        ]
        rates_of = [r["rate"] for r in rows]
        axes.plot(rates_of, costs, "--", color=colour, linewidth=1.8, label=SOLVERS[solver])
    axes.set(
        xscale="log",
        yscale="log",
        xlabel="samples a second; 1 Hz, 0.1 rad, a A = 20, 14-bit encoder",
        ylabel=f"{unit} a second, Cortex-M4F",
    )
    axes.set_title("Cost of an error of 1e-3 (ours: 1e-9)", loc="left", fontsize=12)
    axes.legend(fontsize=8.5)


def growth(target: dict[str, Any], host: dict[str, Any], unit: str = COUNTED) -> Figure:
    with plt.rc_context(STYLE):
        figure, (left, right) = plt.subplots(1, 2, figsize=(15, 5.5), layout="constrained")
        growth_panel(left, host)
        if "m4f" in target:
            sampling_panel(right, target, host, unit)
    return figure


def save(figure: Figure, path: Path) -> None:
    """Replace a picture by a complete one."""
    part = path.with_name(f".{os.getpid()}{path.name}")
    try:
        kind = path.suffix[1:]
        figure.savefig(part, format=kind, dpi=110, facecolor="white", metadata=plain_meta(path))
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)


def plain_meta(path: Path) -> dict[str, None]:
    return {"Date": None} if path.suffix == ".svg" else {}
