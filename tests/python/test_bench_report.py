# SPDX-License-Identifier: MIT
"""What tools/bench writes, of numbers made up so that no two are the same: each must stand in the
row, the column, the point and the page that it belongs to.
"""

from __future__ import annotations

import itertools
import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tools" / "bench"))

import dahl  # noqa: E402
import figures  # noqa: E402
import host  # noqa: E402
import outside  # noqa: E402
import report  # noqa: E402
import results  # noqa: E402
import table  # noqa: E402
import target  # noqa: E402

MOTIONS = ("walk_20", "sine_12", "two_one_24", results.JUMPS)


@pytest.fixture
def counted() -> dict:
    """As target.json: the costs of two libcs, of which newlib's are taken."""
    number = itertools.count(1000)
    ways = [way.key for way in results.WAYS if way.on_target]
    ways += [f"{solver}_parts_{n}" for n in (9, 17) for solver in results.SOLVERS]
    result = {}
    for core in target.CORES:
        motions = {
            libc: {
                motion: {way: 1.37 * next(number) for way in ("floor", *ways)} for motion in MOTIONS
            }
            for libc in (("picolibc",) if core == "rv32" else ("newlib", "picolibc"))
        }
        result[core] = {key: next(number) for _, key in table.ROWS} | {
            "core": f"Core {core}",
            "compiler": "cc 1",
            "motions": motions,
            "helpers": [f"__help_{core}"],
            "helpers_O0": [],
        }
    del result["rv32"]["newlib_expf"]
    return result


RUN = {"quick": False, "cpu": "a processor", "compiler": "a compiler", "ticks": {"threads": 7000}}
RUN |= {"python": {"throughput_ns": 2.0, "batch_ns": 3.0, "step_ns": 500.0}}
RUN["outside"] = {
    "mujoco": {"scenarios": {"walk_20": [1e-4, 1e-5]}, "ns": 6000.0},
    "newton": {"missing": "not here"},
}
RUN["mixes"] = {
    name: {"tick": 10.0 * k + 5, "throughput": 2.0}
    for k, name in enumerate(("slip_1", "slip_2", "slip_4", "slip_8", "mix"))
}
RUN["threads"] = {"1": 3.0, "2": 2.0, "8": 0.5}
RUN["parts"] = [
    {"way": "rk4_parts", "limit": 1e-6, "parts": 25, "worst": dict.fromkeys(MOTIONS, 3e-7)},
    {"way": "euler_parts", "limit": 1e-3, "parts": 1, "worst": dict.fromkeys(MOTIONS, 3e-7)},
    {"way": "backward_parts", "limit": 1e-6, "parts": 0},
    {"way": "trapezoid_parts", "limit": 1e-3, "parts": 0},
]
RUN["rates"] = [
    {"rate": rate, "way": way, "parts": parts}
    for rate, parts in ((100, 17), (1000, 9), (3000, 0))
    for way in host.SOLVERS
]


@pytest.fixture
def measured() -> dict:
    """As host.json, of a whole run."""
    number = itertools.count(1)
    ways = sorted({results.HOST_KEY.get(way.key, way.key) for way in results.WAYS})
    errors = {m: {way: [next(number) * 1e-9, 0.5] for way in ways} for m in MOTIONS}
    errors["walk_20"]["euler"][0] = 7.0
    channels = ("batch_counts_16", "throughput_counts_16", "throughput_angle_16")
    raced = (*ways, *channels, *(f"{way}_apart" for way in channels[:2]), "copy")
    speed = {m: {way: float(next(number)) for way in raced} for m in MOTIONS}
    growth = [
        {"scenario": motion, "way": way, "ticks": ticks, "worst": next(number) * 1e-12}
        for way in figures.GROWTH_TITLES
        for ticks in (1000, 100)
        for motion in ("a", "b")
    ]
    return RUN | {"errors": errors, "speed": speed, "growth": growth}


def rows_of(block: str) -> tuple[list[str], dict[str, list[str]]]:
    """Names of the columns, and the cells of each row of the table in a block."""
    lines = [line for line in block.splitlines() if line.startswith("|")]
    assert len({line.count("|") for line in lines}) == 1  # else no page shows it as a table
    head, _, *rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]
    return head[1:], {row[0]: row[1:] for row in rows}


# --- tables --------------------------------------------------------------------------------------


def test_each_count_stands_in_its_row_and_its_core(counted):
    cores, rows = rows_of(table.markdown(counted))
    assert cores == [core["core"] for core in counted.values()]
    assert len(rows) == len(table.ROWS)
    for title, key in table.ROWS:
        assert rows[title] == [str(core.get(key, "-")) for core in counted.values()]
    for core in counted.values():
        assert f"{core['core']} `{core['helpers'][0]}` (compiled with `-O0`: nothing)" in (
            table.markdown(counted)
        )


