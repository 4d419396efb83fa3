# SPDX-License-Identifier: MIT
"""Speed against error: tools/bench.sh counts and measures on this machine; the results are compared
with limits and references. (The place of each number: test_bench_report.py.)
"""

from __future__ import annotations

import json
import math
import os
import re
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest
from bench_tools import SMALL, Bench, rows_of
from conftest import ROOT
from dahl.sim import reference

pytestmark = pytest.mark.checks

BUDGETS = json.loads((ROOT / "tests/target/budgets.json").read_text())
HOST_BENCH = ROOT / "build/host/tools/bench/host/host_bench"
SIGMA0, FC = 100.0, 0.5
TOOLS = {name: ("arm-none-eabi-gcc", "qemu-system-arm") for name in (*SMALL, "m7", "m33")}
TOOLS["rv32"] = ("riscv64-unknown-elf-gcc", "qemu-system-riscv32")
HERE = [name for name, tools in TOOLS.items() if all(map(shutil.which, tools))]


def run(*command: object) -> str:
    words = [str(word) for word in command]
    done = subprocess.run(words, capture_output=True, text=True, check=False, cwd=ROOT)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def bench(tmp_path_factory) -> Bench:
    """Run target and host in a copy, with the builds of the project; the user's results stay."""
    if not HERE:
        pytest.skip("unproven: what a tick costs: no cross compiler with its QEMU is installed")
    made = Bench(tmp_path_factory.mktemp("bench"))
    cmake = made.folder / "bin/cmake"
    cmake.parent.mkdir()
    cmake.write_text(f'#!/bin/sh\ncd "{ROOT}" && exec {shutil.which("cmake")} "$@"\n')
    cmake.chmod(0o755)
    for name in ("host", *HERE):
        (ROOT / "build" / name).mkdir(exist_ok=True)
        (made.folder / "build" / name).symlink_to(ROOT / "build" / name)
    (made.folder / "lib").symlink_to(ROOT / "lib")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PATH", f"{cmake.parent}:{os.environ['PATH']}")
        for command, words in (("target", HERE), ("host", ["--quick"])):
            done = made.run(command, *words)
            assert done.code == 0, done.err
    return made


@pytest.fixture(scope="module")
def cores(bench) -> dict[str, dict]:
    return bench.get("target")


@pytest.fixture(scope="module")
def errors(bench) -> dict[str, dict]:
    return bench.get("host")["errors"]


def of_core(cores: dict[str, dict], name: str) -> dict:
    if name not in cores:
        pytest.skip(f"unproven: what a tick costs: no tools for {name}")
    return cores[name]


def rows(*words: object) -> list[dict]:
    """Run host_bench and return its lines."""
    return [json.loads(line) for line in run(HOST_BENCH, *words).splitlines()]


def rows_by(rows: list[dict], *keys: str) -> dict:
    return {tuple(row[key] for key in keys): row for row in rows}


# --- speed against error -------------------------------------------------------------------------


def test_no_rival_is_cheaper_and_better_on_any_core(bench, cores) -> None:
    for name in SMALL:
        of_core(cores, name)
    assert bench.run("report").code == 0
    beaten = bench.get("results")["dominated"]
    assert [found for found in beaten if found["core"] in SMALL] == []


def test_ours_is_within_its_bound_on_every_motion(errors) -> None:
    ulp = 2.0**-23  # of Fc = 0.5, over Fc
    for motion, ways in errors.items():
        assert ways["counts_q30"][0] <= 9.4e-10, motion
        for way in ("counts", "batch_counts", "throughput_counts", "throughput_angle"):
            assert ways[way][0] <= 0.52 * ulp, (motion, way)


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
def test_other_methods_have_their_known_errors(errors, ways, least, most) -> None:
    """On a slow sine: the order of a solver, the grid of a table, the rounding of a float."""
    for way in ways:
        assert least < errors["sine_16"][way][0] < most, way


