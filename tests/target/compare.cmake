# SPDX-License-Identifier: MIT
# Runs COMMAND; its output must be the lines of the file EXPECTED, of them those that begin with one of the words ONLY where it is
# given, and it must end well.
execute_process(COMMAND ${COMMAND} OUTPUT_VARIABLE printed RESULT_VARIABLE status)
if(ONLY)
    string(REPLACE ";" "|" words "${ONLY}")
    file(STRINGS ${EXPECTED} lines REGEX "^(${words}) ")
else()
    file(STRINGS ${EXPECTED} lines)
endif()
list(JOIN lines "\n" expected)
if(NOT status EQUAL 0)
    message(FATAL_ERROR "ended with ${status}; printed:\n${printed}")
elseif(expected STREQUAL "" OR NOT printed STREQUAL "${expected}\n")
    message(FATAL_ERROR "${EXPECTED} differs from what was printed:\n${printed}")
endif()
