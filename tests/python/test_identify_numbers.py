# SPDX-License-Identifier: MIT
"""The numbers of an identification against fits of their own on the rows: numpy's least squares,
scipy's minimisers, the closed form of Eq. 1 and the truth of made logs. Nothing of the package is
in the references.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import identify_cases as made
import numpy as np
import pytest
from dahl.identify import pipeline
from dahl.identify.log import Log
from dahl.identify.pipeline import Options, identify
from identify_cases import A
from identify_tools import (
    FC,
    SIGMA0,
    dahl_torque,
    noise_of,
    seen,
    sine,
    springs,
    told,
    width,
)
from scipy.ndimage import median_filter
from scipy.optimize import brentq, minimize_scalar
from scipy.stats import t as student

pytestmark = pytest.mark.usefixtures("library")

NAMES = ("sigma0", "Fc")


def rig(seed: int, rows: int = 1500, cycles: float = 8, noise: float = 0.05, start: float = 0.0):
    """A log without an encoder, of even noise, so that no row is odd; an offset, and a spring
    relaxed at `start`.
    """
    theta = sine(seed, rows=rows, cycles=cycles)
    even = np.random.default_rng(seed).uniform(-np.sqrt(3), np.sqrt(3), rows)
    torque = dahl_torque(theta) + 0.1 + 2.0 * (theta - start) + noise * FC * even
    return Log(f"seed {seed}", theta, torque, np.arange(rows) * 1e-3)


def column_of(log: Log, term: str, start: float) -> np.ndarray:
    speed = np.gradient(log.theta, log.time)
    columns = {"offset": np.ones(log.rows), "spring": log.theta - start, "viscous": speed}
    return columns[term]


def fades_of(log: Log, a: float) -> np.ndarray:
    """What is left, row by row, of the torque at the first row."""
    return np.exp(-a * np.cumsum(np.abs(np.diff(log.theta, prepend=log.theta[0]))))


def rows_of(logs: Sequence[Log], a: float, terms: Sequence[str]) -> tuple[np.ndarray, np.ndarray]:
    """F/Fc, the terms, the first torque of each log; the torque."""
    start, parts = logs[0].theta[0], []
    for k, log in enumerate(logs):
        first = np.zeros((log.rows, len(logs)))
        first[:, k] = fades_of(log, a)
        beside = [column_of(log, term, start) for term in terms]
        parts.append(np.column_stack((dahl_torque(log.theta, a, 1.0), *beside, first)))
    return np.concatenate(parts), np.concatenate([log.torque for log in logs])


def solved(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, float]:
    """Coefficients and the sum of squares that they leave."""
    best = np.linalg.lstsq(x, y, rcond=None)[0]
    return best, float(np.sum((y - x @ best) ** 2))


def best_a(cost: Callable[[float], float], around: float = A, wide: float = 0.3) -> float:
    ends = (np.log(around) - wide, np.log(around) + wide)
    found = minimize_scalar(
        lambda x: cost(np.exp(x)), bounds=ends, method="bounded", options={"xatol": 1e-7}
    )
    return float(np.exp(found.x))


# --- the fit and its intervals --------------------------------------------------------------------


@cache
def of_two() -> tuple[list[Log], dict[str, Any]]:
    logs = [rig(1), rig(2, rows=1100, cycles=5)]
    logs = [replace(one, torque=one.torque - 2.0 * logs[0].theta[0]) for one in logs]
    return logs, seen(*logs, terms=("offset", "spring"), delay=False, model="dahl")


def test_a_fit_is_least_squares_on_all_rows():
    """Of two logs, each with a torque of its own at its first row, and one spring for both."""
    logs, facts = of_two()
    a = best_a(lambda a: solved(*rows_of(logs, a, ("offset", "spring")))[1])
    best, left = solved(*rows_of(logs, a, ("offset", "spring")))
    assert (facts["a"], facts["Fc"]) == pytest.approx((a, best[0]), rel=3e-4)
    assert facts["sigma0"] == pytest.approx(a * best[0], rel=5e-4)
    assert list(facts["extra"].values()) == pytest.approx(best[1:3], rel=2e-3, abs=1e-4)
    torque = np.concatenate([log.torque for log in logs])
    spread = np.sum((torque - torque.mean()) ** 2)
    assert facts["rows"] == facts["sum_of_weights"] == len(torque)
    assert facts["r2"] == pytest.approx(1 - left / spread, abs=1e-5)
    assert facts["rmse"] == pytest.approx(np.sqrt(left / len(torque)), rel=1e-3)
    turns = 0
    for theta in (log.theta for log in logs):  # of which a stroke of .3 presliding lengths follows
        speed = np.diff(theta)
        ends = [*(np.flatnonzero(speed[1:] * speed[:-1] < 0) + 1), -1]
        turns += np.count_nonzero(np.abs(np.diff(theta[ends])) > 0.3 / facts["a"])
    assert facts["reversals"] == turns and facts["logs"] == ["seed 1", "seed 2"]


def test_how_much_of_the_motion_informs_sigma0():
    """Part of the moving rows in which the torque still rises by a tenth of sigma0 at least."""
    logs, facts = of_two()
    steep = moving = 0
    for log in logs:
        moves = np.diff(log.theta, prepend=log.theta[0])
        left = 1 - np.sign(moves) * dahl_torque(log.theta, facts["a"], 1.0)
        steep += np.count_nonzero(left[moves != 0] > 0.1)
        moving += np.count_nonzero(moves)
    assert facts["informs_sigma0"] == pytest.approx(steep / moving, abs=2e-3)


def profiled(log: Log, name: str, value: float) -> float:
    """The least cost with a parameter held."""

    def cost(a: float) -> float:
        x, y = rows_of([log], a, ["offset", "spring"])
        if name == "a":
            return solved(x, y)[1]
        Fc = value if name == "Fc" else value / a  # noqa: N806
        return solved(x[:, 1:], y - Fc * x[:, 0])[1]

    return cost(value) if name == "a" else cost(best_a(cost))


def jackknifed(log: Log, blocks: int = 24) -> dict[str, float]:
    """The variance of each parameter, from fits on the rows without one block each."""
    left, length = [], -(-log.rows // blocks)
    for k in range(-(-log.rows // length)):
        kept = np.ones(log.rows, dtype=bool)
        kept[length * k : length * (k + 1)] = False

        def fitted(a: float, kept: np.ndarray = kept) -> tuple[np.ndarray, float]:
            x, y = rows_of([log], a, ["offset", "spring"])
            return solved(x[kept], y[kept])

        a = best_a(lambda a, fitted=fitted: fitted(a)[1], wide=0.1)
        Fc = fitted(a)[0][0]  # noqa: N806
        left.append((a, Fc, a * Fc))
    return dict(zip(("a", "Fc", "sigma0"), (len(left) - 1) * np.var(left, axis=0), strict=True))


def test_intervals_are_profiles_as_wide_as_the_jackknife_says():
    """95 %: Student's t for 24 blocks; neighbouring rows that share errors widen them."""
    log = rig(4, rows=600, cycles=7)
    facts = seen(log, terms=("offset", "spring"), delay=False, model="dahl")
    freedom, true = 600 - 2 - 3, jackknifed(log)
    least = profiled(log, "a", best_a(lambda a: profiled(log, "a", a)))
    for name, variance in true.items():
        value = facts[name]

        def ends(ratio: float, name: str = name, value: float = value) -> tuple[float, ...]:
            above = lambda x: profiled(log, name, x) - ratio * least  # noqa: E731
            return tuple(
                brentq(above, value, value * (1 + 0.3 * side), xtol=1e-5 * value)
                for side in (-1, 1)
            )

        low, high = ends(1 + 1 / freedom)
        inflation = max(variance / ((high - low) / 2) ** 2, 1.0)
        wanted = ends(1 + student.ppf(0.975, 23) ** 2 / freedom * inflation)
        assert facts["ci95"][name] == pytest.approx(wanted, rel=6e-4), name


