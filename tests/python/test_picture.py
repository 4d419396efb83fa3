# SPDX-License-Identifier: MIT
"""The picture shows what it says: which curve is measured, in which units, over which time."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pytest
from dahl import plots, report
from dahl.scene import Measured, Recorded, Scene


@pytest.fixture
def drawn(monkeypatch, tmp_path):
    """The figure of a short run with a measurement, and what went into it."""
    figures = []
    monkeypatch.setattr(plots, "save", lambda figure, path: figures.append(figure))
    measured = Measured("T", offset=0.25, angle_scale=1000.0, label_angle="way [mm]")
    scene = Scene(Path("x.ini"), "x", 50.0, 0.5, 1e-4, measured=measured)
    count, rows = np.arange(100, 400), np.arange(300) * 2
    trace = report.Trace(
        rows,
        rows / 1000,
        count,
        count * 2**20,
        fresh=np.zeros(300, bool),
        relaxed=np.zeros(300, bool),
        states={},
        recorded=300,
        missing=0,
    )
    recorded = Recorded(np.sin(np.arange(600)), np.arange(600) * 0.005, 600)
    plots.draw(tmp_path / "x.png", scene, trace, recorded)
    return figures[0], scene, trace, recorded


def test_each_panel_has_both_curves(drawn):
    figure, scene, trace, recorded = drawn
    truth, modelled = recorded.torque[trace.row], report.modelled(scene, trace)
    for axes in figure.axes:
        curves = {line.get_color(): line.get_ydata() for line in axes.lines}
        start = len(truth) - len(curves[plots.MEASURED])
        assert start == 0 or axes is figure.axes[2]
        assert set(curves[plots.MEASURED]) <= set(truth)
        assert set(curves[plots.COMPUTED]) <= set(modelled)
    assert np.array_equal(figure.axes[0].lines[0].get_ydata(), truth)
    assert np.array_equal(figure.axes[0].lines[1].get_ydata(), modelled)
    legend = [text.get_text() for text in figure.axes[0].get_legend().get_texts()]
    assert [words.split(",")[0] for words in legend] == ["measured", "computed"]


def test_without_a_clock_in_the_log_time_starts_with_the_run(drawn, tmp_path):
    figure, scene, trace, _ = drawn
    plots.draw(tmp_path / "x.png", scene, replace(trace, time=trace.time + 1.7e9), None)
    whole = plt.figure(plt.get_fignums()[-1]).axes[1]
    assert whole.get_xlabel() == "time on the bus [s]"
    assert whole.lines[0].get_xdata() == pytest.approx(trace.time, abs=1e-6)


def test_angle_and_time_are_in_their_units(drawn):
    figure, _, trace, recorded = drawn
    loop, whole, part = figure.axes
    angle = (trace.count - trace.count[0]) * 1e-4 * 1000
    assert loop.lines[0].get_xdata() == pytest.approx(angle, rel=1e-6)
    assert loop.get_xlabel() == "way [mm]"
    assert np.array_equal(whole.lines[0].get_xdata(), recorded.time[trace.row])
    assert set(part.lines[1].get_xdata()) <= set(whole.lines[1].get_xdata())