def test_the_pages_show_what_is_counted_now(bench, cores) -> None:
    """Compare counts exactly, if the compilers are those of the page, and errors within the digits
    that libm may change. After a change, run tools/bench.sh.
    """
    before = {name: bench.block(page, name) for page, name in BLOCKS}
    known = [core["compiler"] in before["target"] for core in cores.values()]
    if cores.keys() != TOOLS.keys() or not all(known):
        pytest.skip("unproven: the pages' numbers: they are of all cores and of other compilers")
    bench.put(host=bench.get("host") | {"quick": False})
    assert bench.run("report", "--docs").code == 0
    now = {name: bench.block(page, name) for page, name in BLOCKS}
    assert (now["target"], now["short"]) == (before["target"], before["short"])
    (head, there), (now_head, here) = rows_of(before["ways"]), rows_of(now["ways"])
    assert (now_head, list(here)) == (head, list(there))
    for way, (*found, m0, m3, m4f) in here.items():
        assert [m0, m3, m4f] == there[way][2:], way
        for pair in zip(found, there[way], strict=False):
            numbers = [9.9 if e == "diverges" else float(e) for e in pair]
            assert max(numbers) < 1.6 * min(numbers), way
    assert now["ways"].splitlines()[-1] == before["ways"].splitlines()[-1]


BLOCKS = [("docs/microcontroller.md", "target"), ("README.md", "short"), ("docs/speed.md", "ways")]

# --- what a call costs: tests/target/budgets.json holds every limit ------------------------------


@pytest.mark.parametrize("name", TOOLS)
def test_a_core_is_within_its_budgets(cores, name: str) -> None:
    core = of_core(cores, name)
    of_bytes = BUDGETS["bytes at most"]
    limits = BUDGETS["instructions at most"][name] | of_bytes[name] | of_bytes["all"]
    assert {key: core[key] for key, limit in limits.items() if core[key] > limit} == {}
    spread = core["dense_q30_most"] - core["dense_q30_least"]
    assert spread <= BUDGETS["dense moves differ by at most"][name]
    least = BUDGETS["newlib_expm1f over one_count_q30 at least"].get(name, 0)
    assert not least or core["newlib_expm1f"] >= least * core["one_count_q30"]


def test_a_tick_costs_at_most_one_and_a_half_of_euler(cores) -> None:
    motions = of_core(cores, "m4f")["motions"]["newlib"]
    assert motions["two_one_24"]["counts_q30"] <= 1.5 * motions["two_one_24"]["euler"]
    for ways in motions.values():  # each method needs a load, a multiplication and a store
        assert 3 <= ways["floor"] < 0.5 * min(ways[way] for way in ways if way != "floor")


# --- what host_bench prints ----------------------------------------------------------------------


def test_moves_come_with_the_exact_torque(bench) -> None:
    """Compare encoder, sigma0, Fc and sign with a reference in 100 bits."""
    for name in ("sweep_12", "two_one_24", "sine_12", "creep_18", "leap_14"):
        pairs = [line.split() for line in run(HOST_BENCH, "moves", name, 2000).splitlines()]
        assert len(pairs) == 2000
        theta = math.tau / 2 ** int(name[-2:])
        travel = reference.travel_per_count(SIGMA0, FC, float(f"{theta:.9g}"))
        exact = reference.exact_ratios([int(move) for move, _ in pairs], travel)
        printed = [float(w) for _, w in pairs]
        assert printed == pytest.approx([float(w) for w in exact], abs=1e-6), name


def test_one_part_is_the_plain_solver(bench) -> None:
    found = rows_by(rows("errors", 8192), "scenario", "way")
    for solver in ("euler", "rk4"):
        [parts] = rows("parts-error", f"{solver}_parts", 1, "sine_16", 8192)
        plain = found["sine_16", solver]
        assert (parts["worst"], parts["rms"]) == (plain["worst"], plain["rms"])
        assert 0 < float(plain["rms"]) < float(plain["worst"])
        [many] = rows("parts-error", f"{solver}_parts", 16, "sine_16", 8192)
        assert float(many["worst"]) < float(plain["worst"]) / 10


