# SPDX-License-Identifier: MIT
"""Pictures of the scenes compensation and park-steer: their curves, bands and bars."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from dahl.report import compensation, park_steer
from dahl.sim.compensation import PERIOD_S
from log_reading import drawing
from matplotlib.colors import to_hex

LAWS = ("none", "sign", "dead band", "tanh", "dahl")
RANDOM = np.random.default_rng(1)


def traces(*names: str) -> SimpleNamespace:
    return SimpleNamespace(**{name: RANDOM.normal(size=round(4 / PERIOD_S)) for name in names})


def test_each_law_has_its_curves_bands_and_bars(tmp_path) -> None:
    """Means and ranges of 20 ms from 1 s to 3.5 s, and the ratio of each case."""
    axes_runs = {name: {law: traces("error", "motor") for law in LAWS} for name in ("hand", "loop")}
    cases = {case: {law: {"ratio": RANDOM.uniform(0.1, 2)} for law in LAWS} for case in "abc"}
    numbers = {"position": cases, "hand": dict(reversed(cases.items()))}
    given = SimpleNamespace(position=axes_runs["loop"], hand=axes_runs["hand"], numbers=numbers)
    with drawing(rendered=False) as figures:
        compensation.draw(tmp_path / "x.png", given)
    panels, colours = iter(figures[0].axes), {}
    for runs, scale in ((given.position, 1e3), (given.hand, 1.0)):
        for kind, factor in (("error", scale), ("motor", 1.0)):
            panel = next(panels)
            assert sorted(line.get_label() for line in panel.lines) == sorted(LAWS)
            for line, band in zip(panel.lines, panel.collections, strict=True):
                trace = getattr(runs[line.get_label()], kind) * factor
                bins = trace[round(1 / PERIOD_S) : round(3.5 / PERIOD_S)].reshape(125, -1)
                assert line.get_xdata() == pytest.approx(1.01 + 0.02 * np.arange(125))
                assert line.get_ydata() == pytest.approx(bins.mean(axis=1))
                ends = band.get_paths()[0].vertices[:, 1]
                assert {*bins.min(axis=1), *bins.max(axis=1)} == {*ends}
                colours.setdefault(line.get_label(), line.get_color())
                assert line.get_color() == colours[line.get_label()]
    by_colour = {colour: law for law, colour in colours.items()}
    assert len(by_colour) == len(LAWS)
    for panel, shown in zip(panels, numbers.values(), strict=True):
        names = [label.get_text() for label in panel.get_yticklabels()]
        found = {name: {} for name in names}
        for bar in panel.patches:
            law = by_colour[to_hex(bar.get_facecolor())]
            case = names[round(bar.get_y() + bar.get_height() / 2)]
            found[case][law] = bar.get_width()
        assert [*found] == [*shown]
        for case, laws in shown.items():
            ratios = {law: value["ratio"] for law, value in laws.items() if law != "none"}
            assert found[case] == pytest.approx(ratios)
        assert [*panel.lines[0].get_xdata()] == [1, 1]


def test_the_hand_is_drawn_without_and_with_compensation(tmp_path) -> None:
    """Its torque over its angle in degrees, and with compensation all torques over time."""
    plain, assisted = (traces("hand_angle", "hand", "tyres", "assist", "time") for _ in range(2))
    with drawing(rendered=False) as figures:
        park_steer.draw(tmp_path / "x.png", plain, assisted)
    loops, torques = figures[0].axes
    for line, run in zip(loops.lines, (plain, assisted), strict=True):
        assert line.get_xdata() == pytest.approx(np.degrees(run.hand_angle))
        assert line.get_ydata() == pytest.approx(run.hand)
    assert [line.get_label().split()[0] for line in loops.lines] == ["without", "with"]
    assert [line.get_label() for line in torques.lines] == ["tyres", "assist", "hand"]
    for line in torques.lines:
        assert line.get_xdata() == pytest.approx(assisted.time)
        assert line.get_ydata() == pytest.approx(getattr(assisted, line.get_label()))
