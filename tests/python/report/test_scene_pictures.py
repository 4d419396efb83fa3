# SPDX-License-Identifier: MIT
"""Pictures of the scenes commission, compensation and park-steer: their curves, bands and bars. The
table that park-steer prints.
"""

import json
import re
from types import SimpleNamespace

import can
import numpy as np
import pytest
from dahl.report import commission_plot, compensation, park_steer
from dahl.sim import axis
from dahl.sim import park_steer as steering
from dahl.sim.compensation import PERIOD_S, SHOWN_HAND, SHOWN_POSITION
from log_reading import drawing
from log_reading import run as command
from matplotlib.axes import Axes
from matplotlib.colors import to_hex

LAWS = ("none", "sign", "dead band", "tanh", "dahl")
RANDOM = np.random.default_rng(1)
PANELS = [  # of compensation: title, and the ends of the labels of x and y
    (f"Position loop: {SHOWN_POSITION.name}", "time [s]", "error [mrad]"),
    ("motor torque", "time [s]", "torque [N m]"),
    (f"Hand: {SHOWN_HAND.name}", "time [s]", "torque of the hand [N m]"),
    ("motor torque", "time [s]", "torque [N m]"),
    ("", "position: error over that without compensation", ""),
    ("", "hand: error over that without compensation", ""),
]


def assert_labels(panels: list[Axes], wanted: list[tuple[str, str, str]]) -> None:
    for axes, (title, x, y) in zip(panels, wanted, strict=True):
        assert axes.get_title(loc="left") == title
        for label, end in ((axes.get_xlabel(), x), (axes.get_ylabel(), y)):
            assert label.endswith(end) and bool(label) == bool(end), label


def traces(*names: str) -> SimpleNamespace:
    return SimpleNamespace(**{name: RANDOM.normal(size=round(4 / PERIOD_S)) for name in names})


def assert_bars(panel: Axes, shown: dict, law_of: dict[str, str]) -> None:
    """A bar of each case and law is as long as its ratio."""
    names = [label.get_text() for label in panel.get_yticklabels()]
    found = {name: {} for name in names}
    for bar in panel.patches:
        case = names[round(bar.get_y() + bar.get_height() / 2)]
        found[case][law_of[to_hex(bar.get_facecolor())]] = bar.get_width()
    assert [*found] == [*shown]
    for case, laws in shown.items():
        ratios = {law: value["ratio"] for law, value in laws.items() if law != "none"}
        assert found[case] == pytest.approx(ratios)
    assert [*panel.lines[0].get_xdata()] == [1, 1]


def test_each_law_has_its_curves_bands_and_bars(tmp_path) -> None:
    """Means and ranges of 20 ms from 1 s to 3.5 s, and the ratio of each case."""
    axes_runs = {name: {law: traces("error", "motor") for law in LAWS} for name in ("hand", "loop")}
    cases = {case: {law: {"ratio": RANDOM.uniform(0.1, 2)} for law in LAWS} for case in "abc"}
    numbers = {"position": cases, "hand": dict(reversed(cases.items()))}
    given = SimpleNamespace(position=axes_runs["loop"], hand=axes_runs["hand"], numbers=numbers)
    with drawing(rendered=False) as figures:
        compensation.draw(tmp_path / "x.png", given)
    assert_labels(figures[0].axes, PANELS)
    (legend,) = figures[0].legends
    shown = zip(legend.get_texts(), legend.get_lines(), strict=True)
    colours = {text.get_text(): line.get_color() for text, line in shown}
    panels = iter(figures[0].axes)
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
                assert line.get_color() == colours[line.get_label()]
    by_colour = {colour: law for law, colour in colours.items()}
    assert len(by_colour) == len(LAWS)
    for panel, shown in zip(panels, numbers.values(), strict=True):
        assert_bars(panel, shown, by_colour)


def test_the_hand_is_drawn_without_and_with_compensation(tmp_path) -> None:
    """Its torque over its angle in degrees, and with compensation all torques over time."""
    plain, assisted = (traces("hand_angle", "hand", "tyres", "assist", "time") for _ in range(2))
    with drawing(rendered=False) as figures:
        park_steer.draw(tmp_path / "x.png", plain, assisted)
    loops, torques = figures[0].axes
    ends = [("", "[deg]", "torque of the hand [N m]"), ("", "time [s]", "compensation [N m]")]
    assert_labels([loops, torques], ends)
    for axes in (loops, torques):
        shown = [text.get_text() for text in axes.get_legend().get_texts()]
        assert shown == [line.get_label() for line in axes.lines]
    for line, run in zip(loops.lines, (plain, assisted), strict=True):
        assert line.get_xdata() == pytest.approx(np.degrees(run.hand_angle))
        assert line.get_ydata() == pytest.approx(run.hand)
    assert [line.get_label().split()[0] for line in loops.lines] == ["without", "with"]
    assert [line.get_label() for line in torques.lines] == ["tyres", "assist", "hand"]
    for line in torques.lines:
        assert line.get_xdata() == pytest.approx(assisted.time)
        assert line.get_ydata() == pytest.approx(getattr(assisted, line.get_label()))


