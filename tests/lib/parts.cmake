# SPDX-License-Identifier: MIT
# The tests of parts, listed here alone: test_NAME.c runs on the host (CMakeLists.txt beside this) and on each small core (../target).
set(dahl_tests_of_parts slip parallel parts inverse work velocity)