def test_the_short_table_has_three_cores(counted):
    (*cores, last), rows = rows_of(table.short(counted))
    assert (cores, last) == (["Core m0", "Core m3", "Core m4f"], "worst error")
    for title, key, error in table.SHORT_ROWS:
        assert rows[title] == [*(str(counted[c][key]) for c in ("m0", "m3", "m4f")), error]


def test_the_ways_with_error_jumps_and_mean_cost(counted, measured):
    """Cost and worst error are of all motions but the jumps, which have a column of their own."""
    block = report.ways_table(counted, measured)
    head, rows = rows_of(block)
    assert head == ["worst error of F/Fc", "on giant jumps", "Core m0", "Core m3", "Core m4f"]
    few = MOTIONS[:-1]
    for way in (way for way in results.WAYS if way.on_target):
        errors = {
            m: measured["errors"][m][results.HOST_KEY.get(way.key, way.key)][0] for m in MOTIONS
        }
        costs = [
            np.mean([counted[core]["motions"]["newlib"][m][way.key] for m in few])
            for core in results.CORES
        ]
        worst = max(errors[m] for m in few)
        assert rows[f"**{way.title}**" if way.ours else way.title] == [
            "diverges" if way.key == "euler" else f"{worst:.0e}",
            f"{errors[results.JUMPS]:.0e}",
            *(f"{cost:.0f}" for cost in costs),
        ]
    line = {n: counted["m0"]["motions"]["newlib"]["sine_12"][f"rk4_parts_{n}"] for n in (9, 17)}
    assert results.parts_cost({f"rk4_parts_{n}": c for n, c in line.items()}, "rk4", 25) == (
        2 * line[17] - line[9]
    )
    assert [report.shown_error(x) for x in (3.0, 3.1)] == ["3e+00", "diverges"]
    assert "RK4, 25 parts" in rows and "forward Euler, 1 parts" not in rows
    assert "backward Euler 1e-06, trapezoid 1e-03." in block


def test_what_vectors_bring_to_parts(counted, measured):
    """The time of ticks over that of the vectors, in the order of the words."""
    block = report.host_block(results.combine(counted, measured))
    line = next(x for x in block.splitlines() if "dahl_throughput_parallel_counts" in x)
    assert re.findall(r"\d+\.\d", line) == ["2.5", "7.5", "12.5", "17.5", "22.5"]
    measured.pop("mixes")
    assert "parallel" not in report.host_block(results.combine(counted, measured))


def test_what_threads_bring(counted, measured, monkeypatch):
    """One thread's time over theirs; every number of threads is run, over the same moves."""
    result = results.combine(counted, measured)
    assert result["host"]["threads_8_x"] == 6.0
    assert "is 1.5 times as fast as one thread on a log of 7,000" in report.host_block(result)
    torques, asked, run = [], [], dahl.Throughput.run_counts
    monkeypatch.setattr(host, "best_time", lambda work: torques.append(work().copy()) or 6.0)
    monkeypatch.setattr(
        dahl.Throughput, "run_counts", lambda *a, **k: asked.append(k["threads"]) or run(*a, **k)
    )
    found = host.measure_threads(3_000_000)
    assert list(map(str, asked)) == list(found)
    assert {"1", "2"} <= set(found) and set(found.values()) == {6e9 / 3e6}
    assert np.ptp(torques[0]) > 0.5 and np.abs(torques[1] - torques[0]).max() <= 6e-8


def test_mixes_are_run_both_ways(monkeypatch):
    """Each over the same moves, by the clock of best_time(); and the two are the same model."""
    torques = []
    monkeypatch.setattr(host, "best_time", lambda work: torques.append(work().copy()) or 1.0)
    assert list(host.measure_mixes()) == ["slip_1", "slip_2", "slip_4", "slip_8", "mix"]
    for tick, throughput in zip(torques[::2], torques[1::2], strict=True):
        assert np.ptp(tick) > 0.5
        assert np.abs(tick - throughput).max() <= 1.1 * np.spacing(tick.max())


