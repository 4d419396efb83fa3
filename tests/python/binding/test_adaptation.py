# SPDX-License-Identifier: MIT
"""dahl.Adaptation: the bits of a C program, the drift that it follows, and refusals."""

from __future__ import annotations

import subprocess
from pathlib import Path
from typing import Any

import dahl
import numpy as np
import pytest
from sources import CORE, LIB

pytestmark = pytest.mark.usefixtures("library")

FRICTION = (100.0, 0.5, 3.8e-4)
GIVEN: dict[str, Any] = {"reference": True, "gain": 1.0, "limit": 1.0, "slew": 50.0, "period": 1e-3}
Rows = np.ndarray  # (n, 4): measured and reference counts, flag, motor torque in Q24

# Reads rows, prints the torque and the change of Fc in each tick.
PROGRAM = r"""
#include <inttypes.h>
#include <stdio.h>
#include "dahl_compensator.h"
int main(void)
{
    dahl_compensator_params_t params = {.friction = {100.0f, 0.5f, 3.8e-4f},
        .law = DAHL_COMPENSATOR_REFERENCE, .gain = 1.0f, .limit = 1.0f, .slew = 50.0f,
        .period = 1e-3f, .play = 1, .jump = 1000};
    dahl_plan_t element; dahl_state_t bristle = {0};
    dahl_compensator_plan_t plan; dahl_compensator_t compensator = {0};
    dahl_adaptation_plan_t adaptation_plan; dahl_adaptation_t adaptation = {0};
    int32_t d, wanted, good, motor;
    if (dahl_prepare(&element, &params.friction) || dahl_compensator_prepare(&plan, &params)
        || dahl_adaptation_prepare(&adaptation_plan, &params, 0.002f)) { return 1; }
    while (scanf("%" SCNd32 "%" SCNd32 "%" SCNd32 "%" SCNd32, &d, &wanted, &good, &motor) == 4) {
        (void)dahl_compensator_move(&plan, &compensator, d, good);
        int32_t w = dahl_step_counts_q30(&element, &bristle, wanted);
        w = dahl_adaptation_apply(&adaptation, w);
        int32_t y = dahl_compensator_torque(&plan, &compensator, w);
        dahl_adaptation_step(&adaptation_plan, &adaptation, &compensator, motor);
        printf("%" PRId32 " %" PRId32 "\n", y, adaptation.Fc_change_q16);
    }
    return 0;
}
"""


def adaptation(**changed: Any) -> dahl.Adaptation:
    return dahl.Adaptation(*FRICTION, **({"inertia": 0.002, "period": 1e-3} | changed))


def compensator(**changed: Any) -> dahl.Compensator:
    return dahl.Compensator(*FRICTION, **(GIVEN | changed))


def slides(ticks: int, noise: int, seed: int) -> Rows:
    """Slides of half a second to and fro against 0.6 N m, with noise, bad readings and any torque
    now and then."""
    random = np.random.default_rng(seed)
    direction = np.where(np.arange(ticks) % 1000 < 500, 1, -1)
    motor = np.rint(direction * 1.2 * 2**24 * random.uniform(0.9, 1.1, ticks)).astype(np.int64)
    motor[random.random(ticks) < 0.001] = -(2**31)
    flags = random.random(ticks) > 0.001
    moves = direction + np.diff(random.integers(-noise, noise + 1, ticks + 1))
    return np.column_stack([moves, direction, flags, motor])


def run(rows: Rows, one: dahl.Adaptation) -> list[tuple[int, int]]:
    """Return the torque and the change of Fc in each tick."""
    element, added = dahl.Friction(dahl.Plan(*FRICTION)), compensator()
    found = []
    for moved, wanted, is_good, motor in rows.tolist():
        added.move(moved, bool(is_good))
        w = one.apply_q30(element.step_counts_q30(wanted))
        torque = added.torque_q30(w)
        one.step_q24(added, motor)
        found.append((torque, round((one.Fc_estimate / one.Fc - 1) * 2**16)))
    return found


def test_it_has_the_bits_of_a_c_program(tmp_path: Path) -> None:
    (tmp_path / "run.c").write_text(PROGRAM)
    sources = [*CORE, *sorted((LIB / "compensator").glob("*.c"))]
    words = ["gcc", "-O1", f"-I{LIB}/include", tmp_path / "run.c", *sources, "-o", tmp_path / "run"]
    subprocess.run([str(word) for word in words], check=True)
    rows = slides(20_000, noise=2, seed=5)
    text = "\n".join(" ".join(map(str, row)) for row in rows.tolist())
    program = tmp_path / "run"
    done = subprocess.run([program], input=text, capture_output=True, text=True, check=True)
    due = [tuple(map(int, line.split())) for line in done.stdout.splitlines()]
    assert run(rows, adaptation()) == due
    assert due[-1][1] > 0.1 * 2**16 and len({change for _, change in due}) > 5


def test_it_follows_the_friction_and_ignores_a_load() -> None:
    rows = slides(60_000, noise=0, seed=1)
    rows[:, 3] += round(0.4 * 2**24)  # 0.2 N m
    one = adaptation()
    run(rows, one)
    assert one.Fc_estimate == pytest.approx(0.6, rel=0.02)
    assert one.apply_q30(2**29) == pytest.approx(1.2 * 2**29, rel=0.02)


def test_a_torque_in_newton_metres_is_that_in_q24() -> None:
    one, same, added = adaptation(), adaptation(), compensator()
    for k in range(400):
        added.move(1)
        assert one.apply_q30(2**30) == same.apply_q30(2**30) == 2**30
        motor = 1e9 if k == 300 else 0.6
        one.step(added, motor)
        same.step_q24(added, 2**31 - 1 if k == 300 else round(1.2 * 2**24))
    assert one == same != adaptation()
    assert one.terms["speed"] == pytest.approx(0.38, rel=0.02) and one.terms["friction"] == 0.5
    assert 0 < one.terms["samples_forward"] < 400 - 60 and one.terms["samples_backward"] == 0


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"inertia": 0.0}, ("inertia = 0 ", "kg m2")),
        ({"inertia": -1.0}, ("inertia = -1 ", "2^-64")),
        ({"period": 0.021}, ("period = 0.021 ", "0.02 (s)")),
        ({"period": 0.0}, ("period = 0 ", "(s)")),
    ],
)
def test_a_value_out_of_range_is_named(changed: dict[str, Any], words: tuple[str, ...]) -> None:
    with pytest.raises(dahl.Error) as caught:
        adaptation(**changed)
    assert [word for word in words if word not in str(caught.value)] == [], str(caught.value)


@pytest.mark.parametrize(
    ("other", "word"),
    [
        (lambda: compensator(reference=False, Fc_low=0.5, length_long=0.005), "reference = False"),
        (lambda: compensator(period=2e-3), "compensator.period = 0.002 is not 0.001"),
        (lambda: dahl.Compensator(100.0, 0.4, 3.8e-4, **GIVEN), "compensator.Fc = 0.4 is not 0.5"),
        (lambda: 5, "compensator = 5"),
    ],
)
def test_a_compensator_that_does_not_fit_is_refused(other: Any, word: str) -> None:
    one = adaptation()
    with pytest.raises(dahl.Error, match=word):
        one.step(other(), 0.5)
    with pytest.raises(dahl.Error, match="motor = nan"):
        one.step(compensator(), float("nan"))
    assert one == adaptation()
