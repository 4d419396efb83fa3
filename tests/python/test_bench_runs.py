# SPDX-License-Identifier: MIT
"""What the runs of tools/bench ask of the programs that they start, and where each answer goes.
Here these programs note their words and answer at once.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace

import pytest

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tools" / "bench"))

import host  # noqa: E402
import outside  # noqa: E402
import target  # noqa: E402

# --- host.py --------------------------------------------------------------------------------------

MOVES = "3 0.25\n-2 -0.5\n"


def answer(words: list[str]) -> list[dict]:
    """Rows of host_bench; 16 parts are enough for 1e-3 and none for 1e-6."""
    what, *rest = words
    if what == "parts-error":
        worst = 5e-4 if int(rest[1]) >= 16 else 0.5
        return [{"worst": str(worst)}]
    if what == "growth":
        return [{"scenario": rest[0], "way": "expf", "ticks": 10, "worst": "inf"}]
    if what == "parts":
        return [{"rate": int(rest[0]), "way": "rk4_parts", "parts": 3}]
    rows = [{"scenario": name, "way": "euler"} for name in ("walk", "sine")]
    if what == "speed":
        return [row | {"ns": 1.5 + n} for n, row in enumerate(rows)]
    return [row | {"worst": "0.25", "rms": "0.125"} for row in rows]


@pytest.fixture
def asked(monkeypatch, tmp_path) -> list[list[str]]:
    """The words of every program that a run starts."""
    calls: list[list[str]] = []

    def run(*words: object, **options: object) -> str:
        called = [str(word) for word in words]
        calls.append(called)
        if called[0] == str(host.PROGRAM):
            if called[1] == "moves":
                return MOVES
            return "".join(json.dumps(row) + "\n" for row in answer(called[1:]))
        if called[-1].endswith("outside.py"):
            calls.append([json.loads(str(options["input"]))])
            return 'warming up\n{"mujoco": {"ns": 7}, "newton": {"missing": "no warp"}}\n'
        return "cc (here) 12\nmore\n"

    monkeypatch.setattr(host, "run", run)
    monkeypatch.setattr(host, "measure_python", lambda: {"step_ns": 900.0})
    monkeypatch.setattr(host, "measure_threads", lambda ticks: {"1": ticks})
    monkeypatch.setattr(host, "measure_mixes", lambda: {"mix": {"tick": 5.0}})
    monkeypatch.setattr(host, "RESULT", tmp_path / "host.json")
    monkeypatch.setattr(host, "VENV", tmp_path / "venv")
    monkeypatch.setattr(host, "OUT", tmp_path)
    (tmp_path / "venv").mkdir()
    (tmp_path / "venv/.complete").touch()
    return calls


@pytest.mark.parametrize(("words", "sizes"), [([], host.WHOLE), (["--quick"], host.QUICK)])
def test_a_run_on_this_host_asks_for_its_sizes_and_keeps_each_answer(asked, tmp_path, words, sizes):
    assert host.main(words) == 0
    known = json.loads((tmp_path / "host.json").read_text())
    assert (known["quick"], known["ticks"]) == (bool(words), vars(sizes))
    assert (known["compiler"], known["python"]) == ("cc (here) 12", {"step_ns": 900.0})
    assert (known["threads"], known["mixes"]) == ({"1": sizes.threads}, {"mix": {"tick": 5.0}})
    assert known["errors"] == {m: {"euler": [0.25, 0.125]} for m in ("walk", "sine")}
    assert known["speed"] == {"walk": {"euler": 1.5}, "sine": {"euler": 2.5}}
    assert [row["rate"] for row in known["rates"]] == list(host.RATES)
    assert [row["scenario"] for row in known["growth"]] == list(host.GROWN)
    assert {row["worst"] for row in known["growth"]} == {host.DIVERGED}
    assert known["outside"] == {"mujoco": {"ns": 7}, "newton": {"missing": "no warp"}}
    enough = [entry for entry in known["parts"] if entry["limit"] == 1e-3]
    assert [(entry["way"], entry["parts"]) for entry in enough] == [(w, 16) for w in host.SOLVERS]
    assert all(entry["worst"] == {"walk": 5e-4, "sine": 5e-4} for entry in enough)
    never = [entry for entry in known["parts"] if entry["limit"] == 1e-6]
    assert [sorted(entry) for entry in never] == [["limit", "parts", "way"]] * len(host.SOLVERS)
    assert {entry["parts"] for entry in never} == {0}
    program = [call[1:] for call in asked if call[0] == str(host.PROGRAM)]
    assert ["errors", str(sizes.errors)] in program and ["speed", str(sizes.speed)] in program
    for motion in host.GROWN:
        assert ["growth", motion, str(sizes.growth)] in program
    for motion in host.OUTSIDE:
        assert ["moves", motion, str(sizes.outside)] in program
    for rate in host.RATES:
        assert ["parts", str(rate), "0.001"] in program
    ticks = {(call[3], call[4]) for call in program if call[0] == "parts-error"}
    assert ticks == {("sine_12", "20000"), ("walk", str(sizes.parts)), ("sine", str(sizes.parts))}


def test_rivals_get_the_moves_and_what_is_exact(asked, capsys):
    found = host.measure_outside(host.QUICK)
    assert "not compared: newton: no warp" in capsys.readouterr().out
    assert list(found) == ["mujoco", "newton"]
    [task] = next(call for call in asked if isinstance(call[0], dict))
    assert list(task["scenarios"]) == list(host.OUTSIDE)
    for name, scenario in task["scenarios"].items():
        assert scenario["moves"] == [3, -2] and scenario["exact"] == [0.25, -0.5]
        bits = int(name[-2:])
        assert scenario["theta"] == pytest.approx(6.283185307 / 2**bits, rel=1e-7)
    assert (task["sigma0"], task["Fc"]) == (100.0, 0.5)
    assert 0 < task["solved"] < host.QUICK.outside


# --- target.py ------------------------------------------------------------------------------------


@pytest.fixture
def measured(monkeypatch, tmp_path) -> list[tuple[str, list[str]]]:
    """Core and C libraries of each count."""
    done: list[tuple[str, list[str]]] = []

    def measure(core: target.Core, libcs: list[str]) -> dict:
        done.append((core.name, libcs))
        return {"core": core.title, "helpers": [], "helpers_O0": [], "plan_bytes": 312}

    monkeypatch.setattr(target, "build_plugin", lambda: done.append(("plugin", [])))
    monkeypatch.setattr(target, "measure", measure)
    monkeypatch.setattr(target, "RESULT", tmp_path / "target.json")
    return done


BOTH = ["newlib", "picolibc"]


@pytest.mark.parametrize(
    ("words", "counted"),
    [
        ([], {name: ["picolibc"] if name == "rv32" else BOTH for name in target.CORES}),
        (["rv32", "m3"], {"rv32": ["picolibc"], "m3": BOTH}),
        (["--quick", "m4f", "rv32"], {"m4f": ["newlib"], "rv32": ["picolibc"]}),
    ],
)
def test_the_cores_that_are_named_are_counted_and_kept(measured, tmp_path, capsys, words, counted):
    assert target.main(words) == 0
    assert measured == [("plugin", []), *counted.items()]
    known = json.loads((tmp_path / "target.json").read_text())
    assert [core["core"] for core in known.values()] == [target.CORES[n].title for n in counted]
    assert list(known) == list(counted)
    shown = capsys.readouterr().out
    assert "needs beside libdahl" in shown
    line = next(x for x in shown.splitlines() if "plan bytes" in x)
    assert line.count("312") == len(counted)


def test_a_core_that_is_unknown_is_refused_before_anything_is_counted(measured, capsys):
    with pytest.raises(SystemExit) as end:
        target.main(["m3", "m9"])
    assert end.value.code == 2 and not measured
    words = f"unknown core m9; known are {' '.join(target.CORES)}"
    assert words in capsys.readouterr().err and {"m0", "m4f", "rv32"} < target.CORES.keys()


FORMS = ("q30", "float")
MOVES_NAMED = ("one_count", "eight_counts", "1000_counts")
SINGLE = ("zero", "int32_min", "reversal", "counts_worst")
OTHERS = ("angle_zero", "angle_worst", "prepare", "torque", "set_torque", "change_plan")
OTHERS += (
    "counts_between",
    "counts_between_below",
    "encoder_move",
    "encoder_move_other",
    "encoder_move_jump",
)
OTHERS += ("to_units", "control_tick", "control_tick_units")


def test_a_number_is_the_worst_of_the_calls_that_it_stands_for():
    cases, wanted, next_number = {}, {}, iter(range(1000, 9000, 10))
    for form in FORMS:
        for n, move in enumerate(MOVES_NAMED):
            there, back = next(next_number), next(next_number)
            there, back = (back, there) if n % 2 else (there, back)
            cases[f"{move}_forward_{form}"] = [there, there - 3]
            cases[f"{move}_backward_{form}"] = [back - 5, back]
            wanted[f"{move}_{form}"] = max(there, back)
        for move in SINGLE:
            most = next(next_number)
            cases[f"{move}_{form}"], wanted[f"{move}_{form}"] = [most - 1, most], most
    for name in (*OTHERS, "slip_4", "crossing_q30", "asymmetric_prepare", "parallel_2"):
        most = next(next_number)
        cases[name], wanted[name] = [most, most - 1], most
    cases["dense_q30"] = [18, 21, 17, 20]
    cases["euler"] = [5]  # of a rival: not the library's
    numbers = {"stack_step": 48, "stack_prepare": 120, "stack_torque": 8, "plan_bytes": 312}
    found = target.library_numbers(cases, numbers)
    wanted |= {"dense_q30_least": 17, "dense_q30_most": 21, "stack_bytes": 120}
    assert found == wanted | numbers


# --- rivals from outside --------------------------------------------------------------------------

TASK = {"sigma0": 100.0, "Fc": 0.5, "solved": 300}
SCENARIO = {"theta": 1e-3, "moves": [3, -2], "exact": [0.0, 0.0]}


def test_mujoco_gets_the_joints_speed_and_says_its_deflection(monkeypatch):
    """A stand-in whose state after a step is the travel: MuJoCo's is a deflection in rad."""
    seen, fake = {}, ModuleType("mujoco")

    def from_xml_string(text: str) -> SimpleNamespace:
        seen["lugre"] = [float(x) for x in text.partition('lugre="')[2].partition('"')[0].split()]
        seen["step"] = float(text.partition('timestep="')[2].partition('"')[0])
        return SimpleNamespace()

    def step(_: object, data: SimpleNamespace) -> None:
        data.act[0] += data.qvel[0] * seen["step"]

    def reset(_: object, data: SimpleNamespace) -> None:
        data.act[0] = 0.0

    fake.MjModel = SimpleNamespace(from_xml_string=from_xml_string)
    fake.MjData = lambda model: SimpleNamespace(qvel=[0.0], act=[9.0])
    fake.mj_resetData, fake.mj_step = reset, step
    monkeypatch.setitem(sys.modules, "mujoco", fake)
    run = outside.mujoco_way(TASK)
    assert seen["lugre"] == [100.0, 0.0, 0.5, 0.5, 1.0]
    for _ in range(2):
        assert run(SCENARIO) == pytest.approx([0.003 * 200, 0.001 * 200])


