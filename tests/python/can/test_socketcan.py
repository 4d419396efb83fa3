# SPDX-License-Identifier: MIT
"""dahl-loop on a real SocketCAN, with can-utils as foreign clients; then on two emulated SJA1000
controllers.

The first runs on this kernel if its vcan0 is up, else in a virtual machine (tools/vm.sh). One boot
runs all cases (tests/socketcan/run.sh and controllers.sh). Each test reads the files of one case.
"""

import json
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest
from conftest import ROOT, built
from dahl import bus
from dahl.sim import run_file, scene
from loop_tools import EXAMPLE, SCENES, counts_of, read_log, run, torques_of
from programs import call
from test_pytest_plugin import SAME

pytestmark = pytest.mark.checks

SCENE = SCENES / "steering.ini"
SCRIPTS = ROOT / "tests/socketcan"
ABSENT = 77  # vm.sh's code for what cannot be had here
VM_SECONDS = 800  # less than the timeout of a test; only a hang takes so long
BUS_OFF, RESTARTED = 0x20000040, 0x20000100  # error frames, linux/can/error.h
TORQUE = 0x110


@dataclass
class Case:
    folder: Path

    def summary(self, name: str) -> dict:
        counters = (self.folder / f"{name}.counters").read_text()
        return run_file.summary(counters, scene.read(SCENE), "", 1, is_virtual=False)

    def code(self, name: str) -> int:
        return int((self.folder / f"{name}.code").read_text())

    def errors(self, name: str) -> str:
        return (self.folder / f"{name}.err").read_text()

    def counted(self, name: str = "node") -> dict[str, int]:
        """The counts of the node that are not 0."""
        return {kind: count for kind, count in self.summary(name)["node"].items() if count}

    def frames(self, name: str) -> list[tuple[str, str]]:
        """(time, id#data) of each line of a log."""
        lines = (self.folder / f"{name}.log").read_text().splitlines()
        return [(line.split()[0], line.split()[2]) for line in lines]


def run_cases(words: list[object]) -> None:
    done = call("env", f"DAHL_VM_SECONDS={VM_SECONDS}", *words, timeout=VM_SECONDS + 15)
    if done.returncode == ABSENT:
        pytest.skip(done.stdout.strip())
    print(done.stdout, done.stderr)


@pytest.fixture(scope="module", autouse=True)
def can_utils() -> None:
    if not shutil.which("candump"):
        pytest.skip("can-utils are not installed (tools/setup.sh installs them where it can)")


@pytest.fixture(scope="module")
def machine(tmp_path_factory):
    """Run all cases of run.sh; returns a function from the name of a case to its files."""
    folder = tmp_path_factory.mktemp("socketcan")
    words = [SCRIPTS / "run.sh", built("host_sim", "dahl-loop"), EXAMPLE, folder]
    is_here = bus.has_socketcan() and bus.vcan_is_up()
    run_cases(words if is_here else [ROOT / "tools/vm.sh", folder, *words])
    return lambda name: Case(folder / name)


@pytest.fixture(scope="module")
def controllers(tmp_path_factory, library):
    """Do the same with controllers.sh. A helper makes a controller go bus-off meanwhile."""
    if not shutil.which("gdb"):
        pytest.skip("gdb is not installed (tools/setup.sh vm installs it where it can)")
    folder = tmp_path_factory.mktemp("controllers")
    (folder / "test_rig.py").write_text(SAME)
    words = [SCRIPTS / "controllers.sh", built("host_sim", "dahl-loop"), EXAMPLE, sys.executable]
    with subprocess.Popen([str(SCRIPTS / "bus_off.sh"), str(folder)]) as helper:
        try:
            machine = [ROOT / "tools/vm.sh", folder, "env", f"DAHL_LIBRARY={library}"]
            run_cases([*machine, *words, folder])
        finally:
            helper.terminate()
    return lambda name: Case(folder / name)


def test_virtual_time_is_the_same_byte_for_byte(machine, tmp_path):
    """The same seed on vcan0 and in this process. candump sees these frames, at other times."""
    here = run(tmp_path, SCENE, "--virtual", "--seconds", "2")
    case = machine("virtual")
    assert case.code("both") == 0, case.errors("both")
    assert (case.folder / "run.log").read_bytes() == here.log.read_bytes()
    assert len(case.frames("run")) == 4020
    seen, logged = ([words for _, words in case.frames(name)] for name in ("candump", "run"))
    assert seen == logged


def test_two_processes_behind_kernel_filters(machine):
    """The kernel keeps answers and Status away from the node."""
    case = machine("two")
    node, encoder = case.summary("node"), case.summary("encoder")
    assert (case.code("node"), case.code("encoder")) == (0, 0)
    assert (encoder["frames_sent"], encoder["frames_lost"]) == (2000, 0)
    assert (node["node"]["ok"], node["node"]["ignored"]) == (2000, 0)
    assert {words[:3] for _, words in case.frames("candump")} == {"100", "110", "120"}
    same = read_log(case.folder / "candump.log")
    alone = read_log(machine("virtual").folder / "run.log")
    assert counts_of(same) == counts_of(alone)
    assert torques_of(same) == torques_of(alone)
    replayed = machine("replay")  # by canplayer
    assert replayed.summary("node")["node"]["ok"] == 2000
    assert torques_of(read_log(replayed.folder / "candump.log")) == torques_of(alone)


def test_cansend_disturbs_nothing_and_is_counted(machine):
    """A wrong CRC; a short, an extended and a remote frame; two of CAN FD. 7FF is filtered out."""
    case = machine("disturb")
    assert case.counted() == {"crc": 1, "format": 5, "bus_off": 1}
    assert case.summary("node")["bus_counts"]["error_frames"] == 1


