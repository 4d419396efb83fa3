# SPDX-License-Identifier: MIT
"""Friction in MuJoCo: importing this module registers the plugin `dahl.friction`.

An instance in the model gives one joint or tendon its friction; docs/simulators.md has all keys:

    <extension>
      <plugin plugin="dahl.friction">
        <instance name="hip friction">
          <config key="joint" value="hip"/>
          <config key="sigma0" value="120"/>
          <config key="Fc" value="1.8"/>
        </instance>
      </plugin>
    </extension>

`python -m dahl.mujoco` compares it with the frictions of MuJoCo.
"""

from __future__ import annotations

import sys

from dahl.errors import Error
from dahl.simulators import mujoco_plugin


def main() -> int:
    """Print the comparison and return the exit code."""
    from dahl.cli import Parser

    about = "Compare dahl.friction with the frictions of MuJoCo, in a minute."
    Parser(prog="python -m dahl.mujoco", description=about).parse_args()
    try:
        mujoco_plugin.load()
        from dahl.simulators import mujoco_hinge, mujoco_ways

        mujoco_hinge.print_comparison()
        mujoco_ways.print_table()
    except Error as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
mujoco_plugin.load()
