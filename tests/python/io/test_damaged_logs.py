# SPDX-License-Identifier: MIT
"""For any bytes of a log or of a DBC, `dahl identify` reads a log of finite numbers or prints one
line that names the file.
"""

import logging
from pathlib import Path

import log_writers
import numpy as np
import pytest
from hypothesis import strategies as st
from log_reading import RefusedError, read, signals
from property_tools import holds, modes

KINDS = [*log_writers.TABLES, *log_writers.FRAMES]
KINDS.remove("structure.mat")  # scipy needs half a minute for a damaged size in it
ROWS = np.arange(40)


def sound(folder: Path, kind: str) -> tuple[bytes, tuple[object, ...]]:
    path = folder / f"whole.{kind}"
    if kind in log_writers.FRAMES:
        log_writers.frames(path, 1000 + 0.01 * ROWS, 100 * ROWS, ROWS % 7)
        return path.read_bytes(), signals(folder)
    table = {"t": 0.01 * ROWS, "angle_deg": 0.1 * ROWS, "torque_Nm": np.sin(ROWS)}
    log_writers.TABLES[kind](path, table)
    return path.read_bytes(), ()


def assert_read_or_refused(path: Path, *words: object, names: tuple[str, ...]) -> None:
    try:
        log = read(path, *words)
    except RefusedError as error:
        assert any(name in str(error) for name in names), str(error)
        assert not str(error).endswith(f"read as {path.suffix}")  # without a reason
    else:
        assert len(log.theta) == len(log.torque) >= 30
        assert np.isfinite(log.theta).all() and np.isfinite(log.torque).all()


@pytest.mark.parametrize("kind", KINDS)
@modes(short=15, long=300)
def test_a_damaged_file_is_a_log_or_one_line(tmp_path, kind, examples, caplog):
    logging.getLogger("asammdf").addHandler(caplog.handler)
    whole, words = sound(tmp_path, kind)
    path, places = tmp_path / f"damaged.{kind}", st.integers(0, len(whole))
    named = (path.name, "in the DBC")

    def check(cut: tuple[int, int], put: bytes, is_longer: bool) -> None:
        low, high = min(cut), max(cut)
        path.write_bytes(whole[:low] + put + whole[high if is_longer else low + len(put) :])
        assert_read_or_refused(path, *words, names=named)

    check((0, 0), b"", False)
    assert read(path, *words).rows == len(ROWS)
    for part in (1, 10, 130, len(whole) // 7, len(whole) // 2, len(whole) - 1):
        check((part, len(whole)), b"", True)
    holds(check, examples, st.tuples(places, places), st.binary(max_size=8), st.booleans())
    logging.getLogger("asammdf").removeHandler(caplog.handler)
    assert not [one for one in caplog.records if one.name.startswith("asammdf")]


@modes(short=60, long=2000)
def test_any_dbc_is_read_or_refused_in_one_line(tmp_path, examples, dahl_here):
    path, log = tmp_path / "any.dbc", tmp_path / "whole.log"
    log_writers.frames(log, 1000 + 0.01 * ROWS, 100 * ROWS, ROWS % 7)
    lines = [*log_writers.DBC.encode().splitlines(), b"BO_", b"CM_ 1", b"SG_ x", b"\xff", b"\x81"]
    lines += [b"VAL_ 256 Angle 1 2 ;", b"BO_ 256 Shaft: 2 A", b" SG_ Angle m0 : 0|8@1+ (1,0) A"]
    words = ("--dbc", path, "--angle", "Angle", "--torque", "Torque")
    monitor = ("monitor", "-i", "virtual", "-c", "dbc", "--seconds", "0.01", "--dbc", path)

    def check(chosen: list[bytes]) -> None:
        path.write_bytes(b"\n".join(chosen) + b"\n")
        assert_read_or_refused(log, *words, names=("any.dbc", "DBC", "signal"))
        assert dahl_here(*monitor).stderr.count("\n") <= 1

    holds(check, examples, st.lists(st.sampled_from(lines), max_size=14))
