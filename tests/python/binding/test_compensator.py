# SPDX-License-Identifier: MIT
"""dahl.Compensator and dahl.Residual: the bits of the C calls on a log, units of their terms,
refusals with their limits, and changes of parameters in exact numbers.
"""

import math
import random
from collections.abc import Callable
from fractions import Fraction
from functools import partial
from typing import Any

import dahl
import numpy as np
import pytest
from dahl.binding import models
from dahl.binding.library import c
from model_examples import STATE_ELEMENTS

THETA = 3.8e-4
FRICTION = {"sigma0": 100.0, "Fc": 0.5, "theta_per_count": THETA}
VALUES = {"Fc_low": 0.45, "length_long": 4e-3, "gain": 0.75, "limit": 0.3, "slew": 50.0}
VALUES |= {"period": 1e-3, "rise": 0.08, "fall": 0.04, "fade_speed": 1.5}
INERTIA = 2e-3
VALUES |= {"sigma0_high": 120.0, "load": 0.02, "inertia": INERTIA, "delay": 2e-3}
COUNTS = {"elastic": False, "noise": 1, "play": 2, "jump": 500}
ELEMENTS: dict[str, Callable[[], Any]] = {
    "dahl": lambda: dahl.Friction(dahl.Plan(**FRICTION)),
    "slip": lambda: dahl.Slip([60.0, 40.0], [0.3, 0.2], THETA),
    "mix": lambda: dahl.Parallel(dahl.Slip([50.0], [0.25], THETA), ELEMENTS["dahl"]()),
}
for row in STATE_ELEMENTS:  # an Fc for each direction, or the breakaway
    values = [100.0, *[0.5, 0.4][: row.Fcs], THETA, *([0.6] if row.key else [])]
    ELEMENTS[row.name] = partial(models.class_of(row), *values)


def compensator(**changed: Any) -> dahl.Compensator:
    return dahl.Compensator(**(FRICTION | VALUES | COUNTS | changed))


OBSERVER = {"inertia": INERTIA, "corner": 15.0, "limit": 0.25, "speed_gain": 0.4, "resonance": 0.0}


def residual(**changed: Any) -> dahl.Residual:
    tick = {"slew": 50.0, "period": 1e-3, "delay": 2}
    return dahl.Residual(**(FRICTION | OBSERVER | tick | changed))


def params_of_c(reference: bool) -> Any:
    law = c.DAHL_COMPENSATOR_REFERENCE if reference else c.DAHL_COMPENSATOR_MEASURED
    values = {"friction": FRICTION, "law": law, **VALUES, **COUNTS}
    return c.new("dahl_compensator_params_t *", values)


def compensator_of_c(reference: bool) -> tuple[Any, Any]:
    """Return plan and state."""
    plan = c.new("dahl_compensator_plan_t *")
    assert c.dahl_compensator_prepare(plan, params_of_c(reference)) == c.DAHL_COMPENSATOR_OK
    return plan, c.new("dahl_compensator_t *")


def terms_of_c(state: Any) -> dict[str, float]:
    counts = ("move", "play_position", "bad_ticks", "rejected")
    return {
        **{name: getattr(state, name) for name in counts},
        "speed": state.speed_q20 / 2**20 * VALUES["fade_speed"],
        "fade": state.fade_q30 / 2**30,
        "speed_fade": state.speed_fade_q15 / 2**15,
        "friction": state.ratio_q30 / 2**30 * 0.5,
        "wanted": state.wanted_q30 / 2**30 * 0.5,
        "torque": state.torque_q30 / 2**30 * 0.5,
    }


@pytest.mark.parametrize("name", ELEMENTS)
@pytest.mark.parametrize("reference", [False, True])
def test_a_log_has_the_bits_of_the_c_calls_with_any_element(name: str, reference: bool) -> None:
    """Its first part ends while the torque fades over speed, its second with bad readings."""
    moves = np.rint(-10 * np.sin(np.arange(600) / 150)).astype(int)
    flags = np.arange(600) % 50 < 45
    commands = moves[::-1] if reference else None
    one, element, same = compensator(reference=reference), ELEMENTS[name](), ELEMENTS[name]()
    plan, state = compensator_of_c(reference)
    for part, unused in (slice(555), "bad_ticks"), (slice(555, 600), "move"):
        steps = commands[part] if reference else None
        for k, torque in enumerate(one.run_log(element, moves[part], steps, flags[part])):
            is_good = bool(flags[part][k])
            move = c.dahl_compensator_move(plan, state, int(moves[part][k]), is_good)
            w = same.step_counts_q30(int(steps[k]) if reference else move)
            assert torque == c.dahl_compensator_torque(plan, state, w) / 2**30 * 0.5
        assert one.terms == terms_of_c(state)
        assert [term for term, value in one.terms.items() if value in (0, 1)] == [unused]
    assert element == same and one.terms["rejected"] == 60