def test_what_the_host_says_is_over_the_plain_loop(counted, measured):
    """Geometric means and least of all motions; a rival's time over ours."""
    result = results.combine(counted, measured)
    block = report.host_block(result)
    over = {
        way: [speed["expm1f"] / speed[way] for speed in measured["speed"].values()]
        for way in next(iter(measured["speed"].values()))
    }
    pairs = [
        (np.prod(over[way]) ** (1 / len(MOTIONS)), min(over[way]))
        for way in ("batch_counts", "batch_counts_16", "batch_counts_16_apart")
        + ("throughput_counts", "throughput_angle", "throughput_counts_16")
        + ("throughput_counts_16_apart",)
    ]
    wanted = [f"{x:.1f}" for pair in pairs for x in pair]
    by_angle = over["throughput_angle_16"]
    pair = [result["host"][f"throughput_angle_channels16_x{least}"] for least in ("", "_least")]
    assert pair == pytest.approx(
        [np.prod(by_angle) ** (1 / len(MOTIONS)), min(by_angle)], abs=0.006
    )
    assert "a processor, a compiler; " in block and "geometric mean over" in block
    assert "in brackets the least" in block
    assert re.findall(r"\d+\.\d", block.partition("plain copy")[0]) == wanted
    copies = [
        np.mean([speed[way] / speed["copy"] for speed in measured["speed"].values()])
        for way in ("throughput_counts", "throughput_counts_16")
    ]
    said = re.search(r"plain copy\D+(\d+) times\D+(\d+) times", block)
    assert [int(x) for x in said.groups()] == [round(x) for x in copies]
    assert re.search(r"run_counts` is 3000 times.* 2000 times .* call 12\.0 times", block)
    assert "not compared here: newton (not here)" in block
    without = measured | {"outside": {"mujoco": {"missing": "no wheel"}}}
    block = report.host_block(results.combine(counted, without))
    assert "not compared here: mujoco (no wheel)" in block and "mj_step" not in block


# --- pictures ------------------------------------------------------------------------------------


def drawn(axes, style: str) -> dict[str, list]:
    """Points of one kind of line, by colour."""
    found: dict[str, list] = {}
    for line in axes.lines:
        if style in (line.get_marker(), line.get_linestyle()):
            found.setdefault(line.get_color(), []).append(np.transpose(line.get_data()).tolist())
    return found


def test_each_point_stands_at_its_cost_and_error_in_its_colour(counted, measured):
    panels = figures.pareto(counted, measured).axes
    points = [results.core_points(counted, measured, core) for core in results.CORES]
    points.append(results.host_points(measured))
    for axes, group in zip(panels, points, strict=True):
        place = lambda p: [[p.mean_cost(), min(p.worst(), figures.TOP)]]  # noqa: E731
        seen = drawn(axes, "o")
        assert seen[figures.OURS] == [place(p) for p in group if p.ours]
        assert seen[figures.RIVAL] == [
            place(p) for p in group if not p.ours and p.worst() <= figures.TOP
        ]
        assert drawn(axes, "^")[figures.RIVAL] == [
            place(p) for p in group if p.worst() > figures.TOP
        ]
        [front] = [line for line in axes.lines if line.get_color() == figures.FRONT]
        best = figures.front(group)
        assert np.transpose(front.get_data()).tolist() == [place(p)[0] for p in best]
        assert front.get_drawstyle() == "steps-post"  # up to the next one nothing better is had
        low, high = axes.get_ylim()
        assert low < figures.BOTTOM < figures.TOP < high
        assert (axes.get_xscale(), axes.get_yscale()) == ("log", "log")
    assert [axes.get_title(loc="left") for axes in panels] == [
        "Cortex-M0",
        "Cortex-M3",
        "Cortex-M4F",
        "host: a processor",
    ]
    units = [axes.get_xlabel().split(",")[0] for axes in panels]
    assert units == [*["instructions a tick"] * 3, "ns a tick"]
    assert [bool(axes.get_ylabel()) for axes in panels] == [True, False] * 2  # left ones for all
    floors = [
        min(way["floor"] for way in counted[core]["motions"]["newlib"].values())
        for core in results.CORES
    ]
    floors.append(min(speed["copy"] for speed in measured["speed"].values()))
    assert [drawn(axes, ":")["#999999"][0][0][0] for axes in panels] == floors


def test_the_key_names_the_number_beside_each_point(counted, measured):
    """Ours first, in our colour; points too close to each other have one label."""
    figure = figures.pareto(counted, measured)
    [key] = figure.legends
    known = dict(text.get_text().split("  ") for text in key.get_texts())
    assert list(known) == [str(n) for n in range(1, len(known) + 1)]
    groups = [results.core_points(counted, measured, core) for core in results.CORES]
    groups.append(results.host_points(measured))
    ours = {figures.plain(p.title): p.ours for group in groups for p in group}
    colours = [figures.OURS if ours[title] else figures.RIVAL for title in known.values()]
    assert (
        [text.get_color() for text in key.get_texts()] == colours == sorted(colours, reverse=True)
    )
    for axes, group in zip(figure.axes, groups, strict=True):
        by_title = {figures.plain(p.title): p for p in group}
        labels = [(text, text.get_text().split()) for text in axes.texts[:-1]]
        numbers = [number for _, some in labels for number in some]
        assert sorted(known[n] for n in numbers) == sorted(by_title)
        for text, some in labels:
            points = [by_title[known[number]] for number in some]
            assert {p.ours for p in points} == {text.get_color() == figures.OURS}
            cost, error = text.xy
            assert cost == min(p.mean_cost() for p in points)
            assert error == min(figures.drawn_error(p) for p in points)
    assert [a.texts[-1].get_text() for a in figure.axes] == [" load, multiply, store"] * 3 + [
        " plain copy"
    ]


