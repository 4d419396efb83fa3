# SPDX-License-Identifier: MIT
"""Laws of the log readers, for any content: what another program wrote is read back as it was, in
any unit; and whatever the bytes are, the answer is a log or one line that names the file.
"""

from __future__ import annotations

import functools
import math
import re
from pathlib import Path

import log_writers
import numpy as np
import pytest
from dahl import Error, logs
from dahl.identify import readers, units
from dahl.identify.log import Log
from dahl.monitor_view import View
from hypothesis import assume
from hypothesis import strategies as st
from law_tools import holds, modes

KINDS = [*log_writers.TABLES, *log_writers.FRAMES]
numbers = st.floats(-1e4, 1e4, allow_subnormal=False)
lengths = st.integers(2, 30)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("logs")
    (made / "bus.dbc").write_text(log_writers.DBC)
    return made


def columns(count: int) -> st.SearchStrategy[list[np.ndarray]]:
    """Columns of one length, any finite numbers; the first one rises."""
    column = lengths.flatmap(
        lambda n: st.lists(
            st.lists(numbers, min_size=n, max_size=n).map(np.array),
            min_size=count,
            max_size=count,
        )
    )
    return column.map(lambda made: [np.sort(made[0]), *made[1:]])


def source_of(kind: str, folder: Path) -> readers.Source:
    if kind in log_writers.FRAMES:
        return readers.Source("Angle", "Torque", dbc=folder / "bus.dbc")
    return readers.Source()


# --- what was written is what is read -------------------------------------------------------------


@pytest.mark.parametrize("kind", log_writers.TABLES)
@modes(short=12, long=120)
def test_a_table_comes_back_as_it_was_written(folder, kind, examples):
    path = folder / kind
    prefix = "rig." if kind == "structure.mat" else ""
    source = readers.Source(f"{prefix}x_m", f"{prefix}force_N", f"{prefix}t")
    if kind == "channels.mf4":  # its time is not a channel but belongs to each
        source = readers.Source("x_m", "force_N")

    def law(table: list[np.ndarray]) -> None:
        log_writers.TABLES[kind](path, dict(zip(("t", "x_m", "force_N"), table, strict=True)))
        log = readers.read(path, source)
        assert log.linear
        for read, wrote in zip((log.time, log.theta, log.torque), table, strict=True):
            np.testing.assert_allclose(read, wrote, rtol=1e-14)

    holds(law, examples, columns(3))


@pytest.mark.parametrize("kind", log_writers.FRAMES)
@modes(short=12, long=120)
def test_frames_come_back_as_they_were_sent(folder, kind, examples):
    path = folder / f"sent.{kind}"
    bits = st.integers(-900_000, 900_000)
    rows = st.lists(st.tuples(bits, bits), min_size=2, max_size=30)

    def law(sent: list[tuple[int, int]]) -> None:
        angle, torque = np.array(sent).T
        time = 1000 + 0.01 * np.arange(len(sent))
        log_writers.frames(path, time, angle, torque)
        log = readers.read(path, source_of(kind, folder))
        assert log.rows == len(sent)
        np.testing.assert_allclose(np.diff(log.time), 0.01, atol=2e-3)
        np.testing.assert_allclose(log.torque, torque * log_writers.STEP, rtol=1e-12)
        degrees = np.degrees(log.theta)
        turns = (degrees - angle * log_writers.STEP) / 360  # wraps of a turn are undone
        np.testing.assert_allclose(turns, np.round(turns), atol=1e-9)

    holds(law, examples, rows)


@modes(short=60, long=3000)
def test_read_table_comes_back_whatever_the_separator(folder, examples):
    path = folder / "table.csv"

    def law(table: list[np.ndarray], separator: str, extra: str) -> None:
        named = dict(zip(("t", "angle", "torque"), table, strict=True))
        log_writers.text(separator)(path, named)
        path.write_text(extra + path.read_text(), encoding="utf-8")
        read = logs.read_table(path, ["torque", "angle"], "t")
        assert {name: column.tolist() for name, column in read.items()} == {
            name: column.tolist() for name, column in named.items()
        }

    holds(law, examples, columns(3), st.sampled_from("\t;,"), st.sampled_from(["", "\ufeff"]))


# --- units ----------------------------------------------------------------------------------------

RADIANS = {"deg": math.pi / 180, "rad": 1.0, "mrad": 1e-3, "turn": 2 * math.pi}  # the law's own
METRES = {"m": 1.0, "mm": 1e-3, "um": 1e-6, "in": 0.0254}
NEWTONS = {"N": 1.0, "mN": 1e-3, "uN": 1e-6, "kN": 1e3, "lb": 4.4482216153, "kip": 4448.2216153}
TORQUES = {"Nm": 1.0, "mNm": 1e-3, "kNm": 1e3, "lbin": 0.112984829, "lbft": 1.3558179483}


