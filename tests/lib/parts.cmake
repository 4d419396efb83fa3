# SPDX-License-Identifier: MIT
# The tests of parts, listed here alone: test_NAME.c runs on the host (CMakeLists.txt beside this), on each small core (../target),
# and those of the first line with more ticks too (../CMakeLists.txt).
set(dahl_tests_by_ticks slip parallel asymmetric loaded clamped elastoplastic) # each hard motion for TEST_TICKS
set(dahl_tests_of_parts ${dahl_tests_by_ticks} inverse work velocity)
