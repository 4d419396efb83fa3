# SPDX-License-Identifier: MIT
"""The page of `dahl report`: html_report.html filled with the numbers of a run. Jinja2 escapes all
that comes from them.
"""

from __future__ import annotations

import base64
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import jinja2

from dahl import report

NUMBERS = {  # of the summary, in the order of the page: name, unit, format
    "bus": ("bus", "", "s"),
    "time": ("time", "", "s"),
    "ticks": ("ticks", "ms", ".0f"),
    "frames_sent": ("angles sent", "", ".0f"),
    "frames_lost": ("angles without an answer", "", ".0f"),
    "deadline_misses": ("answers later than a period", "", ".0f"),
    "max_error_ulp_Fc": ("largest error against the exact torque", "ulp of Fc", ".3f"),
    "rmse_measured": ("rms error against the measurement", "", ".4g"),
    "r2_measured": ("R² against the measurement", "", ".4f"),
    "bus_load": ("bus load", "", ".1%"),
    "realtime_factor": ("times real time", "", ".1f"),
}
WIDTH, HEIGHT = 900, 180  # of the histogram


def page(numbers: dict[str, Any], picture: bytes) -> str:
    """The whole page. `numbers`: as dahl.summary.read() gives them; `picture`: loop.png."""
    folder = jinja2.FileSystemLoader(Path(__file__).parent)
    room = jinja2.Environment(loader=folder, autoescape=True, trim_blocks=True)
    room.filters["words"] = lambda name: name.replace("_", " ")
    room.filters["number"] = lambda value: f"{value:.6g}"
    return room.get_template("html_report.html").render(
        run=numbers,
        picture=base64.b64encode(picture).decode("ascii"),
        rows=dict(_numbers(numbers)),
        wrong=report.disagreements(numbers) if "faults" in numbers else {},
        bars=list(_bars(numbers)),
        width=WIDTH + 10,
        height=HEIGHT,
    )


def _numbers(numbers: dict[str, Any]) -> Iterator[tuple[str, str]]:
    for key, (name, unit, form) in NUMBERS.items():
        if numbers.get(key) is not None:
            yield name, f"{format(numbers[key], form)} {unit}".strip()
    for name, value in numbers.get("parameters", {}).items():
        yield name, f"{value:.6g}"


def _bars(numbers: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """A bar for each latency, on two logarithmic scales; none where no time was measured."""
    bins = numbers.get("latency_histogram")
    if not bins or numbers["latency_us"]["max"] <= 0:
        return
    low, high = math.log(max(bins[0][0], 1e-3) / 1.1), math.log(max(bins[-1][0], 1e-3) * 1.1)
    top = math.log1p(max(1, *(count for _, count in bins)))
    for edge, count in bins:
        x = WIDTH * (math.log(max(edge, 1e-3)) - low) / (high - low)
        tall = HEIGHT * math.log1p(count) / top
        words = f"up to {edge:.0f} us: {count:.0f}"
        yield {"x": f"{x:.1f}", "y": f"{HEIGHT - tall:.1f}", "tall": f"{tall:.1f}", "words": words}
