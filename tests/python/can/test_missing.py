# SPDX-License-Identifier: MIT
"""dahl.can.missing counts the frames that a recorder lost, and none that the bus lost.

Each recording is made tick by tick, so the number of lost frames is known.
"""

import random
from collections import Counter
from collections.abc import Callable, Iterable

import can
import pytest
from dahl import codec
from dahl.can.missing import Missing
from dahl.codec import EncoderState, FrictionTorque, State, Status
from hypothesis import given
from hypothesis import strategies as st

PERIOD_S = 0.001  # of the encoder
STATUS_TICKS = 7  # from one Status to the next
START = 5  # counter of the first angle
LOST_BY = {  # kinds of frames that the recorder loses in a tick of this fate
    "recorder": (EncoderState, FrictionTorque, Status),
    "angles": (EncoderState,),
    "answers": (FrictionTorque,),
}
Stretch = tuple[str, int]  # fate of ticks, and their number
Bounds = tuple[int, int]


def message(frame: codec.Frame, tick: float, node: int = 0, channel: str = "can0") -> can.Message:
    packed = codec.pack(frame, node)
    packed.timestamp, packed.channel = tick * PERIOD_S, channel
    return packed


def status(number: int, state: State = State.OK) -> Status:
    return Status(number % 16, state, codec.Errors(0), 0, 0, 0, 0, 2, 10)


