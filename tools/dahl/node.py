# SPDX-License-Identifier: MIT
"""The public name of dahl.can.node."""

from dahl.can.node import *  # noqa: F403
