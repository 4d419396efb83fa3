# SPDX-License-Identifier: MIT
"""CBMC over the real sources: no undefined behaviour for any input, and the range theorem.

    tools/test.sh -k cbmc

The checks are functions of cbmc_*.c. Where one calls a function that another check has settled, a
stand-in takes its place that returns whatever that check allows (goto-instrument --replace-calls).
The planted faults are run on changed copies of the sources: each must be seen.
"""

from __future__ import annotations

import re
import subprocess
from dataclasses import dataclass, field, replace
from pathlib import Path

import planting
import pytest
from _pytest.mark.structures import ParameterSet
from conftest import ROOT, need

HERE = Path(__file__).parent
# Not --conversion-check: C99 lets an implementation define what a number too large becomes as a
# signed one, and all that are in use take it modulo 2^32; the sources rely on that.
CHECKS = [
    "--bounds-check",
    "--pointer-check",
    "--pointer-overflow-check",
    "--pointer-primitive-check",
    "--signed-overflow-check",
    "--undefined-shift-check",
    "--div-by-zero-check",
    "--unwinding-assertions",
]
PRODUCTS = {"dahl_mul": "any_product", "dahl_mulhi": "any_upper_half"}
UPDATES = PRODUCTS | {"dahl_forward": "any_forward", "dahl_backward": "any_backward"}
MOVES = UPDATES | {"dahl_move_digits": "any_move"}


@dataclass(frozen=True)
class Proof:
    """A function of a harness, how far its loops go, and what stands in for what."""

    function: str
    unwind: int = 3
    instead: dict[str, str] = field(default_factory=dict)
    harness: str = "cbmc_core.c"
    solver: tuple[str, ...] = ()
    long: bool = False

    @property
    def claim(self) -> str:
        return f"{self.function} of tests/proof/{self.harness}"


PROOFS = [
    Proof("check_upper_half", solver=("--z3",)),
    Proof("check_update", instead=PRODUCTS),
    Proof("check_move_digits", 34, UPDATES),
    Proof("check_step_counts_q30", 3, MOVES),
    Proof("check_step_counts", 5, MOVES),
    Proof("check_step", 5, UPDATES),
    Proof("check_torque", 5, PRODUCTS),
    Proof("check_set_torque", 65, PRODUCTS),
    Proof("check_change_plan", 65, PRODUCTS),
    Proof("check_fill_table_ends", 175, PRODUCTS | {"dahl_mulhi64": "any_word"}),
    Proof("check_fill_table", 175, PRODUCTS | {"dahl_mulhi64": "any_word"}, long=True),
    Proof("check_prepare", 65, PRODUCTS | {"fill_table": "any_table"}),
    Proof("check_two_words"),
    Proof("check_counts_between"),
    *(
        Proof(f"check_{message}", 33, harness="cbmc_frames.c", long=True)
        for message in ("encoder", "torque", "status", "param_write", "param_reply", "reset")
    ),
    Proof("check_crc", 33, harness="cbmc_frames.c"),
    Proof("check_text_feed", harness="cbmc_text.c"),
    Proof("check_slcan_take", 30, harness="cbmc_slcan.c", long=True),
    Proof("check_slcan_write", 30, harness="cbmc_slcan.c", long=True),
]


def run(command: list[str], allowed: tuple[int, ...] = (0,)) -> str:
    done = subprocess.run(command, capture_output=True, text=True, timeout=280, check=False)
    assert done.returncode in allowed, f"{command}\n{done.stdout[-3000:]}\n{done.stderr[-3000:]}"
    return done.stdout


def compiled(proof: Proof, bin_folder: Path, sources: Path, folder: Path) -> str:
    """The checks as CBMC takes them, with the stand-ins in place."""
    whole, ready = str(folder / "whole.goto"), str(folder / "ready.goto")
    includes = [f"-I{path}" for path in (sources / "lib", sources / "lib/include", sources / "port", HERE, sources)]
    command = [str(bin_folder / "goto-cc"), "-std=c99", *includes, str(HERE / proof.harness)]
    run([*command, "--function", proof.function, "-o", whole])
    swaps = [f"--replace-calls={old}:{new}" for old, new in proof.instead.items()]
    swap = [word for each in swaps for word in each.split("=")]
    tool = str(bin_folder / "goto-instrument")
    run([tool, *swap, "--drop-unused-functions", whole, ready])
    return ready


def failures(proof: Proof, sources: Path, folder: Path) -> list[str]:
    """The statements that do not hold; there is at least one statement."""
    cbmc = need("cbmc", proof.claim)
    if proof.solver:
        need("z3", proof.claim)
    ready = compiled(proof, Path(cbmc).parent, sources, folder)
    limits = ["--unwind", str(proof.unwind), *proof.solver]
    said = run([cbmc, ready, "--function", proof.function, *CHECKS, *limits], allowed=(0, 10))
    found = re.search(r"^\*\* (\d+) of (\d+) failed", said, re.MULTILINE)
    assert found is not None and int(found[2]) > 0, said[-3000:]
    wrong = [line for line in said.splitlines() if line.endswith(": FAILURE")]
    assert len(wrong) == int(found[1]), said[-3000:]
    return wrong


def marked(proof: Proof) -> ParameterSet:
    marks = [pytest.mark.long] if proof.long else []
    return pytest.param(proof, id=proof.function.removeprefix("check_"), marks=marks)


@pytest.mark.parametrize("proof", [marked(proof) for proof in PROOFS])
def test_no_input_does_harm(proof: Proof, tmp_path: Path) -> None:
    assert failures(proof, ROOT, tmp_path) == []


