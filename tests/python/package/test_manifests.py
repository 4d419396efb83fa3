# SPDX-License-Identifier: MIT
"""The manifests for PlatformIO, Zephyr and ESP-IDF name the files that a microcontroller compiles.
test_consume.py builds a project with each of them.
"""

import json
import re
from pathlib import Path
from typing import Any

import cantools
import dahl
import pytest
import yaml
from conftest import ROOT
from programs import run

PUBLIC = {
    f"lib/include/{name}"
    for name in ("dahl.h", "dahl_encoder.h", "dahl_parts.h", "dahl.hpp", "dahl_node.h")
    + ("dahl_compensator.h", "dahl_commission.h", "dahl_frames.h", "dahl_can_bus.h")
}


def of(folder: str, *kinds: str) -> set[str]:
    files = [path for kind in kinds for path in (ROOT / folder).rglob(f"*.{kind}")]
    assert files
    return {path.relative_to(ROOT).as_posix() for path in files}


CORE = set().union(
    *(
        of(f"lib/{name}", "c", "h")
        for name in ("arith", "commission", "compensator", "model", "parts")
    )
)
NODE = of("lib/node", "c", "h", "dbc")
ASSEMBLY = of("lib/cores", "S", "inc", "c")
NEEDED = PUBLIC | CORE | NODE | {"LICENSE", "README.md"}
ESP_IDF = {"CMakeLists.txt", "idf_component.yml", "port/esp_idf/component.cmake"}
ESP_IDF |= of("examples/esp_idf", "txt", "yml", "c")  # no ESP has a core of Arm's
ESP_IDF |= of("examples/can_esp32_twai", "txt", "yml", "c", "h")
HEADER = (ROOT / "lib/include/dahl.h").read_text()
VERSION = re.search(r'#define DAHL_VERSION "([\d.]+)"', HEADER)[1]


def matching(globs: list[str]) -> set[str]:
    """Return the files of the project that match; each glob must match one."""
    for glob in globs:
        assert list(ROOT.glob(glob)), f"{glob} matches no file"
    return {path.relative_to(ROOT).as_posix() for glob in globs for path in ROOT.glob(glob)}


def west_project() -> dict[str, str]:
    """Return the entry of west.yml that the page shows."""
    page = (ROOT / "docs/microcontroller.md").read_text()
    (block,) = re.findall(r"```yaml\n(.*?)```", page, re.S)
    (project,) = yaml.safe_load(block)["manifest"]["projects"]
    return project


def citation() -> dict[str, Any]:
    return yaml.safe_load((ROOT / "CITATION.cff").read_text())


def test_every_manifest_has_the_version_of_the_header() -> None:
    """pyproject.toml reads tools/dahl/version.py. These files state it."""
    cmake = (ROOT / "CMakeLists.txt").read_text()
    stated = {
        "CMakeLists.txt": re.search(r"^project\(dahl VERSION (\S+)", cmake, re.M)[1],
        "library.json": json.loads((ROOT / "library.json").read_text())["version"],
        "idf_component.yml": yaml.safe_load((ROOT / "idf_component.yml").read_text())["version"],
        "port/arduino": re.search(
            r"^version=(.*)", (ROOT / "port/arduino/library.properties").read_text(), re.M
        )[1],
        "lib/node/dahl.dbc": cantools.database.load_file(ROOT / "lib/node/dahl.dbc").version,
        "tools/dahl/version.py": dahl.__version__,
        "CITATION.cff": citation()["version"],
        "docs/simulate.md": re.search(
            r"^  version = \{(.*)\}", (ROOT / "docs/simulate.md").read_text(), re.M
        )[1],
        "CHANGELOG.md": re.search(
            r"^## (\d\S+), \d{4}-\d\d-\d\d$", (ROOT / "CHANGELOG.md").read_text(), re.M
        )[1],
    }
    assert stated == dict.fromkeys(stated, VERSION)


def test_platformio_packs_and_compiles_the_needed_files() -> None:
    manifest = json.loads((ROOT / "library.json").read_text())
    assert (manifest["name"], manifest["license"]) == ("dahl", "MIT")
    assert set(manifest["headers"]) == {Path(path).name for path in PUBLIC}
    packed = matching(manifest["export"]["include"])
    shown = {f"{one['base']}/{file}" for one in manifest["examples"] for file in one["files"]}
    assert packed == NEEDED | ASSEMBLY | {"library.json"} | shown
    assert len(shown) > 3
    sources = {
        f"+<{folder}/>"
        for folder in ("arith", "commission", "compensator", "cores", "model", "node", "parts")
    }
    assert set(manifest["build"]["srcFilter"]) == sources


