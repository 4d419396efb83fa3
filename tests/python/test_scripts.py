# SPDX-License-Identifier: MIT
"""What the scripts of tools/ start, with which words and in which order, and how they end; every
program that they call is a stand-in. (tools/setup.sh: test_setup.py)
"""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from loop_tools import wait_until
from script_stage import Stage

UNLOCKED = 'flock -n "$STAGE/build/build.lock" true'  # nobody builds just now


@pytest.fixture
def scripts(tmp_path: Path) -> Stage:
    """The scripts as they are; what they start first is a stand-in."""
    made = Stage(tmp_path)
    for name in ("apt-get", "dpkg-query", "python3", "cmake", "ctest"):
        made.stand_in(f"bin/{name}")
    return made


@pytest.fixture
def stage(scripts: Stage) -> Stage:
    """The same without a set-up of its own, with all that it would have set up."""
    for name in ("tools/setup.sh", "build/venv/bin/python", "build/venv/bin/dahl"):
        scripts.stand_in(name)
    return scripts


@pytest.mark.parametrize("script", ["setup", "test", "demo", "bench", "lock", "vm"])
def test_help_is_given_without_doing_anything(scripts, script):
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
def test_words_that_mean_nothing_are_named_before_anything_is_done(scripts, words, named):
    script, *rest = words.split()
    done = scripts.run(script, *rest)
    assert done.returncode == 1 and not scripts.calls()
    assert done.stderr.startswith("error: ") and named in done.stderr


# --- tools/demo.sh -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("words", "need"),
    [
        ((), "demo"),
        (("--scene", "steering"), "demo"),
        (("--target", "m4f"), "firmware"),
        (("a log.csv", "--target=m0"), "firmware"),
    ],
)
def test_the_demo_gets_what_it_needs_builds_and_starts(stage, words, need):
    """Its exit code is the demo's; nobody else builds while it builds, and others may while it
    runs. A new build folder wants no Unity, one that is there keeps its tests.
    """
    stage.does("cmake", f'{UNLOCKED} && touch "$STAGE/unlocked"; true')
    stage.does("dahl", f'printf "%s\\n" "$@" >"$STAGE/words"; {UNLOCKED} && exit 3')
    assert stage.run("demo", *words, CDPATH="elsewhere:.").returncode == 3
    first, *built, last = stage.calls()
    assert (first, last.split()[:2]) == (f"setup.sh {need}", ["dahl", "demo"])
    configured, made = built
    assert "--preset host" in configured and "-DDAHL_BUILD_TESTS=OFF" in configured
    assert made.startswith("cmake --build build/host ") and "dahl-loop dahl_shared" in made
    assert not (stage.folder / "unlocked").exists()
    assert stage.lines("words") == ["demo", *words]
    (stage.folder / "build/host").mkdir()
    (stage.folder / "build/host/build.ninja").touch()
    stage.run("demo", *words)
    assert stage.calls("cmake")[2:] == [made]


@pytest.mark.parametrize("script", ["demo", "test"])
def test_a_set_up_that_fails_ends_it_and_is_shown(stage, script):
    stage.does("setup.sh", "echo why; exit 1")
    done = stage.run(script)
    assert done.returncode == 1 and "why" in done.stdout
    assert [call.split()[0] for call in stage.calls()] == ["setup.sh"]


@pytest.mark.parametrize("script", ["demo", "test"])
def test_a_build_that_fails_shows_the_end_of_its_own_log(stage, script):
    """The log is that of this run alone, and holds all."""
    stage.does("cmake", "echo of the first run")
    stage.run(script)
    stage.forget()
    stage.does("cmake", "for n in $(seq 40); do echo line $n; done; exit 1")
    done = stage.run(script)
    assert done.returncode == 1 and stage.calls()[-1].startswith("cmake")
    *shown, error = done.stderr.splitlines()
    assert shown and shown == [f"line {n}" for n in range(41 - len(shown), 41)]
    assert error.startswith("error: ") and "build/build.log" in error
    assert stage.lines("build/build.log") == [f"line {n}" for n in range(1, 41)]


# --- tools/test.sh -------------------------------------------------------------------------------


def chosen_labels(call: str) -> set[str]:
    """Labels of the tests that a call of ctest runs; "" stands for a test without one."""
    words = call.split()
    excluded = words[words.index("--label-exclude") + 1] if "--label-exclude" in words else "^$a"
    included = words[words.index("--label-regex") + 1] if "--label-regex" in words else ""
    every = ("", "checks", "long", "soak")
    return {x for x in every if re.search(included, x) and not re.search(excluded, x)}


