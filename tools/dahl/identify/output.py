# SPDX-License-Identifier: MIT
"""What an identification leaves: numbers as JSON and as a table, a plan for flash, a scene that
replays the log. No number stands anywhere without its verdict.
"""

from __future__ import annotations

import io
import json
import math
import textwrap
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from dahl import __version__
from dahl.files import keep
from dahl.identify import carried, clean, load, models_output
from dahl.identify.load import Follows
from dahl.identify.result import Result, titled
from dahl.identify.terms import torque_of, unit_of

if TYPE_CHECKING:
    from rich.table import Table

REPLAYED = 200_000  # rows of the first log that a scene replays
COMMENT = 110  # characters a line of a header
OF_A_SCENE = ("offset", "spring")  # terms that its [measured] has keys for
MADE_UP = 1e-3  # presliding lengths per count of a scene or plan if the log shows no encoder


def keep_table(path: Path, columns: np.ndarray, names: str, form: str | list[str]) -> None:
    """Write a CSV in the same way."""
    text = io.StringIO()
    np.savetxt(text, columns, fmt=form, delimiter=",", header=names, comments="")
    keep(path, text.getvalue())


def plain(value: float) -> float | None:
    """JSON has no infinity."""
    return float(value) if math.isfinite(value) else None


def numbers(result: Result) -> dict[str, Any]:
    """Everything, for machines. Units: N m and rad, or N and m where `linear` is true."""
    estimate, models, log = result.estimate, result.models, result.logs[0]
    return {
        "logs": list(dict.fromkeys(one.name for one in result.logs)),
        "rows": sum(one.rows for one in result.logs),
        "linear": log.linear,
        "units": {"sigma0": log.slope_unit, "Fc": log.unit, "a": f"1/{log.angle_unit}"},
        "sigma0": estimate.sigma0,
        "Fc": estimate.Fc,
        "a": estimate.a,
        "ci95": {name: [plain(one.low), plain(one.high)] for name, one in estimate.ci95.items()},
        "extra": estimate.terms,
        "r2": result.r2,
        "rmse": result.rmse,
        "r2_coulomb": models.r2_coulomb,
        "held_out": {
            name: {"r2": models.r2[name], "rmse": models.rmse[name]} for name in models.r2
        },
        "coulomb_extra": models.terms["coulomb"],
        "bilinear_sigma0": models.bilinear_sigma0,
        "checks": result.checks,
        "reversals": result.reversals,
        "informs_sigma0": result.informs,
        "delay_rows": result.delay,
        "backlash": result.backlash,
        "resolution": log.resolution,
        "r2_plan": result.plan.r2,
        "plan": {
            "theta_per_count": result.plan.theta_per_count,
            "of_target": result.plan.of_target,
            "against": result.plan.against,
        },
        "identifiable": result.verdict.identifiable,
        "verdict": result.verdict.text,
        "reasons": result.verdict.reasons,
        "notes": result.notes,
        **how(result),
        **models_output.numbers(result),
    }


def load_numbers(follows: Follows | None) -> dict[str, Any] | None:
    """By how much sigma0 and Fc follow the load: times 1 + slope (load - reference)."""
    if follows is None:
        return None
    return {
        "reference": follows.reference,
        "slope": follows.slope,
        "slope_standard_error": follows.error,
        "least": follows.ends[0],
        "most": follows.ends[1],
        "shares": list(follows.shares),
        "r2": follows.r2,
        "r2_without": follows.r2_without,
    }


def how(result: Result) -> dict[str, Any]:
    """How the numbers came about: options, cleaning, and what was found by cycle."""
    weights = [one.weight for one in result.logs if one.weight is not None]
    return {
        "version": __version__,
        "options": result.options,
        "load": load_numbers(result.follows),
        "median_rows": result.median,
        "torque_sign": result.sign,
        "angle_between_counts": result.inner,
        "rows_weighing_less": sum(int(np.count_nonzero((one > 0) & (one < 1))) for one in weights),
        "sum_of_weights": result.estimate.rows,
        "pieces": [one.rows for one in result.logs],
        "cycles": {
            "first_row": result.cycles.rows.tolist(),
            **{name: values.tolist() for name, values in result.cycles.value.items()},
        },
        "findings": [
            {"text": found.text, "doubts": list(found.doubts)} for found in result.findings
        ],
    }


