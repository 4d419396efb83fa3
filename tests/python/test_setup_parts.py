# SPDX-License-Identifier: MIT
"""tools/setup.sh on machines of which each lacks something: rights, a source that answers, a whole
archive. Every program that reaches outside only notes how it was called.
"""

from __future__ import annotations

import re
import runpy
import sys
import tarfile
from pathlib import Path

import pytest
from loop_tools import wait_until
from test_scripts import APT, PYTHON, Stage, bare, set_up, sourced, stage

__all__ = ["bare", "stage"]  # pytest's, for the tests below


def installs(stage: Stage) -> list[list[str]]:
    """Packages of each call of apt-get that installs some."""
    calls = [call.split() for call in stage.calls("apt-get") if " install " in call]
    return [[w for w in c[c.index("install") + 1 :] if w[0] != "-"] for c in calls]


# --- what is asked for ----------------------------------------------------------------------------


def test_what_is_in_place_asks_nobody(bare):
    """And the log is that of the last run."""
    (bare.folder / "build").mkdir(exist_ok=True)
    (bare.folder / "build/setup.log").write_text("of a run before\n")
    set_up(bare, "demo")
    assert "of a run before" not in (bare.folder / "build/setup.log").read_text()
    set_up(bare, "demo")
    asked = " ".join(bare.calls())
    assert "--print-uris" not in asked and " download " not in asked


# --- rights ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("sudo", [True, False])
def test_who_is_not_root_installs_by_sudo_or_is_told_what_to_install(bare, sudo):
    bare.stand_in("bin/id", "echo 1000")
    bare.does("sudo", '[ "$1" != -n ] || shift; "$@"' if sudo else "exit 1")
    done, started = set_up(bare, "demo")
    by_sudo = [call for call in bare.calls("sudo") if " apt-get " in call]
    if sudo:
        assert done.returncode == 0, done.stderr
        assert len(by_sudo) == len(bare.calls("apt-get")) - 1  # one asks for addresses alone
        assert all("DEBIAN_FRONTEND=noninteractive" in call for call in by_sudo)
    else:
        assert done.returncode == 1 and not started and not by_sudo
        said = "please install, then run this again: apt-get install --no-install-recommends "
        named = done.stderr.removeprefix(f"error: {said}").split()
        assert {"libc6-dev", "cmake", "python3-venv"} <= set(named) and "arm" not in done.stderr


# --- sources that do not answer -------------------------------------------------------------------


def test_a_source_that_fails_is_asked_afresh_and_then_debians_own_alone(bare):
    """From what is known; with fresh lists; from Debian's own sources; then it is an error."""
    for failures in range(4):
        bare.run("setup", "--help")
        (bare.folder / "installed").write_text("dpkg-dev\npython3\npython3-venv\n")
        (bare.folder / "left").write_text("x\n" * failures)
        count = 'left="$STAGE/left"; if [ -s "$left" ]; then sed -i 1d "$left"; exit 100; fi'
        bare.does("apt-get", f'case "$*" in *" install "*) {count} ;; esac; {APT}')
        done, _ = set_up(bare, "demo")
        calls = [c for c in bare.calls("apt-get", "dpkg") if "--print-uris" not in c]
        kinds = [re.search(r"install|update|configure", call)[0] for call in calls]
        tried = ["install", "configure", "update", "install", "update", "install"]
        assert kinds == tried[: (1, 4, 6, 6)[failures]]
        own = ["sourceparts=build/deps/apt-deb" in call for call in calls]
        assert own == [n > 3 for n in range(len(calls))]
        assert done.returncode == (failures == 3)
    assert re.search(r"^error: apt-get could not install: .*cmake", done.stderr, re.MULTILINE)


