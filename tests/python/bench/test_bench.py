# SPDX-License-Identifier: MIT
"""Speed against error: tools/bench.sh counts and measures on this machine. The results are compared
with limits, references and the pages, which show the same numbers.
"""

from __future__ import annotations

import json
import math
import os
import re
import resource
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from conftest import ROOT
from dahl.sim import reference

BENCH = ROOT / "tools/bench"
BUDGETS = json.loads((ROOT / "tests/target/budgets.json").read_text())
HOST_BENCH = ROOT / "build/host/tools/bench/host/host_bench"
SIGMA0, FC = 100.0, 0.5
SMALL = ("m0", "m3", "m4f")
TOOLS = {name: ("arm-none-eabi-gcc", "qemu-system-arm") for name in (*SMALL, "m7", "m33")}
TOOLS["rv32"] = ("riscv64-unknown-elf-gcc", "qemu-system-riscv32")
HERE = [name for name, tools in TOOLS.items() if all(map(shutil.which, tools))]
PAGES = ("README.md", "docs/microcontroller.md", "docs/speed.md")
EXACT = [("docs/microcontroller.md", name) for name in ("target", "cycles", "worst")]
EXACT += [("README.md", "short"), ("docs/speed.md", "speed")]


def run(*command: object, **options: Any) -> subprocess.CompletedProcess[str]:
    words = [str(word) for word in command]
    return subprocess.run(words, capture_output=True, text=True, check=False, **options)


class Bench:
    """The commands of tools/bench in a copy of the project; the user's results stay."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        shutil.copytree(BENCH, folder / "tools/bench")
        (folder / "docs/pictures").mkdir(parents=True)
        (folder / "build/bench").mkdir(parents=True)
        for page in PAGES:
            shutil.copy(ROOT / page, folder / page)

    def run(self, command: str, *words: str) -> subprocess.CompletedProcess[str]:
        return run(sys.executable, self.folder / f"tools/bench/{command}.py", *words)

    def result(self, name: str) -> Path:
        return self.folder / f"build/bench/{name}.json"

    def get(self, name: str) -> Any:
        return json.loads(self.result(name).read_text())


def block_of(folder: Path, page: str, name: str) -> str:
    start, end = (f"<!-- {slash}bench:{name} -->\n" for slash in ("", "/"))
    return (folder / page).read_text().partition(start)[2].partition(end)[0]


def rows_of(block: str) -> list[list[str]]:
    lines = [line for line in block.splitlines() if line.startswith("|")]
    return [[cell.strip() for cell in line[1:-1].split("|")] for line in lines]


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Bench:
    """Target and host have run, with the builds of the project."""
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
            assert done.returncode == 0, done.stderr
    return made


# --- costs and errors ----------------------------------------------------------------------------


@pytest.mark.checks
def test_no_rival_is_cheaper_and_better_on_any_core(bench: Bench) -> None:
    if not set(SMALL) <= set(HERE):
        pytest.skip("unproven: no rival is cheaper and better: a cross compiler is missing")
    assert bench.run("report").returncode == 0
    beaten = bench.get("results")["dominated"]
    assert [found for found in beaten if found["core"] in SMALL] == []


@pytest.mark.checks
def test_cycles_are_at_least_the_instructions_and_no_rival_is_better(bench: Bench) -> None:
    for name in set(SMALL) & set(HERE):
        core = bench.get("target")[name]
        for libc, motions in core["motion_cycles"].items():
            for motion, ways in motions.items():
                for way, cycles in ways.items():
                    assert cycles >= core["motions"][libc][motion][way]
    done = bench.run("report", "--cycles")
    assert done.returncode == 0 and "cycles a tick" in done.stdout
    assert not re.search("beaten:.*(m0|m3|m4f)", done.stdout)


@pytest.mark.checks
def test_ours_is_within_its_bound_on_every_motion(bench: Bench) -> None:
    ulp = 2.0**-23  # of Fc = 0.5, over Fc
    for motion, ways in bench.get("host")["errors"].items():
        assert ways["counts_q30"][0] <= 9.4e-10, motion
        for way in ("counts", "batch_counts", "throughput_counts", "throughput_angle"):
            assert ways[way][0] <= 0.52 * ulp, (motion, way)


@pytest.mark.checks
def test_calls_from_python_are_measured_without_numba_and_jax(bench: Bench) -> None:
    calls = bench.get("host")["calls"]
    costs = [calls["single"].values(), *calls["logs"]["ns"].values()]
    assert min(map(min, costs)) > 0 and len(calls["logs"]["ns"]["friction"]) == 4
    assert calls["logs"]["missing"].keys() == {"numba", "jax_double"}


@pytest.mark.checks
@pytest.mark.parametrize("name", TOOLS)
def test_a_core_is_within_its_budgets(bench: Bench, name: str) -> None:
    """tests/target/budgets.json has every limit."""
    if name not in HERE:
        pytest.skip(f"unproven: what a tick costs: no tools for {name}")
    core, of_bytes = bench.get("target")[name], BUDGETS["bytes at most"]
    limits = BUDGETS["instructions at most"][name] | of_bytes[name] | of_bytes["all"]
    assert {key: core[key] for key, limit in limits.items() if core[key] > limit} == {}
    spread = core["dense_q30_most"] - core["dense_q30_least"]
    assert spread <= BUDGETS["dense moves differ by at most"][name]
    least = BUDGETS["newlib_expm1f over one_count_q30 at least"].get(name, 0)
    assert not least or core["newlib_expm1f"] >= least * core["one_count_q30"]


@pytest.mark.checks
@pytest.mark.usefixtures("bench")
def test_moves_come_with_the_exact_torque() -> None:
    """Compare encoder, sigma0, Fc and sign with a reference in 100 bits."""
    for name in ("sweep_12", "two_one_24", "sine_12", "creep_18", "leap_14"):
        printed = run(HOST_BENCH, "moves", name, 2000).stdout
        moves, ratios = zip(*(line.split() for line in printed.splitlines()), strict=True)
        theta = math.tau / 2 ** int(name[-2:])
        travel = reference.travel_per_count(SIGMA0, FC, float(f"{theta:.9g}"))
        exact = [float(w) for w in reference.exact_ratios([*map(int, moves)], travel)]
        assert len(moves) == 2000 and [*map(float, ratios)] == pytest.approx(exact, abs=1e-6), name
    done = run(HOST_BENCH, "growth", "no_such_motion", "100")
    assert done.returncode == 2 and done.stderr.startswith("error: ")


def seconds_of_children() -> float:
    """Return the CPU time of all processes that have ended."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


