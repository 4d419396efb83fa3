# SPDX-License-Identifier: MIT
"""What the runs of tools/bench ask of the programs that they start, and where each answer goes.
These programs are stand-ins, which note their words and answer at once.
"""

from __future__ import annotations

import io
import json
import os
import re
import sys

import numpy as np
import pytest
from bench_tools import BYTES, CASES, CORES, OF_A_LIBC, OF_RIVALS, Bench, Run


@pytest.fixture
def bench(tmp_path, monkeypatch, library) -> Bench:
    """A tree whose bin/ comes first on the path."""
    made = Bench(tmp_path)
    monkeypatch.setenv("PATH", f"{tmp_path}/bin:{os.environ['PATH']}")
    monkeypatch.setenv("STAGE", str(tmp_path))
    return made


def program(bench: Bench, name: str, does: str) -> None:
    path = bench.folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(f'#!/bin/bash\necho "{path.name} $*" >>"$STAGE/calls"\n{does}\n')
    path.chmod(0o755)


def calls(bench: Bench, name: str) -> list[list[str]]:
    """Words of each call of a program."""
    noted = bench.folder / "calls"
    lines = noted.read_text().splitlines() if noted.exists() else []
    return [line.split()[1:] for line in lines if line.split()[0] == name]


# --- tools/bench.sh host -------------------------------------------------------------------------

# 16 parts are enough for 1e-3, and none for 1e-6.
HOST_BENCH = """case $1 in
    parts-error) [ "$3" -ge 16 ] && worst=5e-4 || worst=0.5
        printf '{"worst": "%s"}\\n' "$worst" ;;
    parts) printf '{"rate": %s, "way": "rk4_parts", "parts": 3}\\n' "$2" ;;
    growth) printf '{"scenario": "%s", "way": "expf", "ticks": 9, "worst": "inf"}\\n' "$2" ;;
    moves) printf '3 0.25\\n-2 -0.5\\n' ;;
    speed) echo '{"scenario": "walk", "way": "euler", "ns": 1.5}'
        echo '{"scenario": "sine", "way": "rk4", "ns": 2.5}'
        echo '{"scenario": "walk", "way": "rk4", "ns": 3.5}' ;;
    errors) echo '{"scenario": "walk", "way": "euler", "worst": "nan", "rms": "0.125"}'
        echo '{"scenario": "sine", "way": "rk4", "worst": "0.25", "rms": "0.5"}'
        echo '{"scenario": "walk", "way": "rk4", "worst": "2", "rms": "1"}' ;;
esac"""
RIVALS = """cat >"$STAGE/task"; echo warming up
echo '{"mujoco": {"ns": 7}, "newton": {"missing": "no warp"}}'"""
GROWN = {"leap_14", "drift_30", "sweep_24", "dither_16", "walk_20"}
RATES = [100, 300, 1000, 3000, 10000, 30000, 100000]


def run_host(bench: Bench, *words: str) -> Run:
    program(bench, "bin/cmake", ":")
    program(bench, "bin/cc", 'echo "cc (here) 12"; echo more')
    program(bench, "build/host/tools/bench/host/host_bench", HOST_BENCH)
    return bench.run("host", *words)


@pytest.mark.parametrize(("words", "growth"), [(["--quick"], 10**6), ([], 10**9)])
def test_a_run_on_this_host_asks_for_its_sizes_and_keeps_each_answer(bench, words, growth):
    done = run_host(bench, *words)
    assert done.code == 0, done.err
    known = bench.get("host")
    sizes = known["ticks"]
    assert (known["quick"], sizes["growth"]) == (bool(words), growth)
    assert sizes["errors"] == sizes["parts"] == 200_000  # as docs/speed.md says
    assert known["compiler"] == "cc (here) 12" and known["cpu"]
    diverged = [pytest.approx(1e99), 0.125]  # JSON has no NaN
    assert known["errors"]["sine"] == {"rk4": [0.25, 0.5]}
    assert known["errors"]["walk"] == {"euler": diverged, "rk4": [2, 1]}
    assert known["speed"] == {"walk": {"euler": 1.5, "rk4": 3.5}, "sine": {"rk4": 2.5}}
    assert [row["rate"] for row in known["rates"]] == RATES
    assert {row["scenario"] for row in known["growth"]} == GROWN
    assert {row["worst"] for row in known["growth"]} == {1e99}
    for entry in known["parts"]:
        assert entry["parts"] == (16 if entry["limit"] == 1e-3 else 0)
        worst = {"walk": 5e-4, "sine": 5e-4}
        assert entry.get("worst") == (worst if entry["parts"] else None)
    asked = calls(bench, "host_bench")
    assert ["errors", str(sizes["errors"])] in asked and ["speed", str(sizes["speed"])] in asked
    assert {call[1] for call in asked if call[0] == "growth" and call[2] == str(growth)} == GROWN
    assert [call[1:] for call in asked if call[0] == "parts"] == [[str(r), "0.001"] for r in RATES]
    ticks = {(call[3], call[4]) for call in asked if call[0] == "parts-error"}
    assert ticks == {("sine_12", "20000"), ("walk", "200000"), ("sine", "200000")}
    assert max(int(call[2]) for call in asked if call[0] == "parts-error") == 4096
    python = known["python"]
    assert python["throughput_ns"] < python["batch_ns"] < python["step_ns"]
    assert all(mix["throughput"] < mix["tick"] for mix in known["mixes"].values())
    for name in ("mujoco", "newton", "scipy"):  # whose environment is not there
        assert "venv.log" in known["outside"][name]["missing"]


