# SPDX-License-Identifier: MIT
"""What each kind of fault does to the frames, seen in the log beside the same run without it."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from pathlib import Path

import pytest
from loop_tools import SCENES, Logged, read_log, run, setting

STEERING = SCENES / "steering.ini"
SECONDS = "20"
TIMEOUT = 100  # ms, set below
SETS = ("friction.max_step=2000", f"friction.timeout_ms={TIMEOUT}")


@dataclass
class Seen:
    """The frames to the node as the encoder made them, and as they came."""

    clean: list[bytes]
    came: list[Logged]
    count: int  # faults that the summary tells of

    def angles(self) -> list[bytes]:
        return [frame.data for frame in self.came if frame.id == 0x100]


@pytest.fixture(scope="module")
def clean(tmp_path_factory) -> list[bytes]:
    folder = tmp_path_factory.mktemp("clean")
    log = read_log(run(folder, STEERING, "--virtual", "--seconds", SECONDS).log)
    return [frame.data for frame in log if frame.id == 0x100]


@pytest.fixture
def seen(tmp_path: Path, clean: list[bytes], request) -> Seen:
    kind, rate = request.param
    words = setting(*SETS, f"faults.{kind}={rate}")
    result = run(tmp_path, STEERING, "--virtual", "--seconds", SECONDS, *words)
    assert result.code == 0, result.err
    came = [frame for frame in read_log(result.log) if frame.id not in (0x110, 0x120)]
    return Seen(clean, came, result.summary["faults"]["injected"][kind])


def kind(name: str, rate: float = 0.05):
    return pytest.mark.parametrize("seen", [(name, rate)], indirect=True, ids=[name])


def about(seen: Seen, rate: float = 0.05) -> bool:
    """As many as the rate says."""
    due = rate * len(seen.clean)
    return abs(seen.count - due) < 6 * due**0.5 + 0.1 * due


@kind("drop")
def test_drop(seen):
    """The frame does not come; all others do, in order."""
    rest = iter(seen.clean)
    assert all(data in rest for data in seen.angles())
    assert len(seen.clean) - len(seen.angles()) == seen.count
    assert about(seen)


@kind("duplicate")
def test_duplicate(seen):
    """It comes twice, at once."""
    angles = seen.angles()
    twice = [i for i in range(1, len(angles)) if angles[i] == angles[i - 1]]
    assert len(twice) == seen.count
    assert [data for i, data in enumerate(angles) if i not in set(twice)] == seen.clean
    assert about(seen)


@pytest.fixture(scope="module")
def moving(tmp_path_factory) -> Path:
    """A shaft that never shows the same frame twice: a ramp."""
    path = tmp_path_factory.mktemp("moving") / "ramp.ini"
    text = (SCENES / "segments.ini").read_text()
    lines = [line for line in text.splitlines() if line[:5] != "theta" or line[5] == "_"]
    lines = ["speed = 100000" if line.startswith("speed") else line for line in lines]
    at = lines.index("kind = segments") + 1
    lines[at:at] = ["theta1 = 2000000", "theta2 = 0", "theta3 = 1"]
    path.write_text("\n".join(lines))
    return path


@pytest.mark.parametrize(("name", "steps"), [("reorder", {1}), ("delay", {2, 3, 4, 5, 6, 7})])
def test_late_frames(tmp_path, moving, name, steps):
    """reorder: after the next one; delay: after 2 to 7 of them, each of these. None is lost."""
    words = setting(*SETS, f"faults.{name}=0.01")
    alone = read_log(run(tmp_path / "a", moving, "--virtual", "--seconds", SECONDS).log)
    result = run(tmp_path / "b", moving, "--virtual", "--seconds", SECONDS, *words)
    spoiled = read_log(result.log)
    clean = [frame.data for frame in alone if frame.id == 0x100]
    place = {data: i for i, data in enumerate(clean)}
    assert len(place) == len(clean)
    order = [place[frame.data] for frame in spoiled if frame.id == 0x100]
    assert len(clean) - len(order) <= 7  # those that were on their way at the end
    late = [at for at in range(1, len(order)) if order[at] < max(order[max(0, at - 20) : at])]
    assert len(late) == pytest.approx(result.summary["faults"]["injected"][name], abs=8)
    lonely = [at for at in late if not any(0 < abs(at - other) < 20 for other in late)]
    assert len(lonely) > 50
    assert {max(order[at - 20 : at]) - order[at] for at in lonely} == steps


@kind("corrupt")
def test_corrupt(seen):
    """1, 2 or 3 bits are flipped, about as often each; the frame keeps its place and length."""
    flips = [
        bin(int.from_bytes(a, "big") ^ int.from_bytes(b, "big")).count("1")
        for a, b in zip(seen.angles(), seen.clean, strict=True)
    ]
    wrong = [n for n in flips if n]
    assert len(wrong) == seen.count
    assert set(wrong) == {1, 2, 3}
    assert min(map(wrong.count, (1, 2, 3))) > 0.2 * len(wrong)
    assert about(seen)


@kind("length")
def test_length(seen):
    """It is cut to 0 to 7 bytes, each of them."""
    pairs = list(zip(seen.angles(), seen.clean, strict=True))
    assert all(whole[: len(cut)] == cut for cut, whole in pairs)
    lengths = [len(cut) for cut, _ in pairs if len(cut) < 8]
    assert (len(lengths), set(lengths)) == (seen.count, set(range(8)))
    assert about(seen)


@kind("id")
def test_id(seen):
    """It has an id that is nobody's; the data are its own."""
    assert [frame.data for frame in seen.came] == seen.clean
    wrong = [frame.id for frame in seen.came if frame.id != 0x100]
    assert len(wrong) == seen.count
    assert set(wrong) <= set(range(0x700, 0x7FF))
    assert len(set(wrong)) > 50
    assert about(seen)


