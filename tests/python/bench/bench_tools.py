# SPDX-License-Identifier: MIT
"""Run the commands of tools/bench on a copy of the project, in this process, with the files of a
made-up run. All its numbers are different.
"""

from __future__ import annotations

import contextlib
import io
import itertools
import json
import re
import runpy
import shutil
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from conftest import ROOT
from dahl.binding import models
from matplotlib import pyplot
from matplotlib.figure import Figure

BENCH = ROOT / "tools/bench"
MODULES = [path.stem for path in BENCH.glob("*.py")]
PAGES = ("README.md", "docs/microcontroller.md", "docs/speed.md")


@dataclass
class Run:
    code: int
    out: str
    err: str


class Bench:
    def __init__(self, folder: Path) -> None:
        self.folder = folder
        (folder / "tools/bench").mkdir(parents=True)
        (folder / "docs/pictures").mkdir(parents=True)
        (folder / "build/bench").mkdir(parents=True)
        (folder / "data/tribometer").mkdir(parents=True)  # a set without its log
        for path in BENCH.glob("*.*"):
            shutil.copy(path, folder / "tools/bench")
        for page in PAGES:
            shutil.copy(ROOT / page, folder / page)

    def put(self, **files: Any) -> None:
        for name, content in files.items():
            (self.folder / f"build/bench/{name}.json").write_text(json.dumps(content))

    def get(self, name: str) -> Any:
        return json.loads((self.folder / f"build/bench/{name}.json").read_text())

    def block(self, page: str, name: str) -> str:
        return block_of(self.folder / page, name)

    def run(self, command: str, *words: str, draw: bool = False) -> Run:
        """Run a command. Without `draw`, its pictures are empty files."""
        script = self.folder / f"tools/bench/{command}.py"
        done, out, err = Run(0, "", ""), io.StringIO(), io.StringIO()
        with pytest.MonkeyPatch.context() as patch, contextlib.ExitStack() as stack:
            patch.setattr(sys, "argv", [str(script), *words])
            if not draw:
                patch.setattr(Figure, "savefig", lambda _, path, **__: path.write_bytes(b""))
            patch.setenv("DAHL_DATA", str(self.folder / "data"))
            patch.syspath_prepend(str(script.parent))
            for name in MODULES:
                patch.delitem(sys.modules, name, raising=False)
            stack.enter_context(contextlib.redirect_stdout(out))
            stack.enter_context(contextlib.redirect_stderr(err))
            try:
                runpy.run_path(str(script), run_name="__main__")
            except SystemExit as end:
                done.code = int(end.code or 0)
            finally:
                pyplot.close("all")
                for name in MODULES:
                    sys.modules.pop(name, None)
        done.out, done.err = out.getvalue(), err.getvalue()
        return done


def block_of(page: Path, name: str) -> str:
    start, end = (f"<!-- {slash}bench:{name} -->\n" for slash in ("", "/"))
    return page.read_text().partition(start)[2].partition(end)[0]


def rows_of(block: str) -> tuple[list[str], dict[str, list[str]]]:
    """Return the names of the columns and the cells of each row of the table in a block."""
    lines = [line for line in block.splitlines() if line.startswith("|")]
    assert len({line.count("|") for line in lines}) == 1  # otherwise no page shows it as a table
    head, _, *rows = [[cell.strip() for cell in line[1:-1].split("|")] for line in lines]
    return head[1:], {row[0]: row[1:] for row in rows}


# --- what a run is made of -----------------------------------------------------------------------

CORES = ("m0", "m3", "m4f", "m7", "m33", "rv32")
SMALL = ("m0", "m3", "m4f")
FEW = ("walk_20", "sine_12", "two_one_24")
JUMPS = "leap_14"  # reported separately
MOTIONS = (*FEW, JUMPS)
CALLS = ("counts_q30", "counts", "angle")  # ours, on a core
BATCHES = ("batch_counts", "throughput_counts", "throughput_angle")  # ours, on the host
RIVALS = ("expm1f", "expf", "exp_double", "expm1_double", "anchored", "direct", "table")
RIVALS += ("table_counts", "euler", "rk4", "backward", "trapezoid")
SOLVERS = ("euler", "rk4", "backward", "trapezoid")
HOST_NAMES = {"backward": "backward_parts", "trapezoid": "trapezoid_parts"}

MOVES = [f"{move}_{way}" for move in ("one_count", "one_count_c", "eight_counts", "1000_counts")
         for way in ("forward", "backward")]  # fmt: skip
BY_FORM = [*MOVES, "zero", "int32_min", "reversal", "counts_worst"]
CASES = [f"{case}_{form}" for case in BY_FORM for form in ("q30", "float")]
CASES += """angle_zero angle_worst angle_c_worst prepare torque set_torque change_plan
    counts_between counts_between_below encoder_move encoder_move_other encoder_move_jump to_units
    control_tick control_tick_units slip_1_q30 slip_2_q30 slip_4_q30 slip_8_q30 slip_4
    slip_prepare_8 parallel_2 parallel_4 parallel_2_q30 parallel_4_q30 mixed_2_q30 mixed_4_q30
    coulomb loaded_q30 loaded_more_q30 loaded_float clamped_float
    elastic_q30 plastic_q30 crossing_q30 crossing_float work_step work_step_q30 work_read
    counts_to_torque counts_to_torque_fine tip_torque_1000 tip_torque tip_torque_fine
    velocity_torque_q30 velocity_torque compensator_tick compensator_pull adaptation_step
    compensator_prepare dense_q30""".split()