def test_the_residual_has_the_bits_of_the_c_calls() -> None:
    """The axis moves, some readings are bad, and some torques are beyond 64 Fc."""
    plan, state = c.new("dahl_residual_plan_t *"), c.new("dahl_residual_t *")
    params = c.new("dahl_residual_params_t *", OBSERVER | {"delay": 2})
    assert c.dahl_residual_prepare(plan, params_of_c(True), params) == c.DAHL_COMPENSATOR_OK
    one, axis = residual(), compensator(reference=True)
    axis_plan, axis_state = compensator_of_c(True)
    random = np.random.default_rng(6)
    for tick in range(3000):
        move, is_good = round(20 * math.sin(tick / 200)), bool(random.random() > 0.01)
        torque = float(random.choice([1e30, random.normal(0.1, 0.3)], p=[0.01, 0.99]))
        axis.move(move, is_good)
        c.dahl_compensator_move(axis_plan, axis_state, move, is_good)
        wanted = c.dahl_residual_torque(plan, state, axis_state, move)
        assert one.torque(axis, move) == wanted / 2**30 * 0.5
        one.note(torque)
        c.dahl_residual_note(state, c.dahl_residual_q24(plan, torque))
        terms = {"raw": state.raw_q56 / 2**56 * 0.5, "filtered": state.filtered_q56 / 2**56 * 0.5}
        assert one.terms == terms | {"torque": wanted / 2**30 * 0.5}


# --- exact numbers --------------------------------------------------------------------------------


def float32(value: float | Fraction) -> float:
    return float(np.float32(float(value)))


def random_float(chance: random.Random, least: float, most: float) -> float:
    return float32(math.exp(chance.uniform(math.log(least), math.log(most))))


def near(chance: random.Random, value: Fraction) -> float:
    """Return the float nearest to a value, or one of its neighbours, or one a bit farther away."""
    ulps = chance.choice([-1000, -2, -1, 0, 0, 1, 2, 1000])
    bits = int(np.float32(float(value)).view(np.int32))
    return float(np.int32(bits + ulps).view(np.float32))


def random_axis(chance: random.Random) -> dict[str, float]:
    """Return parameters of which each of the three rules is near its limit."""
    Fc = random_float(chance, 1e-6, 1e6)  # noqa: N806
    sigma0 = float32(Fc / (Fc * random_float(chance, 1e-4, 1e-2)))
    one: dict[str, float] = {"Fc": Fc, "sigma0": sigma0, "elastic": chance.random() < 0.5}
    one |= {"gain": random_float(chance, 0.2, 1), "period": random_float(chance, 1e-5, 1e-2)}
    share = Fraction(chance.choice([0.0, 1e-12, 1e-3, 0.5, 0.999]))
    Fc_low = Fraction(one["gain"]) * Fraction(Fc) / Fraction(95, 100) / (1 - share)  # noqa: N806
    one["load"] = float32(share * Fc_low)
    one["Fc_low"] = near(chance, Fc_low)
    seen = Fraction(Fc) / Fraction(one["sigma0"]) / (4 if one["elastic"] else 1)
    one["length_long"] = near(chance, seen)
    one["delay"] = float32(one["period"] * random_float(chance, 1e-9, 1e9))
    one["sigma0_high"] = random_float(chance, 1e-3, 1e6)
    late = Fraction(one["delay"]) + Fraction(one["period"]) / 2
    one["inertia"] = near(chance, Fraction(one["sigma0_high"]) * late**2 / 3)
    return one


def exact_code(one: dict[str, float]) -> tuple[int, bool]:
    """Return the code by exact fractions, and whether a rule is within the stated rounding."""
    f = {name: Fraction(value) for name, value in one.items()}
    net = Fraction(95, 100) * (f["Fc_low"] - f["load"])
    torque = f["gain"] * f["Fc"]
    if torque > net:
        return c.DAHL_COMPENSATOR_GAIN, False
    is_near = net < torque * (1 + Fraction(2) ** -30)
    shorter = Fraction(float(np.nextafter(np.float32(one["length_long"]), np.float32(0))))
    if f["sigma0"] * shorter * (4 if one["elastic"] else 1) > f["Fc"]:
        return c.DAHL_COMPENSATOR_SLOPE, is_near
    least = f["sigma0_high"] * (f["delay"] + f["period"] / 2) ** 2
    if 3 * f["inertia"] < least:
        return c.DAHL_COMPENSATOR_INERTIA, is_near
    is_near |= 3 * f["inertia"] < least * (1 + Fraction(2) ** -26)
    return c.DAHL_COMPENSATOR_OK, is_near


