# SPDX-License-Identifier: MIT
"""The node and its clients on two emulated SJA1000 controllers (tools/vm.sh).

One boot runs all cases (tests/socketcan/controllers.sh). Each test reads the files of one case.
"""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree

import pytest
from conftest import ROOT, built
from loop_tools import SCENES, counts_of, read_log, torques_of
from test_fault_table import PLAYS

pytestmark = pytest.mark.checks

ABSENT = 77  # vm.sh's code for what cannot be had here
VM_SECONDS = 280
BUS_OFF, RESTARTED = 0x20000040, 0x20000100  # error frames, linux/can/error.h
TORQUE = 0x110


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory, library: Path) -> Iterator[Path]:
    """Run all cases; return the folder of their files."""
    for tool in ("candump", "gdb"):
        if not shutil.which(tool):
            pytest.skip(f"{tool} is not installed (tools/setup.sh vm installs it where it can)")
    folder = tmp_path_factory.mktemp("controllers")
    scripts, loop = ROOT / "tests/socketcan", built("host_sim", "dahl-loop")
    words = [ROOT / "tools/vm.sh", folder, "env", f"DAHL_LIBRARY={library}"]
    words += [scripts / "controllers.sh", loop, SCENES / "steering.ini", sys.executable, folder]
    done = run_with_gdb([scripts / "bus_off.sh", folder], words)
    if done.returncode == ABSENT:
        pytest.skip(done.stdout.strip())
    print(done.stdout, done.stderr)
    return folder


def run_with_gdb(gdb: list[object], words: list[object]) -> subprocess.CompletedProcess:
    helper = subprocess.Popen([str(word) for word in gdb])
    try:
        return subprocess.run(
            ["env", f"DAHL_VM_SECONDS={VM_SECONDS}", *(str(word) for word in words)],
            capture_output=True,
            text=True,
            timeout=VM_SECONDS + 15,
            check=False,
        )
    finally:
        helper.terminate()
        helper.wait()


def summary(folder: Path, role: str) -> dict:
    assert (folder / f"{role}.code").read_text() == "0\n", (folder / f"{role}.err").read_text()
    return json.loads((folder / f"{role}.json").read_text())


def counted(folder: Path) -> dict[str, int]:
    return {name: count for name, count in summary(folder, "node")["node"].items() if count}


def test_controllers_carry_each_frame_of_a_loop(folder, capsys):
    """candump on the encoder's side has the same counts and torques as on vcan."""
    logs = {}
    for bus in ("vcan", "can"):
        encoder = summary(folder / bus, "encoder")
        assert (encoder["frames_sent"], encoder["frames_lost"]) == (1000, 0)
        assert counted(folder / bus) == {"ok": 1000}
        logs[bus] = read_log(folder / bus / "candump.log")
        latency = encoder["latency_us"]
        with capsys.disabled():
            print(f"\n{bus}: latency median {latency['p50']:.0f} us, 99 % {latency['p99']:.0f} us")
    for values in (counts_of, torques_of):
        assert len(values(logs["can"])) == 1000
        assert values(logs["can"]) == values(logs["vcan"])


def test_frames_of_cansend_are_counted_at_the_other_controller(folder):
    assert counted(folder / "can_utils") == {"crc": 1, "format": 3}


def test_the_pytest_plugin_plays_the_fault_table(folder):
    root = ElementTree.parse(folder / "fault_table" / "junit.xml").getroot()
    bad = root.findall(".//failure") + root.findall(".//error") + root.findall(".//skipped")
    assert not bad, (folder / "fault_table" / "pytest.out").read_text()
    names = "".join(case.attrib["name"] for case in root.iter("testcase"))
    assert {name for name in PLAYS if f"[{name}]" in names} == PLAYS.keys() - {"FD", "REMOTE"}


def test_a_bus_off_is_counted_and_the_torque_comes_back(folder):
    """By the driver, which restarts the controller after 200 ms, and by the node."""
    case = folder / "bus_off"
    (interface,) = json.loads((case / "can0.json").read_text())
    assert interface["linkinfo"]["info_data"]["state"] == "ERROR-ACTIVE"
    counts = interface["linkinfo"]["info_xstats"]
    assert (counts["bus_off"], counts["restarts"]) == (1, 1)
    node = counted(case)
    assert node["bus_off"] == 1
    assert node["rearm"] >= 2
    log = [frame.id for frame in read_log(case / "node.log")]
    assert TORQUE in log[: log.index(BUS_OFF)]
    assert TORQUE in log[log.index(RESTARTED, log.index(BUS_OFF)) :]
    assert {frame.id for frame in read_log(case / "candump.log")} == {TORQUE}
