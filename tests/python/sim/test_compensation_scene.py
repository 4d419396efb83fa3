# SPDX-License-Identifier: MIT
"""`dahl demo --scene compensation`: what docs/compensation.md states of each law, also of a rival
that is better; its files and refusals. test_compensation_axis.py has the laws and the axis.
"""

import json
from pathlib import Path

import numpy as np
import pytest
from dahl.sim import compensation
from dahl.sim.compensation import Comparison
from dahl.sim.compensation_axis import PERIOD_S, run
from identify_tools import complaint

OBSERVED, LUGRE, DISTURBANCE = "dahl + observer", "LuGre observer", "disturbance observer"
REVERSAL, ELSEWHERE = "reversal rule", "learned elsewhere"
WITHOUT_LEARNING = ("sign", "tanh", "dead band", REVERSAL, LUGRE, DISTURBANCE)
CASCADE = ("Fc 30 % low, cascade", "Fc 30 % high, cascade")
BIG_ERRORS = ("Fc 30 % low", "Fc 30 % high", "Fc fell by 30 %", *CASCADE)
RIGHT = ("17 bits", "17 bits, integral", "17 bits, cascade", "LuGre with Stribeck")
NOISY = "14 bits, noise 2, delay 3"
SMALL = "10 mrad to and fro"


@pytest.fixture(scope="module")
def compared(library) -> Comparison:
    ended: list[None] = []
    found = compensation.compare(progress=lambda: ended.append(None))
    assert len(ended) == compensation.count_steps()
    return found


@pytest.fixture(scope="module")
def ratio(compared: Comparison):
    """Ratio by law and case of the position loop."""
    cases = compared.numbers["position"]
    return lambda law, case: cases[case][law]["ratio"]


@pytest.fixture(scope="module")
def number(compared: Comparison):
    """A number by its name, law and case; of the position loop or of the hand."""
    return lambda name, law, case, axis="position": compared.numbers[axis][case][law][name]


LIMIT, SLEW = 1.0, 50.0  # N m, N m/s: of the library (library_law.h)
LIMITS = [  # largest ratio of dahl + observer
    ("17 bits", 0.005),
    ("17 bits, cascade", 0.02),
    ("Fc 10 % low", 0.015),
    ("Fc 10 % high", 0.015),
    ("Fc 30 % low", 0.04),
    ("Fc 30 % high", 0.04),
    ("Fc 30 % low, cascade", 0.1),
    ("Fc 30 % high, cascade", 0.1),
    ("Fc fell by 30 %", 0.06),
    ("LuGre with Stribeck", 0.006),
    ("Maxwell slip", 0.03),
    (SMALL, 0.05),
]


@pytest.mark.parametrize(("case", "limit"), LIMITS)
def test_model_and_observer_keep_their_ratio(case: str, limit: float, ratio) -> None:
    assert ratio(OBSERVED, case) <= limit


def test_they_are_the_best_if_the_model_is_right_or_far_off(ratio) -> None:
    """Of all laws that do not learn the motion."""
    for cases, share in ((RIGHT, 0.8), ((*BIG_ERRORS, "Maxwell slip", SMALL), 0.75)):
        for case in cases:
            others = [ratio(law, case) for law in WITHOUT_LEARNING]
            assert ratio(OBSERVED, case) < share * min(others), case


def test_a_learned_torque_is_the_best_for_the_motion_that_it_has_learned(ratio) -> None:
    for case in ("Fc 10 % low", "Fc 30 % high", *CASCADE, "Maxwell slip", "14 bits, noise 2"):
        assert ratio("learned", case) < ratio(OBSERVED, case), case
    assert ratio("learned", "17 bits") < 0.005


def test_a_learned_torque_fails_for_another_motion_and_another_friction(ratio) -> None:
    assert ratio(ELSEWHERE, "17 bits") > 0.8
    assert ratio(ELSEWHERE, "17 bits, cascade") > 1.5
    assert ratio("learned", "Fc fell by 30 %") > 0.35


def test_a_disturbance_observer_needs_no_friction(ratio) -> None:
    """It is better than the model alone if Fc is wrong by 10 %, and worse by far if it is right."""
    for case in ("Fc 10 % low", "Fc 10 % high", "Fc 30 % low", "Fc 30 % high"):
        assert ratio(DISTURBANCE, case) == pytest.approx(0.063, abs=0.01)
        assert ratio(DISTURBANCE, case) < ratio("dahl", case)
        assert ratio(OBSERVED, case) < 0.55 * ratio(DISTURBANCE, case)
    assert ratio("dahl", "17 bits") < 0.1 * ratio(DISTURBANCE, "17 bits")


def test_a_late_and_noisy_loop_gains_more_from_a_lugre_observer(ratio, number) -> None:
    """The loop itself is the noise. The bristle of the measured speed takes some of its damping."""
    assert ratio(LUGRE, NOISY) < 0.75 * min(ratio(OBSERVED, NOISY), ratio("dahl", NOISY))
    assert number("hold", LUGRE, NOISY) < 0.6 * number("hold", OBSERVED, NOISY)