@pytest.mark.parametrize("must", [True, False])
def test_sources_that_cannot_be_reached_are_named_with_what_needs_them(bare, must):
    """An error where something must come from them, a word where it only may."""
    known = set((bare.folder / "known").read_text().split()) - {"valgrind"}
    (bare.folder / "installed").write_text("\n".join([*(known - {"g++"} if must else known), ""]))
    for release in bare.folder.glob("dists/*/InRelease"):
        release.unlink()
    done, started = set_up(bare, "test")
    said = "cannot reach this Debian's package sources (apt-get); needed for: "
    assert done.returncode == int(must)
    lacking = "g++ valgrind" if must else "valgrind"
    shown = done.stderr if must else done.stdout
    assert f"{said}{lacking} build/venv (log: build/setup.log)\n" in shown
    assert not installs(bare) and bool(started) != must
    assert not (bare.folder / "build/deps/packages.tried").exists()
    if not must:
        assert "will be skipped: valgrind\n" in done.stdout


def test_what_apt_does_not_know_is_looked_for_in_fresh_lists(bare):
    bare.does("apt-cache", '[ "$2" != valgrind ] || [ -e "$STAGE/fresh" ]')
    bare.does("apt-get", f'case "$*" in *" update") touch "$STAGE/fresh" ;; esac; {APT}')
    done, _ = set_up(bare, "test")
    assert done.returncode == 0 and "valgrind" in (bare.folder / "installed").read_text().split()


def test_what_fails_ends_the_installation_beside_it(bare):
    """Packages of Python come while apt-get is at work; nothing of it stays behind."""
    known = (bare.folder / "known").read_text()
    (bare.folder / "known").write_text(known.replace("\ncmake\n", "\n"))
    beside = 'echo $$ >"$STAGE/beside"; exec /bin/sleep 90'
    bare.does("python", f'case "$*" in *" install "*) {beside} ;; esac; {PYTHON}')
    begun = 'until [ -s "$STAGE/beside" ]; do /bin/sleep 0.1; done'
    bare.does("apt-get", f'case "$*" in *" install "*cmake*) {begun} ;; esac; {APT}')
    assert set_up(bare, "demo")[0].returncode == 1
    process = Path("/proc") / (bare.folder / "beside").read_text().strip() / "cmdline"
    wait_until(lambda: not process.exists() or b"sleep" not in process.read_bytes())


# --- Python ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(("variable", "option"), [("1", "--compile"), ("", "--no-compile")])
def test_packages_are_compiled_where_python_may_not_do_so_later(bare, variable, option):
    own = str(bare.folder / "unity")
    bare.run("setup", "demo", DAHL_UNITY_DIR=own, PYTHONDONTWRITEBYTECODE=variable)
    calls = [call.split() for call in bare.calls("python") if " install " in call]
    assert [word in words for words in calls for word in (option, "--no-deps")] == [True] * 4
    assert ["--require-hashes" in words for words in calls] == [True, False]  # dahl itself


@pytest.mark.parametrize(("version", "good"), [((3, 10, 99), False), ((3, 11, 0), True)])
def test_a_python_that_is_too_old_is_passed_over(bare, version, good):
    told = f'exec {sys.executable} -c "import sys; sys.version_info = {version}; $2"'
    for name in ("mine", "python3.11", "python3"):
        bare.stand_in(f"bin/{name}", told if name == "mine" else "exit 1")
    found = sourced(bare, "DAHL_PYTHON=mine find_python")
    assert found.stdout == ("mine\n" if good else "/usr/bin/python3\n")


def test_without_a_python_it_says_which_were_tried(bare):
    refused = sourced(bare, "find_python() { :; }; DAHL_PYTHON=/my/python; start_python")
    assert refused.returncode == 1
    tried = "(tried: /my/python python3.11 python3 /usr/bin/python3); set DAHL_PYTHON"
    assert f"error: no Python 3.11 or later with venv {tried}" in refused.stderr


