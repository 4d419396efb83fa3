# SPDX-License-Identifier: MIT
"""Each friction law against an ODE solver or a recurrence of this file. In each law sigma0 is the
slope at rest and Fc the friction at full slip.
"""

import json
import pickle
from collections.abc import Callable
from functools import cache

import hostile_logs
import numpy as np
import pytest
from dahl import Error
from dahl.identify import Options, Result, identify, models, report
from dahl.identify.laws import LAWS, OPTIONS, Limits
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from identify_tools import FC, SIGMA0, behind_play, chirp, dahl_torque, log_of, shaft, springs
from scipy.integrate import solve_ivp
from scipy.signal import filtfilt, lfilter

A = SIGMA0 / FC
Slope = Callable[[float, float], float]  # dw/du of w = F/Fc and the direction
SLOPES: dict[str, Slope] = {
    "dahl": lambda w, s: 1 - s * w,
    "slip": lambda w, s: float(s * w < 1),
    "exponent": lambda w, s: max(1 - s * w, 0.0) ** 0.7,
    "bouc-wen": lambda w, s: 1 - np.sign(s * w) * abs(w) ** 1.5,
    # a spring of 30 % of the compliance in series
    "soft shaft": lambda w, s: (1 - s * w) / (0.7 + 0.3 * (1 - s * w)),
}


def by_model(name: str, moves: np.ndarray, pieces: models.Pieces | None = None) -> np.ndarray:
    pieces = pieces or [slice(0, len(moves))]
    shape = {"exponent": 0.7, "bouc-wen": 1.5, "soft shaft": 0.3}.get(name, 0.0)
    return LAWS[name].along(moves, pieces, [A], [shape])[0]


def by_solver(slope: Slope, moves: np.ndarray) -> np.ndarray:
    w, drawn = 0.0, []
    for move in moves.tolist():
        side = float(np.sign(move))
        if move and side * w < 1 - 1e-9:
            rate = lambda _, y, side=side: [side * slope(y[0], side)]  # noqa: E731
            solved = solve_ivp(rate, (0, A * abs(move)), [w], rtol=1e-7, atol=1e-9, max_step=0.05)
            w = float(np.clip(solved.y[0, -1], -1, 1))
        drawn.append(w)
    return np.array(drawn)


