# SPDX-License-Identifier: MIT
"""The result of an identification, and the one rule that decides what is claimed."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from dahl.identify.fit import Fit, Fitter, Hypothesis, Optimum, parameters_of
from dahl.identify.lags import NONE, PLAY
from dahl.identify.least_squares import cost_of, solve
from dahl.identify.refusals import SOURCES as STEPS_OF_SOURCES
from dahl.identify.refusals import next_step
from dahl.identify.samples import MIN_SCORED_CYCLES, Samples, samples_of
from dahl.io.log import Log

if TYPE_CHECKING:
    import pandas as pd

    from dahl.identify.diagnose import Lack
    from dahl.identify.select import Plausible

NAMES = ("sigma0", "Fc")
SLIP_LENGTHS = 3  # presliding lengths that a compensator needs if slip elements fit best
MAX_HALF_WIDTH = 0.3  # of the value; a wider interval is no basis for a firmware
MIN_REACHED = 0.8  # of Fc, by the friction in a log; Dahl's law alone may extrapolate further
MIN_PLAY_COUNTS = 1.5  # of a play that is not the travel hidden by a count
BOUND_MARGIN = 1.1  # of bounds from intervals that are not claimed
MUCH_MORE = 3.0  # times the gain of a row of diagnose.py, from which another row is the cause
MIN_LEFT = 0.9  # of the cost that other torques leave, that friction leaves too if there is none
NOISELESS = 1e-8  # of the variance of a torque: less is rounding
MIN_R2 = 0.5  # on cycles left out; below it most of the torque is not friction
POWERS_OF_REACH = {"spring": 1, "cubic": 3}  # by which samples.py divides the angle of these terms
SOURCES = {  # of the width of an interval, in the order in which they are added
    "noise": "noise",
    "hypotheses": "the choice of law, lag and terms",
    "lack of fit": "a torque that no hypothesis explains",
    "counts": "travel that a count hides",
}


@dataclass(frozen=True)
class Parameter:
    """A number with its 95 % interval. `uncertainty` is the dominant source of its width."""

    value: float
    low: float
    high: float
    claimed: bool
    uncertainty: str

    @property
    def half_width(self) -> float:
        """Relative, of the wider side."""
        return half_width_of(self.value, self.low, self.high)


def half_width_of(value: float, low: float, high: float) -> float:
    """Relative half width of the wider side of an interval: the truth is within it."""
    return max(high - value, value - low) / value


@dataclass
class Intervals:
    """sigma0 and Fc with what their intervals come from: arrays (2,)."""

    value: np.ndarray
    low: np.ndarray
    high: np.ndarray
    widths: dict[str, np.ndarray]  # relative half widths by source; all but "counts" cumulative

    def dominant(self, k: int) -> str:
        """The source that most of an interval comes from."""
        nested = {name: float(w[k]) for name, w in self.widths.items() if name != "counts"}
        own = np.diff([0.0, *nested.values()]).tolist()
        shares = dict(zip(nested, own, strict=True))
        if "counts" in self.widths:
            shares["counts"] = float(self.widths["counts"][k])
        return max(shares, key=lambda name: shares[name])


@dataclass(eq=False)
class Result:
    """All that was found. Torque in N m and angle in rad, or N and m for linear motion."""

    raw: list[Log]  # as given
    logs: list[Log]  # preprocessed pieces
    samples: Samples
    fitter: Fitter
    sign: float  # -1 if the torque was used with the other sign
    options: Any
    fits: list[Fit]
    plausible: Plausible
    lacks: list[Lack]
    intervals: Intervals
    claimed: tuple[bool, bool] = (False, False)
    reasons: list[str] = field(default_factory=list)
    refusals: dict[str, tuple[str, str]] = field(default_factory=dict)  # reason and next step
    are_swapped: bool = False  # angle and torque
    checks: dict[str, float] = field(default_factory=dict)  # log not fitted -> R2

    # --- numbers ---

    @property
    def names(self) -> list[str]:
        """Names of the logs, each once."""
        return list(dict.fromkeys(log.name for log in self.raw))

    @property
    def units(self) -> dict[str, str]:
        """Units of sigma0, Fc and a."""
        log = self.logs[0]
        return {"sigma0": log.slope_unit, "Fc": log.unit, "a": f"1/{log.angle_unit}"}

    @property
    def chosen(self) -> Fit:
        """The simplest plausible hypothesis; sigma0 and Fc are its numbers."""
        return self.plausible.chosen

    @property
    def hypothesis(self) -> Hypothesis:
        """Law, lag, treatment of the angle and terms of the chosen hypothesis."""
        return self.chosen.hypothesis

    @property
    def sigma0(self) -> Parameter:
        """Slope dF/dtheta at rest, N m/rad (N/m)."""
        return self._parameter(0)

    @property
    def Fc(self) -> Parameter:  # noqa: N802
        """Torque at full slip, N m (N)."""
        return self._parameter(1)

    @property
    def a(self) -> Parameter:
        """sigma0/Fc, 1/rad (1/m)."""
        s, c = self.sigma0, self.Fc
        low = s.low / c.high if c.high > 0 else 0.0
        high = s.high / c.low if c.low > 0 else np.inf
        return Parameter(s.value / c.value, low, high, s.claimed and c.claimed, s.uncertainty)

    @property
    def compensator_bounds(self) -> tuple[float | None, float | None, float | None] | None:
        """Fc_low in N m (N), length_long in rad (m) and sigma0_high in N m/rad (N/m) for
        dahl_compensator.h, from the ends of the 95 % intervals; None if there is a reason against
        them.

        An end may be known although the interval is too wide for a claim; a margin is then added. A
        bound whose interval has no end is None, and so is sigma0_high if the log hides the slope at
        rest. If Fc changes with speed or direction, its least value counts for Fc_low, its largest
        for length_long. The length is that of the breakaway, which is more than Fc/sigma0 if the
        slope falls early. Slip elements lose no energy in presliding, so length_long is three times
        theirs.
        """
        if self.against_bounds:
            return None
        law, fit = self.hypothesis.law, self.chosen
        alike = [fit.p for fit in self.plausible.fits if fit.hypothesis.law is law]
        ranges = [law.limit_range(self.samples, p) for p in (fit.p, *alike)]
        least, most = zip(*ranges, strict=True)
        lengths = max(most) * (SLIP_LENGTHS if law.has_slip else 1)
        lengths *= law.rise_lengths(fit)
        margin = 1.0 if all(self.claimed) else BOUND_MARGIN
        is_asked = any("angle" in log.questions for log in self.raw)
        Fc_low = min(least) * self.Fc.low / margin  # noqa: N806
        length_long = lengths * margin / self.a.low if self.a.low > 0 and not is_asked else None
        sigma0_high = self.sigma0.high * margin
        is_hidden = any(_against_sigma0(self, self.intervals))
        is_known = np.isfinite(sigma0_high) and not is_asked and not is_hidden
        return Fc_low or None, length_long, sigma0_high if is_known else None

    @property
    def against_bounds(self) -> str:
        """Reason against bounds for a compensator; "" if there is none."""
        if self.hypothesis.law.follows_load:
            return "the friction follows a load"
        if self.play > 0:
            return "a play is between encoder and friction"
        if all(self.claimed):
            return ""
        doubts = [*_against_units(self), *_against_log(self), *_against_lacks(self)]
        return next((text for against, _, text in doubts if all(against)), "")

    def _parameter(self, k: int) -> Parameter:
        i = self.intervals
        ends = float(i.value[k]), max(float(i.low[k]), 0.0), float(i.high[k])
        return Parameter(*ends, self.claimed[k], i.dominant(k))

    @property
    def r2(self) -> float:
        """Of the chosen hypothesis, on cycles that were left out."""
        return self.r2_of(self.chosen)

    def r2_of(self, fit: Fit) -> float:
        """R2 of a fit, on cycles that were left out."""
        return 1 - fit.total / self.spread

    @cached_property
    def spread(self) -> float:
        """Sum of squares of the torque around its mean, as the fit weighs it."""
        gram = self.samples.grams(np.ones((self.samples.rows, 1))).sum(axis=0)
        return float(gram[1, 1] - gram[0, 1] ** 2 / gram[0, 0])

    @property
    def delay_rows(self) -> float:
        """Rows by which the torque is late in the chosen hypothesis."""
        return self.delay_of(self.chosen)

    def delay_of(self, fit: Fit) -> float:
        """Rows by which the torque is late in a fit: the mean of all logs."""
        h = fit.hypothesis
        late = float(np.mean(fit.p[h.law.parameters :])) if h.lag.is_delay else 0.0
        return (late + h.skew) * self.samples.block

    @property
    def play(self) -> float:
        """Width of the play between encoder and bearing in the chosen hypothesis, rad (m).

        A play of about a count is the travel that a count hides at a turn: 0.
        """
        width = self.hypothesis.lag.play(self.chosen.p)
        return width if width > MIN_PLAY_COUNTS * self.samples.count else 0.0

    @property
    def terms(self) -> dict[str, float]:
        """Coefficients of the terms: offset [N m], spring [N m/rad], viscous, inertia."""
        return terms_of(self.chosen, self.samples)

    # --- views for people and programs ---

    @cached_property
    def predicted(self) -> np.ndarray:
        """Torque of the chosen hypothesis at each sample, (n,) N m (N)."""
        return self.fitter.predicted(self.chosen)

    @property
    def other_torque(self) -> np.ndarray:
        """Torque of the fitted terms at each sample, (n,) N m (N)."""
        return self.fitter.other_torque(self.chosen)

    @property
    def residual(self) -> np.ndarray:
        """Measured less predicted torque at each sample, (n,) N m (N)."""
        residual: np.ndarray = self.samples.torque - self.predicted
        return residual

    @cached_property
    def other_torques(self) -> dict[str, float]:
        """Size of each torque that was fitted beside friction: half its range, N m (N).

        The offset has its sign. "angle" is a torque that depends on the angle, as gravity does.
        """
        s, found = self.samples, {}
        for name, c in term_coefficients(self.chosen, s).items():
            torque = s.waves @ c if name == "waves" else s.terms[name] * c
            size = float(np.ptp(torque[s.used > 0])) / 2
            key = "angle" if name == "waves" else name
            found[key] = float(c[0]) if name == "offset" else size
        return found

    def to_dataframe(self) -> pd.DataFrame:
        """Return one row for each sample of the fit.

        Columns: log, time [s], angle [rad (m)], speed [rad/s (m/s)], torque, predicted and residual
        [N m (N)], weight in the fit.
        """
        import pandas as pd

        s = self.samples
        return pd.DataFrame(
            {
                "log": np.array(self.names)[s.log_of_rows],
                "time": s.time,
                "angle": s.angles[self.hypothesis.angle],
                "speed": s.speed,
                "torque": s.torque,
                "predicted": self.predicted,
                "residual": self.residual,
                "weight": s.used,
            }
        )

    def optimum(self) -> Optimum:
        """Return the chosen fit with the Gram matrices of its linearised columns by cycle."""
        fit, h = self.chosen, self.hypothesis
        table, limits = self.fitter.columns(h, fit.p, fit.limits, h.terms)
        return Optimum(fit.p, self.samples.grams(table), limits, np.ones(len(limits)))

    def bootstrap(self, draws: int = 1000, seed: int = 0) -> np.ndarray:
        """sigma0 and Fc of resampled cycles, (draws, 2): the noise part of the uncertainty."""
        at = self.optimum()
        n = len(at.grams)
        times = np.random.default_rng(seed).multinomial(n, np.full(n, 1 / n), size=draws)
        grams = np.tensordot(times.astype(float), at.grams, axes=1)
        return parameters_of(at.p, at.limits, solve(grams, range(at.grams.shape[-1] - 1)))

    @property
    def correlation(self) -> float:
        """Of sigma0 and Fc, over resampled cycles."""
        return float(np.corrcoef(self.bootstrap().T)[0, 1])

    def by_cycle(self) -> dict[str, np.ndarray]:
        """sigma0, Fc and offset of each scored cycle alone, in the linearised model: (cycles,)."""
        at = self.optimum()
        m, k = len(at.limits), at.grams.shape[-1] - 1
        kept = [*range(2 * m), *range(m + len(at.p), k)]  # shapes and lags are those of all cycles
        c = np.zeros((len(at.grams), k))
        c[:, kept] = solve(at.grams, kept)
        value = parameters_of(at.p, at.limits, c)
        first = k - len(self.fitter.term_columns(self.hypothesis.terms))
        offset = c[:, first] if "offset" in self.hypothesis.terms else np.zeros(len(c))
        return {"sigma0": value[:, 0], "Fc": value[:, 1], "offset": offset}

    def predict(self, pieces: Sequence[Log]) -> tuple[Samples, np.ndarray]:
        """Samples of preprocessed logs that were not fitted, and their torque by this result."""
        samples = samples_of(pieces, reference=self.samples.reference)
        samples = replace(samples, torque=self.sign * samples.torque)
        fit = self.chosen
        if self.hypothesis.angle not in samples.angles:
            samples = samples.with_angle(self.hypothesis.angle, samples.angles["between counts"])
        if self.hypothesis.lag.is_late:
            p = fit.p.copy()
            lags = p[self.hypothesis.law.parameters :]  # of each log, or one of all logs
            lags[:] = lags.mean() * self.samples.block / samples.block
            fit = replace(fit, p=p)
        samples = samples.prepared(self.a.value, np.zeros(samples.rows))
        return samples, Fitter(samples).predicted(fit)

    # --- the verdict ---

    @property
    def verdict(self) -> str:
        """One line: the claims, how well they are known, and the dominant uncertainty."""
        words = []
        for name, p in zip(NAMES, (self.sigma0, self.Fc), strict=True):
            within = f"within {100 * p.half_width:.2g} %, mostly due to {SOURCES[p.uncertainty]}"
            if p.claimed:
                words.append(f"{name} = {p.value:.4g} {self.units[name]} {within}")
            else:
                words.append(f"{name} is not identifiable")
        asked = [text for log in self.raw for text in log.questions.values()]
        refused = dict.fromkeys(self.refusals.values())
        why = [f"{reason}; next: {step}" for reason, step in refused if reason not in asked]
        known = {text for lack in self.lacks if not any(lack.withdraws) for text in [lack.text]}
        remarks = [text for text in self.reasons if text in known and text not in "; ".join(why)]
        return "; ".join([*dict.fromkeys(asked), *words, *why, *remarks])


def term_coefficients(fit: Fit, samples: Samples) -> dict[str, np.ndarray]:
    """Coefficients of the columns of each term in N m (N): (1,), of waves (KNOTS - 1,)."""
    h = fit.hypothesis
    k, found = len(fit.limits) + len(fit.p) + h.lag.columns, {}
    for name in h.terms:
        width = samples.waves.shape[1] if name == "waves" else 1
        found[name] = fit.coefficients[k : k + width]
        k += width
    mean = h.law.mean_torque(fit)
    if mean is not None:  # it is friction, not offset
        found["offset"] = found.get("offset", np.zeros(1)) - mean
    return found


def terms_of(fit: Fit, samples: Samples) -> dict[str, float]:
    """Coefficients of the terms of a fit in N m, N m/rad, ... (N, N/m, ...)."""
    reach, found = samples.reference.reach, term_coefficients(fit, samples)
    return {
        name: float(c[0]) / reach ** POWERS_OF_REACH.get(name, 0)
        for name, c in found.items()
        if name != "waves"
    }


# Against claims of sigma0 and of Fc: a reason of refusals.NEXT_STEPS, and the words for it.
Objection = tuple[tuple[bool, bool], str, str]


def claims_of(result: Result) -> Result:
    """Apply the rule: enough cycles, enough explained, a narrow interval, nothing withdrawn."""
    i = _without_hidden_presliding(result)
    objections = [
        *_against_log(result),
        *_against_widths(result, i),
        *_against_lacks(result),
        *_against_sigma0(result, i),
        *_against_short_strokes(result),
        *_against_ends(i),
    ]
    if all(any(against[k] for against, _, _ in objections) for k in range(len(NAMES))):
        objections = [*_against_missing_friction(result), *objections]
    objections = [*_against_units(result), *objections]
    first = [next((one for one in objections if one[0][k]), None) for k in range(len(NAMES))]
    refusals = {
        name: (one[2], next_step(one[1]))
        for name, one in zip(NAMES, first, strict=True)
        if one is not None
    }
    claimed = (first[0] is None, first[1] is None)
    reasons = list(dict.fromkeys(text for _, _, text in objections if text))
    return replace(result, intervals=i, claimed=claimed, reasons=reasons, refusals=refusals)


def _against_missing_friction(result: Result) -> Iterator[Objection]:
    """Objections to a log without friction: torques by angle, speed and acceleration explain it."""
    samples = result.samples
    table = np.column_stack([*samples.terms.values(), samples.waves])
    gram, columns = samples.grams(table).sum(axis=0), range(table.shape[1])
    c = solve(gram, columns)
    left, whole = float(cost_of(gram, columns, c)), float(cost_of(gram, [0], solve(gram, [0])))
    by_count = c[list(samples.terms).index("spring")] * samples.count / samples.reference.reach
    unseen = float(samples.used.sum()) * (by_count**2 / 12 + whole * NOISELESS)
    is_missing = left < unseen or result.plausible.best.total > MIN_LEFT * left
    if is_missing and left < (1 - MIN_R2) * whole:
        text = "a torque by the angle, viscous torque or inertia explains all: no friction is seen"
        yield (True, True), "no friction", text


def _against_lacks(result: Result) -> Iterator[Objection]:
    """Objections of rows of diagnose.py; if others explain as much, they are named too."""
    for lack in sorted(result.lacks, key=lambda lack: -lack.gain):
        rivals = [one for one in result.lacks if one is not lack and 2 * one.gain > lack.gain]
        named, words = max([lack, *rivals], key=lambda one: one.gain), ""
        if not any(lack.withdraws) or named.gain < MUCH_MORE * lack.gain:
            named = lack
        if any(lack.withdraws) and rivals:
            others = [one.name.split(" each")[0] for one in [lack, *rivals] if one is not named]
            words = f" (or {' or '.join(dict.fromkeys(others))} would)"
        yield lack.withdraws, named.name, named.text + words


def _against_short_strokes(result: Result) -> Iterator[Objection]:
    """Objections to an Fc that only the form of an unusual law extrapolates."""
    friction = np.abs(result.predicted - result.other_torque)[result.samples.used > 0]
    part = float(friction.max(initial=0.0)) / result.Fc.value
    laws = [fit.hypothesis.law for fit in result.plausible.fits]
    if part < MIN_REACHED and not all(law.is_one_element for law in laws):
        text = f"friction reaches {100 * part:.0f} % of Fc only"
        yield (False, True), "no end of the interval", text


def _against_ends(i: Intervals) -> Iterator[Objection]:
    """Objections to an interval without an end. It has another reason in most cases."""
    known = np.isfinite(i.low) & np.isfinite(i.high) & (i.low > 0)
    for k, name in enumerate(NAMES):
        if not known[k]:
            text = f"the log shows no {'upper' if i.low[k] > 0 else 'lower'} end of {name}"
            yield (k == 0, k == 1), "no end of the interval", text


def _against_units(result: Result) -> Iterator[Objection]:
    """Objections to numbers in units that nothing confirms; Fc has no unit of the angle."""
    asked = [question for log in result.raw for question in log.questions.items()]
    for what, text in dict.fromkeys(asked):
        yield (True, what == "torque"), f"unit of the {what}", text


def _against_log(result: Result) -> Iterator[Objection]:
    """Objections to a log whatever its intervals are."""
    cycles, r2 = result.samples.cycles, result.r2_of(result.plausible.best)
    if result.are_swapped:
        text = "the angle follows the torque as friction follows a motion"
        yield (True, True), "swapped columns", f"{text}: are angle and torque swapped?"
    if result.fitter.drives(result.chosen):
        text = "the inertia is negative: it stands for another torque"
        yield (True, True), "negative inertia", text
    if r2 < MIN_R2:
        percent = f"{100 * r2:.0f} %"
        text = f"the best hypothesis explains {percent} of what was left out"
        yield (True, True), "little explained", text
    if cycles < MIN_SCORED_CYCLES:
        text = f"only {cycles} cycles, {MIN_SCORED_CYCLES} are needed to score a fit"
        yield (True, True), "few cycles", text


def _against_widths(result: Result, i: Intervals) -> Iterator[Objection]:
    is_wrong = any(any(lack.withdraws) for lack in result.lacks)  # so that no width has its cause
    for k, name in enumerate(NAMES):
        half = half_width_of(i.value[k], i.low[k], i.high[k])
        if half > MAX_HALF_WIDTH and np.isfinite(half):
            source = "lack of fit" if is_wrong else i.dominant(k)
            text = f"{name} is known within {100 * half:.0f} % only, due to {SOURCES[source]}"
            yield (k == 0, k == 1), STEPS_OF_SOURCES[source], text


def _against_sigma0(result: Result, i: Intervals) -> Iterator[Objection]:
    """Objections to the slope at rest, if no log resolves it; an unusual lag hides Fc too."""
    law, plausible = result.hypothesis.law, [fit.hypothesis for fit in result.plausible.fits]
    is_hidden = i is not result.intervals
    twice = [h.lag is not NONE and not h.law.is_one_element for h in plausible]
    is_unusual = all(twice) and not law.turns_as_dahl
    best = result.plausible.best.hypothesis
    is_dahl = law.is_one_element or law.turns_as_dahl
    has_play = best.lag is PLAY and not best.law.is_one_element and not is_dahl
    if law.peaks_after_rest:
        text = "the torque has a peak after each rest: its form changes the slope there"
        yield (True, False), "peak after a rest", text
    if result.samples.has_rests and not law.is_one_element and (is_hidden or is_unusual):
        text = "friction may change in the rests, or the torque may lag and the friction be soft"
        yield (True, is_unusual), "peak after a rest", text
    if is_hidden:
        what, reason = "presliding is", "short presliding"
        if not law.is_one_element:
            what, reason = "the steepest part of the fitted law is", "steepest at rest"
        yield (True, False), reason, f"{what} shorter than a count or a move of one row"
    if (is_unusual and best.lag is PLAY) or has_play:
        text = "a play and a soft friction look alike in loops, and this log needs both"
        yield (True, is_unusual), "law and play", text
    elif is_unusual:
        text = "a torque that lags and a soft friction look alike in loops, and this log needs both"
        yield (True, is_unusual), "law and lag", text
    if any(fit.hypothesis.law.is_steepest_at_rest(fit.p) for fit in result.plausible.fits):
        text = "the loop is steepest at rest, as of small stiff elements: sigma0 is larger"
        yield (True, False), "steepest at rest", text


def _without_hidden_presliding(result: Result) -> Intervals:
    """The intervals; sigma0 has no upper end if presliding is shorter than a count or a move.

    A stiffer bearing would then give the same log, and the fit ends where its start values do.
    """
    i, samples = result.intervals, result.samples
    moves = np.abs(samples.moves(samples.angles["between counts"]))
    usual = float(np.median(moves[moves > 0])) if moves.any() else 0.0
    if i.value[1] / i.value[0] >= max(samples.count, usual):
        return i
    return replace(i, high=np.array([np.inf, i.high[1]]))