@pytest.mark.parametrize(
    ("mode", "need", "labels"),
    [
        ("", "test", {""}),
        ("--checks", "checks", {"", "checks"}),
        ("--full", "checks", {"", "checks", "long"}),
        ("--long", "checks", {"", "checks", "long"}),
        ("--soak", "checks", {"soak"}),
    ],
)
def test_each_mode_runs_its_tests(stage, mode, need, labels):
    """In C and in Python, those of the word that is asked for, while others may build. What each
    run writes is counted, and what the checks say is shown.
    """
    stage.does("ctest", f'{UNLOCKED} || touch "$STAGE/locked"')
    stage.does("python", 'case "$*" in *tests/proof*) echo of the checks ;; esac')
    done = stage.run("test", "-k", "codec", *mode.split())
    assert done.returncode == 0 and ("of the checks" in done.stdout) == bool(mode)
    assert stage.calls()[0] == f"setup.sh {need}"
    assert "-DDAHL_BUILD_TESTS=ON" in " ".join(stage.calls("cmake"))
    [ctest] = stage.calls("ctest")
    assert chosen_labels(ctest) == labels and "-R codec" in ctest
    assert "--output-on-failure" in ctest  # and whole, since tests are counted in it:
    assert set(re.findall(r"--test-output-size-(\w+) 1000000 ", ctest)) == {"passed", "failed"}
    assert not (stage.folder / "locked").exists()
    runs = [call for call in stage.calls("python") if "-m pytest" in call]
    folders = {folder for call in runs for folder in re.findall(r" tests/(\w+)(?= )", call)}
    assert folders == {"python"} | ({"proof", "fuzz", "static", "quality"} if mode else set())
    assert all(f"-k codec {mode}".strip() in call for call in runs)
    written = [re.search(r"--(?:output-junit|junitxml) (\S+)", call)[1] for call in [ctest, *runs]]
    counted = re.findall(r"(\S+\.xml)=0", stage.calls("python")[-1])
    assert sorted(counted) == sorted(written) and len(set(counted)) == len(written)
    assert ("--note not run: " in stage.calls("python")[-1]) == (not mode)


def test_words_of_the_user_reach_pytest_as_they_are(stage):
    note = 'case "$*" in *"-m pytest"*) printf "%s\\n" "$@" >"$STAGE/words" ;; esac'
    stage.does("python", note)
    stage.run("test", "-k", "slip or parallel or loaded", "-x", DAHL_UNITY_DIR="/my unity")
    assert stage.calls("ctest")[-1].endswith(
        "-R slip|parallel|loaded"
    )  # a regular expression there
    assert stage.lines("words")[-3:] == ["-k", "slip or parallel or loaded", "-x"]
    assert "-DDAHL_UNITY_DIR=/my unity" in " ".join(stage.calls("cmake"))


def test_all_run_whatever_fails_and_each_code_is_counted(stage):
    """Results of an earlier run do not count; the exit code is that of the count."""
    (stage.folder / "build/python.xml").write_text("old")
    stage.does("ctest", "exit 8")
    codes = "*tests/python*) exit 1 ;; *tests/proof*) exit 4 ;; *count_tests*) exit 7 ;;"
    stage.does("python", f'case "$*" in {codes} esac')
    assert stage.run("test", "--checks").returncode == 7
    runs = re.findall(r"build/(\w+\.xml=\d+)", stage.calls("python")[-1])
    assert sorted(runs) == ["checks.xml=4", "ctest.xml=8", "python.xml=1"]
    assert not (stage.folder / "build/python.xml").exists()


def test_a_run_that_is_ended_ends_its_checks(stage):
    """They run beside it, in a process group of their own."""
    beside = '*tests/proof*) echo $$ >"$STAGE/beside"; exec sleep 50 ;;'
    ended = '*tests/python*) until [ -s "$STAGE/beside" ]; do sleep 0.1; done; kill "$PPID" ;;'
    stage.does("python", f'case "$*" in {beside} {ended} esac')
    assert stage.run("test", "--checks").returncode != 0
    process = Path("/proc") / stage.lines("beside")[0] / "cmdline"
    wait_until(lambda: not process.exists() or b"sleep" not in process.read_bytes())


# --- tools/bench.sh ------------------------------------------------------------------------------

TARGET, HOST, REPORT = (f"python tools/bench/{name}.py" for name in ("target", "host", "report"))


@pytest.mark.parametrize(
    ("words", "started"),
    [
        ("", [TARGET, HOST, f"{REPORT} --docs"]),
        ("--quick", [f"{TARGET} --quick", f"{HOST} --quick", REPORT]),
        ("target --quick m0 m3", [f"{TARGET} --quick m0 m3"]),
        ("host --quick", [f"{HOST} --quick"]),
        ("report", [REPORT]),
        ("docs", [f"{REPORT} --docs"]),
    ],
)
def test_each_command_of_the_bench_and_its_words(stage, words, started):
    assert stage.run("bench", *words.split()).returncode == 0
    assert stage.calls()[0] == "setup.sh bench"
    assert [call for call in stage.calls("python") if ".py" in call] == started


@pytest.mark.parametrize("command", ["", "--quick", "target", "host", "report", "docs"])
@pytest.mark.parametrize("failing", ["target", "host", "report", "setup"])
def test_a_part_of_the_bench_that_fails_is_its_end(stage, command, failing):
    failed = f"*bench/{failing}.py*) exit 4 ;;"
    stage.does("python", f'case "$*" in {failed} esac')
    stage.does("setup.sh", "exit 4" if failing == "setup" else "")
    runs = {"": ("target", "host", "report"), "docs": ("report",)}
    runs |= {"--quick": runs[""]} | {name: (name,) for name in ("target", "host", "report")}
    fails = failing in (*runs[command], "setup")
    assert (stage.run("bench", *command.split()).returncode != 0) == fails
    if fails and failing != "setup":
        assert f"bench/{failing}.py" in stage.calls("python")[-1]


