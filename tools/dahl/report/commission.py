# SPDX-License-Identifier: MIT
"""Verdict, JSON, header and table of an axis that commissioned itself."""

from __future__ import annotations

import json
import textwrap
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from dahl.binding import plan_header
from dahl.binding.commission import COMPENSATOR_PARAMETERS, RANGES, REASONS, Range
from dahl.binding.friction import Plan
from dahl.io.files import write_atomic
from dahl.sim.axis import Commissioned
from dahl.version import __version__

if TYPE_CHECKING:
    from rich.table import Table

UNITS = {
    "Fc": "N m",
    "length": "rad",
    "sigma0": "N m/rad",
    "inertia": "kg m2",
    "delay": "s",
    "viscous": "N m s/rad",
    "load": "N m",
    "load_error": "N m",
    "load_most": "N m",
    "period": "s",
    "theta_per_count": "rad",
    "torque_limit": "N m",
    "travel": "rad",
    "angle_limit": "rad",
    "speed_limit": "rad/s",
    "angle": "rad",
    "friction": "N m",
    "friction_at_speed": "rad/s, N m",
    "noise": "count",
    "play": "count",
    "seconds": "s",
}
CONFIGURATION = (
    "period",
    "theta_per_count",
    "inertia",
    "torque_limit",
    "travel",
    "angle_limit",
    "speed_limit",
)
FULL_GAIN = 0.89  # the next step does not ask for more
COMMENT_WIDTH = 100  # columns
NEEDS_DRIVE = ("Fc_low", "length_long", "sigma0_high", "delay", "gain")


