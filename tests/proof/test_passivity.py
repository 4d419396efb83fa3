# SPDX-License-Identifier: MIT
"""No motion makes energy: random closed cycles (passivity.h has the proof of one step)."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import kernel_tools as tools
import pytest
from sources import number as number_of

HEADER = str(Path(__file__).parent / "passivity.h")
ROUNDING = {way: number_of(f"PASSIVITY_{way.upper()}", HEADER) for way in ("counts", "angle")}
TORQUE_BEFORE = "-DPASSIVITY_LOSS=passivity_loss_before"


@pytest.fixture(scope="module")
def cycles(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tools.build(tmp_path_factory.mktemp("cycles"), "tests/proof/passivity.c")


def run(program: Path, *arguments: object) -> tuple[int, str]:
    done = subprocess.run(
        [program, *map(str, arguments)], capture_output=True, text=True, timeout=1800, check=False
    )
    assert done.returncode in (0, 1), done.stderr
    return done.returncode, done.stdout


def number(name: str, text: str) -> float:
    found = re.search(rf"{name} (-?[\d.e+-]+)", text)
    assert found, f"no {name!r} in {text!r}"
    return float(found[1])


def assert_passive(program: Path, way: str, count: int) -> None:
    code, text = run(program, way, count)
    print(text)
    assert code == 0, text
    assert number("cycles", text) == count
    assert number("least loss of a tick", text) >= -ROUNDING[way]
    assert number("least work from rest", text) >= -17 * ROUNDING[way]


@pytest.mark.parametrize("way", ["counts", "angle"])
def test_closed_cycles(cycles: Path, way: str) -> None:
    assert_passive(cycles, way, 1_000_000)


@pytest.mark.long
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("way", ["counts", "angle"])
def test_many_closed_cycles(cycles: Path, way: str) -> None:
    assert_passive(cycles, way, 100_000_000)


def test_planted_torque_before_the_step_in_cycles(tmp_path: Path) -> None:
    program = tools.build(tmp_path, "tests/proof/passivity.c", TORQUE_BEFORE)
    code, text = run(program, "counts", 1000)
    assert code == 1, text


def test_bad_arguments_are_refused(cycles: Path) -> None:
    for command in ([cycles, "counts", "0"], [cycles, "torque", "5"]):
        done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
        assert done.returncode == 2
        assert done.stderr.startswith("error: use:")