@kind("extended")
def test_extended(seen, tmp_path):
    """It has an id of 29 bits."""
    lines = (tmp_path / "run.log").read_text().splitlines()
    assert sum(" 00000100#" in line for line in lines) == seen.count
    assert [frame.data for frame in seen.came] == seen.clean
    assert about(seen)


def parts(data: bytes) -> tuple[int, int]:
    """(count, bits of the byte with the counter) of an EncoderState."""
    return struct.unpack_from("<i", data, 2)[0], data[1]


@kind("invalid")
def test_invalid(seen):
    """The encoder disowns its count: the count stays, one bit and the CRC do not."""
    pairs = list(zip(seen.angles(), seen.clean, strict=True))
    wrong = [(a, b) for a, b in pairs if a != b]
    assert len(wrong) == seen.count
    for a, b in wrong:
        assert parts(a)[0] == parts(b)[0]
        assert bin(int.from_bytes(a[1:], "big") ^ int.from_bytes(b[1:], "big")).count("1") == 1
    assert about(seen)


@kind("glitch")
def test_glitch(seen):
    """Its count is 2^28 counts and more away; the next frame is good."""
    wrong = [
        (i, parts(a)[0] - parts(b)[0])
        for i, (a, b) in enumerate(zip(seen.angles(), seen.clean, strict=True))
        if a != b
    ]
    assert len(wrong) == seen.count
    away = [(difference + 2**31) % 2**32 - 2**31 for _, difference in wrong]
    assert all(abs(counts) >= 2**28 for counts in away)
    assert max(away) > 2**30
    assert all(
        later - before > 1 for (before, _), (later, _) in zip(wrong, wrong[1:], strict=False)
    )


@kind("babble", 0.02)
def test_babble(seen):
    """8 frames of nobody, of high priority and random content, before a good one."""
    assert seen.angles() == seen.clean
    runs, length = [], 0
    for frame in seen.came:
        if 0x0F0 <= frame.id <= 0x0FF:
            length += 1
        elif length:
            runs.append(length)
            length = 0
    assert sum(runs) == 8 * seen.count
    assert all(length % 8 == 0 for length in runs)
    babbled = [frame for frame in seen.came if frame.id != 0x100]
    assert len({frame.id for frame in babbled}) == 16
    assert len({frame.data for frame in babbled}) > 0.99 * len(babbled)


@pytest.mark.parametrize(
    "seen", [("silence", 0.001), ("bus_off", 0.001)], indirect=True, ids=["silence", "bus_off"]
)
def test_silence(seen, request):
    """Nothing for longer than the timeout; bus_off is said soon after the last frame."""
    angles = seen.angles()
    rest = iter(enumerate(seen.clean))
    places = [next(i for i, whole in rest if whole == data) for data in angles]
    gaps = [b - a - 1 for a, b in zip(places, places[1:], strict=False) if b - a > 1]
    if places[-1] < len(seen.clean) - 1:
        gaps.append(TIMEOUT + 10)
    assert len(gaps) == seen.count >= 5
    assert all(gap >= TIMEOUT for gap in gaps[:-1])
    said = [i for i, frame in enumerate(seen.came) if frame.id == 0x20000040]
    assert len(said) in ((seen.count, seen.count - 1) if "bus_off" in request.node.name else (0,))
    assert all(seen.came[i].time - seen.came[i - 1].time < 0.006 for i in said)


@kind("restart", 0.005)
def test_restart(seen):
    """The node starts anew before a frame; nothing is lost."""
    assert seen.angles() == seen.clean
    assert sum(frame.id == 0x150 for frame in seen.came) == seen.count


@pytest.mark.parametrize("kinds", [("drop",), ("drop", "corrupt", "length", "id", "extended")])
def test_six_frames_in_a_row_go_missing_and_no_more(tmp_path, kinds):
    """Where every frame meets a fault of those that hide it, each seventh comes."""
    words = setting(*SETS, *(f"faults.{kind}={1 / len(kinds)}" for kind in kinds))
    result = run(tmp_path, STEERING, "--virtual", "--seconds", "2", *words)
    answers = [round(frame.time * 1000) for frame in read_log(result.log) if frame.id == 0x110]
    assert {later - before for before, later in zip(answers, answers[1:], strict=False)} == {7}
    assert result.summary["node"]["lost"] == 6 * (len(answers) - 1)


@pytest.mark.parametrize("kind", ["glitch", "reorder", "delay"])
def test_what_would_hide_another_fault_is_followed_by_a_good_frame(tmp_path, kind):
    words = setting(*SETS, f"faults.{kind}=1")
    result = run(tmp_path, STEERING, "--virtual", "--seconds", "2", *words)
    answers = [round(frame.time * 1000) for frame in read_log(result.log) if frame.id == 0x110]
    assert {later - before for before, later in zip(answers, answers[1:], strict=False)} == {2}
    assert result.summary["faults"]["injected"][kind] == 1000  # every other one
