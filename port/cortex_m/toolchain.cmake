# SPDX-License-Identifier: MIT
# Bare-metal Arm gcc for one core: cmake --toolchain port/cortex_m/toolchain.cmake -DDAHL_CORE=m4f
# Set the flags of the core, and QEMU's board with this core as CTest's emulator.
set(CMAKE_SYSTEM_NAME Generic)
set(CMAKE_SYSTEM_PROCESSOR arm)
set(DAHL_PORT cortex_m)
set(DAHL_CORE "" CACHE STRING "one of the cores below")
list(APPEND CMAKE_TRY_COMPILE_PLATFORM_VARIABLES DAHL_CORE)
set(CMAKE_TRY_COMPILE_TARGET_TYPE STATIC_LIBRARY)

# dahl_core(NAME BOARD FLAG...): a core, QEMU's board with it, and gcc's flags. After a change, run tools/generators/facts.py.
set(dahl_cores "")
macro(dahl_core name board)
    list(APPEND dahl_cores ${name})
    set(DAHL_BOARD_${name} ${board})
    set(DAHL_CORE_${name} ${ARGN})
endmacro()
dahl_core(m0 microbit -mcpu=cortex-m0)
dahl_core(m3 mps2-an385 -mcpu=cortex-m3)
dahl_core(m4f mps2-an386 -mcpu=cortex-m4 -mfloat-abi=hard -mfpu=fpv4-sp-d16)
dahl_core(m7 mps2-an500 -mcpu=cortex-m7 -mfloat-abi=hard -mfpu=fpv5-d16)
dahl_core(m33 mps2-an505 -mcpu=cortex-m33 -mfloat-abi=hard -mfpu=fpv5-sp-d16)
if(NOT DEFINED DAHL_BOARD_${DAHL_CORE})
    list(JOIN dahl_cores ", " dahl_cores)
    message(FATAL_ERROR "DAHL_CORE is '${DAHL_CORE}'; it must be one of ${dahl_cores}")
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
