# SPDX-License-Identifier: MIT
"""Helpers for tests of `dahl demo`: an own log, files of a run, and a dahl-loop with a fault."""

import configparser
import json
import math
import os
from pathlib import Path
from typing import Any

import dahl
import numpy as np
from loop_tools import counts_of, read_log, torques_of

SIGMA0, FC, TURN, OFFSET, TICKS = 40.0, 0.8, 16384, 0.05, 1200
OWN = ["--angle", "shaft [deg]", "--torque", "sensor [mNm]", "--sigma0", SIGMA0, "--fc", FC]
OWN += ["--counts-per-turn", TURN, "--torque-scale", "-0.001", "--offset", OFFSET]


def write_log(path: Path) -> Path:
    """A log with the torque of the model, with sign, scale and offset of a sensor and noise."""
    random = np.random.default_rng(1)
    degrees = np.array([30 * math.sin(i / 150) + 4 * math.sin(i / 11) for i in range(TICKS)])
    counts = np.rint((degrees - degrees[0]) * TURN / 360).astype(int)
    bearing = dahl.Friction(dahl.Plan(SIGMA0, FC, 2 * math.pi / TURN))
    torque = bearing.run_counts(np.diff(counts, prepend=0)) + OFFSET + random.normal(0, 0.01, TICKS)
    rows = [
        f"{i / 1000:.3f},{angle!r},{-1000 * value:.4f}"
        for i, (angle, value) in enumerate(zip(degrees.tolist(), torque, strict=True))
    ]
    path.write_text("\n".join(["t,shaft [deg],sensor [mNm]", *rows, ""]))
    return path


def summary_of(folder: Path) -> dict[str, Any]:
    return json.loads((folder / "summary.json").read_text())


def scene_of(path: Path) -> configparser.ConfigParser:
    parser = configparser.ConfigParser(inline_comment_prefixes=(";",), interpolation=None)
    parser.optionxform = str
    parser.read(path, encoding="utf-8")
    return parser


def answered(path: Path, node: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Counts and F/Fc in Q30 of each answered tick, if none is missing."""
    log = read_log(path)
    ratios = [ratio for _, ratio in torques_of(log, node)]
    return np.array(counts_of(log, node)[: len(ratios)]), np.array(ratios)


def rows_of(table: str) -> dict[str, str]:
    rows, name = {}, ""
    for line in (line.split("│") for line in table.splitlines() if "│" in line):
        name = line[1].strip() or name
        rows[name] = f"{rows.get(name, '')} {line[2].strip()}".strip()
    return rows


def write_loop(folder: Path, script: str) -> Path:
    """A program in place of dahl-loop. Its script has the real one as $LOOP."""
    folder.mkdir(exist_ok=True)
    path = folder / "loop"
    path.write_text(f"#!/bin/sh\nLOOP='{os.environ['DAHL_LOOP']}'\n{script}\n")
    path.chmod(0o755)
    return path


def in_role(role: str, script: str, otherwise: str = "") -> str:
    """A script that runs this for one role, then dahl-loop."""
    case = f'case " $* " in *" {role} "*) {script};; *) :; {otherwise};; esac'
    return f'{case}\nexec "$LOOP" "$@"'
