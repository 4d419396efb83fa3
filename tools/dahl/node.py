# SPDX-License-Identifier: MIT
"""The public name of dahl.can.node: both names are the same module."""

import sys

from dahl.can import node
from dahl.can.node import *  # noqa: F403  (for type checkers)

sys.modules[__name__] = node
