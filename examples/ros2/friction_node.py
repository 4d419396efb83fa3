# SPDX-License-Identifier: MIT
"""Publish the friction of each joint: subscribe to /joint_states, publish `effort` on /friction.

The effort has the sign of the motion. Add it to an effort command to cancel friction, subtract it
in a simulation. README.md in this folder has the parameters.
"""

import math
import sys

import dahl
import rclpy
from rclpy.node import Node
from sensor_msgs.msg import JointState

THETA_PER_COUNT = 1e-6  # rad; finer than an encoder of 22 bits
COUNTS_MAX = 2**31 - 1  # of a step; more of them saturate the friction anyway
BREAKAWAY = 0.5  # of elastoplastic: fraction of Fc below which a joint does not creep
QUEUE = 10  # messages

Model = dahl.Friction | dahl.Slip | dahl.ElastoPlastic


def make_model(name: str, sigma0: float, Fc: float) -> Model:  # noqa: N803
    """Return a model by name; sigma0 in N m/rad, Fc in N m. Raises dahl.Error."""
    if name == "dahl":
        return dahl.Friction(dahl.Plan(sigma0, Fc, THETA_PER_COUNT))
    if name == "slip":
        return dahl.Slip([sigma0], [Fc], THETA_PER_COUNT)
    if name == "elastoplastic":
        return dahl.ElastoPlastic(sigma0, Fc, THETA_PER_COUNT, BREAKAWAY)
    raise dahl.Error(f"model = {name} is none of dahl, slip, elastoplastic")


class Joint:
    """Friction of a joint. The first position is the starting point."""

    def __init__(self, model: Model) -> None:
        self._model = model
        self._count: int | None = None

    def move(self, position: float) -> float:
        """Return the torque in N m at a position in rad."""
        before, self._count = self._count, round(position / THETA_PER_COUNT)
        moved = 0 if before is None else self._count - before
        return self._model.step_counts(max(-COUNTS_MAX, min(moved, COUNTS_MAX)))


class FrictionNode(Node):  # type: ignore[misc]  # Node is Any without ROS 2
    """Friction of all joints that the parameter `joints` names."""

    def __init__(self) -> None:
        super().__init__("dahl_friction")
        names = self.declare_parameter("joints", ["joint"]).value
        self._joints = {name: Joint(self._read_model(name)) for name in names}
        self._publisher = self.create_publisher(JointState, "friction", QUEUE)
        self.create_subscription(JointState, "joint_states", self.publish_friction, QUEUE)

    def _read_model(self, joint: str) -> Model:
        defaults = {"model": "dahl", "sigma0": 0.0, "Fc": 0.0}  # 0 is refused: give both
        pairs = [(f"{joint}.{key}", value) for key, value in defaults.items()]
        values = [self.declare_parameter(*pair).value for pair in pairs]
        try:
            return make_model(*values)
        except dahl.Error as error:
            raise dahl.Error(f"joint {joint}: {error}") from None

    def publish_friction(self, state: JointState) -> None:
        """Publish the effort of the joints in this message that have a finite position."""
        friction = JointState()
        friction.header = state.header
        for name, position in zip(state.name, state.position):  # noqa: B905 (positions are optional)
            if name in self._joints and math.isfinite(position):
                friction.name.append(name)
                friction.effort.append(self._joints[name].move(position))
        self._publisher.publish(friction)


def main() -> None:
    rclpy.init()
    try:
        node = FrictionNode()
    except dahl.Error as error:
        sys.exit(f"error: {error}")
    rclpy.spin(node)


if __name__ == "__main__":
    main()