@pytest.mark.parametrize("failing", ["bin/cmake", "build/host/tools/bench/host/host_bench"])
def test_a_run_on_this_host_that_fails_says_why_and_leaves_no_file(bench, failing):
    program(bench, "bin/cmake", ":")
    program(bench, failing, "echo why not >&2; exit 1")
    done = bench.run("host", "--quick")
    assert done.code == 1 and done.err.startswith("error: ") and "why not" in done.err
    assert not (bench.folder / "build/bench/host.json").exists()


def test_rivals_get_the_moves_and_what_is_exact(bench):
    program(bench, "build/bench/venv/bin/python", RIVALS)
    (bench.folder / "build/bench/venv/.complete").touch()
    done = run_host(bench, "--quick")
    known = bench.get("host")
    assert known["outside"] == {"mujoco": {"ns": 7}, "newton": {"missing": "no warp"}}
    assert "newton: no warp" in done.out
    task = json.loads((bench.folder / "task").read_text())
    asked = {call[1]: call[2] for call in calls(bench, "host_bench") if call[0] == "moves"}
    assert asked == dict.fromkeys(task["scenarios"], str(known["ticks"]["outside"]))
    for name, scenario in task["scenarios"].items():
        assert (scenario["moves"], scenario["exact"]) == ([3, -2], [0.25, -0.5])
        assert scenario["theta"] == pytest.approx(2 * np.pi / 2 ** int(name[-2:]), rel=1e-7)
    assert (task["sigma0"], task["Fc"]) == (100.0, 0.5)
    assert 0 < task["solved"] < known["ticks"]["outside"]


# --- tools/bench.sh target -----------------------------------------------------------------------

QEMU = """image=${*: -1}; plugin=${*#*-plugin}; out=$(sed 's/.*out=\\([^ ]*\\).*/\\1/' <<<"$*")
cp "$STAGE/counts.${image##*_}" "$out"; cat "$STAGE/cases.${image##*_}" """
NM = """case $* in
    *libdahl.a*) printf 'a.o:\\n         U __help\\n         U mine\\n'
        printf 'b.o:\\n00000010 T mine\\n         U __aid\\n' ;;
    *bench_*) for n in site back mark; do echo "00000100 T bench_$n"; done ;;
esac"""
SIZE = """case $* in *size_q30*) k=1 ;; *size_counts*) k=2 ;; *) k=3 ;; esac
printf '%s :\\nsection size addr\\n' image
for s in .text:10 .text.hot:1 .rodata.cst4:5 .bss:7 .data:2 .comment:99 .srodata:20 .sbss.x:30 \\
    .sdata:40 .tdata:50 .tbss:60; do echo "${s%:*} $((k * ${s#*:})) 0"; done; echo "Total 324" """


def number(case: str, libc: str) -> int:
    """Instructions of a case, other than of any other."""
    names = [*CASES, *OF_A_LIBC, *OF_RIVALS, *(f"{way}_worst" for way in OF_A_LIBC)]
    return 1000 + 10 * names.index(case) + (5 if libc == "picolibc" else 0)


@pytest.fixture
def cores(bench) -> Bench:
    """With the tools of small cores; each image counts each case twice, the second time less."""
    for tools in ("arm-none-eabi-", "riscv64-unknown-elf-"):
        program(bench, f"bin/{tools}gcc", 'case $* in --version) echo "gcc 12"; echo more ;; esac')
        program(bench, f"bin/{tools}nm", NM)
        program(bench, f"bin/{tools}size", SIZE)
    for name in ("cc", "cmake"):
        program(
            bench, f"bin/{name}", 'while [ $# -gt 1 ]; do [ "$1" = -o ] && touch "$2"; shift; done'
        )
    for name in ("arm", "riscv32"):
        program(bench, f"bin/qemu-system-{name}", QEMU)
    for core in CORES:
        (bench.folder / f"build/{core}/bench").mkdir(parents=True)
        (bench.folder / f"build/{core}/CMakeCache.txt").write_text("CMAKE_C_FLAGS:STRING=-g\n")
    for libc in ("newlib", "picolibc"):
        names = [*CASES, *OF_A_LIBC, *OF_RIVALS, *(f"{way}_worst" for way in OF_A_LIBC)]
        text = "".join(f"case {name}\n" for name in names)
        counts = "".join(f"-\n{number(n, libc)}\n{number(n, libc) - 3}\n" for n in names)
        text += (
            "case motion:walk:counts\nnumber stack_a 48\nnumber stack_b 120\nnumber plan_bytes 24\n"
        )
        (bench.folder / f"cases.{libc}").write_text(text)
        (bench.folder / f"counts.{libc}").write_text(f"{counts}-\n10\n20\n33\n")
    return bench


