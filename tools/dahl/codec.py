# SPDX-License-Identifier: MIT
"""The public name of dahl.can.codec."""

from dahl.can.codec import *  # noqa: F403
