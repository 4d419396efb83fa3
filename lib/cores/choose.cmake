# SPDX-License-Identifier: MIT
# DAHL_TICK_SOURCE: the tick written for the core that is compiled for, which takes the place of model/step_counts_q30.c with
# the same bits. Empty where there is none, or with -DDAHL_CORES=OFF: then the C is used.
option(DAHL_CORES "ticks written for the core, where there is one" ON)
set(DAHL_TICK_SOURCE "")
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
        set(DAHL_TICK_SOURCE cores/tick_v6m.S)
    elseif(DAHL_CORE_IS_THUMB2)
        set(DAHL_TICK_SOURCE cores/tick_thumb2.S)
    endif()
endif()
if(DAHL_TICK_SOURCE)
    enable_language(ASM)
endif()
