# SPDX-License-Identifier: MIT
"""Fixtures for tests of a friction node, simulated in this process or on a rig (--dahl-interface).

    dahl_bus        a python-can bus; the report of a failed test has its frames
    dahl_bus_settings
                    arguments of can.Bus() for it
    dahl_node       the node that answers on it: a dahl.Node, on a rig a dahl.can.rig.RigNode, which
                    reads the same properties over the bus
    dahl_make_node  dahl_make_node(number=3, friction=None, **settings) makes one more node
    dahl_async_bus  the bus for `async def` tests: await dahl_async_bus.ask(frame)
    dahl_plan, dahl_node_settings
                    arguments of that node; a test file may define fixtures of these names
    mark dahl       dahl(plan=..., timeout=...) gives both for one test

docs/python.md explains the options and a rig. Imports are in the fixtures, because pytest loads
this module whenever dahl is installed.
"""

from __future__ import annotations

import asyncio
import contextlib
import fcntl
import hashlib
import inspect
import itertools
import math
import os
import socket
import tempfile
from collections.abc import Callable, Generator, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NoReturn, TypeAlias, TypeVar, get_args
from urllib.parse import urlsplit

import pytest

from dahl.errors import Error, InputError, Timeout, hide

if TYPE_CHECKING:
    import can

    from dahl.can.async_bus import AsyncBus
    from dahl.can.frame_log import FrameLog
    from dahl.can.node import Model, Node
    from dahl.can.rig import RigNode

    AnyNode: TypeAlias = Node | RigNode
    Settings: TypeAlias = dict[str, Any]