def test_points_that_are_close_in_both_and_of_one_side_share_a_label():
    made = {"a": (10, 1e-3), "b": (15, 1.4e-3), "dear": (30, 1e-3), "bad": (10, 1e-2)}
    points = [point(key, False, *place) for key, place in made.items()]
    found = figures.clusters([*points, point("ours", True, 10, 1e-3)])
    assert sorted("".join(p.key for p in group) for group in found) == ["ab", "bad", "dear", "ours"]


def test_the_results_keep_each_number_of_both_runs(counted, measured):
    """Cost and worst error of every point; what is of the machine and of Python as it was."""
    result = results.combine(counted, measured)
    few = MOTIONS[:-1]
    for core, points in result["points"].items():
        known = {way.key: way for way in results.WAYS}
        for key, point in points.items():
            assert point["ours"] == (key in known and known[key].ours)
            if key in known and core != "host":
                costs = [counted[core]["motions"]["newlib"][m][key] for m in few]
                assert point["cost"] == pytest.approx(np.mean(costs), abs=0.01)
            elif key in known:
                name = results.HOST_KEY.get(key, key)
                costs = [measured["speed"][m][name] for m in few]
                assert point["cost"] == pytest.approx(np.mean(costs), abs=0.01)
                assert point["worst"] == max(measured["errors"][m][name][0] for m in few)
    assert result["points"]["host"]["mujoco"] == {"ours": False, "cost": 6000.0, "worst": 1e-4}
    assert "newton" not in result["points"]["host"]
    assert result["points"]["m4f"]["rk4_25"]["worst"] == 3e-7
    assert all(key in title.lower() for key, title in results.OUTSIDE.items())
    assert set(result["points"]) == {*results.CORES, "host"}
    ours = {
        place: {key for key, point in points.items() if point["ours"]}
        for place, points in result["points"].items()
    }
    batches = {"batch_counts", "throughput_counts", "throughput_angle"}
    calls = {"counts_q30", "counts", "angle"}
    assert ours == dict.fromkeys(results.CORES, calls) | {"host": batches}
    on_host = {"double_state", *batches}
    assert result["points"]["host"].keys() == known.keys() - calls | {"mujoco"}
    assert result["points"]["m3"].keys() == known.keys() - on_host | {"rk4_25"}
    assert result["python"] == measured["python"] and result["missing"] == {"newton": "not here"}
    assert result["machine"] == {k: measured[k] for k in ("cpu", "compiler", "quick", "ticks")}


def test_a_way_that_is_beaten_is_told(counted, measured, capsys):
    """A rival that is both cheaper and better on one motion alone, on one core."""
    counted["m3"]["motions"]["newlib"]["sine_12"]["rk4"] = 1.0
    measured["errors"]["sine_12"]["rk4"][0] = 1e-12
    result = results.combine(counted, measured)
    ours = [way.key for way in results.WAYS if way.ours and way.on_target]
    expected = [{"core": "m3", "motion": "sine_12", "ours": o, "rival": "rk4"} for o in ours]
    on_m3 = [found for found in result["dominated"] if found["core"] == "m3"]
    assert [found for found in on_m3 if found["rival"] == "rk4"] == expected
    report.show(result)
    shown = capsys.readouterr().out
    assert f"of our points, {len(result['dominated'])} are beaten in both axes" in shown
    assert shown.count("beaten: {") == len(result["dominated"])
    printed = [[cell.strip() for cell in line.split("│")[1:-1]] for line in shown.splitlines()]
    assert [row for row in printed if row] == [
        [key, f"{p['cost']:.4g}", report.shown_error(p["worst"])]
        for points in result["points"].values()
        for key, p in sorted(points.items(), key=lambda item: item[1]["cost"])
    ]
    titles = re.findall(r"^ +(.*): (.*), worst error", shown, re.MULTILINE)
    assert titles == [
        (title, "ns a tick" if core == "host" else "instructions a tick")
        for core, title in figures.TITLES.items()
    ]
    for key, value in result["host"].items():
        assert re.search(rf"^{key} +{value:.2f}$", shown, re.MULTILINE)
    points = results.core_points(counted, measured, "m3")
    assert result["closest"]["m3"] == results.closest(points)


