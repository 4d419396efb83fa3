# SPDX-License-Identifier: MIT
"""Write scene files. scene_reader.py reads them."""

from __future__ import annotations

from typing import Any, TypeAlias

Sections: TypeAlias = dict[str, dict[str, Any]]
STATUS: Sections = {"status": {"period_ms": 100}}  # of all scenes that this package writes


def text_of(sections: Sections, *comments: str) -> str:
    """Return a scene with these sections. A value that is None or "" is left out."""
    lines = [f"; {comment}" for comment in comments]
    for section, values in sections.items():
        lines.append(f"[{section}]")
        lines += [f"{key} = {value}" for key, value in values.items() if value not in (None, "")]
    return "\n".join(lines) + "\n"
