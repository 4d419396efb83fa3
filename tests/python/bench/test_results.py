# SPDX-License-Identifier: MIT
"""Computation of results, cycles and times in tools/bench: small cases by hand, and routines in
QEMU.
"""

from __future__ import annotations

import dataclasses
import re
import subprocess
import sys
from itertools import accumulate
from pathlib import Path
from types import ModuleType, SimpleNamespace

import dahl
import numpy as np
import pytest
from conftest import ROOT, need

BENCH = ROOT / "tools/bench"


@pytest.fixture
def tools(monkeypatch):
    """Import a module of tools/bench by its name."""
    monkeypatch.syspath_prepend(str(BENCH))
    for path in BENCH.glob("*.py"):
        monkeypatch.delitem(sys.modules, path.stem, raising=False)
    return __import__


# --- results -------------------------------------------------------------------------------------


def test_a_cheaper_and_better_method_is_found(tools) -> None:
    """In one motion. An error within 5 % of ours is equal. A mean leaves the giant jumps out."""
    results = tools("results")
    ours = {"sine_12": 10.0, "leap_14": 90.0}, {"sine_12": 1e-9, "leap_14": 1e-3}
    point = results.Point("counts", "", True, *ours)
    assert (point.mean_cost(), point.worst()) == (10.0, 1e-9)
    for cost, error, is_better in ((9, 0.9e-9, 1), (9, 0.96e-9, 0), (11, 0.1e-9, 0)):
        rival = results.Point("rk4", "", False, {"sine_12": cost}, {"sine_12": error})
        found = {"core": "m3", "motion": "sine_12", "ours": "counts", "rival": "rk4"}
        assert results.find_dominated([point, rival], "m3") == [found] * is_better


def test_the_cost_of_more_parts_is_on_the_line_through_9_and_17(tools) -> None:
    counted = {"rk4_parts_9": 100.0, "rk4_parts_17": 180.0}
    assert tools("results").parts_cost(counted, "rk4", 25) == 260.0


def test_ratios_are_geometric_means_over_the_plain_loop(tools) -> None:
    names = "batch_counts batch_counts_16 batch_counts_16_apart throughput_angle throughput_counts"
    names += " throughput_counts_16 throughput_counts_16_apart throughput_angle_16 copy"
    plain = dict.fromkeys(names.split(), 8.0) | {"expm1f": 8.0}
    speed = {"a": plain | {"batch_counts": 4.0}, "b": plain | {"batch_counts": 1.0, "copy": 2.0}}
    host = {
        "speed": speed,
        "mixes": {"mix": {"tick": 9.0, "throughput": 2.0}},
        "threads": {"1": 3.0, "2": 2.0},
        "outside": {"mujoco": {"ns": 6000.0}},
        "python": {"throughput_ns": 2.0, "batch_ns": 3.0, "step_ns": 500.0},
    }
    found = tools("results").ratios(host)
    wanted = {"bitwise_counts_x": 4.0, "bitwise_counts_x_least": 2.0, "throughput_counts_x": 1.0}
    wanted |= {"copy_x": 2.5, "mix_throughput_x": 4.5, "threads_2_x": 1.5}
    wanted |= {"mujoco_x": 3000.0, "mujoco_batch_x": 2000.0, "mujoco_step_x": 12.0}
    assert {key: found[key] for key in wanted} == wanted


def test_solvers_without_enough_parts_are_listed(tools) -> None:
    parts = [("backward", 1e-6, 0), ("trapezoid", 1e-3, 0), ("rk4", 1e-6, 25), ("euler", 1e-3, 1)]
    entries = [{"way": f"{s}_parts", "limit": limit, "parts": n} for s, limit, n in parts]
    line = tools("report").missed_limits({"parts": entries})[-1]
    assert line.endswith("4096 parts a tick: backward Euler 1e-06, trapezoid 1e-03.")


