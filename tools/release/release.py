#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Build the files of a release from a commit. tools/release.sh calls it and has the help."""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import platform
import re
import shutil
import subprocess
import sys
import tarfile
import tempfile
import tomllib
from dataclasses import dataclass
from pathlib import Path

import archives
import sbom

ROOT = Path(__file__).resolve().parents[2]
ARM = "aarch64-linux-gnu"
ADDRESS = re.compile(r"https://(?!([\w.-]+\.)?(?i:example)\.)[\w.-]+\.\w+/[\w./~-]*\w(?<!\.git)")
NO_ADDRESS = """'{address}' is no address of a repository: give one such as
https://host.name/owner/dahl, without .git and not of example.com. Set repository in [tool.dahl] of
pyproject.toml, or give --repository"""


@dataclass
class Release:
    """What all steps need: the unpacked commit, a folder for intermediate files, the result."""

    commit: str
    seconds: int  # time of the commit
    version: str
    tree: Path
    work: Path
    out: Path

    def file(self, ending: str) -> Path:
        return self.out / f"dahl-{self.version}{ending}"


def git(*words: str) -> str:
    return subprocess.check_output(["git", "-C", str(ROOT), *words], text=True).strip()


def run(*words: object, **more: str) -> None:
    """Run a tool of this environment; show its output only if it fails."""
    environment = os.environ | more
    environment["PATH"] = f"{Path(sys.executable).parent}:{environment['PATH']}"
    command = [str(word) for word in words]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise SystemExit(f"error: {' '.join(command)}\n{(done.stdout + done.stderr)[-3000:]}")


def unpack_commit(commit: str, work: Path, out: Path) -> Release:
    tree, source = work / "tree", work / "source.tar.gz"
    version = re.search(r'DAHL_VERSION "(.+)"', git("show", f"{commit}:lib/include/dahl.h"))
    assert version
    prefix = f"dahl-{version[1]}/"
    git("archive", "--format=tar.gz", f"--prefix={prefix}", "-o", str(source), commit)
    with tarfile.open(source) as archive:
        archive.extractall(work, filter="data")
    (work / prefix).rename(tree)
    seconds = int(git("log", "-1", "--format=%ct", commit))
    release = Release(commit, seconds, version[1], tree, work, out)
    shutil.copy(source, release.file("-source.tar.gz"))
    return release


def enter_address(tree: Path, address: str) -> None:
    """Write the address into each manifest of the packages, in the fields of its format."""
    pio = tree / "library.json"
    manifest = json.loads(pio.read_text())
    manifest |= {"repository": {"type": "git", "url": f"{address}.git"}, "homepage": address}
    pio.write_text(json.dumps(manifest, indent=2) + "\n")
    for name, lines in {
        "idf_component.yml": f"url: {address}\nrepository: {address}.git\n",
        "pyproject.toml": f'\n[project.urls]\nRepository = "{address}"\n',
    }.items():
        with (tree / name).open("a") as file:
            file.write(lines)
    arduino = tree / "port/arduino/library.properties"
    arduino.write_text(re.sub(r"^url=$", f"url={address}", arduino.read_text(), flags=re.M))


def amalgamation(release: Release) -> None:
    folder = release.work / "amalgamation"
    script = release.tree / "tools/generators/amalgamate.py"
    run(sys.executable, script, "-o", folder / "friction")
    run(sys.executable, script, "--with", "parts,compensator,commission,node", "-o", folder / "all")
    shutil.copy(release.tree / "lib/node/dahl.dbc", folder / "all")
    archives.write_zip(release.file("-amalgamation.zip"), folder, release.seconds)


def sdist(release: Release) -> None:
    made = release.work / "python"
    command = [sys.executable, "-m", "build", "--no-isolation", "--outdir", made, "--sdist"]
    run(*command, release.tree, SOURCE_DATE_EPOCH=str(release.seconds))
    (archive,) = made.glob("*.tar.gz")
    with tarfile.open(archive) as tar:
        tar.extractall(release.work / "sdist", filter="data")
    shutil.copy(archive, release.out)


def wheel(release: Release, name: str = "native", flags: str = "", **more: str) -> None:
    """Write a wheel that is built from the sdist, named for the Linux that it runs on."""
    work, made = release.work, release.work / name
    (source,) = (work / "sdist").iterdir()
    more["SOURCE_DATE_EPOCH"] = str(release.seconds)
    more["CFLAGS"] = f"-ffile-prefix-map={work}=. {flags}"
    command = [sys.executable, "-m", "build", "--no-isolation", "--outdir", made, "--wheel"]
    run(*command, f"-Cbuild-dir={work}/build-{name}", source, **more)
    (built,) = made.glob("*.whl")
    run("auditwheel", "repair", "--wheel-dir", release.out, built, **more)


