# SPDX-License-Identifier: MIT
"""tools/setup.sh and its Python environment: by which Python, from which pins, when it is mended,
grown or made anew, and what is said without a network.
"""

from __future__ import annotations

import fcntl
import os
import re
import runpy
import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path

import pytest
from conftest import ROOT
from loop_tools import wait_until
from script_stage import PYTHON, Debian

FAILS_TO = 'case "$*" in {} exit 1 ;; esac;'


@pytest.fixture
def bare(tmp_path: Path) -> Debian:
    return Debian(tmp_path)


def made(started: list[str]) -> int:
    return sum("-m venv" in call for call in started)


# --- what is installed ---------------------------------------------------------------------------


@pytest.mark.parametrize(("variable", "option"), [("1", "--compile"), ("", "--no-compile")])
def test_pins_with_sums_alone_come_into_the_environment(bare, variable, option):
    """By the own Python where one is named; compiled where Python may not do so later."""
    bare.stand_in("bin/mine", PYTHON)
    own = {"DAHL_PYTHON": f"{bare.folder}/bin/mine", "PYTHONDONTWRITEBYTECODE": variable}
    assert bare.set_up("demo", **own)[0].returncode == 0
    assert made(bare.calls("mine")) == 1 and not made(bare.calls("python3.11"))
    calls = [call.split() for call in bare.calls("python") if " install " in call]
    pins, dahl = calls
    assert all(option in words and "--no-deps" in words for words in calls)
    assert "--require-hashes" in pins and "--editable" in dahl
    for words in calls:
        assert words[words.index("pip") - 1] == "-m"


@pytest.mark.parametrize(
    ("state", "anew"),
    [("0", 0), ("3", 0), ("4", 1), ("changed", 0), ("half done", 1), ("other Python", 1)],
)
def test_the_environment_is_mended_as_far_as_needed(bare, state, anew):
    """By what check_venv.py says; what pyproject.toml changes is installed again; what was broken
    off, or is of another interpreter, is made anew.
    """
    bare.does("python3.11", f'case "$*" in -VV) cat "$STAGE/version" ;; esac; {PYTHON}')
    bare.write("version", "3.11.2")
    bare.set_up("demo")
    project = bare.folder / "pyproject.toml"
    if state == "changed":
        project.write_text(project.read_text().replace("[project]", "[project]\n# new", 1))
    elif state == "half done":
        bare.write("state", "3")
        bare.does("python", FAILS_TO.format('*" install "*)') + PYTHON)
        assert bare.set_up("demo")[0].returncode == 1
        bare.does("python", PYTHON)
        bare.write("state", "0")
    elif state == "other Python":
        bare.write("version", "3.12.0")
    else:
        bare.write("state", state)
    done, started = bare.set_up("demo")
    assert done.returncode == 0 and made(started) == anew
    assert any("--require-hashes" in call for call in started) == (state != "0")
    assert any("--editable" in call for call in started) == (state != "0")


def test_an_environment_that_was_moved_is_made_anew(bare):
    """Its scripts name their path."""
    bare.set_up("demo")
    there = bare.folder.with_name("moved")
    bare.folder.rename(there)
    bare.folder, bare.own_unity = there, there / "unity"
    shutil.rmtree(there / "bin")
    for name in ("apt-get", "dpkg-query", "python3.11", "apt-cache", "cmake"):
        bare.stand_in(f"bin/{name}", "\n".join(bare.lines(f"{name}.does")))
    bare.stand_in("build/venv/bin/python", PYTHON)  # which would work there too
    assert made(bare.set_up("demo")[1]) == 1


@pytest.mark.parametrize(("version", "good"), [((3, 10, 99), False), ((3, 11, 0), True)])
def test_a_python_that_is_too_old_is_passed_over(bare, version, good):
    told = f'exec {sys.executable} -c "import sys; sys.version_info = {version}; $2"'
    bare.stand_in("bin/mine", f'case "$1" in -c) {told} ;; esac; {PYTHON}')
    assert bare.set_up("demo", DAHL_PYTHON="mine")[0].returncode == 0
    assert [made(bare.calls(name)) for name in ("mine", "python3.11")] == [good, not good]


