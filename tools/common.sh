# shellcheck shell=bash
# SPDX-License-Identifier: MIT
# What the scripts share: where things are, plain words, one build at a time.

ROOT=$(CDPATH='' cd -- "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
BUILD=$ROOT/build
# shellcheck disable=SC2034 # of those who source this
VENV=$BUILD/venv

say() { printf '%s: %s\n' "$(basename "$0" .sh)" "$*"; }

die() {
    printf 'error: %s\n' "$*" >&2
    exit 1
}

# The text between the first two lines of '#' and the first line of code is the script's own manual.
usage() { sed -n '3,/^[^#]/{/^#/s/^# \{0,1\}//p}' "$0"; }

# Run a command with its output in a log; show the end of the log only where it fails.
quietly() {
    local log=$BUILD/$1.log
    shift
    if ! "$@" >>"$log" 2>&1; then
        tail -n 15 "$log" >&2
        return 1
    fi
}

# Hold build/NAME.lock until this shell ends. Children do not inherit it (see the 9>&- of callers that stay behind).
one_at_a_time() {
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

# The demo alone may have built by tcc (tools/setup/needs.sh), and now there is a compiler that makes quicker code.
is_outgrown() { grep -qs TinyCC "$BUILD"/host/CMakeFiles/*/CMakeCCompiler.cmake && ! ${CC:-cc} -v 2>&1 | grep -q '^tcc'; }

start_build() {
    one_at_a_time build
    if is_outgrown; then rm -rf "$BUILD/host"; fi
    : >"$BUILD/build.log"
    say "building with preset host (log: build/build.log)"
}

build_all() {
    start_build
    configure -DDAHL_BUILD_TESTS=ON ${DAHL_UNITY_DIR:+"-DDAHL_UNITY_DIR=$DAHL_UNITY_DIR"}
    build
    exec 9>&-
}

# What the demo runs and nothing else. A folder that was configured before keeps its tests; a new one wants no Unity.
build_demo() {
    start_build
    [ -e "$BUILD/host/build.ninja" ] || configure -DDAHL_BUILD_TESTS=OFF
    build --target dahl-loop dahl_binding
    exec 9>&-
}
