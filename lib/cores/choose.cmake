# SPDX-License-Identifier: MIT
# DAHL_CORE_TICKS: assembly ticks for the target core, if there are any (lib/arith/core.h) and -DDAHL_CORES=OFF is not set.
# Each has the bits of the C tick, which is weak on such a core. They must precede the C ticks in the archive, since the
# linker stops at the first definition.
option(DAHL_CORES "assembly ticks for the target core, if there are any" ON)
set(DAHL_CORE_TICKS "")

# Test whether the C compiler assembles the ticks with the flags of the library: CMAKE_C_FLAGS, and add_compile_options of
# the parent project, which try_compile sees only through a target.
function(dahl_probe_core_ticks result)
    set(CMAKE_TRY_COMPILE_TARGET_TYPE STATIC_LIBRARY) # a bare core cannot link
    set(probe "${CMAKE_CURRENT_BINARY_DIR}/core_ticks.c")
    file(WRITE "${probe}" "
        #include \"${CMAKE_CURRENT_LIST_DIR}/../arith/core.h\"
        #if !DAHL_V6M && !DAHL_THUMB2
        #error no tick is written for this core
        #endif
        #include \"${CMAKE_CURRENT_LIST_DIR}/tick_q30_v6m.S\"
        #include \"${CMAKE_CURRENT_LIST_DIR}/tick_thumb2.S\"\n")
    get_directory_property(options COMPILE_OPTIONS)
    add_library(dahl_probe_flags INTERFACE IMPORTED)
    set_target_properties(dahl_probe_flags PROPERTIES INTERFACE_COMPILE_OPTIONS "${options};SHELL:-x assembler-with-cpp")
    unset(assembled CACHE) # flags may have changed since the last run
    try_compile(assembled "${CMAKE_CURRENT_BINARY_DIR}/core_ticks" "${probe}" LINK_LIBRARIES dahl_probe_flags)
    set(${result} ${assembled} PARENT_SCOPE)
    unset(assembled CACHE)
endfunction()

set(chosen "C")
if(DAHL_CORES AND CMAKE_C_COMPILER_ID MATCHES "GNU|Clang")
    dahl_probe_core_ticks(has_core_ticks)
    if(has_core_ticks)
        set(chosen "assembly, if lib/cores has them for this core")
        file(GLOB DAHL_CORE_TICKS ${CMAKE_CURRENT_LIST_DIR}/*.S)
        set_source_files_properties(${DAHL_CORE_TICKS} PROPERTIES LANGUAGE C COMPILE_OPTIONS "-x;assembler-with-cpp"
            COMPILE_DEFINITIONS DAHL_SAME_FLAGS SKIP_UNITY_BUILD_INCLUSION ON SKIP_PRECOMPILE_HEADERS ON SKIP_LINTING ON)
        list(APPEND DAHL_CORE_TICKS cores/work_large.c)
    endif()
endif()
message(STATUS "dahl: ticks in ${chosen}")
