# SPDX-License-Identifier: MIT
"""Speed against error: tools/bench.sh counts and measures on this machine. The results are compared
with limits, references and the pages, which show the same numbers.
"""

import json
import os
import re
import shutil
import subprocess
import sys
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest
from conftest import ROOT
from programs import call

BENCH = ROOT / "tools/bench"
BUDGETS = json.loads((ROOT / "tests/target/budgets.json").read_text())
SMALL = ("m0", "m3", "m4f")
TOOLS = {name: ("arm-none-eabi-gcc", "qemu-system-arm") for name in (*SMALL, "m7", "m33")}
TOOLS["rv32"] = ("riscv64-unknown-elf-gcc", "qemu-system-riscv32")
HERE = [name for name, tools in TOOLS.items() if all(map(shutil.which, tools))]
HAS_AVR = bool(shutil.which("avr-gcc")) and Path("/usr/include/simavr/sim_avr.h").exists()
PAGES = ("README.md", "docs/microcontroller.md", "docs/speed.md")
EXACT = [
    ("docs/microcontroller.md", name)
    for name in ("target", "calls", "memory", "cycles", "worst", "avr")
]
EXACT += [("README.md", "short")]
EXACT += [("docs/speed.md", name) for name in ("speed", "libc", "computed")]


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
        return call(sys.executable, self.folder / f"tools/bench/{command}.py", *words)

    def result(self, name: str) -> Path:
        return self.folder / f"build/bench/{name}.json"

    def get(self, name: str) -> Any:
        return json.loads(self.result(name).read_text())

    def program(self, name: str, *lines: str) -> None:
        """Write a program that the commands find before that of the machine."""
        (self.folder / "bin").mkdir(exist_ok=True)
        (self.folder / "bin" / name).write_text("\n".join(["#!/bin/sh", *lines]))
        (self.folder / "bin" / name).chmod(0o755)


def block_of(folder: Path, page: str, name: str) -> str:
    start, end = (f"<!-- {slash}bench:{name} -->\n" for slash in ("", "/"))
    return (folder / page).read_text().partition(start)[2].partition(end)[0]


def rows_of(block: str) -> list[list[str]]:
    lines = [line for line in block.splitlines() if line.startswith("|")]
    return [[cell.strip() for cell in line[1:-1].split("|")] for line in lines]


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Bench:
    """Target and host have run, with the builds of the project."""
    if not set(SMALL) <= set(HERE):
        pytest.skip("unproven: what a tick costs: no cross compiler with its QEMU is installed")
    made = Bench(tmp_path_factory.mktemp("bench"))
    made.program("cmake", f'cd "{ROOT}" && exec {shutil.which("cmake")} "$@"')
    cores = [*HERE, *(["avr"] if HAS_AVR else [])]
    for name in ("host", *cores):
        (ROOT / "build" / name).mkdir(exist_ok=True)
        (made.folder / "build" / name).symlink_to(ROOT / "build" / name)
    (made.folder / "lib").symlink_to(ROOT / "lib")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PATH", f"{made.folder}/bin:{os.environ['PATH']}")
        for command, words in (("target", cores), ("host", ["--quick"])):
            done = made.run(command, *words)
            assert done.returncode == 0, done.stderr
    return made


@pytest.mark.checks
@pytest.mark.parametrize("words", [[], ["--cycles"]])
def test_no_rival_is_cheaper_and_better_on_any_core(bench: Bench, words: list[str]) -> None:
    done = bench.run("report", *words)
    unit = "cycles" if words else "instructions"
    assert done.returncode == 0 and f"{unit} a tick" in done.stdout
    assert not re.search("beaten:.*(m0|m3|m4f)", done.stdout)


OF_CALLS = BUDGETS["calls at most: m0, m3 to m33, rv32"]


def limits_of(name: str) -> dict[str, int]:
    """Return each limit of a core in tests/target/budgets.json, by the name of its number."""
    of_bytes, column = BUDGETS["bytes at most"], {"m0": 0, "rv32": 2}.get(name, 1)
    limits = BUDGETS["instructions at most"][name] | of_bytes.get(name, {}) | of_bytes["all"]
    limits |= {f"bytes of {kind}": n for kind, n in BUDGETS["bytes of a type at most"].items()}
    return limits | {
        f"{quantity} of {call}": numbers[column]
        for call, each in OF_CALLS.items()
        for quantity, numbers in each.items()
    }


