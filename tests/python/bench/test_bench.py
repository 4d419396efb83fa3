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


def test_calls_from_python_are_measured_without_numba_and_jax(bench) -> None:
    calls = bench.get("host")["calls"]
    costs = [calls["single"].values(), *calls["logs"]["ns"].values()]
    assert min(map(min, costs)) > 0 and len(calls["logs"]["ns"]["friction"]) == 4
    assert calls["logs"]["missing"].keys() == {"numba", "jax_double"}


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
    for name in ("target", "cycles", "worst", "short", "speed"):
        assert now[name] == before[name]
    (head, there), (now_head, here) = rows_of(before["ways"]), rows_of(now["ways"])
    assert (now_head, list(here)) == (head, list(there))
    for way, (*found, m0, m3, m4f) in here.items():
        assert [m0, m3, m4f] == there[way][2:], way
        for pair in zip(found, there[way], strict=False):
            numbers = [9.9 if e == "diverges" else float(e) for e in pair]
            assert max(numbers) < 1.6 * min(numbers), way
    assert now["ways"].splitlines()[-1] == before["ways"].splitlines()[-1]


BLOCKS = [("docs/microcontroller.md", name) for name in ("target", "cycles", "worst")]
BLOCKS += [("README.md", "short"), ("docs/speed.md", "speed"), ("docs/speed.md", "ways")]

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


def test_host_bench_refuses_an_unknown_motion(bench) -> None:
    command = [HOST_BENCH, "growth", "no_such_motion", "100"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 2 and done.stderr.startswith("error: ")


def test_both_identifications_find_the_parameters() -> None:
    script = ROOT / "tools/bench/identify.py"
    printed = run(sys.executable, script, "--rows", "3000", "--short", "1000")
    ours, theirs, _ = re.findall(r"sigma0 ([\d.]+), Fc ([\d.]+)", printed) + [None]
    assert [*map(float, ours)] == pytest.approx([SIGMA0, FC], rel=0.1)
    assert [*map(float, theirs)] == pytest.approx([*map(float, ours)], rel=2e-3)
