# SPDX-License-Identifier: MIT
"""Declarations of the C library for cffi, from its preprocessed headers."""

from __future__ import annotations

import re

BODY = re.compile(r"\)\s*\{(?:[^{}]|\{[^{}]*\})*\}")  # of an inline function, one level of blocks


def for_cffi(preprocessed: str) -> str:
    """Turn inline functions into declarations: cffi parses no bodies."""
    return BODY.sub(");", re.sub(r"\b(?:static |extern )?inline\b", "", preprocessed))
