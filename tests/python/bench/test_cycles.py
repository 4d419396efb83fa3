# SPDX-License-Identifier: MIT
"""Cycles against counts by hand from the manuals: of instructions, and of routines in QEMU."""

from __future__ import annotations

import dataclasses
import subprocess
import sys

import pytest
from bench_tools import BENCH, SMALL, Bench, made_host, made_target, rows_of
from conftest import need


@pytest.fixture
def bench_modules(monkeypatch):
    monkeypatch.syspath_prepend(str(BENCH))
    for name in ("target", "cycles"):
        monkeypatch.delitem(sys.modules, name, raising=False)
    import target

    return target


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
    bench_modules, core: str, mnemonic: str, operands: str, by_hand: tuple[int, ...]
) -> None:
    assert dataclasses.astuple(bench_modules.cycles.cost(core, mnemonic, operands)) == by_hand


def wrong_rows(cycles) -> int:
    found = [
        (cycles.cost(core, name, operands), by_hand) for core, name, operands, by_hand in COSTS
    ]
    return sum(dataclasses.astuple(each) != by_hand for each, by_hand in found)


def test_the_rows_by_hand_notice_a_doubled_cost_of_any_rule(bench_modules, monkeypatch) -> None:
    cycles = bench_modules.cycles
    rules = {rule for table in cycles.TABLES.values() for rule in table}
    assert wrong_rows(cycles) == 0
    for rule in rules:
        doubled = cycles.Cost(*(2 * number for number in dataclasses.astuple(rule.cost)))
        other = dataclasses.replace(rule, cost=doubled)
        tables = {
            core: [other if each is rule else each for each in table]
            for core, table in cycles.TABLES.items()
        }
        with monkeypatch.context() as patch:
            patch.setattr(cycles, "TABLES", tables)
            assert wrong_rows(cycles) > 0, rule.pattern


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
    bench_modules, tmp_path, core: str, body: str, by_hand: tuple[int, int, int]
) -> None:
    compiler = need("arm-none-eabi-gcc", "cycles of a call")
    need("qemu-system-arm", "cycles of a call")
    has_fpu = core == "m4f"
    source, image = tmp_path / "routine.s", tmp_path / "routine"
    fpu, enable = (".fpu fpv4-sp-d16", ENABLE_FPU) if has_fpu else ("", "")
    source.write_text(IMAGE.format(cpu=CPUS[core], fpu=fpu, enable=enable, body=body))
    command = [compiler, "-nostdlib", f"-mcpu={CPUS[core]}", "-mthumb", "-Wl,-Ttext=0"]
    subprocess.run([*command, "-o", image, source], check=True, capture_output=True)
    bench_modules.build_plugin()
    _, counts = bench_modules.emulate(bench_modules.CORES[core], image)
    assert counts == "-\n{} {} {}\n".format(*by_hand)


# --- what the user reads -------------------------------------------------------------------------


def test_cycles_are_divided_by_the_clock(bench_modules, capsys) -> None:
    import table

    target = made_target()
    table.show_times(target, 48.0)
    printed = capsys.readouterr().out
    least, most = target["m0"]["cycles"]["one_count_q30"]
    assert "Microseconds at 48 MHz" in printed
    assert f"{least / 48:.3g} ({most / 48:.3g})" in printed


@pytest.mark.parametrize(
    ("clock", "core"),
    [("0", "m0"), ("-48", "m0"), ("fast", "m0"), ("nan", "m0"), ("inf", "m0"), ("48", "rv32")],
)
def test_a_clock_without_cycles_is_refused_before_the_build(tmp_path, clock, core) -> None:
    done = Bench(tmp_path).run("target", f"--mhz={clock}", core)
    named = clock if core == "m0" else core
    assert done.code == 1 and done.err.startswith("error: --mhz") and named in done.err
    assert done.err.count("\n") == 1


def test_the_page_has_cycles_and_worst_calls(tmp_path) -> None:
    bench, target = Bench(tmp_path), made_target()
    bench.put(target=target, host=made_host())
    assert bench.run("report", "--docs").code == 0
    cores, rows = rows_of(bench.block("docs/microcontroller.md", "cycles"))
    assert cores == [f"Core {core}" for core in SMALL]
    least, most = (target["m0"]["cycles"]["control_tick"][k] for k in (0, 1))
    assert rows["a whole control tick in float, F in N m"][0] == f"{least} ({most})"
    _, worst = rows_of(bench.block("docs/microcontroller.md", "worst"))
    found = target["m4f"]["worst"]["step_counts"]
    cells = worst["`dahl_step_counts`"]
    assert cells[2] == "{} / {} to {}".format(found["instructions"], *found["cycles"])
    assert cells[3] == "-2 counts of travel 0.5 from -0.25 Fc"