@pytest.mark.checks
def test_both_identifications_find_the_parameters_and_print_their_cpu_time() -> None:
    before = seconds_of_children()
    done = run(sys.executable, BENCH / "identify.py", "--rows", "3000", "--short", "1000")
    ours, theirs, _ = re.findall(r"sigma0 ([\d.]+), Fc ([\d.]+)", done.stdout) + [None]
    assert [*map(float, ours)] == pytest.approx([SIGMA0, FC], rel=0.1)
    assert [*map(float, theirs)] == pytest.approx([*map(float, ours)], rel=2e-3)
    printed = [float(one) for one in re.findall(r"(?:identify|solve_ivp) ([\d.]+) s", done.stdout)]
    assert len(printed) == 3 and min(printed) > 0
    assert sum(printed) < seconds_of_children() - before


# --- the pages -----------------------------------------------------------------------------------


def outside_of_blocks(page: Path) -> str:
    marked = r"(<!-- bench:(?!measured)\w+ -->).*?(<!-- /)"
    return re.sub(marked, r"\1\2", page.read_text(), flags=re.DOTALL)


@pytest.mark.checks
def test_the_pages_show_what_is_counted_now(bench: Bench, tmp_path: Path) -> None:
    """Compare counts exactly, and errors within the digits that libm may change. After a change,
    run tools/bench.sh.
    """
    target, before = bench.get("target"), block_of(ROOT, "docs/microcontroller.md", "target")
    if target.keys() != TOOLS.keys() or any(c["compiler"] not in before for c in target.values()):
        pytest.skip("unproven: the pages' numbers: they are of all cores and of other compilers")
    pages = Bench(tmp_path)
    pages.result("target").write_text(json.dumps(target))
    pages.result("host").write_text(json.dumps(bench.get("host") | {"quick": False}))
    assert pages.run("report", "--docs").returncode == 0
    for page, name in EXACT:
        assert block_of(tmp_path, page, name) == block_of(ROOT, page, name)
    for page in PAGES:
        assert outside_of_blocks(tmp_path / page) == outside_of_blocks(ROOT / page)
    now, there = (block_of(folder, "docs/speed.md", "ways") for folder in (tmp_path, ROOT))
    assert now.splitlines()[-1] == there.splitlines()[-1]
    for new, old in zip(rows_of(now), rows_of(there), strict=True):
        assert (new[0], new[3:]) == (old[0], old[3:])
    for new, old in zip(rows_of(now)[2:], rows_of(there)[2:], strict=True):
        for pair in zip(new[1:3], old[1:3], strict=True):
            numbers = [9.9 if error == "diverges" else float(error) for error in pair]
            assert max(numbers) < 1.6 * min(numbers), new[0]
    for name in ("speed", "pareto", "growth"):
        assert (tmp_path / f"docs/pictures/{name}.png").read_bytes()[:4] == b"\x89PNG"


