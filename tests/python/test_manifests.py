# SPDX-License-Identifier: MIT
"""The manifests for PlatformIO, Zephyr and ESP-IDF name what a microcontroller compiles, and no
more. test_consume.py builds a project by each of them.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
import tarfile
from pathlib import Path

import cantools
import dahl
import pytest
import yaml
from conftest import BUILD, ROOT

PUBLIC = {
    f"lib/include/{name}" for name in ("dahl.h", "dahl_encoder.h", "dahl_parts.h", "dahl.hpp")
}
CORE = {
    path.relative_to(ROOT).as_posix()
    for folder in ("arith", "model", "parts")
    for path in (ROOT / "lib" / folder).glob("*.[ch]")
}
NEEDED = PUBLIC | CORE | {"LICENSE", "README.md"}
ESP_IDF = {"CMakeLists.txt", "idf_component.yml", "port/esp_idf/component.cmake"}
HEADER = (ROOT / "lib/include/dahl.h").read_text()
VERSION = re.search(r'#define DAHL_VERSION "([\d.]+)"', HEADER)[1]


def matching(globs: list[str]) -> set[str]:
    """Files of the project that these globs choose; each must choose one."""
    for glob in globs:
        assert list(ROOT.glob(glob)), f"{glob} chooses nothing"
    return {path.relative_to(ROOT).as_posix() for glob in globs for path in ROOT.glob(glob)}


def test_every_place_tells_the_version_of_the_header() -> None:
    """CMake reads it there, pyproject.toml in tools/dahl/__init__.py; these say it themselves."""
    told = {
        "library.json": json.loads((ROOT / "library.json").read_text())["version"],
        "idf_component.yml": yaml.safe_load((ROOT / "idf_component.yml").read_text())["version"],
        "port/arduino": re.search(
            r"^version=(.*)", (ROOT / "port/arduino/library.properties").read_text(), re.M
        )[1],
        "lib/node/dahl.dbc": cantools.database.load_file(ROOT / "lib/node/dahl.dbc").version,
        "tools/dahl/__init__.py": dahl.__version__,
        "CHANGELOG.md": re.search(r"^## (\S+)", (ROOT / "CHANGELOG.md").read_text(), re.M)[1],
    }
    assert told == dict.fromkeys(told, VERSION)


def test_platformio() -> None:
    manifest = json.loads((ROOT / "library.json").read_text())
    assert (manifest["name"], manifest["license"]) == ("dahl", "MIT")
    assert set(manifest["headers"]) == {Path(path).name for path in PUBLIC}
    assert matching(manifest["export"]["include"]) == NEEDED | {"library.json"}


def test_zephyr() -> None:
    module = yaml.safe_load((ROOT / "zephyr/module.yml").read_text())
    assert module["name"] == "dahl"
    assert (ROOT / module["build"]["kconfig"]).read_text().count("config DAHL\n") == 1
    assert (ROOT / module["build"]["cmake"] / "CMakeLists.txt").exists()


THEIRS = ("zephyr_library_named", "zephyr_library_sources", "zephyr_include_directories")
THEIRS += ("idf_component_register",)  # what the library calls; here they tell what they are given


@pytest.mark.parametrize(
    ("script", "chosen"),
    [("zephyr", "set(CONFIG_DAHL y)"), ("zephyr", ""), (".", "set(ESP_PLATFORM 1)")],
)
def test_a_framework_compiles_the_core_where_it_is_chosen(tmp_path: Path, script, chosen) -> None:
    follow = tmp_path / "follow.cmake"
    calls = [f'function({call})\nmessage("${{ARGV}}")\nendfunction()' for call in THEIRS]
    include = f'include("{ROOT / script}/CMakeLists.txt")'
    follow.write_text("\n".join([*calls, chosen, include]))
    command = ["cmake", "-P", str(follow)]
    told = subprocess.run(command, check=True, capture_output=True, text=True).stderr
    words = [os.path.relpath(word, ROOT) for word in re.split(r"[;\s]", told) if "/lib/" in word]
    sources = {path for path in CORE if path.endswith(".c")}
    assert sorted(words) == (sorted({*sources, "lib/include"}) if chosen else [])


def test_esp_idf() -> None:
    component = yaml.safe_load((ROOT / "idf_component.yml").read_text())
    assert component["license"] == "MIT"
    assert component["files"]["exclude"] == ["**/*"], "only what is included"
    assert matching(component["files"]["include"]) == NEEDED | ESP_IDF


@pytest.fixture(scope="module")
def packers() -> Path:
    """The folder of `pio` and `compote`, from PyPI, in an environment of their own."""
    environment = BUILD.parent / "packers"
    requirements = ROOT / "tests/consume/requirements.txt"
    wanted = requirements.read_text()
    stamp = environment / "installed.txt"
    if not stamp.exists() or stamp.read_text() != wanted:
        subprocess.run([sys.executable, "-m", "venv", "--clear", str(environment)], check=True)
        pip = [str(environment / "bin/pip"), "install", "--quiet", "-r", str(requirements)]
        done = subprocess.run(pip, check=False, timeout=280)
        if done.returncode != 0:
            pytest.skip("unproven: the packers of PlatformIO and ESP-IDF: PyPI is out of reach")
        stamp.write_text(wanted)
    return environment / "bin"


# PlatformIO looks up the names of licences on the net, and nothing else.
PACK = """
import sys
from platformio.package.manifest.schema import ManifestSchema
from platformio.package.pack import PackagePacker
ManifestSchema.load_spdx_licenses = staticmethod(lambda: {"licenses": [{"licenseId": "MIT"}]})
PackagePacker(sys.argv[1]).pack(sys.argv[2])
"""


def packed(archive: Path) -> set[str]:
    """The files of an archive, which is small."""
    assert archive.stat().st_size < 100_000
    with tarfile.open(archive) as tar:
        files = {member.name.removeprefix("./") for member in tar if member.isfile()}
    print(f"{archive.name}: {len(files)} files, {archive.stat().st_size} bytes")
    return files


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    """A copy of the project, since packers write into it."""
    ignored = shutil.ignore_patterns("build", ".git", "__pycache__")
    return Path(shutil.copytree(ROOT, tmp_path / "dahl", ignore=ignored))


@pytest.mark.long
def test_pio_packs_what_is_needed(packers: Path, tree: Path, tmp_path: Path) -> None:
    archive, home = (tmp_path / "dahl.tar.gz", {**os.environ, "PLATFORMIO_CORE_DIR": str(tmp_path)})
    command = [packers / "python", "-c", PACK, tree, archive]
    subprocess.run([str(word) for word in command], check=True, env=home, timeout=120)
    assert packed(archive) == NEEDED | {"library.json"}


@pytest.mark.long
def test_compote_packs_what_is_needed(packers: Path, tree: Path) -> None:
    command = [str(packers / "compote"), "component", "pack", "--name", "dahl"]
    subprocess.run(command, check=True, cwd=tree, timeout=120)
    assert packed(tree / f"dist/dahl_{VERSION}.tgz") == NEEDED | ESP_IDF
