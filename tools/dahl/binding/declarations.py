# SPDX-License-Identifier: MIT
"""Declarations of the C library for cffi, from its preprocessed headers."""

from __future__ import annotations

import re

CONSTANT = re.compile(r"#define DAHL_\w+ (?:0x[0-9a-fA-F]+|\d+)u?")  # a whole number
BODY = re.compile(r"\)\s*\{(?:[^{}]|\{[^{}]*\})*\}")  # of an inline function, one level of blocks


def for_cffi(preprocessed: str) -> str:
    """Turn inline functions into declarations: cffi parses no bodies. Of all #defines it reads
    whole numbers only.
    """
    lines = preprocessed.splitlines(keepends=True)
    preprocessed = "".join(x for x in lines if x[0] != "#" or CONSTANT.fullmatch(x.strip()))
    return BODY.sub(");", re.sub(r"\b(?:static |extern )?inline\b", "", preprocessed))
