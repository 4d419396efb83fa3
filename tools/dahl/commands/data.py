# SPDX-License-Identifier: MIT
"""List the measured sets, or get one by name.

The command searches $DAHL_DATA, ../shared/data next to the project, the cache of the user, and the
network (a pinned commit with checked sha256). With a name it prints only the folder, for scripts.
"""

from __future__ import annotations

import argparse
import json

HELP = "list measured sets, or get one"
EXAMPLE = "example: head -3 $(dahl data tribometer)/reciprocating.tsv"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("name", nargs="?", help="set to get (default: list all)")
    parser.add_argument("--json", action="store_true", help="print JSON")


def run(args: argparse.Namespace) -> None:
    from dahl.io import data

    if args.name:
        folder = str(data.folder(args.name))
        print(json.dumps({"name": args.name, "folder": folder}) if args.json else folder)
        return
    sets = [_numbers(name) for name in data.SETS]
    if args.json:
        print(json.dumps(sets, indent=2))
        return
    for known in sets:
        place = known["folder"] or "not on this machine; no download exists"
        if known["download"] and not known["folder"]:
            place = f"to download from {known['download']}"
        print(f"{known['name']}\n    {known['what']} ({known['licence']})\n    {place}")


def _numbers(name: str) -> dict[str, str | None]:
    """Return a set as JSON values: its `folder` if it is on this machine, and its `download`
    source.
    """
    from dahl.io import data

    known, found = data.SETS[name], data.local_folder(name)
    return {
        "name": name,
        "what": known.what,
        "licence": known.licence,
        "folder": str(found) if found else None,
        "download": known.repo if known.commit else None,
    }
