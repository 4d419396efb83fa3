# SPDX-License-Identifier: MIT
"""The public name of dahl.can.codec: both names are the same module."""

import sys

from dahl.can import codec
from dahl.can.codec import *  # noqa: F403  (for type checkers)

sys.modules[__name__] = codec
