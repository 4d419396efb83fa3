# SPDX-License-Identifier: MIT
"""Many calls at once on one bus: cancelled at random times, and from several threads."""

import asyncio
import contextlib
import random
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import can
import dahl
import pytest
from bus_frames import two_ends
from dahl import codec, node
from dahl.can.async_bus import AsyncBus
from dahl.codec import Param, ParamWrite, Write
from loop_tools import SCENES, client, serving

PLAN = dahl.Plan(100, 0.7, 3.8e-4)
LONGEST_ANSWER_S = 2e-3
CANCELLATIONS = 400


class Slow(node.Listener):
    """Nodes that need a random time for each answer."""

    chance = random.Random(1)

    def __call__(self, msg: can.Message) -> None:
        time.sleep(self.chance.uniform(0, LONGEST_ANSWER_S))
        super().__call__(msg)


@pytest.fixture(params=["virtual", "served"])
def bus(request: pytest.FixtureRequest, tmp_path: Path, dahl_loop: Path) -> Iterator[can.BusABC]:
    """A bus with nodes 0 and 3, which are slow on the virtual bus."""
    if request.param == "served":
        with (
            serving(tmp_path, SCENES / "steering.ini", "--role", "node", "--nodes", "4") as served,
            client(served[1]) as ours,
        ):
            yield ours
        return
    with two_ends() as (ours, theirs):
        nodes = [dahl.Node(PLAN, number, timeout=60) for number in (0, 3)]
        notifier = can.Notifier(theirs, [Slow(theirs, *nodes)], timeout=0.02)
        yield ours
        notifier.stop()


def write(number: int) -> ParamWrite:
    """A frame whose answer has its own counter and value."""
    return ParamWrite(Param.GAIN, number, Write.WRITE, number % codec.COUNTERS)


def is_answer(reply: codec.ParamReply, number: int) -> bool:
    return (reply.value, reply.counter) == (number, number % codec.COUNTERS)


async def cancel(call: asyncio.Task, way: int, seconds: float) -> None:
    """End a call after a time, or half of them soon, in one of the ways of asyncio."""
    seconds = min(seconds, 5e-4) if seconds < LONGEST_ANSWER_S / 2 else seconds
    with contextlib.suppress(TimeoutError, asyncio.CancelledError):
        if way == 0:
            await asyncio.wait_for(call, seconds)
        elif way == 1:
            async with asyncio.timeout(seconds):
                await call
        else:
            await asyncio.sleep(seconds)
            for _ in range(way - 1):  # a caller may cancel again while the first takes effect
                call.cancel()
                await asyncio.sleep(0)
            await call


def test_a_cancelled_call_takes_no_answer_of_a_later_call(bus):
    chance, calls = random.Random(2), AsyncBus(bus)

    async def work() -> None:
        cancelled, number = 0, 0
        while cancelled < CANCELLATIONS / 2:
            call = asyncio.create_task(calls.ask(write(2 * number), timeout=60))
            await cancel(call, number % 4, chance.uniform(0, LONGEST_ANSWER_S))
            cancelled += call.cancelled()
            assert call.cancelled() or is_answer(call.result(), 2 * number)
            later = await calls.ask(write(2 * number + 1), timeout=60)
            assert is_answer(later, 2 * number + 1)
            number += 1

    asyncio.run(work())


def test_calls_that_wait_for_their_turn_are_cancelled_too(bus):
    chance, calls = random.Random(3), AsyncBus(bus)

    async def work() -> None:
        for first in range(0, CANCELLATIONS, 8):
            asked = [
                asyncio.create_task(calls.ask(write(first + k), k % 2 * 3, 60)) for k in range(8)
            ]
            cancelled = chance.sample(range(8), 4)
            for k in cancelled:
                await asyncio.sleep(chance.uniform(0, LONGEST_ANSWER_S))
                asked[k].cancel()
            replies = await asyncio.gather(*asked, return_exceptions=True)
            for k, reply in enumerate(replies):
                is_cancelled = k in cancelled and isinstance(reply, asyncio.CancelledError)
                assert is_cancelled or is_answer(reply, first + k)

    asyncio.run(work())


