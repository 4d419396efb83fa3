# SPDX-License-Identifier: MIT
"""tools/bench.sh report and docs place each number in its row, column, point and page. All numbers
of the made-up run are different.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from bench_tools import (
    BATCHES,
    CALLS,
    DIRECTED,
    HOST_NAMES,
    JUMPS,
    KEYS,
    MOTIONS,
    RIVALS,
    SMALL,
    Bench,
    made_host,
    made_target,
    rows_of,
)

TOP = 3.0  # larger errors are shown as diverging


@pytest.fixture(scope="module")
def made() -> tuple[dict, dict]:
    return made_target(), made_host()


@pytest.fixture(scope="module")
def docs(made, tmp_path_factory):
    """Run `docs` once, with pictures."""
    bench = Bench(tmp_path_factory.mktemp("bench"))
    bench.put(target=made[0], host=made[1])
    return bench, bench.run("report", "--docs", draw=True)


@pytest.fixture
def bench(tmp_path) -> Bench:
    """A copy with the files of a run."""
    bench = Bench(tmp_path)
    bench.put(target=made_target(), host=made_host())
    return bench


# --- an independent account of the same files ----------------------------------------------------


def points_of(target: dict, host: dict) -> dict[str, dict[str, dict]]:
    """Return cost and error by motion of each method, on each core and on the host."""
    errors = {
        way: {m: host["errors"][m][HOST_NAMES.get(way, way)][0] for m in MOTIONS}
        for way in (*CALLS, *BATCHES, *RIVALS, "double_state")
    }
    points: dict[str, dict[str, dict]] = {}
    for core in SMALL:
        counted = target[core]["motions"]["newlib"]
        found = {w: ({m: counted[m][w] for m in MOTIONS}, errors[w]) for w in (*CALLS, *RIVALS)}
        line = {m: 2 * ways["rk4_parts_17"] - ways["rk4_parts_9"] for m, ways in counted.items()}
        found["rk4_25"] = line, dict.fromkeys(MOTIONS, 3e-7)  # 25 parts: as far from 17 as 9 is
        points[core] = found
    points["host"] = {
        way: ({m: host["speed"][m][HOST_NAMES.get(way, way)] for m in MOTIONS}, errors[way])
        for way in (*BATCHES, *RIVALS, "double_state")
    }
    points["host"]["mujoco"] = {"walk_20": 6000.0}, {"walk_20": 1e-4}
    return {
        place: {
            way: {"cost": cost, "error": error, "ours": way in (*CALLS, *BATCHES)}
            for way, (cost, error) in found.items()
        }
        for place, found in points.items()
    }


def mean_cost(point: dict) -> float:
    return float(np.mean([cost for motion, cost in point["cost"].items() if motion != JUMPS]))


def worst(point: dict) -> float:
    return max(error for motion, error in point["error"].items() if motion != JUMPS)


def shown(error: float) -> str:
    return "diverges" if error > TOP else f"{error:.0e}"


# --- results.json and the terminal ---------------------------------------------------------------


def test_the_results_keep_cost_and_error_of_each_way(made, docs):
    """Means over the motions and the worst of them, without the giant jumps."""
    result = docs[0].get("results")
    target, host = made
    points = points_of(target, host)
    assert {place: set(ways) for place, ways in result["points"].items()} == {
        place: set(ways) for place, ways in points.items()
    }
    for place, ways in points.items():
        for way, point in ways.items():
            found = result["points"][place][way]
            assert found["cost"] == pytest.approx(mean_cost(point), abs=0.01), (place, way)
            assert found["worst"] == worst(point) and found["ours"] == point["ours"], way
    assert result["python"] == host["python"] and result["missing"] == {"newton": "not here"}
    assert result["machine"] == {k: host[k] for k in ("cpu", "compiler", "quick", "ticks")}


def test_the_ratios_are_over_the_plain_loop(made, docs):
    """Geometric means and least values over all motions; times of other programs over ours."""
    speed, ratios = made[1]["speed"], docs[0].get("results")["host"]
    block = docs[0].block("docs/speed.md", "host")
    wanted = {}
    for name, way in {
        "bitwise_counts": "batch_counts",
        "bitwise_channels16": "batch_counts_16",
        "bitwise_channels16_apart": "batch_counts_16_apart",
        "throughput_counts": "throughput_counts",
        "throughput_angle": "throughput_angle",
        "throughput_channels16": "throughput_counts_16",
        "throughput_channels16_apart": "throughput_counts_16_apart",
        "throughput_angle_channels16": "throughput_angle_16",
    }.items():
        over = [ways["expm1f"] / ways[way] for ways in speed.values()]
        wanted |= {f"{name}_x": np.prod(over) ** 0.25, f"{name}_x_least": min(over)}
    in_words = [x for name, x in wanted.items() if "angle_channels" not in name]
    printed = [float(x) for x in re.findall(r"\d+\.\d", block.partition("plain copy")[0])]
    assert printed == pytest.approx(in_words, abs=0.056)
    for name, way in (("copy_x", "counts"), ("copy_channels16_x", "counts_16")):
        wanted[name] = np.mean([w[f"throughput_{way}"] / w["copy"] for w in speed.values()])
    copies = re.search(r"plain copy\D+(\d+) times\D+(\d+) times", block)
    assert [*copies.groups()] == [f"{wanted[k]:.0f}" for k in ("copy_x", "copy_channels16_x")]
    slips = dict(zip(("slip_1", "slip_2", "slip_4", "slip_8", "mix"), range(5), strict=True))
    wanted |= {f"{name}_throughput_x": (10 * k + 5) / 2 for name, k in slips.items()}
    wanted |= {"threads_1_x": 1.0, "threads_2_x": 1.5, "threads_8_x": 6.0}
    wanted |= {"mujoco_x": 3000.0, "mujoco_batch_x": 2000.0, "mujoco_step_x": 12.0}
    assert ratios == pytest.approx(wanted, abs=0.006)
    for words in (
        r"parallel_counts`.* 2\.5, 7\.5, 12\.5, 17\.5; .* 22\.5$",
        r"threads=2.* 1\.5 times .* 7,000 ticks",
        r"`Throughput\.run_counts` is 3000 times.* 2000 times .* 12\.0 times",
        r"newton \(not here\)",
        r"^a processor, a compiler; ",
    ):
        assert re.search(words, block, re.M), words


def test_a_dominated_method_is_reported(bench):
    """A method is both cheaper and better in one motion on one core. An error within 5 % of ours is
    equal.
    """
    target, host = made_target(), made_host()
    counted = target["m3"]["motions"]["newlib"]["sine_12"]
    counted["rk4"] = counted["expf"] = 1.0
    host["errors"]["sine_12"]["rk4"][0] = 1e-12
    host["errors"]["sine_12"]["expf"][0] = 0.96 * host["errors"]["sine_12"]["counts"][0]
    bench.put(target=target, host=host)
    done = bench.run("report")
    wanted = [
        {"core": place, "motion": motion, "ours": our, "rival": rival}
        for place, points in points_of(target, host).items()
        for our, p in points.items()
        for rival, r in points.items()
        for motion in p["cost"].keys() & r["error"].keys()
        if p["ours"] and not r["ours"] and r["cost"][motion] < p["cost"][motion]
        and r["error"][motion] < 0.95 * p["error"][motion]
    ]  # fmt: skip
    found = bench.get("results")["dominated"]
    order = lambda one: sorted(one.items())  # noqa: E731
    assert sorted(found, key=order) == sorted(wanted, key=order)
    assert {"core": "m3", "motion": "sine_12", "ours": "counts", "rival": "rk4"} in found
    assert not any(one["rival"] == "expf" and one["ours"] == "counts" for one in found)
    assert done.out.count("beaten: {") == len(found)
    assert re.search(rf"of our points, {len(found)} ", done.out)


# --- tables of the pages -------------------------------------------------------------------------

# Words that the title of a row must have, by the words of its key.
IN_TITLE = {word: word for word in """prepare slip parallel work tip newlib picolibc
    expm1f expf double euler rk4 code const static plan state stack between below units control
    reversal jump q30 1000""".split()}  # fmt: skip
IN_TITLE |= {name: name for name in DIRECTED}
IN_TITLE |= {
    "eight": "8",
    "encoder": "reading",
    "loaded": "load",
    "float": "n m",
    "one": "one count",
}
IN_TITLE |= {
    "c": "by the c",
    "zero": "no motion",
    "worst": "worst",
    "table": "table",
    "set": "set_torque",
}


def test_each_count_is_in_its_row_and_core(made, docs):
    target = made[0]
    block = docs[0].block("docs/microcontroller.md", "target")
    cores, rows = rows_of(block)
    assert cores == [core["core"] for core in target.values()]
    keys = {tuple(str(c.get(key, "-")) for c in target.values()): key for key in KEYS}
    assert len(rows) > 60
    assert len({keys[tuple(cells)] for cells in rows.values()}) == len(rows)
    for title, cells in rows.items():
        words = {IN_TITLE[word] for word in keys[tuple(cells)].split("_") if word in IN_TITLE}
        words -= {"q30"} if "the same" in title else set()
        assert all(word in title.lower() for word in words), (title, words)
    for name, core in target.items():
        assert re.search(rf"{core['core']} `__help_{name}` \(.*?: no function\)", block)
    assert "cc 1" in block


def test_the_ways_with_error_jumps_and_mean_cost(made, docs):
    block = docs[0].block("docs/speed.md", "ways")
    head, rows = rows_of(block)
    points = points_of(*made)
    assert head[2:] == ["Core m0", "Core m3", "Core m4f"] and len(rows) == len(points["m0"])
    wanted = {}
    for way, point in points["m0"].items():
        errors = [shown(worst(point)), shown(point["error"][JUMPS])]
        wanted[(*errors, *(f"{mean_cost(points[c][way]):.0f}" for c in SMALL))] = way
    assert {tuple(cells): title.startswith("**") for title, cells in rows.items()} == {
        cells: way in CALLS for cells, way in wanted.items()
    }
    titles = {wanted[tuple(cells)]: title.strip("*") for title, cells in rows.items()}
    for way in ("expm1f", "expf", "euler", "rk4", "backward", "trapezoid", "anchored", "table"):
        assert way in titles[way].lower()
    assert titles["counts"] == "`dahl_step_counts`" and titles["rk4_25"] == "RK4, 25 parts"
    assert re.search(r"4096 .*: backward Euler 1e-06, trapezoid 1e-03\.$", block, re.M)


# --- files ---------------------------------------------------------------------------------------


def test_the_docs_get_the_pictures_and_nothing_else_changes(docs):
    bench, done = docs
    assert done.code == 0 and "tribometer" in done.out  # its log is missing
    for name in ("pareto", "growth"):
        picture = (bench.folder / f"docs/pictures/{name}.png").read_bytes()
        assert picture == (bench.folder / f"build/bench/{name}.png").read_bytes()
        assert picture[:4] == b"\x89PNG"
        drawing = (bench.folder / f"build/bench/{name}.svg").read_text()
        assert "<svg" in drawing and "<dc:date>" not in drawing  # equal runs give equal files
    root = Path(__file__).parents[2]
    for page in ("README.md", "docs/microcontroller.md", "docs/speed.md"):
        around = [
            re.sub(r"(<!-- bench:(?!measured)\w+ -->).*?(<!-- /)", r"\1\2", text, flags=re.S)
            for text in ((folder / page).read_text() for folder in (root, bench.folder))
        ]
        assert around[0] == around[1]
    assert not list((bench.folder / "build/bench").glob(".*"))


@pytest.mark.parametrize("part", ["host", "target", "cores"])
def test_a_part_of_a_run_is_not_for_the_docs(bench, part):
    """A table with fewer columns or empty cells must not replace a complete one."""
    target = made_target()
    if part == "host":
        bench.put(host=made_host() | {"quick": True})
    elif part == "cores":
        bench.put(target={core: target[core] for core in SMALL})
    else:
        for core in target.values():
            core["motions"] = dict([*core["motions"].items()][:1])
        bench.put(target=target)
    pages = [path.read_text() for path in sorted(bench.folder.glob("**/*.md"))]
    assert bench.run("report").code == 0
    done = bench.run("report", "--docs")
    assert done.code == 2 and re.search(r"^error: build/bench/(host|target)\.json ", done.err)
    assert [path.read_text() for path in sorted(bench.folder.glob("**/*.md"))] == pages


@pytest.mark.parametrize("lacking", ["target", "host"])
def test_a_report_without_a_run_names_the_command(bench, lacking):
    (bench.folder / f"build/bench/{lacking}.json").unlink()
    done = bench.run("report")
    assert done.code == 2 and f"tools/bench.sh {lacking} " in done.err


@pytest.mark.parametrize("mark", ["<!-- bench:target -->", "<!-- /bench:target -->"])
def test_a_page_without_its_marks_is_an_error(bench, mark):
    page = bench.folder / "docs/microcontroller.md"
    text = page.read_text().replace(mark, "")
    page.write_text(text)
    done = bench.run("report", "--docs")
    assert done.code == 2 and "docs/microcontroller.md" in done.err and mark in done.err
    assert page.read_text() == text