def point(key: str, ours: bool, cost: float, error: float, motion: str = "walk") -> results.Point:
    return results.Point(key, key, ours, {motion: cost}, {motion: error})


def test_beaten_in_both_axes_alone():
    ours = point("ours", True, 20, 1e-9)
    rivals = [
        point("cheaper", False, 10, 1e-3),
        point("better", False, 40, 1e-12),
        point("as good", False, 10, 0.97e-9),
    ]
    assert results.beaten([ours, *rivals], "m4f") == []
    found = results.beaten([ours, *rivals, point("both", False, 19, 9e-10)], "m4f")
    assert found == [{"core": "m4f", "motion": "walk", "ours": "ours", "rival": "both"}]


def test_one_motion_is_enough_to_be_beaten():
    ours = results.Point("o", "o", True, {"a": 10, "b": 10}, {"a": 1e-8, "b": 1e-8})
    rival = results.Point("r", "r", False, {"a": 99, "b": 9}, {"a": 1e-9, "b": 1e-9})
    assert [found["motion"] for found in results.beaten([ours, rival], "m0")] == ["b"]


def test_front_keeps_what_nothing_beats():
    points = [point(k, False, c, e) for k, c, e in (("a", 1, 1), ("b", 2, 2), ("c", 3, 0.1))]
    assert [p.key for p in figures.front(points)] == ["a", "c"]


def test_closest_is_the_best_of_the_cheap_and_the_cheapest_of_the_good():
    """An error within 5 % of ours is as good; what beats ours in neither is not looked at."""
    made = {"a": (5, 1e-2), "b": (9, 1e-4), "c": (40, 1e-9), "d": (80, 1e-12), "e": (30, 1.04e-8)}
    points = [
        results.Point(key, key, False, {"walk": cost}, {"walk": error})
        for key, (cost, error) in (made | {"f": (20, 1.2e-8)}).items()
    ]
    for key, cost in (("dear", 50.0), ("ours", 10.0)):
        points.append(results.Point(key, key, True, {"walk": cost}, {"walk": 1e-8}))
    assert results.closest(points) == {
        "as cheap": {"way": "b", "times the error": pytest.approx(1e4)},
        "as exact": {"way": "e", "times the cost": pytest.approx(3)},
    }
    assert results.closest(points[-2:]) == {}


def test_growth_is_the_worst_of_the_motions_by_ticks(counted, measured):
    left, right = figures.growth(counted, measured).axes
    for line, way in zip(left.lines, figures.GROWTH_TITLES, strict=False):
        assert line.get_label() == figures.GROWTH_TITLES[way]
        [title] = [known.title for known in results.WAYS if known.key == way]
        assert set(re.findall(r"\w+", line.get_label())) <= set(re.findall(r"\w+", title))
        assert np.transpose(line.get_data()).tolist() == [
            [
                ticks,
                max(
                    row["worst"]
                    for row in measured["growth"]
                    if (row["way"], row["ticks"]) == (way, ticks)
                ),
            ]
            for ticks in (100, 1000)
        ]
    assert [line.get_linestyle() for line in left.lines[:6]] == ["-", "-", *["--"] * 4]
    assert [x.get_label() for x in right.lines] == [
        "dahl_step_counts_q30",
        *results.SOLVERS.values(),
    ]


def test_growth_names_its_axes_and_the_bound(counted, measured):
    left, right = figures.growth(counted, measured).axes
    for axes, words in (
        (left, ("ticks", "worst error")),
        (right, ("samples a s", "instructions a s")),
    ):
        assert axes.get_xlabel().startswith(words[0]) and axes.get_ylabel().startswith(words[1])
        assert (axes.get_xscale(), axes.get_yscale()) == ("log", "log")
        shown = [text.get_text() for text in axes.get_legend().get_texts()]
        assert shown == [x.get_label() for x in axes.lines if x.get_label()[0] != "_"]
    [bound] = drawn(left, ":")["#999999"]
    assert bound[0][1] == pytest.approx(0.52 * float(np.spacing(np.float32(1))))


def test_growth_by_rate_is_the_cost_of_a_second(counted, measured):
    right = figures.growth(counted, measured).axes[1]
    motions = counted["m4f"]["motions"]["newlib"]
    ours, euler = right.lines[:2]
    assert np.transpose(ours.get_data()).tolist() == [
        [100, 100 * motions["sine_12"]["counts_q30"]],
        [1000, 1000 * motions["two_one_24"]["counts_q30"]],
        [3000, 3000 * motions["two_one_24"]["counts_q30"]],
    ]
    assert np.transpose(euler.get_data()).tolist() == [
        [100, 100 * motions["two_one_24"]["euler_parts_17"]],
        [1000, 1000 * motions["two_one_24"]["euler_parts_9"]],
    ]