def test_another_interpreter_wants_another_environment(bare):
    bare.does("python3.11", f'case "$*" in -VV) cat "$STAGE/version" ;; esac; {PYTHON}')
    for version, made in (("3.11.2", True), ("3.11.2", False), ("3.12.0", True)):
        (bare.folder / "version").write_text(version)
        _, started = set_up(bare, "demo")
        assert any("-m venv" in call for call in started) == made
    keys = sourced(bare, "PYTHON=true; VENV=/here; venv_key; VENV=/there; venv_key").stdout.split()
    assert keys[0] != keys[2]  # and so does another place


def test_an_environment_that_was_left_half_done_is_made_anew(bare):
    set_up(bare, "demo")
    for state, works in (("3", False), ("0", True)):
        (bare.folder / "state").write_text(state)
        fails = "" if works else 'case "$*" in *" install "*) exit 1 ;; esac;'
        bare.does("python", f"{fails} {PYTHON}")
        done, started = set_up(bare, "demo")
        assert (done.returncode == 0) == works
    assert any("-m venv" in call for call in started)


@pytest.fixture
def checked(root, tmp_path, capsys):
    """Exit code and words of check_venv.py for a lock, in a folder that has package one 1.0."""
    space = runpy.run_path(str(root / "tools/setup/check_venv.py"))
    for name, record in (("one-1.0", "one.py,sha256=x,4\n"), ("dahl-0.1", "")):
        (tmp_path / f"site/{name}.dist-info").mkdir(parents=True)
        (tmp_path / f"site/{name}.dist-info/RECORD").write_text(record)
    (tmp_path / "site/one.py").write_text("1+1\n")
    space["main"].__globals__["sysconfig"] = type(
        "Here", (), {"get_path": staticmethod(lambda name: str(tmp_path / "site"))}
    )

    def check(*locks: str) -> tuple[int, list[str]]:
        paths = []
        for n, lock in enumerate(locks):
            (tmp_path / f"{n}.lock").write_text(lock)
            paths.append(str(tmp_path / f"{n}.lock"))
        return space["main"](paths), capsys.readouterr().out.splitlines()

    return tmp_path / "site", check


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


# --- what is fetched ------------------------------------------------------------------------------


def test_unity_comes_out_of_debians_source_package(bare, root):
    """Its three files, proved by their sums, and nothing else is left."""
    whole = root / "build/deps/unity"
    if not (whole / "unity.c").exists():
        pytest.skip("unproven: how Unity is unpacked: build/deps/unity is not here to pack")
    with tarfile.open(bare.folder / "source.tar.gz", "w:gz") as archive:
        for name in ("unity.c", "unity.h", "unity_internals.h"):
            archive.add(whole / name, f"ntpsec-1.2/tests/unity/{name}")
        archive.add(root / "README.md", "ntpsec-1.2/README")
    copied = 'case "$*" in *" source "*) cp "$STAGE/source.tar.gz" ntpsec_1.2.orig.tar.gz ;; esac'
    bare.does("apt-get", copied)
    (bare.folder / "build/deps/unity").mkdir(parents=True)
    (bare.folder / "build/deps/unity/old").touch()
    done = sourced(bare, "mkdir -p build/deps; get_unity; unity_is_here")
    assert done.returncode == 0, done.stderr
    names = {path.name for path in (bare.folder / "build/deps/unity").iterdir()}
    assert names == {"unity.c", "unity.h", "unity_internals.h"}
    assert not (bare.folder / "build/deps/unity.part").exists()
    update, source = bare.calls("apt-get")
    assert update.endswith(" update") and source.endswith(" ntpsec")
    for call in (update, source):  # from Debian's sources alone, into a folder of its own
        assert "sourceparts=build/deps/unity.part/parts" in call
        assert "Dir::State::lists=build/deps/unity.part/lists" in call


def test_a_unity_that_cannot_be_fetched_says_what_to_do(bare):
    bare.does("apt-get", "exit 100")
    done = sourced(bare, "mkdir -p build/deps; get_unity")
    assert done.returncode == 1
    assert "could not fetch Unity" in done.stderr and "DAHL_UNITY_DIR" in done.stderr