def test_intervals_are_as_wide_as_the_errors_are():
    """White noise: over 20 logs, errors in units of the half width scatter as 1 over t(0.975)."""
    parts = []
    for seed in range(20):
        theta = sine(seed, rows=900, cycles=6)
        log = Log("", theta, dahl_torque(theta) + 0.05 * FC * noise_of(seed, 900))
        facts = seen(log, terms=(), delay=False)
        parts += [(facts["sigma0"] / SIGMA0 - 1) / width(facts, "sigma0")]
        parts += [(facts["Fc"] / FC - 1) / width(facts, "Fc")]
    assert 0.3 < np.std(parts) < 0.62


def test_held_out_means_held_out():
    """Noise that no model can know is not explained on rows that were left out."""
    log = replace(rig(1, rows=300, cycles=3), torque=np.random.default_rng(1).normal(size=300))
    facts = seen(log, terms=("offset", "spring", "viscous", "inertia"))
    assert facts["held_out"]["dahl"]["r2"] < 0 < facts["r2"]


def test_odd_rows_weigh_less():
    """Huber's weights: by how far a row is off the median of nine, in robust standard errors."""
    theta = sine(7, rows=3000, cycles=7)
    log = made.of(theta, dahl_torque(theta), 0.05, 0.0)
    log.torque[50::97] += 1.5
    facts = seen(log, terms=())
    residual = log.torque - dahl_torque(log.theta, facts["sigma0"], facts["Fc"])
    off = np.abs(residual - median_filter(residual, 9, mode="nearest"))
    limit = 4 * 1.4826 * np.median(off[off > 0])
    weight = np.minimum(1, limit / np.maximum(off, 1e-12))
    assert facts["sum_of_weights"] == pytest.approx(weight.sum(), abs=0.5)
    assert facts["rows_weighing_less"] == pytest.approx(np.count_nonzero(weight < 1), abs=2)
    assert told(facts, "weigh") == [np.count_nonzero(weight < 0.5), 3000]
    left = np.sum(weight * residual**2)
    assert facts["rmse"] == pytest.approx(np.sqrt(left / weight.sum()), rel=0.01)


