# SPDX-License-Identifier: MIT
"""Instructions of a tick of each throughput form: on every hard motion, counted by callgrind, which
has no AVX-512, and of the AVX-512 loops, read from the object code.
"""

import json
import platform
import re
import shutil
import sys
from pathlib import Path

import pytest
from conftest import BUILD, ROOT
from programs import run

pytestmark = pytest.mark.checks

TICKS = 16384
BUDGETS = json.loads((ROOT / "tests" / "batch_budgets.json").read_text())


@pytest.fixture(scope="module")
def counts(tmp_path_factory):
    """Instructions of each function and its callees by motion, of the forms with AVX2."""
    for tool in ("valgrind", "callgrind_annotate"):
        if not shutil.which(tool):
            pytest.skip(f"unproven: cost of batches: no {tool} (tools/setup.sh checks)")
    if " avx2 " not in Path("/proc/cpuinfo").read_text():
        pytest.skip("unproven: cost of batches: this processor has no AVX2")
    need_gcc_12()
    run("cmake", "--build", BUILD, "--target", "host_bench")
    folder = tmp_path_factory.mktemp("callgrind")
    return lambda motion: counted(folder / motion, motion)


def need_gcc_12() -> None:
    if run("cc", "-dumpversion").strip() != "12":
        pytest.skip("unproven: cost of batches: cc is not gcc 12")


def counted(out: Path, motion: str) -> dict[str, float]:
    words = ["valgrind", "--tool=callgrind", f"--callgrind-out-file={out}"]
    run(*words, BUILD / "tools/bench/host/host_bench", "batches", motion, TICKS)
    text = run("callgrind_annotate", "--inclusive=yes", "--threshold=100", out)
    found: dict[str, float] = {}
    for number, name in re.findall(r"^ *([\d,]+) \([^)]*\)  \S+:(dahl_\w+)", text, re.M):
        found[name] = max(found.get(name, 0.0), int(number.replace(",", "")) / TICKS)
    return found


@pytest.mark.parametrize("motion", BUDGETS)
def test_a_tick_of_each_form_stays_within_its_budget(counts, motion):
    found = counts(motion)
    wanted = BUDGETS[motion]
    assert {name: found[name] for name in wanted if found[name] > wanted[name]} == {}
    assert all(found[name] > wanted[name] / 2 for name in wanted), "a budget is too wide"


AVX512_LOOPS = {  # at most so many instructions for 64 ticks
    "lanes, up to 7 counts": 55,
    "lanes, up to 15": 76,
    "starts of lanes": 24,
    "torques, up to 7 counts": 73,
    "torques, up to 15": 90,
    "largest move": 20,
    "maps, any move": 230,
    "lanes, any move": 32,
    "torques, any move": 48,
    "16 channels, up to 7 counts": 77,
    "16 channels, up to 15": 88,
    "16 channels, any move": 224,
}


def test_each_avx512_loop_stays_within_its_budget():
    need_gcc_12()
    if platform.machine() != "x86_64":
        pytest.skip("unproven: cost of batches: no AVX-512 on this kind of processor")
    text = run(sys.executable, ROOT / "tools/bench/batch_loops.py", BUILD / "lib/libdahl_batch.a")
    rows = [line.strip("| ").split(" | ") for line in text.splitlines()[2:]]
    found = {row[0]: int(row[1]) for row in rows}
    assert found.keys() == AVX512_LOOPS.keys()
    assert {name: found[name] for name, most in AVX512_LOOPS.items() if found[name] > most} == {}
