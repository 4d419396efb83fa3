# SPDX-License-Identifier: MIT
"""The scenes that `dahl demo` simulates without dahl-loop, commission, compensation and park-steer:
their runs, pictures and tables.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dahl.errors import InputError

if TYPE_CHECKING:
    import can

Begin = Callable[[int, str], Callable[[], None]]  # steps, their unit -> a call after each step
OURS = ("dahl", "dahl + observer")  # laws of the library in the scene compensation
COLUMNS = ("without", "with")  # assist, of park-steer; compensation, of commission
ROWS = {
    "width_Nm": "width of the hysteresis loop [N m]",
    "drag_Nm": "of it, viscous drag [N m]",
    "largest_hand_Nm": "largest hand torque [N m]",
    "hand_J": "work of the hand [J]",
    "tyres_J": "work against the tyres [J]",
    "assist_J": "work of the assist [J]",
}


@dataclass(frozen=True)
class Played:
    """A run: its numbers, a function that draws its picture, and the frames of its bus."""

    numbers: dict[str, Any]
    draw: Callable[[Path], None]
    frames: Sequence[can.Message] = ()


@dataclass(frozen=True)
class Table:
    """Cells as text; `names` columns at the left are names, the others numbers."""

    title: str
    head: tuple[str, ...]
    rows: list[tuple[str, ...]]
    names: int


@dataclass(frozen=True)
class SimulatedScene:
    """`play` takes the seed, which a scene without has_seed does not use."""

    play: Callable[[int, Begin], Played]
    table: Callable[[dict[str, Any]], Table]
    has_seed: bool


def _play_compensation(seed: int, begin: Begin) -> Played:
    from dahl.report.compensation import draw
    from dahl.sim import compensation

    comparison = compensation.compare(seed, begin(compensation.count_steps(), "steps"))
    return Played(comparison.numbers, lambda path: draw(path, comparison))


def _compensation_table(numbers: dict[str, Any]) -> Table:
    """Return the ratios of the library and the best other law. The summary has those of all laws,
    and so has the picture.
    """
    axes = {axis: numbers[axis] for axis in ("position", "hand")}
    ours = tuple(law for law in next(iter(axes["position"].values())) if law in OURS)
    rows = [
        (axis, case, *_ratios(values, ours))
        for axis, cases in axes.items()
        for case, values in cases.items()
    ]
    title = "error over that without compensation (less is better)"
    return Table(title, ("axis", "case", *ours, "best other law", "its ratio"), rows, names=2)


def _ratios(values: dict[str, Any], ours: tuple[str, ...]) -> list[str]:
    """Return the cells of a case. A law that needs a reference has none on the axis of the hand."""
    ratios = {law: float(numbers["ratio"]) for law, numbers in values.items()}
    others = {law: ratio for law, ratio in ratios.items() if law not in ("none", *OURS)}
    best = min(others, key=others.__getitem__, default="")
    shown = [ratios.get(law) for law in ours] + [others.get(best)]
    cells = ["" if ratio is None else f"{ratio:.3f}" for ratio in shown]
    return [*cells[:-1], best, cells[-1]]


def _play_park_steer(_: int, begin: Begin) -> Played:
    from dahl.report.park_steer import draw
    from dahl.sim import park_steer

    advance = begin(2 * park_steer.count_ticks() + 2, "ticks")
    runs = [park_steer.simulate(gain, advance) for gain in (0.0, park_steer.GAIN)]
    numbers = dict(zip(COLUMNS, (run.numbers() for run in runs), strict=True))
    return Played(numbers, lambda path: draw(path, *runs), runs[1].frames)


def _park_steer_table(numbers: dict[str, Any]) -> Table:
    columns = [numbers[name] for name in COLUMNS]
    rows = [(text, *(f"{one[key]:.2f}" for one in columns)) for key, text in ROWS.items()]
    head = ("one cycle of the hand wheel", *(f"{name} assist" for name in COLUMNS))
    return Table("", head, rows, names=1)


def _play_commission(_: int, begin: Begin) -> Played:
    from dahl.report.commission import Report
    from dahl.report.commission_plot import draw
    from dahl.sim import axis

    advance = begin(len(axis.STAGES) + 2, "steps")
    done = axis.commission(axis.simulated(), axis.Shaft(), watch=axis.each_stage(advance))
    tracking = []
    for is_compensated in (False, True):
        tracking.append(axis.track(done.axis, is_compensated))
        advance()
    numbers = Report(done, "simulated axis").numbers()
    rms = dict(zip(COLUMNS, (one.rms for one in tracking), strict=True))
    return Played(
        numbers | {"tracking_rms_rad": rms}, lambda path: draw(path, done, tuple(tracking))
    )


def _commission_table(numbers: dict[str, Any]) -> Table:
    result, units, ends = numbers["result"], numbers["units"], ("least", "best", "most")
    rows = [
        (f"{key} [{units[key]}]", *(f"{one[end]:.4g}" for end in ends))
        for key, one in result.items()
        if isinstance(one, dict)
    ]
    rms = numbers["tracking_rms_rad"]
    without, with_it = (1e3 * float(rms[name]) for name in COLUMNS)
    title = (
        f"gain {float(result['gain']):.2g} after {float(result['seconds']):.1f} s; tracking error"
        f" {without:.3g} mrad without compensation, {with_it:.3g} mrad with it"
    )
    return Table(title, ("measured by the axis itself", *ends), rows, names=1)


SCENES = {
    "commission": SimulatedScene(_play_commission, _commission_table, has_seed=False),
    "compensation": SimulatedScene(_play_compensation, _compensation_table, has_seed=True),
    "park-steer": SimulatedScene(_play_park_steer, _park_steer_table, has_seed=False),
}


def is_simulated(numbers: dict[str, Any]) -> bool:
    """Return whether a summary is that of such a scene."""
    return str(numbers.get("scene")) in SCENES and "scene_file" not in numbers


def table(numbers: dict[str, Any], path: Path) -> Table:
    """Return the table of a summary. Raises dahl.Error if a number is missing; any program may have
    written the file.
    """
    name = str(numbers["scene"])
    try:
        return SCENES[name].table(numbers)
    except (KeyError, TypeError, ValueError, AttributeError, StopIteration) as error:
        raise InputError(f"{path}: not the numbers of scene {name} ({error!r})") from None
