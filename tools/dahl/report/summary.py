# SPDX-License-Identifier: MIT
"""Read summary.json of a run and check its shape, since any program may have written it. Show its
numbers as text.

Unknown keys are kept. Each known key may be absent or null.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from dahl.errors import InputError
from dahl.io import files
from dahl.report import traces
from dahl.report.simulated import is_simulated, table

NUMBER, WORDS, NUMBERS, BINS = "a finite number", "a text", "an object of numbers", "pairs above 0"
SHAPE: dict[str, Any] = {
    "title": WORDS,
    "bus": WORDS,
    "time": WORDS,
    "date": WORDS,
    "version": WORDS,
    "command": WORDS,
    "units": {"sigma0": WORDS, "Fc": WORDS, "theta_per_count": WORDS},
    "scene_file": WORDS,
    "log": WORDS,
    "ticks": NUMBER,
    "frames_sent": NUMBER,
    "frames_lost": NUMBER,
    "frames_answered": NUMBER,
    "deadline_misses": NUMBER,
    "late_ticks": NUMBER,
    "late_answers": NUMBER,
    "max_error_ulp_Fc": NUMBER,
    "rmse_measured": NUMBER,
    "r2_measured": NUMBER,
    "realtime_factor": NUMBER,
    "parameters": NUMBERS,
    "control": NUMBERS,
    "node": NUMBERS,
    "answers_by_state": NUMBERS,
    "latency_us": {"p50": NUMBER, "p99": NUMBER, "max": NUMBER},
    "jitter_us": {"p50": NUMBER, "p99": NUMBER, "max": NUMBER},
    "latency_histogram": BINS,
    "faults": {"injected": NUMBERS, "expected": NUMBERS},
}
ROWS = {  # in this order: name, unit, format
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
MEASURED = {"latency_us", "jitter_us", "deadline_misses"}  # required with each histogram


def read(folder: Path) -> dict[str, Any]:
    """Return the summary of the run in a folder, without null values. Raises dahl.Error."""
    path = folder / "summary.json"
    known = files.read_json(path, "; `dahl demo` leaves one")
    if not (isinstance(known, dict) and (_has_scene_file(known) or is_simulated(known))):
        raise InputError(f"{path}: not the summary of a demo (no scene_file)")
    known = {"title": "a run"} | {key: value for key, value in known.items() if value is not None}
    _check(path, "", known, SHAPE)
    if "latency_histogram" in known and not MEASURED <= known.keys():
        raise InputError(f"{path}: latency_histogram without {', '.join(sorted(MEASURED))}")
    if is_simulated(known):
        table(known, path)  # raises if a number is missing
    return known


def rows(numbers: dict[str, Any]) -> Iterator[tuple[str, str]]:
    """Yield each name and its value with the unit; the units of the parameters come from the
    run.
    """
    units = numbers.get("units", {})
    units = units | {"rmse_measured": units.get("Fc", "")}
    for key, (name, unit, form) in ROWS.items():
        if numbers.get(key) is not None:
            yield name, f"{format(numbers[key], form)} {unit or units.get(key, '')}".strip()
    for name, text in traces.format_late(numbers).items():
        yield f"{name} later than a period", text
    for key, name in LATENCIES.items():
        if (numbers.get(key) or {}).get("max"):
            words = (f"{each} {value:.0f}" for each, value in numbers[key].items())
            yield name, ", ".join(words) + " µs"
    for name, value in numbers.get("parameters", {}).items():
        yield name, f"{value:.6g} {units.get(name, '')}".strip()


def _has_scene_file(known: dict[str, Any]) -> bool:
    return isinstance(known.get("scene_file"), str)


def _check(path: Path, where: str, known: dict[str, Any], shape: dict[str, Any]) -> None:
    """Raise dahl.Error for the first key whose value has another shape."""
    for key, wanted in ((key, wanted) for key, wanted in shape.items() if key in known):
        name, value = f"{where}{key}", known[key]
        if isinstance(wanted, dict):
            if not isinstance(value, dict) or wanted.keys() - value.keys():
                raise InputError(f"{path}: {name}: an object with {', '.join(wanted)} was expected")
            _check(path, f"{name}.", value, wanted)
        elif not _has_shape(value, wanted):
            raise InputError(f"{path}: {name} = {str(value)[:40]}: {wanted} was expected")


def _has_shape(value: Any, wanted: str) -> bool:
    if wanted == WORDS:
        return isinstance(value, str)
    if wanted == NUMBER:
        return _is_number(value)
    if wanted == NUMBERS:
        return isinstance(value, dict) and all(map(_is_number, value.values()))
    return isinstance(value, list) and all(
        isinstance(pair, list) and len(pair) == 2 and all(_is_number(x) and x >= 0 for x in pair)
        for pair in value
    )


def _is_number(value: Any) -> bool:
    """Finite, also as a float: an int may be too large for one."""
    return isinstance(value, (int, float)) and abs(value) < 1e300
