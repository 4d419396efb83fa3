# SPDX-License-Identifier: MIT
"""What a check of a log says."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass(frozen=True)
class Finding:
    """Something about a log that the fit does not know of."""

    text: str
    doubts: tuple[str, ...] = ()  # parameters that cannot be claimed beside it
    reach: dict[str, tuple[float, float]] = field(default_factory=dict)  # that they may have too
