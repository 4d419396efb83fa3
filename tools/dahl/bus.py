# SPDX-License-Identifier: MIT
"""The public name of dahl.can.bus."""

from dahl.can.bus import *  # noqa: F403
