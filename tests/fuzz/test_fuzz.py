# SPDX-License-Identifier: MIT
"""Coverage-guided fuzzers of everything that takes input, each a minute; every seed at once; and
1e9 executions of each where asked to (--soak). Their laws stand in tests/fuzz/*.c and readers.py.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import planting
import pytest
from fuzzers import (
    FUZZERS,
    PARTS,
    Run,
    complaint,
    fuzz,
    home,
    program_in,
    program_of,
    replay,
    soak,
)

SECONDS = int(os.environ.get("DAHL_FUZZ_SECONDS", "60"))
SOAK_SECONDS = 120  # what an interruption can cost


def run_for_a_minute(name: str) -> Run:
    """From the same seed each time, so that what it finds is of the change at hand; --soak goes new
    ways.
    """
    return fuzz(name, program_of(name), home(name), SECONDS, "-seed=1")


@pytest.fixture(scope="module")
def minutes(request: pytest.FixtureRequest) -> Iterator[dict[str, Future[Run]]]:
    """The runs of all fuzzers that are asked for, two beside each other, more where there are more
    cores.
    """
    wanted = [
        item.callspec.params["name"]
        for item in request.session.items
        if getattr(item, "originalname", "") == "test_fuzz_for_a_minute"
    ]
    for name in wanted:
        program_of(name)
    pool = ThreadPoolExecutor(max(2, (os.cpu_count() or 1) - 1))
    yield {name: pool.submit(run_for_a_minute, name) for name in wanted}
    pool.shutdown(wait=False, cancel_futures=True)


@pytest.mark.parametrize("name", FUZZERS)
def test_fuzz_every_seed(name: str) -> None:
    run = replay(name)
    assert run.crash is None, complaint(name, run)


@pytest.mark.timeout(900)
@pytest.mark.parametrize("name", FUZZERS)
def test_fuzz_for_a_minute(name: str, minutes: dict[str, Future[Run]]) -> None:
    run = minutes[name].result()
    print(f"{name}: {run.executions} executions in {SECONDS} s, {run.edges} edges covered")
    assert run.crash is None, complaint(name, run)
    assert run.executions > FUZZERS[name].floor * SECONDS // 60, run.text[-2000:]


@pytest.mark.soak
@pytest.mark.timeout(0)
@pytest.mark.parametrize("name", FUZZERS)
def test_fuzz_soak(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    def told(line: str) -> None:
        with capsys.disabled():
            print(line, flush=True)

    goal = FUZZERS[name].soak
    assert soak(name, home(name), goal, SOAK_SECONDS, told) >= goal


def test_fuzz_soak_goes_on_where_it_stopped(tmp_path) -> None:
    lines: list[str] = []
    first = soak("codec", tmp_path, 10**9, 1, lines.append, chunks=1)
    second = soak("codec", tmp_path, 10**9, 1, lines.append, chunks=1)
    assert 0 < first < second
    assert "of 1e+09 executions" in lines[0]
    assert soak("codec", tmp_path, second, 1, lines.append) == second
    assert len(lines) == 2


@dataclass(frozen=True)
class Planted:
    """A fault for a copy of the tree, and a word of what the fuzzer then says."""

    fuzzer: str
    file: str
    right: str
    wrong: str
    word: str


PLANTED = {
    "gap_low_word_lost": Planted(
        "step",
        "lib/multiply.h",
        "dahl_mul(z, g_high) + dahl_mulhi(z, g_low)",
        "dahl_mul(z, g_high)",
        "law",
    ),
    "nan_torque_accepted": Planted(
        "step", "lib/set_torque.c", "if (magnitude > DAHL_BITS_INF) {", "if (0) {", "NaN is none"
    ),
    "softer_bristle_keeps_torque": Planted(
        "step", "lib/change_plan.c", "return x_first ? x : y;", "return x_first ? x : x;", "law"
    ),
    "batch_rounds_otherwise": Planted(
        "batch", "lib/batch.h", "0x7fffffffu - w", "0x80000000u - w", "law broken"
    ),
    "travel_bound_off_by_one": Planted(
        "prepare", "lib/prepare.c", ">= 50)", "> 50)", "accepts iff in range"
    ),
    "wrong_code": Planted(
        "prepare", "lib/prepare.c", "(bits != 0 && field", "(field", "says why not"
    ),
    "crc_skips_a_byte": Planted("codec", "port/frames.c", "i < 8; i++", "i < 7; i++", "polynomial"),
    "crc_not_compared": Planted(
        "codec",
        "port/frames.c",
        "frame->data[0] == frames_crc(frame->data, kind)",
        "frame->data[0] != 256",
        "CRC",
    ),
    "limit_on_one_side": Planted(
        "receiver", "host_sim/node.c", "part > -limit ? part : -limit", "part", "gain and limit"
    ),
    "setting_not_bounded": Planted(
        "receiver", "host_sim/node.c", " || asked->value > setting->high", "", "law broken"
    ),
    "stale_node_answers": Planted(
        "receiver",
        "host_sim/node.c",
        "node->doubts >= NODE_REARM &&",
        "node->doubts >= 2 &&",
        "silence ends",
    ),
    "line_buffer_off_by_one": Planted(
        "slcan",
        "port/slcan/slcan.c",
        "self->length < SLCAN_LINE_MAX",
        "self->length <= SLCAN_LINE_MAX",
        "buffer-overflow",
    ),
    "nine_bytes": Planted(
        "slcan", "port/slcan/slcan.c", "length > 8u", "length > 9u", "law broken"
    ),
    "byte_not_bounded": Planted(
        "socketcand",
        "port/socketcand/text.c",
        "hex_word(&element, 0xFF, &value)",
        "hex_word(&element, 0xFFF, &value)",
        "law broken",
    ),
    "digits_not_checked": Planted(
        "socketcand",
        "port/socketcand/text.c",
        "digits == 0 || word[digits] != '\\0'",
        "digits == 0",
        "law broken",
    ),
    "nan_in_scene": Planted("scene", "host_sim/scene.c", "!isfinite(number)", "0", "law broken"),
    "short_row": Planted(
        "recording",
        "host_sim/recording.c",
        "self->column == self->columns)",
        "self->column <= self->columns)",
        "second reader",
    ),
    "not_finite_row": Planted(
        "tables", "tools/dahl/logs.py", "not math.isfinite(value)", "False", "not finite"
    ),
    "candump_error_escapes": Planted(
        "buses",
        "tools/dahl/logs.py",
        "except (ValueError, IndexError, AssertionError)",
        "except IndexError",
        "ValueError",
    ),
}
PLANTED_SECONDS = 40  # at most; most are found in one
PLANTED_SLOW = {
    "travel_bound_off_by_one",
    "batch_rounds_otherwise",
    "limit_on_one_side",
    "softer_bristle_keeps_torque",
}


@pytest.mark.parametrize(
    "fault",
    [
        pytest.param(name, marks=pytest.mark.long if name in PLANTED_SLOW else ())
        for name in PLANTED
    ],
)
def test_planted_fault_is_found_by_its_fuzzer(fault: str, tmp_path: Path) -> None:
    planted = PLANTED[fault]
    planting.copy(tmp_path, (*PARTS, "tools/dahl"))
    planting.edit(tmp_path / planted.file, planted.right, planted.wrong)
    run = fuzz(planted.fuzzer, program_in(planted.fuzzer, tmp_path), tmp_path, PLANTED_SECONDS)
    assert run.crash is not None, f"not found in {run.executions} executions"
    assert planted.word in run.text, run.text[-3000:]
