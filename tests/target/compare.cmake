# SPDX-License-Identifier: MIT
# Run COMMAND. It must succeed and print the lines of the file EXPECTED. If ONLY is given, the lines are those that begin with one
# of its words.
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