def test_noise_on_the_encoders_own_id_loses_no_answer(machine):
    case = machine("noise")
    assert case.code("both") == 0, case.errors("both")
    assert len(case.frames("run")) > 6400
    assert sorted(case.frames("run")) == sorted(case.frames("candump"))
    summary = case.summary("both")
    assert (summary["frames_sent"], summary["frames_lost"]) == (3000, 0)
    assert case.counted("both") == {"ok": 3000, "crc": 150, "format": 150, "ignored": 100}


def test_after_bus_off_the_third_good_frame_restores_the_torque(machine):
    """After the error frame of the kernel there is no answer until the timeout has passed."""
    case = machine("off")
    assert case.code("both") == 0, case.errors("both")
    summary = case.summary("both")
    node = summary["node"]
    assert (node["bus_off"], node["stale"], summary["bus_counts"]["error_frames"]) == (1, 0, 2)
    assert node["rearm"] > 2  # two would be enough if the node did not wait for the timeout
    assert node["ok"] + node["rearm"] == summary["frames_sent"]
    log = read_log(case.folder / "run.log")
    at = [frame.id for frame in log].index(BUS_OFF)
    after = log[at + 1 :]
    if after[0].id == TORQUE:  # was on its way
        assert after[0].data[1] >> 4 == 0
        after = after[1:]
    back = next(frame for frame in after if frame.id == TORQUE)
    unanswered = sum(frame.id == 0x100 for frame in after[: after.index(back)])
    assert node["rearm"] <= unanswered - 1 <= node["rearm"] + 1
    assert back.data[1] >> 4 == 5  # STALE: a new start
    assert log[at - 1].id != BUS_OFF
    assert 0x20000004 in {frame.id for frame in log[:at]}


def test_the_fourth_bus_off_in_a_row_is_latched(machine):
    case = machine("off")
    assert case.code("latched") == 0, case.errors("latched")
    summary = case.summary("latched")
    assert summary["node"]["bus_off"] == 4
    assert summary["node"]["ok"] + summary["node"]["rearm"] == summary["frames_sent"]
    log = read_log(case.folder / "latched.log")
    last = max(i for i, frame in enumerate(log) if frame.id == BUS_OFF)
    after = [frame.id for frame in log[last:]]
    assert after.count(0x100) > 1500  # longer than the timeout
    assert TORQUE not in after
    assert 0x120 in after


def test_a_full_queue_does_not_stop_the_ticks(machine):
    """ENOBUFS: the frame is retried, then dropped and counted."""
    case = machine("full")
    if not (case.folder / "both.json").exists():
        pytest.skip(f"no queue to fill: {(case.folder / 'tc.err').read_text().strip()}")
    summary = case.summary("both")
    assert case.code("both") == 0, case.errors("both")
    assert summary["ticks"] == 1000
    assert summary["bus_counts"]["dropped"] > 500
    assert summary["bus_counts"]["retries"] > summary["bus_counts"]["dropped"]


def test_an_interface_that_goes_down_is_reported_once(machine):
    case = machine("down")
    assert case.code("both") == 1
    assert case.errors("both").startswith("error: --bus socketcan:vcan0: the bus is gone after ")
    assert case.errors("both").count("\n") == 1
    log = read_log(case.folder / "run.log")
    summary = case.summary("both")
    assert len(counts_of(log)) <= summary["frames_sent"] <= summary["ticks"]
    assert summary["ticks"] > 100
    assert case.code("absent") == 1
    assert case.errors("absent").count("\n") == 1


# --- controllers ----------------------------------------------------------------------------------


def test_controllers_carry_each_frame_of_a_loop(controllers, tmp_path):
    """candump on the encoder's side has the counts and torques of a run in one process."""
    case, alone = controllers("lockstep"), run(tmp_path, SCENE, "--virtual", "--seconds", "1")
    assert (case.code("encoder"), case.code("node"), case.counted()) == (0, 0, {"ok": 1000})
    encoder = case.summary("encoder")
    assert (encoder["frames_sent"], encoder["frames_lost"]) == (1000, 0)
    seen, same = read_log(case.folder / "candump.log"), read_log(alone.log)
    assert (counts_of(seen), torques_of(seen)) == (counts_of(same), torques_of(same))


def test_the_pytest_plugin_tests_a_node_behind_controllers(controllers):
    said = (controllers("plugin").folder / "pytest.out").read_text()
    assert " 4 passed" in said and "failed" not in said and "skipped" not in said, said


def test_a_bus_off_of_a_controller_is_counted_and_the_torque_comes_back(controllers):
    """By the driver, which restarts the controller after 200 ms, and by the node."""
    case = controllers("bus_off")
    (interface,) = json.loads((case.folder / "can0.json").read_text())
    assert interface["linkinfo"]["info_data"]["state"] == "ERROR-ACTIVE"
    counts = interface["linkinfo"]["info_xstats"]
    assert (counts["bus_off"], counts["restarts"]) == (1, 1)
    assert (case.code("node"), case.counted()["bus_off"]) == (0, 1)
    assert case.counted()["rearm"] >= 2
    log = [frame.id for frame in read_log(case.folder / "node.log")]
    assert TORQUE in log[: log.index(BUS_OFF)]
    assert TORQUE in log[log.index(RESTARTED, log.index(BUS_OFF)) :]
    assert {frame.id for frame in read_log(case.folder / "candump.log")} == {TORQUE}
