# SPDX-License-Identifier: MIT
"""Run a property on some inputs by default and on many with --long."""

from collections.abc import Callable

import hypothesis
import pytest
from hypothesis import HealthCheck, Phase
from hypothesis.strategies import SearchStrategy

PHASES = (Phase.explicit, Phase.generate, Phase.shrink)
SLOW = (HealthCheck.too_slow, HealthCheck.filter_too_much)  # a busy machine is slow


def modes(short: int, long: int) -> pytest.MarkDecorator:
    """Return the parameter `examples`: its values by default and with --long."""
    many = pytest.param(long, id="long", marks=pytest.mark.long)
    return pytest.mark.parametrize("examples", [pytest.param(short, id="short"), many])


def holds(check: Callable[..., None], examples: int, *inputs: SearchStrategy) -> None:
    """Raise if `check` fails, on the smallest input that shows it."""
    settings = hypothesis.settings(
        max_examples=examples, phases=PHASES, report_multiple_bugs=False, suppress_health_check=SLOW
    )
    settings(hypothesis.given(*inputs)(check))()
