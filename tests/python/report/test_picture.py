# SPDX-License-Identifier: MIT
"""The picture of `dahl plot`: curves, units, time axes, and panels that only some runs have."""

import copy
import json
import re
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from bus_runs import FC, SIGMA0, THETA, Run
from dahl.codec import Reset, What
from log_reading import drawing
from log_reading import run as command
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.transforms import Bbox

TICKS = 300
ROWS = np.arange(2 * TICKS)
CLOCK, TORQUE = 0.005 * ROWS, np.sin(ROWS)  # columns of the log of the run
MEASURED = "torque = torque\noffset = 0.25\nspring = 7\nangle_scale = 1000\nlabel_angle = way [mm]"


def made(counts: np.ndarray, rows: np.ndarray | None = None) -> Run:
    run = Run()
    for row, count in zip(range(len(counts)) if rows is None else rows, counts, strict=True):
        run.tick(int(row), int(count), state=0 if run.frames else 6, used=bool(run.frames))
    return run


@pytest.fixture(scope="module")
def steady(library) -> Run:
    return made(np.arange(100, 100 + TICKS))


@pytest.fixture
def picture(tmp_path):
    def draw(
        run: Run,
        measured: str = "",
        theta: float = THETA,
        friction: str = "",
        title: str = "a title",
        rendered: bool = False,
        **numbers: object,
    ) -> Figure:
        rows = zip(CLOCK.tolist(), TORQUE.tolist(), strict=True)
        (tmp_path / "rows.csv").write_text(
            "t,a,torque\n" + "".join(f"{t},0,{y}\n" for t, y in rows)
        )
        motion = (
            "[motion]\nkind = log\nfile = rows.csv\nangle = a\ntime = t\ncounts_per_unit = 1\n"
            if measured
            else ""
        )
        (tmp_path / "x.ini").write_text(
            f"[scene]\ntitle = {title}\n[friction]\nsigma0 = {SIGMA0}\nFc = {FC}\n"
            f"theta_per_count = {theta!r}\n{friction}\n{motion}[measured]\n{measured}\n"
        )
        run.write(tmp_path / "run.log")
        known = {"scene_file": str(tmp_path / "x.ini"), **numbers}
        (tmp_path / "summary.json").write_text(json.dumps(known))
        with drawing(rendered) as figures:
            done = command("plot", tmp_path)
        assert done.returncode == 0, done.stderr
        return figures[0]

    return draw


def axis(axes) -> tuple[str, str]:
    return axes.get_xlabel(), axes.get_ylabel()


def test_each_panel_has_both_curves_in_their_units(library, picture):
    """The model with offset and spring, over the way in mm and over the clock of the log."""
    rows = np.arange(TICKS) * 2 - (np.arange(TICKS) > 0)  # every other one is missing
    run = made(np.arange(100, 100 + TICKS), rows)
    loop, whole, part = picture(run, MEASURED).axes
    a, angle = SIGMA0 / FC, np.arange(TICKS) * THETA
    computed = FC * -np.expm1(-a * angle) + 7 * angle + 0.25
    for axes in (loop, whole):
        assert axes.lines[0].get_ydata() == pytest.approx(TORQUE[rows])
        assert axes.lines[1].get_ydata() == pytest.approx(computed, rel=1e-6)
    for line, total in zip(part.lines, (TORQUE[rows], computed), strict=True):
        assert np.interp(line.get_xdata(), CLOCK[rows], total) == pytest.approx(
            line.get_ydata(), rel=1e-6
        )
    for line in loop.lines:
        assert line.get_xdata() == pytest.approx(1000 * angle, rel=1e-6)
    for line in whole.lines:
        assert line.get_xdata() == pytest.approx(CLOCK[rows])
    assert axis(loop) == ("way [mm]", "friction torque [N m]")
    assert axis(whole) == ("time in the log [s]", "torque [N m]")
    assert axis(part) == ("time in the log [s], a part enlarged", "torque [N m]")
    left, spread = TORQUE[rows] - computed, TORQUE[rows] - TORQUE[rows].mean()
    legend = [text.get_text() for text in loop.get_legend().get_texts()]
    r2 = 1 - np.sum(left**2) / np.sum(spread**2)
    assert float(re.search(r"R² (\S+)", legend[1])[1]) == pytest.approx(r2, abs=6e-5)
    names = [words.split(",")[0] for words in legend]
    assert names == ["measured", "dahl", "slip elements", "Fc sign(v)"]
    assert "offset 0.25 N m" in loop.get_title(loc="left")
    first, second = ([axes.lines[k].get_color() for axes in (loop, whole, part)] for k in (0, 1))
    assert len({*first}) == len({*second}) == 1 and first != second