# --- files ---------------------------------------------------------------------------------------


def not_in_reach():
    raise target.BenchError("tribometer/reciprocating.tsv is not in reach (dahl data)")


@pytest.fixture
def pages(monkeypatch, tmp_path, counted, measured) -> Path:
    """A tree with the files of a run and the pages that it writes."""
    monkeypatch.setattr(report.measured, "measure", not_in_reach)
    out, docs = tmp_path / "out", tmp_path / "docs"
    (docs / "pictures").mkdir(parents=True)
    out.mkdir()
    for module, names in ((report, ("ROOT", "OUT", "DOCS", "RESULT")), (target, ("RESULT",))):
        places = {"ROOT": tmp_path, "OUT": out, "DOCS": docs, "RESULT": out / "results.json"}
        for name in names:
            monkeypatch.setattr(module, name, places[name])
    monkeypatch.setattr(target, "RESULT", out / "target.json")
    monkeypatch.setattr(host, "RESULT", out / "host.json")
    target.write(target.RESULT, counted)
    target.write(host.RESULT, measured)
    marks = {
        "README.md": [table.SHORT_MARKS],
        "docs/microcontroller.md": [table.MARKS],
        "docs/speed.md": [report.HOST_MARKS, report.WAYS_MARKS],
    }
    for page, pairs in marks.items():
        text = "".join(f"before\n{start}\nold\n{end}\nafter\n" for start, end in pairs)
        (tmp_path / page).write_text(text)
    return tmp_path


def test_the_docs_get_each_block_and_picture_in_its_place(pages, counted, measured, capsys):
    assert report.main(["--docs"]) == 0
    text = {path: (pages / path).read_text() for path in ("README.md", "docs/speed.md")}
    assert text["README.md"] == f"before\n{table.short(counted)}\nafter\n"
    page = (pages / "docs/microcontroller.md").read_text()
    assert page == f"before\n{table.markdown(counted)}\nafter\n"
    result = results.combine(counted, measured)
    blocks = report.host_block(result), report.ways_table(counted, measured)
    assert text["docs/speed.md"] == "".join(f"before\n{block}\nafter\n" for block in blocks)
    for name in report.PICTURES:
        picture = (pages / "docs/pictures" / name).read_bytes()
        assert picture == (pages / "out" / name).read_bytes()
        assert picture[:4] == b"\x89PNG"
    assert json.loads((pages / "out/results.json").read_text()) == json.loads(json.dumps(result))
    assert "not compared with measured logs anew: tribometer" in capsys.readouterr().out
    growth, pareto = ((pages / f"out/{name}.svg").read_text() for name in ("growth", "pareto"))
    assert "Error over ticks" in growth and "Speed against error" in pareto
    assert "<dc:date>" not in growth + pareto  # the same run gives the same file


@pytest.mark.parametrize("part", ["host", "target", "cores"])
def test_a_part_of_a_run_is_not_for_the_docs(pages, counted, measured, monkeypatch, part):
    """A table of fewer columns or with empty cells would take the place of a whole one."""
    monkeypatch.setattr(report, "draw", lambda *_: None)  # takes longest, is no matter
    if part == "host":
        target.write(host.RESULT, measured | {"quick": True})
    elif part == "cores":
        target.write(target.RESULT, {core: counted[core] for core in ("m0", "m3", "m4f")})
    else:
        for core in counted.values():
            core["motions"] = dict([*core["motions"].items()][:1])
        target.write(target.RESULT, counted)
    assert report.main([]) == 0
    with pytest.raises(target.BenchError, match="docs/ wants a whole one"):
        report.main(["--docs"])
    for page in ("README.md", "docs/microcontroller.md", "docs/speed.md"):
        assert "\nold\n" in (pages / page).read_text()


@pytest.mark.parametrize("lacking", ["target", "host"])
def test_a_report_without_a_run_names_the_command(pages, lacking):
    (pages / "out" / f"{lacking}.json").unlink()
    with pytest.raises(target.BenchError, match=rf"run tools/bench\.sh {lacking} first"):
        report.main([])


@pytest.mark.parametrize("text", ["no marks\n", f"one alone\n{table.MARKS[0]}\nand more\n"])
def test_a_page_without_its_marks_is_an_error(pages, monkeypatch, text):
    monkeypatch.setattr(report, "draw", lambda *_: None)
    page = pages / "docs/microcontroller.md"
    page.write_text(text)
    with pytest.raises(target.BenchError, match=re.escape("docs/microcontroller.md lacks")):
        report.main(["--docs"])
    assert page.read_text() == text


