# SPDX-License-Identifier: MIT
"""The public name of dahl.can.bus: both names are the same module."""

import sys

from dahl.can import bus
from dahl.can.bus import *  # noqa: F403  (for type checkers)

sys.modules[__name__] = bus