def test_without_a_clock_in_the_log_time_starts_with_the_run(steady, picture):
    late = copy.deepcopy(steady)
    for frame in late.frames:
        frame.timestamp += 1.7e9
    _, whole, _ = picture(late).axes
    assert whole.get_xlabel() == "time on the bus [s]" and len(whole.lines) == 1
    assert whole.lines[0].get_xdata() == pytest.approx(np.arange(TICKS) / 1000, abs=2e-6)


TIMES = {
    "latency_histogram": [[100.0, 3], [200.0, 7], [400.0, 1]],
    "latency_us": {"p50": 150.0, "p99": 390.0, "max": 400.0},
    "jitter_us": {"p50": 1.0, "p99": 21.0, "max": 30.0},
    "deadline_misses": 5,
    "frames_answered": 11,
    "late_answers": 3,
    "late_ticks": 2,
    "ticks": 300,
}
FAULTS = {"faults": {"injected": {"crc": 4, "bus_off": 9}, "expected": {}}}


def test_latencies_faults_and_tracking_error_have_panels(steady, picture, tmp_path):
    table = "time_s,reference_rad,angle_rad\n0,0.5,0.25\n0.001,1,1.5\n0.002,2,2\n"
    (tmp_path / "trace.csv").write_text(table)
    figure = picture(steady, control={}, bus="socketcand", **TIMES, **FAULTS)
    latencies, faults, tracking = figure.axes[3:]
    edges = [bar.get_x() + max(bar.get_width(), 0) for bar in latencies.patches]
    assert edges == pytest.approx([100, 200, 400])
    assert [abs(bar.get_width()) * 33 for bar in latencies.patches] == pytest.approx(edges)
    assert [bar.get_height() for bar in latencies.patches] == [3, 7, 1]
    assert (latencies.get_xscale(), latencies.lines[0].get_xdata()[0]) == ("log", 1000)
    words = latencies.get_title(loc="left")
    assert re.findall(r" (\d+) ", words) == ["150", "390", "21", "3", "11", "2", "300"]
    assert "3 of 11 answers late" in words and "2 of 300 ticks late" in words
    assert "jitter" in words and "[µs]" in latencies.get_xlabel() and words.count(" µs") == 3
    assert ([bar.get_height() for bar in faults.patches], faults.get_yscale()) == ([4, 9], "symlog")
    assert [label.get_text() for label in faults.get_xticklabels()] == ["crc", "bus off"]
    assert axis(tracking) == ("time [s]", "tracking error [rad]")
    assert tracking.lines[0].get_xdata() == pytest.approx([0, 0.001, 0.002])
    assert tracking.lines[0].get_ydata() == pytest.approx([0.25, -0.5, 0])
    words = figure.axes[0].get_title(loc="left")
    assert re.findall(r"[\d.]+", words.partition("=")[2]) == ["50", "0.5", "300"]
    assert "50 N m/rad" in words and "0.5 N m," in words and "socketcand" in words
    assert figure.get_suptitle() == "a title"


def test_a_compensated_loop_shows_its_gain_and_both_errors(steady, picture, tmp_path):
    errors = {"trace": (0.25, -0.5, 0.25), "uncompensated": (1, -2, 3)}
    for name, values in errors.items():
        rows = "".join(f"{k / 1000},{value},0\n" for k, value in enumerate(values))
        (tmp_path / f"{name}.csv").write_text(f"time_s,reference_rad,angle_rad\n{rows}")
    figure = picture(steady, friction="gain = 0.85\nlimit = 0.95", control={})
    loop, tracking = figure.axes[0], figure.axes[-1]
    assert ["0.85" in text.get_text() for text in loop.get_legend().get_texts()] == [True]
    for line, values in zip(tracking.lines, errors.values(), strict=True):
        assert line.get_ydata() == pytest.approx(values)
    names = [text.get_text() for text in tracking.get_legend().get_texts()]
    assert re.findall(r"gain ([\d.]+)", " ".join(names)) == ["0.85", "0"]
    assert len({line.get_color() for line in tracking.lines}) == 2
    words = tracking.get_title(loc="left")
    assert [float(one) for one in re.findall(r"[\d.]+", words)] == [0.354, 2.16, 6.11]
    (tmp_path / "uncompensated.csv").unlink()
    assert len(picture(steady, control={}).axes[-1].lines) == 1


