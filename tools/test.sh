#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# Usage: tools/test.sh [--long | --full | --soak] [-k WORD] [pytest arguments]
#
# Sets up, builds with preset host, runs the C tests (CTest), the Python tests and, beside them on another core, the checks
# (proofs, fuzzers, coverage, static analysis), and ends with a line
#   N passed, N failed, N skipped
# that counts single tests of all of them, after naming each failed and each skipped one. Exit code 0 only when none failed.
#   --long     also the tests marked long (all 2^31 floats, ten minutes of four nodes)
#   --full     the same
#   --soak     the tests marked soak and no others: 1e9 ticks, 1e9 executions of each fuzzer (1e6 in Python); hours to days
#   -k WORD    only tests whose name has WORD, in C and in Python
# Examples:  tools/test.sh                 all but the long ones, under 15 minutes on two cores
#            tools/test.sh -k codec -x     those about the codec, pytest stopping at the first failure
#            tools/test.sh --soak -k fuzz  1e9 executions of each fuzzer
# Leaves: build/{ctest,python,checks}.xml (JUnit), build/build.log, build/checks.log
set -euo pipefail
# shellcheck source=tools/common.sh
source "$(dirname "${BASH_SOURCE[0]}")/common.sh"

CTEST=(--label-exclude '^(long|soak)$')
PYTEST=()
RESULTS=()

parse() {
    while [ $# -gt 0 ]; do
        case "$1" in
            -h | --help) usage; exit 0 ;;
            --long | --full) CTEST[1]='^soak$'; PYTEST+=("$1") ;;
            --soak) CTEST=(--label-regex '^soak$'); PYTEST+=("$1") ;;
            -k) [ $# -ge 2 ] || die "-k needs a word"; CTEST+=(-R "$2"); PYTEST+=(-k "$2"); shift ;;
            *) PYTEST+=("$1") ;;
        esac
        shift
    done
}

run_ctest() {
    ctest --test-dir "$BUILD/host" --parallel "$(nproc)" --output-on-failure --no-tests=ignore --timeout 600 \
        --test-output-size-passed 1000000 --test-output-size-failed 1000000 --output-junit "$BUILD/ctest.xml" \
        ${CTEST[@]+"${CTEST[@]}"} || true
}

run_pytest() { # NAME FOLDER...: results in build/NAME.xml
    local name=$1
    shift
    "$VENV/bin/python" -m pytest -c "$ROOT/tests/pytest.ini" "$@" --junitxml "$BUILD/$name.xml" \
        ${PYTEST[@]+"${PYTEST[@]}"} || true
}

# Neither waits for the other; the checks yield, since some of the Python tests run a bus in real time.
run_both() {
    local pid
    (
        renice -n 10 -p "$BASHPID" >/dev/null
        run_pytest checks "$ROOT"/tests/{proof,fuzz,mutants,static}
    ) >"$BUILD/checks.log" 2>&1 &
    pid=$!
    trap 'pkill -P "$pid" || true' EXIT
    run_pytest python "$ROOT/tests/python"
    say "waiting for the checks (log: build/checks.log)"
    wait "$pid"
    trap - EXIT
    cat "$BUILD/checks.log"
}

parse "$@"
RESULTS=("$BUILD"/{ctest,python,checks}.xml)
"$ROOT/tools/setup.sh"
configure_and_build
rm -f "${RESULTS[@]}"
run_ctest
run_both
"$VENV/bin/python" "$ROOT/tools/count_tests.py" "${RESULTS[@]}"
