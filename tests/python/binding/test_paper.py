# SPDX-License-Identifier: MIT
"""The errata in docs/model.md, and the library, against Eq. 1 integrated with 30 digits.

The motion starts at an angle that is not 0. The reference is a Taylor series of the differential
equation from turn to turn; it knows no closed form.
"""

from typing import Any, NamedTuple

import dahl
import mpmath
import pytest
from conftest import ROOT
from sources import number

digits = mpmath.mp.clone()
digits.dps = 30

ULP_COUNTS = number("DAHL_ULP_COUNTS")
SIGMA0, FC = 100, 1
TURNS = (50, 150, 0, 180)  # [counts] theta0 = .01 rad, theta1 = .03, theta2 = 0, end
CALLS = {"exp": digits.exp, "log": digits.log, "abs": abs, "__builtins__": {}}

# As printed, and not in the table: both sides of each equation.
RIGHT = {
    6: ("out", "log(abs(1 - w)) - log(abs(1 - 0))", "-a*(theta - theta0)"),
    7: ("out", "w", "1 - exp(-a*(theta - theta0))"),
    11: ("back", "log(abs(1 + w)) - k1", "a*(theta - theta1)"),
    14: ("at theta1", "w", "-1 + exp(a*(theta1 - theta1))*exp(k1)"),
    22: ("again", "w", "1 - exp(-a*(theta - theta2))*exp(k2)"),
    24: ("at theta2", "w", "1 - exp(-a*(theta2 - theta2))*exp(k2)"),
}


class Row(NamedTuple):
    equations: str
    place: str
    value: str
    printed: str
    fault: str
    corrected: str
    error: str


def errata() -> list[Row]:
    """Return the rows of the table in docs/model.md."""
    table = (ROOT / "docs/model.md").read_text().split("errata -->\n")[1]
    lines = [line for line in table.splitlines() if line.startswith("|")][2:]
    return [Row(*(cell.strip(" `") for cell in line.strip("|").split("|"))) for line in lines]


@pytest.fixture(scope="module")
def plan() -> dahl.Plan:
    return dahl.Plan(SIGMA0, FC, 2e-4)


@pytest.fixture(scope="module")
def points(plan: dahl.Plan) -> dict[str, list[dict[str, Any]]]:
    """Return theta and w at each count of the three strokes, with all constants."""
    a, count = digits.mpf(SIGMA0) / FC, digits.mpf(plan.theta_per_count)
    names = {f"theta{k}": turn * count for k, turn in enumerate(TURNS[:3])}
    names |= {"a": a, "sigma0": SIGMA0, "Fc": FC, "Tc": FC, "Theta0": names["theta0"]}
    strokes, w = {}, digits.mpf(0)
    for name, begin, end in zip(("out", "back", "again"), TURNS, TURNS[1:], strict=False):
        side = 1 if end > begin else -1
        curve = digits.odefun(lambda _, now, s=side: a * (s - now), 0, w)  # over |travel|
        travels = range(abs(end - begin) + 1)
        angles = [(begin + side * travel) * count for travel in travels]
        values = [curve(travel * count) for travel in travels]
        strokes[name] = [{"theta": t, "w": v} for t, v in zip(angles, values, strict=True)]
        w = values[-1]
    strokes |= {"at theta1": strokes["back"][:1], "at theta2": strokes["again"][:1]}
    names["k1"] = digits.log(1 + strokes["at theta1"][0]["w"])
    names["k2"] = digits.log(1 - strokes["at theta2"][0]["w"])
    return {name: [names | point for point in stroke] for name, stroke in strokes.items()}


def largest_error(formula: str, value: str, points: list[dict[str, Any]]) -> Any:
    """Return the largest difference of two formulas in the notation of the page."""
    errors = [eval(f"{formula} - ({value})", CALLS, names) for names in points]
    return max(errors, key=abs)


@pytest.mark.parametrize("row", errata(), ids=lambda row: row.equations)
def test_an_equation_of_the_paper_is_wrong_as_printed_and_right_as_corrected(
    row: Row, points: dict[str, list[dict[str, Any]]]
) -> None:
    assert abs(largest_error(row.corrected, row.value, points[row.place])) < 1e-20
    error = largest_error(row.printed, row.value, points[row.place])
    if row.error.startswith("log of "):  # of a negative number
        assert row.printed.startswith("log(")
        argument = eval(row.printed.removeprefix("log"), CALLS, points[row.place][0])
        assert float(argument) == pytest.approx(float(row.error.split()[-1]), rel=0.01)
        assert argument < 0
    else:
        assert float(abs(error)) == pytest.approx(float(row.error), rel=0.02)


@pytest.mark.parametrize("equation", RIGHT)
def test_an_equation_without_a_row_is_right(
    equation: int, points: dict[str, list[dict[str, Any]]]
) -> None:
    place, left, right = RIGHT[equation]
    assert abs(largest_error(left, right, points[place])) < 1e-20


def test_the_library_follows_eq_1_from_an_angle_that_is_not_0(
    plan: dahl.Plan, points: dict[str, list[dict[str, Any]]]
) -> None:
    """It adds travels, so it needs no theta0."""
    bearing = dahl.Friction(plan)
    for name, direction in (("out", 1), ("back", -1), ("again", 1)):
        for point in points[name][1:]:
            torque = bearing.step_counts(direction)
            assert abs(torque - point["w"] * FC) <= ULP_COUNTS * plan.ulp