def test_the_host_table_has_ours_and_each_package_that_ran(tools) -> None:
    points = {"batch_counts": (9.5, 1e-8), "mujoco": (6000.4, 1e-4), "expm1f": (31.6, 7.0)}
    host = {key: {"cost": cost, "worst": worst} for key, (cost, worst) in points.items()}
    assert tools("report").host_table({"points": {"host": host}})[2:] == [
        "| **`dahl_batch_counts`** | 9.50 | 1e-08 |",
        "| `expm1f` step | 32 | diverges |",
        "| MuJoCo `dcmotor` | 6,000 | 1e-04 |",
    ]


SINGLE = {"float": 50, "message": 400, "step_counts": 250, "receive": 1640, "receive_now": 2120}
LOGS = {"ticks": [1, 1000000], "ns": {"friction": [3000.0, 2.7e6]}, "missing": {"numba": "no"}}
CALLS = {"python": "3.99", "single": SINGLE, "logs": LOGS}


def test_calls_from_python_are_next_to_those_of_other_packages(tools) -> None:
    block = tools("report").python_block({"calls": CALLS, "machine": {"cpu": "a processor"}})
    assert "| us a call, by ticks of the log | 1 | 1,000,000 |" in block
    assert "| **`Friction.run_counts(moves, out)`** | 3.0 | 2,700 |" in block
    assert "numba (no)" in block and "a processor, Python 3.99" in block
    printed = re.findall(r": (\S+) us, (\S+) times", block)
    assert printed == [("0.25", "5.0"), ("1.64", "4.1"), ("2.12", "5.3")]


def test_the_terminal_shows_cost_and_error_of_each_method(tools, capsys) -> None:
    """The cheapest first, then the calls from Python, the ratios and the methods that beat ours."""
    point = {"cost": 21.0, "worst": 1e-9, "ours": True}
    points = {"m3": {"counts": point, "rk4": {"cost": 12.5, "worst": 3e-4, "ours": False}}}
    points["host"] = {"expm1f": {"cost": 31.6, "worst": 7.0, "ours": False}}
    beaten = [{"core": "m3", "ours": "counts", "rival": "rk4"}]
    result = {"points": points, "calls": CALLS, "host": {"copy_x": 2.5}, "dominated": beaten}
    tools("report").show(result, "instructions")
    printed = capsys.readouterr().out
    rows = [re.split(r" *[│┃] *", line)[1:-1] for line in printed.splitlines()]
    assert [row for row in rows if len(row) == 3 and row[2] != "1,000,000"] == [
        ["way", "instructions a tick", "worst"],
        ["rk4", "12.5", "3e-04"],
        ["counts", "21", "1e-09"],
        ["way", "ns a tick", "worst"],
        ["expm1f", "31.6", "diverges"],
        ["Friction.run_counts(moves, out)", "3.0", "2,700"],
    ]
    assert "Friction.step_counts: 0.25 us, 5.0 times" in printed and "copy_x" in printed
    assert " 2.50\n" in printed and str(beaten[0]) in printed and "our points, 1 are" in printed


def test_a_time_is_the_best_of_its_rounds_and_in_ns_a_tick(tools, monkeypatch) -> None:
    host, outside = tools("host"), tools("outside")
    ends = iter([0.0, 5.0, 10.0, 12.0, 20.0, 23.0, 30.0, 31.0])
    monkeypatch.setattr(host, "perf_counter", lambda: next(ends))
    assert host.best_time(lambda: None, rounds=3) == 2.0
    monkeypatch.setattr(outside.time, "perf_counter", lambda: next(ends))
    assert outside.time_run(lambda _: range(4), {}) == (0.25e9, range(4))


def test_measured_logs_have_r2_under_the_cost_of_each_model(tools) -> None:
    measured = tools("measured")
    m3 = {case: 10 + k for k, (_, _, case) in enumerate(measured.MODELS.values())}
    r2 = {"a log": {title: 0.9 + k / 100 for k, title in enumerate(measured.MODELS)}}
    block = measured.block(r2, {"m0": dict.fromkeys(m3, 0), "m3": m3})
    rows = [line for line in block.splitlines() if line.startswith("| ")]
    head, costs, log = (row.split(" | ")[1:] for row in (row.removesuffix(" |") for row in rows))
    assert head == [*measured.MODELS] and costs == [str(10 + k) for k in range(len(m3))]
    assert log == [f".9{k}00" for k in range(len(m3))]