def test_a_cancelled_recv_loses_no_frame():
    with two_ends() as (ours, theirs):
        chance, calls = random.Random(4), AsyncBus(ours)

        def send() -> None:
            for number in range(CANCELLATIONS):
                theirs.send(can.Message(arbitration_id=number, is_extended_id=False))
                time.sleep(chance.uniform(0, LONGEST_ANSWER_S))

        async def work() -> list[int]:
            found: list[int] = []
            sender = asyncio.create_task(asyncio.to_thread(send))
            while len(found) < CANCELLATIONS:
                call = asyncio.create_task(calls.recv(60))
                await cancel(call, len(found) % 4, chance.uniform(0, LONGEST_ANSWER_S))
                if not call.cancelled():
                    found.append(call.result().arbitration_id)
            await sender
            return found

        assert asyncio.run(asyncio.wait_for(work(), 300)) == [*range(CANCELLATIONS)]


def test_a_cancelled_call_ends_soon_and_leaves_no_thread_on_the_bus(bus):
    async def work() -> None:
        calls = AsyncBus(bus)
        for call in (calls.ask(write(1), 7, 60), calls.recv(60), calls.expect_silence(None, 7, 60)):
            with pytest.raises(TimeoutError):
                await asyncio.wait_for(call, 0.02)
        begin = time.monotonic()
        assert is_answer(await calls.ask(write(2), timeout=60), 2)
        assert time.monotonic() - begin < 30  # not after the 60 s of the calls that were cancelled

    asyncio.run(work())


def test_each_loop_may_call_and_busy_threads_of_the_caller_do_not_matter(bus):
    calls, free = AsyncBus(bus), threading.Event()

    async def work() -> None:
        asked = [calls.ask(write(number), timeout=60) for number in range(4)]
        assert all(map(is_answer, await asyncio.gather(*asked), range(4)))

    async def work_beside_threads() -> None:
        busy = [asyncio.create_task(asyncio.to_thread(free.wait, 60)) for _ in range(99)]
        await asyncio.sleep(0)
        await work()
        free.set()
        await asyncio.gather(*busy)

    for each in (work, work_beside_threads, work):
        asyncio.run(each())


@pytest.mark.parametrize(
    ("call", "kind", "words"),
    [
        (lambda calls: AsyncBus(5).recv(), TypeError, "bus = 5"),
        (lambda calls: calls.send(5), TypeError, "message = 5"),
        (lambda calls: calls.recv("1"), TypeError, "timeout = '1'"),
        (lambda calls: calls.recv(float("nan")), dahl.InputError, "timeout = nan"),
    ],
)
def test_a_wrong_argument_is_refused(bus, call, kind, words):
    async def work() -> None:
        with pytest.raises(kind, match=words):
            await asyncio.wait_for(call(AsyncBus(bus)), 60)

    asyncio.run(work())


def test_a_lost_bus_is_a_connection_error_of_each_call():
    class Gone:
        def send(self, message: can.Message) -> None:
            raise can.CanOperationError("cable out")

        def recv(self, timeout: float) -> None:
            raise can.CanOperationError("cable out")

    async def work() -> None:
        calls = AsyncBus(Gone())
        frame = codec.EncoderState(5)
        waiting = calls.ask(frame), calls.send(frame), calls.recv(), calls.expect_silence(frame)
        for call in waiting:
            with pytest.raises(dahl.BusError, match="cable out"):
                await call

    asyncio.run(work())


def test_two_loops_and_threads_that_ask_on_one_bus_take_turns(bus):
    """The second half asks through an AsyncBus of its own."""
    begin = threading.Barrier(4)

    def ask(which: int) -> None:
        calls = AsyncBus(bus)
        begin.wait(60)
        for number in range(which, CANCELLATIONS, 4):
            if which < 2:
                reply = node.ask(bus, write(number), which * 3, timeout=60)
            else:
                reply = asyncio.run(calls.ask(write(number), which % 2 * 3, 60))
            assert is_answer(reply, number)

    with ThreadPoolExecutor(4) as threads:
        list(threads.map(ask, range(4), timeout=300))
