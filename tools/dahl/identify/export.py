# SPDX-License-Identifier: MIT
"""Export the friction that a firmware can run: a header with a plan, and a scene.

plan_quality() says how good the plan is on the motion as it was measured.
"""

from __future__ import annotations

import io
import math
import textwrap
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from dahl.errors import Error
from dahl.identify import encoder_grid, models
from dahl.identify.fit import Fit
from dahl.identify.models import LAWS, OPTIONS
from dahl.identify.result import Result, terms_of
from dahl.identify.samples import SETTLE_LENGTHS
from dahl.identify.select import best_of
from dahl.io.files import write_atomic
from dahl.io.log import Log

if TYPE_CHECKING:
    from dahl.binding.plan_header import AnyPlan

MIN_PLAN_R2 = 0.9  # on the raw motion; a worse plan does more harm than good
MAX_REPLAYED_ROWS = 200_000  # of the first log, in a scene
COMMENT_WIDTH = 110  # columns
SCENE_TERMS = ("offset", "spring")  # keys of [measured] in a scene
NO_ENCODER_COUNT = 1e-3  # presliding lengths per count, if the log shows no encoder
MIN_LOAD_SHARE = 1e-3  # of the load that the plan is for


@dataclass(frozen=True)
class RunnableModel:
    """One friction model by the keys of a scene. N m and rad, or N and m."""

    fit: Fit
    model: str  # dahl, slip, parallel, asymmetric or loaded
    sigma0: tuple[float, ...]
    Fc: tuple[float, ...]  # of each element; asymmetric: forward and backward
    kinds: tuple[str, ...]  # dahl or slip for each element
    terms: dict[str, float]
    lost_r2: float = 0.0  # on left-out cycles, compared with the best hypothesis
    load: tuple[float, float] = (1.0, 0.0)  # share of the load that the plan is for: at 0, per unit

    @property
    def a(self) -> float:
        """sigma0/Fc of all elements together, 1/rad (1/m)."""
        return sum(self.sigma0) / (sum(self.Fc) / (2 if self.model == "asymmetric" else 1))

    def torque(self, moves: np.ndarray, load: np.ndarray | None = None) -> np.ndarray:
        """Return the torque after each move, from rest: (n,) N m (N)."""
        whole = [slice(0, len(moves))]
        if self.model == "loaded" and load is not None:
            share = np.maximum(self.load[0] + self.load[1] * load, MIN_LOAD_SHARE)
            return self.Fc[0] * models.dahl_under_load(moves, whole, self.a, share)
        if self.model == "asymmetric":
            half, mean = sum(self.Fc) / 2, (self.Fc[0] - self.Fc[1]) / 2
            w = models.asymmetric(moves, whole, self.a, mean / half)
            return mean + half * w
        torque, laws = np.zeros(len(moves)), {"dahl": models.dahl, "slip": models.slip}
        for kind, sigma0, Fc in zip(self.kinds, self.sigma0, self.Fc, strict=True):  # noqa: N806
            torque += Fc * laws[kind](moves, whole, sigma0 / Fc)
        return torque

    def plans(self, theta_per_count: float) -> dict[str, AnyPlan]:
        """Return the plans of a firmware by the endings of their names.

        Raises dahl.Error for parameters that the library rejects.
        """
        from dahl.binding.asymmetric import Asymmetric
        from dahl.binding.friction import Plan
        from dahl.binding.slip import Slip

        if self.model == "asymmetric":
            return {"": Asymmetric(self.sigma0[0], self.Fc[0], self.Fc[1], theta_per_count)}
        several = self.model == "parallel"
        parts = list(zip(self.kinds, self.sigma0, self.Fc, strict=True))
        dahls = [Plan(s, Fc, theta_per_count) for kind, s, Fc in parts if kind == "dahl"]
        found: dict[str, AnyPlan] = {
            f"_{k + 1}" if several else "": one for k, one in enumerate(dahls)
        }
        slips = [(s, Fc) for kind, s, Fc in parts if kind == "slip"]
        if slips:
            sigma0, limits = zip(*slips, strict=True)
            found["_slip" if several else ""] = Slip(sigma0, limits, theta_per_count)
        return found


