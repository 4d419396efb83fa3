# SPDX-License-Identifier: MIT
"""A C file includes headers of its room and of the rooms that its room may use; rooms form no
circle; only lib sees the private headers of lib.
"""

import os
import re
from graphlib import TopologicalSorter
from pathlib import Path

import pytest
from conftest import ROOT

MAY_USE = {  # docs/architecture.md; a public header belongs to the room that implements it
    "lib/arith": "",
    "lib/model": "lib/arith",
    "lib/parts": "lib/arith lib/model",
    "lib/compensator": "lib/arith lib/model",
    "lib/commission": "lib/arith lib/model lib/compensator",
    "lib/cores": "lib/arith lib/model lib/parts",
    "lib/batch": "lib/model lib/parts",
    "lib/float": "lib/model",
    "bus": "",
    "lib/node": "lib/arith lib/model lib/parts bus",
    "port": "bus",
    "port/loopback": "port bus",
    "port/slcan": "port bus",
    "port/socketcan": "port bus",
    "port/socketcand": "port bus",
    "port/avr": "port",
    "port/riscv": "port",
    "port/cortex_m": "port port/slcan lib/node",
    "port/simulators": "lib/model lib/parts",
    "port/fmu": "port/simulators lib/parts",
    "port/mujoco": "port/simulators lib/parts",
    "host_sim": "lib/model lib/parts lib/node bus"
    " port port/loopback port/slcan port/socketcan port/socketcand",
    "host_sim/compare": "host_sim lib/model lib/compensator",
}
ROOM_OF = {"dahl": "lib/model", "dahl_encoder": "lib/model", "dahl_can_bus": "bus"}
OF_ONE_HEADER = ("parts", "compensator", "commission", "batch", "float")
ROOM_OF |= {f"dahl_{name}": f"lib/{name}" for name in OF_ONE_HEADER}
ROOM_OF |= {"dahl_node": "lib/node", "dahl_frames": "lib/node"}
SEARCHED = ("lib/include", "port", "host_sim")  # include paths of the builds

FILES = {
    str(path.relative_to(ROOT)): path.read_text(encoding="utf-8")
    for part in ("lib", "port", "host_sim")
    for path in (ROOT / part).rglob("*")
    if path.suffix in {".c", ".h", ".S", ".inc", ".def"}
}


def room(name: str) -> str:
    folders = Path(name).parts[:-1]
    is_public = folders == ("lib", "include")
    return ROOM_OF[Path(name).stem] if is_public else "/".join(folders[:2])


def is_private(name: str) -> bool:
    return name.startswith("lib/") and not name.startswith("lib/include/")


def violations(files: dict[str, str]) -> list[tuple[str, str]]:
    """Return each file with the header that it must not include."""
    wrong = []
    for name, text in files.items():
        for word in re.findall(r'^\s*#\s*include\s+"([^"]+)"', text, re.MULTILINE):
            places = (str(Path(name).parent), *SEARCHED)
            tried = (os.path.normpath(f"{place}/{word}") for place in places)
            header = next((path for path in tried if path in files), None)
            if header is None:  # made by a build, or of another project
                continue
            is_allowed = room(header) in {room(name), *MAY_USE[room(name)].split()}
            if not is_allowed or (is_private(header) and not name.startswith("lib/")):
                wrong.append((name, header))
    return wrong


def test_a_file_includes_only_rooms_that_its_room_may_use() -> None:
    TopologicalSorter({name: used.split() for name, used in MAY_USE.items()}).prepare()
    assert {room(name) for name in FILES if "/" in name} == MAY_USE.keys()
    assert violations(FILES) == []


@pytest.mark.parametrize(
    ("name", "header"),
    [
        ("lib/arith/ratio.c", "lib/model/torque.h"),
        ("lib/model/prepare.c", "lib/include/dahl_parts.h"),
        ("lib/include/dahl_parts.h", "lib/include/dahl_frames.h"),
        ("lib/parts/slip.c", "lib/node/model_storage.h"),
        ("lib/node/node.c", "port/frame_queue.h"),
        ("port/slcan/slcan.c", "port/loopback/loopback.h"),
        ("port/simulators/friction.c", "lib/arith/fixed.h"),
        ("host_sim/main.c", "lib/parts/part.h"),
    ],
)
def test_a_planted_include_is_found(name: str, header: str) -> None:
    line = f'\n#include "{os.path.relpath(header, Path(name).parent)}"\n'
    assert violations(FILES | {name: FILES[name] + line}) == [(name, header)]