T = TypeVar("T")
Scope: TypeAlias = Literal["function", "class", "module", "package", "session"]
__tracebackhide__ = hide
VIRTUAL = "virtual"
MAX_ANSWER_TIMEOUT_S = 60.0  # node.MAX_PARAM_S
FRAMES = "frames on dahl_bus"  # in the report and in JUnit XML
MARK = "dahl(plan=None, **settings): of dahl_node. Every test that uses dahl_bus has this mark."
_numbers = itertools.count()
_frames = pytest.StashKey["FrameLog"]()  # of a test
_open_log = pytest.StashKey["FrameLog"]()  # of a session: that of dahl_bus while it is open
_item = pytest.StashKey[pytest.Item]()  # of a session: the test that runs
_in_use = pytest.StashKey[set[int]]()  # numbers of the nodes of a test
# Of a session: the reason to skip the tests of a bus or node, "" if it has answered.
_contacts = pytest.StashKey[dict[str, str]]()


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the options that name the bus."""
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
        help="simulate dahl_node on that bus too, if it has no node (vcan0)",
    )
    group.addoption(
        "--dahl-require",
        action="store_true",
        help="fail, and do not skip, if the bus does not open or no node answers",
    )
    group.addoption(
        "--dahl-answer-timeout",
        type=float,
        metavar="S",
        help="seconds within which a rig must open and answer each frame (default: 1)",
    )
    parser.addini(
        "dahl_require",
        "with --dahl-interface, the same as --dahl-require",
        type="bool",
        default=False,
    )
    parser.addini("dahl_answer_timeout", "the same as --dahl-answer-timeout", default="1")
    parser.addini("dahl_bus_scope", "scope of dahl_bus and dahl_bus_settings", default="function")


def pytest_configure(config: pytest.Config) -> None:
    """Reject wrong options, and options without effect."""
    config.addinivalue_line("markers", MARK)
    config.stash[_contacts] = {}
    _answer_timeout(config)
    _scope("dahl_bus", config)
    words = str(config.getoption("--dahl-bus-kwargs")).split()
    if bad := next((word for word in words if "=" not in word.strip("=")), None):
        raise pytest.UsageError(f"--dahl-bus-kwargs {bad}: KEY=VALUE was expected")
    if config.getoption("--dahl-interface") is None:
        for option in ("--dahl-channel", "--dahl-bus-kwargs", "--dahl-serve", "--dahl-require"):
            if config.getoption(option):
                raise pytest.UsageError(f"{option} goes with --dahl-interface, such as socketcan")


def _answer_timeout(config: pytest.Config) -> float:
    """Return the seconds within which a rig must open and answer each frame."""
    option = config.getoption("--dahl-answer-timeout")
    text = config.getini("dahl_answer_timeout") if option is None else option
    try:
        seconds = float(text)
    except ValueError:
        seconds = math.nan
    if not 0 < seconds <= MAX_ANSWER_TIMEOUT_S:
        limit = f"0 < dahl_answer_timeout <= {MAX_ANSWER_TIMEOUT_S:g} (s)"
        raise pytest.UsageError(f"dahl_answer_timeout = {text}: {limit} was expected")
    return seconds


def _scope(fixture_name: str, config: pytest.Config) -> Scope:
    """Return the scope of dahl_bus and dahl_bus_settings."""
    scope: Scope = config.getini("dahl_bus_scope")
    if scope not in get_args(Scope):
        wanted = ", ".join(get_args(Scope))
        raise pytest.UsageError(f"dahl_bus_scope = {scope}: one of {wanted} was expected")
    return scope


def pytest_itemcollected(item: pytest.Item) -> None:
    """Mark the tests that use the bus."""
    if "dahl_bus" in getattr(item, "fixturenames", ()) and not item.get_closest_marker("dahl"):
        item.add_marker("dahl")


def pytest_pyfunc_call(pyfuncitem: pytest.Function) -> bool | None:
    """Run an `async def` test of dahl_async_bus, unless a plugin for asyncio does."""
    test, given = pyfuncitem.obj, pyfuncitem.funcargs
    if "dahl_async_bus" not in given or not inspect.iscoroutinefunction(test):
        return None
    names = inspect.signature(test).parameters
    asyncio.run(test(**{name: given[name] for name in names if name in given}))
    return True


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> None:
    """Begin the log of a test whose bus is open already."""
    item.config.stash[_item] = item
    frames = item.config.stash.get(_open_log, None)
    if frames is not None and "dahl_bus" in getattr(item, "fixturenames", ()):
        frames.start_again()
        item.stash[_frames] = frames


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_call(item: pytest.Item) -> None:
    """Mark the end of the set-up in the log."""
    if (frames := item.stash.get(_frames, None)) is not None:
        frames.end_set_up()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item, call: pytest.CallInfo[None]
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Add the frames to the report of a failed test, and to its properties in JUnit XML."""
    report = yield
    frames = item.stash.get(_frames, None)
    if report.failed and frames is not None:
        if call.when != "teardown":
            frames.read_rest()
        if text := frames.text():
            report.sections.append((FRAMES, text))
            others = [one for one in item.user_properties if one[0] != FRAMES]
            item.user_properties[:] = [*others, (FRAMES, text)]
            report.user_properties[:] = item.user_properties
    if call.when == "teardown" and frames is not None:
        del item.stash[_frames]  # with its bus
    return report


# --- parameters of the node -----------------------------------------------------------------------


@contextlib.contextmanager
def _one_line() -> Iterator[None]:
    """Fail a test with one line, without a traceback, after an error of the bus or the node."""
    try:
        yield
    except Error as error:
        raise pytest.fail.Exception(str(error), pytrace=False) from None


def _mark_arguments(request: pytest.FixtureRequest) -> Settings:
    mark = request.node.get_closest_marker("dahl")
    if mark is not None and mark.args:
        pytest.fail(f"mark dahl: {mark.args[0]!r} has no name, such as plan=", pytrace=False)
    return {} if mark is None else dict(mark.kwargs)


@pytest.fixture
def dahl_plan(request: pytest.FixtureRequest) -> Model:
    """Parameters of dahl_node: 100 N m/rad, 0.5 N m, 16384 counts a turn; on a rig its own."""
    from dahl.binding.friction import Plan

    arguments = _mark_arguments(request)
    if (plan := arguments.get("plan")) is not None:
        return plan  # type: ignore[no-any-return]
    if not _is_rig(request):
        return Plan(sigma0=100.0, Fc=0.5, theta_per_count=2 * math.pi / 16384)
    settings = request.getfixturevalue("dahl_node_settings") | arguments
    with _one_line():
        return _reset_node(request, settings.get("number", 0)).plan


@pytest.fixture
def dahl_node_settings() -> Settings:
    """Return the other arguments of Node(). The timeout in s is long, for a busy machine."""
    return {"timeout": 10.0}


# --- the bus --------------------------------------------------------------------------------------


