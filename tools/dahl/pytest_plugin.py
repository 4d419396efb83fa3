# SPDX-License-Identifier: MIT
"""The public name of dahl.can.pytest_plugin."""

from dahl.can.pytest_plugin import *  # noqa: F403