@pytest.mark.parametrize("code", [0, 1])
def test_rivals_are_installed_once_and_stop_nothing(stage, code):
    """What could not be had is asked for again with the next run; so is what has other pins."""
    venv = '"-m venv "*) mkdir -p "$3/bin" && ln -s "$STAGE/note" "$3/bin/python" ;;'
    stage.does("python", f'case "$*" in {venv} *" install "*) exit {code} ;; esac')
    pins, asked = stage.folder / "tools/requirements/rivals.lock", []
    for more in ("", "", "# other\n"):
        pins.write_text(pins.read_text() + more)
        done = stage.run("bench", "host")
        assert done.returncode == 0 and ("bench/venv.log" in done.stdout) == bool(code)
        assert HOST in stage.calls("python")[-1]
        asked.append(sum("--require-hashes -r tools/" in call for call in stage.calls("python")))
    assert asked == ([1, 2, 3] if code else [1, 1, 2])


# --- tools/lock.sh -------------------------------------------------------------------------------


def test_each_lock_stands_on_those_before_it(stage):
    """In their versions, and without their packages."""
    made = 'mkdir -p "$4/bin"; for name in python uv; do ln -s "$STAGE/note" "$4/bin/$name"; done'
    stage.does("python3", made)
    assert stage.run("lock", "--upgrade").returncode == 0
    calls = {re.search(r" (\w+)\.txt -o \1\.lock$", call)[1]: call for call in stage.calls("uv")}
    assert {name: re.findall(r"-c (\w+)\.lock", call) for name, call in calls.items()} == {
        "demo": [],
        "identify": ["demo"],
        "test": ["demo", "identify"],
        "checks": ["demo", "identify", "test"],
        "rivals": [],
    }
    for call in calls.values():
        assert "--generate-hashes" in call and "--upgrade" in call
        assert "--universal --python-version 3.11 " in call  # the oldest that setup.sh takes
        assert ("--no-emit-package=numpy" in call) == ("-c demo.lock" in call)
    stage.does("uv", 'case "$*" in *" test.txt "*) exit 1 ;; esac')
    assert stage.run("lock").returncode != 0 and "checks" not in stage.calls("uv")[-1]


# --- tools/vm.sh ---------------------------------------------------------------------------------


@pytest.fixture
def machine(stage, tmp_path) -> Path:
    """A folder for tools/vm.sh, with an emulator that runs the machine's command here."""
    folder = tmp_path / "a,b"
    folder.mkdir()
    (stage.folder / "build/deps/kernel/lib/modules/6.1").mkdir(parents=True)
    (stage.folder / "build/deps/kernel/vmlinuz").write_text("kernel")
    for name in ("busybox", "ip", "modprobe", "qemu-system-x86_64"):
        stage.stand_in(f"bin/{name}")
    stage.stand_in("bin/cpio", "cat >/dev/null")
    there = f'sed "/^export/d" {folder}/.vm/command | bash >{folder}/.vm/output 2>&1'
    stage.does("qemu-system-x86_64", f"{there}; echo $? >{folder}/.vm/code")
    return folder


def test_the_machine_has_two_buses_and_runs_the_words_as_they_are(stage, machine):
    """In the folder, whose comma QEMU would take for the end of an option's value."""
    words = ("bash", "-c", 'pwd; printf "<%s>" "$@"; exit 9', "x", "a b", "$HOME", "")
    done = stage.run("vm", str(machine), *words)
    assert done.stdout == f"{machine}\n<a b><$HOME><>"
    assert done.returncode == 9
    for name in ("vcan0", "vcan1"):
        assert f"ip link add dev {name} type vcan" in stage.calls("ip")
        assert f"ip link set {name} up" in stage.calls("ip")
    modules = {call.split()[-1] for call in stage.calls("modprobe")}
    assert {"9p", "virtio_pci", "vcan", "can-raw", "can-gw", "sch_tbf"} <= modules
    (emulated,) = stage.calls("qemu-system-x86_64")
    assert "local,path=a,,b,mount_tag=work," in emulated
    others = re.search(r"local,path=/,(\S+)", emulated)[1]  # this machine's files
    assert "readonly=on" in others


def test_a_machine_that_does_not_run_is_an_error(stage, machine):
    stage.does("qemu-system-x86_64", "exec sleep 90")
    (machine / ".vm").mkdir()
    (machine / ".vm/code").write_text("0\n")  # of a run before
    done = stage.run("vm", str(machine), "true", DAHL_VM_SECONDS="1")
    assert done.returncode == 1 and "error: " in done.stderr
    (stage.folder / "build/deps/kernel/vmlinuz").unlink()
    assert stage.run("vm", str(machine), "true").returncode == 77