def runnable_model(result: Result) -> RunnableModel:
    """Return the law of --model or the chosen one; the nearest one if the library lacks it."""
    wanted = OPTIONS.get(result.options.model, result.hypothesis.law)
    library = [f for f in result.fits if LAWS[f.hypothesis.law].in_library]
    same = [f for f in library if f.hypothesis.law == wanted]
    if result.options.model and wanted != "coulomb" and not same:
        raise Error(f"--model {result.options.model}: this law does not fit the log")
    is_chosen = wanted == result.hypothesis.law and LAWS[wanted].in_library
    fit = result.chosen if is_chosen else _alone(result, best_of(same or library))
    return _runnable(result, fit)


def _alone(result: Result, fit: Fit) -> Fit:
    """Fit a law as a plan runs it: without a lag, and with offset and spring at most."""
    if fit.hypothesis.law == "loaded":
        return fit
    h = replace(fit.hypothesis, lag="none", skew=0.0)
    start = fit.p[: h.friction.parameters]
    alone = (result.fitter.fit(replace(h, terms=t), start) for t in (SCENE_TERMS, ("offset",)))
    return next((one for one in alone if one is not None), fit)


def _runnable(result: Result, fit: Fit) -> RunnableModel:
    law, terms = fit.hypothesis.friction, terms_of(fit, result.samples)
    Fc, sigma0 = fit.limits, tuple(fit.slopes.tolist())  # noqa: N806
    lost = max((fit.total - result.plausible.best.total) / result.spread, 0.0)
    kinds = tuple("dahl" if kind == "loaded" else kind for kind in law.kinds)
    if fit.hypothesis.law == "asymmetric":
        limits = (float(Fc[0] * (1 + fit.p[1])), float(Fc[0] * (1 - fit.p[1])))
        return RunnableModel(fit, "asymmetric", sigma0, limits, kinds, terms, lost)
    if fit.hypothesis.law == "loaded":
        return _loaded(result, fit, terms, lost)
    model = kinds[0] if len(set(kinds)) == 1 and (kinds[0] == "slip" or len(kinds) == 1) else ""
    return RunnableModel(fit, model or "parallel", sigma0, tuple(Fc.tolist()), kinds, terms, lost)


def _loaded(result: Result, fit: Fit, terms: dict[str, float], lost: float) -> RunnableModel:
    """Return the model with sigma0 and Fc at the largest load of the logs."""
    assert result.samples.load is not None
    reference, slope = result.samples.reference.load, float(fit.p[1])
    at = 1 + slope * (result.samples.load / reference - 1)
    most = float(at.max())
    Fc = float(fit.limits[0]) * most  # noqa: N806
    line = ((1 - slope) / most, slope / reference / most)
    sigma0 = float(fit.slopes[0]) * most
    return RunnableModel(fit, "loaded", (sigma0,), (Fc,), ("dahl",), terms, lost, line)


# --- quality of a plan ----------------------------------------------------------------------------


@dataclass(frozen=True)
class PlanQuality:
    """How good a plan is in a firmware, which has no filter, delay or terms."""

    theta_per_count: float  # rad (m); 0 if there is no encoder
    is_for_target: bool  # for --target-counts-per-turn, not for the encoder of the log
    r2: float  # of friction alone on the raw motion
    against: list[str]  # reasons not to write it


