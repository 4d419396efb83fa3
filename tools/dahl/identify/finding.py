# SPDX-License-Identifier: MIT
"""What a check of a log says."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Finding:
    """Something about a log that the fit does not know of."""

    text: str
    doubts: tuple[str, ...] = ()  # parameters that cannot be claimed beside it