@pytest.mark.parametrize("what", ["cmake", "pip", "python"])
def test_what_it_must_have_and_cannot_get_is_an_error_each_time(bare, what):
    if what == "cmake":
        bare.unknown("cmake")
    else:
        name = {"pip": "python", "python": "python3.11"}[what]
        bare.does(name, FAILS_TO.format('*" install "*|*"-m venv"*)') + PYTHON)
    for _ in range(2):
        done, started = bare.set_up("demo")
        assert done.returncode == 1 and "error: " in done.stderr
    if what == "pip":
        assert sum("--require-hashes" in call for call in started) == 3


def test_what_fails_ends_the_installation_beside_it(bare):
    """Packages of Python come while apt-get is at work; nothing of it stays behind."""
    bare.unknown("cmake")
    beside = 'echo $$ >"$STAGE/beside"; exec /bin/sleep 90'
    bare.does("python", f'case "$*" in *" install "*) {beside} ;; esac; {PYTHON}')
    begun = 'until [ -s "$STAGE/beside" ]; do /bin/sleep 0.1; done'
    apt = "\n".join(bare.lines("apt-get.does"))
    bare.does("apt-get", f'case "$*" in *" install "*cmake*) {begun} ;; esac; {apt}')
    assert bare.set_up("demo")[0].returncode == 1
    process = Path("/proc") / bare.lines("beside")[0] / "cmdline"
    wait_until(lambda: not process.exists() or b"sleep" not in process.read_bytes())


@pytest.mark.parametrize("there", ["no pip", "pip", "environment"])
def test_without_pips_index_nothing_is_tried_for_minutes(bare, there):
    """Also where there is no pip to ask with before the environment is made, or it lacks some."""
    if there == "environment":
        bare.set_up("demo")
        bare.write("state", "3")
    bare.write("installed", *bare.lines("known"))
    before = FAILS_TO.format('*"pip --version"*)') if there == "no pip" else ""
    offline = FAILS_TO.format('*" download "*)')
    bare.does("python3.11", f"{before} {offline} {PYTHON}")
    bare.does("python", f"{offline} {PYTHON}")
    done, started = bare.set_up("demo")
    assert done.returncode == 1
    assert "(pip)" in done.stderr and "build/venv" in done.stderr
    assert not [call for call in started if " install " in call]


# --- tools/setup/check_venv.py -------------------------------------------------------------------


@pytest.fixture
def checked(tmp_path, capsys, monkeypatch):
    """Exit code and words of check_venv.py for locks, in a folder that has package one 1.0."""
    site = tmp_path / "site"
    for name, record in (("one-1.0", "one.py,sha256=x,4\n"), ("dahl-0.1", "")):
        (site / f"{name}.dist-info").mkdir(parents=True)
        (site / f"{name}.dist-info/RECORD").write_text(record)
    (site / "one.py").write_text("1+1\n")

    def check(*locks: str) -> tuple[int, list[str]]:
        for n, lock in enumerate(locks):
            (tmp_path / f"{n}.lock").write_text(lock)
        paths = [str(tmp_path / f"{n}.lock") for n in range(len(locks))]
        with monkeypatch.context() as patch, pytest.raises(SystemExit) as end:
            patch.setattr(sys, "argv", ["check_venv.py", *paths])
            patch.setattr(sysconfig, "get_path", lambda name: str(site))
            runpy.run_path(str(ROOT / "tools/setup/check_venv.py"), run_name="__main__")
        return end.value.code, capsys.readouterr().out.splitlines()

    return site, check