def test_a_spike_weighs_little_in_both_rows_that_a_part_of_a_row_spreads_it_over():
    """A delay of 4.5 rows draws each row of the torque from two, and either may be the spike."""
    log = made.late_between_rows(4.5)
    spikes = np.arange(150, log.rows - 100, 217)
    log.torque[spikes] += 0.5 * FC
    result = pipeline.identify([log])
    fitted = result.logs[0]
    assert 4.2 < result.delay < 4.8
    light = np.concatenate([spikes - 5, spikes - 4])
    assert np.flatnonzero(fitted.weight < 0.5).tolist() == sorted(light)


# --- what is left out -----------------------------------------------------------------------------


def blocks_left_out(log: Log, columns: Callable[[float], np.ndarray]) -> float:
    """R2 over fifths of 24 blocks, each predicted by a fit to the others."""
    fold, lost = np.arange(log.rows) // -(-log.rows // 24) * 5 // 24, 0.0

    def fitted(a: float, rows: np.ndarray) -> tuple[np.ndarray, float]:
        x = np.column_stack((columns(a), fades_of(log, a)))[rows]
        return solved(x, log.torque[rows])

    for part in range(5):
        kept = fold != part
        a = best_a(lambda a, kept=kept: fitted(a, kept)[1])
        left = log.torque - columns(a) @ fitted(a, kept)[0][:-1]
        lost += solved(fades_of(log, a)[~kept, None], left[~kept])[1]
    return 1 - lost / np.sum((log.torque - log.torque.mean()) ** 2)


@cache
def of_one() -> tuple[Log, dict[str, Any]]:
    log = rig(5, noise=0.03)
    log = replace(log, torque=log.torque - 2.0 * log.theta[0])
    return log, seen(log, model="dahl")