@pytest.mark.parametrize("name", SLOPES)
def test_a_law_solves_its_equation(name):
    """To and fro with strokes of many lengths and rests, in two pieces; far away it slips."""
    theta = np.repeat(chirp(160, 0.012, first=2, last=5), np.arange(160) % 9 // 8 + 1)
    moves = np.diff(theta, prepend=theta[0])
    pieces = [slice(0, 100), slice(100, len(moves))]
    truth = np.concatenate([by_solver(SLOPES[name], moves[rows]) for rows in pieces])
    off = 0.03 if name == "slip" else 2e-4  # its corner lies between two steps of the solver
    assert np.abs(by_model(name, moves, pieces) - truth).max() < off
    for side in (1, -1):
        assert by_model(name, np.array([side * 1e-4 / A])) == pytest.approx(side * 1e-4, rel=2e-3)
        far = by_model(name, np.full(200, side / A))
        assert far[-1] == pytest.approx(side, abs=1e-3) and np.abs(far).max() <= 1 + 1e-9


PATHS = arrays(float, st.integers(2, 60), elements=st.floats(-0.02, 0.02))


@settings(max_examples=25)
@given(PATHS, st.integers(0, 99))
def test_laws_whose_limit_changes_against_row_by_row(theta, seed):
    limits = 1 + 0.4 * np.random.default_rng(seed).uniform(-1, 1, len(theta))
    moves, cut = np.diff(theta, prepend=theta[:1]), len(theta) // 2
    pieces = [slice(0, cut), slice(cut, len(theta))]
    moves[cut] = 0.0
    steady = models.dahl_with_limits(moves, pieces, A, limits)
    loaded = models.dahl_under_load(moves, pieces, A, limits)
    for rows in pieces:
        one, limit = theta[rows], limits[rows]
        assert steady[rows] == pytest.approx(dahl_torque(one, A, limit), abs=1e-6)
        truth = dahl_torque(one, A * limit, limit, is_reduced=True)
        assert loaded[rows] == pytest.approx(truth, abs=1e-6)
    settled = np.concatenate((np.linspace(0, 0.2, 50), 0.2 + theta))  # forgets the start
    moves = np.diff(settled, prepend=0.0)
    each_way = dahl_torque(settled, A, np.where(moves > 0, 1.3, 0.7))
    found = models.asymmetric(moves, [slice(0, len(moves))], A, 0.3)
    assert found[50:] == pytest.approx(each_way[50:] - 0.3, abs=1e-5)  # less the mean


@settings(max_examples=25)
@given(PATHS, st.floats(1e-4, 0.02))
def test_play_against_row_by_row(theta, width):
    pieces = [slice(0, len(theta) // 2), slice(len(theta) // 2, len(theta))]
    behind = np.concatenate([behind_play(theta[rows], width) for rows in pieces])
    assert models.behind_play(theta, pieces, width) == pytest.approx(behind, abs=1e-9)


# --- one law, one log -----------------------------------------------------------------------------

MOTION = chirp(2400, first=5, last=11)
MOVES, SPEED = np.diff(MOTION, prepend=MOTION[0]), np.gradient(MOTION, 1e-3)
DAHL, SLIP = dahl_torque(MOTION), springs(MOTION, (SIGMA0, FC))
RATE = np.gradient(DAHL) / np.abs(np.gradient(DAHL)).max()
SLOW = np.exp(-((SPEED / (0.15 * np.abs(SPEED).max())) ** 2))
LOGARITHM = np.log(np.maximum(np.abs(SPEED), 0.1))
MEAN = np.ones(15) / 15
BENT = ("exponent", "bouc-wen", "soft shaft", "mixed")  # laws that bend alike
MADE: dict[str, tuple[np.ndarray, tuple[str, ...]]] = {  # a torque, and laws that describe it
    "dahl": (DAHL, ("dahl",)),
    "slip": (SLIP, ("slip",)),
    "late slip": (np.roll(SLIP, 4), ("slip",)),
    "2 slip": (springs(MOTION, (80, 0.2), (20, 0.3)), ("2 slip",)),
    "mixed": (
        dahl_torque(MOTION, 60, 0.2) + springs(MOTION, (40, 0.3)),
        ("mixed", "2 dahl", "2 slip", "3 slip", "4 slip"),
    ),
    "exponent": (FC * by_model("exponent", MOVES), BENT),
    "bouc-wen": (FC * by_model("bouc-wen", MOVES), BENT),
    # 30 % more friction at rest
    "stribeck": (dahl_torque(MOTION, Fc=FC * (1 + 0.3 * SLOW)), ("stribeck",)),
    # 4 % more for each factor e of speed, as of dry contacts
    "log speed": (
        dahl_torque(MOTION, Fc=FC * (1 + 0.04 * (LOGARITHM - LOGARITHM.mean()))),
        ("log speed",),
    ),
    "asymmetric": (dahl_torque(MOTION, Fc=FC * np.where(MOVES > 0, 1.25, 0.75)), ("asymmetric",)),
    # sigma1 of LuGre's law: a part of the torque follows its rate
    "damping": (DAHL + 0.2 * FC * RATE, ("dahl",)),
    "delay+filter": (np.roll(lfilter(MEAN, [1], DAHL), 10), ("dahl",)),
    "zero-phase filter": (filtfilt([0.3], [1, -0.7], DAHL), ("dahl",)),
}


@cache
def found(name: str) -> Result:
    return identify([log_of(MOTION, MADE[name][0], 0.01)])


@pytest.mark.parametrize("name", MADE)
def test_a_law_is_recognised_and_its_numbers_mean_the_same(name):
    """The chosen law is the true one or one that bends alike, and no claim is wrong."""
    result = found(name)
    assert result.hypothesis.law.name in MADE[name][1], str(result.hypothesis)
    for parameter, truth in ((result.sigma0, SIGMA0), (result.Fc, FC)):
        assert not parameter.claimed or parameter.low <= truth <= parameter.high
    assert result.Fc.claimed and result.Fc.value == pytest.approx(FC, rel=0.02)
    assert result.r2 > 0.995
    assert abs(result.terms["offset"]) < 0.02 * FC
    for lag in ("damping", "delay+filter", "zero-phase filter"):
        assert (result.hypothesis.lag.name == lag) == (name == lag)
    late = {"late slip": 4, "delay+filter": 17}  # a mean of 15 rows adds 7
    assert result.delay_rows == pytest.approx(late.get(name, 0), abs=0.5)


BOUNDS = {  # least Fc over FC, and the largest presliding length over FC/SIGMA0
    "dahl": (1, 1),
    "slip": (1, 3),
    "stribeck": (1, 1.3),
    "log speed": (0.93, 1.03),
    "asymmetric": (0.75, 1.25),
}


@pytest.mark.parametrize("name", BOUNDS)
def test_bounds_for_a_compensator_hold_at_each_speed_and_in_both_directions(name):
    least, most = BOUNDS[name]
    Fc_low, length_long, sigma0_high = found(name).compensator_bounds  # noqa: N806
    assert sigma0_high == found(name).sigma0.high
    assert 0.9 * least * FC <= Fc_low <= least * FC
    assert most * FC / SIGMA0 <= length_long <= 1.15 * most * FC / SIGMA0


def test_the_length_of_a_compensator_is_that_of_the_breakaway_not_of_the_first_slope() -> None:
    """Friction on both sides of a soft shaft: stiff at first, then the shaft twists."""
    parts = (80.0, 0.25), (20.0, 0.25)
    torque = sum(dahl_torque(MOTION, sigma0, Fc) for sigma0, Fc in parts)
    result = identify([log_of(MOTION, torque, 0.01)])
    _, length_long, _ = result.compensator_bounds
    angle = np.linspace(1e-5, 0.06, 1000)
    true = sum(-Fc / FC * np.expm1(-sigma0 / Fc * angle) for sigma0, Fc in parts)
    assert np.all((-np.expm1(-angle / length_long) <= true)[true < 0.95])
    assert 1.9 * FC / SIGMA0 < length_long < 2.5 * FC / SIGMA0  # the softer side alone: 2.5


@pytest.mark.parametrize("seed", [52001, 52002])
def test_a_slope_at_rest_that_no_log_resolves_has_no_upper_bound(seed: int) -> None:
    result = identify([hostile_logs.KINDS["eight elements"](seed)])
    *known, sigma0_high = result.compensator_bounds
    assert sigma0_high is None and not result.sigma0.claimed and all(known)


def test_a_play_between_encoder_and_friction_leaves_no_bounds() -> None:
    result = identify([log_of(chirp(), dahl_torque(behind_play(chirp(), 0.004)))])
    assert result.play > 0 and result.compensator_bounds is None
    assert "play" in result.against_bounds


def test_a_peak_after_rests_hides_the_slope_at_rest_only() -> None:
    result = identify([hostile_logs.KINDS["adhesion after rests"](1)])
    Fc_low, length_long, _ = result.compensator_bounds  # noqa: N806
    assert Fc_low <= FC and length_long >= FC / SIGMA0  # although sigma0 is not claimed
    assert result.hypothesis.law.name == "breakaway" and result.claimed == (False, True)
    assert result.Fc.low <= FC <= result.Fc.high


def test_a_law_that_is_asked_for_is_exported():
    """It may be more than the log needs, but must not contradict it."""
    theta = chirp()
    more = springs(theta, (0.3 * SIGMA0, 0.1 * FC), (0.1 * SIGMA0, 0.3 * FC))
    three = log_of(theta, dahl_torque(theta, 0.6 * SIGMA0, 0.6 * FC) + more)
    for log, name, elements in ((three, "mixed-3", 3), (shaft(), "slip-4", 4)):
        facts = json.loads(report.as_json(identify([log], Options(model=name))))
        assert facts["exported_model"].endswith(f"K={elements}")
        (parts,) = (m["parts"] for m in facts["models"] if m["name"] == facts["exported_model"])
        assert len(parts) == elements
    facts = report.numbers(found("asymmetric"))
    assert facts["r2_plan"] > 0.98
    assert 0 < facts["extra_standard_errors"]["offset"] < 0.02 * FC  # without the asymmetry
    coulomb = report.numbers(identify([shaft()], Options(model="coulomb")))
    assert "Coulomb" in coulomb["plan"]["against"][0]
    with pytest.raises(Error, match="mixed-4: .*does not fit"):
        report.numbers(identify([shaft()], Options(model="mixed-4")))
    for name, law in OPTIONS.items():
        assert name == "coulomb" or law.in_library


class ByAngle(Limits):
    """A law of this test: Fc grows over the range of the angle."""

    name = label = "by angle"
    shape = ((0.05, -0.9, 0.9),)

    def change(self, samples, a, shape):
        return samples.terms["spring"]  # -1 .. 1


def test_a_new_law_is_one_class(monkeypatch):
    monkeypatch.setitem(LAWS, ByAngle.name, ByAngle())
    result = identify([log_of(MOTION, dahl_torque(MOTION, Fc=FC * (1 + 4 * MOTION)), 0.01)])
    facts = report.numbers(result)
    (own,) = (one for one in facts["models"] if one["chosen"])
    assert facts["model"] == own["name"] == "by angle" and not own["in_library"]
    assert own["parts"][0]["shape_1"] == pytest.approx(0.2, abs=0.01)  # of 50 mrad
    assert facts["exported_model"] != "by angle" and result.r2 > 0.995
    for name, truth in (("sigma0", SIGMA0), ("Fc", FC)):
        assert facts[name] == pytest.approx(truth, rel=0.02)
    copied = pickle.loads(pickle.dumps(result))  # as from another process
    assert report.numbers(copied) == facts and copied.hypothesis == result.hypothesis
    Fc_low, length_long, _ = result.compensator_bounds  # noqa: N806
    assert Fc_low <= 0.8 * FC and length_long >= 1.2 * FC / SIGMA0