@modes(short=80, long=2000)
def test_a_unit_is_one_factor_however_it_is_said(folder, examples):
    path = folder / "units.csv"
    kinds = st.sampled_from([(RADIANS, TORQUES), (METRES, NEWTONS)])
    forms = st.sampled_from(["{what} [{unit}]", "{what}_{unit}", "{what} ({unit})", "{what}"])
    small = st.lists(st.floats(-0.4, 0.4), min_size=8, max_size=8).map(np.array)  # of a turn

    def law(data, kind, form: str, angle: np.ndarray, torque: np.ndarray) -> None:
        angles, torques = kind
        first, second = (data.draw(st.sampled_from(sorted(known))) for known in kind)
        turn = 2 * math.pi if angles is RADIANS else 1.0
        written = (turn * angle / angles[first], torque / torques[second])
        names = (
            form.format(what="angle" if angles is RADIANS else "position", unit=first),
            form.format(what="torque", unit=second),
        )
        source = readers.Source(angle_unit=first, torque_unit=second)
        if "unit" in form:
            source = readers.Source()
        log_writers.text(",")(path, dict(zip(names, written, strict=True)))
        log = readers.read(path, source)
        assert log.linear == (angles is METRES)
        np.testing.assert_allclose(log.theta, turn * angle, rtol=1e-9, atol=1e-15)
        np.testing.assert_allclose(log.torque, torque, rtol=1e-9, atol=1e-15)

    holds(law, examples, st.data(), kinds, forms, small, small)


@modes(short=60, long=2000)
def test_counts_and_wraps_of_a_counter_are_a_path(folder, examples):
    """A counter that runs over, in whole counts, gives the path that was gone."""
    path = folder / "counts.csv"
    moves = st.lists(st.integers(-400, 400), min_size=5, max_size=60).map(np.array)

    def law(steps: np.ndarray, bits: int, start: int) -> None:
        turn = 2**bits
        gone = np.cumsum(steps)
        assume(np.ptp(gone) < turn)
        read = (gone + start) % turn
        jumps = np.abs(np.diff(read))
        assume(jumps.size and (jumps.max() > 0.9 * turn or jumps.max() == np.abs(steps[1:]).max()))
        log_writers.text(",")(path, {"counts": read, "torque": 0.5 * np.arange(len(read))})
        log = readers.read(path, readers.Source(counts_per_turn=turn))
        way = (log.theta - log.theta[0]) * turn / (2 * math.pi)
        np.testing.assert_allclose(way, gone - gone[0], atol=1e-6)
        assert log.resolution == pytest.approx(2 * math.pi / turn)

    holds(law, examples, moves, st.integers(10, 20), st.integers(0, 2**20))


@modes(short=150, long=5000)
def test_a_named_unit_is_found_in_a_name(examples):
    words = st.text(st.characters(codec="ascii", categories=["Ll"]), min_size=3, max_size=8)
    known = st.sampled_from([*units.ANGLES, *units.TORQUES])

    def law(word: str, unit: str, blanks: str) -> None:
        table = units.ANGLES if unit in units.ANGLES else units.TORQUES
        assert units.unit_in(f"{word} [{blanks}{unit}{blanks}]", table, "none") == unit
        assert units.unit_in(f"{word}_{unit}", table, "none") == unit
        if word not in {*map(str.lower, table), *units.SAME}:
            assert units.unit_in(word, table, "none") == "none"

    holds(law, examples, words, known, st.sampled_from(["", " "]))


# --- whatever the bytes are -----------------------------------------------------------------------


def answered(path: Path, source: readers.Source) -> None:
    """A log, or one line that names the file (or the DBC); nothing else."""
    try:
        log = readers.read(path, source)
    except Error as error:
        assert re.fullmatch(r"[^\r\n]+", str(error)), repr(str(error))
        assert path.name in str(error) or "in the DBC" in str(error), str(error)
    else:
        assert isinstance(log, Log)
        assert log.theta.dtype == log.torque.dtype == float
        assert len(log.theta) == len(log.torque)
        assert np.isfinite(log.theta).all() and np.isfinite(log.torque).all()


@functools.cache
def whole(folder: Path, kind: str) -> bytes:
    """A sound file of one kind."""
    path, rows = folder / f"whole.{kind}", np.arange(40)
    if kind in log_writers.FRAMES:
        log_writers.frames(path, 1000 + 0.01 * rows, 100 * rows, rows % 7)
    else:
        table = {"t": 0.01 * rows, "angle_deg": 0.1 * rows, "torque_Nm": np.sin(rows)}
        log_writers.TABLES[kind](path, table)
    return path.read_bytes()


@pytest.mark.parametrize("kind", KINDS)
@modes(short=15, long=300)
def test_a_damaged_file_is_a_log_or_one_line(folder, kind, examples):
    sound, path = whole(folder, kind), folder / f"damaged.{kind}"
    places = st.integers(0, len(sound))

    def law(cut: tuple[int, int], put: bytes, start: int) -> None:
        low, high = min(cut), max(cut)
        damaged = sound[:low] + put + sound[high if start else low + len(put) :]
        path.write_bytes(damaged)
        answered(path, source_of(kind, folder))

    holds(law, examples, st.tuples(places, places), st.binary(max_size=8), st.integers(0, 1))


@modes(short=60, long=2000)
def test_any_dbc_is_taken_or_refused_in_one_line(folder, examples):
    path = folder / "any.dbc"
    lines = [*log_writers.DBC.encode().splitlines(), b"BO_", b"CM_ 1", b"SG_ x", b"\xff", b"\x81"]
    lines += [b"VAL_ 256 Angle 1 2 ;", b"BO_ 256 Shaft: 2 A", b" SG_ Angle m0 : 0|8@1+ (1,0) A"]

    def law(chosen: list[bytes]) -> None:
        path.write_bytes(b"\n".join(chosen) + b"\n")
        for take in (lambda: readers.Signals(path, "Angle", "Torque"), lambda: View(dbc=path)):
            try:
                take()
            except Error as error:
                assert re.fullmatch(r"[^\r\n]+", str(error)), repr(str(error))

    holds(law, examples, st.lists(st.sampled_from(lines), max_size=14))
