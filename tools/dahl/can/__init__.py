# SPDX-License-Identifier: MIT
"""CAN: frames, nodes, buses, monitoring, the pytest plugin."""