@pytest.fixture(scope=_scope)
def dahl_bus_settings(request: pytest.FixtureRequest) -> Settings:
    """Arguments of can.Bus(); a separate channel for each dahl_bus if virtual."""
    from dahl.can import codec

    with _one_line():
        cast_from_string = codec.python_can().util.cast_from_string
    option = request.config.getoption
    interface, channel = option("--dahl-interface") or VIRTUAL, option("--dahl-channel")
    if channel is None and interface == VIRTUAL:
        channel = f"dahl-{next(_numbers)}"
    pairs = (word.partition("=") for word in option("--dahl-bus-kwargs").split())
    more = {key.replace("-", "_"): cast_from_string(value) for key, _, value in pairs}
    return {"interface": interface, "channel": channel, **more}


@pytest.fixture(scope=_scope)
def dahl_bus(request: pytest.FixtureRequest, dahl_bus_settings: Settings) -> Iterator[can.BusABC]:
    """Return the bus. If dahl_bus_scope is wider than a test, frames that wait are dropped before
    each test.
    """
    is_shared = dahl_bus_settings["interface"] != VIRTUAL
    with _reserve_bus(dahl_bus_settings) if is_shared else contextlib.nullcontext():
        with _one_line():
            bus = _open(request, dahl_bus_settings)
        with bus:
            request.config.stash[_open_log] = _log_of(request, bus)
            yield bus
            del request.config.stash[_open_log]


@pytest.fixture
def dahl_async_bus(dahl_bus: can.BusABC) -> AsyncBus:
    """dahl_bus for `async def` tests, with or without a plugin for asyncio."""
    from dahl.can.async_bus import AsyncBus

    return AsyncBus(dahl_bus)


def _log_of(request: pytest.FixtureRequest, bus: can.BusABC) -> FrameLog:
    """Return the log of the frames of a test, which may define dahl_bus itself."""
    from dahl.can import frame_log

    stash = request.config.stash[_item].stash
    frames = stash.get(_frames, None)
    if frames is None or frames.bus is not bus:
        stash[_frames] = frames = frame_log.attach(bus)
    return frames


def _is_rig(request: pytest.FixtureRequest) -> bool:
    interface = request.getfixturevalue("dahl_bus_settings")["interface"]
    return interface != VIRTUAL and not request.config.getoption("--dahl-serve")


def _address(settings: Settings) -> str:
    """Return the same text for the same device or server in each process, whatever its spelling and
    settings. python-can's own settings may name it.
    """
    from dahl.can import codec

    can = codec.python_can()
    with contextlib.suppress(can.CanError, NotImplementedError, ValueError, TypeError):
        settings = can.util.load_config(config=dict(settings))
    channel = str(settings.get("channel"))
    with contextlib.suppress(ValueError):  # of a bad address, which does not open
        if os.sep in channel and not (link := urlsplit(channel)).netloc:
            return os.path.realpath(channel.partition("@")[0])  # of a serial port, without speed
        if "://" in channel:
            return f"{link.scheme} {_host(link.hostname)} {link.port}"
    server = _host(settings.get("host")), settings.get("port")
    return " ".join(map(str, (settings.get("interface"), channel, *server)))


def _host(name: object) -> object:
    """Return the address of a host by its name."""
    try:
        return socket.gethostbyname(str(name)) if name else name
    except OSError:
        return name


@contextlib.contextmanager
def _reserve_bus(settings: Settings) -> Iterator[None]:
    """Wait until no other test of this user has the bus."""
    key = hashlib.sha256(_address(settings).encode()).hexdigest()[:16]
    path = Path(tempfile.gettempdir(), f"dahl-bus-{os.getuid()}-{key}.lock")
    with open(os.open(path, os.O_RDWR | os.O_CREAT, 0o600), "rb") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield


def _open(request: pytest.FixtureRequest, settings: Settings) -> can.BusABC:
    """Open the bus; skip the test if it is that of a rig, and has never been open."""
    from dahl.can.bus import open_bus
    from dahl.can.rig import open_rig

    if not _is_rig(request):
        return open_bus(**settings)
    timeout = _answer_timeout(request.config)
    return _contact(request.config, _key(settings), lambda: open_rig(settings, timeout))


