# SPDX-License-Identifier: MIT
"""How much of tools/dahl its tests run, lines and branches, the commands in processes of their own
included: at least LEAST of it, else each line that none ran is named.
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from conftest import BUILD, ROOT

LEFT_OUT = "not c_tests and not error_and_cover"  # slow, run nothing more
LEAST = 95.0  # %, of the lines and of the lines and branches together
CONFIG = """[run]
branch = true
parallel = true
patch = subprocess
source_pkgs = {package}
data_file = {folder}/data
[report]
exclude_also =
    if TYPE_CHECKING:
"""
PARTS = ("bench_batch", "bridge", "core", "data", "demo", "exact", "logs", "loop_bad_input")
PARTS += ("identify", "identify_bad_input", "identify_excite", "identify_many", "identify_output")
PARTS += (
    "api",
    "plan",
    "loop_virtual",
    "monitor",
    "picture",
    "property_identify",
    "property_readers",
)
PARTS += ("report", "report_page", "target_demo", "edges")  # tests/python/test_PART.py


def measured(folder: Path, package: str, tests: list[Path], where: Path) -> dict[str, Any]:
    """Run tests under coverage; what it found, as its JSON has it."""
    config = folder / "coverage.ini"
    config.write_text(CONFIG.format(package=package, folder=folder))

    def coverage(*words: object) -> None:
        command = [sys.executable, "-m", "coverage", *map(str, words)]
        done = subprocess.run(
            command, cwd=where, capture_output=True, text=True, check=False, timeout=1500
        )
        assert done.returncode in (0, 1), done.stdout + done.stderr  # 1: a test failed, in lane 1

    options = ["-c", ROOT / "tests" / "pytest.ini", "-q", "--rootdir", where, "-k", LEFT_OUT]
    coverage("run", f"--rcfile={config}", "-m", "pytest", *options, *tests)
    coverage("combine", f"--rcfile={config}")
    coverage("json", f"--rcfile={config}", "-o", folder / "found.json")
    found: dict[str, Any] = json.loads((folder / "found.json").read_text())
    return found


def verdict(found: dict[str, Any]) -> tuple[float, float, list[str]]:
    """Lines run in %, lines and branches together in %, and the lines not run by file."""
    totals = found["totals"]
    missing = [
        f"{name}: {', '.join(map(str, one['missing_lines']))}"
        for name, one in found["files"].items()
        if one["missing_lines"]
    ]
    return (
        100 * totals["covered_lines"] / totals["num_statements"],
        totals["percent_covered"],
        missing,
    )


@pytest.mark.long
@pytest.mark.timeout(1800)
def test_the_tests_run_the_package(tmp_path: Path) -> None:
    tests = [ROOT / "tests" / "python" / f"test_{name}.py" for name in PARTS]
    lines, both, missing = verdict(measured(tmp_path, "dahl", tests, ROOT))
    report = f"lines {lines:.1f} %, with branches {both:.1f} %\n" + "\n".join(missing)
    (BUILD.parent / "python-coverage.txt").write_text(report + "\n")
    assert min(lines, both) >= LEAST, report
