# SPDX-License-Identifier: MIT
"""The scripts of tools/: help, bad words, the programs that they start, exit codes. All programs
that they call are stand-ins. (tools/setup.sh: test_setup.py)
"""

import re
from pathlib import Path

import pytest
from loop_tools import is_running, wait_until
from script_stage import PYTHON, UV, Stage

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
    scripts.stand_in("build/deps/uv/bin/uv", UV)
    scripts.stand_in("bin/python3.11", PYTHON)
    return scripts


SCRIPTS = ["setup", "test", "demo", "bench", "lock", "vm", "docs", "explore"]


@pytest.mark.parametrize("script", SCRIPTS)
def test_help_does_nothing_else(scripts, script):
    shown = scripts.run(script, "--help")
    assert shown.returncode == 0 and not scripts.calls()
    assert shown.stdout.startswith(f"Usage: tools/{script}.sh") and len(shown.stdout) > 200


BAD_WORDS = {"setup demo --fast": "--fast", "bench paint": "paint", "test -k": "-k"}
BAD_WORDS |= {"vm relative true": "absolute", "vm /tmp": "command"}
BAD_WORDS |= {"explore --fast": "--fast", "explore a.html b.html": "b.html"}


@pytest.mark.parametrize("words", BAD_WORDS)
def test_unknown_words_are_an_error_before_anything_starts(scripts, words):
    done = scripts.run(*words.split())
    assert done.returncode == 1 and not scripts.calls()
    assert done.stderr.startswith("error: ") and BAD_WORDS[words] in done.stderr


DEMOS = {"--scene steering": "demo", "--target m4f": "firmware", "log.csv --target=m0": "firmware"}


@pytest.mark.parametrize("words", DEMOS)
def test_the_demo_sets_up_builds_and_runs(stage, words):
    """A second build must wait for the first, but not for its demo."""
    stage.does("cmake", f'! {UNLOCKED} || touch "$STAGE/unlocked"')
    stage.does("dahl", f"{UNLOCKED} && exit 3")
    assert stage.run("demo", *words.split(), CDPATH="elsewhere:.").returncode == 3
    first, configured, built, ran = stage.calls()
    assert first == f"setup.sh {DEMOS[words]}" and "-DDAHL_BUILD_TESTS=OFF" in configured
    assert "dahl-loop dahl_binding dahl_fmu" in built and ran == f"dahl demo {words}"
    assert not (stage.folder / "unlocked").exists()


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
    stage.does("setup.sh", "echo reason; exit 1")
    done = stage.run(script)
    assert done.returncode == 1 and "reason" in done.stdout and len(stage.calls()) == 1


def test_a_virtual_machine_returns_the_code_of_its_command(scripts):
    for name in ("qemu-system-x86_64", "busybox", "cpio", "ip", "modprobe", "timeout"):
        scripts.stand_in(f"bin/{name}")
    scripts.does("cpio", "cat >/dev/null")  # otherwise `find` may write into a closed pipe
    scripts.does("timeout", "echo 3 >code")
    scripts.write("build/deps/kernel/vmlinuz", "a kernel")
    scripts.write("build/deps/kernel/lib/modules/6/modules.dep")
    assert scripts.run("vm", str(scripts.folder), "echo", "a b").returncode == 3
    assert "\necho a\\ b " in (scripts.folder / ".vm/command").read_text()


LABELS = {  # of the tests in C, as a regular expression
    "": "--label-exclude ^(checks|long|soak)$",
    "--checks": "--label-exclude ^(long|soak)$",
    "--full": "--label-exclude ^soak$",
    "--soak": "--label-regex ^soak$",
}


@pytest.mark.parametrize("mode", LABELS)
def test_each_mode_runs_and_counts_its_tests(stage, mode):
    stage.write("build/python.xml", "of an earlier run")
    stage.does("ctest", "exit 8")
    codes = f"*tests/python*) {UNLOCKED} || exit 9; exit 1 ;; *tests/proof*) exit 4 ;;"
    stage.does("python", f'case "$*" in {codes} *count_tests*) exit 7 ;; esac')
    assert stage.run("test", "-k", "slip or loaded", *mode.split()).returncode == 7
    assert stage.calls()[0] == f"setup.sh {'checks' if mode else 'test'}"
    [ctest] = stage.calls("ctest")
    assert f" {LABELS[mode]} " in ctest and "-R slip|loaded" in ctest
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


BENCHES = {
    "": ["target.py", "host.py", "report.py --docs"],
    "--quick": ["target.py --quick", "host.py --quick", "report.py"],
    "target --quick m0 m3": ["target.py --quick m0 m3"],
    "host --quick": ["host.py --quick"],
    "docs": ["report.py --docs"],
}


@pytest.mark.parametrize("fails", [False, True])
@pytest.mark.parametrize("words", BENCHES)
def test_each_bench_command_ends_with_its_first_failure(stage, words, fails):
    due = BENCHES[words]
    stage.does("python", f'case "$*" in *bench/{due[0].split()[0]}*) exit {4 * fails} ;; esac')
    assert stage.run("bench", *words.split()).returncode == 4 * fails
    assert stage.calls()[0] == "setup.sh bench"
    calls = [call.partition("python tools/bench/")[2] for call in stage.calls("python")]
    assert [call for call in calls if call] == (due[:1] if fails else due)
    needs_rivals = any(call.startswith("host.py") for call in calls)
    assert any("pyproject.toml:rivals" in call for call in stage.calls("uv")) == needs_rivals


@pytest.mark.parametrize("words", ["", "a.html"])
def test_the_page_is_compiled_before_it_is_written(stage, words):
    stage.stand_in("bin/clang")
    assert stage.run("explore", *words.split()).returncode == 0
    setup, clang, python = stage.calls()
    assert setup == "setup.sh explore" and "lib/model" in clang
    assert python.endswith(words or "build/explore.html")
    stage.does("clang", "exit 1")
    assert stage.run("explore").returncode == 1 and stage.calls()[-1].startswith("clang")
