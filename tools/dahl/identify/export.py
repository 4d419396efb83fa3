# SPDX-License-Identifier: MIT
"""Export the friction that a firmware can run: a header with a plan, and a scene.

RunnableModel also says how good the plan is on the motion as it was measured.
"""

from __future__ import annotations

import math
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from dahl.errors import InputError
from dahl.identify.angle import smooth_angle
from dahl.identify.fit import Fit
from dahl.identify.lags import NONE
from dahl.identify.laws import DAHL, MIN_STRIBECK_COUNTS, OPTIONS, Law
from dahl.identify.result import Result, term_coefficients, terms_of
from dahl.identify.runnable import Runnable
from dahl.identify.samples import KNOTS, NO_CLOCK_STEP, SETTLE_LENGTHS, rates_of
from dahl.identify.select import best_of
from dahl.io import encoder_grid
from dahl.io.files import write_atomic
from dahl.sim import scene_writer

if TYPE_CHECKING:
    from dahl.io.log import Log

MIN_PLAN_R2 = 0.9  # on the raw motion; a worse plan does more harm than good
MAX_REPLAYED_ROWS = 200_000  # of the first log, in a scene
COMMENT_WIDTH = 110  # columns
SCENE_TERMS = ("offset", "spring")  # keys of [measured] in a scene
NO_ENCODER_COUNT = 1e-3  # presliding lengths per count, if the log shows no encoder


@dataclass(frozen=True)
class RunnableModel:
    """The friction of a result as a firmware runs it. It has no filter, delay or terms."""

    result: Result
    fit: Fit
    friction: Runnable

    @property
    def terms(self) -> dict[str, float]:
        """Coefficients of the terms that were fitted with it."""
        return terms_of(self.fit, self.result.samples)

    @property
    def lost_r2(self) -> float:
        """R2 on left-out cycles that the best hypothesis has more."""
        more = self.fit.total - self.result.plausible.best.total
        return max(more / self.result.spread, 0.0)

    @property
    def theta_per_count(self) -> float:
        """Of the plan, rad (m); 0 if there is no encoder."""
        log, target = self.result.logs[0], self.result.options.target_counts
        return (1e-3 if log.linear else 2 * math.pi) / target if target else log.resolution

    @property
    def about(self) -> str:
        """Which model is exported and what it loses; "" if it is Dahl's, as chosen."""
        law, chosen = self.fit.hypothesis.law, self.result.hypothesis.law
        if law is chosen is DAHL:
            return self.outside
        why = "asked for" if self.result.options.model else "chosen"
        if not self.result.options.model and law is not chosen:
            why = f"the nearest that the library runs to {chosen.label}"
        loss = f"it loses {self.lost_r2:.4f} of R2 on cycles left out"
        return f"The model is {law.label}, {why}; {loss}. {self.outside}".strip()

    @property
    def outside(self) -> str:
        """Which exported numbers lie outside the claimed intervals, and why; "" if none does."""
        found = []
        follows_load = self.fit.hypothesis.law.follows_load
        for name, value in () if follows_load else self.friction.sums.items():
            p = getattr(self.result, name)
            if p.claimed and not p.low <= value <= p.high:
                found.append(f"its {name}, {value:.4g}, is outside {p.low:.4g} to {p.high:.4g}")
        why = "a simpler law without a lag fits best so on average"
        return f"Note that {' and '.join(found)}: {why}." if found else ""

    @cached_property
    def plan_r2(self) -> float:
        """R2 of the plan by counts on the raw motion, with the best torque at each start.

        All other torques that were fitted are taken out first, such as gravity and inertia. Offset
        and spring are those that suit the plan.
        """
        lost = spread = 0.0
        count, friction = self.theta_per_count, self.friction
        for log in self.result.logs:
            theta = log.theta - log.theta[0]
            theta = np.round(theta / count) * count if count else theta
            moves = np.diff(theta, prepend=0.0)
            measured = self.result.sign * log.torque - _other_torque(self.result, log)
            torque = friction.torque(moves, log.load)
            fading = np.exp(-np.minimum(friction.a * np.cumsum(np.abs(moves)), 700.0))
            free = np.column_stack((fading, *_free_terms(self.result, log)))
            left = measured - torque
            left -= free @ np.linalg.lstsq(free.T @ free, free.T @ left, rcond=None)[0]
            lost += float(left @ left)
            spread += float(np.sum((measured - measured.mean()) ** 2))
        return 1 - lost / spread if spread else 0.0

    @cached_property
    def against(self) -> list[str]:
        """Reasons not to write the plan."""
        result, count, r2 = self.result, self.theta_per_count, self.plan_r2
        options = result.options
        grid = "" if options.trust_units else encoder_grid.contradiction(result.logs[0])
        reasons = {
            "the library has no plan for Coulomb's model": _wanted(result) is None,
            "sigma0 and Fc are not both identifiable": not all(result.claimed),
            f"it explains {100 * r2:.0f} % of the friction on the raw motion,"
            f" {100 * MIN_PLAN_R2:.0f} % is the least": r2 < MIN_PLAN_R2,
            "it does not model the play that the log shows": result.play > 0,
            "the log shows no encoder, and this model works by counts alone": not count
            and self.friction.needs_encoder,
            grid: bool(grid) and not options.target_counts,
        }
        return [words for words, holds in reasons.items() if holds]


