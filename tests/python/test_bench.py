# SPDX-License-Identifier: MIT
"""Speed against error: what the commands count and measure, against limits and references."""

from __future__ import annotations

import dataclasses
import json
import math
import re
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tools" / "bench"))

import figures  # noqa: E402
import host  # noqa: E402
import measured as models  # noqa: E402
import report  # noqa: E402
import results  # noqa: E402
import table  # noqa: E402
import target  # noqa: E402
from dahl import reference  # noqa: E402
from test_bench_report import rows_of  # noqa: E402

pytestmark = pytest.mark.checks


BUDGETS = json.loads((ROOT / "tests/target/budgets.json").read_text())


@pytest.fixture(scope="module")
def bench() -> dict[str, dict]:
    """tools/bench.sh target, all cores, counted now; a core without its tools is left out."""
    names = [
        n
        for n, c in target.CORES.items()
        if shutil.which(c.tool("gcc")) and shutil.which(c.tools[1])
    ]
    if not names:
        pytest.skip("no cross compiler with its QEMU is installed")
    result = target.measure_all(names, quick=False)
    target.write_result(result)
    return result


@pytest.fixture(scope="module")
def counted(bench) -> dict:
    """The three cores of the chart."""
    return {name: of_core(bench, name) for name in results.CORES}


@pytest.fixture(scope="module")
def measured() -> dict:
    """What is the same on every machine: errors, and parts that solvers need."""
    host.build()
    errors = host.measure_errors(host.QUICK)
    parts = host.measure_parts(host.QUICK, list(errors))
    return {"errors": errors, "parts": parts}


def test_no_rival_is_cheaper_and_better_on_any_core(counted, measured) -> None:
    for core in results.CORES:
        assert results.beaten(results.core_points(counted, measured, core), core) == []


def test_ours_is_within_its_bound_on_every_motion(measured) -> None:
    ulp = 2.0**-23  # of Fc = 0.5, over Fc
    for motion, ways in measured["errors"].items():
        assert ways["counts_q30"][0] <= 9.4e-10, motion
        for way in ("counts", "batch_counts", "throughput_counts", "throughput_angle"):
            assert ways[way][0] <= 0.52 * ulp, (motion, way)


def test_a_tick_costs_at_most_one_and_a_half_of_euler(counted) -> None:
    motions = results.motions_of(counted, "m4f")
    assert motions["two_one_24"]["counts_q30"] <= 1.5 * motions["two_one_24"]["euler"]
    for ways in motions.values():  # and none can do without a load, a multiplication and a store
        assert 3 <= ways["floor"] < 0.5 * min(ways[way] for way in ways if way != "floor")


def shown(page: str, marks: tuple[str, str]) -> str:
    """What a page has between two marks, these included."""
    text = (ROOT / page).read_text()
    return text[text.index(marks[0]) : text.index(marks[1])] + marks[1]


def test_the_pages_show_what_is_counted_now(bench, counted, measured) -> None:
    """Each count to the instruction, where the compilers are those of the page; errors to the digit
    that libm leaves open. Else: tools/bench.sh target && tools/bench.sh host && tools/bench.sh docs
    """
    page = shown("docs/microcontroller.md", table.MARKS)
    if bench.keys() != target.CORES.keys() or any(
        c["compiler"] not in page for c in bench.values()
    ):
        pytest.skip("the pages are of all cores and of other compilers")
    assert page == table.markdown(bench)
    assert shown("README.md", table.SHORT_MARKS) == table.short(bench)
    assert models.block({}, bench).splitlines()[3] in shown("docs/speed.md", models.MARKS)
    block = report.ways_table(counted, measured)
    (head, there), (now_head, now) = map(
        rows_of, (shown("docs/speed.md", report.WAYS_MARKS), block)
    )
    assert (now_head, list(now)) == (head, list(there))
    for way, (*errors, m0, m3, m4f) in now.items():
        assert [m0, m3, m4f] == there[way][2:], way
        for error, before in zip(errors, there[way], strict=False):
            numbers = [9.9 if e == "diverges" else float(e) for e in (error, before)]
            assert max(numbers) < 1.6 * min(numbers), way
    assert block.splitlines()[-2] in shown("docs/speed.md", report.WAYS_MARKS)


# --- what a call costs: tests/target/budgets.json holds every limit -----------------------------


def of_core(bench: dict[str, dict], name: str) -> dict:
    if name not in bench:
        pytest.skip(f"no tools for {name}")
    return bench[name]


LIMITS = [
    (n, k, limit)
    for n, limits in BUDGETS["instructions at most"].items()
    for k, limit in limits.items()
]
BYTES = BUDGETS["bytes at most"]
LIMITS += [(n, k, limit) for n in sorted(BYTES.keys() - {"all"}) for k, limit in BYTES[n].items()]
LIMITS += [(n, k, limit) for n in target.CORES for k, limit in BYTES["all"].items()]


@pytest.mark.parametrize("name, key, limit", LIMITS)
def test_budget(bench, name: str, key: str, limit: int) -> None:
    assert of_core(bench, name)[key] <= limit


@pytest.mark.parametrize(
    "name, least", BUDGETS["newlib_expm1f over one_count_q30 at least"].items()
)
def test_ratio(bench, name: str, least: float) -> None:
    core = of_core(bench, name)
    assert core["newlib_expm1f"] >= least * core["one_count_q30"]


@pytest.mark.parametrize("name", target.CORES)
def test_dense_moves_cost_the_same(bench, name: str) -> None:
    core = of_core(bench, name)
    assert (
        core["dense_q30_most"] - core["dense_q30_least"]
        <= BUDGETS["dense moves differ by at most"][name]
    )