@dataclass(frozen=True)
class Report:
    """A run, or a recording of the sweeps, with its source in words."""

    done: Commissioned
    source: str

    @property
    def refusal(self) -> str:
        """Key of REASONS, or ""."""
        return self.done.axis.refusal_code

    @property
    def stage(self) -> str:
        """The last stage that moved the axis, or "done"."""
        stages = [one for one in self.done.trace.stage if one not in ("done", "refused")]
        return "done" if self.done.axis.stage == "done" else (stages or ["rest"])[-1]

    @property
    def verdict(self) -> str:
        """One sentence."""
        if self.refusal:
            return f"refused in the stage {self.stage}: {REASONS[self.refusal][0]}"
        if self.stage != "done":
            missing = ", ".join(NEEDS_DRIVE)
            return f"friction and load are known; a table cannot show {missing}"
        gain = self.done.axis.result["gain"]
        words = f"all bounds are known; the axis came to rest after all kicks at gain {gain:.2g}"
        return words + ("; its load may exceed its friction" if self._needs_load_table else "")

    @property
    def _needs_load_table(self) -> bool:
        """Return whether compensation without the load table would drive the axis."""
        return not self.done.axis.c_params(True).gain > 0

    @property
    def next_step(self) -> str:
        """One sentence: the action that follows from the verdict."""
        if self.refusal:
            return REASONS[self.refusal][1]
        if self.stage != "done":
            return "let dahl commission drive the axis over CAN, or use dahl_commission.h in it"
        if self._needs_load_table:
            return "add the load table in the firmware; without it, the gain must be 0"
        if self.done.axis.result["gain"] < FULL_GAIN:
            return "use this gain; a stiffer shaft or a finer encoder may allow more"
        return "build the header into the firmware, and start with gain 0.3"

    def numbers(self) -> dict[str, Any]:
        """Return the values of the JSON file."""
        axis = self.done.axis
        return {
            "verdict": self.verdict,
            "next_step": self.next_step,
            "refusal": self.refusal or None,
            "stage": self.stage,
            "source": self.source,
            "version": __version__,
            "units": UNITS,
            "configuration": {name: getattr(axis, name) for name in CONFIGURATION},
            "sweeps": self._sweeps(),
            "result": _as_json(axis.result) if self.stage == "done" else None,
            "compensator": self._compensator(False),
            "compensator_without_load_table": self._compensator(True),
        }

    def _sweeps(self) -> dict[str, Any] | None:
        return _as_json(self.done.axis.sweeps) if self.done.axis.has_sweeps else None

    def _compensator(self, has_load: bool) -> dict[str, float] | None:
        """Return the keywords of dahl.Compensator. None if the bounds are not known."""
        if self.stage != "done":
            return None
        params = self.done.axis.c_params(has_load)
        found = {name: getattr(params, name) for name in COMPENSATOR_PARAMETERS}
        names = ("sigma0", "Fc", "theta_per_count")
        element = {name: getattr(params.friction, name) for name in names}
        return {**element, **found, "elastic": bool(params.elastic)}

    def as_json(self) -> str:
        return json.dumps(self.numbers(), indent=2) + "\n"

    def header(self, name: str) -> str:
        """Return dahl_plan_NAME.h. The stage must be done."""
        axis, result = self.done.axis, self.done.axis.result
        params = axis.c_params()
        friction = params.friction
        comment = [
            f"Friction of an axis that commissioned itself ({self.source}):",
            f"{self.verdict}.",
            *(f"{key} [{UNITS[key]}]: {_shown(result[key])}." for key in RANGES),
        ]
        folded = [part for line in comment for part in textwrap.wrap(line, COMMENT_WIDTH)]
        plan = Plan(friction.sigma0, friction.Fc, friction.theta_per_count)
        bounds = result["Fc"].least, result["length"].most, result["sigma0"].most
        return (
            plan_header.text(name, plan, folded)
            + plan_header.bounds(name, *bounds, "N m", "rad")
            + plan_header.commission(name, params, result["load"].tolist(), axis.travel)
        )

    def rows(self) -> Iterator[tuple[str, str]]:
        """Yield name and words of each number, the verdict first."""
        axis = self.done.axis
        yield "verdict", self.verdict
        yield "next step", self.next_step
        if self.stage == "done":
            result = axis.result
            for key in RANGES:
                yield key, f"{_shown(result[key])} {UNITS[key]}"
            bounds = result["Fc"].least, result["length"].most, result["sigma0"].most
            words = "Fc_low {:.4g} N m, length_long {:.4g} rad, sigma0_high {:.4g} N m/rad"
            yield "bounds", words.format(*bounds)
            most = result["load_most"]
            yield "load", f"at most {most:.4g} N m; the table is within {result['load_error']:.2g}"
            share = axis.c_params(True).gain
            yield "gain", f"{result['gain']:.2g}; {share:.2g} if the firmware has no load table"
            yield "axis", "elastic" if result["elastic"] else "rigid"
            yield "duration", f"{result['seconds']:.1f} s"
        elif axis.has_sweeps:
            yield "Fc", f"{_shown(axis.sweeps['Fc'])} N m"
            yield "viscous", f"{_shown(axis.sweeps['viscous'])} N m s/rad"
            load, error = axis.sweeps["load"], axis.sweeps["load_error"]
            words = f"{load.min():.4g} to {load.max():.4g} N m over the travel, each within"
            yield "load", f"{words} {error:.2g}"

    def table(self) -> Table:
        """Return the rows as a table for the terminal."""
        from rich.table import Table

        shown = Table(show_header=False, title=self.source, title_justify="left")
        for row in self.rows():
            shown.add_row(*row)
        return shown

    def write_files(self, name: str, folder: Path) -> list[Path]:
        """Write JSON and picture, and the header last, if all bounds are known."""
        from dahl.report import commission_plot

        folder.mkdir(parents=True, exist_ok=True)
        plan = folder / f"dahl_plan_{name}.h"
        plan.unlink(missing_ok=True)  # an earlier run's header must not stay with new numbers
        written = [folder / f"{name}.json", folder / f"{name}.png"]
        write_atomic(written[0], self.as_json())
        commission_plot.draw(written[1], self.done)
        if self.stage == "done":
            write_atomic(plan, self.header(name))
            written.append(plan)
        return written


def _shown(one: Range) -> str:
    return f"{one.best:.4g}, {one.least:.4g} to {one.most:.4g}"


def _as_json(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return ranges as objects, and arrays as lists."""
    plain: dict[str, Any] = {}
    for key, value in values.items():
        if isinstance(value, Range):
            plain[key] = value._asdict()
        else:
            plain[key] = value.tolist() if isinstance(value, np.ndarray) else value
    return plain
