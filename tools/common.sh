# shellcheck shell=bash
# SPDX-License-Identifier: MIT
# Shared by the scripts: places, messages, locks, and the build with preset host.

ROOT=$(CDPATH='' cd -- "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
BUILD=$ROOT/build
# shellcheck disable=SC2034 # used by the scripts that source this file
VENV=$BUILD/venv
# shellcheck disable=SC2034
LOCK_FILE=$ROOT/tools/requirements.lock

say() { printf '%s: %s\n' "$(basename "$0" .sh)" "$*"; }

die() {
    printf 'error: %s\n' "$*" >&2
    exit 1
}

# Print the comment between line 3 of the script and its first line of code.
usage() { sed -n '3,/^[^#]/{/^#/s/^# \{0,1\}//p}' "$0"; }

# Run a command with its output in build/NAME.log. If it fails, show the end of the log.
quietly() { # NAME COMMAND...
    local log=$BUILD/$1.log
    shift
    if ! "$@" >>"$log" 2>&1; then
        tail -n 15 "$log" >&2
        return 1
    fi
}

# Hold build/NAME.lock until this shell ends. Start background processes that outlive it with 9>&-.
one_at_a_time() { # NAME
    mkdir -p "$BUILD"
    exec 9>"$BUILD/$1.lock"
    flock -n 9 && return
    say "another $1 is at work here; waiting for it"
    flock -w 1800 9 || die "the other $1 did not end within 30 minutes (lock: build/$1.lock)"
}

configure() { # CMAKE_ARGUMENT...
    (cd "$ROOT" && quietly build cmake --preset host "$@") || die "cmake could not configure; see build/build.log"
}

build() { # CMAKE_ARGUMENT...
    quietly build cmake --build "$BUILD/host" "$@" || die "the build failed; see build/build.log"
}

start_build() {
    one_at_a_time build
    : >"$BUILD/build.log"
    say "building with preset host (log: build/build.log)"
}

build_all() {
    start_build
    configure -DDAHL_BUILD_TESTS=ON ${DAHL_UNITY_DIR:+"-DDAHL_UNITY_DIR=$DAHL_UNITY_DIR"}
    build
    exec 9>&-
}

# Build the programs of the demo only. A new build folder gets no tests, because they need Unity.
build_demo() {
    start_build
    [ -e "$BUILD/host/build.ninja" ] || configure -DDAHL_BUILD_TESTS=OFF
    build --target dahl-loop dahl_binding dahl_fmu
    exec 9>&-
}
