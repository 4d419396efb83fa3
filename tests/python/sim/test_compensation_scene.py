# SPDX-License-Identifier: MIT
"""`dahl demo --scene compensation`: the numbers of each law, its files, and its refusals."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from dahl.binding.library import c
from dahl.sim import compensation
from dahl.sim.compensation import Comparison
from identify_tools import complaint


@pytest.fixture(scope="module")
def compared(library) -> Comparison:
    ended: list[None] = []
    found = compensation.compare(progress=lambda: ended.append(None))
    assert len(ended) == compensation.count_runs()
    return found


def test_the_page_has_the_numbers_of_the_scene(compared: Comparison, root: Path) -> None:
    text = (root / "docs/compensation.md").read_text()
    rows = re.findall(
        r"^\|[^|]*\| ([^|]+) \| ([\d.]+) \| ([\d.]+) \| ([\d.]+) \| ([\d.]+) \|$", text, re.M
    )
    shown = {
        (case, k >= len(compensation.POSITION_CASES)): row for k, (case, *row) in enumerate(rows)
    }
    for axis, cases in compared.numbers.items():
        for case, laws in cases.items():
            ratios = [value["ratio"] for law, value in laws.items() if law != "none"]
            row = [float(value) for value in shown.pop((case, axis == "hand"))]
            assert row == pytest.approx(ratios, abs=2e-3), case
    assert not shown


@pytest.mark.parametrize("kind", compensation.GAINS)
def test_the_controller_has_the_torque_of_its_textbook(kind: str) -> None:
    """PD, PID, or a PI controller of the speed that a P controller of the angle asks for."""
    error, speed = np.random.default_rng(1).normal(size=(2, 50))
    asked = 50.0 * error + speed
    due = {
        "PD": 30 * error + 0.4 * speed,
        "PID": 30 * error + 0.4 * speed + 300 * np.cumsum(error) * 1e-3,
        "cascade": 0.4 * asked + 8 * np.cumsum(asked) * 1e-3,
    }
    controller = c.new("controller_t *", compensation.GAINS[kind])
    steps = zip(error, speed * 1e-3, strict=True)
    found = [c.dahl_controller_torque(controller, *step) for step in steps]
    assert found == pytest.approx(due[kind], rel=1e-12)


def test_a_hold_does_not_change_the_sign_of_the_torque(compared: Comparison) -> None:
    for case, laws in compared.numbers["position"].items():
        assert laws["dahl"]["sign_changes_per_s"] == 0, case
    assert compared.numbers["position"]["17 bits"]["dead band"]["sign_changes_per_s"] > 10


def test_the_motor_torque_stays_within_limit_and_slew(compared: Comparison) -> None:
    added = compared.hand["dahl"].added
    assert max(map(abs, added)) <= compensation.LIMIT
    steps = [abs(b - a) for a, b in zip(added, added[1:], strict=False)]
    assert 0 < max(steps) <= compensation.SLEW * compensation.PERIOD_S * (1 + 1e-6)


def test_the_seed_alone_decides(compared: Comparison) -> None:
    case = compensation.SHOWN_HAND

    def error(seed: int) -> list[float]:
        return compensation.lead(case, compensation.laws(case, False)["dahl"], seed).error

    assert error(1) == error(1) == compared.hand["dahl"].error
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
