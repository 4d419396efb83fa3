# SPDX-License-Identifier: MIT
"""The scripts: what set-up says offline, quickly; that it looks at what is there; help and bad
arguments. With a network: tests/quality/test_setup_network.py.
"""

from __future__ import annotations

import fcntl
import os
import re
import runpy
import shutil
import subprocess
import time
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
    words = f"source {elsewhere}/tools/common.sh; one_at_a_time setup; echo mine"
    with (elsewhere / "build/setup.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        second = subprocess.Popen(["bash", "-c", words], stdout=subprocess.PIPE, text=True)
        assert "waiting for it" in second.stdout.readline()
        with pytest.raises(subprocess.TimeoutExpired):
            second.wait(0.5)
    assert second.communicate(timeout=20)[0] == "mine\n"


def test_files_of_another_sum_are_not_used(elsewhere):
    names = "{unity.c,unity.h,unity_internals.h}"
    words = (
        f"cd {elsewhere}/tools; . ./common.sh; . setup/needs.sh; . setup/fetched.sh;"
        f' fetch_unity() {{ echo other | tee "$1"/{names}; }}; get_unity'
    )
    done = run("bash", "-c", words)
    assert done.returncode == 1
    assert "these are not the files of Unity" in done.stderr
    assert not (elsewhere / "build/deps/unity").exists()


def test_second_setup_is_quick_and_says_what_it_found(root):
    needs_setup(root)
    before = os.times()
    done = run(root / "tools/setup.sh", "test")
    after = os.times()
    busy = (
        after.children_user + after.children_system - before.children_user - before.children_system
    )
    assert done.returncode == 0, done.stderr
    assert busy < 2  # s of processor time: on a machine at rest it takes no longer
    lines = done.stdout.splitlines()
    assert all(line.startswith("setup: ") for line in lines)
    assert "setup: Python environment: in place (build/venv)" in lines
    assert lines[-1].startswith("setup: done in ")


def test_offline_it_says_within_30_seconds_what_it_cannot_reach(elsewhere):
    start = time.monotonic()
    done = run(elsewhere / "tools/setup.sh", "test", **NOWHERE)
    assert time.monotonic() - start < 30
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


@pytest.fixture
def site(root, tmp_path):
    """A folder with one installed package, and what set-up finds in it: (lacking, changed)."""
    compare = runpy.run_path(str(root / "tools/setup/check_venv.py"))["compare"]
    lock = tmp_path / "one.lock"
    lock.write_text("one-thing==1.0 \\\n    --hash=sha256:00\nother==2 ; sys_platform == 'win32'\n")
    place = tmp_path / "site"
    for name, record in (("One_Thing-1.0", "one.py,sha256=x,4\none.pyc,,\n"), ("dahl-0.1", "")):
        (place / f"{name}.dist-info").mkdir(parents=True)
        (place / f"{name}.dist-info/RECORD").write_text(record)
    (place / "one.py").write_text("1+1\n")
    return place, lambda: compare(place, [lock])


def test_what_is_as_pinned_is_whole(site):
    _, found = site
    assert found() == ([], [])


def test_another_version_is_lacking(site):
    place, found = site
    (place / "One_Thing-1.0.dist-info").rename(place / "one_thing-1.1.dist-info")
    assert found() == (["one-thing 1.0"], [])


def test_the_command_dahl_is_missed(site):
    place, found = site
    shutil.rmtree(place / "dahl-0.1.dist-info")
    assert found() == (["dahl"], [])


@pytest.mark.parametrize("damage", ["removed", "cut", "record"])
def test_a_damaged_package_is_found(site, damage):
    place, found = site
    if damage == "removed":
        (place / "one.py").unlink()
    elif damage == "cut":
        (place / "one.py").write_text("1")
    else:
        (place / "One_Thing-1.0.dist-info/RECORD").unlink()
    lacking, changed = found()
    assert (lacking, len(changed)) == ([], 1)
