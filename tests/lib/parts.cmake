# SPDX-License-Identifier: MIT
# Tests of parts and the compensator that run on the host (CMakeLists.txt) and on each small core (../target).
set(dahl_tests_of_parts parallel work compensator)
