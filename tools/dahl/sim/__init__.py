# SPDX-License-Identifier: MIT
"""Simulation: scenes, the program dahl-loop, exact references."""
