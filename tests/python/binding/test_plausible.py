# SPDX-License-Identifier: MIT
"""Remarks on units: none on real machines, one on each mistake that can be found."""

import math
from fractions import Fraction
from typing import NamedTuple

import dahl
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

TURN = math.tau


class Machine(NamedTuple):
    """Friction and encoder, in N m and rad, or in N and m; counts per turn of a rotary encoder."""

    name: str
    sigma0: float
    Fc: float
    counts: int | None
    theta: float | None = None  # if it is not one turn over the counts

    @property
    def theta_per_count(self) -> float:
        return TURN / self.counts if self.theta is None else self.theta


ROTARY = (
    Machine("steering column", 120.0, 1.8, 2**18),
    Machine("steering motor behind a belt gear, tyres at rest", 0.02, 0.3, 4096),
    Machine("ball bearing of a spindle", 5.0, 0.01, 2**14),
    Machine("seal of a pump", 40.0, 2.5, 2**13),
    Machine("gimbal motor, magnetic encoder", 4.0, 0.008, 4096),
    Machine("gimbal motor, 24 bits", 120.0, 1.8, 2**24),
    Machine("harmonic drive, encoder at the joint", 2000.0, 8.0, 2**19),
    Machine("harmonic drive, encoder at the motor", 0.2, 0.08, 16384),
    Machine("cycloidal drive", 750.0, 4.4, 2**16),
    Machine("worm gear, Hall sensors at the motor", 0.01, 0.05, 42),
    Machine("toy servo, potentiometer", 1.5, 0.03, 1228),
    Machine("servo of a robot kit", 2.5, 0.05, 4096),
    Machine("hub motor, Hall sensors", 20.0, 0.3, 90),
    Machine("motor with one pole pair, Hall sensors", 0.02, 0.005, 6),
    Machine("quadrature encoder of one line", 0.01, 0.01, 4),
    Machine("stepper motor, microsteps", 2.0, 0.02, 3200),
    Machine("incremental encoder of 2500 lines", 60.0, 0.4, 10000),
    Machine("incremental encoder of 10000 lines", 60.0, 0.4, 40000),
    Machine("telescope mount, 26 bits", 3e4, 3.0, 2**26),
)
GEARED = (  # theta_per_count at the joint, encoder at the motor
    Machine("harmonic drive 101:1", 2000.0, 8.0, None, TURN / (8192 * 101)),
    Machine("planetary gear 50.9:1", 300.0, 0.9, None, TURN / (2048 * 50.9)),
)
LINEAR = (
    Machine("ball screw of 5 mm, 10000 counts", 2e6, 20.0, None, 5e-3 / 10000),
    Machine("ball screw of 5 mm, 4096 counts", 2e6, 20.0, None, 5e-3 / 4096),
    Machine("piezo stage, 1 nm", 5e6, 5.0, None, 1e-9),
    Machine("linear motor, scale of 1 um", 3e5, 15.0, None, 1e-6),
    Machine("linear motor, scale of 1 um / 4096", 3e5, 15.0, None, 1e-6 / 4096),
    Machine("belt of 40 mm, 1024 counts", 4e4, 8.0, None, 0.04 / 1024),
    Machine("belt of 40 mm, Hall sensors", 2e4, 10.0, None, 0.04 / 42),
    Machine("tribometer, 0.1 um", 36449.1, 2.69, None, 1e-7),
    Machine("pneumatic cylinder, potentiometer of 0.1 mm", 2e5, 40.0, None, 1e-4),
    Machine("wheel of 0.2 m, 12 bits", 3e4, 6.0, None, 0.2 / 4096),
)


def remark(sigma0: float, Fc: float, theta: float) -> str:  # noqa: N803
    """Return the first word of a remark that tells it from the others."""
    text = dahl.implausible(sigma0, Fc, theta)
    words = ("quarter turn", "counts per turn in degrees", "a count of", "presliding length")
    return next((word for word in words if word in text), text)


@pytest.mark.parametrize("machine", [*ROTARY, *GEARED, *LINEAR], ids=lambda one: one.name)
def test_a_real_machine_has_no_remark(machine: Machine) -> None:
    """With the encoder, and by angle."""
    for theta in (machine.theta_per_count, 0.0):
        assert dahl.implausible(machine.sigma0, machine.Fc, theta) == ""


