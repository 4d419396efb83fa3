# SPDX-License-Identifier: MIT
"""Frames are received while the program works on earlier ones (dahl.bus.read_ahead).

A server drops a slow reader. A bus inside this process does not, so the function is called.
"""

import contextlib
import itertools
import threading
import time

import pytest
from dahl import RunError
from dahl import bus as dahl_bus


def test_frames_are_received_while_the_caller_works():
    """An error of the bus reaches the caller after the frames."""
    received = threading.Event()

    def frames():
        yield from range(100)
        received.set()
        raise RunError("the bus has gone")

    ahead = dahl_bus.read_ahead(frames())
    assert next(ahead) == 0 and received.wait(10)
    assert [*itertools.islice(ahead, 99)] == [*range(1, 100)]
    with pytest.raises(RunError, match="the bus has gone"):
        next(ahead)
    assert list(dahl_bus.read_ahead(iter([None, None]))) == [None, None]


def test_closing_ends_the_thread():
    def frames():
        while True:
            time.sleep(0.001)
            yield None

    before = threading.active_count()
    with contextlib.closing(dahl_bus.read_ahead(frames())) as ahead:
        assert next(ahead) is None and threading.active_count() == before + 1
    assert threading.active_count() == before