def test_logs_of_numba_and_jax_have_the_torques_of_ours(tools, monkeypatch) -> None:
    """Stand-ins run the loop in Python and the scan in order."""

    class Torques(np.ndarray):
        def block_until_ready(self) -> Torques:
            return self

    def scan(join, elements) -> list[Torques]:
        joined = accumulate(zip(*elements, strict=True), join)
        return [np.array(part).view(Torques) for part in zip(*joined, strict=True)]

    jax = ModuleType("jax")
    jax.numpy, jax.jit = np, lambda call: call
    jax.config = SimpleNamespace(update=lambda *_: None)
    jax.lax = SimpleNamespace(associative_scan=scan)
    for name, module in {
        "jax": jax,
        "jax.numpy": np,
        "numba": SimpleNamespace(njit=jax.jit),
    }.items():
        monkeypatch.setitem(sys.modules, name, module)
    rivals, moves = tools("log_rivals"), np.array([3, 40, -7, 0, 900, -2, -500], np.int32)
    plan = dahl.Plan(100.0, 0.5, 1e-4)
    ours, out = dahl.Friction(plan).run_counts(moves), np.empty(len(moves))
    rivals.numba_loop()(moves, 100.0 / 0.5 * 1e-4, 0.5, out)
    by_jax = rivals.jax_scan("float64")(moves, 100.0 / 0.5 * 1e-4, 0.5)
    assert out == pytest.approx(ours, abs=1e-6) and by_jax == pytest.approx(ours, abs=1e-6)


def test_a_block_of_a_page_is_replaced_between_its_marks(tools, tmp_path) -> None:
    report, marks = tools("report"), ("<!-- a -->", "<!-- /a -->")
    (page := tmp_path / "page.md").write_text("before\n<!-- a -->\nold\n<!-- /a -->\nafter\n")
    for text in ("first", "second"):
        report.write_block(page, marks, f"{marks[0]}\n{text}\n{marks[1]}")
        assert page.read_text() == f"before\n<!-- a -->\n{text}\n<!-- /a -->\nafter\n"


def test_a_new_plugin_replaces_the_old_one(tools, monkeypatch, tmp_path) -> None:
    target = tools("target")
    monkeypatch.setattr(target, "OUT", tmp_path)
    monkeypatch.setattr(target, "PLUGIN", tmp_path / "plugin.so")
    target.PLUGIN.write_text("old")
    target.build_plugin()
    assert target.PLUGIN.read_bytes()[:4] == b"\x7fELF" and len([*tmp_path.iterdir()]) == 1


def test_cycles_are_divided_by_the_clock(tools) -> None:
    table = tools("table")
    assert table.format_times("m0", [24, 96], 48.0) == "0.5 (2)"
    assert table.format_times("m3", [24, 96], 48.0) == "0.5 to 2"


@pytest.mark.parametrize(
    ("clock", "core"),
    [("0", "m0"), ("-48", "m0"), ("fast", "m0"), ("nan", "m0"), ("inf", "m0"), ("48", "rv32")],
)
def test_a_clock_without_cycles_is_refused_before_the_build(clock: str, core: str) -> None:
    words = [sys.executable, BENCH / "target.py", f"--mhz={clock}", core]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    named = clock if core == "m0" else core
    assert done.returncode == 1 and done.stderr.startswith("error: --mhz") and named in done.stderr
    assert done.stderr.count("\n") == 1


