# SPDX-License-Identifier: MIT
"""Write a result as JSON, as tables for people, and as files; the verdict always comes first."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from dahl.identify import excitation, models
from dahl.identify.export import RunnableModel, header, runnable_model, write_scene
from dahl.identify.fit import Fit
from dahl.identify.lags import NONE
from dahl.identify.laws import DAHL, SLIP, Law
from dahl.identify.least_squares import cost_of, jackknife, solve
from dahl.identify.models import turning_points
from dahl.identify.result import NAMES, Result, terms_of
from dahl.identify.samples import MIN_TURN_LENGTHS
from dahl.identify.select import penalised_cost
from dahl.io.files import write_atomic
from dahl.version import __version__

if TYPE_CHECKING:
    from rich.table import Table

BOUNDS = (
    "Fc_low",
    "length_long",
    "sigma0_high",
)  # for dahl_compensator.h; null if a log gives none
MAX_CHOICES = 40  # best hypotheses that JSON lists
UNITS = {"offset": "{T}", "spring": "{k}", "viscous": "{T} s/{x}", "inertia": "{T} s2/{x}"}
MIN_INFORMING_SLOPE = 0.1  # of sigma0; a smaller slope says little about sigma0
TABLE_COLUMNS = 80
MAX_NAME_COLUMNS = 24  # of a log, in the first column


def title_of(result: Result) -> str:
    """The names of the logs, each once."""
    return ", ".join(dict.fromkeys(Path(name).name for name in result.names))


def best_by_law(result: Result) -> dict[Law, Fit]:
    """Return the best fit of each law, simple laws first; for the chosen law the chosen fit."""
    found = {
        f.hypothesis.law: f for f in sorted(result.fits, key=lambda f: -penalised_cost(f).sum())
    }
    found[result.hypothesis.law] = result.chosen
    return dict(sorted(found.items(), key=lambda item: item[0].size))


# --- JSON -----------------------------------------------------------------------------------------


def numbers(result: Result) -> dict[str, Any]:
    """Return all numbers by their JSON keys, in N m and rad, or N and m if `linear` is true."""
    log, model, samples = result.logs[0], runnable_model(result), result.samples
    residual = result.residual * np.sqrt(samples.used)
    least = MIN_TURN_LENGTHS / result.a.value
    delays = [result.delay_of(fit) for fit in result.plausible.fits]
    return {
        "logs": result.names,
        "rows": sum(one.rows for one in result.logs),
        "linear": log.linear,
        "units": result.units,
        **_claims(result),
        "notes": notes(result),
        "extra": result.terms,
        "extra_standard_errors": _term_errors(result),
        "other_torques": {f"{k}_torque": size for k, size in result.other_torques.items()},
        "r2": 1 - float(residual @ residual) / result.spread,
        "rmse": float(np.sqrt(residual @ residual / samples.used.sum())),
        **_simple_models(result),
        "checks": result.checks,
        "reversals": sum(len(turning_points(one.theta, least)) for one in result.logs),
        "informs_sigma0": _informing_part(result),
        "cycles_scored": samples.cycles,
        "rows_used": round(samples.rows * samples.block),
        "delay_rows": result.delay_rows,
        "delay_rows_standard_error": float(np.ptp(delays)) / 2,
        "backlash": result.play,
        "resolution": log.resolution,
        "r2_plan": model.plan_r2,
        "plan": {
            "sigma0": list(model.friction.sigma0),
            "Fc": list(model.friction.Fc),
            "theta_per_count": model.theta_per_count,
            **model.friction.by_speed,
            "of_target": bool(result.options.target_counts),
            "against": model.against,
        },
        "load": _load(result),
        **_how(result),
        **_models(result, model),
    }


def _claims(result: Result) -> dict[str, Any]:
    """Return the parameters, their intervals and bounds, and what is claimed of them."""
    parameters = {name: getattr(result, name) for name in ("sigma0", "Fc", "a")}
    return {
        **{name: p.value for name, p in parameters.items()},
        "ci95": {name: [_finite(p.low), _finite(p.high)] for name, p in parameters.items()},
        **dict.fromkeys(BOUNDS),
        **dict(zip(BOUNDS, result.compensator_bounds or (), strict=False)),
        "against_bounds": result.against_bounds,
        "uncertainty": {name: parameters[name].uncertainty for name in NAMES},
        "identifiable": dict(zip(NAMES, result.claimed, strict=True)),
        "verdict": result.verdict,
        "reasons": result.reasons,
        "next_steps": {name: step for name, (_, step) in result.refusals.items()},
    }


def as_json(result: Result) -> str:
    return json.dumps(numbers(result), indent=2) + "\n"


def _finite(x: float) -> float | None:
    """Return a number; None for infinity, which JSON lacks."""
    return x if math.isfinite(x) else None


def notes(result: Result) -> list[str]:
    found = []
    for log in result.logs:
        place = f"{Path(log.name).name}: " if len(result.names) > 1 else ""
        found += [f"{place}{note}" for note in log.notes]
    if any(log.load is not None for log in result.raw) and not result.hypothesis.law.follows_load:
        found.append("load: not used, the friction does not follow it in all logs")
    alike = excitation.warning(result.logs, result.a.value, MIN_TURN_LENGTHS / result.a.value)
    if alike and result.claimed[0]:
        found.append(alike)
    if result.sign < 0:
        found.append("the torque was used with the other sign: friction has the sign of the motion")
    return found


def _term_errors(result: Result) -> dict[str, float]:
    no_limits = np.zeros_like(result.chosen.limits)
    fit = replace(result.chosen, coefficients=jackknife(result.chosen.left_out), limits=no_limits)
    return {name: abs(error) for name, error in terms_of(fit, result.samples).items()}


def _simple_models(result: Result) -> dict[str, Any]:
    """Return held-out R2 and rms of Dahl's law, Coulomb's, no friction and one slip element."""
    s, fits = result.samples, best_by_law(result)
    terms = [name for name in result.hypothesis.terms if name != "waves"]
    columns = result.fitter.term_columns(terms)
    costs = {
        "dahl": fits[DAHL].total if DAHL in fits else math.nan,
        "coulomb": _held_out(result, [s.direction, *columns]),
        "none": _held_out(result, columns or [np.zeros(s.rows)]),
        "bilinear": fits[SLIP].total if SLIP in fits else math.nan,
    }
    weight = float(s.used.sum())
    held = {
        name: {"r2": 1 - cost / result.spread, "rmse": math.sqrt(cost / weight)}
        for name, cost in costs.items()
        if math.isfinite(cost)
    }
    return {
        "held_out": held,
        "r2_coulomb": held["coulomb"]["r2"],
        "coulomb_extra": terms,
        "bilinear_sigma0": float(fits[SLIP].value[0]) if SLIP in fits else None,
    }


def _held_out(result: Result, columns: list[np.ndarray]) -> float:
    """Return the squared residual of left-out cycles if only these columns are fitted."""
    grams, own = result.samples.grams(np.column_stack(columns)), range(len(columns))
    return float(cost_of(grams, own, solve(grams.sum(axis=0) - grams, own)).sum())


def _informing_part(result: Result) -> float:
    """Return the part of the moving samples that are steep enough to inform sigma0."""
    moves = result.fitter.moves["between counts"]
    moving = moves != 0
    w = models.dahl(moves, result.samples.pieces, result.a.value)
    steep = (1 - np.sign(moves) * w)[moving] > MIN_INFORMING_SLOPE
    return float(np.mean(steep)) if moving.any() else 0.0


def _load(result: Result) -> dict[str, Any] | None:
    """Return how sigma0 and Fc follow the load: by the factor 1 + slope (load - reference)."""
    fit, s = result.chosen, result.samples
    if not fit.hypothesis.law.follows_load or s.load is None:
        return None
    plain = best_by_law(result)[DAHL]
    reference, ends = s.reference.load, (float(s.load.min()), float(s.load.max()))
    slope = float(fit.p[1]) / reference
    return {
        "reference": reference,
        "slope": slope,
        "slope_standard_error": float(jackknife(fit.left_out)[2]) / reference,
        "least": ends[0],
        "most": ends[1],
        "shares": [1 + slope * (end - reference) for end in ends],
        "r2": result.r2,
        "r2_without": result.r2_of(plain),
        "linearised_change": float(fit.coefficients[2]),
    }


def _how(result: Result) -> dict[str, Any]:
    """Return how the numbers came about: options, preprocessing, cycles and lack of fit."""
    weight = result.samples.weight
    cycles = result.by_cycle()
    first = [round(fold.start * result.samples.block) for fold in result.samples.folds]
    return {
        "version": __version__,
        "options": asdict(result.options),
        "median_rows": result.options.median,
        "torque_sign": result.sign,
        "angle_between_counts": result.hypothesis.angle != "as read",
        "rows_weighing_less": int(np.count_nonzero((weight > 0) & (weight < 1))),
        "sum_of_weights": float(result.samples.used.sum()),
        "rows_per_sample": result.samples.block,
        "pieces": [one.rows for one in result.logs],
        "cycles": {"first_row": first, **{key: x.tolist() for key, x in cycles.items()}},
        "findings": [
            {
                "text": lack.text,
                "doubts": [name for name, no in zip(NAMES, lack.withdraws, strict=True) if no],
            }
            for lack in result.lacks
        ],
    }


def _models(result: Result, model: RunnableModel) -> dict[str, Any]:
    """Return the laws, each with its best fit, and the best hypotheses."""
    others = [f for f in result.fits if f is not result.chosen]
    ordered = [*sorted(others, key=lambda f: f.total)[:MAX_CHOICES], result.chosen]
    return {
        "model": result.hypothesis.law.label,
        "exported_model": model.fit.hypothesis.law.label,
        "exported_model_lost_r2": model.lost_r2,
        "models": [_law_numbers(result, fit) for fit in best_by_law(result).values()],
        "choices": [_hypothesis_numbers(result, fit) for fit in ordered],
    }


def _law_numbers(result: Result, fit: Fit) -> dict[str, Any]:
    law = fit.hypothesis.law
    return {
        "name": law.label,
        "chosen": law is result.hypothesis.law,
        "parts": law.parts(fit),
        "r2": result.r2_of(fit),
        "delay_rows": result.delay_of(fit),
        "extra": terms_of(fit, result.samples),
        "instructions_m3": law.instructions,
        "in_library": law.in_library,
    }


def _hypothesis_numbers(result: Result, fit: Fit) -> dict[str, Any]:
    h, is_chosen = fit.hypothesis, fit is result.chosen
    return {
        "model": h.law.label,
        "lag": h.lag.name,
        "angle": h.angle,
        "terms": list(h.terms),
        "r2": result.r2_of(fit),
        "sigma0": float(fit.value[0]),
        "Fc": float(fit.value[1]),
        "plausible": is_chosen or any(fit is near for near in result.plausible.fits),
        "taken": is_chosen,
    }


# --- tables for people ----------------------------------------------------------------------------


def tables(result: Result) -> tuple[Table, Table]:
    """Return the table of the numbers, which begins with the verdict, and the table of the laws."""
    from rich.table import Table

    kept = numbers(result)
    title = title_of(result)
    shown = Table(show_header=False, title=title, width=TABLE_COLUMNS, title_justify="left")
    for row in _rows(result, kept):
        shown.add_row(*row)
    laws = Table("law", "parameters", "R2", "tick", width=TABLE_COLUMNS, title_justify="left")
    laws.title = "laws"
    for law in kept["models"]:
        numbers_of = (part.values() for part in law["parts"])
        parts = (", ".join(f"{x:.4g}" for x in one if not isinstance(x, str)) for one in numbers_of)
        name = f"{law['name']} (chosen)" if law["chosen"] else law["name"]
        laws.add_row(name, "; ".join(parts), f"{law['r2']:.4f}", str(law["instructions_m3"] or "-"))
    laws.caption = (
        f"sigma0 [{result.units['sigma0']}] and Fc [{result.units['Fc']}] of each element"
        " (asymmetric: Fc forward and backward), then shape parameters; R2 on cycles left out;"
        " instructions of a Q30 tick on Cortex-M3, - if the library has no such law"
    )
    return shown, laws


def _rows(result: Result, kept: dict[str, Any]) -> Iterator[tuple[str, str]]:
    """Yield name and words of each number."""
    log, h = result.logs[0], result.hypothesis
    yield "verdict", kept["verdict"]
    yield (
        "rows",
        f"{sum(one.rows for one in result.raw)} read, {kept['rows_used']} used;"
        f" {kept['reversals'] // 2} cycles found, {kept['cycles_scored']} scored",
    )
    for name, unit in kept["units"].items():
        p = getattr(result, name)
        high = f"{p.high:.5g}" if math.isfinite(p.high) else "no end"
        yield name, f"{p.value:.5g} {unit}, 95 %: {p.low:.5g} to {high}"
    yield "compensator", _bounds(result)
    late = _delay(result) if kept["delay_rows"] else ""
    is_hidden = h.lag.play(result.chosen.p) > 0 and not result.play
    lag = "travel that a count hides" if is_hidden else h.lag.name
    yield "law", kept["model"] + (late or f", with {lag}" * (h.lag is not NONE))
    if load := kept["load"]:
        least, most = load["shares"]
        yield (
            "load",
            f"sigma0 and Fc are given at {load['reference']:.4g}, {least:.3g} to {most:.3g} times"
            f" as large in the log; R2 {load['r2']:.4f}, {load['r2_without']:.4f} without the load",
        )
    for name, value in kept["extra"].items():
        unit = UNITS.get(name, "").format(T=log.unit, k=log.slope_unit, x=log.angle_unit)
        yield name, f"{value:.4g} {unit}".strip()
    others = [(name, size) for name, size in result.other_torques.items() if name != "offset"]
    if words := ", ".join(f"{name} {size:.3g} {log.unit}" for name, size in others):
        yield "other torques", f"{words} (half of the range)"
    yield "R2, cycles left out", f"{result.r2:.4f} of {kept['cycles_scored']} cycles"
    for path, r2 in kept["checks"].items():
        yield f"check {_shorten_name(Path(path).name)}", f"R2 {r2:.4f}, not fitted"
    model, units = runnable_model(result), kept["units"]
    sums = ", ".join(f"{key} {x:.5g} {units[key]}" for key, x in model.friction.sums.items())
    yield "header and scene", f"{sums}. {model.about}".strip()
    yield "R2 of the plan alone", f"{kept['r2_plan']:.4f} on the raw motion"
    yield from (("note", note) for note in kept["notes"])


def _delay(result: Result) -> str:
    """Return the delay of the torque in words."""
    rows, time = result.delay_rows, result.logs[0].time
    words = f", torque {'late' if rows > 0 else 'early'} by {abs(rows):.2g} rows"
    if time is None:
        return words
    return f"{words} ({1e3 * abs(rows) * float(np.median(np.diff(time))):.2g} ms)"


def _bounds(result: Result) -> str:
    """Return the bounds for a compensator in words, or the reason against them."""
    bounds, log = result.compensator_bounds, result.logs[0]
    if bounds is None:
        return f"no bounds: {result.against_bounds}"
    ends = zip(BOUNDS, bounds, (log.unit, log.angle_unit, log.slope_unit), strict=True)
    known = (f"{key} {x:.5g} {unit}" for key, x, unit in ends if x is not None)
    return ", ".join(known) or "no bounds: no interval has an end"


def _shorten_name(name: str) -> str:
    """Return a name without its middle if it is long."""
    half = MAX_NAME_COLUMNS // 2
    return name if len(name) <= MAX_NAME_COLUMNS else f"{name[: half - 1]}…{name[-half:]}"


# --- files ----------------------------------------------------------------------------------------


def write_files(result: Result, name: str, folder: Path, force: bool = False) -> list[Path]:
    """Write JSON, picture and scene, and the header last.

    The header is left out if there are reasons against the plan and it is not forced.
    """
    from dahl.identify import plot

    folder.mkdir(parents=True, exist_ok=True)
    model, title = runnable_model(result), title_of(result)
    plan = folder / f"dahl_plan_{name}.h"
    plan.unlink(missing_ok=True)  # an earlier run's header must not stay with new numbers
    scene = write_scene(model, name, folder)
    json_file, picture, csv = (scene.with_suffix(end) for end in (".json", ".png", ".csv"))
    write_atomic(json_file, as_json(result))
    plot.draw(picture, result, title)
    if model.against and not force:
        return [json_file, picture, csv, scene]
    write_atomic(plan, header(model, name, title))
    return [json_file, picture, csv, scene, plan]
