# SPDX-License-Identifier: MIT
"""What firmware links on each small core, from the compiler's own frames, call graph and symbols.

Stack: no recursion, no frame of unknown size, the deepest way of the integer path within
tests/target/budgets.json (the emulator's measured depth, in tests/python/test_target.py, has the
same limit). Symbols: the integer path needs nothing but itself and two integer helpers of the
compiler; receiver and codec no heap, no printing, no libm, no variable.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

import pytest
import small_cores
import static_tools as static
from conftest import ROOT
from small_cores import Calls

CLAIM = "firmware has a bound on its stack, and links no heap, printing, libm or float helper"
LIMITS = json.loads((ROOT / "tests/target/budgets.json").read_text())["bytes at most"]
TICK = ["dahl_step_counts_q30", "dahl_step_counts", "dahl_step", "dahl_torque", "dahl_prepare"]
REST = ["dahl_set_torque", "dahl_change_plan", "dahl_counts_between"]
BATCHES = ["dahl_throughput", "dahl_throughput_counts"]
BATCHES += ["dahl_throughput_channels", "dahl_throughput_counts_channels"]
NODE = ["node_receive", "node_tick", "node_init", "node_bus_off", "slcan_take", "slcan_write"]
HELPERS = {"__clzsi2", "__aeabi_uidivmod"}  # of the compiler, leaves: leading zeros, a remainder
COPIES = {"memcpy", "memset", "memmove", "strcpy"}
INTEGER = [file for file in static.LIB if not file.stem.startswith(("batch", "float"))]
OWN = re.compile(r"(dahl|frames|node|slcan)_\w+")
NODE_STACK = 544  # bytes, most of them a plan on its way; float helpers may need a few more
# The compiler's float helpers, and 64-bit product and division of Cortex-M0.
FLOATS = re.compile(
    r"__aeabi_(f(add|sub|mul|div|2uiz|cmp\w+)|ui2f|lmul|uidiv)"
    r"|__(add|sub|mul|div|ge|lt|gt|le)sf[23]|__fixunssfsi|__floatunsisf"
)
CORES = [
    name if name == "m0" else pytest.param(name, marks=pytest.mark.long)
    for name in small_cores.target.CORES
]


@dataclass(frozen=True)
class Firmware:
    """All that firmware links, compiled for one core."""

    core: small_cores.target.Core
    calls: Calls
    objects: dict[Path, Path]

    def foreign(self, files: Iterable[Path], allowed: set[str]) -> dict[str, set[str]]:
        """Source -> what its object needs beyond the project and what is allowed, or keeps."""
        said = {}
        for file in files:
            needed, kept = small_cores.symbols(self.core, self.objects[file])
            if bad := {word for word in needed if not OWN.fullmatch(word)} - allowed | kept:
                said[file.stem] = bad
        return said

    def unbounded(self) -> list[str]:
        """Functions whose frame has no fixed size."""
        return sorted(name for name, (_, kind) in self.calls.frames.items() if kind != "static")


Make = Callable[[str], Firmware]


def compiled(name: str, files: list[Path], folder: Path) -> Firmware:
    core = small_cores.core_of(name, CLAIM)
    calls, objects = small_cores.compile_for(core, files, folder)
    return Firmware(core, calls, dict(zip(files, objects, strict=True)))


@pytest.fixture(scope="module")
def firmware(tmp_path_factory: pytest.TempPathFactory) -> Make:
    """Each core's firmware, compiled once."""
    known: dict[str, Firmware] = {}

    def make(name: str) -> Firmware:
        if name not in known:
            known[name] = compiled(name, static.FIRMWARE, tmp_path_factory.mktemp(name))
        return known[name]

    return make


@pytest.mark.parametrize("name", CORES)
def test_stack_of_the_integer_path_is_bounded(name: str, firmware: Make) -> None:
    made = firmware(name)
    depth = made.calls.depths()
    assert made.unbounded() == []
    assert made.calls.frames.keys() >= {*TICK, *REST, *BATCHES, *NODE}
    assert made.calls.outside([*TICK, *REST]) <= HELPERS
    assert max(depth[function] for function in [*TICK, *REST]) <= LIMITS[name]["stack_bytes"]


@pytest.mark.parametrize("name", CORES)
def test_stack_of_the_throughput_forms_is_bounded(name: str, firmware: Make) -> None:
    """16 KiB, as dahl.h says of their temporaries."""
    depth = firmware(name).calls.depths()
    assert 0 < max(depth[function] for function in BATCHES) <= 16 * 1024


@pytest.mark.parametrize("name", CORES)
def test_stack_of_the_node_is_bounded(name: str, firmware: Make) -> None:
    """Receiver, codec and library together: a fixed depth, whatever frame comes."""
    calls = firmware(name).calls
    assert small_cores.INDIRECT not in calls.outside(NODE)
    assert 0 < max(calls.depths()[function] for function in NODE) <= NODE_STACK


@pytest.mark.parametrize("name", CORES)
def test_integer_path_links_itself_alone(name: str, firmware: Make) -> None:
    assert len(INTEGER) >= 10
    assert firmware(name).foreign(INTEGER, HELPERS) == {}


@pytest.mark.parametrize("name", CORES)
def test_codec_links_no_heap_and_no_printing(name: str, firmware: Make) -> None:
    assert firmware(name).foreign(static.CODEC, HELPERS | COPIES) == {}


@pytest.mark.parametrize("name", CORES)
def test_receiver_links_no_heap_and_no_printing(name: str, firmware: Make) -> None:
    """Floats are for a parameter that is read or written."""
    found = firmware(name).foreign(static.NODE, HELPERS | COPIES)
    assert {word for bad in found.values() for word in bad if not FLOATS.fullmatch(word)} == set()


# --- each fault is seen --------------------------------------------------------------------------
