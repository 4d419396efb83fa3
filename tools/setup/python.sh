# shellcheck shell=bash
# SPDX-License-Identifier: MIT
# The Python environment build/venv, for tools/setup.sh. It gains packages with each need; if damaged, it is created again.
# Source tools/common.sh and tools/setup/needs.sh first.

PIP_JOB=
GROUPS_WANTED=() # sections of the lock file for this run
VENV_STATE=      # complete, incomplete or unusable
PYTHON=

is_good_python() {
    "$1" -c 'import sys, venv, ensurepip; sys.exit(sys.version_info < (3, 11))' >/dev/null 2>&1
}

find_python() {
    local python
    for python in ${DAHL_PYTHON:+"$DAHL_PYTHON"} python3.11 python3 /usr/bin/python3; do
        if is_good_python "$python"; then echo "$python"; return; fi
    done
}

# True for a Python of another origin too: no Debian package has its Python.h. If there is no Python, set-up installs Debian's.
has_python_headers() {
    local python
    python=$(find_python)
    [ -n "$python" ] && "$python" -c 'import os, sys, sysconfig
folder = sysconfig.get_path("include")
sys.exit(folder.startswith("/usr/include/") and not os.path.exists(folder + "/Python.h"))'
}

# An environment is bound to its interpreter and its place, because its scripts contain its path.
venv_key() { { echo "$VENV"; "$PYTHON" -VV; } | sha256sum; }

# The part of pyproject.toml that describes the package `dahl`. A change of it installs `dahl` again.
package_key() { sed '/^\[dependency-groups/,$d' "$ROOT/pyproject.toml" | sha256sum; }

stamp_holds() { # LINE KEY
    [ "$(sed -n "$1p" "$VENV/.complete" 2>/dev/null)" = "$2" ]
}

# The stamp is written last: without it, an installation was interrupted. With it, each package is checked.
venv_state() {
    local code=0
    stamp_holds 1 "$(venv_key)" || { echo unusable; return; }
    "$VENV/bin/python" -I "$ROOT/tools/setup/check_venv.py" "$BUILD/deps/packages.txt" >>"$BUILD/setup.log" 2>&1 || code=$?
    case "$code" in
        0) if stamp_holds 2 "$(package_key)"; then echo complete; else echo incomplete; fi ;;
        3) echo incomplete ;;
        *) echo unusable ;;
    esac
}

check_python() {
    mapfile -t GROUPS_WANTED < <(words_of PYTHON_GROUP)
    locked_packages "${GROUPS_WANTED[@]}" >"$BUILD/deps/packages.txt"
    PYTHON=$(find_python)
    if [ -n "$PYTHON" ]; then VENV_STATE=$(venv_state); else VENV_STATE=unusable; fi
}

needs_pip() { [ "$VENV_STATE" != complete ]; }

pip() { "$VENV/bin/python" -m pip --disable-pip-version-check --quiet "$@"; }

# Download one small package with pip's own settings and proxies. Without a network pip gives up after 10 s; on a busy machine it
# needs more than 25 s to start. If there is no pip yet, create_venv checks again.
reach_pip() {
    local python
    for python in "$VENV/bin/python" "$PYTHON"; do
        if [ -n "$python" ] && "$python" -m pip --version >/dev/null 2>&1; then break; else python=; fi
    done
    [ -n "$python" ] || return 0
    timeout 60 "$python" -m pip --disable-pip-version-check --quiet download --no-deps --no-cache-dir --retries 1 --timeout 5 \
        --dest "$BUILD/deps" --require-hashes -r <(smallest_package) >>"$BUILD/setup.log" 2>&1
    local code=$?
    rm -f "$BUILD"/deps/mdurl-*
    return "$code"
}

smallest_package() { locked_packages demo | sed -n '/^mdurl==/,/[^\\]$/p'; }

# Python compiles a module when it first imports it. If that is forbidden, pip must compile all of them.
pip_install() {
    local try compile=--no-compile
    if [ -n "${PYTHONDONTWRITEBYTECODE:-}" ]; then compile=--compile; fi
    for try in 1 2 3; do
        quietly setup pip install "$compile" --progress-bar off --retries 5 --timeout 30 "$@" && return
        say "pip failed (try $try of 3)"
        sleep $((try * 3))
    done
    die "pip could not install the Python packages (log: build/setup.log)"
}

create_venv() {
    say "creating the Python environment build/venv with $("$PYTHON" -V)"
    rm -rf "$VENV"
    quietly setup "$PYTHON" -m venv "$VENV" || die "$PYTHON could not create a virtual environment (log: build/setup.log)"
    reach_pip || die "cannot reach the index of Python packages (pip), needed for: build/venv (log: build/setup.log)"
}

# pip installs only packages with a SHA-256 sum of the lock file.
fill_venv() {
    say "installing Python packages: ${GROUPS_WANTED[*]} (tools/requirements.lock)"
    rm -f "$VENV/.complete"
    pip_install --no-deps --require-hashes -r "$BUILD/deps/packages.txt"
    pip_install --no-deps --no-build-isolation --editable "$ROOT"
    printf '%s\n' "$(venv_key)" "$(package_key)" >"$VENV/.complete"
}

# Install Python packages in the background while apt-get installs other packages.
start_python() {
    PYTHON=$(find_python)
    [ -n "$PYTHON" ] ||
        die "no Python 3.11 or later with venv (tried: ${DAHL_PYTHON:-} python3.11 python3 /usr/bin/python3); set DAHL_PYTHON"
    if [ "$VENV_STATE" = complete ]; then return; fi
    set -m # a process group for stop_python
    {
        if [ "$VENV_STATE" = unusable ]; then create_venv; fi
        fill_venv
    } &
    PIP_JOB=$!
    set +m
}

stop_python() {
    [ -n "$PIP_JOB" ] || return 0
    kill -- "-$PIP_JOB" 2>/dev/null || true
    wait "$PIP_JOB" 2>/dev/null || true
}

finish_python() {
    [ -z "$PIP_JOB" ] || wait "$PIP_JOB" || die "no Python environment; the reason is above (log: build/setup.log)"
    PIP_JOB=
    touch -c "$VENV/.complete" # newer than the lock file: the environment is up to date
    say "Python environment: in place (build/venv)"
}
