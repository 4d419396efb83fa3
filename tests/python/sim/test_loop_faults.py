# SPDX-License-Identifier: MIT
"""Injected faults: the log of a run against the log of the same seed without faults. Each fault has
its form, is counted, and changes no torque (host_sim/faults.h).
"""

from collections import Counter, defaultdict
from pathlib import Path

import numpy as np
import pytest
from dahl.sim import keys as table
from loop_model import BUS_OFF, ENCODER, RESET, is_good
from loop_tools import Logged, Run, check_node, read_log, run, scene_with, word

KINDS = table.names("faults")
LATE = ("reorder", "delay")
OFF_TICKS = 110  # of silence and bus_off, at a timeout of 100 ms


def storm(folder: Path, *options: object, keys: tuple[str, ...] = (), **rates: float) -> Run:
    """The shipped scene; with these faults alone if there are any."""
    rates = dict.fromkeys(KINDS, 0) | rates if rates else {}
    folder.mkdir(exist_ok=True)
    sets = (*(f"faults.{kind}={rate}" for kind, rate in rates.items()), *keys)
    scene = scene_with(folder, "fault-storm", *sets)
    result = run(folder, scene, "--virtual", *options)
    assert (result.code, result.err) == (0, "")
    summary, answers = result.summary, [f for f in read_log(result.log) if f.id & ~15 == 0x110]
    assert summary["node"] == summary["node"] | summary["faults"]["expected"]
    assert (summary["frames_answered"], summary["answers_unmatched"]) == (len(answers), 0)
    return result


MORE_THAN_ONCE = {("babble", "ignored"): 8, ("silence", "rearm"): 2, ("bus_off", "rearm"): 2}


def due_counts(injected: dict[str, int]) -> Counter:
    """Counters of the node by the table of faults in keys.csv."""
    due = Counter()
    for kind in KINDS:
        for name in table.KEYS["faults", kind].of.split():
            due[name] += MORE_THAN_ONCE.get((kind, name), 1) * injected[kind]
    return due


# --- one kind of fault ----------------------------------------------------------------------------


def flips(frame: Logged, clean: bytes) -> int:
    difference = int.from_bytes(frame.data, "big") ^ int.from_bytes(clean, "big")
    return difference.bit_count()


def away(frame: Logged, clean: bytes) -> int:
    return (word(frame.data, 2) - word(clean, 2) + 2**31) % 2**32 - 2**31


def is_plain(frame: Logged, clean: bytes) -> bool:
    return (frame.id, frame.data, frame.is_extended) == (ENCODER, clean, False)


def is_alone(came: list[Logged], clean: bytes) -> bool:
    return len(came) == 1 and is_plain(came[0], clean)


FORMS = {  # the frames of a tick with this fault and the data of its angle: their form
    "drop": lambda came, clean: not came,
    "duplicate": lambda came, clean: all(is_plain(one, clean) for one in came) and len(came) == 2,
    "corrupt": lambda came, clean: not is_good(came[0], 3) and flips(came[0], clean) in (1, 2, 3),
    "length": lambda came, clean: len(came[0].data) < 8 and clean.startswith(came[0].data),
    "id": lambda came, clean: 0x700 <= came[0].id < 0x7FF and came[0].data == clean,
    "extended": lambda came, clean: came[0].is_extended and came[0].data == clean,
    "invalid": lambda came, clean: is_good(came[0], 3) and came[0].data[1] ^ clean[1] == 16,
    "glitch": lambda came, clean: is_good(came[0], 3) and 2**28 <= away(came[0], clean) < 2**31,
    "babble": lambda came, clean: (
        all(0x0F0 <= one.id <= 0x0FF for one in came[:8])
        and all(map(any, zip(*(one.data for one in came[:8]), strict=True)))  # no byte stays 0
        and is_plain(came[8], clean)
    ),
    "restart": lambda came, clean: came[0].id == RESET and is_plain(came[1], clean),
    "silence": lambda came, clean: not came,
    "bus_off": lambda came, clean: [one.id for one in came] in ([], [BUS_OFF]),
}
SIZES = {  # what must occur: a size of the frames of a tick, and its values
    "corrupt": (lambda came, clean: flips(came[0], clean), {1, 2, 3}),
    "length": (lambda came, clean: len(came[0].data), set(range(8))),
    "glitch": (lambda came, clean: away(came[0], clean) >> 28, set(range(1, 7))),
    "babble": (lambda came, clean: came[0].id & 15, set(range(16))),
    "id": (lambda came, clean: came[0].id >> 4, set(range(0x70, 0x80))),
}


def by_tick(log: list[Logged]) -> dict[int, list[Logged]]:
    ticks = defaultdict(list)
    for frame in log:
        if frame.id & ~15 not in (0x110, 0x120):
            ticks[round(frame.time * 1000)].append(frame)
    return ticks


@pytest.fixture(scope="module")
def angles(tmp_path_factory) -> list[bytes]:
    none = storm(tmp_path_factory.mktemp("clean"), "--seconds", 12, drop=0)
    return [frame.data for frame in read_log(none.log) if frame.id == ENCODER]


