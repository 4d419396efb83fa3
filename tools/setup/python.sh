# shellcheck shell=bash
# SPDX-License-Identifier: MIT
# Python environments, for tools/setup.sh and tools/bench.sh. pip installs uv in build/deps/uv; uv installs everything else.
# Both use only files that have a SHA-256 sum in tools/requirements.lock. Source tools/common.sh first.

UV=$BUILD/deps/uv/bin/uv
PYTHON=

# Print the path of a Python that can be used.
find_python() {
    local python
    for python in ${DAHL_PYTHON:+"$DAHL_PYTHON"} python3.11 python3 /usr/bin/python3; do
        "$python" -c 'import sys, venv, ensurepip
sys.exit() if sys.version_info < (3, 11) else print(sys.executable)' 2>/dev/null | grep . && return
    done
}

# True for a Python of another origin too: no Debian package has its Python.h. If there is no Python, set-up installs Debian's.
has_python_headers() {
    local python
    python=$(find_python) || return
    "$python" -c 'import os, sys, sysconfig
folder = sysconfig.get_path("include")
sys.exit(folder.startswith("/usr/include/") and not os.path.exists(folder + "/Python.h"))'
}

locked_uv() { sed -n '/^uv==/,/[^\\]$/p' "$LOCK_FILE"; }

# A new release of uv in the lock replaces the installed one. uv needs a cache; the user of a container may have no folder for it.
install_uv() {
    local pin cache=${XDG_CACHE_HOME:-${HOME:-/proc}/.cache}/uv
    mkdir -p "${UV_CACHE_DIR:-$cache}" 2>/dev/null || export UV_CACHE_DIR=$BUILD/deps/uv-cache
    PYTHON=$(find_python) ||
        die "no Python 3.11 or later with venv (tried: ${DAHL_PYTHON:-} python3.11 python3 /usr/bin/python3); set DAHL_PYTHON"
    read -r pin _ < <(locked_uv) || die "tools/requirements.lock has no uv"
    [[ "$("$UV" --version 2>/dev/null) " != "${pin/==/ } "* ]] || return 0
    say "installing uv, which installs Python packages (build/deps/uv)"
    rm -rf "$BUILD/deps/uv"
    quietly setup "$PYTHON" -m venv "$BUILD/deps/uv" ||
        die "$PYTHON could not create a virtual environment (log: build/setup.log)"
    quietly setup "$BUILD/deps/uv/bin/python" -m pip --disable-pip-version-check install --quiet --retries 2 --timeout 10 \
        --require-hashes -r <(locked_uv) || die "pip could not install uv, needed for: build/venv (log: build/setup.log)"
}

# Use pip's index and the certificates of this system, unless uv has settings of its own.
set_uv_index() {
    local index=${PIP_INDEX_URL:-$("$BUILD/deps/uv/bin/python" -m pip config get global.index-url 2>/dev/null)}
    export UV_SYSTEM_CERTS=${UV_SYSTEM_CERTS:-true}
    if [ -n "$index" ]; then export UV_DEFAULT_INDEX=${UV_DEFAULT_INDEX:-$index}; fi
}

# Python compiles a module when it first imports it. If that is forbidden, uv must compile all of them. The first try uses installed
# packages and the cache of uv, so it needs no network.
uv_install() { # FOLDER ARGUMENT...
    local words=(pip install --python "$1/bin/python" ${PYTHONDONTWRITEBYTECODE:+--compile-bytecode} "${@:2}")
    "$UV" "${words[@]}" --offline >>"$BUILD/setup.log" 2>&1 && return
    set_uv_index
    quietly setup "$UV" "${words[@]}" || die "uv could not install Python packages in $1 (log: build/setup.log)"
}

# False if a file of a package is missing, or has another size than it had when installed.
is_undamaged() { # FOLDER
    "$1/bin/python" -I -c 'import os, sys
from importlib.metadata import distributions
files = (file for each in distributions() for file in each.files or sys.exit("no RECORD"))
sys.exit(any(file.size is not None and os.stat(file.locate()).st_size != file.size for file in files))' >>"$BUILD/setup.log" 2>&1
}

# Install groups of pyproject.toml. An environment is created again if it is damaged, if its installation was interrupted, or if
# its place or its Python changed. Its file .complete is written last. uv links files of its cache, so damage may be in the cache too.
fill_venv() { # FOLDER GROUP...
    local key group words=(--require-hashes --constraints "$LOCK_FILE")
    key="$1 $("$PYTHON" -VV)"
    if [ "$(cat "$1/.complete" 2>/dev/null)" != "$key" ]; then
        create_venv "$1"
    elif ! is_undamaged "$1"; then
        create_venv "$1"
        words+=(--no-cache)
    fi
    rm -f "$1/.complete"
    for group in "${@:2}"; do words+=(--group "$ROOT/pyproject.toml:$group"); done
    uv_install "$1" "${words[@]}"
    echo "$key" >"$1/.complete"
}

create_venv() { # FOLDER
    say "creating a Python environment with $("$PYTHON" -V)"
    quietly setup "$UV" venv --clear --python "$PYTHON" "$1" || die "uv could not create $1 (log: build/setup.log)"
}

# Install the package `dahl` in place, again if its description changed.
install_dahl() {
    [ ! "$VENV/bin/dahl" -nt "$ROOT/pyproject.toml" ] || [ ! "$VENV/bin/dahl" -nt "$ROOT/tools/dahl/version.py" ] || return 0
    uv_install "$VENV" --no-deps --no-build-isolation --editable "$ROOT"
}

# Installed packages of other needs stay.
install_python() { # GROUP...
    install_uv
    say "Python packages: $* (tools/requirements.lock)"
    fill_venv "$VENV" "$@"
    install_dahl
    say "Python environment: in place (build/venv)"
}

# Other versions of MuJoCo than that of build/venv, in folders of their own there. tests/python/mujoco runs in each.
install_other_mujocos() {
    local lock folder
    mkdir -p "$VENV/mujoco"
    for lock in "$ROOT"/tools/setup/mujoco-*.lock; do
        folder=$VENV/mujoco/$(basename "${lock##*/mujoco-}" .lock)
        [ ! -e "$folder.complete" ] || continue
        uv_install "$VENV" --require-hashes --no-deps --target "$folder" -r "$lock"
        touch "$folder.complete"
    done
    say "other versions of MuJoCo: in place (build/venv/mujoco)"
}
