# SPDX-License-Identifier: MIT
"""dahl.Compensator.from_identified and dahl.Residual.for_compensator: bounds on the safe side, the
conditions of the guarantee in exact numbers, and a next step in each refusal.
"""

import json
import math
import re
from fractions import Fraction
from pathlib import Path
from typing import Any

import dahl
import pytest
from dahl.binding import plan_header
from hypothesis import given
from hypothesis import strategies as st

FOUND = {"linear": False, "Fc_low": 0.45, "length_long": 5.5e-3, "sigma0_high": 90.0}
FOUND |= {"against_bounds": "", "reasons": [], "next_steps": {}}
AXIS = {"theta_per_count": 3.8e-4, "period": 1e-3, "inertia": 2e-3, "delay": 2e-3}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder for all examples of a property."""
    return tmp_path_factory.mktemp("rig")


def rig(folder: Path, **changed: Any) -> Path:
    (path := folder / "rig.json").write_text(json.dumps({**FOUND, **changed}))
    return path


def exact(compensator: dahl.Compensator, name: str) -> Fraction:
    return Fraction(getattr(compensator, name))


LENGTHS = st.floats(1e-5, 0.1)
SHARES = st.just(0.0) | st.floats(1e-6, 0.99)


@given(st.floats(1e-3, 1e3), LENGTHS, st.floats(1, 5), SHARES, st.booleans(), st.integers(0, 9))
def test_each_condition_of_the_guarantee_holds(
    folder: Path, low: float, long: float, stiffer: float, share: float, elastic: bool, noise: int
) -> None:
    high, load = stiffer * low / long, share * low
    inertia = high * 2.5e-3**2 / 2.9
    path = rig(folder, Fc_low=low, length_long=long, sigma0_high=high)
    law = dahl.Compensator.from_identified(
        path, **{**AXIS, "inertia": inertia}, load=load, elastic=elastic, noise=noise
    )
    assert exact(law, "Fc") <= Fraction(low) and exact(law, "length_long") >= Fraction(long)
    assert exact(law, "sigma0_high") >= Fraction(high)
    assert law.Fc == law.Fc_low and law.Fc > 0.999999 * low and law.gain <= 0.9
    left = exact(law, "Fc_low") - exact(law, "load")
    assert exact(law, "gain") * exact(law, "Fc") <= Fraction(19, 20) * left
    assert law.Fc / law.sigma0 >= (4 if elastic else 1) * long * (1 - 1e-6)
    assert law.play == (2 * noise + 2 if noise else 1)
    assert law.slew >= 19.9999 * low and law.slew > low * math.sqrt(high / inertia) / 25.001


def test_the_bounds_are_those_of_the_header(tmp_path: Path) -> None:
    """Also at a motor with a gear: 50 rad for one of the log."""
    for ratio, low, long, high in ((1, 0.45, 5.5e-3, 90.0), (50, 0.009, 0.275, 0.036)):
        text = plan_header.bounds("rig", low, long, high, "N m", "rad")
        macros = [float(one) for one in re.findall(r"(\S+)f /\*", text)]
        law = dahl.Compensator.from_identified(rig(tmp_path), ratio=ratio, **AXIS)
        assert [law.Fc_low, law.length_long, law.sigma0_high] == pytest.approx(macros, rel=2e-7)
        law = dahl.Compensator.from_identified(rig(tmp_path), ratio=ratio, reference=True, **AXIS)
        assert (law.reference, law.gain) == (True, 1) and law.sigma0 == pytest.approx(low / long)


def test_a_linear_log_needs_the_ratio_of_its_screw(tmp_path: Path) -> None:
    """100 N over 20 um, on a screw with a lead of 10 mm."""
    path = rig(tmp_path, linear=True, Fc_low=100.0, length_long=2e-5, sigma0_high=5.5e6)
    with pytest.raises(dahl.InputError, match=r"give ratio = 2\*pi/lead"):
        dahl.Compensator.from_identified(path, **AXIS)
    law = dahl.Compensator.from_identified(path, ratio=2 * math.pi / 0.01, **AXIS)
    assert law.Fc_low == pytest.approx(0.159155)  # 100 N * 10 mm / (2 pi)
    assert law.length_long == pytest.approx(4e-3 * math.pi)  # 20 um / 10 mm * 2 pi
    linear = {**AXIS, "inertia": 50.0}  # kg
    assert dahl.Compensator.from_identified(path, ratio=1, **linear).Fc_low == 100


MISSING = {"Fc_low": None, "length_long": None, "sigma0_high": None}
REFUSALS: list[tuple[dict[str, Any], dict[str, Any], str]] = [
    ({**MISSING, "against_bounds": "a play is between"}, {}, "no Fc_low: a play .*next: record"),
    ({"length_long": None, "reasons": ["too short"], "next_steps": {"Fc": "go on"}}, {},
     "no length_long: too short; next: go on"),
    ({"sigma0_high": None}, {}, "no sigma0_high: the log does not show it; next: record a motion"),
    ({"compensator_without_load_table": None}, {}, "by dahl commission; its 'compensator'"),
    ({"Fc_low": "0.4 N"}, {}, "not written by this version of dahl identify"),
    ({"Fc_low": -1}, {}, "not written by this version of dahl identify"),
    ({"Fc_low": 10**400}, {}, "not written by this version of dahl identify"),
    ({"length_long": 1e300}, {}, "not written by this version of dahl identify"),
    ({}, {"ratio": 0}, "ratio = 0 is not above 0"),
    ({}, {"ratio": math.nan}, "ratio = nan"),
    ({}, {"load": 0.45}, "load = 0.45 is not below Fc_low"),
    ({}, {"load": 0.2, "gain": 0.9}, r"gain\*Fc = 0.40[45]"),
    ({}, {"slew": 5}, "slew = 5 is below 9: 20 Fc/s"),
    ({}, {"slew": 10, "inertia": 2e-4, "delay": 5e-4}, "slew = 10 is below 12.07"),
    ({}, {"noise": 1, "play": 3}, r"play = 3 is below 2\*noise \+ 2 = 4"),
    ({}, {"fade_speed": 0.5}, "fade_speed = 0.5 is below 0.556"),
    ({}, {"inertia": 1e-5}, "inertia = 1e-05 is below"),
    ({}, {"inertia": 0.0}, "inertia = 0 is outside"),
]  # fmt: skip


@pytest.mark.parametrize(("changed", "given", "words"), REFUSALS)
def test_a_refusal_names_the_reason(
    changed: dict[str, Any], given: dict[str, Any], words: str, tmp_path: Path
) -> None:
    with pytest.raises(dahl.InputError, match=words):
        dahl.Compensator.from_identified(rig(tmp_path, **changed), **{**AXIS, **given})


def test_a_file_of_another_kind_is_refused(tmp_path: Path) -> None:
    with pytest.raises(dahl.InputError, match="dahl identify writes it"):
        dahl.Compensator.from_identified(tmp_path / "none.json", **AXIS)
    for text in ("", "[1, 2]", "{}", "\xff", '{"linear": 0, "Fc_low": [1]}', "[" * 10**5):
        (path := tmp_path / "rig.json").write_text(text, encoding="latin-1")
        with pytest.raises(dahl.InputError, match=r"rig\.json"):
            dahl.Compensator.from_identified(path, **AXIS)
    with pytest.raises(TypeError, match="Fc follows from the file"):
        dahl.Compensator.from_identified(rig(tmp_path), Fc=1, **AXIS)


def test_the_gain_changes_without_a_step_of_the_torque(tmp_path: Path) -> None:
    law = dahl.Compensator.from_identified(rig(tmp_path), **AXIS)
    element = dahl.Friction(dahl.Plan(law.sigma0, law.Fc, law.theta_per_count))
    torques = []
    for tick in range(3000):
        if tick % 300 == 299:
            law.change(gain=0.2 if law.gain > 0.5 else 0.9)
        torques.append(law.torque(element.step_counts_q30(law.move(2))))
    steps = [abs(b - a) for a, b in zip(torques, torques[1:], strict=False)]
    assert max(steps) <= law.slew * law.period * (1 + 1e-6) and min(torques[900:]) > 0.08
    assert max(torques[1000:]) == pytest.approx(0.9 * law.Fc, rel=1e-3)


@given(st.floats(1e-5, 1), st.floats(1e-3, 100), st.booleans())
def test_an_observer_takes_the_highest_corner_of_its_rule(
    folder: Path, inertia: float, known: float, has_gain: bool
) -> None:
    law = dahl.Compensator.from_identified(rig(folder), reference=True, **AXIS)
    loop = {"speed_gain": known} if has_gain else {"resonance": known}
    observer = dahl.Residual.for_compensator(law, inertia=inertia, **loop)
    most = known / (4 * math.pi * inertia) if has_gain else known / 10
    unsaturated = 64 * law.Fc * law.period / (4 * math.pi * inertia * law.theta_per_count)
    assert observer.corner == pytest.approx(min(15, most, unsaturated), rel=1e-4)
    taken = observer.limit, observer.slew, observer.period
    assert taken == (pytest.approx(law.Fc / 2), law.slew, law.period)
    assert observer.torque(law, law.move(0)) == 0


NOISY = [(True, 2, 10), (True, 1, 15), (False, 2, 15)]


@pytest.mark.parametrize(("no_integral", "noise", "corner"), NOISY)
def test_a_noisy_encoder_lowers_the_corner_of_a_loop_without_an_integral(
    no_integral: bool, noise: int, corner: float
) -> None:
    """5 counts of 14 bits are above a quarter of 5 mrad; 3 counts are not."""
    law = dahl.Compensator(
        100.0, 0.5, 2 * math.pi / 2**14, reference=True, limit=1.0, slew=50.0, period=1e-3,
        noise=noise, play=6, jump=1000)  # fmt: skip
    observer = dahl.Residual.for_compensator(
        law, inertia=0.002, speed_gain=0.4, no_integral=no_integral
    )
    assert observer.corner == pytest.approx(corner, rel=1e-4)


def test_an_observer_without_a_loop_is_refused(tmp_path: Path) -> None:
    law = dahl.Compensator.from_identified(rig(tmp_path), reference=True, **AXIS)
    for loop, words in (({}, "one of them must be known"), ({"speed_gain": -1.0}, "speed_gain")):
        with pytest.raises(dahl.InputError, match=words):
            dahl.Residual.for_compensator(law, inertia=1e-3, **loop)
    free = dahl.Compensator.from_identified(rig(tmp_path), **AXIS)
    with pytest.raises(dahl.InputError, match="its own output"):
        dahl.Residual.for_compensator(free, inertia=1e-3, speed_gain=1.0)
