# SPDX-License-Identifier: MIT
"""Which tools the tests of a module rest on, and their versions."""

from __future__ import annotations

import re
import shutil
import subprocess
from importlib import metadata

from sentences import ROOT

# Module (or its first letters) to tools; a C test that has no line here rests on the compiler.
OF_MODULE = {
    "test_cbmc": ["cbmc"],
    "test_frama": ["frama-c"],
    "test_theorems": ["bitwuzla", "z3-solver", "clang-19"],
    "test_kernel_proof": ["sollya", "gappa", "mpfr", "cc"],
    "kernel_all": ["mpfr", "cc"],
    "test_passivity": ["cc"],
    "test_error_theorem": ["cc", "mpmath"],
    "test_coverage": ["clang-19", "llvm-cov-19", "gcovr"],
    "test_mutants": ["tree-sitter", "cc", "bitwuzla"],
    "test_fuzz": ["clang-19", "atheris"],
    "test_static": ["cppcheck", "cc", "clang-19", "clang-tidy-19", "qemu-s390x-static"],
    "test_python_types": ["mypy"],
    "test_python_style": ["ruff"],
    "test_python_coverage": ["coverage"],
    "test_property": ["hypothesis"],
    "test_target": ["arm-none-eabi-gcc", "qemu-system-arm"],
    "test_bits": ["cc", "clang"],
    "test_exact": ["mpmath", "hypothesis"],
    "test_core": ["hypothesis"],
    "test_codec": ["cantools", "autosar-e2e", "crccheck"],
    "test_socketcan": ["qemu-system-x86_64"],
    "test_loop_cost": ["valgrind"],
    "test_loop_control": ["scipy"],
    "test_loop": ["python-can"],
    "test_identify": ["scipy", "numpy"],
    "test_report": ["chromium"],
}
UNITY = re.compile(r"RUN_TEST\((\w+)\)")
VERSION = re.compile(r"\d+\.\d+[\w.+~-]*")


def unity_cases(source: str) -> list[str]:
    """The single tests that a Unity program runs."""
    return UNITY.findall(source)


def of(modules: dict[str, None] | list[str]) -> list[str]:
    """The tools of these modules, each once; the longest fitting name decides."""
    found: dict[str, None] = {}
    for module in modules:
        fitting = [name for name in OF_MODULE if module.startswith(name)]
        found |= dict.fromkeys(OF_MODULE[max(fitting, key=len)] if fitting else ["cc"])
    return list(found)


def _command(tool: str) -> list[str] | None:
    path = shutil.which(tool) or ROOT / "build" / "deps" / tool / "bin" / tool
    if not shutil.which(str(path)):
        return None
    return [str(path), "-version" if tool == "frama-c" else "--version"]


def version(tool: str) -> str:
    """What the tool says of itself; "absent" where it is not there."""
    try:
        return metadata.version(tool)
    except metadata.PackageNotFoundError:
        pass
    command = (
        ["dpkg-query", "-W", "-f", "${Version}", "libmpfr-dev"]
        if tool == "mpfr"
        else _command(tool)
    )
    if command is None:
        return "absent"
    done = subprocess.run(
        command, capture_output=True, text=True, check=False, timeout=60, stdin=subprocess.DEVNULL
    )
    found = VERSION.search(done.stdout + done.stderr)
    return found[0] if found else "absent"


def table() -> str:
    """All tools and their versions, one row each."""
    names = sorted({tool for tools in OF_MODULE.values() for tool in tools})
    rows = "\n".join(f"| {name} | {version(name)} |" for name in names)
    return f"| tool | version |\n|---|---|\n{rows}"
