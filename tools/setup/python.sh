# shellcheck shell=bash
# SPDX-License-Identifier: MIT
# The Python environment build/venv, for tools/setup.sh. It grows by need; what is damaged is made anew.

PIP_ANSWERS=yes # see ask_networks
PIP_JOB=
LOCKS=()       # the locks of this run, as words for pip and check_venv.py
VENV_STATE=    # whole, lacking or none
PYTHON=

good_python() {
    "$1" -c 'import sys, venv, ensurepip; sys.exit(sys.version_info < (3, 11))' >/dev/null 2>&1
}

find_python() {
    local python
    for python in ${DAHL_PYTHON:+"$DAHL_PYTHON"} python3.11 python3 /usr/bin/python3; do
        if good_python "$python"; then echo "$python"; return; fi
    done
}

# What an environment cannot outlive: another interpreter, another place (its scripts name their path).
venv_key() { { echo "$VENV"; "$PYTHON" -VV; } | sha256sum; }

# What the command `dahl` in it was made from: a change installs it again, and nothing else.
package_key() { sed '/^\[tool\.ruff/,$d' "$ROOT/pyproject.toml" | sha256sum; }

stamp_holds() { # LINE KEY
    [ "$(sed -n "$1p" "$VENV/.complete" 2>/dev/null)" = "$2" ]
}

# The stamp is written last, so an environment without it was left half done. With it, each package is looked at.
look_at_venv() {
    local code=0
    stamp_holds 1 "$(venv_key)" || { echo none; return; }
    "$VENV/bin/python" -I "$ROOT/tools/setup/check_venv.py" "${LOCKS[@]}" >>"$BUILD/setup.log" 2>&1 || code=$?
    case "$code" in
        0) if stamp_holds 2 "$(package_key)"; then echo whole; else echo lacking; fi ;;
        3) echo lacking ;;
        *) echo none ;;
    esac
}

look_at_python() {
    mapfile -t LOCKS < <(words_of LOCK | sed "s!.*!$ROOT/tools/requirements/&.lock!")
    PYTHON=$(find_python)
    if [ -n "$PYTHON" ]; then VENV_STATE=$(look_at_venv); else VENV_STATE=none; fi
}

wants_pip() { [ "$VENV_STATE" != whole ]; }

pip() { "$VENV/bin/python" -m pip --disable-pip-version-check --quiet "$@"; }

# One small package by pip's own settings and proxies: without a network it gives up after some 10 s, and on a busy machine pip
# alone takes more than 15 s to start. Where there is no pip yet, start_python asks again.
reach_pip() {
    local python
    for python in "$VENV/bin/python" "$PYTHON"; do
        if [ -n "$python" ] && "$python" -m pip --version >/dev/null 2>&1; then break; else python=; fi
    done
    [ -n "$python" ] || return 0
    timeout 25 "$python" -m pip --disable-pip-version-check --quiet download --no-deps --no-cache-dir --retries 1 --timeout 5 \
        --dest "$BUILD/deps" --require-hashes -r <(smallest_lock) >>"$BUILD/setup.log" 2>&1
    local code=$?
    rm -f "$BUILD"/deps/mdurl-*
    return "$code"
}

smallest_lock() { sed -n '/^mdurl==/,/[^\\]$/p' "$ROOT/tools/requirements/demo.lock"; }

# Python compiles what it imports when it first does; where that is forbidden, pip compiles everything.
pip_install() {
    local try compile=--no-compile
    if [ -n "${PYTHONDONTWRITEBYTECODE:-}" ]; then compile=--compile; fi
    for try in 1 2 3; do
        quietly setup pip install "$compile" --progress-bar off --retries 5 --timeout 30 "$@" && return
        say "pip did not get through (try $try of 3)"
        sleep $((try * 3))
    done
    die "pip could not install the Python packages (log: build/setup.log)"
}

make_venv() {
    say "making the Python environment build/venv with $("$PYTHON" -V)"
    rm -rf "$VENV"
    quietly setup "$PYTHON" -m venv "$VENV" || die "$PYTHON could not make a virtual environment (log: build/setup.log)"
    reach_pip || die "cannot reach the index of Python packages (pip), needed for: build/venv (log: build/setup.log)"
}

# Each package is pinned, with the sums of its files: nothing else gets in.
fill_venv() {
    local list=()
    for lock in "${LOCKS[@]}"; do list+=(-r "$lock"); done
    say "installing Python packages: tools/requirements/$(words_of LOCK | tail -n 1).lock and what it stands on"
    rm -f "$VENV/.complete"
    pip_install --no-deps --require-hashes "${list[@]}"
    pip_install --no-deps --no-build-isolation --editable "$ROOT"
    printf '%s\n' "$(venv_key)" "$(package_key)" >"$VENV/.complete"
}

# In the background, while apt-get installs other packages.
start_python() {
    PYTHON=$(find_python)
    [ -n "$PYTHON" ] ||
        die "no Python 3.11 or later with venv (tried: ${DAHL_PYTHON:-} python3.11 python3 /usr/bin/python3); set DAHL_PYTHON"
    if [ "$VENV_STATE" = whole ]; then return; fi
    set -m # a process group of its own, so that end_python reaches all of it
    {
        if [ "$VENV_STATE" = none ]; then make_venv; fi
        fill_venv
    } &
    PIP_JOB=$!
    set +m
}

end_python() {
    [ -n "$PIP_JOB" ] || return 0
    kill -- "-$PIP_JOB" 2>/dev/null || true
    wait "$PIP_JOB" 2>/dev/null || true
}

get_python() {
    [ -z "$PIP_JOB" ] || wait "$PIP_JOB" || die "no Python environment; what failed is said above (log: build/setup.log)"
    PIP_JOB=
    say "Python environment: in place (build/venv)"
}
