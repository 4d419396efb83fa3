# SPDX-License-Identifier: MIT
"""Write one self-contained page about a recorded run: loop, traces, latencies, faults, counters.

RUN is a folder of `dahl demo`, of any scene. The page contains the picture and needs no other file,
no network and no script. It is report.html in that folder, or the file of -o.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from dahl.errors import InputError

HELP = "one self-contained HTML page about a run"
EXAMPLE = """examples:
  dahl report build/demo
  dahl report build/demo -o /tmp/run.html"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("run_path", type=Path, metavar="RUN", help="folder of a run")
    parser.add_argument("-o", "--output", type=Path, metavar="HTML", help="page to write")


def run(args: argparse.Namespace) -> None:
    from dahl.io import files
    from dahl.report import page, run_files, simulated, summary

    folder = args.run_path
    if folder.is_file():
        raise InputError(f"{folder}: a file; the folder of a run was expected")
    output = args.output or folder / "report.html"
    numbers = summary.read(folder)
    is_simulated = simulated.is_simulated(numbers)
    picture = _picture(folder / (f"{numbers['scene']}.png" if is_simulated else "loop.png"))
    table = simulated.table(numbers, folder) if is_simulated else None
    text = page.page(numbers, picture, table)
    files.write_atomic(output, text)
    run_files.add(output)
    print(f"{output}: {len(text) // 1024} KiB")


def _picture(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except FileNotFoundError:
        raise InputError(f"{path}: no such file; `dahl plot {path.parent}` draws it") from None
    except OSError as error:
        raise InputError(f"{path}: {error.strerror}") from None
