# SPDX-License-Identifier: MIT
# Bare-metal Arm gcc for one core: cmake --toolchain port/cortex_m/toolchain.cmake -DDAHL_CORE=m0|m3|m4f|m7|m33
# Sets the core's flags, and QEMU's board with that core as the emulator that CTest runs the tests in.
set(CMAKE_SYSTEM_NAME Generic)
set(CMAKE_SYSTEM_PROCESSOR arm)
set(DAHL_PORT cortex_m)
set(DAHL_CORE "" CACHE STRING "m0, m3, m4f, m7 or m33")
list(APPEND CMAKE_TRY_COMPILE_PLATFORM_VARIABLES DAHL_CORE)
set(CMAKE_TRY_COMPILE_TARGET_TYPE STATIC_LIBRARY)

set(DAHL_CORE_m0 -mcpu=cortex-m0)
set(DAHL_CORE_m3 -mcpu=cortex-m3)
set(DAHL_CORE_m4f -mcpu=cortex-m4 -mfloat-abi=hard -mfpu=fpv4-sp-d16)
set(DAHL_CORE_m7 -mcpu=cortex-m7 -mfloat-abi=hard -mfpu=fpv5-d16)
set(DAHL_CORE_m33 -mcpu=cortex-m33 -mfloat-abi=hard -mfpu=fpv5-sp-d16)
set(DAHL_BOARD_m0 microbit)
set(DAHL_BOARD_m3 mps2-an385)
set(DAHL_BOARD_m4f mps2-an386)
set(DAHL_BOARD_m7 mps2-an500)
set(DAHL_BOARD_m33 mps2-an505)
if(NOT DEFINED DAHL_BOARD_${DAHL_CORE})
    message(FATAL_ERROR "DAHL_CORE is '${DAHL_CORE}'; known are m0, m3, m4f, m7, m33")
endif()
set(DAHL_BOARD ${DAHL_BOARD_${DAHL_CORE}})

find_program(CMAKE_C_COMPILER arm-none-eabi-gcc REQUIRED)
find_program(CMAKE_OBJCOPY arm-none-eabi-objcopy)
list(JOIN DAHL_CORE_${DAHL_CORE} " " dahl_core_flags)
set(CMAKE_C_FLAGS_INIT "-mthumb ${dahl_core_flags}")
set(CMAKE_ASM_FLAGS_INIT "-mthumb ${dahl_core_flags}")

find_program(DAHL_QEMU qemu-system-arm)
set(CMAKE_CROSSCOMPILING_EMULATOR ${DAHL_QEMU} -M ${DAHL_BOARD} -nographic -monitor none -serial none
    -semihosting-config enable=on,target=native -kernel)

set(CMAKE_FIND_ROOT_PATH_MODE_LIBRARY NEVER)
set(CMAKE_FIND_ROOT_PATH_MODE_INCLUDE NEVER)
set(CMAKE_FIND_ROOT_PATH_MODE_PACKAGE NEVER)