def plan_quality(result: Result, model: RunnableModel) -> PlanQuality:
    log, target = result.logs[0], result.options.target_counts
    turn = 1e-3 if log.linear else 2 * math.pi
    count = turn / target if target else log.resolution
    r2 = _r2_on_raw_motion(result, model, count)
    grid = "" if result.options.trust_units else encoder_grid.contradiction(log)
    reasons = {
        "the library has no plan for Coulomb's model": result.options.model == "coulomb",
        "sigma0 and Fc are not both identifiable": not all(result.claimed),
        f"it explains {100 * r2:.0f} % of the friction on the raw motion,"
        f" {100 * MIN_PLAN_R2:.0f} % is the least": r2 < MIN_PLAN_R2,
        "it does not model the play that the log shows": result.play > 0,
        "the log shows no encoder, and this model works by counts alone": not count
        and model.model != "dahl",
        grid: bool(grid) and not target,
    }
    against = [words for words, holds in reasons.items() if holds]
    return PlanQuality(count, bool(target), r2, against)


def _r2_on_raw_motion(result: Result, model: RunnableModel, count: float) -> float:
    """Return R2 of the plan by counts, with the best torque at the start of each piece."""
    lost = spread = 0.0
    centre = result.samples.reference.centre
    for log in result.logs:
        theta = log.theta - log.theta[0]
        theta = np.round(theta / count) * count if count else theta
        resting = model.terms.get("offset", 0.0) + model.terms.get("spring", 0.0) * (
            log.theta - centre
        )
        measured = result.sign * log.torque - resting
        left = measured - from_best_start(model, np.diff(theta, prepend=0.0), measured, log.load)
        lost += float(left @ left)
        spread += float(np.sum((measured - measured.mean()) ** 2))
    return 1 - lost / spread if spread else 0.0


def from_best_start(
    model: RunnableModel, moves: np.ndarray, measured: np.ndarray, load: np.ndarray | None = None
) -> np.ndarray:
    """Return the torque of the model with the best torque at the first row: (n,) N m (N)."""
    torque = model.torque(moves, load)
    fading = np.exp(-np.minimum(model.a * np.cumsum(np.abs(moves)), 700.0))
    first = float(fading @ (measured - torque) / (fading @ fading))
    started: np.ndarray = torque + fading * first
    return started


# --- header ---------------------------------------------------------------------------------------


def header(
    result: Result, model: RunnableModel, quality: PlanQuality, name: str, title: str
) -> str:
    """Return dahl_plan_NAME.h. Raises dahl.Error for parameters that dahl_prepare() rejects."""
    from dahl.binding import plan_header

    log = result.logs[0]
    whose = "the target's" if quality.is_for_target else "that of the encoder in the log"
    comment = [
        f"Friction identified from {title}:",
        f"{result.verdict}.",
        about(result, model),
        *(
            f"{name} [{result.units[name]}]: 95 % within {p.low:.5g} to {p.high:.5g}."
            for name, p in (("sigma0", result.sigma0), ("Fc", result.Fc))
        ),
        f"R2 on cycles left out {result.r2_of(model.fit):.4f}; of this plan alone on the raw motion"
        f" {quality.r2:.4f}.",
        f"theta_per_count is {whose} (--target-counts-per-turn)."
        if quality.theta_per_count
        else "The log shows no encoder: this plan is for dahl_step() alone.",
        *(f"FORCED, although {words}." for words in quality.against),
        *(f"Note: {note}." for one in result.logs for note in one.notes),
    ]
    whole = [line.replace("*/", "* /") for line in comment if line]
    folded = [part for line in whole for part in textwrap.wrap(line, COMMENT_WIDTH)]
    text = plan_header.text(name, model.plans(quality.theta_per_count), folded)
    if result.compensator_bounds:
        text += plan_header.bounds(name, *result.compensator_bounds, log.unit, log.angle_unit)
    return plan_header.with_load(text, name, *model.load) if model.model == "loaded" else text


def about(result: Result, model: RunnableModel) -> str:
    """Return which model is exported and what it loses; "" if it is Dahl's, as chosen."""
    law = model.fit.hypothesis.friction
    if law.name == result.hypothesis.law == "dahl":
        return ""
    why = "asked for" if result.options.model else "chosen"
    if not result.options.model and law.name != result.hypothesis.law:
        why = f"the nearest that the library runs to {result.hypothesis.friction.label}"
    return (
        f"The model is {law.label}, {why}; it loses {model.lost_r2:.4f} of R2 on cycles left out."
    )


