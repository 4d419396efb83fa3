# SPDX-License-Identifier: MIT
"""CBMC over the real sources: no undefined behaviour for any input, and the range theorem.

    tools/test.sh -k cbmc

The checks are functions of cbmc_*.c. If a check calls a function that another check proves, a
stand-in replaces it, which returns any allowed result (goto-instrument --replace-calls). Checks of
the core run twice, because compiler.h and fixed.h have a form for GNU C and one for plain C.
"""

import re
from dataclasses import dataclass, field, replace
from pathlib import Path

import pytest
from _pytest.mark.structures import ParameterSet
from conftest import ROOT, need
from programs import call
from sources import INCLUDES, as_one

HERE = Path(__file__).parent
# Not --conversion-check: the sources rely on the conversion to signed modulo 2^32, which C99 leaves
# to the implementation.
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
UPDATES_BY_ANGLE = PRODUCTS | {
    "dahl_forward_by_angle": "any_forward_by_angle",
    "dahl_backward_by_angle": "any_backward_by_angle",
}

MOVES = UPDATES | {"dahl_step_large": "any_move"}


@dataclass(frozen=True)
class Proof:
    """A function of a harness, the bound of its loops, and its stand-ins."""

    function: str
    unwind: int = 3
    instead: dict[str, str] = field(default_factory=dict)
    harness: str = "cbmc_core.c"
    long: bool = False
    flags: tuple[str, ...] = ()  # -U__GNUC__: the form for other compilers

    @property
    def claim(self) -> str:
        return f"{self.function} of tests/proof/{self.harness}"


CORE = [
    Proof("check_normalise", 65),
    Proof("check_update", instead=PRODUCTS),
    Proof("check_update_by_angle", instead=PRODUCTS),
    Proof("check_step_large", 34, UPDATES),
    Proof("check_step_counts_q30", 3, MOVES),
    Proof("check_step_counts", 5, MOVES),
    Proof("check_step", 5, UPDATES_BY_ANGLE),
    Proof("check_torque", 5, PRODUCTS),
    Proof("check_set_torque", 65, PRODUCTS),
    Proof("check_change_plan", 65, PRODUCTS),
    Proof("check_counts_between"),
    Proof("check_to_units"),
]
PROOFS = [
    *CORE,
    *(replace(proof, flags=("-U__GNUC__",)) for proof in CORE),
    Proof("check_encoder_move", 33, {"dahl_shortest_move": "any_way"}, "cbmc_encoder.c"),
    Proof("check_encoder_way", 33, {"dahl_shortest_move": "any_way"}, "cbmc_encoder.c"),
    Proof("check_text_feed", harness="cbmc_text.c"),
    Proof("check_slcan_take", 66, harness="cbmc_slcan.c", long=True),
    Proof("check_slcan_write", 30, harness="cbmc_slcan.c", long=True),
]


def run(command: list[str], allowed: tuple[int, ...] = (0,)) -> str:
    done = call(*command, timeout=1700)
    assert done.returncode in allowed, f"{command}\n{done.stdout[-3000:]}\n{done.stderr[-3000:]}"
    return done.stdout


def compiled(proof: Proof, bin_folder: Path, folder: Path) -> str:
    whole, ready = str(folder / "whole.goto"), str(folder / "ready.goto")
    as_one(folder)
    includes = [f"-I{path}" for path in (folder, HERE, ROOT)]
    command = [str(bin_folder / "goto-cc"), "-std=c99", *proof.flags, *includes, *INCLUDES]
    command.append(str(HERE / proof.harness))
    run([*command, "--function", proof.function, "-o", whole])
    swaps = [f"--replace-calls={old}:{new}" for old, new in proof.instead.items()]
    swap = [word for each in swaps for word in each.split("=")]
    tool = str(bin_folder / "goto-instrument")
    run([tool, *swap, "--drop-unused-functions", whole, ready])
    return ready


def failures(proof: Proof, folder: Path) -> list[str]:
    """The statements that do not hold. There must be at least one statement."""
    cbmc = need("cbmc", proof.claim)
    ready = compiled(proof, Path(cbmc).parent, folder)
    limits = ["--unwind", str(proof.unwind)]
    said = run([cbmc, ready, "--function", proof.function, *CHECKS, *limits], allowed=(0, 10))
    found = re.search(r"^\*\* (\d+) of (\d+) failed", said, re.MULTILINE)
    assert found is not None and int(found[2]) > 0, said[-3000:]
    wrong = [line for line in said.splitlines() if line.endswith(": FAILURE")]
    assert len(wrong) == int(found[1]), said[-3000:]
    return wrong


def marked(proof: Proof) -> ParameterSet:
    marks = [pytest.mark.long] if proof.long else []
    form = "-plain" if proof.flags else ""
    return pytest.param(proof, id=proof.function.removeprefix("check_") + form, marks=marks)


@pytest.mark.parametrize("proof", [marked(proof) for proof in PROOFS])
def test_no_input_does_harm(proof: Proof, tmp_path: Path) -> None:
    assert failures(proof, tmp_path) == []


def test_every_check_is_run() -> None:
    """CBMC proves only the functions that PROOFS lists."""
    asked = {(proof.harness, proof.function) for proof in PROOFS}
    for harness in HERE.glob("cbmc_*.c"):
        text = harness.read_text()
        names = re.findall(r"^void (check_\w+)\(", text, re.MULTILINE)
        assert names
        assert {(harness.name, name) for name in names} <= asked
