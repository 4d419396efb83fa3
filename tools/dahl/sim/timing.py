# SPDX-License-Identifier: MIT
"""The period of the loop, as host_sim/timing.h defines it."""

from __future__ import annotations

import functools
import re

from dahl import paths


@functools.cache
def period_us() -> int:
    """Return the time from one EncoderState to the next, in us."""
    found = re.search(r"#define PERIOD_US (\d+)u", (paths.SIM / "timing.h").read_text("utf-8"))
    assert found is not None
    return int(found[1])