@pytest.mark.checks
def test_the_page_shows_the_fit_of_each_measured_log(bench: Bench, monkeypatch) -> None:
    """Compare R2 of each model and log with the page."""
    monkeypatch.syspath_prepend(str(BENCH))
    import measured

    try:
        scores = measured.measure()
    except measured.BenchError as problem:
        pytest.skip(f"unproven: the page's R2: {problem}")
    block = measured.block(scores, bench.get("target"))
    now, there = rows_of(block), rows_of(block_of(ROOT, "docs/speed.md", "measured"))
    assert now[:3] == there[:3] and [row[0] for row in now] == [row[0] for row in there]
    for new, old in zip(now[3:], there[3:], strict=True):
        assert [*map(float, new[1:])] == pytest.approx([*map(float, old[1:])], abs=5e-4)


REFUSALS = {  # a table with fewer columns or empty cells must not replace a complete one
    "quick": r"build/bench/host\.json ",
    "few cores": r"build/bench/target\.json ",
    "no target": r"tools/bench\.sh target ",
    "no host": r"tools/bench\.sh host ",
    "no mark": r"docs/microcontroller\.md .*<!-- bench:target -->",
}


@pytest.mark.checks
@pytest.mark.parametrize("broken", REFUSALS)
def test_a_part_of_a_run_is_refused_and_changes_no_page(
    bench: Bench, tmp_path: Path, broken: str
) -> None:
    target, copy = bench.get("target"), Bench(tmp_path)
    if broken == "few cores":
        target.pop("m0")
    copy.result("target").write_text(json.dumps(target))
    copy.result("host").write_text(json.dumps(bench.get("host") | {"quick": broken == "quick"}))
    page = tmp_path / "docs/microcontroller.md"
    if broken == "no mark":
        page.write_text(page.read_text().replace("<!-- bench:target -->", ""))
    elif broken in ("no target", "no host"):
        copy.result(broken.split()[1]).unlink()
    before = page.read_text()
    done = copy.run("report", "--docs")
    assert done.returncode == 2 and re.search(rf"^error: .*{REFUSALS[broken]}", done.stderr)
    assert page.read_text() == before


@pytest.mark.parametrize(
    ("words", "code", "named"),
    [("host --quick", 1, "reason"), ("target --quick m3", 1, "reason"), ("target m3 m9", 2, "m9")],
)
def test_a_failed_run_is_an_error_without_a_result(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: str, code: int, named: str
) -> None:
    bench, fails = Bench(tmp_path), tmp_path / "bin"
    fails.mkdir()
    for name in ("cc", "cmake"):
        (fails / name).write_text("#!/bin/sh\necho reason >&2\nexit 1\n")
        (fails / name).chmod(0o755)
    monkeypatch.setenv("PATH", f"{fails}:{os.environ['PATH']}")
    command, *rest = words.split()
    done = bench.run(command, *rest)
    assert done.returncode == code and named in done.stderr and "error: " in done.stderr
    assert not bench.result(command).exists()
