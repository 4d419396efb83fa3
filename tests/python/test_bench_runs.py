# SPDX-License-Identifier: MIT
"""The runs of tools/bench call other programs and store their answers. The programs are stand-ins
that record their words.
"""

from __future__ import annotations

import io
import json
import os
import re
import sys

import numpy as np
import pytest
from bench_tools import CORES, Bench, Run


@pytest.fixture
def bench(tmp_path, monkeypatch, library) -> Bench:
    """A copy with bin/ first in PATH."""
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
    """Return the words of each call of a program."""
    noted = bench.folder / "calls"
    lines = noted.read_text().splitlines() if noted.exists() else []
    return [line.split()[1:] for line in lines if line.split()[0] == name]


# --- tools/bench.sh host -------------------------------------------------------------------------

# 16 parts reach 1e-3; no number of parts reaches 1e-6.
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
def test_a_host_run_stores_each_answer(bench, words, growth):
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
    for name in ("mujoco", "newton", "scipy"):  # their environment is missing
        assert "venv.log" in known["outside"][name]["missing"]


@pytest.mark.parametrize("failing", ["bin/cmake", "build/host/tools/bench/host/host_bench"])
def test_a_failed_host_run_is_an_error_without_a_result(bench, failing):
    program(bench, "bin/cmake", ":")
    program(bench, failing, "echo why not >&2; exit 1")
    done = bench.run("host", "--quick")
    assert done.code == 1 and done.err.startswith("error: ") and "why not" in done.err
    assert not (bench.folder / "build/bench/host.json").exists()


def test_other_simulators_get_moves_and_exact_results(bench):
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

QEMU = """counts=$(sed 's/.*out=\\([^ ]*\\).*/\\1/' <<<"$*"); cp "$STAGE/counts" "$counts"
echo case one_count; echo case two_counts"""
NM = 'for n in site back mark; do echo "00000100 T bench_$n"; done'


@pytest.fixture
def cores(bench) -> Bench:
    """Stand-ins for the tools of small cores. The image names two cases."""
    program(bench, "bin/arm-none-eabi-gcc", "echo gcc 12")
    program(bench, "bin/arm-none-eabi-nm", NM)
    program(bench, "bin/cc", 'while [ $# -gt 1 ]; do [ "$1" = -o ] && touch "$2"; shift; done')
    program(bench, "bin/cmake", ":")
    program(bench, "bin/qemu-system-arm", QEMU)
    return bench


def test_an_unknown_core_is_refused_before_a_count(cores):
    done = cores.run("target", "m3", "m9")
    assert done.code == 2 and not (cores.folder / "calls").exists()
    assert all(re.search(rf"\b{name}\b", done.err) for name in ("m9", *CORES))


@pytest.mark.parametrize(
    ("broken", "named"),
    [
        ("counts", "2 cases and the plugin saw 1"),
        ("no counts", "2 cases and the plugin saw 0"),
        ("gcc", "reason"),
        ("no qemu", "qemu-system-arm"),
    ],
)
def test_a_failed_count_is_an_error_without_a_result(cores, monkeypatch, broken, named):
    """An image with other cases than it names, a tool that fails, a tool that is missing."""
    (cores.folder / "counts").write_text("" if broken == "no counts" else "-\n5\n")
    if broken == "gcc":
        program(cores, "bin/arm-none-eabi-gcc", "echo reason >&2; exit 1")
    elif broken == "no qemu":
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
    """Return the last line of outside.py for these motions."""
    task = {"scenarios": scenarios, "sigma0": 100.0, "Fc": 0.5, "solved": 300}
    monkeypatch.setattr(sys, "stdin", io.StringIO(json.dumps(task)))
    return json.loads(bench.run("outside").out.splitlines()[-1])


def test_a_missing_simulator_is_named(bench, monkeypatch):
    """399 short moves and a long one, with the exact solution of Eq. 1."""
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
