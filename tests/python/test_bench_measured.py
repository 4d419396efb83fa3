# SPDX-License-Identifier: MIT
"""Models against measured friction: on made-up logs the model that made them is found, and what is
not in reach leaves the page as it is.
"""

from __future__ import annotations

import re
import sys

import numpy as np
import pytest
from conftest import ROOT

sys.path.insert(0, str(ROOT / "tools" / "bench"))

import measured  # noqa: E402
import report  # noqa: E402

pytestmark = pytest.mark.usefixtures("library")

TARGET = {
    core: {case: least + k for k, (_, _, case) in enumerate(measured.MODELS.values())}
    for core, least in (("m0", 500), ("m3", 10))
}


@pytest.fixture(scope="module")
def angle():
    """Loops of many sizes, 2 rad wide."""
    t = np.linspace(0, 60, 4000)
    return np.sin(t) * (0.6 + 0.4 * np.sin(0.37 * t)) + 0.1 * np.sin(5 * t)


def made(angle, kind):
    """Torque of an element in steps of its equation, 50 between two rows; neither grid nor C."""
    F, found, last = 0.0, [], angle[0]
    for place in angle:
        for _ in range(50):
            step = (place - last) / 50
            F += 20 * step * (1 - F * np.sign(step)) if kind == "dahl" else 20 * step
            F = max(-1.0, min(1.0, F))
        last = place
        found.append(F)
    return np.array(found)


@pytest.mark.parametrize(("kind", "best"), [("dahl", "Dahl"), ("slip", "slip, 1")])
def test_the_model_that_made_it_is_found(angle, kind, best):
    torque = -3.0 * made(angle, kind) + 0.4 + 0.2 * angle  # the rig counts the reaction
    scores = measured.score(angle, torque)
    other = "slip, 1" if kind == "dahl" else "Dahl"
    assert scores[best] > 0.998
    assert scores["Coulomb"] < scores[other] < scores[best]
    assert scores["slip, 4"] >= scores["slip, 2"] >= scores["slip, 1"]
    assert abs(scores["LuGre, Euler steps"] - scores["Dahl"]) < 0.03


def test_what_no_model_explains_is_not_explained(angle):
    noise = np.random.default_rng(3).normal(size=len(angle))
    assert max(measured.score(angle, noise).values()) < 0.05


def test_the_block_has_each_log_each_model_and_its_cost():
    scores = {
        rig: {title: 0.9 + 0.01 * k for k, title in enumerate(measured.MODELS)}
        for rig in ("rig, slow", "rig, fast", "other")
    }
    head, _, cost, *logs = measured.block(scores, TARGET).splitlines()[1:-1]
    cells = [re.split(r" *\| *", row.strip("| "))[1:] for row in (head, cost, *logs)]
    assert cells[:2] == [list(measured.MODELS), [str(10 + k) for k in range(len(cells[0]))]]
    assert cells[2:] == [[f".{9000 + 100 * k}" for k in range(len(cells[0]))]] * 3


def test_the_picture_has_each_log_on_the_panel_of_its_machine():
    """What is left of the spread over the cost of the model, and a line at the least so far."""
    names = ("rig, slow", "rig, fast", "other", "third", "fourth")
    r2 = iter(np.linspace(0.95, 0.3, 7 * len(names)) + 0.04 * np.cos(np.arange(7 * len(names))))
    scores = {log: {title: next(r2) for title in measured.MODELS} for log in names}
    costs = {case: 16 - k for k, (_, _, case) in enumerate(measured.MODELS.values())}
    order = list(measured.MODELS)[::-1]
    figure = measured.picture(scores, TARGET | {"m3": costs})
    assert [axes.get_title() for axes in figure.axes] == ["rig", "other", "third", "fourth"]
    logs = [line for axes in figure.axes for line in axes.lines]
    for points, steps, log in zip(logs[::2], logs[1::2], names, strict=True):
        left = [(1 - scores[log][title]) ** 0.5 for title in order]
        assert list(points.get_xdata()) == list(steps.get_xdata()) == list(range(10, 17))
        assert points.get_ydata() == pytest.approx(left)
        assert steps.get_ydata() == pytest.approx([min(left[: n + 1]) for n in range(7)])
        assert points.get_color() == steps.get_color() and steps.get_drawstyle() == "steps-post"
    legend = figure.axes[0].get_legend()
    assert [text.get_text() for text in legend.get_texts()] == ["slow", "fast"]
    for axes in figure.axes:
        assert (axes.get_xscale(), axes.get_yscale()) == ("log", "log")
        ticks = [tick.get_text() for tick in axes.get_xticklabels()]
        assert ticks == [f"{title} ({10 + n})" for n, title in enumerate(order)]
    for axes in figure.axes[::3]:  # the left ones, for all of their row
        assert [float(tick.get_text()) for tick in axes.get_yticklabels()] == [*axes.get_yticks()]
    assert "Cortex-M3" in figure.get_supxlabel() and "error" in figure.get_supylabel()