def test_the_worst_call_is_that_with_the_most_cycles(tools) -> None:
    """A pair of cycles is the least and the most of all calls."""
    target = tools("target")
    calls = [target.Call(7, 5, 9), target.Call(8, 6, 8)]
    text = "case worst:step\ninput 3f000000 1 2\ninput 40000000 3 4\n"
    assert target.worst_numbers({"worst:step": calls}, text)["step"] == {
        "instructions": 8,
        "cycles": [6, 9],
        "searched": 2,
        "input": (0x3F000000, 1, 2),
    }
    cases = {name: calls for names in target.CYCLE_CASES.values() for name in names}
    assert set(map(tuple, target.cycle_numbers(cases).values())) == {(6, 9)}


# --- cycles by hand from the manuals -------------------------------------------------------------

# Least and most cycles if the next instruction follows, then if it jumps.
COSTS = [
    ("m0", "adds", "r0, r0, r1", (1, 1, 1, 1)),
    ("m0", "muls", "r0, r1", (1, 32, 1, 32)),
    ("m0", "ldrh", "r0, [r1, #2]", (2, 2, 2, 2)),
    ("m0", "str", "r0, [r1, #0]", (2, 2, 2, 2)),
    ("m0", "ldmia", "r1!, {r2, r4-r6}", (5, 5, 5, 5)),
    ("m0", "push", "{r4, lr}", (3, 3, 3, 3)),
    ("m0", "pop", "{r4-r6}", (4, 4, 4, 4)),
    ("m0", "pop", "{r4, pc}", (6, 6, 6, 6)),
    ("m0", "bls.n", "10 <f>", (1, 1, 3, 3)),
    ("m0", "b.n", "10 <f>", (3, 3, 3, 3)),
    ("m0", "bl", "10 <f>", (4, 4, 4, 4)),
    ("m0", "mov", "pc, r3", (3, 3, 3, 3)),
    ("m0", "bics", "r0, r1", (1, 1, 1, 1)),
    ("m3", "mul.w", "r0, r1, r2", (1, 1, 1, 1)),
    ("m3", "mla", "r0, r1, r2, r3", (2, 2, 2, 2)),
    ("m3", "umull", "r0, r1, r2, r3", (3, 5, 3, 5)),
    ("m3", "smlal", "r0, r1, r2, r3", (4, 7, 4, 7)),
    ("m3", "umullne", "r0, r1, r2, r3", (1, 5, 3, 5)),
    ("m3", "udiv", "r0, r1, r2", (2, 12, 2, 12)),
    ("m3", "ldr.w", "r0, [r1]", (1, 2, 2, 5)),
    ("m3", "strd", "r0, r1, [r2]", (3, 3, 3, 3)),
    ("m3", "ldmia.w", "sp!, {r4, r5, r6, r7, r8, sl, fp, pc}", (9, 9, 10, 12)),
    ("m3", "bne.n", "10 <f>", (1, 1, 2, 4)),
    ("m3", "bls.n", "10 <f>", (1, 1, 2, 4)),
    ("m3", "itte", "ne", (0, 1, 0, 1)),
    ("m3", "tbb", "[pc, r0]", (2, 2, 3, 5)),
    ("m3", "stmdb", "sp!, {r4, r5}", (3, 3, 3, 3)),
    ("m3", "strb", "r0, [r1]", (1, 2, 1, 2)),
    ("m3", "dsb", "sy", (0, 4, 0, 4)),
    ("m4f", "umull", "r0, r1, r2, r3", (1, 1, 1, 1)),
    ("m4f", "vmul.f32", "s0, s0, s1", (1, 2, 1, 2)),
    ("m4f", "vmls.f32", "s0, s1, s2", (3, 4, 3, 4)),
    ("m4f", "vdiv.f32", "s0, s1, s2", (1, 15, 1, 15)),
    ("m4f", "vldr", "s0, [r0]", (1, 2, 1, 2)),
    ("m4f", "vldr", "d0, [r0]", (1, 3, 1, 3)),
    ("m4f", "vpush", "{d8-d9}", (5, 5, 5, 5)),
    ("m4f", "vldmia", "r0!, {s0-s2}", (4, 4, 4, 4)),
    ("m4f", "vmov", "r0, r1, d0", (2, 2, 2, 2)),
]