# --- what is read ---------------------------------------------------------------------------------


def test_counts_belong_to_the_case_before_them():
    text = "case one\nnumber plan_bytes 24\ncase two\n"
    cases, numbers = target.read_cases(text, "-\n5\n7\n-\n9\n")
    assert (cases, numbers) == ({"one": [5, 7], "two": [9]}, {"plan_bytes": 24})
    for broken in ("-\n5\n", "-\n5\n-\n9\n-\n", ""):
        with pytest.raises(target.BenchError):
            target.read_cases(text, broken)


def test_motions_are_means_and_the_rest_is_the_worst():
    cases = {"motion:walk:counts": [10, 20, 33], "motion:walk:euler": [5], "euler": [1, 9]}
    assert target.motion_numbers(cases) == {"walk": {"counts": 21.0, "euler": 5.0}}
    cases = {name: [n, 10 * n] for n, name in enumerate(RIVALS, 1)}
    assert target.rival_numbers(cases, "newlib") == {
        "newlib_expm1f": 10,
        "newlib_expf": 20,
        "newlib_exp_double": 30,
        "euler": 40,
        "rk4": 50,
        "table": 60,
        "newlib_expm1f_worst": 70,
        "newlib_expf_worst": 80,
        "newlib_exp_double_worst": 90,
    }


RIVALS = ("expm1f", "expf", "exp_double", "euler", "rk4", "table")
RIVALS += ("expm1f_worst", "expf_worst", "exp_double_worst")


FLOATS = "__aeabi_fadd __aeabi_dmul __aeabi_l2f __adddf3 __floatsisf malloc _sbrk printf"
FLOATS += " expm1f __ieee754_expf"
INTEGERS = "__aeabi_div0 __aeabi_uidiv __aeabi_lmul __aeabi_idivmod dahl_step_counts memcpy"


def test_what_may_not_be_linked(monkeypatch):
    names = f"{INTEGERS} {FLOATS}".split()
    monkeypatch.setattr(target, "run", lambda *_: "".join(f"00000010 T {n}\n" for n in names))
    found = target.forbidden(target.CORES["m3"], Path("image"))
    assert sorted(found) == sorted(FLOATS.split())


def test_helpers_are_what_is_wanted_and_not_there(monkeypatch):
    listing = "a.o:\n         U __help\n         U mine\nb.o:\n00000010 T mine\n         U __aid\n"
    monkeypatch.setattr(target, "run", lambda *_: listing)
    assert target.helpers(target.CORES["m3"], Path("a.o")) == ["__aid", "__help"]


def test_sizes_by_what_they_cost(monkeypatch):
    listing = "x :\nsection size addr\n.text 10 0\n.text.hot 1 0\n.rodata.cst4 5 0\n.bss 7 0\n"
    listing += ".data 2 0\n.comment 99 0\n.srodata 20 0\n.sbss.x 30 0\n.sdata 40 0\n"
    listing += ".tdata 50 0\n.tbss 60 0\nTotal 324\n"
    monkeypatch.setattr(target, "run", lambda *_: listing)
    sizes = target.sizes(target.CORES["m3"], Path("image"))
    assert sizes == {"code": 11, "const": 25, "static": 189}
    monkeypatch.setattr(target, "link_path", lambda core, path: path)
    monkeypatch.setattr(target, "sizes", lambda core, path: dict.fromkeys(sizes, path))
    assert target.measure_sizes(target.CORES["m3"]) == {
        f"{kind}_bytes{suffix}": path
        for kind in sizes
        for suffix, path in (("", "q30"), ("_counts", "counts"), ("_angle", "angle"))
    }


def test_a_command_that_fails_or_hangs_is_told():
    with pytest.raises(target.BenchError, match="why not"):
        target.run("sh", "-c", "echo why not >&2; exit 1")
    with pytest.raises(target.BenchError, match=r"did not end within 0\.1 s"):
        target.run("sleep", "9", timeout=0.1)
    with pytest.raises(target.BenchError, match="no-such-program is not installed"):
        target.run("no-such-program")


def test_fewest_parts_is_the_first_power_of_two_that_is_enough(monkeypatch):
    for enough, found in ((1, 1), (3, 4), (4096, 4096), (4097, 0)):
        error = lambda way, parts, *_, n=enough: 1e-3 if parts >= n else 2e-3  # noqa: E731
        monkeypatch.setattr(host, "solver_error", error)
        assert host.fewest_parts("euler_parts", 1e-3) == found


