#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# Usage: tools/setup.sh [NEED...]
#
# Installs what a need requires and what is not installed yet. The other scripts call it; the default need is `test`.
#   demo      C compiler, CMake; Python (and Python.h) with the packages of `dahl demo`
#   identify  demo, and the packages of the other commands of `dahl`
#   firmware  demo, and a cross compiler and an emulator for Cortex-M (tools/demo.sh --target)
#   test      identify, Unity and pytest: for tools/test.sh without options
#   docs      test, explore, Doxygen, Sphinx and a browser: for tools/docs.sh
#   release   docs, and the tools that make and check wheels: for tools/release.sh
#   explore   demo, clang and lld: for tools/explore.sh
#   vm        demo, an emulator, can-utils, and a kernel with CAN if this one lacks it: for tools/vm.sh
#   checks    test, firmware, vm, release, other compilers, small cores, fuzzers, provers, a browser, CBMC, MuJoCo,
#             JAX, MinGW-w64, Wine: for tools/test.sh --checks
#   bench     identify, firmware, SLEEF and the other cores of tools/bench.sh
#   all       everything
# apt-get installs Debian packages, as root or with sudo. Everything else is under build/: the Python packages of
# tools/requirements.lock in build/venv, uv, which installs them, and other downloads in build/deps. Optional packages are tried
# once a day; if one is missing, its tests are skipped and say so. A second run ends within two seconds and needs no network. It
# is safe to interrupt it and to run two at once.
#
# Environment: DAHL_PYTHON   a Python 3.11 or later (default: python3.11, python3, then /usr/bin/python3)
#              DAHL_UNITY_DIR  a folder with unity.c, unity.h and unity_internals.h, to use instead of Debian's
set -euo pipefail
# shellcheck source=tools/common.sh
source "$(dirname "${BASH_SOURCE[0]}")/common.sh"
# shellcheck source=tools/setup/needs.sh
source "$ROOT/tools/setup/needs.sh"
# shellcheck source=tools/setup/packages.sh
source "$ROOT/tools/setup/packages.sh"
# shellcheck source=tools/setup/fetched.sh
source "$ROOT/tools/setup/fetched.sh"
# shellcheck source=tools/setup/python.sh
source "$ROOT/tools/setup/python.sh"

parse() {
    local need
    for need; do
        case "$need" in -h | --help) usage; exit 0 ;; esac
        is_need "$need" || die "unknown need '$need'; setup.sh has ${NEEDS[*]} (see --help)"
    done
    for need in "${@:-test}"; do add_need "$need"; done
}

# apt-get retries for minutes if there is no network. Therefore first download one small file, for a few seconds.
check_network() {
    local silent="cannot reach this Debian's package sources (apt-get)"
    ! needs_apt || reach_apt || APT_ANSWERS=no
    [ "$APT_ANSWERS" = no ] || return 0
    silent+="; needed for: ${MISSING[*]} ${TO_FETCH[*]} ${MISSING_OPTIONAL[*]} (log: build/setup.log)"
    if must_have_apt; then die "$silent"; fi
    say "$silent"
}

main() {
    parse "$@"
    check_build_tools
    one_at_a_time setup
    mkdir -p "$BUILD/deps"
    : >"$BUILD/setup.log"
    check_packages
    check_fetched
    check_network
    install_missing
    fetch_missing
    # shellcheck disable=SC2046 # a list of words
    install_python $(words_of PYTHON_GROUP)
    [ -z "${WANTED[checks]:-}" ] || install_other_mujocos
    say "done in $SECONDS s"
}

main "$@"