def test_a_reversal_rule_is_good_for_the_motion_to_which_it_is_tuned(ratio) -> None:
    """It does not depend on sigma0."""
    assert ratio(REVERSAL, "17 bits") < 0.04
    assert ratio(REVERSAL, "sigma0 / 3") < ratio(OBSERVED, "sigma0 / 3")
    assert ratio(REVERSAL, NOISY) < 1.1 * ratio(OBSERVED, NOISY)
    assert ratio(REVERSAL, SMALL) > 1.1


def test_the_hold_of_a_pd_loop_needs_the_observer(number) -> None:
    """In mrad. With a wrong sigma0, a LuGre observer swings."""
    hold = {law: 1e3 * number("hold", law, "17 bits") for law in compensation.LAWS}
    assert hold["dahl"] > 15 and hold[OBSERVED] < 0.2 and hold[DISTURBANCE] < 0.2
    assert number("hold", OBSERVED, "14 bits, noise 2") < 1.5e-3
    assert number("hold", OBSERVED, "14 bits, noise 2") < 1.5 * number(
        "hold", "none", "14 bits, noise 2"
    )
    assert number("hold", LUGRE, "sigma0 x 3") > 3e-3
    assert number("noise", LUGRE, "sigma0 x 3") > 0.1


def test_an_integral_holds_with_each_law(number) -> None:
    for law in compensation.LAWS:
        for case in ("17 bits, integral", "17 bits, cascade"):
            assert number("hold", law, case) < 0.2e-3, (law, case)


def test_the_tuned_laws_meet_the_bound_of_noise(number) -> None:
    """With another seed than that of the tuning, and thus with a margin."""
    for case in ("17 bits", "14 bits, noise 2", NOISY, "17 bits, integral", "17 bits, cascade"):
        bound = 1.1 * number("noise", "none", case) + compensation.NOISE_FLOOR
        for law in compensation.LAWS:
            assert number("noise", law, case) <= 1.03 * bound, (law, case)


def test_a_hand_feels_as_much_with_a_lugre_observer(number) -> None:
    """With coarse and late readings less; in small motions, and while it holds, more."""

    def hand(name: str, law: str, case: str) -> float:
        return number(name, law, case, "hand")

    for case in ("17 bits, noise 1", "LuGre with Stribeck", "Maxwell slip, sigma0 / 3"):
        assert hand("ratio", "dahl", case) == pytest.approx(hand("ratio", LUGRE, case), rel=0.05)
    assert hand("ratio", LUGRE, NOISY) < 0.8 * hand("ratio", "dahl", NOISY)
    assert hand("ratio", "dahl", "5 mrad to and fro") < 0.5 * hand(
        "ratio", LUGRE, "5 mrad to and fro"
    )
    for case in ("17 bits, noise 1", NOISY, "12 bits, noise 1"):
        assert hand("hold", "dahl", case) < 0.15 * hand("hold", LUGRE, case)
        assert hand("noise", "dahl", case) == 0 < hand("noise", LUGRE, case)
        for law in ("sign", "tanh", "dead band"):
            assert hand("ratio", law, case) > 0.5


def test_a_hold_does_not_change_the_sign_of_the_torque(compared: Comparison) -> None:
    for case, laws in compared.numbers["position"].items():
        assert laws["dahl"]["sign_changes_per_s"] == 0, case
    assert compared.numbers["position"]["sigma0 x 3"][LUGRE]["sign_changes_per_s"] > 1


def test_the_motor_torque_stays_within_limit_and_slew(compared: Comparison) -> None:
    added = compared.hand["dahl"].added
    assert np.max(np.abs(added)) <= LIMIT
    assert 0 < np.max(np.abs(np.diff(added))) <= SLEW * PERIOD_S * (1 + 1e-6)


def test_the_seed_alone_decides(compared: Comparison) -> None:
    case = compensation.SHOWN_HAND

    def error(seed: int) -> list[float]:
        return [*run(case, "DAHL", 0.0, seed).error]

    assert error(1) == error(1) == [*compared.hand["dahl"].error]
    assert error(2) != error(1)


@pytest.mark.parametrize(("words", "seed"), [((), 1), (("--seed", "7"), 7)])
def test_the_demo_writes_picture_and_numbers_of_its_seed(
    words: tuple[str, ...], seed: int, compared: Comparison, dahl, monkeypatch
) -> None:
    asked = []

    def compare(seed: int, _progress: object) -> Comparison:
        asked.append(seed)
        return compared

    monkeypatch.setattr(compensation, "compare", compare)
    done = dahl("demo", "--scene", "compensation", *words, "--json", "-o", "out")
    assert done.returncode == 0 and asked == [seed], done.stderr
    numbers = json.loads(done.stdout)
    assert numbers == json.loads(Path("out/summary.json").read_text())
    assert numbers == numbers | compared.numbers | {"scene": "compensation", "seed": seed}
    assert Path("out/compensation.png").read_bytes().startswith(b"\x89PNG")


REFUSED = ["compensation --bus socketcand", "park-steer --seconds 3", "park-steer --fc 1"]


@pytest.mark.parametrize("words", REFUSED)
def test_options_of_a_bus_or_a_log_are_refused(words: str, dahl) -> None:
    code, line = complaint(dahl("demo", "--scene", *words.split(), "-o", "out"))
    assert code == 2 and words.split()[1] in line
    assert not Path("out/summary.json").exists()
