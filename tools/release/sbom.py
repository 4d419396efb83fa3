# SPDX-License-Identifier: MIT
"""The bill of materials of a release: CycloneDX 1.5 in JSON, from pyproject.toml and the lock.

The C library needs no other software. The Python package needs those of scope `required`, its
extras those of scope `optional`. Those of scope `excluded` only build and test it.
"""

from __future__ import annotations

import hashlib
import re
import time
import tomllib
import uuid
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

PIN = re.compile(r"([\w.-]+)(?:\[[\w,]+\])?==([^\s;]+)")
NAME = re.compile(r"[\w.-]+")


@dataclass
class Package:
    """A package of the lock, and the packages that require it."""

    version: str
    hashes: list[str] = field(default_factory=list)
    parents: list[str] = field(default_factory=list)


def normal(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


def read_lock(text: str) -> dict[str, list[Package]]:
    """Return the packages by name: one for each version, as some Pythons need an older one."""
    packages: dict[str, list[Package]] = {}
    for line in text.splitlines():
        if found := PIN.match(line):
            current = Package(found[2])
            packages.setdefault(normal(found[1]), []).append(current)
        elif found := re.search(r"--hash=sha256:(\w+)", line):
            current.hashes.append(found[1])
        elif found := re.match(r"    # via (.*)", line):
            names = (NAME.match(one.strip()) for one in found[1].split(","))
            current.parents += [normal(one[0]) for one in names if one]
    return packages


def closure(roots: list[str], packages: dict[str, list[Package]]) -> set[str]:
    """Return the roots and all packages that they require."""
    found = {name for name in map(requirement, roots) if name in packages}
    size = 0
    while size != len(found):
        size = len(found)
        found |= {name for name, some in packages.items() if parents_of(some) & found}
    return found


def parents_of(versions: list[Package]) -> set[str]:
    return {parent for one in versions for parent in one.parents}


def requirement(text: str) -> str:
    """Return the name in a requirement such as numpy>=1.26."""
    found = NAME.match(text)
    assert found, text
    return normal(found[0])


def scopes(project: dict[str, Any], packages: dict[str, list[Package]]) -> dict[str, str]:
    extras = [one for some in project["optional-dependencies"].values() for one in some]
    of_extras, of_core = closure(extras, packages), closure(project["dependencies"], packages)
    scope = dict.fromkeys(packages, "excluded") | dict.fromkeys(of_extras, "optional")
    return scope | dict.fromkeys(of_core, "required")


def ref_of(name: str, package: Package) -> str:
    return f"pkg:pypi/{name}@{package.version}"


def component(name: str, package: Package, scope: str) -> dict[str, Any]:
    purl = ref_of(name, package)
    hashes = [{"alg": "SHA-256", "content": one} for one in package.hashes]
    address = f"https://pypi.org/project/{name}/{package.version}/"
    return {
        "type": "library",
        "bom-ref": purl,
        "name": name,
        "version": package.version,
        "scope": scope,
        "purl": purl,
        "externalReferences": [{"type": "distribution", "url": address, "hashes": hashes}],
    }


def file_entry(path: Path) -> dict[str, Any]:
    content = hashlib.sha256(path.read_bytes()).hexdigest()
    return {
        "type": "file",
        "bom-ref": f"file:{path.name}",
        "name": path.name,
        "hashes": [{"alg": "SHA-256", "content": content}],
    }


def dependencies(
    itself: str, needed: list[str], packages: dict[str, list[Package]]
) -> list[dict[str, Any]]:
    """Return the graph: each reference, and the references that it requires."""
    refs = {name: [ref_of(name, one) for one in some] for name, some in packages.items()}
    children = {itself: [ref for name in needed for ref in refs[name]]}
    for name, own in refs.items():
        users = [refs[child] for child, some in packages.items() if name in parents_of(some)]
        children |= dict.fromkeys(own, [ref for some in users for ref in some])
    return [{"ref": ref, "dependsOn": sorted(ones)} for ref, ones in children.items()]


def bill(tree: Path, version: str, commit: str, seconds: int, files: list[Path]) -> dict[str, Any]:
    """Return the document for the files of a release."""
    project = tomllib.loads((tree / "pyproject.toml").read_text())["project"]
    packages = read_lock((tree / "tools/requirements.lock").read_text())
    scope = scopes(project, packages)
    itself = f"pkg:generic/dahl@{version}"  # it is on no index
    needed = [requirement(one) for one in project["dependencies"]]
    return {
        "bomFormat": "CycloneDX",
        "specVersion": "1.5",
        "serialNumber": f"urn:uuid:{uuid.uuid5(uuid.NAMESPACE_URL, f'dahl {commit}')}",
        "version": 1,
        "metadata": {
            "timestamp": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime(seconds)),
            "component": {
                "type": "library",
                "bom-ref": itself,
                "name": "dahl",
                "version": version,
                "description": project["description"],
                "licenses": [{"license": {"id": project["license"]}}],
                "purl": itself,
                "components": [file_entry(path) for path in files],
            },
            "properties": [{"name": "dahl:commit", "value": commit}],
        },
        "components": [
            component(name, one, scope[name]) for name, some in packages.items() for one in some
        ],
        "dependencies": dependencies(itself, needed, packages),
    }