@pytest.mark.parametrize(("core", "mnemonic", "operands", "by_hand"), COSTS)
def test_an_instruction_has_the_cycles_of_the_manual(
    tools, core: str, mnemonic: str, operands: str, by_hand: tuple[int, ...]
) -> None:
    assert dataclasses.astuple(tools("cycles").cost(core, mnemonic, operands)) == by_hand


LOOP = "movs r0, #10; 1: subs r0, #1; bne 1b"  # 10 rounds: the branch is taken 9 times
CALL = "push {r4, lr}; ldr r0, [sp]; bl 2f; pop {r4, pc}; .align 2; .word 0; 2: bx lr"
SKIP = "cmp r0, r0; itt ne; ldrne r1, [sp]; addne r1, r1, #1; umull r0, r1, r2, r3; bx lr"
FLOAT = "vmul.f32 s0, s1, s1; vadd.f32 s0, s0, s1; bx lr"

# Instructions, least and most cycles.
ROUTINES = [
    ("m0", f"{LOOP}; muls r0, r0; bx lr", (23, 1 + 10 + 27 + 1 + 1 + 3, 1 + 10 + 27 + 1 + 32 + 3)),
    ("m0", CALL, (5, 3 + 2 + 4 + 3 + 6, 18)),
    ("m3", f"{LOOP}; bx lr", (22, 1 + 10 + 18 + 1 + 2, 1 + 10 + 36 + 1 + 4)),
    ("m3", SKIP, (6, 1 + 0 + 1 + 1 + 3 + 2, 1 + 1 + 2 + 1 + 5 + 4)),
    ("m4f", SKIP, (6, 1 + 0 + 1 + 1 + 1 + 2, 1 + 1 + 2 + 1 + 1 + 4)),
    ("m3", "push {r4, lr}; ldr.w r0, [sp]; pop {r4, pc}", (3, 3 + 1 + 4, 3 + 2 + 6)),
    ("m4f", FLOAT, (3, 1 + 1 + 2, 2 + 2 + 4)),
]

# A vector table, one counted call, and the end of the emulator by semihosting (SYS_EXIT).
IMAGE = """.syntax unified
.cpu {cpu}
{fpu}
.thumb
.global _start, bench_site, bench_back, bench_mark
.word 0x20001000, _start + 1
.thumb_func
_start: {enable}
    bl bench_mark
    ldr r4, =routine + 1
bench_site: blx r4
bench_back: movs r0, #0x18
    ldr r1, =0x20026
    bkpt 0xab
.thumb_func
bench_mark: bx lr
.ltorg
.align 2
routine: {body}
"""
CPUS = {"m0": "cortex-m0", "m3": "cortex-m3", "m4f": "cortex-m4"}
ENABLE_FPU = "ldr r0, =0xe000ed88; ldr r1, =0xf00000; str r1, [r0]; dsb; isb"


@pytest.mark.checks
@pytest.mark.parametrize(("core", "body", "by_hand"), ROUTINES)
def test_a_routine_has_the_cycles_counted_by_hand(
    tools, tmp_path: Path, core: str, body: str, by_hand: tuple[int, int, int]
) -> None:
    compiler = need("arm-none-eabi-gcc", "cycles of a call")
    need("qemu-system-arm", "cycles of a call")
    has_fpu = core == "m4f"
    source, image = tmp_path / "routine.s", tmp_path / "routine"
    fpu, enable = (".fpu fpv4-sp-d16", ENABLE_FPU) if has_fpu else ("", "")
    source.write_text(IMAGE.format(cpu=CPUS[core], fpu=fpu, enable=enable, body=body))
    command = [compiler, "-nostdlib", f"-mcpu={CPUS[core]}", "-mthumb", "-Wl,-Ttext=0"]
    subprocess.run([*command, "-o", image, source], check=True, capture_output=True)
    target = tools("target")
    target.build_plugin()
    _, counts = target.emulate(target.CORES[core], image)
    assert counts == "-\n{} {} {}\n".format(*by_hand)