def test_the_rules_of_an_axis_are_decided_as_by_fractions() -> None:
    chance, found = random.Random(3), dict.fromkeys(range(-23, 1), 0)
    for _ in range(5000):
        one = random_axis(chance)
        friction = {name: one[name] for name in ("sigma0", "Fc")} | {"theta_per_count": 1e-5}
        rest = {name: value for name, value in one.items() if name not in friction}
        rest |= {"law": c.DAHL_COMPENSATOR_MEASURED, "limit": 1.0, "slew": 100 * one["Fc"]}
        rest |= {"play": 1, "jump": 1}
        params = c.new("dahl_compensator_params_t *", {"friction": friction, **rest})
        code, is_near = exact_code(one)
        got = c.dahl_compensator_prepare(c.new("dahl_compensator_plan_t *"), params)
        assert got == code or (is_near and got < 0), one
        found[code] += 1
    kinds = {code for code, number in found.items() if number > 100}
    named = ("GAIN", "SLOPE", "INERTIA", "OK")
    assert kinds == {getattr(c, f"DAHL_COMPENSATOR_{name}") for name in named}


def random_plan(chance: random.Random) -> dict[str, Any]:
    """Return parameters of the reference law whose units are far apart, or equal."""
    Fc = chance.choice([0.5, 0.25, random_float(chance, 0.02, 20)])  # noqa: N806
    one = {"sigma0": 100.0, "Fc": Fc, "theta_per_count": THETA, "reference": True}
    one |= {"gain": random_float(chance, 0.1, 1), "limit": random_float(chance, 0.05, 5) * Fc}
    one |= {"slew": random_float(chance, 1e-4, 1e4) * Fc}
    one |= {"period": random_float(chance, 1e-4, 2e-2)}
    one |= {"fade_speed": chance.choice([0.0, random_float(chance, 1, 100)]), "jump": 100}
    return one | {"play": chance.choice([1, 2, 7, 100])}


def torque_of(one: dahl.Compensator, ratio_q30: int) -> Fraction:
    """Return the torque of a tick in 2^-30 N m."""
    return Fraction(one.torque_q30(ratio_q30)) * Fraction(one.Fc)


def test_limit_and_slew_hold_in_newton_metres_across_a_change() -> None:
    """Exactly, after each of 5000 changes of all parameters. A lower limit is reached at once."""
    chance, parted = random.Random(4), 0
    params = random_plan(chance)
    one = dahl.Compensator(**params)
    for _ in range(5000):
        for _ in range(chance.choice([1, 3, 10])):
            move = one.move(chance.randint(-3, 20), chance.random() < 0.9)
            last = torque_of(one, chance.choice([-(2**30), 2**30, 2**29]))
        params = random_plan(chance)
        one.change(**params)
        assert abs(one.terms["play_position"] - one.play / 2) <= one.play / 2
        one.move(move)
        torque = torque_of(one, chance.choice([-(2**30), 2**30, 0]))
        limit = Fraction(one.limit) * 2**30
        slew = Fraction(one.slew) * Fraction(one.period) * 2**30
        assert abs(torque) <= limit and one.play == params["play"]
        assert one.Fc == float32(params["Fc"])
        limit = min(limit, 2**31 * Fraction(one.Fc))
        if abs(last) <= limit:
            assert abs(torque - last) <= slew
        else:
            parted += abs(torque - last) > slew
            assert abs(torque) >= limit * Fraction(999, 1000) - slew
    assert parted > 100


def random_observer(chance: random.Random, axis: dict[str, Any]) -> dict[str, Any]:
    one = {name: axis[name] for name in (*FRICTION, "slew", "period")}
    one |= {"inertia": random_float(chance, 1e-6, 1e-3) * axis["Fc"], "no_integral": True}
    one |= {"corner": random_float(chance, 0.005, 0.045) / axis["period"], "speed_gain": 1e9}
    one |= {"delay": chance.randint(0, 3)}
    return one | {"limit": random_float(chance, 0.05, 2) * axis["Fc"]}


