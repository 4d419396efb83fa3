# SPDX-License-Identifier: MIT
"""
Say where the measured sets are, or get one by name.

Looked for in $DAHL_DATA, in ../shared/data beside the project, in the user's cache, and last on the
network (a pinned commit, sha256 checked). With a name, the folder is printed alone on a line, for
use in scripts.
"""

from __future__ import annotations

import argparse
import json
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from dahl.io.data import Set

HELP = "measured sets: where they are; fetch one"
EXAMPLE = "example: head -3 $(dahl data tribometer)/reciprocating.tsv"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("name", nargs="?", help="set to get; without it all are listed")
    parser.add_argument("--json", action="store_true", help="the same as JSON")


def run(args: argparse.Namespace) -> None:
    from dahl.io import data

    if args.name:
        folder = str(data.folder(args.name))
        print(json.dumps({"name": args.name, "folder": folder}) if args.json else folder)
    elif args.json:
        print(json.dumps([_numbers(*one) for one in data.SETS.items()], indent=2))
    else:
        for name, known in data.SETS.items():
            print(f"{name}\n    {known.what} ({known.licence})\n    {_where(name, known)}")


def _numbers(name: str, known: Set) -> dict[str, str | None]:
    """A set for a program: `folder` where it is, `download` where it could come from."""
    from dahl.io import data

    found = data.local_folder(name)
    return {
        "name": name,
        "what": known.what,
        "licence": known.licence,
        "folder": str(found) if found else None,
        "download": known.repo if known.commit else None,
    }


def _where(name: str, known: Set) -> str:
    from dahl.io import data

    found = data.local_folder(name)
    if found:
        return str(found)
    return (
        f"to download from {known.repo}" if known.commit else "not here, and not to be downloaded"
    )