def test_newton_gets_angles_and_says_torques(monkeypatch):
    """A stand-in for the kernel that multiplies the angle by Fc over tau, the slope at rest."""
    warp, kernel = ModuleType("warp"), ModuleType("outside_newton")
    warp.array = lambda values, dtype, device: values.copy()

    class Out(list):
        def numpy(self):
            return outside_array(self)

    def outside_array(values: list):
        import numpy as np

        return np.array(values, np.float32)

    def launch(advance: object, dim: int, inputs: list, device: str) -> None:
        assert dim == 1  # a tick needs the one before it
        moves, out, Fc, tau = inputs  # noqa: N806
        out += [Fc / tau * move for move in moves]

    warp.empty = lambda n, dtype, device: Out()
    warp.launch, kernel.advance = launch, object()
    monkeypatch.setitem(sys.modules, "warp", warp)
    monkeypatch.setitem(sys.modules, "outside_newton", kernel)
    found = outside.newton_way(TASK)(SCENARIO)
    assert found == pytest.approx([200 * 3e-3, -200 * 2e-3])  # sigma0 x/Fc


def test_a_rival_is_timed_a_tick_without_its_first_use(monkeypatch):
    """First use takes 100 s; then a tick of the three motions 2, 9 and 5 s: the median counts."""
    clock, asked = [0.0], []

    def make(task: dict):
        def run(scenario: dict) -> list[float]:
            asked.append(len(scenario["moves"]))
            clock[0] += len(scenario["moves"]) * scenario["slow"] if asked[1:] else 100.0
            return [0.5] * len(scenario["moves"])

        return run

    monkeypatch.setattr(outside.time, "perf_counter", lambda: clock[0])
    motions = {
        name: {"moves": [1] * n, "exact": [0.5] * (n - 1) + [0.75], "slow": slow}
        for name, n, slow in (("a", 20, 2.0), ("b", 4, 9.0), ("c", 5, 5.0))
    }
    found = outside.measure(make, {"scenarios": motions})
    assert asked == [10, 20, 4, 5]
    assert (found["ns"], found["ticks"]) == (5e9, 29)
    assert found["scenarios"]["b"] == [0.25, pytest.approx(0.125)]
