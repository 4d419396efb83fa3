# SPDX-License-Identifier: MIT
"""Fixtures for tests of what speaks to a friction node: a bus, and a node that answers on it.

    dahl_bus     a python-can bus; of this process unless --dahl-interface names another
    dahl_node    the dahl.Node that answers on it; on a bus that --dahl-interface names it is
                 the one that is there (None), restarted by a Reset before each test, unless
                 --dahl-serve starts it there too
    dahl_plan, dahl_node_settings
                 of that node; a test file that has a fixture of this name has its own

pytest loads this by itself where dahl is installed; it costs nothing until a fixture is used.
"""

from __future__ import annotations

import contextlib
import itertools
import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    import can

    from dahl.core import Plan
    from dahl.node import Node

VIRTUAL = "virtual"
_numbers = itertools.count()


def pytest_addoption(parser: pytest.Parser) -> None:
    """Which bus."""
    group = parser.getgroup("dahl", "a friction node on a CAN bus")
    group.addoption(
        "--dahl-interface",
        metavar="NAME",
        help="python-can interface of dahl_bus, such as socketcan (default: virtual)",
    )
    group.addoption("--dahl-channel", metavar="NAME", help="its channel, such as can0")
    group.addoption(
        "--dahl-bus-kwargs",
        default="",
        metavar="KEY=VALUE ...",
        help="more of python-can's arguments in one word, such as 'bitrate=500000 fd=True'",
    )
    group.addoption(
        "--dahl-serve",
        action="store_true",
        help="let dahl_node answer on that bus too, where no node is there (vcan0)",
    )


def pytest_configure(config: pytest.Config) -> None:
    """Refuse options that would be passed over, or that no test could use."""
    words = str(config.getoption("--dahl-bus-kwargs")).split()
    if bad := next((word for word in words if "=" not in word.strip("=")), None):
        raise pytest.UsageError(f"--dahl-bus-kwargs {bad}: KEY=VALUE was expected")
    if config.getoption("--dahl-interface") is None:
        for option in ("--dahl-channel", "--dahl-bus-kwargs", "--dahl-serve"):
            if config.getoption(option):
                raise pytest.UsageError(f"{option} goes with --dahl-interface, such as socketcan")


@contextlib.contextmanager
def _one_line() -> Iterator[None]:
    """A bus that is not there, or a node that is silent, ends a test in one line, without the
    insides of a fixture.
    """
    from dahl import RunError

    try:
        yield
    except RunError as error:
        raise pytest.fail.Exception(str(error), pytrace=False) from None


@pytest.fixture
def dahl_plan() -> Plan:
    """Parameters of dahl_node: 100 N m/rad, 0.5 N m, an encoder of 16384 counts a turn."""
    from dahl.core import Plan

    return Plan(sigma0=100.0, Fc=0.5, theta_per_count=2 * math.pi / 16384)


@pytest.fixture
def dahl_node_settings() -> dict[str, Any]:
    """What Node() takes beside dahl_plan: a timeout in s that a busy machine does not reach."""
    return {"timeout": 10.0}


@pytest.fixture
def dahl_bus_settings(request: pytest.FixtureRequest) -> dict[str, Any]:
    """What can.Bus() takes to open the bus; a channel of its own for each test if virtual."""
    from dahl import codec

    with _one_line():
        cast_from_string = codec.python_can().util.cast_from_string
    option = request.config.getoption
    interface, channel = option("--dahl-interface") or VIRTUAL, option("--dahl-channel")
    if channel is None and interface == VIRTUAL:
        channel = f"dahl-{next(_numbers)}"
    pairs = (word.partition("=") for word in option("--dahl-bus-kwargs").split())
    more = {key.replace("-", "_"): cast_from_string(value) for key, _, value in pairs}
    return {"interface": interface, "channel": channel, **more}


@pytest.fixture
def dahl_bus(dahl_bus_settings: dict[str, Any]) -> Iterator[can.BusABC]:
    """The test's end of the bus."""
    from dahl.bus import open_bus

    with _one_line():
        bus = open_bus(**dahl_bus_settings)
    with bus:
        yield bus


@pytest.fixture
def dahl_node(
    request: pytest.FixtureRequest,
    dahl_bus: can.BusABC,
    dahl_bus_settings: dict[str, Any],
    dahl_plan: Plan,
    dahl_node_settings: dict[str, Any],
) -> Iterator[Node | None]:
    """The node at the other end; None where it is not of this process."""
    from dahl import codec
    from dahl.node import Listener, Node, ask

    if dahl_bus_settings["interface"] != VIRTUAL and not request.config.getoption("--dahl-serve"):
        with _one_line():
            ask(dahl_bus, codec.Reset(codec.What.RESTART))
        yield None
        return
    import can

    from dahl.bus import open_bus

    with open_bus(**dahl_bus_settings) as bus:
        node = Node(dahl_plan, **dahl_node_settings)
        notifier = can.Notifier(bus, [Listener(bus, node)], timeout=0.05)
        try:
            yield node
        finally:
            notifier.stop()
