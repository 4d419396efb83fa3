# SPDX-License-Identifier: MIT
"""What a tick of each batch costs on every hard motion: instructions, counted by callgrind. So a
batch that only gets slower, with the same torques, is noticed.
"""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from pathlib import Path

import pytest
from conftest import BUILD, ROOT

pytestmark = pytest.mark.checks

TICKS = 16384
BUDGETS = json.loads((ROOT / "tests" / "batch_budgets.json").read_text())


@pytest.fixture(scope="module")
def counts(tmp_path_factory):
    """Instructions of each function with all that it calls, by motion. callgrind knows no AVX-512,
    so the forms with AVX2 run.
    """
    for tool in ("valgrind", "callgrind_annotate"):
        if not shutil.which(tool):
            pytest.skip(f"{tool} is not installed (tools/setup.sh installs it where it can)")
    if " avx2 " not in Path("/proc/cpuinfo").read_text():
        pytest.skip("the budgets are for AVX2, which this processor has not")
    compiler = subprocess.run(["cc", "-v"], capture_output=True, text=True, check=False).stderr
    if "gcc version 12." not in compiler:
        pytest.skip("the budgets are for gcc 12, and cc is another compiler here")
    words = ["cmake", "--build", BUILD, "--target", "host_bench"]
    subprocess.run(words, capture_output=True, check=True)
    folder = tmp_path_factory.mktemp("callgrind")
    return lambda motion: counted(folder / motion, motion)


def counted(out: Path, motion: str) -> dict[str, float]:
    words = ["valgrind", "--tool=callgrind", f"--callgrind-out-file={out}"]
    words += [str(BUILD / "tools/bench/host/host_bench"), "batches", motion, str(TICKS)]
    subprocess.run(words, capture_output=True, check=True, timeout=120)
    words = ["callgrind_annotate", "--inclusive=yes", "--threshold=100", str(out)]
    text = subprocess.run(words, capture_output=True, text=True, check=True, timeout=60).stdout
    found: dict[str, float] = {}
    for number, name in re.findall(r"^ *([\d,]+) \([^)]*\)  \S+:(dahl_\w+)", text, re.M):
        found[name] = max(found.get(name, 0.0), int(number.replace(",", "")) / TICKS)
    return found


@pytest.mark.parametrize("motion", BUDGETS)
def test_a_tick_of_each_batch_costs_no_more(counts, motion):
    found = counts(motion)
    wanted = BUDGETS[motion]
    assert {name: found[name] for name in wanted if found[name] > wanted[name]} == {}
    assert all(found[name] > wanted[name] / 2 for name in wanted), (
        "a budget this wide guards nothing"
    )
