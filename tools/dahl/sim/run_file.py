# SPDX-License-Identifier: MIT
"""Resolve a scene to the run file of dahl-loop, and its counters to a summary.

The run file, the counts of a replayed log and the counters are files in memory, which end with the
processes that have opened them.
"""

from __future__ import annotations

import math
import os
import re
import weakref
from pathlib import Path
from typing import Any

from dahl.facts import PERIOD_US
from dahl.io import data
from dahl.sim import replay
from dahl.sim.keys import KEYS
from dahl.sim.scene import Scene, element
from dahl.sim.scene_reader import Name, Value

OF_NODE = ("friction", "load", "status")  # sections of a run without an encoder
LINE = re.compile(r":(\d+): ")


class RunFile:
    """A scene as dahl-loop reads it. `fds` must be passed to its process.

    A run of role "node" has no encoder, so its log is not read. Raises dahl.Error.
    """

    def __init__(self, scene: Scene, log: Path | None = None, role: str = "both") -> None:
        self._scene = scene
        self.fds: list[int] = []
        weakref.finalize(self, _close_all, self.fds)
        values = dict(scene.file.values)
        if role == "node":
            values = {name: value for name, value in values.items() if name[0] in OF_NODE}
        elif scene.log:
            counts = replay.counts_of(scene, log or data.find_log(scene.log, scene.path.parent))
            values |= {("motion", "kind"): "counts", ("motion", "file"): self._in_memory(counts)}
        if "faults" in scene.parts and role != "node":
            values.setdefault(("faults", "drop"), 0.0)  # so that the section is there
        if scene.elements:
            element(scene)  # raises if the library refuses its parameters
        self.names = [name for name in values if not KEYS[name].is_of_scene]
        self.path = self._in_memory(text_of({name: values[name] for name in self.names}))
        self.counters = self._in_memory("")

    def _in_memory(self, text: str) -> str:
        """Return the path of a new file in memory."""
        fd = os.memfd_create("dahl-run", 0)
        self.fds.append(fd)
        with os.fdopen(os.dup(fd), "w", encoding="utf-8", errors="surrogateescape") as file:
            file.write(text)
        return f"/proc/self/fd/{fd}"

    def summary(self, bus: str, seed: int, is_virtual: bool) -> dict[str, Any]:
        """Return the summary of the run, {} if dahl-loop has written no counters."""
        text = Path(self.counters).read_text(encoding="ascii")
        return summary(text, self._scene, bus, seed, is_virtual) if text else {}

    def explain(self, message: str) -> str:
        """Return a message of dahl-loop with the place in the scene instead of the run file."""
        before, found, after = message.partition(self.path)
        line = LINE.match(after)
        if not found or not line:
            return message.replace(self.path, str(self._scene.path))
        place = self._scene.file.place(*self.names[int(line[1]) - 1])
        return f"{before}{place}: {after[line.end() :]}"


def _close_all(fds: list[int]) -> None:
    for fd in fds:
        os.close(fd)


def text_of(values: dict[Name, Value]) -> str:
    """Return the lines of a run file."""
    return "".join(f"{section}.{key} = {_text(one)}\n" for (section, key), one in values.items())


def _text(value: Value) -> str:
    if isinstance(value, tuple):
        return " ".join(map(_text, value))
    if isinstance(value, str):
        return " ".join(value.split())  # a value of a scene may have several lines
    return repr(value).removesuffix(".0")


# --- results --------------------------------------------------------------------------------------


def summary(text: str, scene: Scene, bus: str, seed: int, is_virtual: bool) -> dict[str, Any]:
    """Return the summary of a run from the counters that dahl-loop has written."""
    raw = dict(line.split(" = ", 1) for line in text.splitlines())
    found: dict[str, Any] = {
        "bus": bus,
        "scene": str(scene.path),
        "title": scene.file.text("scene", "title"),
        "time": "virtual" if is_virtual else "real",
        "seed": seed,
        "ticks": int(raw["ticks"]),
    }
    if "frames.sent" in raw:
        found |= _frames(raw)
    if "nodes" in raw:
        found |= {"nodes": int(raw["nodes"]), "node": _group(raw, "node.")}
    if "expected.ok" in raw:
        faults = {"injected": _group(raw, "injected."), "expected": _group(raw, "expected.")}
        found["faults"] = faults
    if "late_ticks" in raw:
        found |= _deadlines(raw)
    if "control.ticks" in raw:
        found["control"] = _tracking(raw)
    if "beat_late" in raw:
        found["beat_late_us"] = _quantiles(raw["beat_late"])
    wall = int(raw["wall_ns"]) * 1e-9
    seconds = found["ticks"] * PERIOD_US / 1e6
    return found | {
        "bus_counts": _group(raw, "bus."),
        "wall_s": wall,
        "realtime_factor": seconds / wall if wall > 0 else 0,
        "max_rss_kib": int(raw["max_rss_kib"]),
    }


def _group(raw: dict[str, str], prefix: str) -> dict[str, int]:
    names = (name for name in raw if name.startswith(prefix))
    return {name.removeprefix(prefix): int(raw[name]) for name in names}


def _frames(raw: dict[str, str]) -> dict[str, Any]:
    sent, answered = int(raw["frames.sent"]), int(raw["frames.answered"])
    found: dict[str, Any] = {
        "frames_sent": sent,
        "frames_answered": answered,
        "frames_lost": sent - answered,
        "answers_unmatched": int(raw["answers.unmatched"]),
        "answers_corrupt": int(raw["answers.corrupt"]),
    }
    if "latency" in raw:
        found["latency_us"] = _quantiles(raw["latency"])
        found["jitter_us"] = _quantiles(raw["jitter"])
        found["latency_histogram"] = [[edge / 1e3, count] for edge, count in _bins(raw["latency"])]
    return found


def _deadlines(raw: dict[str, str]) -> dict[str, int]:
    """Return answers and ticks that are more than a period late, and their sum."""
    ticks, answers = int(raw["late_ticks"]), int(raw.get("answers.late", "0"))
    found = {"late_ticks": ticks} | ({"late_answers": answers} if "answers.late" in raw else {})
    return found | {"deadline_misses": ticks + answers}


def _tracking(raw: dict[str, str]) -> dict[str, Any]:
    ticks = max(int(raw["control.ticks"]), 1)
    return {
        "rms_error_rad": math.sqrt(float(raw["control.sum_square_rad2"]) / ticks),
        "max_error_rad": float(raw["control.max_error_rad"]),
        "torque_alternations": int(raw["control.torque_alternations"]),
        "reference_reversals": int(raw["control.reference_reversals"]),
    }


def _bins(text: str) -> list[tuple[int, int]]:
    """Return upper edge in ns and count of each bin of a histogram."""
    pairs = (word.split(":") for word in text.split()[1:])
    return [(int(edge), int(count)) for edge, count in pairs]


def _quantiles(text: str) -> dict[str, float]:
    """Return median, 99 % and maximum in us. A quantile is the upper edge of its bin."""
    bins, most = _bins(text), int(text.split(maxsplit=1)[0])
    total, found = sum(count for _, count in bins), {}
    for name, part in (("p50", 0.5), ("p99", 0.99)):
        seen, value = 0, most
        for edge, count in bins:
            seen += count
            if seen >= part * total:
                value = min(edge, most)
                break
        found[name] = value / 1e3
    return found | {"max": most / 1e3}