def test_the_observer_keeps_limit_and_slew_across_a_change() -> None:
    """Exactly in N m, as above. Its low-passes keep their torque."""
    chance, parted = random.Random(5), 0
    params = random_plan(chance) | {"slew": 50.0}
    axis = dahl.Compensator(**params)
    one = dahl.Residual(**random_observer(chance, params))
    for _ in range(3000):
        for _ in range(chance.choice([1, 3, 10])):
            move = chance.randint(-3, 20)
            axis.move(move, chance.random() < 0.9)
            last = Fraction(one.torque_q30(axis, move)) * Fraction(one.Fc)
            one.note(chance.uniform(-5, 5) * one.Fc)
        params = random_plan(chance)
        params["slew"] = random_float(chance, 0.01, 1e4) * params["Fc"]
        before, units = one.terms, one.Fc + params["Fc"]
        axis.change(**params)
        one.change(**random_observer(chance, params))
        due = {name: pytest.approx(value, abs=2**-24 * units) for name, value in before.items()}
        if max(map(abs, before.values())) < 60 * one.Fc:
            assert one.terms == due
        axis.move(move)
        torque = Fraction(one.torque_q30(axis, move)) * Fraction(one.Fc)
        limit = min(Fraction(one.limit), 2 * Fraction(one.Fc)) * 2**30
        slew = Fraction(one.slew) * Fraction(one.period) * 2**30
        assert abs(torque) <= limit
        parted += abs(last) > limit
        assert abs(last) > limit or abs(torque - last) <= slew
    assert parted > 100


def test_a_change_converts_the_speed_and_keeps_the_end_of_the_play() -> None:
    """At 1.9 rad/s the torque is off with a fade speed of 0.9 rad/s, and half with 1.27 rad/s."""
    given = {"reference": True, "rise": 0.0, "fade_speed": 0.9, "play": 7, "slew": 1e4}
    one = compensator(**given, gain=1.0, Fc_low=0.5)
    for _ in range(200):
        one.move(5)
    assert one.torque_q30(2**30) == 0 and one.terms["play_position"] == 7
    one.change(fade_speed=1.27, play=100)
    assert one.terms["speed"] == pytest.approx(1.9, rel=1e-4) and one.terms["play_position"] == 100
    assert one.torque(2**30) == pytest.approx(0.5 * (2 - 1.9 / 1.27), rel=1e-3)
    one.change(fade_speed=0.0)
    assert one.torque(2**30) == pytest.approx(0.3, rel=1e-6)  # its limit
    one.change(fade_speed=0.9)  # the speed is that of the last move
    assert one.terms["speed"] == pytest.approx(5 * THETA / 1e-3, rel=1e-3)
    assert one.torque_q30(2**30) == 0


def test_a_change_keeps_each_torque_and_the_speed_in_their_units() -> None:
    one = compensator()
    one.run_log(ELEMENTS["dahl"](), [5, 5, 5, -3, 2] * 9)
    before = one.terms
    one.change(Fc=0.31, sigma0=61.0, Fc_low=0.3, gain=0.4, fade_speed=7.0, period=2e-3, delay=1e-3)
    due = {name: pytest.approx(value, rel=1e-5) for name, value in before.items()}
    assert one.terms == due and 0 not in (before["torque"], before["wanted"], before["speed"])


def test_a_change_has_the_bits_of_c_and_a_refused_one_changes_nothing() -> None:
    one, (plan, state) = compensator(), compensator_of_c(False)
    one.run_log(ELEMENTS["dahl"](), [9, 9, 9])
    bearing = ELEMENTS["dahl"]()
    for _ in range(3):
        w = bearing.step_counts_q30(c.dahl_compensator_move(plan, state, 9, True))
        c.dahl_compensator_torque(plan, state, w)
    before = compensator()
    before.run_log(ELEMENTS["dahl"](), [9, 9, 9])
    for wrong in ({"gain": 2.0}, {"inertia": 1e-9}, {"speed": 1.0}, {"elastic": 1}):
        with pytest.raises((dahl.InputError, TypeError)):
            one.change(**wrong)
        assert one == before
    params, to = params_of_c(False), c.new("dahl_compensator_plan_t *")
    params.friction.Fc, params.friction.sigma0, params.gain = 0.41, 80.0, 0.9
    assert c.dahl_compensator_prepare(to, params) == c.DAHL_COMPENSATOR_OK
    c.dahl_compensator_change(plan, to, state)
    changes = {"Fc": 0.41, "sigma0": 80.0, "gain": 0.9}
    one.change(**changes)
    assert one.torque_q30(2**30) == c.dahl_compensator_torque(to, state, 2**30) != 0
    assert bytes(c.buffer(one._state)) == bytes(c.buffer(state))
    assert repr(one) == repr(dahl.Compensator(**(FRICTION | VALUES | COUNTS | changes)))


