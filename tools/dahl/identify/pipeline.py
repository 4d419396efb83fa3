# SPDX-License-Identifier: MIT
"""One identification from logs to a judged result: clean, fit, compare, judge.

The order matters. The angle is cleaned first, since each false reversal counts as travel; then
terms are chosen, delay and backlash looked for with that fit, odd rows given less weight, and at
the end the intervals and the comparison with simpler models are taken from the same sweep.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial

import numpy as np

from dahl import Error
from dahl.identify import (
    angle_noise,
    clean,
    delay,
    drift,
    even_rows,
    explore,
    fit,
    grid,
    in_step,
    load,
    lowpass,
    model_table,
    path,
    plan_quality,
    play,
    recording,
    ripple,
    sweep,
    torque_steps,
    turning,
    variety,
    verdict,
)
from dahl.identify.explore import Explored
from dahl.identify.finding import Finding
from dahl.identify.fit import Estimate, Interval
from dahl.identify.load import Follows
from dahl.identify.log import Log
from dahl.identify.result import Models, Result
from dahl.identify.sweep import Model, Sweep
from dahl.identify.terms import TERMS, TIMED, UNTIMED, torque_of

BLOCKS = 24  # of all logs together; at least 4 each
LEAST_LOOP, MOST_STEPS = 2.0, 3.0  # a is sought from 2/range (tips at 0.76 Fc) to 3/resolution
LOOKED_AT = 100_000  # rows that the first looks are taken at
BENT = 13  # values of a at which the bilinear element is tried
NEARBY = np.sinh(np.linspace(-2, 2, 13))  # log of a around a known best
HOPELESS = 0.7  # part of the spread not explained: no other choice will help
POOR, SWAPPED = 0.2, 0.3  # part of the spread not explained; of that, the other way round
FINE = 0.003  # presliding lengths of a count below which what a count hides does not show
LOAD_ROUNDS, SETTLED = 4, 1e-3  # of taking the load out of the torque; of Fc and a
TURN = 0.3  # presliding lengths that a reversal must turn by to be counted


@dataclass(frozen=True)
class Options:
    """What the user asked for."""

    terms: tuple[str, ...] | None = None  # None: those that pay
    delay: bool = True
    median: int = 0  # rows; 0: what pays
    trust_units: bool = False
    target_counts: float = 0.0  # a turn (millimetre) of the plan's encoder; 0: the log's
    model: str = ""  # as in model_table.names(); "": the simplest that the log supports


class Study:
    """Logs with the range of a in which to look, and the sweeps over them."""

    def __init__(self, logs: Sequence[Log]) -> None:
        self.logs = [replace(log, zero=float(logs[0].theta[0])) for log in logs]
        usual = max(_usual_move(log) for log in self.logs)
        finest = max(log.resolution for log in self.logs) or usual / 3
        self.low = LEAST_LOOP / max(float(np.ptp(log.theta)) for log in self.logs)
        self.high = max(MOST_STEPS / finest, 100 * self.low)
        self.timed = all(log.time is not None for log in self.logs)
        self.blocks = max(BLOCKS // len(self.logs), 4)

    @property
    def candidates(self) -> list[str]:
        return list(TERMS) if self.timed else list(UNTIMED)

    def at(self, nodes: np.ndarray, model: Model = path.dahl) -> Sweep:
        """Sweep a model."""
        return sweep.sweep(self.logs, self.blocks, nodes, model)

    def search(self, wanted: Sequence[str] | None) -> tuple[Sweep, list[str]]:
        """The sweep around the best a, and the terms."""
        found = fit.search(self.at, self.low, self.high, wanted or ["offset"])
        if wanted is not None:
            return found, list(wanted)
        terms = fit.choose_terms(found, self.candidates)
        for _ in range(fit.ROUNDS):
            found = fit.refine(found, self.at, terms)
        return found, terms

    def again(self, a: float, terms: Sequence[str]) -> Sweep:
        """A sweep after a small change, close to where the best was before."""
        nodes = np.unique(np.clip(a * np.exp(NEARBY), self.low, self.high))
        found = self.at(nodes)
        for _ in range(fit.ROUNDS):
            found = fit.refine(found, self.at, terms)
        return found

    def predicted(self, estimate: Estimate, index: int) -> np.ndarray:
        """What the model says of the torque of one log, with the best torque at its first row:
        (rows,) N m (N).
        """
        log = self.logs[index]
        moves = log.moves_of(slice(0, log.rows))
        drawn = estimate.Fc * path.dahl(moves, estimate.a) + torque_of(log, estimate.terms)
        start = np.exp(-np.minimum(estimate.a * np.cumsum(np.abs(moves)), 700.0))
        weighed = start if log.weight is None else start * log.weight
        first = float(weighed @ (log.torque - drawn) / (weighed @ start))
        torque: np.ndarray = drawn + start * first
        return torque


def _usual_move(log: Log) -> float:
    moves = np.abs(log.moves[:LOOKED_AT])
    moves = moves[moves > 0]
    return float(np.median(moves)) if len(moves) else float(np.ptp(log.theta))


def identify(logs: Sequence[Log], options: Options = Options()) -> Result:
    """The whole of it. Raises dahl.Error for logs that no fit can use."""
    raw = _mended(logs, options)
    result = _studied(raw, raw, options)
    return _under_load(raw, result, options) if _has_load(raw) else result


def _has_load(logs: Sequence[Log]) -> bool:
    return all(log.load is not None for log in logs)


def _under_load(raw: list[Log], result: Result, options: Options) -> Result:
    """The same again with the torque as it would be at one load, until that no longer changes."""
    follows: Follows | None = None
    for _ in range(LOAD_ROUNDS):
        before = result.estimate
        cleaned = [
            replace(log, torque=_cleaned(result, one))
            for log, one in zip(result.logs, raw, strict=True)
        ]
        follows = load.found(cleaned, before, TURN / before.a)
        if follows is None:
            break
        eased = [
            _at_reference(result, one, log, follows)
            for one, log in zip(raw, result.logs, strict=True)
        ]
        result = _studied(eased, raw, replace(options, model=options.model or "dahl"), follows)
        if (
            abs(result.estimate.Fc / before.Fc - 1) + abs(result.estimate.a / before.a - 1)
            < SETTLED
        ):
            break
    if follows is None:
        result.logs[0].notes.append("the logs do not show that friction follows the load: not used")
    return result


def _cleaned(result: Result, log: Log) -> np.ndarray:
    """The torque with the sign and in the time of the fit: (rows,)."""
    return clean.shifted(result.sign * log.torque, result.delay)


def _at_reference(result: Result, raw: Log, cleaned: Log, follows: Follows) -> Log:
    """A log with the torque as it would have been at the reference of the load."""
    beyond = clean.shifted(load.more(cleaned, follows), -result.delay)
    return replace(raw, torque=raw.torque - result.sign * beyond)


def _studied(
    logs: list[Log], raw: list[Log], options: Options, follows: Follows | None = None
) -> Result:
    """Clean, fit, compare, judge logs without a gap; `raw` are they as they were measured, which
    differ where their friction follows a load.
    """
    noted = [replace(log, notes=list(log.notes)) for log in logs]
    turned, sign = _positive(noted, options)
    steadied, window = _steadied(turned, options)
    steadied, doubts = _between_counts(steadied, options)
    study = Study(steadied)
    found, terms = study.search(options.terms)
    counted = fit.point(found, terms)
    slack = _without_backlash(study, counted)
    if slack:
        found, terms = study.search(options.terms)
    first = fit.point(found, terms)
    if _weigh(study, first):
        found = study.again(first.a, terms)
        first = fit.point(found, terms)
    _refuse_swapped(logs, found, first, options)
    seen = _explored(study, found, first, options)
    late = _undelayed(study, seen)
    if late and not doubts:
        study.logs, doubts = _between_counts(study.logs, options)
        if doubts:
            seen, more = _explored_again(study, options)
            late += more
    _name_delay(study, late)
    if late or (seen.taken and set(seen.choice.terms) != set(terms)):
        found, terms = study.search(seen.choice.terms)
    if slack and seen.taken:
        seen = explore.with_backlash(seen, counted)
    hidden = _hidden(study, fit.point(found, terms), terms, doubts)
    estimate = explore.widened(fit.estimate(found, terms, hidden), seen)
    result = _result_of(study, found, load.widened(estimate, follows), late, slack)
    result = replace(result, median=window, sign=sign, inner=bool(doubts), options=asdict(options))
    result.explored, result.raw, result.eased, result.follows = seen, raw, logs, follows
    return _checked(result, options)


def _mended(logs: Sequence[Log], options: Options) -> list[Log]:
    """The pieces of the logs, as far as a fit can use them. Raises dahl.Error where it cannot."""
    for log in logs:
        clean.refuse(log, options.trust_units)
    pieces = [
        replace(piece, notes=list(piece.notes))
        for log in logs
        for piece in recording.mended(log, options.trust_units)
    ]
    timed = next((term for term in options.terms or () if term in TIMED), "")
    untimed = next((piece.name for piece in pieces if piece.time is None), "")
    if timed and untimed:
        raise Error(f"{untimed}: {timed} takes the speed, and there are no usable times (--time)")
    return pieces


def _checked(result: Result, options: Options) -> Result:
    """With all that other checks find, the verdict on it and the worth of a plan."""
    estimate, turn = result.estimate, TURN / result.estimate.a
    refit = partial(_refitted, result)
    result.cycles = drift.cycles_of(result.logs, result.predicted, estimate, turn)
    doubted = [] if options.trust_units else grid.finding(result.raw[0])
    result.findings = [
        *doubted,
        *result.explored.findings,
        *explore.long_delay(result.delay),
        *explore.between_rows(result.delay, estimate.a * max(map(_usual_move, result.logs))),
        *drift.findings(result.cycles),
        *lowpass.finding(result),
        *even_rows.finding(result, _as_they_are),
        *play.finding(result),
        *ripple.finding(result, turn),
        *torque_steps.finding(result.raw, estimate),
        *angle_noise.finding(result, refit),
    ]
    tried = [*in_step.finding(result, refit, turn), *turning.finding(result, refit, turn)]
    ci95 = _drawn_out(estimate.ci95, [*result.findings, *tried])
    result.estimate = _with_a(replace(estimate, ci95=ci95))
    result.logs[0].notes.extend(found.text for found in tried)
    result.verdict = verdict.judge(result)
    unseen = variety.note(result.logs, estimate.a, turn)
    if unseen and result.verdict.sigma0:
        result.logs[0].notes.append(unseen)
    result.plan = plan_quality.of(result, options.target_counts, bool(doubted))
    return result


def _drawn_out(ci95: dict[str, Interval], findings: Sequence[Finding]) -> dict[str, Interval]:
    """Intervals that hold what the findings say that a parameter may be."""
    for found in findings:
        for name, (low, high) in found.reach.items():
            ci95 = {**ci95, name: ci95[name].around(low).around(high)}
    return ci95


def _with_a(estimate: Estimate) -> Estimate:
    """The interval of a = sigma0/Fc holds what those of sigma0 and of Fc allow, each by itself."""
    sigma0, force = estimate.ci95["sigma0"], estimate.ci95["Fc"]
    least = max(sigma0.low, 0.0) / estimate.Fc
    a = estimate.ci95["a"].around(least).around(sigma0.high / estimate.Fc)
    most = estimate.sigma0 / force.low if force.low > 0 else np.inf
    a = a.around(estimate.sigma0 / force.high).around(most)
    return replace(estimate, ci95={**estimate.ci95, "a": a})


def _refitted(result: Result, made: Sequence[Log]) -> Estimate:
    """The parameters of logs that were made to see what the cleaning and the fit do to them."""
    way = replace(result, sign=1.0, delay=0.0)
    study = Study([_as_fitted(way, log) for log in made])
    return fit.point(*study.search(tuple(result.estimate.terms)))


def _as_they_are(logs: Sequence[Log], terms: Sequence[str] | None = None) -> Estimate:
    """The parameters of cleaned logs with these terms, or those that pay."""
    return fit.point(*Study(logs).search(terms))


def _refuse_swapped(logs: list[Log], found: Sweep, estimate: Estimate, options: Options) -> None:
    """Raise dahl.Error where the other way round draws a loop that this way does not."""
    left = estimate.sse / fit.spread_of(found)
    if left < POOR or options.trust_units:
        return
    turned = [replace(log, theta=log.torque, torque=log.theta, resolution=0.0) for log in logs]
    study = Study([log.head(LOOKED_AT) for log in turned])
    other, terms = study.search(("offset",))
    if fit.point(other, terms).sse / fit.spread_of(other) < SWAPPED * left:
        raise Error(
            f"{logs[0].name}: angle and torque look swapped: {100 * (1 - left):.0f} % are explained"
            " this way, much more the other way round (--trust-units says they are not)"
        )


def _positive(logs: list[Log], options: Options) -> tuple[list[Log], float]:
    """Friction opposes the motion: where a first look says otherwise, the torque has the other
    sign; returns the sign too.
    """
    if _first(logs, options).Fc > 0:
        return logs, 1.0
    words = "torque taken with the other sign: friction has the sign of the motion"
    return [replace(log, torque=-log.torque, notes=[*log.notes, words]) for log in logs], -1.0


def _steadied(logs: list[Log], options: Options) -> tuple[list[Log], int]:
    """Take the running median of the angle that leaves least of the cost."""
    windows = (options.median,) if options.median else clean.WINDOWS
    turns = [clean.flickers(log) for log in logs]
    shaky = [bool(options.median) or count > clean.FLICKER for count in turns]
    if not any(shaky):
        return logs, 1
    versions = {window: _through_median(logs, shaky, window) for window in windows}
    best = min(versions, key=lambda window: _first(versions[window], options).sse)
    for log, count, is_shaky in zip(versions[best], turns, shaky, strict=True):
        if is_shaky and best > 1:
            seen = f"angle turns back at once in {count} of {log.rows} rows (flicker or spikes)"
            why = "--median" if options.median else seen
            log.notes.append(f"{why}: running median of {best} rows taken")
    return versions[best], best


def _through_median(logs: list[Log], shaky: list[bool], window: int) -> list[Log]:
    return [
        replace(log, theta=clean.median(log, window)) if is_shaky else log
        for log, is_shaky in zip(logs, shaky, strict=True)
    ]


def _first(logs: list[Log], options: Options) -> Estimate:
    """A first look at the first rows, without intervals, with the terms that no cleaning is to make
    up for.
    """
    study = Study([log.head(LOOKED_AT) for log in logs])
    found, terms = study.search(options.terms or UNTIMED)
    if options.terms is None and not fit.told_apart(found, ("offset",), "spring"):
        found, terms = study.search(("offset",))
    return fit.point(found, terms)


def _between_counts(logs: list[Log], options: Options) -> tuple[list[Log], list[np.ndarray]]:
    """Take the angle between the counts where the torque fits that better; then each log has a
    doubt too, see clean.doubt_between_counts().
    """
    if options.median == 1:  # the angle as it was read
        return logs, []
    read = _first(logs, options)
    if read.a * max(log.resolution for log in logs) < FINE:
        return logs, []
    inner = [replace(log, theta=clean.between_counts(log)) for log in logs]
    if _first(inner, options).sse >= read.sse:
        return logs, []
    for log in inner:
        log.notes.append("angle taken between the counts of the encoder: the torque fits it better")
    pairs = zip(logs, inner, strict=True)
    return inner, [clean.doubt_between_counts(log, one.theta) for log, one in pairs]


def _hidden(
    study: Study, best: Estimate, terms: Sequence[str], doubts: Sequence[np.ndarray]
) -> dict[str, float]:
    """What the counts may still hide of each parameter, as standard errors and parts of it: where
    the motion turns within a count, the path was guessed, and another one gives other parameters.
    """
    if not doubts:
        return {}
    pairs = zip(study.logs, doubts, strict=True)
    logs = [replace(log, theta=log.theta + doubt) for log, doubt in pairs]
    names = ("a", "Fc", "sigma0")
    if not any(np.ptp(log.theta) > 0 for log in logs):
        return dict.fromkeys(names, 1.0)  # the whole motion is within a count
    other = fit.point(Study(logs).again(best.a, terms), terms)
    return {name: abs(getattr(other, name) / getattr(best, name) - 1) for name in names}


def _explored(
    study: Study, found: Sweep, estimate: Estimate, options: Options, least: float = delay.SKEW
) -> Explored:
    """What else may be chosen, where the logs tell anything; `least` delay in rows."""
    if not estimate.Fc > 0 or estimate.sse > HOPELESS * fit.spread_of(found):
        return Explored()
    sets = fit.sets_of(found, study.candidates) if options.terms is None else [options.terms]
    model = model_table.names().get(options.model, "")
    asked = explore.Asked(tuple(sets), options.delay and study.timed, least, model)
    seen = explore.explored(study.logs, estimate, TURN / estimate.a, asked)
    return seen if seen.taken else explore.unscored(found, estimate, sets, seen.cycles)


def _explored_again(study: Study, options: Options) -> tuple[Explored, float]:
    """A torque that came late is in time now, and has told more of the angle between the counts,
    which tells more of the delay: the choices, and how many rows are still to go.
    """
    found, terms = study.search(options.terms)
    seen = _explored(study, found, fit.point(found, terms), options, least=0.0)
    return seen, _undelayed(study, seen)


def _undelayed(study: Study, seen: Explored) -> float:
    """Shift the torque to the angle by the delay that was taken, if any; returns it in rows. Where
    a torque was read at some of the rows it is whole rows, as between them it is not known.
    """
    rows = seen.choice.delay
    if any(log.weight is not None and not log.weight.all() for log in study.logs):
        rows = float(round(rows))
    if rows:
        for log in study.logs:
            log.torque = clean.shifted(log.torque, rows)
            if log.weight is not None:
                log.weight = clean.shifted_weight(log.weight, rows)
    return rows


def _name_delay(study: Study, rows: float) -> None:
    """Say what the torque was shifted by."""
    if rows == 0:
        return
    for log in study.logs:
        assert log.time is not None  # a delay is sought only where every log has its time
        step = float(np.median(np.diff(log.time)))
        who = "torque" if rows > 0 else "angle"
        log.notes.append(f"{who} comes {abs(rows):.1f} rows ({abs(rows) * step:.3g} s) late")


def _without_backlash(study: Study, estimate: Estimate) -> float:
    """Take the travel of flat zones out of the motion; returns the largest zone, rad (m)."""
    largest = 0.0
    resting = {name: v for name, v in estimate.terms.items() if name in UNTIMED}
    for log in study.logs:
        ratio = (log.torque - torque_of(log, resting)) / estimate.Fc
        turns = path.reversals(log.theta, TURN / estimate.a)
        slack, centre, moves = clean.backlash(log, ratio, turns)
        if slack:
            log.free_moves = moves
            log.notes.append(
                f"backlash: the torque rests near {centre * estimate.Fc:.3g} {log.unit} over"
                f" {slack:.3g} {log.angle_unit} after each reversal; this travel is not counted"
            )
            largest = max(largest, slack)
    return largest


def _weigh(study: Study, estimate: Estimate) -> bool:
    """Give odd rows less weight; True where there were any."""
    odd = 0
    for index, log in enumerate(study.logs):
        residual = log.torque - study.predicted(estimate, index)
        log.weight = clean.huber(residual, log.weight)
        few = int(np.count_nonzero((log.weight > 0) & (log.weight < 0.5)))
        if few:
            log.notes.append(
                f"{few} of {log.rows} torque rows disagree with their neighbours: they weigh less"
            )
        odd += int(np.count_nonzero((log.weight > 0) & (log.weight < 1)))
    return odd > 0


def _result_of(
    study: Study, found: Sweep, estimate: Estimate, delay: float, slack: float
) -> Result:
    """What was found, compared with simpler models; nothing else is checked yet."""
    models = _models(study, found, estimate)
    spread = fit.spread_of(found)
    turns = sum(len(path.reversals(log.theta, TURN / estimate.a)) for log in study.logs)
    return Result(
        study.logs,
        estimate,
        models,
        r2=1 - estimate.sse / spread,
        rmse=float(np.sqrt(estimate.sse / estimate.rows)),
        reversals=turns,
        informs=_informs(study, estimate),
        delay=delay,
        median=1,
        backlash=slack,
        predicted=[study.predicted(estimate, index) for index in range(len(study.logs))],
    )


def _models(study: Study, found: Sweep, estimate: Estimate) -> Models:
    """Dahl, Coulomb (the sign alone), none (the terms alone) and bilinear, held out."""
    terms = list(estimate.terms)
    sign = study.at(np.array([study.high * 1e6]), path.coulomb)
    bent = study.at(_bent_nodes(study, estimate), path.bilinear)
    own = fit.choose_terms(sign, study.candidates)
    best = fit.curve_of(bent.a, bent.total(), terms)
    held = {
        "dahl": fit.held_out(found, fit.columns_of(terms)),
        "coulomb": min(
            (fit.held_out(sign, fit.columns_of(t)) for t in (own, terms)), key=lambda h: h.sse
        ),
        "none": fit.held_out(sign, fit.columns_of(terms or ["offset"])[1:]),
        "bilinear": fit.held_out(bent, fit.columns_of(terms)),
    }
    plain = min(fit.curve_of(sign.a, sign.total(), t).sse.min() for t in (own, terms))
    return Models(
        float(1 - plain / fit.spread_of(sign)),
        {name: one.r2 for name, one in held.items()},
        {name: float(np.sqrt(max(one.sse, 0.0) / estimate.rows)) for name, one in held.items()},
        {"dahl": terms, "coulomb": own},
        float(best.a[best.best] * best.coefficient[best.best, 0]),
    )


def _bent_nodes(study: Study, estimate: Estimate) -> np.ndarray:
    """The values of a at which the bilinear element is tried: of long logs those around the best of
    the first rows.
    """
    nodes = estimate.a * np.geomspace(1 / 8, 4, BENT)
    if all(log.rows <= LOOKED_AT for log in study.logs):
        return nodes
    first = Study([log.head(LOOKED_AT) for log in study.logs]).at(nodes, path.bilinear)
    best = fit.curve_of(first.a, first.total(), list(estimate.terms)).best
    return nodes[max(best - 2, 0) : best + 3]


def _informs(study: Study, estimate: Estimate) -> float:
    """Part of the rows that move where the curve is not yet flat: at least a tenth of sigma0."""
    steep = moving = 0
    for log in study.logs:
        moves = log.moves_of(slice(0, log.rows))
        there = moves != 0
        ratio = path.dahl(moves, estimate.a)
        steep += int(np.count_nonzero((1 - np.sign(moves) * ratio)[there] > 0.1))
        moving += int(np.count_nonzero(there))
    return steep / max(moving, 1)


def check(result: Result, log: Log) -> float:
    """R2 of the found parameters on a log that was not fitted, cleaned in the same way; the torque
    at its first row is fitted, as nobody measured it.
    """
    clean.refuse(log, trust_units=True)
    pieces = [_as_fitted(result, piece) for piece in recording.mended(log, trust_units=True)]
    study = Study(pieces)
    for piece in study.logs:
        piece.zero = result.logs[0].zero
    if result.backlash:
        _without_backlash(study, result.estimate)
    torque = np.concatenate([piece.torque for piece in pieces])
    for piece in study.logs:
        piece.torque = piece.torque - load.more(piece, result.follows)
    left = np.concatenate(
        [piece.torque - study.predicted(result.estimate, i) for i, piece in enumerate(study.logs)]
    )
    return 1 - float(np.sum(left**2) / np.sum((torque - torque.mean()) ** 2))


def _as_fitted(result: Result, log: Log) -> Log:
    """A log cleaned as those were that the parameters come from."""
    log = replace(log, theta=clean.median(log, result.median), torque=_cleaned(result, log))
    return replace(log, theta=clean.between_counts(log)) if result.inner else log
