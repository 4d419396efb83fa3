# SPDX-License-Identifier: MIT
"""Friction in other simulators: functional mock-up units, the plugin of MuJoCo."""