@pytest.mark.parametrize("machine", ROTARY, ids=lambda one: one.name)
def test_a_wrong_unit_of_a_rotary_encoder_has_a_remark(machine: Machine) -> None:
    sigma0, Fc, counts = machine.sigma0, machine.Fc, machine.counts  # noqa: N806
    assert remark(sigma0, Fc, counts) == "quarter turn"
    wanted = "counts per turn in degrees" if counts > 360 / 1.6 else "quarter turn"
    assert remark(sigma0, Fc, 360 / counts) == wanted


def test_each_number_of_counts_is_plausible_in_rad() -> None:
    for counts in [*range(4, 50_000), *(2**k for k in range(16, 27))]:
        assert dahl.implausible(1.0, 0.1, TURN / counts) == "", counts


def test_exchanged_parameters_and_stiffness_per_degree_have_a_remark() -> None:
    """The second if the presliding length is 128 rad or more; a gear has shorter ones."""
    assert remark(0.5, 100.0, 0.0) == "presliding length"
    assert remark(0.1 / 57.3, 0.3, 0.0) == "presliding length"
    assert remark(0.4 / 57.3, 0.8, 0.0) == ""


@st.composite
def floats(draw: st.DrawFn) -> float:
    """A float of any size in range, or near a limit of the remarks."""
    near = [1.6, 2**-7, 16.0, 128.0, 1.0, 360.0, math.tau]
    mantissa = draw(st.sampled_from(near) | st.floats(1.0, 2.0))
    return float(np.float32(mantissa * 2.0 ** draw(st.integers(-30, 30))))


@given(floats(), floats(), floats() | st.just(0.0))
def test_the_remarks_are_those_of_exact_fractions(sigma0: float, Fc: float, theta: float) -> None:  # noqa: N803
    length = Fraction(Fc) / Fraction(sigma0)
    exact = Fraction(theta)
    if theta and exact > Fraction(float(np.float32(1.6))):
        wanted = "quarter turn"
    elif theta and is_encoder_in_degrees(theta):
        wanted = "counts per turn in degrees"
    elif theta and exact >= 16 * length:
        wanted = "a count of"
    else:
        wanted = "presliding length" if length >= 128 else ""
    assert remark(sigma0, Fc, theta) == wanted


def is_encoder_in_degrees(theta: float) -> bool:
    """Return whether 360/theta has at most 11 bits, or 1 bit for fine counts, within the rounding
    of theta to a float: 2^8 units of 32 bits, and one truncated unit.
    """
    counts, bits = 360 / Fraction(theta), 11 if theta >= 2**-7 else 1
    unit = Fraction(2) ** (math.floor(math.log2(counts)) - 31)
    short = unit * 2 ** (32 - bits)
    return -(2**8) <= (counts - round(counts / short) * short) / unit < 2**8 + 1


BASE = {"sigma0": 100.0, "Fc": 0.5, "theta_per_count": TURN / 16384, "limit": 1.0, "slew": 50.0}
BASE |= {"reference": True, "rise": 0.5, "fall": 0.02, "fade_speed": 5.0, "jump": 200}


@pytest.mark.parametrize(
    ("changes", "word"),
    [
        *(({"period": period, "jump": 2e5 * period}, "") for period in (1e-5, 5e-5, 1e-3, 0.02)),
        ({"period": 0.04, "rise": 0.0, "fall": 0.0, "fade_speed": 0.0}, ""),  # 25 Hz
        ({"period": 1e-3, "fade_speed": 70.0}, ""),  # 183 counts a tick
        ({"period": 1e-3, "fade_speed": 0.0}, ""),
        *(({"period": 1e-3 * unit}, "period = ") for unit in (1e3, 1e6)),  # ms, us
        ({"period": 5e-5 * 1e3}, "period = "),
        ({"period": 1000.0}, "period = "),  # Hz
        ({"period": 1e-3, "fade_speed": 5 * 57.3}, "fade_speed = "),
        ({"period": 1e-3, "fade_speed": 20 * 9.55}, "fade_speed = "),
    ],
)
def test_the_units_of_a_compensator(changes: dict[str, float], word: str) -> None:
    given = BASE | changes
    text = dahl.Compensator(**(given | {"jump": int(given["jump"])})).implausible
    assert text.startswith(word) and bool(text) == bool(word)