def test_growth_passes_through_the_errors_of_a_run(bench) -> None:
    """1e5 ticks lie between 24 and 25 blocks of 4096."""
    grown = rows_by(rows("growth", "walk_20", 10**5), "way", "ticks")
    around = [rows_by(rows("errors", 4096 * n), "scenario", "way") for n in (24, 25)]
    for way in dict.fromkeys(way for way, _ in grown):
        least, most = (float(found["walk_20", way]["worst"]) for found in around)
        worst = [float(grown[way, 10**n]["worst"]) for n in (2, 3, 4, 5)]
        assert worst == sorted(worst)
        assert 0.999 * least <= worst[-1] <= 1.001 * most


def error_of_euler(rate: int, parts: int) -> float:
    """Return the worst error on two turns of 0.1 rad at 1 Hz, by the closed form of Euler."""
    travel = float(reference.travel_per_count(SIGMA0, FC, math.tau / 2**14))
    w = exact = worst = last = 0.0
    for k in range(1, 2 * rate + 1):
        place = round(2**14 / math.tau * 0.1 * math.sin(math.tau * k / rate))
        s, u = (1.0 if place > last else -1.0), travel * abs(place - last)
        w, exact = s + (w - s) * (1 - u / parts) ** parts, s + (exact - s) * math.exp(-u)
        worst, last = max(worst, abs(w - exact)), place
    return worst


def test_parts_by_rate_are_the_fewest_that_are_enough(bench) -> None:
    """With half the parts, the error of RK4 is 16 times as large; the other factors are smaller."""
    few, many = (rows_by(rows("parts", rate, 1e-3), "way") for rate in (3000, 100))
    for row in (few["euler_parts",], many["euler_parts",]):
        error = error_of_euler(row["rate"], row["parts"])
        assert float(row["worst"]) == pytest.approx(error, rel=0.01)
    assert {row["parts"] for row in rows("parts", 100, 1e-12)} == {0}  # too small for a float
    for way, row in many.items():
        assert row["rate"] == 100 and 1 <= few[way]["parts"] < row["parts"]
        for found in (row, few[way]):
            assert 1e-3 / 20 < float(found["worst"]) <= 1e-3 or found["parts"] == 1


def test_speed_is_nanoseconds_a_tick(bench) -> None:
    """The rounds of all methods need at least the time of the best rounds, and not much more."""
    ticks, rounds = 20_000, 15
    start = time.perf_counter()
    speed = rows("speed", ticks)
    elapsed = time.perf_counter() - start
    least = sum(row["ns"] for row in speed) * ticks * rounds * 1e-9
    assert 0.1 * elapsed < least < elapsed


@pytest.mark.parametrize("words", [["nothing"], ["growth", "no_such_motion", "100"], []])
def test_host_bench_refuses_unknown_words(bench, words) -> None:
    done = subprocess.run([HOST_BENCH, *words], capture_output=True, text=True, check=False)
    assert done.returncode == 2 and done.stderr.startswith("error: ")


def test_the_cost_of_an_identification_is_printed() -> None:
    """Both fits find the parameters; the ratio is the time of solve_ivp over ours."""
    script = Path(ROOT / "tools/bench/identify.py")
    ours, theirs, long = run(
        sys.executable, script, "--rows", "3000", "--short", "1000"
    ).splitlines()
    assert ours.startswith("1000 rows: ") and long.startswith("3000 rows: ")
    found = [
        [float(x) for x in re.search(r"sigma0 ([\d.]+), Fc ([\d.]+)", line).groups()]
        for line in (ours, theirs)
    ]
    assert found[0] == pytest.approx([SIGMA0, FC], rel=0.1)
    assert found[1] == pytest.approx(found[0], rel=2e-3)
    seconds = [float(re.search(r" ([\d.]+) s,", line)[1]) for line in (ours, theirs)]
    ratio = float(re.search(r"ratio (\d+)", theirs)[1])
    assert ratio == pytest.approx(seconds[1] / seconds[0], rel=0.05, abs=0.6)
