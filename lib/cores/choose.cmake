# SPDX-License-Identifier: MIT
# The ticks written for the core that is compiled for: DAHL_CORE_TICKS, files of lib/cores that take the place of those in
# DAHL_CORE_STANDS_FOR, with the same bits. Both are empty where there are none, or with -DDAHL_CORES=OFF: then
# the C is used.
option(DAHL_CORES "ticks written for the core, where there are any" ON)
set(DAHL_CORE_TICKS "")
set(DAHL_CORE_STANDS_FOR "")
if(DAHL_CORES AND CMAKE_C_COMPILER_ID MATCHES "GNU|Clang")
    include(CheckCSourceCompiles)
    set(CMAKE_TRY_COMPILE_TARGET_TYPE STATIC_LIBRARY) # a bare core has nothing to link with
    check_c_source_compiles("
        #if !defined(__ARM_ARCH_6M__) && !defined(__ARM_ARCH_8M_BASE__)
        #error
        #endif
        int dahl_core;" DAHL_CORE_IS_V6M)
    check_c_source_compiles("
        #if !defined(__thumb2__) || !defined(__ARM_ARCH_PROFILE) || __ARM_ARCH_PROFILE != 'M'
        #error
        #endif
        int dahl_core;" DAHL_CORE_IS_THUMB2)
    if(DAHL_CORE_IS_V6M)
        set(DAHL_CORE_TICKS cores/tick_q30_v6m.S)
        set(DAHL_CORE_STANDS_FOR model/step_counts_q30.c)
    elseif(DAHL_CORE_IS_THUMB2)
        set(DAHL_CORE_TICKS cores/tick_q30_thumb2.S cores/tick_thumb2.S cores/part_thumb2.S cores/parallel_q30_thumb2.S
            cores/work_thumb2.S cores/work_large.c)
        set(DAHL_CORE_STANDS_FOR model/step_counts_q30.c model/step_counts.c parts/part_move.c
            parts/parallel_q30.c parts/work_step.c)
    endif()
endif()
if(DAHL_CORE_TICKS)
    enable_language(ASM)
endif()