def _other_torque(result: Result, log: Log) -> np.ndarray:
    """Return the torque of the fitted terms at each row of a log: (n,) N m (N)."""
    reference = result.samples.reference
    z = (log.theta - reference.centre) / reference.reach
    coefficients = term_coefficients(result.chosen, result.samples)
    torque = np.zeros(log.rows)
    for name, power in (("offset", 0), ("spring", 1), ("cubic", 3)):
        torque += coefficients.get(name, np.zeros(1)) * z**power
    if "waves" in coefficients:
        torque += np.interp(z, np.linspace(-1, 1, KNOTS), [0.0, *coefficients["waves"]])
    timed = [coefficients.get(name, np.zeros(1)) for name in ("viscous", "inertia")]
    if any(map(np.any, timed)):
        noise, time = result.samples.noise, log.time
        time = NO_CLOCK_STEP * np.arange(log.rows) if time is None else time
        smooth = smooth_angle(log.theta, log.resolution, noise)
        rates = rates_of(log.theta, smooth, time, 0.0 if noise else log.resolution)
        torque += sum(c * rate for c, rate in zip(timed, rates, strict=True))
    return torque


def _free_terms(result: Result, log: Log) -> list[np.ndarray]:
    """Return the columns of offset and spring, if they were fitted."""
    columns = {"offset": np.ones(log.rows), "spring": log.theta - log.theta.mean()}
    return [columns[name] for name in SCENE_TERMS if name in result.hypothesis.terms]


def _wanted(result: Result) -> Law | None:
    """Return the law of --model or the chosen one; None if no fit is of the law of --model."""
    return OPTIONS.get(result.options.model, result.hypothesis.law)


@lru_cache(maxsize=1)  # JSON, tables, picture and header of one result need it
def runnable_model(result: Result) -> RunnableModel:
    """Return the law of --model or the chosen one; the nearest one if the library lacks it."""
    wanted = _wanted(result)
    library = [f for f in result.fits if f.hypothesis.law.can_run(f, result.samples)]
    same = [f for f in library if f.hypothesis.law is wanted]
    if result.options.model and wanted is not None and not same:
        raise InputError(f"--model {result.options.model}: this law does not fit the log")
    is_chosen = wanted is result.hypothesis.law and wanted.can_run(result.chosen, result.samples)
    fit = result.chosen if is_chosen else _alone(result, best_of(same or library))
    friction = fit.hypothesis.law.runnable(fit, result.samples)
    return RunnableModel(result, fit, friction)


def _alone(result: Result, fit: Fit) -> Fit:
    """Fit a law as a plan runs it, without a lag; with the terms of the result if that fits."""
    if fit.hypothesis.law.follows_load:
        return fit
    h = replace(fit.hypothesis, lag=NONE, skew=0.0)
    start = fit.p[: h.law.parameters]
    sets = (result.hypothesis.terms, SCENE_TERMS, ("offset",))
    alone = (result.fitter.fit(replace(h, terms=terms), start) for terms in sets)
    return next((one for one in alone if one is not None), fit)


# --- header ---------------------------------------------------------------------------------------


def header(model: RunnableModel, name: str, title: str) -> str:
    """Return dahl_plan_NAME.h. Raises dahl.Error for parameters that dahl_prepare() rejects."""
    from dahl.binding import plan_header

    result, log = model.result, model.result.logs[0]
    whose = "the target's" if result.options.target_counts else "that of the encoder in the log"
    comment = [
        f"Friction identified from {title}:",
        f"{result.verdict}.",
        model.about,
        model.friction.note,
        *(
            f"{name} [{result.units[name]}]: 95 % within {p.low:.5g} to {p.high:.5g}."
            for name, p in (("sigma0", result.sigma0), ("Fc", result.Fc))
        ),
        f"R2 on cycles left out {result.r2_of(model.fit):.4f}; of this plan alone on the raw motion"
        f" {model.plan_r2:.4f}.",
        f"theta_per_count is {whose} (--target-counts-per-turn)."
        if model.theta_per_count
        else "The log shows no encoder: this plan is for dahl_step() alone.",
        *(f"FORCED, although {words}." for words in model.against),
        *(f"Note: {note}." for one in result.logs for note in one.notes),
    ]
    whole = [line.replace("*/", "* /") for line in comment if line]
    folded = [part for line in whole for part in textwrap.wrap(line, COMMENT_WIDTH)]
    text = plan_header.text(name, model.friction.plans(model.theta_per_count), folded)
    Fc_low, length, high = result.compensator_bounds or (None, None, None)  # noqa: N806
    if Fc_low is not None and length is not None and high is not None:
        text += plan_header.bounds(name, Fc_low, length, high, log.unit, log.angle_unit)
    load = model.friction.load
    return text if load is None else plan_header.with_load(text, name, *load)