def as_json(result: Result) -> str:
    return json.dumps(numbers(result), indent=2) + "\n"


def table(result: Result) -> Table:
    """For people."""
    from rich.table import Table

    estimate, models, log = result.estimate, result.models, result.logs[0]
    shown = Table(show_header=False, title=titled(result))
    shown.title_justify = "left"
    shown.add_row("verdict", result.verdict.text)
    whose = models_output.whose(result)
    if whose:
        shown.add_row("model", models_output.headlines(result)[0])
    for name, unit in (("sigma0", log.slope_unit), ("Fc", log.unit), ("a", f"1/{log.angle_unit}")):
        number = f"{getattr(estimate, name):.5g} {unit}{whose}"
        shown.add_row(name, f"{number}  {interval(result, name)}")
    for name, value in estimate.terms.items():
        shown.add_row(name, f"{value:.4g} {unit_of(name, log)}")
    fit = f"{result.r2:.4f}, {result.rmse:.3g} {log.unit}{whose}"
    shown.add_row("R2, rms on the rows fitted", fit)
    for name, words in (
        ("dahl", "Dahl"),
        ("coulomb", "Coulomb"),
        ("none", "no friction"),
        ("bilinear", "bilinear"),
    ):
        shown.add_row(
            f"held out: {words}",
            f"R2 {models.r2[name]:.4f}, rms {models.rmse[name]:.3g} {log.unit}",
        )
    if result.follows is not None:
        shown.add_row("load", result.follows.words)
    for name, r2 in result.checks.items():
        shown.add_row(f"check: {Path(name).name}", f"R2 {r2:.4f}, not fitted")
    shown.add_row("R2 of the plan, raw motion", f"{result.plan.r2:.4f}, friction alone")
    shown.add_row("reversals", str(result.reversals))
    shown.add_row("motion that informs sigma0", f"{100 * result.informs:.0f} % of the moving rows")
    for note in result.notes:
        shown.add_row("note", note)
    return shown


def interval(result: Result, name: str) -> str:
    one = result.estimate.ci95[name]
    high = f"{one.high:.5g}" if math.isfinite(one.high) else "no end"
    return f"95 %: {one.low:.5g} to {high}"


def header(result: Result, name: str) -> str:
    """dahl_plan_NAME.h. Raises dahl.Error for parameters that dahl_prepare() refuses."""
    from dahl import plan_header

    log, friction = result.logs[0], carried.of(result)
    count, about_count = _count_of_plan(result, friction.model)
    plans = friction.plans(count)
    comment = [
        f"Friction identified from {titled(result)}:",
        f"{result.verdict.text}.",
        models_output.about(result),
        result.follows.words + "." if result.follows else "",
        f"Dahl's sigma0 [{log.slope_unit}] {interval(result, 'sigma0')};"
        f" Fc [{log.unit}] {interval(result, 'Fc')}.",
        f"Dahl's R2 held out {result.models.r2['dahl']:.4f}; of this plan alone on the raw motion"
        f" {result.plan.r2:.4f}.",
        about_count,
        *(f"FORCED, although {words}." for words in result.plan.against),
        *(f"Note: {note}." for one in result.logs for note in one.notes),
    ]
    whole = [line.replace("*/", "* /") for line in comment]
    folded = [part for line in whole if line for part in textwrap.wrap(line, COMMENT)]
    text = plan_header.text(name, plans, folded)
    return plan_header.with_load(text, name, *friction.line) if friction.follows else text


def _count_of_plan(result: Result, model: str) -> tuple[float, str]:
    """Return theta_per_count of the plan and its origin. Only Dahl's model also moves by angle, so
    any other model needs a count even if the log shows no encoder.
    """
    count, log = result.plan.theta_per_count, result.logs[0]
    if count:
        whose = "the target's" if result.plan.of_target else "that of the encoder in the log"
        return count, f"theta_per_count is {whose} (--target-counts-per-turn)."
    if model == "dahl":
        return 0.0, "The log shows no encoder: this plan is for dahl_step() alone."
    count = _made_up_count(result)
    words = f"The log shows no encoder: theta_per_count = {count:.6g} {log.angle_unit} is made up"
    return count, f"{words}; --target-counts-per-turn sets yours."


