# SPDX-License-Identifier: MIT
"""The models that were compared and the choices that were tried, for people and for machines."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from dahl.identify import delay
from dahl.identify.compare import Candidate, Part
from dahl.identify.log import Log
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
        name = one.name + f" ({models.why})" * (one.name == models.chosen)
        cost = "-" if ticks is None else f"{ticks}"
        words = "; ".join(_words(part) for part in one.parts)
        shown.add_row(name, words, f"{models.r2(one):.4f}", cost)
    shown.caption = (
        f"parameters: sigma0 in {log.slope_unit}, Fc in {log.unit} (forward, backward; exponent);"
        " instructions of a tick of up to 8 counts on a Cortex-M3, at most"
    )
    return shown


def _words(part: dict[str, float | str]) -> str:
    """Kind, then sigma0, Fc and so on: the numbers in the order of the caption."""
    shown = [f"{value:.4g}" for value in part.values() if not isinstance(value, str)]
    return f"{part['kind']} {', '.join(shown)}"


def whose(result: Result) -> str:
    """Return " (Dahl)" if another model was chosen, since the numbers of both are shown."""
    return " (Dahl)" * (result.explored.models.chosen not in ("", "Dahl"))


def headlines(result: Result) -> list[str]:
    """The chosen model with its numbers, then Dahl's if that is another one."""
    models, estimate, log = result.explored.models, result.estimate, result.logs[0]
    dahl: Part = {"sigma0": estimate.sigma0, "Fc": estimate.Fc}
    lines = [f"Dahl: {_in_units([dahl], log)}, R2 {result.r2:.4f} on the rows fitted"]
    chosen = models.of(models.chosen)
    if chosen is None or chosen.name == "Dahl":
        return lines
    kinds = [str(part["kind"]) for part in chosen.parts]
    mix = f" ({' + '.join(kinds)})" * (len(set(kinds)) > 1)
    score = f"R2 {models.r2(chosen):.4f} on cycles left out"
    return [f"{chosen.name}, {models.why}{mix}: {_in_units(chosen.parts, log)}, {score}", *lines]


def _in_units(parts: Sequence[Part], log: Log) -> str:
    """Each number of the elements under its name, those of several elements as a sum."""
    names = [name for name, value in parts[0].items() if not isinstance(value, str)]
    units = {"sigma0": log.slope_unit, "exponent": ""}
    words = []
    for name in names:
        values = " + ".join(f"{part[name]:.4g}" for part in parts)
        words.append(f"{name.replace('_', ' ')} = {values} {units.get(name, log.unit)}".strip())
    return ", ".join(words)


def about(result: Result) -> str:
    """Which model a header and a scene carry, where it is not Dahl's."""
    models = result.explored.models
    why = "asked for" if models.forced else "chosen: it explains cycles that were left out better"
    chosen = models.of(models.chosen)
    if chosen is None or chosen.name == "Dahl":
        return ""
    shown = "; ".join(_words(part) for part in chosen.parts)
    lacking = "; this carries Dahl's, as the library has no plan for it" * (
        chosen.name == "Coulomb"
    )
    return f"The model is {chosen.name}, {why}: {shown}, R2 {models.r2(chosen):.4f}{lacking}"


def numbers(result: Result) -> dict[str, Any]:
    """For the JSON: the models with their scores, and the choices."""
    seen = result.explored
    models = seen.models
    trials = sorted(seen.trials, key=lambda trial: float(trial.cost.sum()))[:LISTED]
    taken = seen.taken
    return {
        "extra_standard_errors": taken.errors if taken else {},
        "delay_rows_standard_error": delay.standard_error(seen.trials, taken) if taken else 0.0,
        "model": models.chosen or "Dahl",
        "models": [_model(result, one) for one in models.candidates],
        "choices": [
            {
                "model": one.choice.model,
                "terms": list(one.choice.terms),
                "delay_rows": one.choice.delay,
                "backlash_counted": one.choice.backlash,
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
