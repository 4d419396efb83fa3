# SPDX-License-Identifier: MIT
"""The scripts of tools/: help, bad words, the programs that they start, exit codes. All programs
that they call are stand-ins. (tools/setup.sh: test_setup.py)
"""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from loop_tools import is_running, wait_until
from script_stage import Stage

UNLOCKED = 'flock -n "$STAGE/build/build.lock" true'  # no build is running


@pytest.fixture
def scripts(tmp_path: Path) -> Stage:
    made = Stage(tmp_path)
    for name in ("apt-get", "dpkg-query", "python3", "cmake", "ctest"):
        made.stand_in(f"bin/{name}")
    return made


@pytest.fixture
def stage(scripts: Stage) -> Stage:
    for name in ("tools/setup.sh", "build/venv/bin/python", "build/venv/bin/dahl"):
        scripts.stand_in(name)
    return scripts


@pytest.mark.parametrize("script", ["setup", "test", "demo", "bench", "lock", "vm", "docs"])
def test_help_does_nothing_else(scripts, script):
    shown = scripts.run(script, "--help")
    assert shown.returncode == 0
    assert shown.stdout.startswith(f"Usage: tools/{script}.sh") and len(shown.stdout) > 200
    assert not scripts.calls()


@pytest.mark.parametrize(
    ("words", "named"),
    [
        ("setup demo --fast", "--fast"),
        ("bench paint", "paint"),
        ("test -k", "-k"),
        ("vm relative true", "absolute"),
        ("vm /tmp", "command"),
    ],
)
def test_unknown_words_are_an_error_before_anything_starts(scripts, words, named):
    script, *rest = words.split()
    done = scripts.run(script, *rest)
    assert done.returncode == 1 and not scripts.calls()
    assert done.stderr.startswith("error: ") and named in done.stderr


@pytest.mark.parametrize(
    ("words", "need"),
    [
        (("--scene", "steering"), "demo"),
        (("--target", "m4f"), "firmware"),
        (("a log.csv", "--target=m0"), "firmware"),
    ],
)
def test_the_demo_sets_up_builds_and_runs(stage, words, need):
    stage.does("cmake", f'{UNLOCKED} && touch "$STAGE/unlocked"; true')
    stage.does("dahl", f'printf "%s\\n" "$@" >"$STAGE/words"; {UNLOCKED} && exit 3')
    assert stage.run("demo", *words, CDPATH="elsewhere:.").returncode == 3
    first, configured, built, _ = stage.calls()
    assert first == f"setup.sh {need}" and "-DDAHL_BUILD_TESTS=OFF" in configured
    assert "dahl-loop dahl_binding dahl_fmu" in built
    assert not (stage.folder / "unlocked").exists()
    assert stage.lines("words") == ["demo", *words]


@pytest.mark.parametrize("ends", [True, False])
def test_a_second_build_waits_for_the_first(stage, ends):
    stage.stand_in("bin/flock", f'case "$*" in *-w*) exit {int(not ends)} ;; esac; exit 1')
    done = stage.run("demo")
    assert "another build is at work" in done.stdout
    assert done.returncode == int(not ends) and bool(stage.calls("cmake")) == ends
    assert ends or done.stderr.startswith("error: ") and "build/build.lock" in done.stderr


@pytest.mark.parametrize("step", ["--preset", "--build"])
@pytest.mark.parametrize("script", ["demo", "test"])
def test_a_failed_set_up_or_build_ends_it_and_shows_the_log(stage, script, step):
    fails = "for n in $(seq 40); do echo line $n; done; exit 1"
    stage.does("cmake", f'case "$*" in *{step}*) {fails} ;; esac')
    done = stage.run(script)
    assert done.returncode == 1 and stage.calls()[-1].startswith("cmake")
    *shown, error = done.stderr.splitlines()
    assert shown and shown == [f"line {n}" for n in range(41 - len(shown), 41)]
    assert error.startswith("error: ") and "build/build.log" in error
    stage.forget()
    stage.does("setup.sh", "echo reason; exit 1")
    done = stage.run(script)
    assert done.returncode == 1 and "reason" in done.stdout and len(stage.calls()) == 1


VM_TOOLS = ("qemu-system-x86_64", "busybox", "cpio", "ip", "modprobe", "timeout")