def _made_up_count(result: Result) -> float:
    """For a log without an encoder, rad (m)."""
    return MADE_UP / result.estimate.a


def write_scene(result: Result, name: str, folder: Path) -> Path:
    """NAME.ini and NAME.csv: the first log, cleaned, for `dahl demo --scene`. Terms that a
    scene does not know are taken off.
    """
    log, friction = result.logs[0], carried.of(result)
    rows = slice(0, REPLAYED)
    rest = {term: value for term, value in friction.terms.items() if term not in OF_A_SCENE}
    beyond = load.more(log, result.follows)
    torque = clean.shifted(log.torque + beyond, friction.earlier)
    torque = (torque - torque_of(log, rest))[rows]
    theta = log.theta[rows] - log.theta[0]
    angle, force = (f"theta_{log.angle_unit}", "torque_N" if log.linear else "torque_Nm")
    names, columns = [angle, force], [theta, torque]
    if friction.follows is not None and log.load is not None:
        names, columns = [*names, "load"], [*columns, friction.load(log.load)[rows]]
    keep_table(folder / f"{name}.csv", np.column_stack(columns), ",".join(names), "%.9g")
    path = folder / f"{name}.ini"
    keep(path, _scene(result, name, angle, force))
    return path


def _scene(result: Result, name: str, angle: str, force: str) -> str:
    """The scene that replays NAME.csv."""
    log, estimate, shown = result.logs[0], result.estimate, carried.of(result)
    sigma0, Fc = (" ".join(map(repr, some)) for some in (shown.sigma0, shown.Fc))  # noqa: N806
    count = log.resolution or _made_up_count(result)
    size, unit = log.shown_in
    way = "position" if log.linear else "angle"
    rows = min(log.rows, REPLAYED)
    travelled = np.cumsum(np.abs(log.moves[:rows]))
    settled = int(np.searchsorted(travelled, 5 / estimate.a))
    lines = [
        f"; written by dahl identify: {result.verdict.text}",
        *(f"; {words}" for words in (models_output.about(result),) if words),
        "[scene]",
        f"title = {name}, identified",
        "[friction]",
        f"model = {shown.model}",
        f"sigma0 = {sigma0} ; {log.slope_unit}",
        f"Fc = {Fc} ; {log.unit}",
        *([f"kinds = {' '.join(shown.kinds)}"] if shown.kinds else []),
        f"theta_per_count = {count!r} ; {log.angle_unit}",
        *(["[load]", "full = 1", "column = load"] if shown.follows else []),
        "[motion]",
        "kind = log",
        f"file = {name}.csv",
        f"angle = {angle}",
        f"counts_per_unit = {1 / count!r}",
        "[status]",
        "period_ms = 100",
        "[measured]",
        f"torque = {force}",
        "torque_scale = 1",
        f"offset = {shown.terms.get('offset', 0.0)!r}",
        f"spring = {shown.terms.get('spring', 0.0)!r}",
        f"settle = {settled if settled < rows // 2 else 0}",
        f"angle_scale = {1 / size!r}",
        f"label_angle = {way} from the start [{unit}]",
        f"label_torque = friction [{log.unit}]",
    ]
    return "\n".join(lines) + "\n"


def write_all(result: Result, name: str, folder: Path, force: bool = False) -> list[Path]:
    """Every file; a plan only where nothing speaks against it or it is forced, and last, so that
    none of an earlier run stays beside new numbers.
    """
    from dahl.identify import draw

    folder.mkdir(parents=True, exist_ok=True)
    plan = folder / f"dahl_plan_{name}.h"
    plan.unlink(missing_ok=True)
    scene = write_scene(result, name, folder)
    json_file, picture, table = (scene.with_suffix(end) for end in (".json", ".png", ".csv"))
    keep(json_file, as_json(result))
    draw.draw(picture, result)
    written = [json_file, picture, table, scene]
    if force or not result.plan.against:
        keep(plan, header(result, name))
        written.append(plan)
    return written
