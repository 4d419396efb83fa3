# SPDX-License-Identifier: MIT
"""The manifests for PlatformIO, Zephyr and ESP-IDF: parsed, and followed as far as one can here."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
CORE = ("arith", "model")  # what a microcontroller compiles, and nothing else
SOURCES = sorted(path.name for folder in CORE for path in (ROOT / "lib" / folder).glob("*.c"))
HEADER = (ROOT / "lib/include/dahl.h").read_text()
VERSION = re.search(r'#define DAHL_VERSION "([\d.]+)"', HEADER)[1]


def read_yaml(path: Path) -> dict:
    """The part of YAML that these files use: maps by indentation, lists of words, plain words."""
    root: dict = {}
    stack: list[tuple[int, dict]] = [(-1, root)]
    for number, line in enumerate(path.read_text().splitlines(), 1):
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        depth, text = len(line) - len(line.lstrip(" ")), line.strip()
        while stack[-1][0] >= depth:
            stack.pop()
        if item := re.fullmatch(r"- (\S+)", text):
            stack[-1][1].setdefault("", []).append(item[1])
            continue
        pair = re.fullmatch(r'([\w-]+):(?: ("[^"]*"|[^"#:\[{]+))?', text)
        assert pair, f"{path.name}:{number}: {line!r} is no `key: value`"
        assert pair[1] not in stack[-1][1], f"{path.name}:{number}: {pair[1]} twice"
        stack[-1][1][pair[1]] = pair[2].strip('"') if pair[2] else {}
        if not pair[2]:
            stack.append((depth, stack[-1][1][pair[1]]))
    return root


def cmake(script: str, folder: Path) -> str:
    path = folder / "follow.cmake"
    path.write_text(script)
    done = subprocess.run(
        ["cmake", "-P", path], capture_output=True, text=True, check=False, cwd=folder
    )
    assert done.returncode == 0, done.stderr
    return done.stderr


def test_platformio(tmp_path) -> None:
    """What PlatformIO does with it: every C file of srcDir, with includeDir, in one build."""
    manifest = json.loads((ROOT / "library.json").read_text())
    assert (manifest["name"], manifest["version"], manifest["license"]) == ("dahl", VERSION, "MIT")
    exported = {path for glob in manifest["export"]["include"] for path in ROOT.glob(glob)}
    for path in exported:
        (tmp_path / path.relative_to(ROOT)).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(path, tmp_path / path.relative_to(ROOT))
    include = tmp_path / manifest["build"]["includeDir"]
    assert (include / manifest["headers"]).exists()
    chosen = [re.fullmatch(r"\+<(\w+/)>", text)[1] for text in manifest["build"]["srcFilter"]]
    source_folder = tmp_path / manifest["build"]["srcDir"]
    sources = [path for folder in chosen for path in source_folder.glob(f"{folder}*.c")]
    assert sorted(path.name for path in sources) == SOURCES
    command = ["gcc", "-Wall", "-Wextra", "-Werror", f"-I{include}", "-c", *sources]
    subprocess.run([str(word) for word in command], check=True, cwd=tmp_path)


def test_zephyr(tmp_path) -> None:
    module = read_yaml(ROOT / "zephyr/module.yml")
    assert module["name"] == "dahl"
    assert (ROOT / module["build"]["kconfig"]).read_text().count("config DAHL\n") == 1
    script = ROOT / module["build"]["cmake"] / "CMakeLists.txt"
    stubs = """
        function(zephyr_library_named name)
        endfunction()
        function(zephyr_library_sources)
            message("SOURCES ${ARGN}")
        endfunction()
        function(zephyr_include_directories folder)
            message("INCLUDE ${folder}")
        endfunction()
    """
    said = cmake(f"{stubs}\nset(CONFIG_DAHL y)\ninclude({script})", tmp_path)
    assert sorted(re.findall(r"(\w+\.c)\b", said)) == SOURCES
    assert (Path(re.search(r"INCLUDE (.*)", said)[1]) / "dahl.h").exists()
    assert cmake(f"{stubs}\ninclude({script})", tmp_path) == "", "not chosen, but built"


def test_esp_idf(tmp_path) -> None:
    component = read_yaml(ROOT / "idf_component.yml")
    assert (component["version"], component["license"]) == (VERSION, "MIT")
    for glob in component["files"]["include"][""]:
        assert list(ROOT.glob(glob)), glob
    stub = """
        function(idf_component_register)
            message("REGISTER ${ARGN}")
        endfunction()
        set(ESP_PLATFORM 1)
    """
    said = cmake(f"{stub}\ninclude({ROOT}/CMakeLists.txt)", tmp_path)
    assert sorted(re.findall(r"(\w+\.c)\b", said)) == SOURCES
    assert (Path(re.search(r"INCLUDE_DIRS;(.*)", said)[1].strip()) / "dahl.h").exists()
