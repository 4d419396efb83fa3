#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Write the library as two files, dahl.c and dahl.h. tools/amalgamate.sh calls it and has the help.

It needs only Python. Each source follows the headers that it includes, each header stands once, and
no text changes but includes and licence lines. A test compiles all lib sources as one unit, so the
names of two files never collide.
"""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
LIB = ROOT / "lib"
ARCHIVED_COMMIT = "$Format:%H$"  # `git archive` enters the commit here (.gitattributes)

# Part: its headers, its folders of sources, and the parts that it needs.
PARTS = {
    "friction": (("dahl.h", "dahl_encoder.h"), ("arith", "model"), ()),
    "parts": (("dahl_parts.h",), ("parts",), ()),
    "compensator": (("dahl_compensator.h",), ("compensator",), ()),
    "commission": (("dahl_commission.h",), ("commission",), ("compensator",)),
    "node": (("dahl_can_bus.h", "dahl_frames.h", "dahl_node.h"), ("node",), ("parts",)),
}
INCLUDE = re.compile(r'^#include "(.+)"[^\n]*\n', re.M)
BEFORE_INCLUDE = re.compile(r'^(#define [^\n]+\n)(?=#include "dahl)', re.M)  # it changes a header
LICENCE_LINE = "/* SPDX-License-Identifier: MIT */\n"

HEAD = """{licence_line}/*
 * dahl {version}: friction torque by Dahl's model, exact at every encoder tick.
 *
 * Generated from a checkout: do not edit. Change the sources there, then write this file again.
 *   contains     {parts}
 *   commit       {commit}
 *   written by   tools/amalgamate.sh{options}
 *
 * Copy dahl.c and dahl.h into one folder of your project, compile dahl.c, and include "dahl.h".
 * It needs no define and no include path. C99 or later; dahl.h is also for C++. With gcc, compile
 * with -ffunction-sections -fdata-sections and link with -Wl,--gc-sections, so that unused
 * functions are left out.
 * This is the C alone. On Cortex-M the library also has ticks in assembly with the same bits
 * (lib/cores), which are faster; docs/microcontroller.md has the instructions of both.
 *
{licence}
 */
"""
CODE_HEAD = """
#if !defined(DAHL_WITHOUT_ASSEMBLY)
#define DAHL_WITHOUT_ASSEMBLY /* so no tick is weak */
#endif
{defines}#include "dahl.h"

#if defined(__clang__) /* not every selection of parts needs every helper */
#pragma clang diagnostic ignored "-Wunused-function"
#endif
"""


def selected(names: list[str]) -> list[str]:
    """Return friction, the named parts and all that they need, in the order of PARTS."""
    needed = {"friction", *names}
    for name in names:
        needed.update(PARTS[name][2])
    return [name for name in PARTS if name in needed]


class Fold:
    """Join files; replace each include of a project header by its text, the first time only.

    `defines` collects the lines that a source has before the include of a public header.
    """

    def __init__(self, known: tuple[Path, ...] = ()) -> None:
        self.done = {*known}
        self.defines = ""

    def text(self, file: Path) -> str:
        self.done.add(file)
        text = file.read_text(encoding="utf-8").removeprefix(LICENCE_LINE)
        self.defines += "".join(BEFORE_INCLUDE.findall(text))
        text = BEFORE_INCLUDE.sub("", text)
        body = INCLUDE.sub(lambda found: self.included(file, found[1]), text)
        return f"\n/* ---- lib/{file.relative_to(LIB).as_posix()} ---- */\n{body}"

    def included(self, file: Path, name: str) -> str:
        header = (file.parent / name).resolve()
        if not header.exists():
            header = LIB / "include" / name
        return "" if header in self.done else self.text(header)


def commit() -> str:
    """Return the commit of the checkout or of the archive, and say if files differ from it."""
    if not ARCHIVED_COMMIT.startswith("$"):
        return ARCHIVED_COMMIT
    git = ["git", "-C", str(ROOT)]
    try:
        top, known = subprocess.check_output(
            [*git, "rev-parse", "--show-toplevel", "HEAD"], text=True
        ).splitlines()
        if not ROOT.samefile(top):
            return "unknown"  # a copy in the repository of another project
        changed = subprocess.check_output([*git, "status", "--porcelain", "--", "lib"])
    except (OSError, subprocess.CalledProcessError):
        return "unknown"
    return known + (" and local changes" if changed else "")


def head(parts: list[str], names: list[str]) -> str:
    version = re.search(r'DAHL_VERSION "(.+)"', (LIB / "include/dahl.h").read_text())
    assert version
    licence = (ROOT / "LICENSE").read_text(encoding="utf-8").strip().splitlines()
    return HEAD.format(
        licence_line=LICENCE_LINE,
        version=version[1],
        parts=", ".join(parts),
        commit=commit(),
        options=f" --with {','.join(names)}" if names else "",
        licence="\n".join(f" * {line}".rstrip() for line in licence),
    )


def amalgamate(names: list[str], folder: Path) -> None:
    parts = selected(names)
    headers = [LIB / "include" / name for part in parts for name in PARTS[part][0]]
    folders = [LIB / name for part in parts for name in PARTS[part][1]]
    sources = [path for folder in folders for path in sorted(folder.glob("*.c"))]
    fold = Fold()
    public = "".join(fold.text(header) for header in headers if header not in fold.done)
    fold = Fold(tuple(headers))
    code = "".join(fold.text(source) for source in sources)
    folder.mkdir(parents=True, exist_ok=True)
    start = head(parts, names)
    (folder / "dahl.h").write_text(start + public, encoding="utf-8")
    code = CODE_HEAD.format(defines=fold.defines) + code
    (folder / "dahl.c").write_text(start + code, encoding="utf-8")


def main() -> int:
    parser = argparse.ArgumentParser(prog="amalgamate.sh", add_help=False)
    parser.add_argument("--with", dest="names", default=[], type=lambda text: text.split(","))
    parser.add_argument("-o", dest="folder", type=Path, required=True)
    options = parser.parse_args()
    unknown = [name for name in options.names if name not in PARTS]
    if unknown:
        known = ", ".join(list(PARTS)[1:])
        print(f"error: --with has no part '{unknown[0]}'; it has {known}", file=sys.stderr)
        return 2
    amalgamate(options.names, options.folder)
    return 0


if __name__ == "__main__":
    sys.exit(main())
