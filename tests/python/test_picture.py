# SPDX-License-Identifier: MIT
"""The picture shows what it says: which curve is measured, in which units, over which time."""

from __future__ import annotations

import re
from dataclasses import replace
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from dahl import plots, report
from dahl.scene import Measured, Recorded, Scene
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.transforms import Bbox


@pytest.fixture
def figures(monkeypatch):
    """All that was drawn, in its order, instead of files."""
    drawn = []
    monkeypatch.setattr(plots, "save", lambda figure, path: drawn.append(figure))
    return drawn


@pytest.fixture
def drawn(figures, tmp_path):
    """The figure of a short run with a measurement, and what went into it."""
    measured = Measured("T", offset=0.25, angle_scale=1000.0, label_angle="way [mm]")
    scene = Scene(Path("x.ini"), "a title", "dahl", ((50.0, 0.5),), 1e-4, measured=measured)
    count, rows = np.arange(100, 400), np.arange(300) * 2
    trace = report.Trace(
        rows,
        rows / 1000,
        count,
        count * 2**20,
        fresh=np.zeros(300, bool),
        relaxed=np.zeros(300, bool),
        states={},
        recorded=305,  # of which some have no answer
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


@pytest.mark.parametrize("name", ["$\\undefined$", "$x$ and $y", "a $ b"])
def test_a_name_with_dollars_is_no_formula(drawn, figures, tmp_path, name):
    _, scene, trace, recorded = drawn
    measured = replace(scene.measured, label_angle=name, label_torque=name)
    plots.draw(tmp_path / "x.png", replace(scene, title=name, measured=measured), trace, recorded)
    figures[-1].savefig(tmp_path / "x.png")
    assert figures[-1].get_suptitle().replace("\\$", "$") == name


def test_without_a_clock_in_the_log_time_starts_with_the_run(drawn, figures, tmp_path):
    figure, scene, trace, _ = drawn
    plots.draw(tmp_path / "x.png", scene, replace(trace, time=trace.time + 1.7e9), None)
    whole = figures[-1].axes[1]
    assert whole.get_xlabel() == "time on the bus [s]"
    assert whole.lines[0].get_xdata() == pytest.approx(trace.time, abs=1e-6)


def test_no_number_of_an_axis_is_cut_off(drawn, figures, tmp_path):
    """Long ones too, as of a way in m, whose last one stands over the end of its axis."""
    figure, scene, trace, _ = drawn
    plots.draw(tmp_path / "x.png", replace(scene, theta_per_count=8e-7 / 1000), trace, None)
    figure = figures[-1]
    figure.draw_without_rendering()
    low, high = figure.axes[0].get_xlim()
    ticks = figure.axes[0].get_xticklabels()
    ends = [one.get_window_extent().x1 for one in ticks if low <= one.get_position()[0] <= high]
    assert max(len(one.get_text()) for one in ticks) >= 6
    assert max(ends) <= figure.bbox.x1


def test_what_only_some_runs_have_is_shown_as_it_was(drawn, figures, tmp_path):
    """Latencies, faults, and how far the angle is behind its reference."""
    figure, scene, trace, _ = drawn
    text = "time_s,reference_rad,angle_rad\n0,0.5,0.25\n0.001,1,1.5\n0.002,2,2\n"
    (tmp_path / "trace.csv").write_text(text)
    bins = [[100.0, 3], [200.0, 7], [400.0, 1]]
    quantiles = {"p50": 150.0, "p99": 390.0, "max": 400.0}
    numbers = {"latency_histogram": bins, "latency_us": quantiles, "deadline_misses": 5}
    numbers |= {"jitter_us": {"p50": 1.0, "p99": 21.0, "max": 30.0}, "control": {}}
    numbers |= {"faults": {"injected": {"crc": 4, "lost": 9}, "expected": {}}}
    numbers |= {"bus": "socketcand", "r2_measured": 0.98765}
    plots.draw(tmp_path / "x.png", scene, trace, None, numbers)
    drawn_again = figures[-1]
    latencies, faults, tracking = drawn_again.axes[3:]
    edges = [bar.get_x() + max(bar.get_width(), 0) for bar in latencies.patches]
    assert edges == pytest.approx([100, 200, 400])
    assert [abs(bar.get_width()) * 33 for bar in latencies.patches] == pytest.approx(edges)
    assert [bar.get_height() for bar in latencies.patches] == [3, 7, 1]
    assert (latencies.get_xscale(), latencies.lines[0].get_xdata()[0]) == ("log", 1000)
    words = latencies.get_title(loc="left")
    assert re.findall(r" (\d+) ", words) == ["150", "390", "21", "5"]
    assert ([bar.get_height() for bar in faults.patches], faults.get_yscale()) == ([4, 9], "symlog")
    assert [label.get_text() for label in faults.get_xticklabels()] == ["crc", "lost"]
    assert (tracking.get_xlabel(), tracking.get_ylabel()) == ("time [s]", "tracking error [rad]")
    assert tracking.lines[0].get_xdata() == pytest.approx([0, 0.001, 0.002])
    assert tracking.lines[0].get_ydata() == pytest.approx([0.25, -0.5, 0])
    words = drawn_again.axes[0].get_title(loc="left")
    assert re.findall(r"[\d.]+", words.partition("=")[2]) == ["50", "0.5", "300", "0.9877"]
    assert "50 N m/rad" in words and "0.5 N m," in words and "socketcand" in words
    linear = replace(scene, measured=Measured(label_torque="force [N]"))
    (tmp_path / "trace.csv").unlink()  # and time stood still: no panel of either
    without = {"control": {}, **numbers, "latency_us": quantiles | {"max": 0}}
    del without["faults"]
    plots.draw(tmp_path / "x.png", linear, trace, None, without)
    assert len(figures[-1].axes) == 3
    words = figures[-1].axes[0].get_title(loc="left")
    assert "50 N/m" in words and "0.5 N," in words
    assert drawn_again.get_suptitle() == scene.title


def test_no_panel_and_no_word_lies_on_another(figures, drawn, tmp_path):
    """Each panel with its title, legend and labels, and the title of all; few panels and many."""
    _, scene, trace, _ = drawn
    numbers = {"faults": {"injected": {"crc": 4}, "expected": {}}, "bus": "socketcand"}
    plots.draw(tmp_path / "x.png", scene, trace, None, numbers)
    for figure in figures:
        renderer = FigureCanvasAgg(figure).get_renderer()
        figure.draw(renderer)
        title = figure.texts[0].get_window_extent(renderer)
        whole = [title, *(axes.get_tightbbox(renderer) for axes in figure.axes)]
        assert all(Bbox.intersection(box, figure.bbox).bounds == box.bounds for box in whole)
        loop = figure.axes[0]
        parts = (loop, loop.get_legend(), loop._left_title, loop.xaxis.label, loop.yaxis.label)
        boxes = [part.get_window_extent(renderer) for part in parts]
        assert not any(a.overlaps(b) for some in (whole, boxes) for a, b in combinations(some, 2))


def test_faults_and_restarts_are_marked_where_they_were(drawn, figures, tmp_path):
    """Ticks without an answer, new starts and restarts, in the panels over time; none else."""
    _, scene, trace, _ = drawn
    rows = np.arange(300)
    plots.draw(tmp_path / "x.png", scene, replace(trace, row=rows), None)
    assert not any(axes.collections for axes in figures[-1].axes)
    at = [0, 100, 200]  # a run's first tick is a new start that says nothing
    some = replace(
        trace,
        row=np.where(rows < 50, rows, rows + 1),
        time=rows / 1000,
        fresh=np.isin(rows, at),
        relaxed=rows == 200,
    )
    plots.draw(tmp_path / "x.png", scene, some, None)
    _, whole, _ = figures[-1].axes
    places = [[stroke[0][0] for stroke in each.get_segments()] for each in whole.collections]
    assert places == [[pytest.approx(0.05)], [pytest.approx(0.1)], [pytest.approx(0.2)]]
    assert [each.get_segments()[0][1][1] for each in whole.collections] == [0.08, 1, 1]
    words = [text.get_text() for text in whole.get_legend().get_texts()]
    assert [each.split()[0] for each in words] == ["no", "new", "restart,"]


@pytest.mark.parametrize(("ticks", "enlarged"), [(100, 100), (300, 200), (5000, 400)])
def test_the_last_panel_shows_where_the_torque_moves_most(
    drawn, figures, tmp_path, ticks, enlarged
):
    """A twelfth of the run or so, and at least 200 ticks where there are so many."""
    _, scene, trace, _ = drawn
    rows, still = np.arange(ticks), (ticks - enlarged) * 4 // 5
    busy = np.where(rows < still, 0, np.where(rows % 2, 2**28, -(2**28)))
    none = np.zeros(ticks, bool)
    run = replace(trace, row=rows, time=rows, count=rows, ratio=busy, fresh=none, relaxed=none)
    plots.draw(tmp_path / "x.png", scene, run, None)
    _, whole, part = figures[-1].axes
    shown = part.lines[0].get_ydata()
    assert (len(whole.lines[0].get_ydata()), len(shown)) == (ticks, enlarged)
    assert np.all(np.diff(shown)[1:] != 0)


def test_angle_and_time_are_in_their_units(drawn):
    figure, _, trace, recorded = drawn
    loop, whole, part = figure.axes
    angle = (trace.count - trace.count[0]) * 1e-4 * 1000
    assert loop.lines[0].get_xdata() == pytest.approx(angle, rel=1e-6)
    assert loop.get_xlabel() == "way [mm]"
    assert np.array_equal(whole.lines[0].get_xdata(), recorded.time[trace.row])
    assert set(part.lines[1].get_xdata()) <= set(whole.lines[1].get_xdata())
    assert whole.get_xlabel() == part.get_xlabel() == "time in the log [s]"
    assert loop.get_ylabel() == "friction torque [N m]"
    assert whole.get_ylabel() == part.get_ylabel() == "torque [N m]"


@pytest.mark.parametrize(
    ("counted", "title"),
    [
        ({"crc": 4, "$lost^": 9}, "every one counted by the node"),
        ({"crc": 4, "$lost^": 8}, "counted, due: {'$lost^': (8, 9)}"),
        ({"crc": 4}, "counted, due: {'$lost^': (0, 9)}"),
    ],
)
def test_the_picture_says_whether_each_fault_was_counted(figures, drawn, tmp_path, counted, title):
    """By any name: whoever writes a summary, dollars in it are no formula."""
    _, scene, trace, _ = drawn
    faults = {"injected": {"$a^$": 1234567}, "expected": {"crc": 4, "$lost^": 9}}
    plots.draw(tmp_path / "x.png", scene, trace, None, {"faults": faults, "node": counted})
    figures[-1].savefig(tmp_path / "x.png")
    axes = figures[-1].axes[-1]
    assert axes.get_title(loc="left").replace("\\$", "$") == title
    assert [text.get_text() for text in axes.get_xticklabels()] == ["\\$a^\\$"]
    assert [text.get_text() for text in axes.texts] == ["1234567"]


def test_a_picture_replaces_the_old_one_when_it_is_whole(monkeypatch, tmp_path):
    """One that fails leaves the old one alone."""
    path = tmp_path / "loop.png"
    path.write_text("old")
    figure = Figure()
    monkeypatch.setattr(figure, "savefig", lambda part, **_: part.write_text("half") and 1 / 0)
    with pytest.raises(ZeroDivisionError):
        plots.save(figure, path)
    assert path.read_text() == "old"
    monkeypatch.undo()
    plots.save(figure, path)
    assert path.read_bytes().startswith(b"\x89PNG")
    assert [each.name for each in tmp_path.iterdir()] == ["loop.png"]