@pytest.mark.parametrize("kind", KINDS)
def test_each_fault_alone_has_its_form_rate_and_counters(tmp_path, angles, kind):
    rate = 0.002 if kind in ("silence", "bus_off", "restart") else 0.05
    result = storm(tmp_path, "--seconds", 12, **{kind: rate})
    check_node(result, tmp_path / "scene.ini")
    injected, counts = result.summary["faults"]["injected"], result.summary["node"]
    assert {name for name, count in injected.items() if count} == {kind}
    counted = {name for name, count in counts.items() if count and name != "ok"}
    assert counted == {name for name, count in due_counts(injected).items() if count}
    ticks = by_tick(read_log(result.log))
    odd = {tick: ticks[tick] for tick, data in enumerate(angles) if not is_alone(ticks[tick], data)}
    if kind in LATE:
        check_late(kind, ticks, angles, injected[kind])
        return
    assert all(FORMS[kind](came, angles[tick]) for tick, came in odd.items())
    runs = silences([*odd]) if kind in ("silence", "bus_off") else [1] * len(odd)
    assert len(runs) == injected[kind] and set(runs[:-1]) <= {1, OFF_TICKS}
    due = rate * (12000 - len(odd) * (len(runs) < len(odd)))
    assert abs(injected[kind] - due) < 6 * due**0.5 + 0.1 * due
    if kind in SIZES:
        size, wanted = SIZES[kind]
        assert {size(came, angles[tick]) for tick, came in odd.items()} == wanted


def silences(ticks: list[int]) -> list[int]:
    """Lengths of the stretches of ticks without a frame."""
    parts = np.split(np.array(ticks), np.flatnonzero(np.diff(ticks) > 1) + 1)
    return [len(part) for part in parts]


def check_late(kind: str, ticks: dict, angles: list[bytes], injected: int) -> None:
    """Each late frame comes after the present one. Those on their way at the end are missing."""
    delays = Counter()
    for tick in range(len(angles)):
        data = [frame.data for frame in ticks[tick]]
        for late in data[1:] if data[:1] == [angles[tick]] else data:
            recent = angles[max(0, tick - 7) : tick]
            delays[len(recent) - recent.index(late)] += 1
    assert injected - 7 <= delays.total() <= injected
    assert {*delays} == ({1} if kind == "reorder" else {2, 3, 4, 5, 6, 7})


FULL = [  # kinds of which every frame meets one, ticks from answer to answer
    (("drop",), 7),
    (("drop", "corrupt", "length", "id", "extended"), 7),
    (("glitch",), 2),
    (("reorder",), 2),
    (("delay",), 2),
]


@pytest.mark.parametrize(("kinds", "ticks"), FULL)
def test_faults_keep_apart(tmp_path, kinds, ticks):
    """At most six frames in a row are missing. A good frame follows a late one or a glitch."""
    log = read_log(storm(tmp_path, "--seconds", 2, **dict.fromkeys(kinds, 1 / len(kinds))).log)
    answers = [round(frame.time * 1000) for frame in log if frame.id == 0x110]
    assert set(np.diff(answers)) == {ticks} and len(answers) > 280


# --- all kinds ------------------------------------------------------------------------------------


MILLION = pytest.param(None, 1000, marks=pytest.mark.long)


@pytest.mark.parametrize(
    ("rate", "seconds"),
    [(None, 30), (1 / len(KINDS), 30), MILLION],
    ids=["scene", "every frame", "a million frames"],
)
def test_every_fault_of_a_storm_is_counted(tmp_path, rate, seconds):
    """While the count wraps. The shipped scene spoils a tenth of the frames."""
    rates = {} if rate is None else dict.fromkeys(KINDS, rate)
    keys = ("motion.start_count=2147483600", f"motion.seconds={seconds}")
    result = storm(tmp_path, keys=keys, **rates)
    check_node(result, tmp_path / "scene.ini")
    summary, injected = result.summary, result.summary["faults"]["injected"]
    assert summary["frames_sent"] == 1000 * seconds
    spoiled, least = sum(injected.values()) / summary["frames_sent"], 0.09 if rate is None else 0.08
    assert all(injected.values()) and least < spoiled < 0.11
    for name, due in due_counts(injected).items():
        assert due - 8 <= summary["node"][name] <= due, name


@pytest.mark.parametrize("ms", [1, 30.6, 400])
def test_a_silence_is_longer_than_any_timeout(tmp_path, ms):
    """Its bus-off comes after 5 ms."""
    counters = {"silence": "stale"} if ms < 5 else {"silence": "stale", "bus_off": "bus_off"}
    keys = (f"friction.timeout_ms={ms}",)
    result = storm(tmp_path, keys=keys, **dict.fromkeys(counters, 0.002))
    check_node(result, tmp_path / "scene.ini")
    assert min(result.summary["node"][name] for name in counters.values()) > 5


@pytest.mark.parametrize("kind", ["silence", "bus_off"])
def test_counters_agree_whenever_the_run_ends(tmp_path, kind):
    seen = set()
    for ticks in range(OFF_TICKS - 20, OFF_TICKS + 20):
        node = storm(tmp_path, "--seconds", ticks / 1000, **{kind: 1}).summary["node"]
        seen.add((node["stale"], node["bus_off"], node["rearm"]))
    ended = (1, 0) if kind == "silence" else (0, 1)
    assert {(*ended, rearm) for rearm in (0, 1, 2)} <= seen


def test_each_node_has_its_own_faults(tmp_path):
    rates = {"bus_off": 0.002, "restart": 0.002, "glitch": 0.002}
    words = ("--nodes", 3, "--seconds", 20)
    summary = storm(tmp_path, *words, keys=("friction.node=5",), **rates).summary
    node, injected = summary["node"], summary["faults"]["injected"]
    counted = {"bus_off": node["bus_off"], "restart": node["resets"], "glitch": node["jump"]}
    assert {kind: injected[kind] for kind in counted} == counted and min(counted.values()) > 3
    assert summary["bus_counts"]["error_frames"] == node["bus_off"]
