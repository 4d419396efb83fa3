# SPDX-License-Identifier: MIT
"""Optional Python packages: which command needs which. If one is missing, an error says how to
install it.
"""

from __future__ import annotations

import re
import shlex
import sys
from importlib import metadata
from importlib.util import find_spec
from types import ModuleType
from typing import cast

from dahl import paths
from dahl.errors import RunError

NEEDS = {  # command: extras in pyproject.toml, and the packages by import name
    "demo": ("can,plot", ("can", "cantools", "rich", "matplotlib", "mpmath", "pooch", "pandas")),
    "commission": ("identify", ("scipy", "pandas", "matplotlib", "rich", "can")),
    "loop": ("plot", ("pandas", "pooch")),
    "identify": ("identify", ("scipy", "pandas", "joblib", "matplotlib", "mpmath", "rich", "can")),
    "excite": ("identify", ("scipy",)),
    "monitor": ("can", ("can", "cantools", "rich", "plotext", "mpmath")),
    "node": ("can", ("can", "rich")),
    "record": ("can", ("can",)),
    "plot": ("plot", ("matplotlib", "can", "cantools", "mpmath", "pandas")),
    "report": ("plot", ("jinja2", "mpmath")),
    "data": ("plot", ("pooch",)),
    "dbc": ("can", ("cantools", "mpmath")),
}
OPTIONAL = {  # packages that only some options or files need: their extra
    "asammdf": "identify",
    "cantools": "can",
    "dask": "cluster",
    "pooch": "plot",
    "pyarrow": "identify",
    "serial": "can",
}
DISTRIBUTED_AS = {"can": "python-can", "dask": "dask[distributed]", "serial": "pyserial"}
WITHOUT_MF4 = ("demo", "loop", "monitor", "node", "plot", "record", "report")  # if no .mf4 is read


def require(command: str) -> None:
    """Raise dahl.RunError if a package that a command always needs is not installed."""
    if _missing_packages(command):
        raise refusal(command)


def refusal(command: str, module: str = "") -> RunError:
    """Return the error that names the packages to install, for a command that lacks packages or
    `module`.
    """
    missing = _missing_packages(command) or [module.partition(".")[0]]
    extras = NEEDS[command][0] if _missing_packages(command) else OPTIONAL.get(missing[0], "all")
    venv = "" if paths.INSTALLED else "; tools/setup.sh identify installs all in build/venv"
    return RunError(
        f"dahl {command} needs {_display_names(missing)}; {hint(missing, extras)}{venv}"
    )


def hint(packages: list[str], extras: str) -> str:
    """Return the commands that install these packages. dahl is on no package index, so its extras
    must come from its sources.
    """
    wanted = shlex.join(map(_requirement, packages))
    return f"pip install {wanted}, or pip install '.[{extras}]' in the source folder of dahl"


def _requirement(package: str) -> str:
    """Return the package with the versions that the extras of the installed dahl allow."""
    name = DISTRIBUTED_AS.get(package, package)
    try:
        known = metadata.requires("dahl") or []
    except metadata.PackageNotFoundError:  # run from a source folder by PYTHONPATH
        known = []
    specifiers = (each.partition(";")[0].strip() for each in known)
    return next((one for one in specifiers if _project(one) == _project(name)), name)


def _project(requirement: str) -> str:
    """Return the bare name in a requirement such as "plotext<6,>=5.3"."""
    return re.split(r"[^\w.-]", requirement, maxsplit=1)[0].lower()


def is_lacking(command: str, module: str | None) -> bool:
    """Return whether an extra contains a module that could not be imported."""
    return bool(_missing_packages(command)) or (module or "").partition(".")[0] in OPTIONAL


def _missing_packages(command: str) -> list[str]:
    """Return the missing packages among those that a command always needs."""
    return [name for name in NEEDS.get(command, ("", ()))[1] if find_spec(name) is None]


def _display_names(packages: list[str]) -> str:
    return ", ".join(DISTRIBUTED_AS.get(name, name) for name in packages)


def block_mf4_import(command: str, words: list[str]) -> None:
    """Block the import of asammdf if a command uses no MF4 file: python-can would import it, which
    is most of the start-up time. Call it only in a program that runs a single command.
    """
    is_unused = command in WITHOUT_MF4 and not any(word.lower().endswith(".mf4") for word in words)
    if is_unused or {"-h", "--help"} & set(words):
        sys.modules.setdefault("asammdf", cast(ModuleType, None))  # its import then fails