def wheel_for_aarch64(release: Release) -> None:
    """Compile for 64-bit Arm by clang, on x86-64.

    Debian's Python.h includes a file in a folder named after the processor. The file of x86-64 has
    the same sizes.
    """
    folder = f"python{sys.version_info.major}.{sys.version_info.minor}"
    include = release.work / "include" / ARM
    include.mkdir(parents=True)
    (include / folder).symlink_to(Path("/usr/include/x86_64-linux-gnu") / folder)
    compiler = {"CC": f"clang --target={ARM}", "_PYTHON_HOST_PLATFORM": "linux-aarch64"}
    wheel(release, "aarch64", f"-I{include.parent}", **compiler)


def can_cross_compile() -> bool:
    tools = [shutil.which("clang"), shutil.which(f"{ARM}-ld")]
    return platform.machine() == "x86_64" and all(tools) and Path("/usr", ARM, "include").exists()


def arduino(release: Release) -> None:
    folder = release.work / "arduino"
    run(release.tree / "port/arduino/pack.sh", folder)
    archives.write_zip(release.file("-arduino.zip"), folder, release.seconds)


def matching(tree: Path, globs: list[str]) -> list[Path]:
    return [path for glob in globs for path in tree.glob(glob) if path.is_file()]


def platformio(release: Release) -> None:
    globs = json.loads((release.tree / "library.json").read_text())["export"]["include"]
    files = matching(release.tree, globs)
    archive = release.file("-platformio.tar.gz")
    archives.write_tar(archive, release.tree, files, release.seconds)


def esp_idf(release: Release) -> None:
    import yaml  # here, so that --check needs no package

    globs = yaml.safe_load((release.tree / "idf_component.yml").read_text())["files"]["include"]
    files = matching(release.tree, globs)
    archives.write_tar(release.file("-esp-idf.tgz"), release.tree, files, release.seconds)


def bill_of_materials(release: Release) -> None:
    files = archives.files_below(release.out)
    document = sbom.bill(release.tree, release.version, release.commit, release.seconds, files)
    release.file(".cdx.json").write_text(json.dumps(document, indent=1) + "\n")


def check_sums(release: Release) -> None:
    lines = [
        f"{hashlib.sha256(path.read_bytes()).hexdigest()}  {path.name}\n"
        for path in archives.files_below(release.out)
    ]
    (release.out / "SHA256SUMS").write_text("".join(lines))


def address_of(given: str | None) -> str:
    """Return the address of the repository; it must be set and must not be a placeholder."""
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["dahl"]
    address = settings["repository"] if given is None else given
    if not ADDRESS.fullmatch(address):
        raise SystemExit(f"error: {NO_ADDRESS.format(address=address)}")
    return str(address)


def build(commit: str, address: str, out: Path, site: Path | None, has_arm: bool) -> Release:
    with tempfile.TemporaryDirectory(prefix="dahl-release-") as work:
        release = unpack_commit(commit, Path(work), out)
        enter_address(release.tree, address)
        for step in (amalgamation, sdist, wheel, arduino, platformio, esp_idf):
            step(release)
        if has_arm:
            wheel_for_aarch64(release)
        if site:
            archives.write_zip(release.file("-site.zip"), site, release.seconds)
        bill_of_materials(release)
        check_sums(release)
    return release


def main() -> None:
    parser = argparse.ArgumentParser(prog="release.sh", add_help=False)
    parser.add_argument("--repository")
    parser.add_argument("--commit", default="HEAD")
    parser.add_argument("--site", type=Path)
    parser.add_argument("--check", action="store_true")
    parser.add_argument("--without-aarch64", action="store_true")
    parser.add_argument("-o", dest="out", type=Path, required=True)
    options = parser.parse_args()
    address, out = address_of(options.repository), options.out
    if out.exists() and any(out.iterdir()):
        raise SystemExit(f"error: {out} is not empty; remove it, or name another folder with -o")
    if options.check:
        return
    out.mkdir(parents=True, exist_ok=True)
    os.umask(0o022)  # the wheel keeps the modes of its folders
    has_arm = not options.without_aarch64 and can_cross_compile()
    commit = git("rev-parse", options.commit)
    release = build(commit, address, out.resolve(), options.site, has_arm)
    print(*(f"{path.stat().st_size:>9} {path}" for path in archives.files_below(out)), sep="\n")
    if not has_arm:
        print(f"no wheel for aarch64: left out, or without clang, {ARM}-ld and its C library")
    print(f"tag: git tag -a v{release.version} {release.commit}")


if __name__ == "__main__":
    main()