def test_the_state_of_an_environment_is_an_exit_code(checked):
    """Of every lock; what is for another system or Python is not missed."""
    site, check = checked
    one = "one==1.0 \\\n    --hash=sha256:00\n"
    assert check(one) == (0, [])
    other = "two[extra]==2.5 ; python_version >= '3' \\\n    --hash=sha256:00\n"
    other += "three==1 ; sys_platform == 'win32' \\\n    --hash=sha256:00\n# four==4\n"
    assert check(one, other) == (3, ["lacking: two 2.5"])
    record = site / "one-1.0.dist-info/RECORD"
    (site / "one.py").write_text("1\n")
    assert check(one) == (4, ["changed: one.py"])
    assert check(one, other) == (4, ["lacking: two 2.5", "changed: one.py"])
    assert check(other) == (3, ["lacking: two 2.5"])  # what no lock names is nobody's business
    (site / "one.py").unlink()
    assert check(one) == (4, ["changed: one.py"])
    record.unlink()
    assert check(one) == (4, [f"changed: {record}"])
    record.parent.rename(site / "One-1.1.dist-info")
    (site / "dahl-0.1.dist-info").rename(site / "other-0.1.dist-info")
    assert check(one) == (3, ["lacking: one 1.0", "lacking: dahl"])


# --- the scripts as they are, on this machine ----------------------------------------------------

NOWHERE = {"http_proxy": "http://127.0.0.1:9", "https_proxy": "http://127.0.0.1:9"}


@pytest.fixture
def elsewhere(tmp_path: Path) -> Path:
    """A copy of the scripts, where nothing is set up yet."""
    shutil.copytree(ROOT / "tools", tmp_path / "tools")
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    return tmp_path


def timed(script: Path, **variables: str) -> tuple[subprocess.CompletedProcess, float]:
    """And its seconds of processor time: on a machine at rest it takes little longer."""
    before = os.times()
    done = subprocess.run(
        [script, "test"],
        env={**os.environ, **variables},
        capture_output=True,
        text=True,
        timeout=200,
        check=False,
    )
    after = os.times()
    return done, sum(after[2:4]) - sum(before[2:4])


def test_second_setup_is_quick_and_says_what_it_found():
    stamp = ROOT / "build/venv/.complete"  # setting up anew would take away this environment
    pins = (ROOT / "tools/requirements").glob("*.lock")
    if not stamp.exists() or any(pin.stat().st_mtime > stamp.stat().st_mtime for pin in pins):
        pytest.skip("build/venv is not of this checkout or not up to date (tools/setup.sh test)")
    done, busy = timed(ROOT / "tools/setup.sh")
    assert done.returncode == 0, done.stderr
    assert busy < 2
    lines = done.stdout.splitlines()
    assert all(line.startswith("setup: ") for line in lines)
    assert any("in place (build/venv)" in line for line in lines)


def test_offline_it_soon_says_what_it_cannot_reach(elsewhere):
    """Nothing waits: the proxy refuses at once. A second run waits for the first."""
    (elsewhere / "build").mkdir()
    with (elsewhere / "build/setup.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        words = [elsewhere / "tools/setup.sh", "test"]
        with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as second:
            assert second.stdout.readline().startswith("setup: another setup is at work")
            with pytest.raises(subprocess.TimeoutExpired):
                second.wait(0.5)
            second.kill()
    done, busy = timed(elsewhere / "tools/setup.sh", **NOWHERE)
    assert busy < 20 and done.returncode == 1
    [said] = done.stderr.splitlines()
    wanted = ["apt-get", "unity"] if shutil.which("apt-get") else []
    assert all(word in said for word in [*wanted, "(pip)", "build/venv", "build/setup.log"])


def pins_of(path: Path) -> dict[str, str]:
    pins = re.findall(r"^([\w.-]+)(?:\[[^]]*\])?==([^\s;\\]+)", path.read_text(), re.MULTILINE)
    return {re.sub("[-_.]+", "-", name).lower(): version for name, version in pins}


def test_each_list_is_in_the_locks_in_the_same_version():
    locked: dict[str, str] = {}
    for group in ("demo", "identify", "test", "checks"):
        locked |= pins_of(ROOT / f"tools/requirements/{group}.lock")
        wanted = pins_of(ROOT / f"tools/requirements/{group}.txt")
        assert wanted
        assert {name: locked.get(name) for name in wanted} == wanted, "run tools/lock.sh"
