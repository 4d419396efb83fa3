# SPDX-License-Identifier: MIT
"""Firmware of the node on emulated cores."""