# --- scene ----------------------------------------------------------------------------------------


def write_scene(model: RunnableModel, name: str, folder: Path) -> Path:
    """Write NAME.ini and NAME.csv, the first piece, for `dahl demo --scene`.

    The delay of the torque is removed, and so are viscous and inertia torque, for which a scene has
    no keys.
    """
    result, log = model.result, model.result.logs[0]
    places = np.arange(log.rows)
    torque = np.interp(places + result.delay_rows, places, result.sign * log.torque)
    if log.time is not None and {"viscous", "inertia"} & set(model.terms):
        speed = np.gradient(log.theta, log.time)
        other = model.terms.get("viscous", 0.0) * speed
        torque -= other + model.terms.get("inertia", 0.0) * np.gradient(speed, log.time)
    names = [f"theta_{log.angle_unit}", "torque_N" if log.linear else "torque_Nm"]
    columns = [log.theta - log.theta[0], torque]
    if model.friction.load is not None and log.load is not None:
        names, columns = [*names, "load"], [*columns, model.friction.shares(log.load)]
    columns = [column[:MAX_REPLAYED_ROWS] for column in columns]
    write_csv(folder / f"{name}.csv", columns, ",".join(names), ",".join(["%.9g"] * len(names)))
    path = folder / f"{name}.ini"
    write_atomic(path, _scene(model, name, *names[:2]))
    return path


def _scene(model: RunnableModel, name: str, angle: str, force: str) -> str:
    result, log, friction = model.result, model.result.logs[0], model.friction
    sigma0, Fc = (" ".join(map(repr, some)) for some in (friction.sigma0, friction.Fc))  # noqa: N806
    kinds = " ".join(element.name for element in friction.elements)
    count = log.resolution or NO_ENCODER_COUNT / friction.a
    if friction.own is not None and not log.resolution:
        count = min(count, friction.own / MIN_STRIBECK_COUNTS)
    size, unit = log.shown_in
    offset, spring = (model.terms.get(term, 0.0) for term in SCENE_TERMS)
    from_centre = float(log.theta[0]) - result.samples.reference.centre
    moved = np.cumsum(np.abs(log.moves[:MAX_REPLAYED_ROWS]))
    settled = int(np.searchsorted(moved, SETTLE_LENGTHS / friction.a))
    words = f"written by dahl identify: {result.verdict}. {model.about}"
    sections: scene_writer.Sections = {
        "scene": {"title": f"{name}, identified"},
        "friction": {
            "model": friction.model,
            "sigma0": f"{sigma0} ; {log.slope_unit}",
            "Fc": f"{Fc} ; {log.unit}",
            "kinds": kinds if friction.is_mixed else None,
            "theta_per_count": f"{count!r} ; {log.angle_unit}",
            friction.model: None if friction.own is None else repr(friction.own),
        },
        **({"load": {"full": 1, "column": "load"}} if friction.load else {}),
        "motion": {
            "kind": "log",
            "file": f"{name}.csv",
            "angle": angle,
            "counts_per_unit": 1 / count,
        },
        **scene_writer.STATUS,
        "measured": {
            "torque": force,
            "torque_scale": 1,
            "offset": offset + spring * from_centre,
            "spring": spring,
            "settle": settled if settled < len(moved) // 2 else 0,  # until the start is forgotten
            "angle_scale": 1 / size,
            "label_angle": f"{'position' if log.linear else 'angle'} from the start [{unit}]",
            "label_torque": f"friction [{log.unit}]",
        },
    }
    return scene_writer.text_of(sections, *textwrap.wrap(words, COMMENT_WIDTH))


def write_csv(path: Path, columns: Sequence[np.ndarray], names: str, forms: str) -> None:
    """Write a CSV; `forms` has the format of each column."""
    rows = zip(*(column.tolist() for column in columns), strict=True)
    text = "".join(f"{forms}\n" % row for row in rows)  # three times as fast as np.savetxt()
    write_atomic(path, f"{names}\n{text}")