# --- refusals -------------------------------------------------------------------------------------

REFUSED: list[tuple[Callable[..., Any], dict[str, Any], tuple[str, ...]]] = [
    (compensator, {"Fc_low": 0.37, "reference": True}, ("gain*Fc = 0.375 ", " Fc_low = 0.37")),
    (compensator, {"Fc_low": 0.4}, ("gain*Fc = 0.375 ", "0.95*(Fc_low - load) = 0.361")),
    (compensator, {"load": 0.06}, ("gain*Fc = 0.375 ", "0.95*(Fc_low - load) = 0.3704")),
    (compensator, {"length_long": 0.006}, ("Fc/sigma0 = 0.005 ", "length_long = 0.006")),
    (
        compensator,
        {"elastic": True},
        ("Fc/sigma0 = 0.005 ", "4*length_long of an elastic", "0.016"),
    ),
    (compensator, {"inertia": 2e-4}, ("inertia = 0.0002 ", "(delay + period/2)^2/3 = 0.00025")),
    (compensator, {"inertia": 0.0}, ("inertia = 0 is outside 2^-64", "reference = False")),
    (compensator, {"delay": 0.0}, ("delay = 0 is outside 2^-64", "reference = False")),
    (compensator, {"sigma0_high": math.nan}, ("sigma0_high = nan ", "N m/rad")),
    (compensator, {"load": -0.1}, ("load = -0.1 is outside 0, or",)),
    (compensator, {"play": 1}, ("play = 1 ", "2*noise = 2")),
    (compensator, {"play": 0}, ("play = 0 ", "1")),
    (compensator, {"jump": 0}, ("jump = 0 ", "1")),
    (compensator, {"jump": 1000, "fade_speed": 0.3}, ("jump = 1000 ", "1000 times")),
    (compensator, {"jump": 1010, "fade_speed": 0.38}, ("jump = 1010 ", "1000 times")),
    (compensator, {"slew": 8e-7}, ("slew = 8e-07 ", "2^-29 Fc")),
    (compensator, {"jump": 2**29, "fade_speed": 1e4}, ("jump = 536870912 ", "500 times the 26315")),
    (compensator, {"gain": 1.5}, ("gain = 1.5 ", "<= 1")),
    (compensator, {"Fc_low": 0.0}, ("Fc_low = 0 is outside 2^-64", "reference = False")),
    (compensator, {"length_long": -1.0, "reference": True}, ("= -1 is outside 0, or 2^-64",)),
    (compensator, {"slew": 0.0}, ("slew = 0 ", "N m/s")),
    (compensator, {"period": -1.0}, ("period = -1 ", "(s)")),
    (residual, {"corner": 16.0}, ("corner = 16 Hz ", "speed_gain/(4*pi*inertia) = 15.91549")),
    (residual, {"speed_gain": 0.0}, ("speed_gain = resonance = 0",)),
    (residual, {"speed_gain": 0.0, "resonance": 149.0}, ("corner = 15 Hz ", "resonance/10")),
    (residual, {"resonance": -1.0}, ("resonance = -1 ", "0, or 2^-64")),
    (residual, {"corner": 51.0}, ("corner = 51 Hz ", "0.05/period")),
    (residual, {"inertia": 10.0}, ("inertia = 10: ", "64 Fc")),
    (residual, {"inertia": 0.0}, ("inertia = 0 ", "kg m2")),
    (residual, {"delay": 4}, ("delay = 4 ", "3")),
    (residual, {"limit": 0.33}, ("limit = 0.33 N m ", "0.64 Fc = 0.32", "no_integral = False")),
    (residual, {"Fc": 0.311, "limit": 0.1990400591}, ("limit = 0.19904 N m ", "0.64 Fc")),
    (residual, {"slew": 5e-5}, ("slew = 5e-05 ", "2^-23 Fc")),
    (residual, {"slew": 0.0}, ("slew = 0 ", "N m/s")),
    (residual, {"theta_per_count": 0.0}, ("theta_per_count = 0 ",)),
    (residual, {"Fc": math.inf}, ("Fc = inf ",)),
]


