# SPDX-License-Identifier: MIT
"""
Write one self-contained page about a recorded run: loop, traces, latencies, faults, counters.

RUN is a folder that `dahl demo` left. The page holds its picture and needs no other file, no
network and no script. It goes into the folder as report.html, or where -o says.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

from dahl import Error

HELP = "one self-contained HTML page about a run"
EXAMPLE = """examples:
  dahl report build/demo
  dahl report build/demo -o /tmp/run.html"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("run_path", type=Path, metavar="RUN", help="folder of a run")
    parser.add_argument("-o", "--output", type=Path, metavar="HTML", help="page to write")


def run(args: argparse.Namespace) -> None:
    from dahl import html_report

    folder = args.run_path
    output = args.output or folder / "report.html"
    text = html_report.page(_summary(folder / "summary.json"), _picture(folder / "loop.png"))
    part = output.with_suffix(".part")
    part.write_text(text, encoding="utf-8")
    part.replace(output)
    print(f"{output}: {len(text) // 1024} KiB")


def _summary(path: Path) -> dict[str, Any]:
    try:
        known = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise Error(f"{path}: no such file; `dahl demo` leaves one") from None
    except ValueError as error:
        raise Error(f"{path}: not JSON ({error})") from None
    if not isinstance(known, dict) or "scene_file" not in known:
        raise Error(f"{path}: not the summary of a demo")
    return known


def _picture(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except FileNotFoundError:
        raise Error(f"{path}: no such file; `dahl plot {path.parent}` draws it") from None
