# SPDX-License-Identifier: MIT
"""Simulation: scenes, the program dahl-loop, emulated firmware, exact references."""