@pytest.mark.parametrize("code", [0, 3, None])
def test_a_virtual_machine_returns_the_code_of_its_command(scripts, code):
    """77 without a kernel, 1 if the machine wrote no code. Its time limit is that of the caller."""
    for name in VM_TOOLS:
        scripts.stand_in(f"bin/{name}")
    scripts.does("cpio", "cat >/dev/null")  # otherwise `find` may write into a closed pipe
    folder, limit = scripts.folder / "work", {"DAHL_VM_SECONDS": "7"}
    folder.mkdir()
    assert scripts.run("vm", str(folder), "true", **limit).returncode == 77
    scripts.write("build/deps/kernel/vmlinuz", "a kernel")
    (scripts.folder / "build/deps/kernel/lib/modules/6").mkdir(parents=True)
    scripts.does("timeout", "" if code is None else f"echo out >output; echo {code} >code")
    done = scripts.run("vm", str(folder), "echo", "a b", **limit)
    assert done.returncode == (1 if code is None else code), done.stderr
    assert ("out\n" in done.stdout) == (code is not None)
    assert scripts.calls("timeout")[0].startswith("timeout 7 qemu-system-x86_64 ")
    assert f"cd {folder}\necho a\\ b " in (folder / ".vm/command").read_text()


def chosen_labels(call: str) -> set[str]:
    words = call.split()
    excluded = words[words.index("--label-exclude") + 1] if "--label-exclude" in words else "^$a"
    included = words[words.index("--label-regex") + 1] if "--label-regex" in words else ""
    every = ("", "checks", "long", "soak")
    return {x for x in every if re.search(included, x) and not re.search(excluded, x)}


@pytest.mark.parametrize(
    ("mode", "labels"),
    [
        ("", {""}),
        ("--checks", {"", "checks"}),
        ("--full", {"", "checks", "long"}),
        ("--soak", {"soak"}),
    ],
)
def test_each_mode_runs_and_counts_its_tests(stage, mode, labels):
    stage.write("build/python.xml", "of an earlier run")
    stage.does("ctest", "exit 8")
    codes = "*tests/python*) exit 1 ;; *tests/proof*) exit 4 ;; *count_tests*) exit 7 ;;"
    stage.does("python", f'case "$*" in {codes} esac')
    assert stage.run("test", "-k", "slip or loaded", *mode.split()).returncode == 7
    assert stage.calls()[0] == f"setup.sh {'checks' if mode else 'test'}"
    [ctest] = stage.calls("ctest")
    assert chosen_labels(ctest) == labels and "-R slip|loaded" in ctest
    *runs, count = stage.calls("python")
    folders = {folder for call in runs for folder in re.findall(r" tests/(\w+)(?= )", call)}
    assert folders == {"python"} | ({"proof", "fuzz", "static", "quality"} if mode else set())
    assert all(f"-k slip or loaded {mode}".strip() in call for call in runs)
    counted = re.findall(r"build/(\w+\.xml=\d+)", count)
    assert sorted(counted) == ["checks.xml=4"] * bool(mode) + ["ctest.xml=8", "python.xml=1"]
    assert ("--note not run: " in count) == (not mode)
    assert not (stage.folder / "build/python.xml").exists()


def test_a_run_that_is_ended_ends_its_checks(stage):
    beside = '*tests/proof*) echo $$ >"$STAGE/beside"; exec sleep 600 ;;'
    ended = '*tests/python*) until [ -s "$STAGE/beside" ]; do sleep 0.1; done; kill "$PPID" ;;'
    stage.does("python", f'case "$*" in {beside} {ended} esac')
    assert stage.run("test", "--checks").returncode != 0
    wait_until(lambda: not is_running(int(stage.lines("beside")[0])))


@pytest.mark.parametrize("fails", [False, True])
@pytest.mark.parametrize(
    ("words", "started"),
    [
        ("", ["target.py", "host.py", "report.py --docs"]),
        ("--quick", ["target.py --quick", "host.py --quick", "report.py"]),
        ("target --quick m0 m3", ["target.py --quick m0 m3"]),
        ("host", ["host.py"]),
        ("report", ["report.py"]),
        ("docs", ["report.py --docs"]),
    ],
)
def test_each_bench_command_ends_with_its_first_failure(stage, words, started, fails):
    stage.does("python", f'case "$*" in *bench/{started[0].split()[0]}*) exit {4 * fails} ;; esac')
    assert stage.run("bench", *words.split()).returncode == 4 * fails
    assert stage.calls()[0] == "setup.sh bench"
    calls = [call.partition("python tools/bench/")[2] for call in stage.calls("python")]
    assert [call for call in calls if call] == (started[:1] if fails else started)
