# SPDX-License-Identifier: MIT
"""Which command needs which Python packages, and how they come.

The package itself needs numpy alone. In a checkout tools/demo.sh sets up what `dahl demo` imports,
and the first command that needs more installs it by tools/setup.sh. Elsewhere one line names the
packages to install.
"""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
from importlib import metadata
from importlib.util import find_spec
from types import ModuleType
from typing import cast

from dahl import paths
from dahl.errors import RunError

NEEDS = {  # command: extras of pyproject.toml that bring its packages, and these, as imported
    "demo": ("can,plot", ("can", "cantools", "rich", "matplotlib", "mpmath", "pooch", "pandas")),
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
AT_TIMES = {  # packages that some options or files want, and the extra that brings each
    "asammdf": "identify",
    "cantools": "can",
    "dask": "cluster",
    "pooch": "plot",
    "pyarrow": "identify",
    "serial": "can",
}
DISTRIBUTED_AS = {"can": "python-can", "dask": "dask[distributed]", "serial": "pyserial"}
WITHOUT_MF4 = ("demo", "monitor", "node", "plot", "record", "report")  # where no word is an .mf4
TRIED = "DAHL_SETUP_TRIED"  # set for the second start, so that there is no third


def bring(command: str, words: list[str]) -> None:
    """Return if the packages of a command are there; else set them up and start it again. Raises
    RunError where this is not build/venv of a checkout, or the set-up failed.
    """
    lacking = _lacking(command)
    if not lacking:
        return
    if not _is_own_environment() or TRIED in os.environ:
        raise refusal(command)
    setup = paths.ROOT / "tools" / "setup.sh"
    if subprocess.run([setup, "identify"], stdout=sys.stderr, check=False).returncode:
        raise RunError(
            f"dahl {command} needs {_named(lacking)}, and tools/setup.sh identify failed"
        )
    os.execve(sys.executable, [sys.executable, "-m", "dahl", *words], {**os.environ, TRIED: "1"})


def refusal(command: str, module: str = "") -> RunError:
    """What to install for a command that lacks packages, or could not import this module."""
    lacking = _lacking(command) or [module.partition(".")[0]]
    extras = NEEDS[command][0] if _lacking(command) else AT_TIMES.get(lacking[0], "all")
    return RunError(f"dahl {command} needs {_named(lacking)}; {hint(lacking, extras)}")


def hint(packages: list[str], extras: str) -> str:
    """Return the pip commands that install these packages. No index has dahl itself, so its extras
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
    """Whether an extra brings a module that could not be imported."""
    return bool(_lacking(command)) or (module or "").partition(".")[0] in AT_TIMES


def _lacking(command: str) -> list[str]:
    """Packages that a command always needs, and that are not here."""
    return [name for name in NEEDS.get(command, ("", ()))[1] if find_spec(name) is None]


def _named(packages: list[str]) -> str:
    return ", ".join(DISTRIBUTED_AS.get(name, name) for name in packages)


def _is_own_environment() -> bool:
    """Whether this is build/venv of a checkout, which tools/setup.sh fills."""
    own = paths.ROOT / "build" / "venv"
    return not paths.INSTALLED and os.path.realpath(sys.prefix) == os.path.realpath(own)


def spare_mf4(command: str, words: list[str]) -> None:
    """Leave out asammdf, which python-can imports wherever it is installed: most of the start of a
    command that reads and writes no MF4. For the program, where no other command follows.
    """
    spares = command in WITHOUT_MF4 and not any(word.lower().endswith(".mf4") for word in words)
    if spares or {"-h", "--help"} & set(words):
        sys.modules.setdefault("asammdf", cast(ModuleType, None))  # its import then fails
