# SPDX-License-Identifier: MIT
"""tools/setup.sh with a network and a small lock file: damaged packages, and other sums."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import pytest

PACKAGES = ("mdurl", "packaging", "pathspec", "scikit-build-core")  # small, or install tools/dahl


def set_up(folder: Path) -> subprocess.CompletedProcess:
    done = subprocess.run(
        [folder / "tools/setup.sh", "demo"],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        stdin=subprocess.DEVNULL,
        text=True,
        timeout=250,
        check=False,
    )
    if "cannot reach" in done.stdout:
        pytest.skip(f"no network: {done.stdout}")
    return done


@pytest.fixture
def copy(root: Path, tmp_path: Path) -> Path:
    """The scripts and the package dahl with a lock of few packages, before the first set-up."""
    shutil.copytree(root / "tools", tmp_path / "tools")
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(root / name, tmp_path)
    lock = tmp_path / "tools/requirements.lock"
    pins = re.findall(r"^(?:# group .*|\S+==(?:.*\\\n)*.*)\n", lock.read_text(), re.MULTILINE)
    lock.write_text("".join(pin for pin in pins if pin.startswith(("#", *PACKAGES))))
    return tmp_path


def test_it_creates_and_repairs_the_environment(copy):
    python = copy / "build/venv/bin/python"
    first = set_up(copy)
    assert first.returncode == 0 and "creating the Python environment" in first.stdout
    assert "installing" not in set_up(copy).stdout
    shutil.rmtree(next((copy / "build/venv").glob("lib/*/site-packages/mdurl")))
    assert "creating the Python environment" in set_up(copy).stdout
    subprocess.run([python, "-m", "pip", "-q", "uninstall", "--yes", "mdurl"], check=True)
    repaired = set_up(copy).stdout
    assert "installing Python packages" in repaired and "creating" not in repaired
    subprocess.run([python, "-c", "import mdurl, dahl"], check=True)


def test_a_package_with_another_sum_is_not_installed(copy):
    lock = copy / "tools/requirements.lock"
    others, last = re.split(r"(?=^scikit)", lock.read_text(), flags=re.MULTILINE)
    lock.write_text(others + re.sub(r"sha256:..", "sha256:00", last))
    done = set_up(copy)
    assert done.returncode == 1 and "DO NOT MATCH THE HASHES" in done.stdout
    assert not (copy / "build/venv/.complete").exists()
