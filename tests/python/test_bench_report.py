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


# --- all that is written, of these numbers -------------------------------------------------------

NUMBER = r"-?\d[\d,]*\.?\d*(?:e[-+]?\d+)?"
GOLDEN = Path(__file__).with_name("golden_bench.json")


def drawn(figure) -> list:
    """Names of each legend, and of each panel: scales, limits, units, lines and labels."""
    found = [[text.get_text() for text in legend.get_texts()] for legend in figure.legends]
    for axes in figure.axes:
        lines = [
            [x.get_color(), x.get_linestyle(), x.get_marker(), x.get_drawstyle(), *x.get_data()]
            for x in axes.lines
        ]
        labels = [(t.get_text(), t.get_color(), t.xy) for t in axes.texts if t.get_text()[0] != " "]
        units = [
            re.match(r"\w*( a \w+)?", word)[0] for word in (axes.get_xlabel(), axes.get_ylabel())
        ]
        own = axes.get_legend()
        named = [text.get_text() for text in own.get_texts()] if own else axes.get_title("left")
        scales = (axes.get_xscale(), axes.get_yscale(), axes.get_ylim() if not own else None)
        found.append((units, named, scales, lines, labels))
    return found


def rounded(value):
    """As JSON keeps it, numbers to 6 digits."""
    if isinstance(value, dict):
        return {str(key): rounded(one) for key, one in value.items()}
    if isinstance(value, list | tuple | np.ndarray):
        return [rounded(one) for one in value]
    number = isinstance(value, float | np.number)
    return float(f"{float(value):.6g}") if number else value


def test_each_number_stands_where_it_belongs(counted, measured, capsys, tmp_path):
    """In tables, words, results and pictures; one rival is both cheaper and better somewhere. Each
    was compared with sums made beside it when the file was written.
    """
    counted["m3"]["motions"]["newlib"]["sine_12"]["rk4"] = 1.0
    measured["errors"]["sine_12"]["rk4"][0] = 1e-12
    result = results.combine(counted, measured)
    report.show(result)
    page = table.markdown(counted)
    blocks = (page, table.short(counted), report.ways_table(counted, measured))
    told = {
        "result": result,
        "shown": re.findall(NUMBER, capsys.readouterr().out),
        "helpers": re.findall(r"`(__\w+)`", page),
        "words": [re.findall(NUMBER, text) for text in (report.host_block(result), blocks[2])],
        "tables": [[head, list(rows.values())] for head, rows in map(rows_of, blocks)],
        "pictures": [drawn(draw(counted, measured)) for draw in (figures.pareto, figures.growth)],
    }
    new = tmp_path / GOLDEN.name
    parts = (f"{json.dumps(key)}: {json.dumps(value)}" for key, value in rounded(told).items())
    new.write_text("{" + ",\n".join(parts) + "}\n")
    assert json.loads(new.read_text()) == json.loads(GOLDEN.read_text()), (
        f"meant? cp {new} {GOLDEN}"
    )


def test_what_was_not_measured_is_not_told(counted, measured):
    del measured["mixes"]
    measured["outside"] = measured["outside"] | {"mujoco": {"missing": "no wheel"}}
    block = report.host_block(results.combine(counted, measured))
    assert "parallel" not in block and "mj_step" not in block
    assert "not compared here: mujoco (no wheel)" in block and "newton (not here)" in block
    assert [report.shown_error(x) for x in (3.0, 3.1)] == ["3e+00", "diverges"]


def test_what_threads_bring(counted, measured, monkeypatch):
    """One thread's time over theirs; every number of threads is run, over the same moves."""
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


def test_points_that_are_close_in_both_and_of_one_side_share_a_label():
    made = {"a": (10, 1e-3), "b": (15, 1.4e-3), "dear": (30, 1e-3), "bad": (10, 1e-2)}
    points = [point(key, False, *place) for key, place in made.items()]
    found = figures.clusters([*points, point("ours", True, 10, 1e-3)])
    assert sorted("".join(p.key for p in group) for group in found) == ["ab", "bad", "dear", "ours"]


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
