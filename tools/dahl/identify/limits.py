# SPDX-License-Identifier: MIT
"""Limits that several modules of identification share."""

HEAD_ROWS = 100_000  # first rows of a log: enough to see its grid, readings and strokes