@pytest.mark.parametrize(
    ("words", "counted"),
    [
        ([], dict.fromkeys(CORES, ["newlib", "picolibc"]) | {"rv32": ["picolibc"]}),
        (["--quick", "rv32", "m3"], {"rv32": ["picolibc"], "m3": ["newlib"]}),
    ],
)
def test_a_number_is_the_worst_of_the_calls_that_it_stands_for(cores, words, counted):
    """Of the cores that are named, with the C libraries that each has; newlib's where it has."""
    done = cores.run("target", *words)
    assert done.code == 0, done.err
    known = cores.get("target")
    assert list(known) == list(counted)
    for name, libcs in counted.items():
        core = known[name]
        at = lambda case, libc=libcs[0]: number(case, libc)  # noqa: E731
        for case in CASES:
            if "_backward" in case:  # counted above the way forward, whatever its form
                assert core[case.replace("_backward", "")] == at(case)
            elif "_forward" not in case and case != "dense_q30":
                assert core[case] == at(case), case
            assert core["cases"][case] == [at(case) - 3, at(case)]
        assert core["dense_q30_most"] - core["dense_q30_least"] == 3
        for libc in libcs:
            for way in OF_A_LIBC:
                assert core[f"{libc}_{way}"] == number(way, libc)
                assert core[f"{libc}_{way}_worst"] == number(f"{way}_worst", libc)
            assert core["motions"][libc] == {"walk": {"counts": 21.0}}  # the mean
        assert set(core["motions"]) == set(libcs) and core["rk4"] == at("rk4")
        assert (core["stack_bytes"], core["plan_bytes"], core["compiler"]) == (120, 24, "gcc 12")
        assert core["helpers"] == ["__aid", "__help"]
        for k, path in enumerate(("", "_counts", "_angle"), 1):
            found = [core[f"{kind}_bytes{path}"] for kind in ("code", "const", "static")]
            assert found == [11 * k, 25 * k, 189 * k]
    line = next(row for row in done.out.splitlines() if "plan bytes" in row)
    assert line.count("24") == len(counted) and "plan_bytes" in BYTES


def test_a_core_that_is_unknown_is_refused_before_anything_is_counted(cores):
    done = cores.run("target", "m3", "m9")
    assert done.code == 2 and not (cores.folder / "calls").exists()
    assert all(re.search(rf"\b{name}\b", done.err) for name in ("m9", *CORES))


@pytest.mark.parametrize(
    ("broken", "named"),
    [
        ("counts", "cases"),
        ("no counts", "cases"),
        ("gcc", "why not"),
        ("no qemu", "qemu-system-arm"),
    ],
)
def test_what_cannot_be_counted_is_an_error_and_leaves_no_file(cores, monkeypatch, broken, named):
    """An image that counts other cases than it names, a tool that fails, one that is not here."""
    if "counts" in broken:
        text = "" if broken == "no counts" else "-\n5\n"
        (cores.folder / "counts.newlib").write_text(text)
    elif broken == "gcc":
        program(cores, "bin/arm-none-eabi-gcc", "echo why not >&2; exit 1")
    else:
        (cores.folder / "bin/qemu-system-arm").unlink()
        for tool in ("bash", "sed", "cp", "cat", "touch"):
            (cores.folder / "bin" / tool).symlink_to(f"/bin/{tool}")
        monkeypatch.setenv("PATH", str(cores.folder / "bin"))
    done = cores.run("target", "--quick", "m3")
    assert done.code == 1 and done.err.startswith("error: ") and named in done.err
    assert not (cores.folder / "build/bench/target.json").exists()
    assert not list((cores.folder / "build/bench").glob("counts.*"))


# --- rivals from outside -------------------------------------------------------------------------


def measured(bench: Bench, monkeypatch, scenarios: dict) -> dict:
    """What outside.py prints of these motions, in its last line."""
    task = {"scenarios": scenarios, "sigma0": 100.0, "Fc": 0.5, "solved": 300}
    monkeypatch.setattr(sys, "stdin", io.StringIO(json.dumps(task)))
    return json.loads(bench.run("outside").out.splitlines()[-1])


def test_a_rival_that_is_not_here_is_named_and_stops_no_other(bench, monkeypatch):
    """399 moves of 0.002 rad, a long one, and the exact answer of Eq. 1."""
    moves, exact, w = [3] * 200 + [-40] + [-2] * 199, [], 0.0
    for move in moves:
        s = np.sign(move)
        w = s + (w - s) * np.exp(-200 * abs(move) * 1e-3)
        exact.append(w)
    found = measured(bench, monkeypatch, {"a": {"theta": 1e-3, "moves": moves, "exact": exact}})
    assert list(found) == ["mujoco", "newton", "scipy"]
    assert found["scipy"]["scenarios"]["a"][0] < 1e-7 and found["scipy"]["ticks"] == 300
    assert 1e3 < found["scipy"]["ns"] < 1e9
    for name in ("mujoco", "newton"):
        one = found[name]
        assert "missing" in one or (one["ticks"] == 400 and one["scenarios"]["a"][0] < 0.2)
