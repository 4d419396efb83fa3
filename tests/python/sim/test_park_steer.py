# SPDX-License-Identifier: MIT
"""`dahl demo --scene park-steer`: the loop of hand torque over angle, its work, and its files."""

import re
from pathlib import Path

import numpy as np
import pytest
from dahl import codec
from dahl.sim import park_steer as scene
from scipy.integrate import solve_ivp

GAINS = {"without": 0.0, "with": scene.GAIN}


@pytest.fixture(scope="module")
def runs(library) -> dict[str, scene.Run]:
    return {name: scene.simulate(gain) for name, gain in GAINS.items()}


def exact_run(gain: float) -> tuple[np.ndarray, float]:
    """Solve pinion and friction as an ODE. Return the torques of the hand and the work of the
    tyres in the last cycle. The compensation follows the friction without a delay."""
    plan, end = scene.tyre_plan(), scene.CYCLES / scene.HAND_HZ
    time = np.arange(scene.count_ticks() + 1) * scene.PERIOD_S

    def slope(t: float, state: np.ndarray) -> list[float]:
        angle, speed, friction, _ = state
        twist = -scene.TORSION_BAR * (scene.HAND_AMPLITUDE * np.cos(scene.RATE * t) + angle)
        torque = twist - scene.PINION_DAMPING * speed - (1 - gain) * friction
        bristle = plan.sigma0 * (speed - abs(speed) * friction / plan.Fc)
        return [speed, torque / scene.PINION_INERTIA, bristle, friction * speed]

    start = [-scene.HAND_AMPLITUDE, 0, 0, 0]
    done = solve_ivp(slope, (0, end), start, "DOP853", time, rtol=1e-9, atol=1e-9, max_step=0.02)
    angle, speed, acceleration = np.array([scene.hand_motion(t) for t in time]).T
    inertia = scene.HAND_WHEEL_INERTIA * acceleration
    hand = inertia + scene.COLUMN_DAMPING * speed + scene.TORSION_BAR * (angle - done.y[0])
    return hand, done.y[3, -1] - done.y[3, -1 - round(1 / scene.HAND_HZ / scene.PERIOD_S)]


@pytest.mark.parametrize("name", GAINS)
def test_torque_and_work_are_those_of_the_ode(name: str, runs) -> None:
    hand, tyres_work = exact_run(GAINS[name])
    assert np.abs(runs[name].hand - hand).max() < 1e-3 * scene.sticking_torque()
    numbers = runs[name].numbers()
    assert numbers["tyres_J"] == pytest.approx(tyres_work, rel=1e-4)
    assert numbers["assist_J"] == pytest.approx(GAINS[name] * tyres_work, rel=1e-4)


@pytest.mark.parametrize("name", GAINS)
def test_each_node_gets_the_nearest_count(name: str, runs) -> None:
    run, ids = runs[name], [one.arbitration_id for one in runs[name].frames]
    assert ids == [0x100, 0x101, 0x110, 0x111] * (scene.count_ticks() + 1)
    for node in (scene.TYRES, scene.ASSIST):
        sent = [one for one in run.frames if one.arbitration_id == codec.EncoderState.base + node]
        counts = np.array([codec.unpack(one, codec.EncoderState).count for one in sent])
        off = counts * scene.THETA_PER_COUNT - run.pinion_angle
        assert np.abs(off).max() < 0.501 * scene.THETA_PER_COUNT


def test_the_page_has_the_numbers_of_the_scene(runs, root: Path) -> None:
    text = (root / "docs/steering.md").read_text()
    rows = re.findall(r"^\|[^|]*\[(?:N m|J)\] \| ([\d.]+) \| ([\d.]+) \|$", text, re.M)
    due = zip(*(runs[name].numbers().values() for name in GAINS), strict=True)
    assert np.array(rows, float) == pytest.approx(np.array(list(due)), abs=0.011)


def test_the_assist_drives_a_free_wheel_on_less_grip_than_it_assumes(root: Path) -> None:
    """Until the viscous drag takes the surplus of torque. On dry tyres the wheel rests."""
    text = (root / "docs/steering.md").read_text()
    drag = scene.PINION_DAMPING + scene.COLUMN_DAMPING
    rows = re.findall(r"^\| ([\d.]+) \| [^|]* \| ([\d.]+) \|$", text, re.M)
    due = {
        float(x): max(0, scene.GAIN - float(x)) * scene.sticking_torque() / drag for x, _ in rows
    }
    assert len(rows) == 4
    assert [float(speed) for _, speed in rows] == pytest.approx(list(due.values()), abs=0.051)
    for share in (1.0, 0.15):
        run = scene.simulate(scene.GAIN, grip_share=share, released=2.5)
        moved = float(run.pinion_angle[-1] - run.pinion_angle[-1001])
        assert moved / (1000 * scene.PERIOD_S) == pytest.approx(due[share], abs=0.01)
        assert run.hand[-1] == 0


def test_the_page_changes_gain_and_tyres(root: Path, library, monkeypatch, capsys) -> None:
    monkeypatch.setattr(scene, "TYRE_GRIP", scene.TYRE_GRIP)  # restore it afterwards
    (code,) = re.findall(r"```python\n(.*?)```", (root / "docs/steering.md").read_text(), re.S)
    exec(code, {})
    (stated,) = re.findall(r"# ([\d.]+) N m$", code, re.M)
    assert float(capsys.readouterr().out) == pytest.approx(float(stated), abs=0.005)
