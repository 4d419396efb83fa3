#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Put the page of tools/explore.sh together: sources, compiled library, and the rules for columns
and units of `dahl identify`.

Usage: build.py LIBRARY.wasm OUT.html
"""

import base64
import json
import sys
from pathlib import Path

from dahl.io import encoder_grid, log, readers, units

HERE = Path(__file__).parent


def rules() -> dict[str, object]:
    """Return what log.js must know of dahl.io. Sizes of units are in rad, m, N m, N, A and s."""
    return {
        "quantities": units.QUANTITIES,
        "lengths": list(units.LENGTHS),
        "currents": list(units.CURRENTS),
        "unitOf": units.UNIT_OF,
        "otherUnits": units.OTHER_UNITS,
        "twoWords": units.TWO_WORDS,
        "rotating": units.ROTATING,
        "shortLengths": units.SHORT_LENGTHS,
        "shortTimes": units.SHORT_TIMES,
        "roles": readers.ROLES,
        "derived": readers.DERIVED,
        "setpoint": readers.SETPOINT,
        "force": readers.FORCE,
        "current": readers.CURRENT,
        "wrap": readers.MIN_WRAP_TURNS,
        "headRows": log.HEAD_ROWS,
        "bits": encoder_grid.BITS,
        "powerTolerance": encoder_grid.POWER_TOLERANCE,
        "turns": encoder_grid.TURNS,
    }


def page(library: bytes) -> str:
    """Return the page. The size of a unit that depends on the encoder is NaN, as JavaScript has."""
    sources = {
        name: (HERE / name).read_text().rstrip() for name in ("style.css", "log.js", "explore.js")
    }
    sources["library"] = base64.b64encode(library).decode()
    sources["rules"] = json.dumps(rules(), ensure_ascii=True).replace("</", "<\\/")
    text = (HERE / "page.html").read_text()
    for name, source in sources.items():
        text = text.replace(f"@{name}@", source)
    return text


def main() -> None:
    library, out = map(Path, sys.argv[1:])
    out.parent.mkdir(parents=True, exist_ok=True)
    out.write_text(page(library.read_bytes()), encoding="utf-8")


if __name__ == "__main__":
    main()