def _key(settings: Settings) -> str:
    return repr(sorted(settings.items()))


def _contact(config: pytest.Config, key: str, call: Callable[[], T]) -> T:
    """Return the result of a call to a rig; skip the test if the rig has never answered. A rig that
    has answered before must answer.
    """
    from dahl.can.rig import NoRig

    contacts = config.stash[_contacts]
    if contacts.get(key):
        _skip(config, contacts[key])
    try:
        result = call()
    except (Timeout, NoRig) as error:
        if key in contacts:
            raise
        contacts[key] = f"no rig: {error}"
    else:
        contacts[key] = ""
        return result
    _skip(config, contacts[key])


def _skip(config: pytest.Config, reason: str) -> NoReturn:
    """Skip the test, or fail it if the rig is required."""
    if config.getoption("--dahl-require") or config.getini("dahl_require"):
        pytest.fail(reason, pytrace=False)
    pytest.skip(reason)


# --- nodes ----------------------------------------------------------------------------------------


@pytest.fixture
def dahl_make_node(
    request: pytest.FixtureRequest, dahl_bus: can.BusABC, dahl_node_settings: Settings
) -> Iterator[Callable[..., AnyNode]]:
    """Return make(number=1, friction=dahl_plan, **settings), with the other arguments of dahl.Node:
    it makes one more node on dahl_bus, or returns the one of this number on a rig.
    """
    with _one_line(), contextlib.ExitStack() as nodes:

        def make(number: int = 1, friction: Model | None = None, **settings: Any) -> AnyNode:
            if friction is None:
                friction = request.getfixturevalue("dahl_plan")
            settings = dahl_node_settings | settings | {"number": number}
            if _is_rig(request):
                return nodes.enter_context(_on_rig(request, friction, settings))
            return nodes.enter_context(_simulated(request, friction, settings))

        yield make


@pytest.fixture
def dahl_node(
    request: pytest.FixtureRequest,
    dahl_make_node: Callable[..., AnyNode],
    dahl_plan: Model,
    dahl_node_settings: Settings,
) -> AnyNode:
    """Return the node that answers on dahl_bus."""
    settings = {"number": 0, "plan": dahl_plan} | dahl_node_settings | _mark_arguments(request)
    with _one_line():
        return dahl_make_node(friction=settings.pop("plan"), **settings)


@contextlib.contextmanager
def _simulated(
    request: pytest.FixtureRequest, friction: Model, settings: Settings
) -> Iterator[Node]:
    """Yield a node in this process, on a separate bus object."""
    import can

    from dahl.can.bus import open_bus
    from dahl.can.node import Listener

    node = _new(request, friction, settings)
    with open_bus(**request.getfixturevalue("dahl_bus_settings")) as bus:
        notifier = can.Notifier(bus, [Listener(bus, node)], timeout=0.05)
        try:
            yield node
        finally:
            notifier.stop()


@contextlib.contextmanager
def _on_rig(
    request: pytest.FixtureRequest, friction: Model, settings: Settings
) -> Iterator[RigNode]:
    """Yield a node of the rig with these parameters; restore its own at the end."""
    wanted = _new(request, friction, settings)
    rig = _reset_node(request, wanted.number)
    try:
        rig.configure(wanted)
        rig.restart()
        yield rig
    finally:
        rig.restore()


def _new(request: pytest.FixtureRequest, friction: Model, settings: Settings) -> Node:
    """Return a node of these parameters. Raises dahl.Error for wrong ones."""
    from dahl.can.node import Node

    try:
        node = Node(friction, **settings)
    except TypeError as error:
        raise InputError(str(error)) from None
    in_use = request.node.stash.setdefault(_in_use, set())
    if node.number in in_use:
        raise InputError(f"number = {node.number}: this test has a node of this number already")
    in_use.add(node.number)
    return node


def _reset_node(request: pytest.FixtureRequest, number: int) -> RigNode:
    """Return a node of the rig after a Reset; skip the test if it has never answered."""
    from dahl.can.rig import RigNode

    bus, settings = map(request.getfixturevalue, ("dahl_bus", "dahl_bus_settings"))
    rig = RigNode(bus, _log_of(request, bus), number, _answer_timeout(request.config))
    _contact(request.config, f"{_key(settings)} {number}", rig.restart)
    return rig