DIRECTED = [model.name for model in models.table().values() if model.has_directions]
CASES += [f"{name}_{call}" for name in DIRECTED for call in ("q30", "float", "prepare")]
OF_A_LIBC = ("expm1f", "expf", "exp_double")
OF_RIVALS = ("euler", "rk4", "table")
BYTES = ("code_bytes", "code_bytes_angle", "const_bytes_angle", "static_bytes_angle")
BYTES += ("plan_bytes", "state_bytes", "stack_bytes")
KEYS = [re.sub("_(forward|backward)", "", case) for case in CASES]
KEYS += [f"{libc}_{way}" for libc in ("newlib", "picolibc") for way in OF_A_LIBC]
KEYS = [*dict.fromkeys([*KEYS, *OF_RIVALS, *BYTES])]
WITH_CYCLES = ("one_count_q30", "one_count_float", "angle_worst", "control_tick_units")
WITH_CYCLES += ("control_tick", "compensator_tick", "newlib_expm1f")
SEARCHED = ("encoder_move", "step_counts_q30", "step_counts", "step", "to_units")
SEARCHED += ("control_tick_units", "control_tick", "compensator_tick")
WORST_INPUT = (0x3F000000, (1 << 64) - (1 << 60), (1 << 32) - 2)  # travel 0.5, w -0.25, 2 back


def made_target() -> dict[str, dict]:
    """Return a target.json with two C libraries; rv32 has no newlib. Pages use newlib."""
    number = itertools.count(1000)
    ways = ["floor", *CALLS, *RIVALS, *(f"{s}_parts_{n}" for n in (9, 17) for s in SOLVERS)]
    result: dict[str, dict] = {}
    for core in CORES:
        libcs = ("picolibc",) if core == "rv32" else ("newlib", "picolibc")
        motions = {
            libc: {motion: {way: 1.37 * next(number) for way in ways} for motion in MOTIONS}
            for libc in libcs
        }
        named = {"core": f"Core {core}", "compiler": "cc 1", "motions": motions}
        helped = {"helpers": [f"__help_{core}"], "helpers_O0": []}
        result[core] = {key: next(number) for key in KEYS} | named | helped
        result[core]["worst"] = {
            call: {
                "instructions": next(number),
                "cycles": [next(number), next(number)],
                "input": WORST_INPUT,
            }
            for call in SEARCHED
        }
        if core in SMALL:
            result[core]["cycles"] = {key: [next(number), next(number)] for key in WITH_CYCLES}
    del result["rv32"]["newlib_expf"]
    return result


MADE_HERE = {
    "quick": False,
    "cpu": "a processor",
    "compiler": "a compiler",
    "ticks": {"threads": 7000},
    "python": {"throughput_ns": 2.0, "batch_ns": 3.0, "step_ns": 500.0},
    "calls": {
        "python": "3.99",
        "single": {"float": 50, "message": 400, "step_counts": 250, "receive": 1640}
        | {"receive_now": 2120},
        "logs": {
            "ticks": [1, 10, 100, 1000000],
            "ns": {"friction": [3000.0, 3100.0, 3210.0, 2.7e6]},
            "missing": {"numba": "no numba"},
        },
    },
    "outside": {
        "mujoco": {"scenarios": {"walk_20": [1e-4, 1e-5]}, "ns": 6000.0},
        "newton": {"missing": "not here"},
    },
}


def made_host() -> dict[str, Any]:
    """Return a host.json of a full run on a machine with eight cores, without Newton."""
    number = itertools.count(1)
    ways = [*BATCHES, *(HOST_NAMES.get(way, way) for way in RIVALS), "double_state"]
    errors = {m: {way: [next(number) * 1e-9, 0.5] for way in (*CALLS, *ways)} for m in MOTIONS}
    errors["walk_20"]["euler"][0] = 7.0
    channels = ("batch_counts_16", "throughput_counts_16", "throughput_angle_16")
    raced = (*ways, *channels, *(f"{way}_apart" for way in channels[:2]), "copy")
    grown = ("counts", "throughput_counts", "expm1f", "expf", "anchored", "table_counts")
    worst = dict.fromkeys(MOTIONS, 3e-7)
    parts = [("rk4", 1e-6, 25), ("euler", 1e-3, 1), ("backward", 1e-6, 0), ("trapezoid", 1e-3, 0)]
    slips = enumerate(("slip_1", "slip_2", "slip_4", "slip_8", "mix"))
    return MADE_HERE | {
        "mixes": {name: {"tick": 10.0 * k + 5, "throughput": 2.0} for k, name in slips},
        "threads": {"1": 3.0, "2": 2.0, "8": 0.5},
        "parts": [
            {"way": f"{s}_parts", "limit": limit, "parts": n} | ({"worst": worst} if n else {})
            for s, limit, n in parts
        ],
        "rates": [
            {"rate": rate, "way": f"{solver}_parts", "parts": parts}
            for rate, parts in ((100, 17), (1000, 9), (3000, 0))
            for solver in SOLVERS
        ],
        "errors": errors,
        "speed": {  # the time of the plain loop grows with the motion, so that means differ
            motion: {way: next(number) * (1.0 + 2 * k * (way == "expm1f")) for way in raced}
            for k, motion in enumerate(MOTIONS)
        },
        "growth": [
            {"scenario": motion, "way": way, "ticks": ticks, "worst": next(number) * 1e-12}
            for way in grown
            for ticks in (1000, 100)
            for motion in ("a", "b")
        ],
    }
