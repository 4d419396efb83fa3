# SPDX-License-Identifier: MIT
"""dahl.Compensator: the bits of C on a log, each term of a tick, and refusals with their limits."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import dahl
import numpy as np
import pytest

pytestmark = pytest.mark.usefixtures("library")

THETA = 3.8e-4
GIVEN: dict[str, Any] = {"Fc_low": 0.5, "length_long": 0.005, "gain": 1.0, "limit": 1.0}
GIVEN |= {"slew": 50.0, "period": 1e-3, "noise": 1, "play": 2, "jump": 500}
ELEMENTS: dict[str, Callable[[], Any]] = {
    "dahl": lambda: dahl.Friction(dahl.Plan(100.0, 0.5, THETA)),
    "slip": lambda: dahl.Slip([60.0, 40.0], [0.3, 0.2], THETA),
    "mix": lambda: dahl.Parallel(dahl.Slip([50.0], [0.25], THETA), ELEMENTS["dahl"]()),
    "asymmetric": lambda: dahl.Asymmetric(100.0, 0.5, 0.4, THETA),
    "elastoplastic": lambda: dahl.ElastoPlastic(100.0, 0.5, THETA, 0.6),
}
MOVES = np.cumsum(np.random.default_rng(3).integers(-3, 4, 400)).clip(-200, 200)


def compensator(**changed: Any) -> dahl.Compensator:
    return dahl.Compensator(100.0, 0.5, THETA, **(GIVEN | changed))


@pytest.mark.parametrize("name", ELEMENTS)
@pytest.mark.parametrize("reference", [False, True])
def test_a_log_has_the_bits_of_single_ticks_with_any_element(name: str, reference: bool) -> None:
    flags = np.arange(400) % 50 > 4
    one, element = compensator(reference=reference), ELEMENTS[name]()
    again, same = compensator(reference=reference), ELEMENTS[name]()
    commands = MOVES[::-1] if reference else None
    torques = one.run_log(element, MOVES, commands, flags)
    for k, torque in enumerate(torques):
        move = again.move(int(MOVES[k]), bool(flags[k]))
        w = same.step_counts_q30(int(commands[k]) if reference else move)
        assert again.torque(w) == torque == again.terms["torque"]
        assert again.terms["friction"] == w * 2.0**-30 * 0.5
    assert one == again and one.terms["rejected"] == 40
    assert np.abs(np.diff(torques)).max() <= 50.0 * 1e-3 * (1 + 1e-6)


def test_the_terms_of_a_tick_have_units() -> None:
    one = compensator(fade_speed=4.0, rise=0.1)
    for _ in range(50):  # 7.6 rad/s forward
        one.torque_q30(2**30 if one.move(20) else 0)
    terms = one.terms
    assert terms["speed"] == pytest.approx(7.6, rel=0.02)
    assert terms["fade"] == pytest.approx(0.5) and terms["speed_fade"] == pytest.approx(
        0.1, abs=0.04
    )
    assert terms["wanted"] == pytest.approx(0.5 * terms["fade"] * terms["speed_fade"], abs=1e-3)


def test_draw_closes_the_gap_of_two_states() -> None:
    one, element, measured = (
        compensator(pull=0.3, reference=True),
        *(ELEMENTS["dahl"]() for _ in "ab"),
    )
    element.state.w = 2**62
    for _ in range(512):
        one.draw(element, measured)
    assert element.state.w * 2.0**-62 == pytest.approx(np.exp(-1), rel=0.01)
    with pytest.raises(dahl.Error, match="element = Slip"):
        one.draw(ELEMENTS["slip"](), measured)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"Fc_low": 0.49}, ("gain*Fc = 0.5 ", "Fc_low = 0.49")),
        ({"length_long": 0.006}, ("Fc/sigma0 = 0.005 ", "length_long = 0.006")),
        ({"play": 1}, ("play = 1 ", "2*noise = 2")),
        ({"play": 0}, ("play = 0 ", "1")),
        ({"jump": 0}, ("jump = 0 ", "1")),
        ({"jump": 1000, "fade_speed": 0.3}, ("jump = 1000 ", "1000 times")),
        ({"jump": 2**29, "fade_speed": 1e4}, ("jump = 536870912 ", "500 times the 26315.8")),
        ({"gain": 1.5}, ("gain = 1.5 ", "<= 1")),
        ({"Fc_low": 0.0}, ("Fc_low = 0 is outside 2^-64", "reference = False")),
        ({"length_long": -1.0, "reference": True}, ("length_long = -1 is outside 0, or 2^-64",)),
        ({"slew": 0.0}, ("slew = 0 ", "N m/s")),
        ({"period": -1.0}, ("period = -1 ", "(s)")),
        ({"reference": 1}, ("reference = 1",)),
    ],
)
def test_a_bound_that_is_broken_is_named_with_its_value(
    changed: dict[str, Any], words: tuple[str, ...]
) -> None:
    with pytest.raises(dahl.Error) as caught:
        compensator(**changed)
    assert [word for word in words if word not in str(caught.value)] == [], str(caught.value)


POSITIVE, OPTIONAL = ("limit", "slew", "period"), ("rise", "fall", "fade_speed", "pull")
LEAST, MOST = 2.0**-64, float(np.nextafter(np.float32(2.0**64), np.float32(0)))


@pytest.mark.parametrize("name", [*POSITIVE, *OPTIONAL, "Fc_low", "length_long", "gain"])
def test_a_number_is_accepted_at_its_limits_and_named_beyond(name: str) -> None:
    """0 switches a term off: the fade over speed, or with a reference a bound of the friction."""
    beyond = [-LEAST, LEAST / 2, 2.0**64, math.inf, math.nan, 1.001 if name == "gain" else -1.0]
    for value in beyond + [0.0] * (name in POSITIVE):
        with pytest.raises(dahl.Error, match=rf"^{name} = .*2\^-64 <= {name}"):
            compensator(reference=True, **{name: value})
    ends = {"fade_speed": [0.0], "Fc_low": [0.0, MOST], "length_long": [0.0, LEAST]}
    ends |= {"gain": [0.0, LEAST, 1.0]} | dict.fromkeys(POSITIVE, [LEAST, MOST])
    for value in ends.get(name, [0.0, LEAST, MOST]):
        assert getattr(compensator(reference=True, **{name: value}), name) == value


@pytest.mark.parametrize("flag", ["False", math.nan, None, [0], np.ones(2), np.timedelta64(1, "s")])
def test_a_flag_that_is_no_bool_is_refused(flag: Any) -> None:
    """A text or NaN would be true: a bad reading would count as good."""
    one = compensator()
    with pytest.raises(dahl.Error, match="is_good = "):
        one.move(5, flag)
    with pytest.raises(dahl.Error, match="is_good "):
        one.run_log(ELEMENTS["dahl"](), [5, 5], is_good=[flag, flag])
    assert one == compensator()


@pytest.mark.parametrize("flag", [0, 1, False, True, np.False_, np.int8(1)])
def test_a_flag_may_be_a_whole_number(flag: Any) -> None:
    one, again = compensator(), compensator()
    one.move(5, flag)
    again.run_log(ELEMENTS["dahl"](), [5], is_good=np.array([flag]))
    assert one.terms["rejected"] == again.terms["rejected"] == int(not flag)


def test_a_log_that_does_not_fit_changes_nothing() -> None:
    one, element = compensator(), ELEMENTS["dahl"]()
    wrong: list[tuple[Any, ...]] = [([1, 2], [1, 2]), ([1, 2], None, [True]), ([[1]],), ([0.5],)]
    for arguments in wrong:
        with pytest.raises(dahl.Error):
            one.run_log(element, *arguments)
    with pytest.raises(dahl.Error, match="element = 3"):
        one.run_log(3, [1])  # type: ignore[arg-type]
    assert one == compensator() and element == ELEMENTS["dahl"]()