def test_a_run_with_faults_lies_over_the_same_run_without(library, steady, picture, tmp_path):
    """The first frame of the run is lost, and the shaft stands still after 2 of 3 ticks."""
    steady.write(tmp_path / "faultless.log")
    rows = np.arange(1, TICKS)
    run = made(100 + np.minimum(rows, 2 * TICKS // 3), rows)
    for frame in run.frames:
        frame.timestamp += 0.001
    figure = picture(run, **FAULTS)
    a, way = SIGMA0 / FC * THETA, np.arange(TICKS)
    without, with_faults = (
        FC * -np.expm1(-a * moved) for moved in (way, np.minimum(way, 2 * TICKS // 3)[1:] - 1)
    )
    for axes, x, first in zip(figure.axes, (THETA, 1e-3), (0, 1), strict=False):
        under, over = axes.lines[:2]
        assert under.get_xdata() == pytest.approx((way[first:] - 1) * x, abs=2e-6)
        assert under.get_ydata() == pytest.approx(without[first:], abs=1e-6)
        assert over.get_ydata() == pytest.approx(with_faults, abs=1e-6)
        assert under.get_linewidth() > over.get_linewidth()
    names = [text.get_text() for text in figure.axes[0].get_legend().get_texts()]
    assert "without faults" in names[0] and "over the bus" in names[1]
    share = np.mean(np.abs(without[1:] - with_faults) <= 0.01 * FC)
    (shown,) = re.findall(r"([\d.]+) % of the answers", figure.axes[0].get_title(loc="left"))
    assert 1 < float(shown) < 99 and float(shown) == pytest.approx(100 * share, abs=0.06)


def test_a_free_rotor_has_its_angle_over_time(steady, picture, tmp_path):
    (tmp_path / "trace.csv").write_text("time_s,angle_rad\n0,0.25\n0.001,1.5\n")
    parts = "[rotor]\ninertia = 1\nsigma0 = 1\nFc = 1\n[motor]\nbias = 1\nseconds = 1\n"
    angle = picture(steady, friction=parts, bus="socketcand").axes[1]
    assert axis(angle) == ("time [s]", "angle [rad]")
    assert [*angle.lines[0].get_xdata()] == [0, 0.001]
    assert [*angle.lines[0].get_ydata()] == [0.25, 1.5]
    assert len(picture(steady, bus="socketcand").axes) == 3


def test_a_force_is_in_newton_and_an_empty_panel_is_left_out(steady, picture):
    still = {**TIMES, "latency_us": {**TIMES["latency_us"], "max": 0}}
    figure = picture(steady, "label_torque = force [N]", control={}, **still)
    words = figure.axes[0].get_title(loc="left")
    assert len(figure.axes) == 3 and "50 N/m" in words and "0.5 N," in words
    assert figure.axes[1].get_ylabel() == "force [N]"


@pytest.mark.parametrize("numbers", [{}, {"bus": "socketcand", **FAULTS}])
def test_panels_and_labels_do_not_overlap(steady, picture, numbers):
    name = "$\\undefined$ a"  # dollars are no formula
    figure = picture(steady, f"{MEASURED}\nlabel_torque = {name}", title=name, **numbers)
    assert figure.get_suptitle().replace("\\$", "$") == name
    renderer = FigureCanvasAgg(figure).get_renderer()
    figure.draw(renderer)
    title = figure.texts[0].get_window_extent(renderer)
    whole = [title, *(axes.get_tightbbox(renderer) for axes in figure.axes)]
    assert all(Bbox.intersection(box, figure.bbox).bounds == box.bounds for box in whole)
    loop = figure.axes[0]
    parts = (loop, loop.get_legend(), loop._left_title, loop.xaxis.label, loop.yaxis.label)
    boxes = [part.get_window_extent(renderer) for part in parts]
    assert not any(a.overlaps(b) for some in (whole, boxes) for a, b in combinations(some, 2))


def test_missing_answers_new_starts_and_restarts_are_marked(library, steady, picture):
    assert not any(axes.collections for axes in picture(steady).axes)
    run, lost = Run(), (30, 300)
    for row in (0, 1):
        run.send(row, 0)  # before the first answer, so not marked
    for row in range(2, 400):
        if row == 350:
            run.add(Reset(What.RESTART))
        if row not in lost:
            count = 0 if row < 190 else 200 * (row % 2)
            run.tick(row, count, state=6 if row in (2, 350) else 5 if row == 320 else 0)
    _, whole, part = picture(run).axes
    for axes in (whole, part):
        looks = {(str(one.get_color()), str(one.get_linestyle())) for one in axes.collections}
        assert len(looks) == len(axes.collections) == 3
        share_of_panel = axes.get_xaxis_transform()
        assert all(one.get_transform() == share_of_panel for one in axes.collections)
    for axes, times in ((whole, [0.028, 0.297]), (part, [0.297])):
        strokes = {one.get_label().split()[0]: one.get_segments() for one in axes.collections}
        found = [[stroke[0][0] for stroke in strokes[name]] for name in ("no", "new", "restart,")]
        assert found == [pytest.approx(one, abs=1e-6) for one in (times, [0.316], [0.3465])]
        heights = [strokes[name][0][:, 1].tolist() for name in ("no", "new", "restart,")]
        assert heights == [[0, 0.08], [0, 1], [0, 1]]
        words = [text.get_text() for text in axes.get_legend().get_texts()]
        assert [re.findall(r"\d+", one) for one in words] == [[str(len(times))], ["1"], ["1"]]


@pytest.mark.parametrize(("ticks", "enlarged"), [(100, 100), (300, 200), (3000, 240)])
def test_the_last_panel_shows_where_the_torque_moves_most(library, picture, ticks, enlarged):
    """About a twelfth of the run, at least 200 ticks."""
    rows, still = np.arange(ticks), (ticks - enlarged) * 4 // 5
    run = made(np.where(rows < still, 0, 200 * (rows % 2)))
    _, whole, part = picture(run).axes
    shown = part.lines[0].get_ydata()
    assert (len(whole.lines[0].get_ydata()), len(shown)) == (ticks, enlarged)
    assert np.all(np.diff(shown)[1:] != 0)


@pytest.mark.parametrize(
    ("counted", "wrong"),
    [
        ({"crc": 4, "$lost^": 9}, []),
        ({"crc": 4, "$lost^": 8}, ["8", "9"]),
        ({"crc": 4}, ["0", "9"]),
    ],
)
def test_the_picture_says_whether_each_fault_was_counted(steady, picture, counted, wrong):
    faults = {"injected": {"$a^$": 1234567}, "expected": {"crc": 4, "$lost^": 9}}
    axes = picture(steady, rendered=True, faults=faults, node=counted).axes[-1]
    title = axes.get_title(loc="left").replace("\\$", "$")
    assert re.findall(r"\d+", title) == wrong and ("'$lost^'" in title) == bool(wrong)
    assert [text.get_text() for text in axes.get_xticklabels()] == ["\\$a^\\$"]
    assert [text.get_text() for text in axes.texts] == ["1234567"]


BEGINNINGS = {"p": b"\x89PNG", "p.PDF": b"%PDF"}


def test_a_picture_replaces_the_old_one_when_it_is_whole(steady, picture, monkeypatch, tmp_path):
    picture(steady)
    for name, beginning in BEGINNINGS.items():
        path = tmp_path / name
        path.write_text("old")
        with monkeypatch.context() as patched:

            def half(figure: Figure, part: Path, **_: object) -> None:
                part.write_text("half")
                raise OSError(28, "No space left")

            patched.setattr(Figure, "savefig", half)
            assert command("plot", tmp_path, "-o", path).returncode == 1
        assert path.read_text() == "old"
        assert command("plot", tmp_path, "-o", path).returncode == 0
        assert path.read_bytes().startswith(beginning)
    assert not list(tmp_path.glob(".*"))
