# SPDX-License-Identifier: MIT
# Runs COMMAND; its output must be the file EXPECTED, up to the word UNTIL where one is given, and it must end well.
execute_process(COMMAND ${COMMAND} OUTPUT_VARIABLE printed RESULT_VARIABLE status)
file(READ ${EXPECTED} expected)
if(UNTIL)
    string(FIND "${expected}" "${UNTIL}" length)
    string(SUBSTRING "${expected}" 0 ${length} expected)
endif()
if(NOT status EQUAL 0)
    message(FATAL_ERROR "ended with ${status}; printed:\n${printed}")
elseif(NOT printed STREQUAL expected)
    message(FATAL_ERROR "${EXPECTED} differs from what was printed:\n${printed}")
endif()