def test_no_two_sources_make_the_same_object_file() -> None:
    """Compiled into one folder, the second object would replace the first."""
    sources = [Path(name) for name in CORE | NODE | ASSEMBLY]
    stems = [path.stem for path in sources if path.suffix in (".c", ".S")]
    assert sorted(stems) == sorted(set(stems)) and len(stems) > 40


def test_all_manifests_name_one_author_and_no_address() -> None:
    """The release enters the address (test_release.py). Arduino's format must have the field."""
    pio = json.loads((ROOT / "library.json").read_text())
    idf = yaml.safe_load((ROOT / "idf_component.yml").read_text())
    lines = (ROOT / "port/arduino/library.properties").read_text().splitlines()
    arduino = dict(line.split("=", 1) for line in lines)
    (author,) = {one["name"] for one in pio["authors"]}
    assert [author] == idf["maintainers"] and author == arduino["author"] == arduino["maintainer"]
    manifests = (pio, idf, arduino, citation(), (ROOT / "zephyr/module.yml").read_text())
    assert [one for one in manifests if "://" in str(one)] == []
    assert arduino["url"] == "" and west_project()["url"].isupper()


CFF_KEYS = {"cff-version", "message", "type", "title", "abstract", "version", "license", "authors"}
CFF_KEYS |= {"date-released", "references"}
CFF_PAPER = {"type", "title", "authors", "institution", "notes"}


def test_the_citation_file_has_the_form_of_cff_1_2_and_the_author_of_the_licence() -> None:
    """Of its schema, the rules for the keys that the file has."""
    file = citation()
    assert set(file) == CFF_KEYS and file["cff-version"] == "1.2.0" and file["type"] == "software"
    texts = CFF_KEYS - {"authors", "references", "date-released"}
    assert all(isinstance(file[key], str) and file[key] for key in texts)
    changes = (ROOT / "CHANGELOG.md").read_text()
    assert f"## {file['version']}, {file['date-released'].isoformat()}\n" in changes
    licence = (ROOT / "LICENSE").read_text()
    (author,) = file["authors"]
    assert author["name"].lower() in licence and file["license"] == licence.split()[0]
    (paper,) = file["references"]
    assert set(paper) == CFF_PAPER and paper["type"] == "generic"
    assert set(paper["institution"]) == {"name"}
    assert all(set(one) == {"family-names", "given-names"} for one in paper["authors"])


@pytest.mark.parametrize("page", ["README.md", "docs/model.md", "lib/include/dahl.h"])
def test_the_paper_is_cited_as_in_the_citation_file(page: str) -> None:
    (paper,) = citation()["references"]
    text = re.sub(r"[\s*]+", " ", (ROOT / page).read_text())
    words = [paper["title"], *(one["family-names"] for one in paper["authors"])]
    words += [paper["institution"]["name"].split(",")[0], "ANR-09-VTT-14"]
    assert [word for word in words if word not in text] == []


def test_the_recipe_for_west_names_no_revision_that_is_missing() -> None:
    """A placeholder in capitals, or a tag of this repository."""
    revision = west_project()["revision"]
    assert revision.isupper() or revision in run("git", "-C", ROOT, "tag").split()


def test_zephyr_and_twister_find_the_module_its_options_and_samples() -> None:
    module = yaml.safe_load((ROOT / "zephyr/module.yml").read_text())
    assert module["name"] == west_project()["name"] == "dahl"
    options = re.findall(r"^config (\w+)$", (ROOT / module["build"]["kconfig"]).read_text(), re.M)
    assert options == ["DAHL", "DAHL_NODE", "DAHL_COMMISSION"]
    assert (ROOT / module["build"]["cmake"] / "CMakeLists.txt").exists()
    (folder,) = (ROOT / name for name in module["samples"])
    metadata = yaml.safe_load((folder / "sample.yaml").read_text())
    (test,) = metadata["tests"].values()  # test_can_examples.py compares the line that it expects
    assert metadata["sample"]["name"] and test["harness"] == "console"
    chosen = re.findall(r"^CONFIG_(\w+)=y$", (folder / "prj.conf").read_text(), re.M)
    assert {"CAN", "DAHL", "DAHL_NODE"} <= set(chosen)
    listed = re.findall(r"src/\w+\.c", (folder / "CMakeLists.txt").read_text())
    assert {folder / one for one in listed} == set(folder.glob("src/*.c"))


def test_esp_idf_packs_the_needed_files() -> None:
    component = yaml.safe_load((ROOT / "idf_component.yml").read_text())
    assert component["license"] == "MIT"
    assert component["files"]["exclude"] == ["**/*"]
    assert matching(component["files"]["include"]) == NEEDED | ESP_IDF
    for example in component["examples"]:
        assert f"{example['path']}/CMakeLists.txt" in ESP_IDF
