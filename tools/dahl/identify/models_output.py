# SPDX-License-Identifier: MIT
"""The models that were compared and the choices that were tried, for people and for machines."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from dahl.identify.compare import Candidate
from dahl.identify.model_table import instructions
from dahl.identify.result import Result

if TYPE_CHECKING:
    from rich.table import Table

LISTED = 40  # choices, the best ones


def table(result: Result) -> Table:
    """Model, parameters, R2 on cycles that were left out, cost."""
    from rich.table import Table

    models, log = result.explored.models, result.logs[0]
    shown = Table("model", "parameters", "R2, cycles left out", "instructions", title="models")
    shown.title_justify = "left"
    for one in models.candidates:
        ticks = instructions(one.name)
        mark = {True: " (asked for)", False: " (chosen)"}[bool(models.forced)]
        name = one.name + mark * (one.name == models.chosen)
        cost = "-" if ticks is None else f"{ticks}"
        words = "; ".join(_words(part) for part in one.parts)
        shown.add_row(name, words, f"{models.r2(one):.4f}", cost)
    shown.caption = (
        f"parameters: sigma0 in {log.slope_unit}, Fc in {log.unit} (forward, backward; exponent);"
        " instructions of a tick on a Cortex-M3, at most"
    )
    return shown


def _words(part: dict[str, float | str]) -> str:
    """Kind, then sigma0, Fc and so on: the numbers in the order of the caption."""
    shown = [f"{value:.4g}" for value in part.values() if not isinstance(value, str)]
    return f"{part['kind']} {', '.join(shown)}"


@dataclass(frozen=True)
class SceneFriction:
    """What a scene says of the friction: a model that it knows, numbers as they are written."""

    model: str
    sigma0: str
    Fc: str
    terms: dict[str, float]
    earlier: float = 0.0  # rows that the torque is to come earlier than it was shifted to


def of_scene(result: Result) -> SceneFriction:
    """Slip elements, where they were chosen, else Dahl's model."""
    seen, estimate = result.explored, result.estimate
    one = seen.models.of(seen.models.chosen)
    if one is None or not is_slip(one.name):
        return SceneFriction("dahl", f"{estimate.sigma0!r}", f"{estimate.Fc!r}", estimate.terms)
    sigma0, force = (" ".join(f"{part[name]!r}" for part in one.parts) for name in ("sigma0", "Fc"))
    earlier = one.trial.choice.delay - seen.choice.delay
    return SceneFriction("slip", sigma0, force, one.trial.terms, earlier)


def is_slip(name: str) -> bool:
    return name.startswith("slip")


def about(result: Result, carried: str = "dahl") -> str:
    """That another model was chosen than the one that a header or a scene carries; "" otherwise."""
    chosen = result.explored.models.chosen or "Dahl"
    same = is_slip(chosen) if carried == "slip" else chosen == "Dahl"
    return "" if same else f"The model chosen for this log is {chosen}; this carries Dahl's"


def numbers(result: Result) -> dict[str, Any]:
    """For the JSON: the models with their scores, and the choices."""
    seen = result.explored
    models = seen.models
    trials = sorted(seen.trials, key=lambda trial: float(trial.cost.sum()))[:LISTED]
    return {
        "model": models.chosen or "Dahl",
        "models": [_model(result, one) for one in models.candidates],
        "choices": [
            {
                "model": one.choice.model,
                "terms": list(one.choice.terms),
                "delay_rows": one.choice.delay,
                "r2": 1 - float(one.cost.sum()) / seen.spread,
                "sigma0": float(one.value["sigma0"]),
                "Fc": float(one.value["Fc"]),
                "plausible": bool(one.plausible),
                "taken": one is seen.taken,
            }
            for one in trials
        ],
    }


def _model(result: Result, one: Candidate) -> dict[str, Any]:
    return {
        "name": one.name,
        "chosen": one.name == result.explored.models.chosen,
        "elements": one.parts,
        "terms": one.trial.terms,
        "delay_rows": one.trial.choice.delay,
        "r2": result.explored.models.r2(one),
        "instructions_m3": instructions(one.name),
        "in_library": one.product,
    }