def test_the_demo_of_park_steer_prints_the_numbers_of_its_summary(tmp_path, monkeypatch) -> None:
    """In the column of its run, also with --json. The summary has the same numbers."""
    names = ("width_Nm", "drag_Nm", "largest_hand_Nm", "hand_J", "tyres_J", "assist_J")
    columns = {gain: dict(zip(names, RANDOM.uniform(1, 9, 6), strict=True)) for gain in (0, 1)}
    frame = can.Message(arbitration_id=5, is_extended_id=False, data=b"ab")

    def simulate(gain: float, progress) -> SimpleNamespace:
        progress()
        return SimpleNamespace(
            **vars(traces("hand_angle", "hand", "tyres", "assist", "time")),
            frames=[frame] * bool(gain),
            numbers=lambda: columns[gain > 0],
        )

    monkeypatch.setattr(steering, "simulate", simulate)
    for words in ((), ("--json",)):
        with drawing(rendered=False):
            done = command("demo", "--scene", "park-steer", "-o", tmp_path, *words)
        summary = json.loads((tmp_path / "summary.json").read_text())
        assert summary["without"] == columns[0] and summary["with"] == columns[1]
        assert done.returncode == 0 and (not words or json.loads(done.stdout) == summary)
        shown = done.stderr if words else done.stdout
        cells = [re.split(r" *│ *", line)[1:4] for line in shown.splitlines() if "│" in line]
        rows = [[f"{columns[gain][name]:.2f}" for gain in (0, 1)] for name in names]
        assert [row[1:] for row in cells] == rows
        for name, (meaning, *_) in zip(names, cells, strict=True):
            assert meaning.endswith("[J]" if name.endswith("_J") else "[N m]")
        assert "without" in shown and str(tmp_path / "run.log") in shown
    assert (tmp_path / "run.log").read_text().endswith(" 005#6162\n")


@pytest.fixture(scope="module")
def commissioned() -> axis.Commissioned:
    return axis.commission(axis.simulated(), axis.Shaft())


def curves(panel: Axes) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    return {line.get_label(): (line.get_xdata(), line.get_ydata()) for line in panel.lines}


def test_a_commissioning_has_its_motion_friction_turn_kicks_and_tracking(
    commissioned: axis.Commissioned, tmp_path
) -> None:
    tracking = tuple(axis.track(commissioned.axis, is_on) for is_on in (False, True))
    with drawing() as drawn:
        commission_plot.draw(tmp_path / "all.png", commissioned, tracking)
    motion, by_angle, by_speed, turn, kicks, errors = drawn[0].axes
    assert [*curves(motion)] == list(axis.STAGES)
    found = curves(by_angle)
    assert found["friction"][1] == pytest.approx(axis.FC, rel=0.05)
    assert found["load"][1] == pytest.approx(axis.GRAVITY * np.cos(found["load"][0]), abs=0.02)
    speed, friction = curves(by_speed)["measured"]
    assert friction == pytest.approx(axis.FC + axis.VISCOUS * speed, rel=0.03)
    travel, torque = curves(turn)["measured"]  # a ramp to the breakaway
    assert travel[-1] > 50 and max(torque) == pytest.approx(axis.FC, rel=0.1)  # mrad
    assert len(kicks.lines) == 8  # both ways, 4 at the largest gain
    ends = [line.get_ydata()[-1] for line in kicks.lines]
    assert [end > 0 for end in ends] == [True, False] * 4
    assert [max(np.abs(line.get_ydata())) > 10 for line in errors.lines] == [True, False]


def test_a_refused_axis_has_the_panels_of_its_data(tmp_path) -> None:
    """The load of this one falls after the sweeps, or at once."""
    for until, panels in ((11.0, 3), (0.3, 1)):
        shaft, ticks = axis.Shaft(), []

        def fall(_: object, shaft=shaft, ticks=ticks, until=until) -> None:
            ticks.append(0)
            shaft.hand = 3 * axis.FC * (len(ticks) > until / axis.PERIOD_S)

        refused = axis.commission(axis.simulated(), shaft, watch=fall)
        assert refused.axis.refusal_code
        with drawing(rendered=False) as drawn:
            commission_plot.draw(tmp_path / "part.png", refused)
        assert len(drawn[0].axes) == panels