# --- scene ----------------------------------------------------------------------------------------


def write_scene(result: Result, model: RunnableModel, name: str, folder: Path) -> Path:
    """Write NAME.ini and NAME.csv, the first piece, for `dahl demo --scene`.

    The delay of the torque is removed. Terms that a scene lacks are subtracted.
    """
    log, rows = result.logs[0], slice(0, MAX_REPLAYED_ROWS)
    places = np.arange(log.rows)
    torque = np.interp(places + result.delay_rows, places, result.sign * log.torque)
    angle, force = (f"theta_{log.angle_unit}", "torque_N" if log.linear else "torque_Nm")
    names = [angle, force]
    columns = [log.theta - log.theta[0], torque - _other_terms(model, log)]
    if model.model == "loaded" and log.load is not None:
        names, columns = [*names, "load"], [*columns, model.load[0] + model.load[1] * log.load]
    write_csv(folder / f"{name}.csv", np.column_stack(columns)[rows], ",".join(names), "%.9g")
    path = folder / f"{name}.ini"
    write_atomic(path, _scene(result, model, name, angle, force))
    return path


def _other_terms(model: RunnableModel, log: Log) -> np.ndarray:
    """Return viscous and inertia torque, for which a scene has no keys."""
    torque = np.zeros(log.rows)
    if log.time is None or not {"viscous", "inertia"} & set(model.terms):
        return torque
    speed = np.gradient(log.theta, log.time)
    torque += model.terms.get("viscous", 0.0) * speed
    torque += model.terms.get("inertia", 0.0) * np.gradient(speed, log.time)
    return torque


def _scene(result: Result, model: RunnableModel, name: str, angle: str, force: str) -> str:
    log = result.logs[0]
    sigma0, Fc = (" ".join(map(repr, some)) for some in (model.sigma0, model.Fc))  # noqa: N806
    count = log.resolution or NO_ENCODER_COUNT / model.a
    size, unit = log.shown_in
    from_centre = float(log.theta[0]) - result.samples.reference.centre
    offset = model.terms.get("offset", 0.0) + model.terms.get("spring", 0.0) * from_centre
    words = f"written by dahl identify: {result.verdict}. {about(result, model)}"
    lines = [
        *(f"; {line}" for line in textwrap.wrap(words, COMMENT_WIDTH)),
        "[scene]",
        f"title = {name}, identified",
        "[friction]",
        f"model = {model.model}",
        f"sigma0 = {sigma0} ; {log.slope_unit}",
        f"Fc = {Fc} ; {log.unit}",
        *([f"kinds = {' '.join(model.kinds)}"] if model.model == "parallel" else []),
        f"theta_per_count = {count!r} ; {log.angle_unit}",
        *(["[load]", "full = 1", "column = load"] if model.model == "loaded" else []),
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
        f"offset = {offset!r}",
        f"spring = {model.terms.get('spring', 0.0)!r}",
        f"settle = {_settled_rows(log.moves[:MAX_REPLAYED_ROWS], model.a)}",
        f"angle_scale = {1 / size!r}",
        f"label_angle = {'position' if log.linear else 'angle'} from the start [{unit}]",
        f"label_torque = friction [{log.unit}]",
    ]
    return "\n".join(lines) + "\n"


def _settled_rows(moves: np.ndarray, a: float) -> int:
    """Return the rows until the torque at the start is forgotten; 0 if these are half of all."""
    settled = int(np.searchsorted(np.cumsum(np.abs(moves)), SETTLE_LENGTHS / a))
    return settled if settled < len(moves) // 2 else 0


def write_csv(path: Path, columns: np.ndarray, names: str, form: str | list[str]) -> None:
    """Write a CSV; an old file stays until the new one is complete."""
    text = io.StringIO()
    np.savetxt(text, columns, fmt=form, delimiter=",", header=names, comments="")
    write_atomic(path, text.getvalue())
