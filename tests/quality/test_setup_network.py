# SPDX-License-Identifier: MIT
"""tools/setup.sh with a network, in a copy of the scripts whose locks are small: what is damaged is
made anew, what has another sum is not taken, two at once and a broken-off run do no harm.
"""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import pytest

PACKAGES = ("mdurl", "packaging", "pathspec", "scikit-build-core")  # small, or install tools/dahl


def setup(root: Path, need: str = "demo") -> subprocess.Popen:
    return subprocess.Popen(
        [root / "tools/setup.sh", need],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        stdin=subprocess.DEVNULL,
        text=True,
        start_new_session=True,
    )


def said(process: subprocess.Popen) -> str:
    text, _ = process.communicate(timeout=250)
    if "cannot reach" in text:
        pytest.skip(f"no network: {text}")
    return text


@pytest.fixture
def elsewhere(root: Path, tmp_path: Path) -> Path:
    """The scripts, the package dahl and locks of few packages, and nothing set up."""
    shutil.copytree(root / "tools", tmp_path / "tools")
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(root / name, tmp_path)
    for lock in (tmp_path / "tools/requirements").glob("*.lock"):
        pins = re.findall(r"^\S+==(?:.*\\\n)*.*\n", lock.read_text(), re.MULTILINE)
        lock.write_text("".join(pin for pin in pins if pin.startswith(PACKAGES)))
    return tmp_path


def test_it_makes_grows_and_mends_the_environment(elsewhere):
    made = setup(elsewhere)
    assert "making the Python environment" in said(made)
    assert made.returncode == 0
    subprocess.run([elsewhere / "build/venv/bin/python", "-c", "import mdurl, dahl"], check=True)

    assert "installing" not in said(setup(elsewhere))

    shutil.rmtree(next((elsewhere / "build/venv").glob("lib/*/site-packages/mdurl")))
    text = said(setup(elsewhere))
    assert "making the Python environment" in text
    subprocess.run([elsewhere / "build/venv/bin/python", "-c", "import mdurl"], check=True)

    pip = [elsewhere / "build/venv/bin/python", "-m", "pip", "--quiet", "uninstall", "--yes"]
    subprocess.run([*pip, "mdurl"], check=True)
    text = said(setup(elsewhere))
    assert "making the Python environment" not in text
    assert "installing Python packages" in text
    subprocess.run([elsewhere / "build/venv/bin/python", "-c", "import mdurl"], check=True)


def test_a_package_with_another_sum_is_not_installed(elsewhere):
    lock = elsewhere / "tools/requirements/demo.lock"
    others, last = re.split(r"(?=^scikit)", lock.read_text(), flags=re.MULTILINE)
    lock.write_text(others + re.sub(r"sha256:..", "sha256:00", last))
    tried = setup(elsewhere)
    text = said(tried)
    assert tried.returncode == 1
    assert "THESE PACKAGES DO NOT MATCH THE HASHES" in text
    assert not (elsewhere / "build/venv/.complete").exists()
