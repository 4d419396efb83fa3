# SPDX-License-Identifier: MIT
"""Tables of `dahl demo` and CAN logs of `dahl plot`: good ones are read as `dahl identify` reads
them, and an error names file, line and column.
"""

from pathlib import Path

import can
import numpy as np
import pandas as pd
import pytest
from identify_tools import complaint
from log_reading import run

MODEL = "--sigma0 40 --fc 0.8 --counts-per-turn 4096 --bus canopy -o out".split()


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch, dahl_loop, library) -> None:
    monkeypatch.chdir(tmp_path)


def own_table(*words: object) -> tuple[np.ndarray, str]:
    """The table that `dahl demo LOG` replays, and its scene; the bus is refused after that."""
    assert "canopy" in complaint(run("demo", *words, *MODEL))[1]
    return np.loadtxt("out/own.csv", delimiter=",", skiprows=1), Path("out/own.ini").read_text()


def test_the_demo_reads_what_identify_reads():
    text = "Prüfstand;3\n\nDatum;24.11.2026\nt;angle [deg];T\n0;15;2\n0,25;-25;3\n0,5;35;-4,5\n;;\n"
    Path("log.csv").write_text(text, encoding="utf-16")
    table, scene = own_table("log.csv", *"--angle angle --torque T --time t".split())
    assert table.tolist() == [[15, 2, 0], [-25, 3, 0.25], [35, -4.5, 0.5]]
    assert "counts_per_unit = 11.37" in scene and "[deg]" in scene
    assert own_table("log.csv", "--angle", "angle")[0].tolist() == [15, -25, 35]
    code, line = complaint(run("demo", "log.csv", "--angle", 2, "--torque", 2, *MODEL))
    assert code == 2 and "different columns" in line
    Path("log.csv").write_text("angle,t,torque, angle\n1,2,3,4\n")
    code, line = complaint(run("demo", "log.csv", "--angle", "angle", *MODEL))
    assert code == 2 and line.startswith("log.csv:1: 2 columns 'angle'")


def test_the_demo_uses_the_units_of_names_and_unwraps():
    gone = np.arange(100) * 0.03
    frame = pd.DataFrame({"angle [turn]": gone % 1, "T_mNm": 1e3 * gone, "t_ms": 5e3 * gone})
    frame.to_parquet("x.parquet")
    words = "x.parquet --angle 1 --torque T_mNm --time t_ms".split()
    table, scene = own_table(*words)
    np.testing.assert_allclose(table, np.column_stack((gone, gone, 5 * gone)), atol=1e-12)
    assert "counts_per_unit = 4096" in scene
    table, _ = own_table(*words, "--torque-scale", -2)
    np.testing.assert_allclose(table[:, 1], -2e3 * gone)


@pytest.mark.parametrize(
    ("name", "content", "parts"),
    [
        ("a.log", "(0.1) v 100#00\nhello\nyou\n", "a.log:2: |hello|bad lines: 2 of 3"),
        ("a.log", "(zero) v 100#00\n", "a.log:1: "),
        ("a.log", "", "a.log: no frames"),
        ("a.asc", 0, "a.asc: no frames"),
        ("a.blf", 20, "a.blf: | 20 frames"),  # python-can does not notice the lost end
        ("a.txt", "", "a.txt: |.asc, .blf, .log"),
    ],
)
def test_a_log_without_frames_or_with_a_broken_one_is_named(name, content, parts):
    if isinstance(content, str):
        Path(name).write_text(content)
    else:
        with can.Logger(name) as log:
            for n in range(content):
                log.on_message_received(can.Message(timestamp=n, arbitration_id=n, data=b"1"))
        Path(name).write_bytes(Path(name).read_bytes()[: -1 if content else None])
    code, line = complaint(run("plot", name, "--scene", "segments"))
    assert code == 2 and all(part in line for part in parts.split("|"))
