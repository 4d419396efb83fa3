# SPDX-License-Identifier: MIT
"""examples/ros2 against a mock of rclpy: the node is not run in ROS 2."""

import math
import runpy
import sys
from itertools import pairwise
from types import SimpleNamespace

import dahl
import pytest

GIVEN = {"joints": ["hip", "knee"], "hip.sigma0": 120.0, "hip.Fc": 1.8}
GIVEN |= {"knee.model": "slip", "knee.sigma0": 80.0, "knee.Fc": 1.2}


def message(name=(), position=()) -> SimpleNamespace:
    return SimpleNamespace(header=0, name=list(name), position=position, effort=[])


def start(root, monkeypatch, parameters: dict) -> tuple[object, list]:
    sent, node = [], type("Node", (), {"__init__": lambda *_: None})
    node.declare_parameter = lambda _, *pair: SimpleNamespace(value=parameters.get(*pair))
    node.create_publisher = lambda *_: SimpleNamespace(publish=sent.append)
    node.create_subscription = lambda _, kind, topic, call, queue: setattr(node, "receive", call)
    for name in ("rclpy", "rclpy.node", "sensor_msgs.msg"):
        monkeypatch.setitem(sys.modules, name, SimpleNamespace(Node=node, JointState=message))
    return runpy.run_path(str(root / "examples/ros2/friction_node.py"))["FrictionNode"](), sent


def test_each_joint_gets_the_friction_of_its_model(root, library, monkeypatch) -> None:
    node, sent = start(root, monkeypatch, GIVEN)
    hip = knee = 0.0
    for before, angle in pairwise((1.0, 1.0, 1.01, 1.05, 1.02, 1e9)):
        node.receive(message(["knee", "wheel", "hip"], [angle, 5.0, -angle]))
        goal = math.copysign(1.8, before - angle)
        hip = goal + (hip - goal) * math.exp(-120 / 1.8 * abs(angle - before))
        knee = max(-1.2, min(knee + 80 * (angle - before), 1.2))
        efforts = dict(zip(sent[-1].name, sent[-1].effort, strict=True))
        assert efforts == pytest.approx({"knee": knee, "hip": hip}, abs=1e-6)
    for unusable in ([], [math.nan]):
        node.receive(message(["hip"], unusable))
        assert sent[-1].name == sent[-1].effort == []


WRONG = {"hip.sigma0": None, "hip.Fc": None, "knee.model": "x"}  # None: it is not given


@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_or_missing_parameter_names_its_joint(root, library, monkeypatch, name) -> None:
    changed = GIVEN | {name: WRONG[name]}
    given = {key: value for key, value in changed.items() if value is not None}
    with pytest.raises(dahl.Error, match=f"joint {name.replace('.', ': ')} = "):
        start(root, monkeypatch, given)