def test_errors_keep_their_motion_way_and_order(monkeypatch):
    row = {"scenario": "walk", "way": "euler", "worst": "nan", "rms": "1.5e-3"}
    monkeypatch.setattr(host, "rows", lambda *_: [row, row | {"way": "rk4", "worst": "2e-9"}])
    wanted = {"walk": {"euler": [host.DIVERGED, 1.5e-3], "rk4": [2e-9, 1.5e-3]}}
    assert host.measure_errors(host.QUICK) == wanted
    assert host.number("inf") == host.DIVERGED


def test_times_from_python_are_of_a_tick(monkeypatch, library):
    """One second for each piece of work stands for its ticks; the work is done."""
    done = []
    monkeypatch.setattr(host, "best_time", lambda work, *_: float(bool(done.append(work()) or 1)))
    assert host.measure_python() == {
        "step_ns": pytest.approx(1e9 / len(done[0])),
        "batch_ns": pytest.approx(1e9 / len(done[1])),
        "throughput_ns": pytest.approx(1e9 / len(done[2])),
        "empty_batch_ns": pytest.approx(1e9),
    }
    assert np.abs(done[1] - done[2]).max() < 1e-6
    assert done[1][: len(done[0])] == pytest.approx(done[0], abs=1e-7)
    assert 0.1 < np.abs(done[1]).max() < host.FC


def test_the_best_time_is_the_least_of_all_rounds(monkeypatch):
    times = iter([0.0, 5.0, 10.0, 12.0, 20.0, 24.0])
    monkeypatch.setattr(host, "perf_counter", lambda: next(times))
    assert host.best_time(lambda: None, 3) == 2.0


# --- rivals from outside --------------------------------------------------------------------------


@pytest.fixture
def task() -> dict:
    """399 moves of 0.002 rad, a long one, and the exact answer of Eq. 1."""
    moves = [3] * 200 + [-40] + [-2] * 199
    exact, w = [], 0.0
    for move in moves:
        s = np.sign(move)
        w = s + (w - s) * np.exp(-200 * abs(move) * 1e-3)
        exact.append(w)
    scenario = {"theta": 1e-3, "moves": moves, "exact": exact}
    return {"scenarios": {"a": scenario}, "sigma0": 100.0, "Fc": 0.5, "solved": 300}


def test_scipy_follows_the_model(task):
    found = outside.measure(outside.scipy_way, task)
    assert found["scenarios"]["a"][0] < 1e-7
    assert found["ticks"] == 300
    assert 1e3 < found["ns"] < 1e8


def test_errors_are_worst_and_rms():
    assert outside.errors([1.0, 2.0, 5.0], [1.0, 6.0, 2.0]) == [4.0, pytest.approx((25 / 3) ** 0.5)]


@pytest.mark.checks
def test_a_rival_that_is_not_here_is_named_and_stops_no_other(task):
    own = ROOT / "build/bench/venv/bin/python"
    done = subprocess.run(
        [own if own.exists() else sys.executable, ROOT / "tools/bench/outside.py"],
        input=json.dumps(task),
        capture_output=True,
        text=True,
        check=True,
    )
    found = json.loads(done.stdout.splitlines()[-1])
    assert list(found) == ["mujoco", "newton", "scipy"]
    assert found["scipy"]["scenarios"]["a"][1] < 1e-7
    for name in ("mujoco", "newton"):
        one = found[name]
        assert "missing" in one or (one["ticks"] == 400 and one["scenarios"]["a"][0] < 0.2)


# --- what an identification costs ----------------------------------------------------------------


@pytest.mark.checks
def test_the_cost_of_an_identification_is_told():
    """Both fits find the parameters; the ratio is the rival's time over ours."""
    words = [sys.executable, ROOT / "tools/bench/identify.py", "--rows", "3000", "--short", "1000"]
    done = subprocess.run(words, capture_output=True, text=True, check=True, timeout=200)
    ours, theirs, long = done.stdout.splitlines()
    assert ours.startswith("1000 rows: ") and long.startswith("3000 rows: ")
    found = [
        [float(x) for x in re.search(r"sigma0 ([\d.]+), Fc ([\d.]+)", line).groups()]
        for line in (ours, theirs)
    ]
    assert found[0] == pytest.approx([100, 0.5], rel=0.1)
    assert found[1] == pytest.approx(found[0], rel=2e-3)
    seconds = [float(re.search(r" ([\d.]+) s,", line)[1]) for line in (ours, theirs)]
    ratio = float(re.search(r"ratio (\d+)", theirs)[1])
    assert ratio == pytest.approx(seconds[1] / seconds[0], rel=0.05, abs=0.6)
