# SPDX-License-Identifier: MIT
"""Instructions of a tick of each throughput form on every hard motion, counted by callgrind."""

import json
import re
import shutil
from pathlib import Path

import pytest
from conftest import BUILD, ROOT
from programs import run

pytestmark = pytest.mark.checks

TICKS = 16384
BUDGETS = json.loads((ROOT / "tests" / "batch_budgets.json").read_text())


@pytest.fixture(scope="module")
def counts(tmp_path_factory):
    """Instructions of each function and its callees by motion. callgrind has no AVX-512, so the
    forms with AVX2 run.
    """
    for tool in ("valgrind", "callgrind_annotate"):
        if not shutil.which(tool):
            pytest.skip(f"unproven: cost of batches: no {tool} (tools/setup.sh checks)")
    if " avx2 " not in Path("/proc/cpuinfo").read_text():
        pytest.skip("unproven: cost of batches: this processor has no AVX2")
    if run("cc", "-dumpversion").strip() != "12":
        pytest.skip("unproven: cost of batches: cc is not gcc 12")
    run("cmake", "--build", BUILD, "--target", "host_bench")
    folder = tmp_path_factory.mktemp("callgrind")
    return lambda motion: counted(folder / motion, motion)


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