def test_every_check_is_run() -> None:
    """A function that nobody asks for would prove nothing."""
    asked = {(proof.harness, proof.function) for proof in PROOFS}
    for harness in HERE.glob("cbmc_*.c"):
        text = harness.read_text()
        names = re.findall(r"^void (check_\w+)\(", text, re.MULTILINE)
        names += [f"check_{name}" for name in re.findall(r"^CHECK\((\w+),", text, re.MULTILINE)]
        assert names
        assert {(harness.name, name) for name in names} <= asked


@dataclass(frozen=True)
class Fault:
    """A change of one place of the sources, the check that sees it, and what that says."""

    file: str
    old: str
    new: str
    check: str
    says: str
    long: bool = True


FAULTS = {
    "dense_10": Fault(
        "lib/gap.h", "DAHL_DENSE 8", "DAHL_DENSE 10", "move_digits", "dereference", long=False
    ),
    "no_far_moves": Fault(
        "lib/counts_q30.c", "dcounts > DAHL_DENSE", "dcounts > 64", "step_counts_q30", "dereference"
    ),
    "shift_by_32": Fault("lib/kernel.h", "v.shift < 2)", "v.shift < 0)", "step", "shift"),
    "tiny_too_far": Fault(
        "lib/kernel.h", "v.shift < 64", "v.shift < 65", "step", "shift", long=False
    ),
    "gap_too_large": Fault(
        "lib/gap.h",
        "w, DAHL_ONE_Q30 + dahl_q30(w)",
        "w, dahl_q30(w) - DAHL_ONE_Q30",
        "update",
        "overflow",
        long=False,
    ),
    "past_the_target": Fault(
        "lib/gap.h",
        "w, DAHL_ONE_Q30 - dahl_q30(w)",
        "w, DAHL_ONE_Q30 + 1u - dahl_q30(w)",
        "update",
        "forward, in range",
    ),
    "no_clamp": Fault(
        "lib/change_plan.c",
        "return product > DAHL_ONE_Q62 ? DAHL_ONE_Q62 : product;",
        "return product;",
        "change_plan",
        "state in range",
    ),
    "shift_of_64": Fault(
        "lib/change_plan.c", "shift < -63 ?", "shift < -64 ?", "change_plan", "shift"
    ),
    "no_limit_of_F": Fault(
        "lib/set_torque.c", "shift > 63 ?", "shift > 64 ?", "set_torque", "shift"
    ),
    "table_too_long": Fault(
        "lib/prepare.c", "n < TABLE; n++", "n <= TABLE; n++", "fill_table_ends", "dereference"
    ),
    "travel_unchecked": Fault(
        "lib/prepare.c", ">= 50)", ">= 51)", "prepare", "a size that check_fill_table has had"
    ),
    "turn_unreduced": Fault(
        "lib/encoder.c", "now %= counts_per_turn;", "", "counts_between", "the shortest way"
    ),
    "crc_of_9_bytes": Fault(
        "port/frames.c", "size_t i = 1; i < 8;", "size_t i = 1; i < 9;", "crc", "dereference"
    ),
    "write_before_check": Fault(
        "port/frames.c",
        "result == FRAMES_GOOD) {\n        out->counter = frame->data[1] & 0x0F;\n"
        "        out->valid",
        "result != FRAMES_BAD_FORMAT) {\n"
        "        out->counter = frame->data[1] & 0x0F;\n        out->valid",
        "encoder",
        "nothing written",
    ),
    "line_too_long": Fault(
        "port/slcan/slcan.c",
        "if (self->length < SLCAN_LINE_MAX)",
        "if (self->length <= SLCAN_LINE_MAX)",
        "slcan_take",
        "bound",
    ),
    "element_too_long": Fault(
        "port/socketcand/text.c",
        "TEXT_ELEMENT_MAX - s->length",
        "TEXT_ELEMENT_MAX + 1 - s->length",
        "text_feed",
        "room for its end",
    ),
    "nine_bytes_of_data": Fault(
        "port/slcan/slcan.c", "if (length > 8u)", "if (length > 9u)", "slcan_take", "a bus carries"
    ),
}


def planted(fault: Fault, folder: Path) -> Path:
    """A copy of the sources with the fault."""
    planting.edit(planting.copy(folder) / fault.file, fault.old, fault.new)
    return folder


@pytest.mark.parametrize(
    "fault",
    [
        pytest.param(fault, id=name, marks=[pytest.mark.long] if fault.long else [])
        for name, fault in FAULTS.items()
    ],
)
def test_planted_fault_is_seen(fault: Fault, tmp_path: Path) -> None:
    proof = next(each for each in PROOFS if each.function == f"check_{fault.check}")
    wrong = failures(proof, planted(fault, tmp_path), tmp_path)
    assert any(fault.says in line for line in wrong), wrong


def test_planted_range_one_too_wide_is_seen(tmp_path: Path) -> None:
    """The range is tight: from its upper end, which no call reaches, an update would overflow."""
    planting.copy(tmp_path, ["lib"])
    for file in ("cbmc_core.c", "cbmc_ranges.h", "products.h"):
        text = (HERE / file).read_text()
        (tmp_path / file).write_text(text.replace("w < STATE_END;", "w <= STATE_END;"))
    proof = next(each for each in PROOFS if each.function == "check_update")
    wide = replace(proof, harness=str(tmp_path / "cbmc_core.c"))
    assert any("overflow on signed -" in line for line in failures(wide, tmp_path, tmp_path))
