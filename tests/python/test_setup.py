# SPDX-License-Identifier: MIT
"""The scripts: what set-up says offline, quickly; that it looks at what is there; help and bad
arguments. With a network: tests/quality/test_setup_network.py.
"""

from __future__ import annotations

import fcntl
import hashlib
import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest

NOWHERE = {"http_proxy": "http://127.0.0.1:9", "https_proxy": "http://127.0.0.1:9"}
GROUPS = ("demo", "identify", "test", "checks")


def run(*command, timeout: float = 60, **variables) -> subprocess.CompletedProcess:
    return subprocess.run(
        list(map(str, command)),
        capture_output=True,
        text=True,
        timeout=timeout,
        check=False,
        stdin=subprocess.DEVNULL,
        env={**os.environ, **variables},
    )


@pytest.fixture
def elsewhere(root: Path, tmp_path: Path) -> Path:
    """A copy of the scripts, where nothing is set up yet."""
    shutil.copy(root / "pyproject.toml", tmp_path)
    for part in ("common.sh", "setup.sh", "setup", "requirements"):
        source = root / "tools" / part
        copy = shutil.copytree if source.is_dir() else shutil.copy
        (tmp_path / "tools").mkdir(exist_ok=True)
        copy(source, tmp_path / "tools" / part)
    return tmp_path


def needs_setup(root: Path) -> None:
    """Setting up anew would take away the environment that this test runs in."""
    stamp = root / "build/venv/.complete"
    pins = (root / "tools/requirements").glob("*.lock")
    if not stamp.exists() or any(pin.stat().st_mtime > stamp.stat().st_mtime for pin in pins):
        pytest.skip("build/venv is not of this checkout or not up to date (tools/setup.sh test)")


def test_a_second_run_waits_for_the_first(elsewhere):
    (elsewhere / "build").mkdir()
    with (elsewhere / "build/setup.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        second = subprocess.Popen(
            [elsewhere / "tools/setup.sh", "demo"],
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
            env={**os.environ, **NOWHERE},
        )
        assert second.stdout.readline() == "setup: another setup is at work here; waiting for it\n"
        with pytest.raises(subprocess.TimeoutExpired):
            second.wait(0.5)
    assert second.wait(timeout=100) == 1  # without a network


def test_files_of_another_sum_are_not_used(elsewhere):
    names = "{unity.c,unity.h,unity_internals.h}"
    words = (
        f"cd {elsewhere}/tools; . ./common.sh; . setup/needs.sh; . setup/fetched.sh;"
        f' fetch_unity() {{ echo other | tee "$1"/{names}; }}; get_unity'
    )
    done = run("bash", "-c", words)
    assert done.returncode == 1
    assert "these are not the files of Unity" in done.stderr
    assert done.stderr.count(hashlib.sha256(b"other\n").hexdigest()) == 3
    assert not (elsewhere / "build/deps/unity").exists()


def timed(*command, **variables) -> tuple[subprocess.CompletedProcess, float]:
    """And its seconds of processor time: on a machine at rest it takes little longer."""
    before = os.times()
    done = run(*command, timeout=200, **variables)
    after = os.times()
    return done, sum(after[2:4]) - sum(before[2:4])


def test_second_setup_is_quick_and_says_what_it_found(root):
    needs_setup(root)
    done, busy = timed(root / "tools/setup.sh", "test")
    assert done.returncode == 0, done.stderr
    assert busy < 2
    lines = done.stdout.splitlines()
    assert all(line.startswith("setup: ") for line in lines)
    assert "setup: Python environment: in place (build/venv)" in lines
    assert lines[-1].startswith("setup: done in ")


def test_offline_it_soon_says_what_it_cannot_reach(elsewhere):
    """Nothing waits: the proxy refuses at once."""
    done, busy = timed(elsewhere / "tools/setup.sh", "test", **NOWHERE)
    assert busy < 20
    assert done.returncode == 1
    if shutil.which("apt-get"):
        assert "this Debian's package sources (apt-get)" in done.stderr
    assert "the index of Python packages (pip)" in done.stderr
    assert "build/venv" in done.stderr
    assert len(done.stderr.splitlines()) == 1


def test_a_changed_unity_is_not_taken_for_whole(root, elsewhere):
    unity = elsewhere / "build/deps/unity"
    if not (root / "build/deps/unity").exists() or not shutil.which("apt-get"):
        pytest.skip("no build/deps/unity from Debian")
    shutil.copytree(root / "build/deps/unity", unity)
    whole = run(elsewhere / "tools/setup.sh", "test", **NOWHERE)
    with (unity / "unity.c").open("a") as file:
        file.write("\n")
    changed = run(elsewhere / "tools/setup.sh", "test", **NOWHERE)
    assert "needed for: build/venv" in whole.stderr
    assert "needed for: unity build/venv" in changed.stderr


@pytest.mark.parametrize("lacking", ["unity.c", "unity.h", "unity_internals.h"])
def test_an_own_unity_is_looked_at(elsewhere, tmp_path, lacking):
    for name in {"unity.c", "unity.h", "unity_internals.h"} - {lacking}:
        (tmp_path / name).write_text("mine")
    (tmp_path / lacking).touch()  # empty
    done = run(elsewhere / "tools/setup.sh", "test", DAHL_UNITY_DIR=str(tmp_path))
    assert done.returncode == 1
    assert done.stderr == f"error: DAHL_UNITY_DIR: {tmp_path} has no {lacking}\n"


@pytest.mark.parametrize("script", ["setup", "test", "demo", "bench", "lock", "vm"])
def test_help_is_given_without_doing_anything(root, script):
    shown = run(root / "tools" / f"{script}.sh", "--help")
    assert shown.returncode == 0
    assert shown.stdout.startswith(f"Usage: tools/{script}.sh")


def test_setup_refuses_what_it_does_not_know(root):
    done = run(root / "tools/setup.sh", "demo", "--fast")
    assert done.returncode == 1
    assert done.stderr.startswith("error: setup.sh knows demo ")
    assert "'--fast'" in done.stderr


def pins_of(path: Path) -> dict[str, str]:
    pins = re.findall(r"^([\w.-]+)(?:\[[^]]*\])?==([^\s;\\]+)", path.read_text(), re.MULTILINE)
    return {re.sub("[-_.]+", "-", name).lower(): version for name, version in pins}


def test_each_list_is_in_the_locks_in_the_same_version(root):
    locked: dict[str, str] = {}
    for group in GROUPS:
        folder = root / "tools/requirements"
        locked |= pins_of(folder / f"{group}.lock")
        wanted = pins_of(folder / f"{group}.txt")
        assert wanted
        assert {name: locked.get(name) for name in wanted} == wanted, "run tools/lock.sh"