def sent(fates: list[str], late: int, with_node: bool) -> list[tuple[float, codec.Frame]]:
    """Return time in ticks and frame: Status, angle, and the answer `late` ticks after its angle.

    An angle of fate "bus" reaches neither node nor recorder. A "silent" node does not answer.
    """
    frames: list[tuple[float, codec.Frame]] = []
    answers = 0
    for tick, fate in enumerate(fates):
        echo = (tick + START) % 16
        if fate != "bus":
            frames.append((tick + 0.2, EncoderState(tick, echo)))
        if with_node and tick % STATUS_TICKS == 0:
            frames.append((tick + 0.3, status(tick // STATUS_TICKS)))
        if with_node and fate not in ("bus", "silent"):
            answers += 1
            frames.append((tick + late + 0.5, FrictionTorque(0, answers % 16, State.OK, echo)))
    return frames


def record(
    stretches: list[Stretch], late: int = 0, with_node: bool = True, **of_node: int | str
) -> tuple[list[can.Message], Bounds]:
    """Return the recorded frames of one node, and the least and most number of lost frames."""
    fates = [fate for fate, ticks in stretches for _ in range(ticks)]
    place = [number for number, (_, ticks) in enumerate(stretches) for _ in range(ticks)]
    noise, held, lost = random.Random(1), [], Counter()
    for moment, frame in sent(fates, late, with_node):
        tick = min(int(moment), len(fates) - 1)
        if isinstance(frame, LOST_BY.get(fates[tick], ())):
            lost[place[tick], type(frame)] += 1
        else:
            held.append(message(frame, moment + noise.uniform(-0.1, 0.1), **of_node))
    return held, (sum(gap % 16 for gap in lost.values()), lost.total())


def counted(frames: Iterable[can.Message]) -> Bounds:
    missing = Missing()
    for frame in frames:
        missing.feed(frame)
    return tuple(missing.count())


def stretches(**ticks_of: tuple[int, int]) -> st.SearchStrategy[list[Stretch]]:
    """Draw ticks of these fates, each between normal ones. The first 30 give the period. A gap of
    16 n looks like a pause.
    """
    ticks = {k: st.integers(*ends).filter(lambda n: n % 16) for k, ends in ticks_of.items()}
    fates = [st.tuples(st.just(fate), number) for fate, number in ticks.items()]
    normal = st.tuples(st.just("normal"), st.integers(8, 20))
    some = st.lists(st.tuples(st.one_of(fates), normal), max_size=5)
    return some.map(lambda pairs: [("normal", 30), *(one for pair in pairs for one in pair)])


LATE = st.integers(0, 3)  # ticks from an angle to its answer
# If more than 7 angles are lost but not their answers, the counters do not show it.
LOST = stretches(recorder=(1, 60), answers=(1, 60), angles=(1, 7))
NODES = [(node, channel) for node in (0, 15) for channel in ("can0", "can1")]


@given(st.lists(st.tuples(LOST, LATE, st.booleans()), min_size=4, max_size=4))
def test_lost_frames_are_counted_for_each_node_of_each_bus(runs):
    """By their counters at least, by time at most. A bus may have no node that answers."""
    made = [record(*run, node=n, channel=c) for run, (n, c) in zip(runs, NODES, strict=True)]
    frames = sorted((frame for held, _ in made for frame in held), key=lambda one: one.timestamp)
    assert counted(frames) == tuple(map(sum, zip(*(bounds for _, bounds in made), strict=True)))


@given(stretches(recorder=(1, 7), bus=(1, 7), silent=(1, 12)), LATE)
def test_frames_that_the_bus_lost_are_not_missing(lost, late):
    held, bounds = record(lost, late)
    assert counted(sorted(held, key=lambda one: one.timestamp)) == bounds


@pytest.mark.parametrize("late", range(4))
def test_losses_of_bus_and_recorder_in_one_gap_are_told_apart(late):
    draw = random.Random(late)
    fates = ["normal"] * 30 + draw.choices(["normal", "bus"], [9, 1], k=3000)
    frames = sorted(sent(fates, late, with_node=True), key=lambda one: one[0])
    held = [message(frame, time) for time, frame in frames if time < 35 or draw.random() > 0.05]
    lost = len(frames) - len(held)
    least, most = counted(held)
    assert 0.98 * lost <= least <= most <= lost


def angles(
    counters: Iterable[int], ticks: Callable[[int], float] = float, **changes: object
) -> list[can.Message]:
    numbered = enumerate(counters)
    made = [message(EncoderState(n, counter % 16), ticks(n)) for n, counter in numbered]
    for frame, (name, value) in ((frame, change) for frame in made for change in changes.items()):
        setattr(frame, name, value)
    return made


def spoiled_answers(spoiled: range, lost: range) -> list[can.Message]:
    frames = [message(FrictionTorque(0, n % 16), n) for n in range(100)]
    for number in spoiled:
        frames[number].data[0] ^= 1
    return [frame for n, frame in enumerate(frames) if n not in lost]


def restarted(kind: type[codec.Frame]) -> list[can.Message]:
    """Node and encoder restart after a counter of 12: it begins at 0, the first state is Init."""
    frames = []
    for tick in range(100):
        counter = (tick - 56 if tick >= 56 else tick + START) % 16
        state = State.INIT if tick == 56 else State.OK
        answer = FrictionTorque(0, counter, state, counter)
        frames.append(message(EncoderState(tick, counter), tick))
        frames.append(message(answer if kind is FrictionTorque else status(counter, state), tick))
    return frames


def silenced(ticks: int) -> list[can.Message]:
    held, _ = record([("normal", 30), ("recorder", 5), ("silent", ticks)])
    return [frame for frame in held if frame.arbitration_id != Status.base]


SILENT_SINCE_A_LOSS = [("angles", 3), ("silent", 3), ("bus", 2), ("silent", 1), ("normal", 5)]
AFTER_48 = [("normal", 30), ("recorder", 48), ("normal", 8), ("recorder", 14), ("normal", 9)]
FOREIGN = ("is_extended_id", "is_remote_frame", "is_error_frame", "is_fd")
CASES = {
    "a pause": (angles(range(100), lambda n: n + 6000 * (n > 50)), (0, 0)),
    "a gap after a hidden one": (record(AFTER_48, with_node=False)[0], (14, 14)),
    "a stuck counter": (angles(min(n, 50) for n in range(100)), (0, 0)),
    "a repeated frame": (angles(n - (n > 50) for n in range(100)), (0, 0)),
    "the same, slow": (angles((n - (n > 50) for n in range(100)), lambda n: 100 * n), (0, 0)),
    "a late frame": (angles([0, 1, 2, 4, 3, 5, 6, 7]), (1, 1)),
    "a sender that does not count": (angles([5] * 40, lambda n: n + 20 * (n > 20)), (0, 0)),
    "no time stamps": (angles(range(100), lambda _: 0), (0, 0)),
    "no period yet": (angles([0, 8, 9, 10, 11]), (7, 7)),
    "no period yet, late": (angles([0, 9, 1, 2, 3]), (0, 0)),
    "no period yet, after 5 ms": (angles([0, 9, 10, 11, 12], lambda n: 5 * n), (8, 8)),
    "a short run": (angles([0, 1, 2, 3, 23], lambda n: n + 19 * (n > 3)), (3, 19)),
    "too short to be of a node": (angles([0, 1, 2, 10, 11, 12]), (0, 0)),
    "it is of a node at last": (angles([0, 1, 2, 10, 11, 12, 13]), (7, 7)),
    "two frames in turn": (angles([0, 1] * 50, lambda n: 10 * n), (0, 0)),
    **{name: (angles([0, 1, 2, 3, 8], **{name: True}), (0, 0)) for name in FOREIGN},
    "an id below": (angles([0, 1, 2, 3, 8], arbitration_id=0xFF), (0, 0)),
    "an id above": (angles([0, 1, 2, 3, 8], arbitration_id=0x130), (0, 0)),
    "a wrong CRC": (spoiled_answers(range(40, 41), range(0)), (0, 0)),
    "a wrong CRC and a gap": (spoiled_answers(range(40, 41), range(50, 53)), (3, 3)),
    "16 wrong CRC in a row": (spoiled_answers(range(40, 56), range(56, 59)), (0, 3)),
    "an id of another sender": (spoiled_answers(range(40, 57), range(57, 60)), (0, 0)),
    "a gap, then 16 angles without an answer": (silenced(16), (0, 0)),
    "a gap, then 17 angles without an answer": (silenced(17), (5, 5)),
    "a gap of the bus of a silent node": (
        record([("normal", 30), *SILENT_SINCE_A_LOSS])[0],
        (3, 3),
    ),
    "a restart, by an answer": (restarted(FrictionTorque), (0, 0)),
    "a restart, by a Status": (restarted(Status), (0, 0)),
}


@pytest.mark.parametrize(("frames", "bounds"), CASES.values(), ids=CASES)
def test_only_a_counter_that_skips_is_a_gap(frames, bounds):
    assert counted(frames) == bounds


def test_random_bytes_of_another_bus_are_no_gaps():
    """On all ids of nodes; one of 256 such frames has a right CRC. Beside them a node loses 3."""
    draw, foreign = random.Random(1), []
    for n in range(180_000):
        number, data = draw.randrange(0x100, 0x130), draw.randbytes(8)
        foreign.append(can.Message(n / 3000, number, is_extended_id=False, data=data))
    assert sum(codec.is_whole(one.arbitration_id, one.data) for one in foreign) > 500
    assert counted(foreign) == (0, 0)
    held, _ = record([("normal", 30), ("recorder", 3), ("normal", 30)], channel="can1")
    both = sorted([*foreign, *held], key=lambda one: one.timestamp)
    assert counted(both) == counted(held) == (6, 6)