def over_budget(numbers: dict[str, int], name: str) -> dict[str, int]:
    return {key: numbers[key] for key, limit in limits_of(name).items() if numbers[key] > limit}


@pytest.mark.checks
@pytest.mark.parametrize("name", TOOLS)
def test_a_core_is_within_its_budgets(bench: Bench, name: str) -> None:
    if name not in HERE:
        pytest.skip(f"unproven: what a tick costs: no tools for {name}")
    core = bench.get("target")[name]
    numbers = core | {f"bytes of {kind}": n for kind, n in core["types"].items()}
    for function, each in core["calls"].items():
        numbers |= {f"{quantity} of {function}": number for quantity, number in each.items()}
    assert over_budget(numbers, name) == {}
    spread = core["dense_q30_most"] - core["dense_q30_least"]
    assert spread <= BUDGETS["dense moves differ by at most"][name]
    least = BUDGETS["newlib_expm1f over one_count_q30 at least"].get(name, 0)
    assert not least or core["newlib_expm1f"] >= least * core["one_count_q30"]


@pytest.mark.parametrize("name", TOOLS)
def test_each_budget_bites(name: str) -> None:
    limits = limits_of(name)
    assert over_budget(limits, name) == {}
    for key, limit in limits.items():
        assert over_budget(limits | {key: limit + 1}, name) == {key: limit + 1}


@pytest.mark.checks
def test_an_avr_is_within_its_budgets(bench: Bench) -> None:
    """Also: code whose cycles the data sheet gives is counted exactly."""
    if not HAS_AVR:
        pytest.skip("unproven: what a tick costs on an AVR: no avr-gcc or no libsimavr-dev")
    result, limits = bench.get("avr"), BUDGETS["on an avr at most"]
    assert result["known"] == {"cycles": 82, "instructions": 41, "stack": 6}
    assert limits.keys() == {key for key in result if key not in ("core", "compiler", "known")}
    for key, row in limits.items():
        assert {name: n for name, n in row.items() if result[key][name] > n} == {}, key


def test_each_public_call_has_a_budget_of_instructions_and_stack(monkeypatch) -> None:
    """A new call needs a case in tools/bench/target, and a budget."""
    monkeypatch.syspath_prepend(str(BENCH))
    costs = import_module("call_costs")
    assert OF_CALLS.keys() == {*costs.public_calls(), *costs.RECEIVED}
    assert all(each.keys() == {"instructions", "stack"} for each in OF_CALLS.values())


@pytest.fixture
def results(monkeypatch: pytest.MonkeyPatch) -> Any:
    monkeypatch.syspath_prepend(str(BENCH))
    return import_module("results")


RIVALS = {"both": (9.0, 0.5), "dearer": (11.0, 0.1), "worse": (1.0, 2.0), "equal": (10.0, 1.0)}


def test_a_rival_that_is_cheaper_and_better_is_found_by_its_motion(results) -> None:
    """Each has a cost and an error."""
    points = [results.Point("ours", "", True, {"a": 10.0, "b": 1.0}, {"a": 1.0, "b": 1.0})]
    for key, (cost, error) in RIVALS.items():
        points.append(results.Point(key, "", False, {"a": cost, "b": 2.0}, {"a": error, "b": 0.1}))
    found = results.find_dominated(points, "m0")
    assert found == [{"core": "m0", "motion": "a", "ours": "ours", "rival": "both"}]


def test_ratios_are_geometric_means_over_the_plain_loop(results) -> None:
    names = "batch_counts throughput_angle throughput_counts throughput_counts_16"
    names += " throughput_counts_16_apart throughput_angle_16 copy"
    plain = dict.fromkeys(names.split(), 8.0) | {"expm1f": 8.0}
    speed = {"a": plain | {"batch_counts": 4.0}, "b": plain | {"batch_counts": 1.0, "copy": 2.0}}
    host = {
        "speed": speed,
        "threads": {"1": 3.0, "2": 2.0},
    }
    found = results.ratios(host)
    wanted = {"bitwise_counts_x": 4.0, "bitwise_counts_x_least": 2.0, "throughput_counts_x": 1.0}
    assert found == dict.fromkeys(found, 1.0) | wanted | {"threads_2_x": 1.5}


