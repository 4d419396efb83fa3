# SPDX-License-Identifier: MIT
"""All tests of the plugin in other versions of MuJoCo, which tools/setup.sh checks installs."""

import os
import sys
from pathlib import Path

import pytest
from conftest import ROOT
from programs import run

LOCKS = sorted(ROOT.glob("tools/setup/mujoco-*.lock"))
VERSIONS = [path.stem.partition("-")[2] for path in LOCKS]
PYTEST = "-m", "pytest", "-c", ROOT / "tests/pytest.ini", "--checks", "-q"
QUICK = "-k", "not threads_change_no_bit"  # which measures for a minute


def test_the_oldest_version_that_is_allowed_is_tested() -> None:
    assert any(version.startswith("3.8.") for version in VERSIONS)


@pytest.mark.parametrize("version", VERSIONS)
def test_all_tests_pass_in_another_version(version: str) -> None:
    folder = Path(sys.prefix) / "mujoco" / version
    if not folder.exists():
        pytest.skip(f"unproven: dahl.friction in MuJoCo {version}: tools/setup.sh checks lacks it")
    env = {**os.environ, "PYTHONPATH": str(folder)}
    shown = run(sys.executable, "-c", "import mujoco; print(mujoco.__version__)", env=env)
    assert shown.strip() == version
    run(sys.executable, *PYTEST, Path(__file__).with_name("test_mujoco.py"), *QUICK, env=env)
