#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# Usage: tools/setup.sh [NEED...]
#
# Gets what is needed and not there yet. The other scripts call it with what they need; by itself it takes `test`.
#   demo      compiler, CMake, three small parser libraries; Python with what `dahl demo` imports
#   identify  demo, and what the other commands of `dahl` import
#   firmware  demo, and a cross compiler and an emulator for Cortex-M (tools/demo.sh --target)
#   test      identify, and what tools/test.sh runs by itself: Unity, pytest
#   vm        demo, and for tools/vm.sh an emulator, can-utils, and a kernel with CAN if this one has none
#   checks    test, firmware and vm, and what tools/test.sh --checks adds: other compilers, small cores, fuzzers, provers, a
#             browser, CBMC
#   bench     identify and firmware, and the other cores of tools/bench.sh
#   all       everything
# Debian packages come by apt-get, as root or by sudo; all else lies under build/: Python packages in build/venv, pinned with
# sums by tools/requirements/*.lock, the rest in build/deps. What a need can do without is tried once a day; tests that want
# it are skipped and say so. A second run finds all in place within two seconds. Safe to interrupt and to run twice at once.
#
# Environment: DAHL_PYTHON   a Python 3.11 or later to use (default: python3.11, python3, then /usr/bin/python3)
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
        is_need "$need" || die "setup.sh knows ${NEEDS[*]}, not '$need' (see --help)"
    done
    for need in "${@:-test}"; do add_need "$need"; done
}

# Tools that reach nothing try for minutes. So first one small file from each side, and a few seconds for it.
ask_networks() {
    local apt pip silent=()
    { ! wants_apt || reach_apt; } &
    apt=$!
    { ! wants_pip || reach_pip; } &
    pip=$!
    wait "$apt" || { APT_ANSWERS=no; silent+=("this Debian's package sources (apt-get)"); }
    wait "$pip" || { PIP_ANSWERS=no; silent+=("the index of Python packages (pip)"); }
    [ "${#silent[@]}" -gt 0 ] || return 0
    silent=("cannot reach ${silent[0]}${silent[1]:+, nor ${silent[1]}}; needed for:$(what_lacks) (log: build/setup.log)")
    if must_have_apt || [ "$PIP_ANSWERS" = no ]; then die "${silent[0]}"; fi
    say "${silent[0]}"
}

what_lacks() {
    local lacks=("${MISSING[@]}" "${TO_FETCH[@]}" "${LATER[@]}")
    if wants_pip; then lacks+=(build/venv); fi
    printf ' %s' "${lacks[@]}"
}

main() {
    parse "$@"
    one_at_a_time setup
    mkdir -p "$BUILD/deps"
    : >"$BUILD/setup.log"
    trap end_python EXIT
    look_at_packages
    look_at_fetched
    look_at_python
    ask_networks
    get_packages
    get_fetched
    get_python
    if is_outgrown; then build_demo; fi
    say "done in $SECONDS s"
}

main "$@"