def test_r2_of_what_was_held_out():
    """Of Dahl's model, and of the terms alone, which explain the spring."""
    log, facts = of_one()
    beside = np.column_stack([column_of(log, term, log.theta[0]) for term in facts["extra"]])
    assert list(facts["extra"]) == ["offset", "spring"]
    w = lambda a: np.column_stack((dahl_torque(log.theta, a, 1.0), beside))  # noqa: E731
    held = facts["held_out"]
    assert held["dahl"]["r2"] == pytest.approx(blocks_left_out(log, w), abs=3e-5)
    assert held["none"]["r2"] < held["coulomb"]["r2"] < held["bilinear"]["r2"] < held["dahl"]["r2"]
    spread = np.sum((log.torque - log.torque.mean()) ** 2)
    for one in held.values():
        assert one["rmse"] == pytest.approx(np.sqrt((1 - one["r2"]) * spread / log.rows), rel=1e-3)


def test_simpler_models_on_the_rows():
    """Coulomb's sign with terms of its own, and the stiffness of one spring that slips."""
    log, facts = of_one()
    sign = np.sign(np.diff(log.theta, prepend=log.theta[0]))
    speed = np.gradient(log.theta, log.time)
    known = {"spring": log.theta, "viscous": speed, "inertia": np.gradient(speed, log.time)}
    own = [known[name] for name in facts["coulomb_extra"] if name != "offset"]
    one = np.ones(log.rows)
    left = solved(np.column_stack((sign, one, np.arange(log.rows) == 0, *own)), log.torque)[1]
    spread = np.sum((log.torque - log.torque.mean()) ** 2)
    assert own and facts["r2_coulomb"] == pytest.approx(1 - left / spread, abs=5e-3)
    costs = {}
    for a in facts["a"] * np.geomspace(1 / 8, 4, 13):
        x = (springs(log.theta, (a, 1.0)), one, log.theta, fades_of(log, a))
        best, cost = solved(np.column_stack(x), log.torque)
        costs[cost] = a * best[0]
    assert facts["bilinear_sigma0"] == pytest.approx(costs[min(costs)], rel=0.03)


