# SPDX-License-Identifier: MIT
# Write the main of a Unity test file. It runs all `static void test_...(void)` in their order.
# dahl_unity_main(a.c main_of_a.c), or cmake -DSOURCE=a.c -DMAIN=main_of_a.c -P unity_main.cmake
function(dahl_unity_main source main)
    file(STRINGS "${source}" heads REGEX "^static void test_[A-Za-z0-9_]+\\(void\\)")
    string(REGEX MATCHALL "static void test_[A-Za-z0-9_]+" heads "${heads}")
    list(TRANSFORM heads REPLACE "static void (.*)" "    RUN_TEST(\\1)")
    string(JOIN ";\n" calls ${heads} "")
    set(text "#include \"${source}\"\n\n")
    foreach(hook setUp tearDown)
        file(STRINGS "${source}" own REGEX "^void ${hook}\\(void\\)")
        if(NOT own)
            string(APPEND text "void ${hook}(void) {}\n")
        endif()
    endforeach()
    string(APPEND text "\nint main(void)\n{\n    UnityBegin(\"${source}\");\n${calls}    return UNITY_END();\n}\n")
    file(CONFIGURE OUTPUT "${main}" CONTENT "${text}" @ONLY)
endfunction()

if(CMAKE_SCRIPT_MODE_FILE)
    dahl_unity_main("${SOURCE}" "${MAIN}")
endif()