def test_the_distance_to_a_copy_names_the_worst_motion(results) -> None:
    """The geometric mean of 2 and 8 is 4."""
    speed = {"sine_12": {"ours": 2.0, "copy": 1.0}, "leap_14": {"ours": 4.0, "copy": 0.5}}
    wanted = {"ns": 3.0, "mean": pytest.approx(4.0), "most": 8.0, "motion": "leap_14"}
    assert results.distances({"speed": speed})["ours"] == wanted


def test_the_processor_is_named_with_its_vectors(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(BENCH))
    host = import_module("host")
    text = (
        "model name\t: A\ncpu family\t: 6\nmodel\t\t: 85\nflags\t\t: sse avx2{}\n\nmodel name\t: B"
    )
    assert host.cpu(text.format("")) == "A (family 6, model 85, AVX2)"
    assert host.cpu(text.format(" avx512bw")) == "A (family 6, model 85, AVX-512)"
    assert "unknown" in host.cpu("Processor\t: ARM")


def numbers_of(row: list[str]) -> list[float]:
    return [9.9 if error == "diverges" else float(error) for error in row[1:3]]


@pytest.mark.checks
def test_the_pages_show_what_is_counted_now(bench: Bench, tmp_path: Path) -> None:
    """Compare counts exactly, and errors within the digits that libm may change. After a change,
    run tools/bench.sh.
    """
    target, before = bench.get("target"), block_of(ROOT, "docs/microcontroller.md", "target")
    is_other = any(c["compiler"] not in before for c in target.values())
    if target.keys() != TOOLS.keys() or is_other or not HAS_AVR:
        pytest.skip("unproven: the pages' numbers: they are of all cores and of other compilers")
    pages = Bench(tmp_path)
    pages.result("target").write_text(json.dumps(target))
    shutil.copy(bench.result("avr"), pages.result("avr"))
    pages.result("host").write_text(json.dumps(bench.get("host") | {"quick": False}))
    assert pages.run("report", "--docs").returncode == 0
    for page, name in EXACT:
        assert block_of(tmp_path, page, name) == block_of(ROOT, page, name)
    for page in PAGES:  # outside of the marks nothing changes
        marked = r"(?s)(<!-- bench:(?!measured)\w+ -->).*?(<!-- /)"
        now, there = (re.sub(marked, r"\1\2", (at / page).read_text()) for at in (tmp_path, ROOT))
        assert now == there
    for name, count in {"ways": 99, "host": 6, "python": 5}.items():  # rows of this machine
        now, there = (rows_of(block_of(at, "docs/speed.md", name)) for at in (tmp_path, ROOT))
        assert [row[0] for row in now[:count]] == [row[0] for row in there[:count]]
        if name == "ways":
            assert [row[3:] for row in now] == [row[3:] for row in there]
            for new, old in zip(now[2:], there[2:], strict=True):
                assert numbers_of(new) == pytest.approx(numbers_of(old), rel=0.5), new[0]


REFUSALS = {  # a table with fewer columns or empty cells must not replace a complete one
    "quick": r"build/bench/host\.json ",
    "few cores": r"build/bench/target\.json ",
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
    elif broken == "no host":
        copy.result("host").unlink()
    before = page.read_text()
    copy.result("avr").write_text("{}")
    done = copy.run("report", "--docs")
    assert done.returncode == 2 and re.search(rf"^error: .*{REFUSALS[broken]}", done.stderr)
    assert page.read_text() == before


FAILURES = {"host --quick": (1, "reason"), "target --quick m3": (1, "reason")}
FAILURES |= {"host --core-math=absent.c": (1, "absent.c")}
FAILURES |= {"target m3 m9": (2, "m9"), "target --mhz=48 rv32": (1, "rv32")}
FAILURES |= {f"target --mhz={clock} m0": (1, clock) for clock in ("0", "-48", "fast", "inf")}
FAILURES["target avr"] = (1, "reason")


@pytest.mark.parametrize("words", FAILURES)
def test_a_failed_run_is_an_error_without_a_result(tmp_path, monkeypatch, words) -> None:
    bench, (command, *rest) = Bench(tmp_path), words.split()
    for name in ("cc", "cmake"):
        bench.program(name, "echo reason >&2", "exit 1")
    monkeypatch.setenv("PATH", f"{tmp_path}/bin:{os.environ['PATH']}")
    done, (code, named) = bench.run(command, *rest), FAILURES[words]
    assert done.returncode == code and named in done.stderr and "error: " in done.stderr
    assert not bench.result(command).exists()