@pytest.mark.parametrize(("make", "changed", "words"), REFUSED)
def test_a_bound_that_is_broken_is_named_with_its_value(make, changed, words) -> None:
    with pytest.raises(dahl.Error) as caught:
        make(**changed)
    assert [word for word in words if word not in str(caught.value)] == [], str(caught.value)


POSITIVE, OPTIONAL = ("limit", "slew", "period"), ("rise", "fall", "fade_speed")
LEAST, MOST = 2.0**-64, float(np.nextafter(np.float32(2.0**64), np.float32(0)))
ENDS = dict.fromkeys(OPTIONAL, [0.0, LEAST, MOST]) | dict.fromkeys(POSITIVE, [LEAST, MOST])
ENDS |= {"fade_speed": [0.0], "Fc_low": [0.0, MOST], "length_long": [0.0, LEAST]}
ENDS |= {"gain": [0.0, LEAST, 0.875]}
ENDS |= {"slew": [2.0**-20, MOST], "period": [2.0**-35, MOST]}  # 2^-29 Fc in a tick


@pytest.mark.parametrize("name", ENDS)
def test_a_number_is_accepted_at_its_limits_and_named_beyond(name: str) -> None:
    """0 switches a term off: the fade over speed, or with a reference a bound of the friction."""

    def with_value(value: float) -> dahl.Compensator:
        return compensator(reference=True, **({"fade_speed": 0.0} | {name: value}))

    beyond = [-LEAST, LEAST / 2, 2.0**64, math.inf, math.nan, 1.001 if name == "gain" else -1.0]
    for value in beyond + [0.0] * (name in POSITIVE):
        with pytest.raises(dahl.Error, match=rf"^{name} = .*2\^-64 <= {name}"):
            with_value(value)
    for value in ENDS[name]:
        assert getattr(with_value(value), name) == value


NO_FLAGS = ["False", math.nan, None, [0], np.ones(2), np.timedelta64(1, "s")]


@pytest.mark.parametrize("flag", [*NO_FLAGS, 0, 1, False, True, np.False_, np.int8(1)])
def test_a_flag_is_a_bool_or_a_whole_number(flag: Any) -> None:
    """A text or NaN would be true: a bad reading would count as good."""
    one, again, element = compensator(), compensator(), ELEMENTS["dahl"]()
    if any(flag is wrong for wrong in NO_FLAGS):
        with pytest.raises(TypeError, match="is_good = "):
            one.move(5, flag)
        with pytest.raises((dahl.InputError, TypeError), match="is_good "):
            one.run_log(element, [5, 5], is_good=[flag, flag])
        assert one == compensator()
        return
    one.move(5, flag)
    again.run_log(element, [5], is_good=np.array([flag]))
    assert one.terms["rejected"] == again.terms["rejected"] == int(not flag)


def test_a_log_that_does_not_fit_changes_nothing() -> None:
    one, element = compensator(), ELEMENTS["dahl"]()
    wrong: list[tuple[Any, ...]] = [
        (element, [1, 2], [1, 2]),
        (element, [1, 2], None, [True]),
        (element, [[1]]),
        (element, [0.5]),
        (3, [1]),
    ]
    for arguments in wrong:
        with pytest.raises((dahl.InputError, TypeError)):
            one.run_log(*arguments)
    assert one == compensator() and element == ELEMENTS["dahl"]()


MISFITS: dict[str, Callable[[], Any]] = {
    "reference = False": compensator,
    "compensator.period = 0.002 is not 0.001": lambda: compensator(reference=True, period=2e-3),
    "compensator.slew = 9.0 is not 50.0": lambda: compensator(reference=True, slew=9.0),
    "compensator.Fc = 0.48 is not 0.5": lambda: compensator(reference=True, Fc=0.48),
    "compensator = 5": lambda: 5,
}


@pytest.mark.parametrize("word", MISFITS)
def test_a_compensator_that_does_not_fit_is_refused(word: str) -> None:
    one = residual()
    with pytest.raises((dahl.InputError, TypeError), match=word):
        one.torque(MISFITS[word](), 5)
    with pytest.raises(dahl.Error, match="unexplained = nan"):
        one.note(math.nan)
    assert one == residual()


def test_a_removed_class_names_its_successor() -> None:
    with pytest.raises(AttributeError, match=r"dahl\.Residual"):
        _ = dahl.Adaptation  # type: ignore[attr-defined]
