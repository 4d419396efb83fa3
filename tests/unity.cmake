# SPDX-License-Identifier: MIT
# Unity (ThrowTheSwitch), the C unit-test framework: a directory given as DAHL_UNITY_DIR, else an installed package, else
# build/deps/unity where tools/setup.sh puts Debian's copy, else a pinned download.
set(DAHL_UNITY_DIR "" CACHE PATH "directory with unity.c and unity.h")

function(dahl_find_unity)
    set(dir "${DAHL_UNITY_DIR}")
    if(NOT dir AND EXISTS "${PROJECT_SOURCE_DIR}/build/deps/unity/unity.c")
        set(dir "${PROJECT_SOURCE_DIR}/build/deps/unity")
    endif()
    if(NOT dir)
        find_package(unity QUIET)
        if(TARGET unity::framework)
            add_library(dahl_unity INTERFACE)
            target_link_libraries(dahl_unity INTERFACE unity::framework)
            return()
        endif()
        include(FetchContent)
        FetchContent_Declare(unity GIT_REPOSITORY https://github.com/ThrowTheSwitch/Unity.git GIT_TAG v2.6.1)
        FetchContent_Populate(unity)
        set(dir "${unity_SOURCE_DIR}/src")
    endif()
    add_library(dahl_unity STATIC "${dir}/unity.c")
    target_include_directories(dahl_unity SYSTEM PUBLIC "${dir}")
    target_compile_definitions(dahl_unity PUBLIC UNITY_INCLUDE_DOUBLE)
endfunction()

dahl_find_unity()

# One test file, one executable, one CTest entry: dahl_unity_test(name SOURCES a.c LIBS dahl::dahl)
function(dahl_unity_test name)
    cmake_parse_arguments(arg "" "" "SOURCES;LIBS" ${ARGN})
    add_executable(${name} ${arg_SOURCES})
    target_link_libraries(${name} PRIVATE ${arg_LIBS} dahl_unity)
    dahl_strict(${name})
    target_compile_options(${name} PRIVATE -Wno-double-promotion) # references are long double
    add_test(NAME ${name} COMMAND ${name})
    set_tests_properties(${name} PROPERTIES LABELS unity TIMEOUT 300)
endfunction()
