#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# Usage: tools/test.sh [--long] [-k WORD] [pytest arguments]
#
# Sets up, builds with preset host, runs the C tests (CTest) and then the Python tests (pytest), and ends with a line
#   N passed, N failed, N skipped
# that counts single tests of both, after naming each failed and each skipped one. Exit code 0 only when none failed.
#   --long     also the tests marked long (all 2^31 floats, longer random motions)
#   -k WORD    only tests whose name has WORD, in C and in Python
# Examples:  tools/test.sh                 all but the long ones
#            tools/test.sh -k codec -x     those about the codec, pytest stopping at the first failure
# Leaves: build/ctest.xml and build/pytest.xml (JUnit), build/build.log
set -euo pipefail
# shellcheck source=tools/common.sh
source "$(dirname "${BASH_SOURCE[0]}")/common.sh"

CTEST=(--label-exclude '^long$')
PYTEST=()

parse() {
    while [ $# -gt 0 ]; do
        case "$1" in
            -h | --help) usage; exit 0 ;;
            --long) CTEST=("${CTEST[@]:2}"); PYTEST+=(--long) ;;
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

run_pytest() {
    "$VENV/bin/python" -m pytest "$ROOT/tests/python" --junitxml "$BUILD/pytest.xml" \
        ${PYTEST[@]+"${PYTEST[@]}"} || true
}

parse "$@"
"$ROOT/tools/setup.sh"
configure_and_build
rm -f "$BUILD/ctest.xml" "$BUILD/pytest.xml"
run_ctest
run_pytest
"$VENV/bin/python" "$ROOT/tools/count_tests.py" "$BUILD/ctest.xml" "$BUILD/pytest.xml"
