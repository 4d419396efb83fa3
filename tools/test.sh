#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# Usage: tools/test.sh [--checks | --full | --soak] [-k WORD] [pytest arguments]
#
# Installs what the tests need, builds with preset host, and runs the C tests (CTest) and the Python tests. Prints each failed and
# each skipped test, then the sum of all single tests:
#   N passed, N failed[, N skipped]
# It exits with 0 if no test failed and each run was complete.
#   (none)     4 minutes on two cores
#   --checks   also proofs, fuzzers, static analysis, coverage, small cores in QEMU, a kernel with CAN, the API pages: 15 minutes
#   --full     also the tests marked long: every sanitizer, ten minutes of four nodes, a bare Debian (--long is the same)
#   --soak     only the tests marked soak: 1e9 ticks, 1e9 executions of each fuzzer; hours to days
#   -k WORD    only tests with WORD in their name, in C and in Python; also "WORD or WORD"
# Examples:  tools/test.sh -k codec -x           tests of the codec; pytest stops at the first failure
#            tools/test.sh --checks -k kernel    with the proofs
# Leaves: build/{ctest,python,checks}.xml (JUnit), build/build.log, build/checks.log
set -euo pipefail
# shellcheck source=tools/common.sh
source "$(dirname "${BASH_SOURCE[0]}")/common.sh"

LEFT_OUT='not run: proofs, fuzzers, static analysis, coverage, small cores in QEMU, a kernel with CAN; tools/test.sh --checks does'
CTEST=(--label-exclude '^(checks|long|soak)$')
PYTEST=()
NEED='test' # of tools/setup.sh
CHECKS=   # process of the checks
RUNS=() # FILE=EXIT_CODE of each run, for count_tests.py

parse() {
    while [ $# -gt 0 ]; do
        case "$1" in
            -h | --help) usage; exit 0 ;;
            --checks) NEED=checks; CTEST[1]='^(long|soak)$'; PYTEST+=("$1") ;;
            --long | --full) NEED=checks; CTEST[1]='^soak$'; PYTEST+=("$1") ;;
            --soak) NEED=checks; CTEST[0]=--label-regex; CTEST[1]='^soak$'; PYTEST+=("$1") ;;
            -k) [ $# -ge 2 ] || die "-k needs a word"; CTEST+=(-R "${2// or /|}"); PYTEST+=(-k "$2"); shift ;;
            *) PYTEST+=("$1") ;;
        esac
        shift
    done
}

run_ctest() {
    local code=0
    ctest --test-dir "$BUILD/host" --parallel "$(nproc)" --output-on-failure --no-tests=ignore --timeout 600 \
        --test-output-size-passed 1000000 --test-output-size-failed 1000000 --output-junit "$BUILD/ctest.xml" \
        "${CTEST[@]}" || code=$?
    RUNS+=("$BUILD/ctest.xml=$code")
}

run_pytest() { # NAME FOLDER...: results in build/NAME.xml
    local name=$1
    shift
    "$VENV/bin/python" -m pytest -c "$ROOT/tests/pytest.ini" "$@" --junitxml "$BUILD/$name.xml" ${PYTEST[@]+"${PYTEST[@]}"}
}

# The checks run at the same time as the Python tests, with lower priority, because some tests run a bus in real time.
start_checks() {
    set -m # a process group for stop_checks
    {
        renice -n 10 -p "$BASHPID" >/dev/null
        run_pytest checks "$ROOT"/tests/{proof,fuzz,static,quality} -n "$(nproc)" --dist loadfile
    } >"$BUILD/checks.log" 2>&1 </dev/null &
    CHECKS=$!
    set +m
    trap stop_checks EXIT
}

stop_checks() { [ -z "$CHECKS" ] || kill -- "-$CHECKS" 2>/dev/null || true; }

end_checks() {
    local code=0
    say "waiting for the checks (log: build/checks.log)"
    wait "$CHECKS" || code=$?
    CHECKS=
    cat "$BUILD/checks.log"
    RUNS+=("$BUILD/checks.xml=$code")
}

# One process more than cores, because many tests wait for a bus in real time.
run_python() {
    local code=0
    run_pytest python "$ROOT/tests/python" -n "$(($(nproc) + 1))" --dist loadfile || code=$?
    RUNS+=("$BUILD/python.xml=$code")
}

parse "$@"
"$ROOT/tools/setup.sh" "$NEED"
build_all
rm -f "$BUILD"/{ctest,python,checks}.xml
run_ctest
if [ "$NEED" = checks ]; then start_checks; fi
run_python
if [ "$NEED" = checks ]; then LEFT_OUT=; end_checks; fi
"$VENV/bin/python" "$ROOT/tools/count_tests.py" "${RUNS[@]}" --note "$LEFT_OUT"