def test_a_log_that_is_not_in_reach_is_named(monkeypatch):
    """And no table is made of the others."""
    find = measured.data.local_folder
    monkeypatch.setattr(
        measured.data, "local_folder", lambda n: None if n == "pneumatic" else find(n)
    )
    with pytest.raises(measured.BenchError, match=r"/\w+\.\w+ is not in reach"):
        measured.measure()


def test_the_sign_of_the_motion_is_found_under_a_spring():
    """Slow ramps of torque on a stiff shaft, which jumps ahead and creeps back for three rows: most
    rows go against the torque.
    """
    ramp = np.sin(np.linspace(0, 12, 900))
    angle = 0.2 * ramp - 3e-3 * np.sign(ramp) * (np.arange(900) % 4)
    torque = made(0.2 * ramp, "dahl") + ramp
    for sign in (1, -1):
        assert measured.score(angle, sign * torque)["Dahl"] > 0.9


def test_each_folder_with_measured_friction_is_compared():
    """All logs of the machines at hand but of the two that have none of it: a drive whose torque is
    not measured, and a wheel that stands still.
    """
    logs = {(source.folder, source.file) for source in measured.SOURCES}
    assert len(logs) == len(measured.SOURCES)
    here = [
        (folder.name, path.name)
        for name in measured.data.SETS
        if (folder := measured.data.local_folder(name)) is not None
        for path in folder.iterdir()
        if path.suffix in {".csv", ".tsv", ".json"}
    ]
    if not here:
        pytest.skip("no measured log is in reach (dahl data)")
    missing = {log for log in here if log not in logs}
    assert {folder for folder, _ in missing} <= {"servo_pendulum", "can_steering"}


@pytest.mark.checks
def test_the_page_shows_what_is_measured_now():
    """R2 of each model on each log; else: tools/bench.sh docs"""
    try:
        block = measured.block(measured.measure(), TARGET).splitlines()
    except measured.BenchError as error:
        pytest.skip(str(error))
    page = (ROOT / "docs/speed.md").read_text()
    there = page[page.index(measured.MARKS[0]) : page.index(measured.MARKS[1])].splitlines()
    numbers = [
        [
            (name, *map(float, rest))
            for name, *rest in (row.strip("| ").split(" | ") for row in rows)
        ]
        for rows in (block[4:-1], there[4:])
    ]
    assert (block[1], len(numbers[0])) == (there[1], len(measured.SOURCES))
    for now, before in zip(*numbers, strict=True):
        assert now[0] == before[0] and now[1:] == pytest.approx(before[1:], abs=5e-4)


def test_spikes_of_a_position_are_no_travel(tmp_path):
    time = np.arange(400.0)
    position = 20 * np.sin(time / 60)
    force = np.sign(np.cos(time / 60))
    table = np.zeros((400, 7))
    table[:, 0], table[:, 4], table[:, 6] = time, position, force
    table[50::40, 4] += 9.0
    np.savetxt(tmp_path / "log.csv", table, delimiter="\t")
    found, same = measured.without_spikes(tmp_path / "log.csv")
    assert np.abs(found - position).max() < 0.5
    assert np.array_equal(same, force)


def test_a_new_table_and_picture(monkeypatch, tmp_path):
    scores = {"rig": dict.fromkeys(measured.MODELS, 0.9)}
    monkeypatch.setattr(measured, "measure", lambda: scores)
    monkeypatch.setattr(report, "DOCS", tmp_path)
    (tmp_path / "pictures").mkdir()
    page = tmp_path / "speed.md"
    page.write_text("before\n" + "\nold\n".join(measured.MARKS) + "\nafter\n")
    report.write_measured(TARGET)
    assert page.read_text() == f"before\n{measured.block(scores, TARGET)}\nafter\n"
    assert (tmp_path / "pictures/measured.png").stat().st_size > 5000
