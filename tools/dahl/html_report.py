# SPDX-License-Identifier: MIT
"""The page of `dahl report`: plain HTML with the picture inside, tables, and a histogram as SVG."""

from __future__ import annotations

import base64
import math
from collections.abc import Sequence
from html import escape
from typing import Any

from dahl import report

STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; margin: 2em auto; max-width: 62em; color: #222; }
h2 { margin-top: 2em; } img { width: 100%; }
table { border-collapse: collapse; } td, th { padding: .2em 1em .2em 0; text-align: left; }
td + td, th + th { text-align: right; } tr + tr td { border-top: 1px solid #e3e6ea; }
.wrong { color: #d1495b; font-weight: bold; } .note { color: #555; }
"""
NUMBERS = {  # of the summary, in the order of the page: name, unit, format
    "bus": ("bus", "", "s"),
    "time": ("time", "", "s"),
    "ticks": ("ticks", "ms", "d"),
    "frames_sent": ("angles sent", "", "d"),
    "frames_lost": ("angles without an answer", "", "d"),
    "deadline_misses": ("answers later than a period", "", "d"),
    "max_error_ulp_Fc": ("largest error against the exact torque", "ulp of Fc", ".3f"),
    "rmse_measured": ("rms error against the measurement", "", ".4g"),
    "r2_measured": ("R² against the measurement", "", ".4f"),
    "bus_load": ("bus load", "", ".1%"),
    "realtime_factor": ("times real time", "", ".1f"),
}
WIDTH, HEIGHT = 900, 180  # of the histogram


def page(numbers: dict[str, Any], picture: bytes) -> str:
    """The whole page. `numbers`: summary.json; `picture`: loop.png."""
    title = escape(str(numbers.get("title", "a run")))
    image = base64.b64encode(picture).decode("ascii")
    parts = [
        _section("numbers", "Numbers", _numbers(numbers)),
        _section("faults", "Faults", _faults(numbers)),
        _section("control", "Closed loop", _plain(numbers.get("control", {}))),
        _section("histogram", "Latency of an answer", _histogram(numbers)),
        _section("states", "What the node said of its input", _states(numbers)),
        _section("counters", "What the node counted", _plain(numbers.get("node", {}))),
    ]
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f"<title>{title}</title>\n<style>{STYLE}</style>\n</head>\n<body>\n<h1>{title}</h1>\n"
        '<img id="picture" alt="torque over angle, and over time"'
        f' src="data:image/png;base64,{image}">\n' + "".join(parts) + "</body>\n</html>\n"
    )


def _section(name: str, title: str, body: str) -> str:
    return f'<section id="{name}">\n<h2>{title}</h2>\n{body}\n</section>\n' if body else ""


def _table(head: tuple[str, ...], rows: Sequence[tuple[str, ...]]) -> str:
    """Cells are HTML."""
    lines = ["<tr>" + "".join(f"<th>{word}</th>" for word in head) + "</tr>"] if head else []
    lines += ["<tr>" + "".join(f"<td>{cell}</td>" for cell in row) + "</tr>" for row in rows]
    return "<table>\n" + "\n".join(lines) + "\n</table>" if rows else ""


def _numbers(numbers: dict[str, Any]) -> str:
    rows = []
    for key, (name, unit, form) in NUMBERS.items():
        if numbers.get(key) is not None:
            value = escape(format(numbers[key], form))
            rows.append((name, f"{value} {unit}".strip()))
    parameters = numbers.get("parameters", {})
    rows += [(escape(name), f"{value:.6g}") for name, value in parameters.items()]
    return _table((), rows)


def _plain(values: dict[str, Any]) -> str:
    rows = [(escape(name.replace("_", " ")), f"{value:.6g}") for name, value in values.items()]
    return _table((), rows)


def _states(numbers: dict[str, Any]) -> str:
    states = numbers.get("answers_by_state", {})
    return _table(("state", "answers"), [(escape(name), str(n)) for name, n in states.items()])


def _faults(numbers: dict[str, Any]) -> str:
    """What was injected, and beside each counter of the node what it had to become."""
    if "faults" not in numbers:
        return ""
    injected = _plain(numbers["faults"]["injected"])
    wrong = report.disagreements(numbers)
    rows = []
    for name, due in numbers["faults"]["expected"].items():
        counted = str(numbers.get("node", {}).get(name, 0))
        cell = f'<span class="wrong">{counted}</span>' if name in wrong else counted
        rows.append((escape(name.replace("_", " ")), str(due), cell))
    verdict = "Every fault was counted." if not wrong else "Not every fault was counted."
    counted = _table(("counter of the node", "due", "counted"), rows)
    return f"<p>{verdict}</p>\n{injected}\n<h3>Counters</h3>\n{counted}"


def _histogram(numbers: dict[str, Any]) -> str:
    bins = numbers.get("latency_histogram") or []
    if not bins or numbers["latency_us"]["max"] <= 0:
        return ""
    low, high = math.log(max(bins[0][0], 1e-3) / 1.1), math.log(bins[-1][0] * 1.1)
    top = math.log1p(max(count for _, count in bins))
    bars = []
    for edge, count in bins:
        x = WIDTH * (math.log(max(edge, 1e-3)) - low) / (high - low)
        tall = HEIGHT * math.log1p(count) / top
        words = f"up to {edge:.0f} us: {count:.0f}"
        bars.append(
            f'<rect x="{x:.1f}" y="{HEIGHT - tall:.1f}" width="6" height="{tall:.1f}"'
            f' fill="#d1495b"><title>{words}</title></rect>'
        )
    quantiles = ", ".join(f"{name} {value:.0f} us" for name, value in numbers["latency_us"].items())
    return (
        f'<p>{quantiles}; both scales are logarithmic</p>\n<svg viewBox="0 0 {WIDTH + 10} {HEIGHT}"'
        f' role="img">\n' + "\n".join(bars) + "\n</svg>"
    )
