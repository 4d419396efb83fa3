# SPDX-License-Identifier: MIT
"""Make the page of `dahl report`: page.html, filled with the numbers of a run. Jinja2 escapes
them.
"""

from __future__ import annotations

import base64
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import jinja2

from dahl.report import traces
from dahl.report.simulated import Table

NUMBERS = {  # of the summary, in the order of the page: name, unit, format
    "bus": ("bus", "", "s"),
    "time": ("time", "", "s"),
    "ticks": ("ticks of 1 ms", "", ".0f"),
    "frames_sent": ("frames sent", "", ".0f"),
    "frames_lost": ("frames without an answer", "", ".0f"),
    "max_error_ulp_Fc": ("largest error against the exact torque", "ulp of Fc", ".3f"),
    "rmse_measured": ("rms error against the measurement", "", ".4g"),
    "r2_measured": ("R² against the measurement", "", ".4f"),
    "realtime_factor": ("times real time", "", ".1f"),
}
LATENCIES = {"latency_us": "latency of an answer", "jitter_us": "jitter"}


def page(numbers: dict[str, Any], picture: bytes, table: Table | None = None) -> str:
    """Return the page. `numbers`: from dahl.report.summary.read(); `picture`: bytes of a PNG;
    `table`: of a scene without dahl-loop.
    """
    folder = jinja2.FileSystemLoader(Path(__file__).parent)
    room = jinja2.Environment(loader=folder, autoescape=True, trim_blocks=True)
    room.filters["words"] = traces.words
    room.filters["number"] = lambda value: str(value) if isinstance(value, int) else f"{value:.6g}"
    return room.get_template("page.html").render(
        run=numbers,
        picture=base64.b64encode(picture).decode("ascii"),
        rows=dict(_numbers(numbers)),
        simulated=table,
        wrong=traces.disagreements(numbers) if "faults" in numbers else {},
        made=_origin(numbers),
    )


def _origin(numbers: dict[str, Any]) -> str:
    """Return date and version of the run, as far as the summary has them."""
    words = [numbers.get("date", ""), "dahl " + numbers["version"] if "version" in numbers else ""]
    return ", ".join(word for word in words if word)


def _numbers(numbers: dict[str, Any]) -> Iterator[tuple[str, str]]:
    """Yield each name and its value with the unit; the units of the parameters come from the
    run.
    """
    units = numbers.get("units", {})
    units = units | {"rmse_measured": units.get("Fc", "")}
    for key, (name, unit, form) in NUMBERS.items():
        if numbers.get(key) is not None:
            yield name, f"{format(numbers[key], form)} {unit or units.get(key, '')}".strip()
    for name, text in traces.format_late(numbers).items():
        yield f"{name} later than a period", text
    for key, name in LATENCIES.items():
        if numbers.get(key, {}).get("max"):
            words = (f"{each} {value:.0f}" for each, value in numbers[key].items())
            yield name, ", ".join(words) + " µs"
    for name, value in numbers.get("parameters", {}).items():
        yield name, f"{value:.6g} {units.get(name, '')}".strip()