# --- what host_bench prints ----------------------------------------------------------------------

BLOCKS = 24  # of 4096 ticks, next to 1e5


def rows_by(rows: list[dict], *keys: str) -> dict:
    return {tuple(row[key] for key in keys): row for row in rows}


def test_moves_come_with_the_exact_torque(measured) -> None:
    """Against a reference in 100 bits: the motion's encoder, sigma0, Fc and sign."""
    for name, scenario in host.outside_task(host.QUICK)["scenarios"].items():
        a_theta = reference.travel_per_count(host.SIGMA0, host.FC, scenario["theta"])
        exact = reference.exact_ratios(scenario["moves"][:2000], a_theta)
        assert scenario["exact"][:2000] == pytest.approx([float(w) for w in exact], abs=1e-14), name
        assert len(scenario["moves"]) == host.QUICK.outside


def test_one_part_is_the_plain_solver(measured) -> None:
    errors = rows_by(host.rows("errors", 8192), "scenario", "way")
    for solver in ("euler", "rk4"):
        [parts] = host.rows("parts-error", f"{solver}_parts", 1, "sine_16", 8192)
        plain = errors["sine_16", solver]
        assert (parts["worst"], parts["rms"]) == (plain["worst"], plain["rms"])
        assert 0 < float(plain["rms"]) < float(plain["worst"])
        [many] = host.rows("parts-error", f"{solver}_parts", 16, "sine_16", 8192)
        assert float(many["worst"]) < float(plain["worst"]) / 10


def test_growth_passes_through_the_errors_of_a_run(measured) -> None:
    grown = rows_by(host.rows("growth", "walk_20", 10**5), "way", "ticks")
    around = [
        rows_by(host.rows("errors", 4096 * blocks), "scenario", "way")
        for blocks in (BLOCKS, BLOCKS + 1)
    ]
    for way in figures.GROWTH_TITLES:
        least, most = (float(errors["walk_20", way]["worst"]) for errors in around)
        errors = [float(grown[way, 10**n]["worst"]) for n in (2, 3, 4, 5)]
        assert errors == sorted(errors)
        assert 0.999 * least <= errors[-1] <= 1.001 * most


def error_of_euler(rate: int, parts: int) -> float:
    """Worst on two turns of 0.1 rad at 1 Hz, by the closed form of Euler's parts of a tick."""
    travel = reference.travel_per_count(host.SIGMA0, host.FC, math.tau / 2**14)
    w = exact = worst = last = 0.0
    for k in range(1, 2 * rate + 1):
        place = round(2**14 / math.tau * 0.1 * math.sin(math.tau * k / rate))
        s, u = (1.0 if place > last else -1.0), float(travel) * abs(place - last)
        w, exact = s + (w - s) * (1 - u / parts) ** parts, s + (exact - s) * math.exp(-u)
        worst, last = max(worst, abs(w - exact)), place
    return worst


def test_parts_by_rate_are_the_fewest_that_are_enough(measured) -> None:
    """Half of them would err 16 times as much with RK4, less with the others."""
    few, many = (rows_by(host.rows("parts", rate, 1e-3), "way") for rate in (3000, 100))
    for row in (few["euler_parts",], many["euler_parts",]):
        error = error_of_euler(row["rate"], row["parts"])
        assert float(row["worst"]) == pytest.approx(error, rel=0.01)
    assert {row["parts"] for row in host.rows("parts", 100, 1e-12)} == {0}  # beyond a float
    for way, row in many.items():
        assert row["rate"] == 100 and 1 <= few[way]["parts"] < row["parts"]
        for found in (row, few[way]):
            assert 1e-3 / 20 < float(found["worst"]) <= 1e-3 or found["parts"] == 1


@pytest.mark.parametrize(
    ("ways", "least", "most"),
    [
        (("euler", "backward_parts"), 1e-2, 1e-1),
        (("trapezoid_parts",), 5e-4, 5e-3),
        (("rk4",), 1e-6, 1e-5),
        (("table",), 1e-3, 1e-2),
        (("expm1f", "expf", "exp_double", "expm1_double", "anchored", "direct"), 2e-8, 1e-6),
        (("double_state", "table_counts"), 1e-8, 1e-6),
    ],
)
def test_rivals_err_as_it_is_their_way(measured, ways, least, most) -> None:
    """On a slow sine: by the order of a solver, the grid of a table, the rounding of a float."""
    for way in ways:
        assert least < measured["errors"]["sine_16"][way][0] < most, way


def test_speed_is_nanoseconds_a_tick(measured) -> None:
    """All rounds of all ways take what the best round of each says, and not much more."""
    ticks, rounds = 20_000, 15
    start = time.perf_counter()
    speed = host.measure_speed(dataclasses.replace(host.QUICK, speed=ticks))
    took = time.perf_counter() - start
    least = sum(ns for ways in speed.values() for ns in ways.values()) * ticks * rounds * 1e-9
    assert 0.1 * took < least < took


def test_a_bench_that_there_is_not_is_refused_before_anything_is_set_up() -> None:
    done = subprocess.run(
        [ROOT / "tools/bench.sh", "paint"], capture_output=True, text=True, check=False
    )
    assert done.returncode != 0 and "knows target, host, report and docs" in done.stderr


def test_host_bench_says_what_it_takes(measured) -> None:
    for arguments in (["nothing"], ["growth", "no_such_motion", "100"], []):
        done = subprocess.run(
            [host.PROGRAM, *arguments], capture_output=True, text=True, check=False
        )
        assert done.returncode == 2 and re.match("error: ", done.stderr)