def cycles_of(log: Log, a: float) -> list[np.ndarray]:
    """The rows of each whole cycle that counts: behind six presliding lengths of travel, and no
    nearer to the ends than the longest delay or a twentieth of the log.
    """
    speed = np.diff(log.theta)
    turns = (np.flatnonzero(speed[1:] * speed[:-1] < 0) + 1)[::2]
    cycle = np.clip(
        np.searchsorted(turns, np.arange(log.rows), side="right") - 1, 0, len(turns) - 2
    )
    counted = fades_of(log, 1.0) < np.exp(-6 / a)
    reach = min(90, log.rows // 20)
    counted[:reach] = counted[log.rows - reach :] = False
    return [np.flatnonzero(counted & (cycle == k)) for k in range(len(turns) - 1)]


def r2_by_cycles(log: Log, columns: Callable[[float], list[np.ndarray]], a: float) -> float:
    """R2 over whole cycles, each predicted by a fit to the others, in which F/Fc, the first of the
    columns, may change with log a as well.
    """
    parts = cycles_of(log, a)
    rows, torque = np.concatenate(parts), log.torque
    a = best_a(lambda a: solved(np.column_stack(columns(a))[rows], torque[rows])[1], a, 0.8)
    change = (columns(a * np.exp(0.02))[0] - columns(a * np.exp(-0.02))[0]) / 0.04
    x, lost = np.column_stack((*columns(a), change)), 0.0
    for part in parts:
        others = np.setdiff1d(rows, part)
        best = solved(x[others], torque[others])[0]
        lost += float(np.sum((torque[part] - x[part] @ best) ** 2))
    return 1 - lost / float(np.sum((torque[rows] - torque[rows].mean()) ** 2))


def late_by(column: np.ndarray, rows: float) -> np.ndarray:
    place = np.arange(len(column), dtype=float)
    return np.interp(place - rows, place, column)


def test_choices_are_scored_by_cycles_left_out():
    """Each set of terms and each delay that was tried, listed with its R2, the best first."""
    log, facts = of_one()
    listed = facts["choices"]
    scores = [one["r2"] for one in listed]
    assert scores == sorted(scores, reverse=True) and len(listed) > 8
    checked = 0
    for one in listed:
        terms, delay = one["terms"], one["delay_rows"]
        if one["model"] != "Dahl" or "viscous" in terms or "inertia" in terms or abs(delay) > 20:
            continue

        def columns(a: float, terms=terms, delay=delay) -> list[np.ndarray]:
            beside = [column_of(log, term, log.theta[0]) for term in terms]
            return [late_by(x, delay) for x in (dahl_torque(log.theta, a, 1.0), *beside)]

        r2 = r2_by_cycles(log, columns, one["sigma0"] / one["Fc"])
        assert one["r2"] == pytest.approx(r2, abs=2e-4, rel=1e-3), (terms, delay)
        checked += 1
    assert checked >= 5 and sum(one["taken"] for one in listed) == 1


def test_models_are_scored_by_cycles_left_out():
    log, facts = of_one()
    by_name = {one["name"]: one for one in facts["models"]}
    beside = [column_of(log, term, log.theta[0]) for term in ("offset", "spring")]
    made_by = {
        "Dahl": lambda a: [dahl_torque(log.theta, a, 1.0), *beside],
        "Coulomb": lambda _: [np.sign(np.diff(log.theta, prepend=log.theta[0])), *beside],
    }
    for name, columns in made_by.items():
        (part,) = by_name[name]["elements"]
        assert by_name[name]["r2"] == pytest.approx(r2_by_cycles(log, columns, A), abs=2e-4), name
        assert part["Fc"] == pytest.approx(FC, rel=0.01 if name == "Dahl" else 0.3)
    (slip,) = by_name["slip K=1"]["elements"]
    drawn = [springs(log.theta, (slip["sigma0"] / slip["Fc"], 1.0)), *beside]
    rows = np.concatenate(cycles_of(log, A))
    best = solved(np.column_stack(drawn)[rows], log.torque[rows])[0]
    assert slip["Fc"] == pytest.approx(best[0], rel=0.005)


# --- backlash -------------------------------------------------------------------------------------


def band_rows(way: np.ndarray, centre: float) -> int:
    """Rows from the last one below a band of .1 of Fc to either side, to the first one above it."""
    above = int(np.argmax(way > centre + 0.1))
    return above - int(np.flatnonzero(way[:above] < centre - 0.1)[-1])


@pytest.mark.parametrize("slack", [0.005, 0.01])
def test_travel_that_is_taken_out_as_backlash(slack):
    """Strokes at one speed, so that travel is rows. The flat band keeps the travel that the bands
    beside it have; a row more or less in each of them is seen.
    """
    rows = 200  # a cycle
    phase = (np.arange(8 * rows) / rows + 0.1) % 1
    theta = 0.05 * np.interp(phase, [0, 0.5, 1], [-1, 1, -1])
    ratio = made.resting_ratio(theta, slack)
    log = made.of(theta, FC * ratio, 0.002, 0.0)
    result = identify([log], Options(terms=("offset",), delay=False, model="dahl"))
    turns = np.flatnonzero(np.diff(np.sign(np.diff(theta)))) + 1
    strokes = [ratio[i : j + 1] * (-1) ** k for k, (i, j) in enumerate(pairwise(turns), 1)]
    low, flat, high = np.median(
        [[band_rows(way, centre) for centre in (-0.25, 0, 0.25)] for way in strokes], axis=0
    )
    part, step = 1 - (low + high) / (2 * flat), 0.2 / rows  # taken out; rad a row
    kept = np.abs(result.logs[0].moves_of(slice(turns[0], turns[-1]))).sum()
    out = np.abs(np.diff(theta[turns[0] - 1 : turns[-1]])).sum() - kept
    assert out / len(strokes) == pytest.approx(part * (flat - 1) * step, abs=0.35 * step)


# --- cycle by cycle -------------------------------------------------------------------------------


def test_each_cycle_has_its_own_numbers():
    """Fc that halves at row 2000, and sigma0 that grows, at the turning points that are whole."""
    half = np.where(np.arange(4000) < 2000, 1.0, 0.5)
    facts = seen(made.drifting(Fc=half - 1))
    first, found = np.array(facts["cycles"]["first_row"]), np.array(facts["cycles"]["Fc"])
    speed = np.diff(sine(1, rows=4000, cycles=12))
    turns = (np.flatnonzero(speed[1:] * speed[:-1] < 0) + 1)[::2]
    assert first == pytest.approx(turns[:-1], abs=8) and len(first) == 11
    whole = [half[i:j].mean() for i, j in pairwise(turns)]
    inside = [one in (1.0, 0.5) for one in whole]
    assert found[inside] == pytest.approx(FC * np.array(whole)[inside], rel=0.02)
    growing = seen(made.drifting(sigma0=0.3 * made.ramp()))
    sigma0 = np.array(growing["cycles"]["sigma0"])
    assert sigma0 == pytest.approx(SIGMA0 * (1 + 0.3 * made.ramp()[turns[:-1] + 166]), rel=0.04)
    assert abs(np.array(growing["cycles"]["offset"])).max() < 0.01 * FC


# --- terms and delays -----------------------------------------------------------------------------


def test_terms_and_delays_have_standard_errors():
    """The truth lies within four of them, and they are of the size that seeds scatter by."""
    springy = made.beside("spring", 4.0)
    found = [
        replace(springy, torque=springy.torque + 0.05 * FC * noise_of(k, 5000)) for k in range(6)
    ]
    facts = [seen(one, terms=("offset", "spring"), delay=False) for one in found]
    sizes = [one["extra"]["spring"] for one in facts]
    errors = [one["extra_standard_errors"]["spring"] for one in facts]
    assert 0.4 * np.std(sizes, ddof=1) < np.median(errors) < 2.5 * np.std(sizes, ddof=1)
    assert abs(np.mean(sizes) - 4.0) < 4 * np.median(errors)
    late = [seen(made.late(10, seed, noise=0.05)) for seed in range(4)]
    delays = [one["delay_rows"] for one in late]
    errors = [one["delay_rows_standard_error"] for one in late]
    assert delays == pytest.approx([10.0] * 4, abs=0.5) and 0.01 < np.median(errors) < 0.5
    assert seen(made.shaft())["delay_rows_standard_error"] == 0.0


def test_terms_that_are_asked_for_are_the_only_choice():
    facts = seen(made.shaft(1), terms=("viscous",))
    assert list(facts["extra"]) == ["viscous"]
    assert {tuple(one["terms"]) for one in facts["choices"]} == {("viscous",)}
    late = seen(made.late(9), terms=(), delay=False)
    assert late["delay_rows"] == 0 and {one["delay_rows"] for one in late["choices"]} == {0}


# --- a log that was not fitted --------------------------------------------------------------------


def written(path: Path, log: Log, way: str = "theta_rad,torque_Nm") -> Path:
    table = np.column_stack((log.time, log.theta, log.torque))
    np.savetxt(path, table, "%.12g", ",", header=f"time_s,{way}", comments="")
    return path


@pytest.mark.parametrize("kind", ["late", "against", "shaky", "linear", "backlash"])
def test_r2_of_a_log_that_was_not_fitted(dahl, tmp_path, kind):
    """It is cleaned as those that were: its delay, its sign, its filter of the angle, its backlash,
    its spring relaxed at the same angle, wherever it begins, and behind a gap too.
    """
    way = "pos_m,force_N" if kind == "linear" else "theta_rad,torque_Nm"

    def log(seed: int) -> Log:
        if kind == "late":
            return made.late(9, seed)
        if kind == "shaky":
            return made.shaky(0.3, seed=seed)
        if kind == "backlash":
            return made.played(0.01, seed=seed)
        one = made.shaft(seed, 0.05)
        more = 0.1 + 3.0 * one.theta if kind == "linear" else 0.0
        return replace(one, torque=(-1 if kind == "against" else 1) * (one.torque + more))

    other = log(6)
    if kind == "linear":
        kept, time = slice(700, None), other.time + 0.5 * (other.time > 1.5)
        other = Log("", other.theta[kept], other.torque[kept], time[kept])
    fitted = written(tmp_path / "a.csv", log(5), way)
    words = ("--check", written(tmp_path / "b.csv", other, way), "--json", "-", "--no-files")
    facts = json.loads(dahl("identify", fitted, "--model", "dahl", *words).stdout)
    (r2,) = facts["checks"].values()
    assert facts["linear"] is (kind == "linear")
    assert r2 == pytest.approx(facts["r2"], abs=4e-3)
