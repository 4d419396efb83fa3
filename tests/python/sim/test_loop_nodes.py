# SPDX-License-Identifier: MIT
"""Many nodes on one bus, in virtual and in real time."""

import pytest
from loop_tools import SCENES, read_log, run, setting

STEERING = SCENES / "steering.ini"
SLIP = ("friction.model=slip", "friction.sigma0=100 60", "friction.Fc=1 0.5")


@pytest.mark.parametrize("keys", [(), SLIP], ids=["dahl", "slip"])
def test_each_of_three_nodes_behaves_as_alone(tmp_path, keys):
    """Seeds are consecutive: motion, faults and bristles are separate."""
    common = ("--virtual", "--seconds", "4", *setting("faults.bus_off=0", *keys))
    storm = SCENES / "fault-storm.ini"
    three = run(tmp_path, storm, *common, "--nodes", "3", "--set", "friction.node=4")
    log = [frame for frame in read_log(three.log) if 0x100 <= frame.id < 0x160]
    sums = dict.fromkeys(three.summary["node"], 0)
    for i in range(3):
        alone = ("--seed", 1 + i, "--set", f"friction.node={4 + i}")
        one = run(tmp_path, storm, *common, *alone)
        own = [frame for frame in read_log(one.log) if 0x100 <= frame.id < 0x160]
        assert [frame for frame in log if frame.id & 15 == 4 + i] == own and len(own) > 7000
        sums = {name: sums[name] + count for name, count in one.summary["node"].items()}
    sums["ignored"] = three.summary["node"]["ignored"]  # each node counts the babble of its number
    assert sums == three.summary["node"]


@pytest.mark.parametrize("seconds", [2, pytest.param(600, marks=pytest.mark.long)])
@pytest.mark.timeout(700)
def test_four_nodes_at_one_kilohertz_lose_nothing(tmp_path, seconds):
    options = ("--bus", "socketcand:0", "--nodes", "4", *setting(f"motion.seconds={seconds}"))
    result = run(tmp_path, STEERING, *options, timeout=680)
    summary = result.summary
    assert result.code == 0, result.err
    assert summary["frames_sent"] == summary["frames_answered"] == 4000 * seconds
