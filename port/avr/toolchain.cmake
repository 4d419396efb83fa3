# SPDX-License-Identifier: MIT
# Bare-metal avr-gcc with avr-libc, ATmega2560: int has 16 bits. cmake --toolchain port/avr/toolchain.cmake -DDAHL_CORE=avr
set(CMAKE_SYSTEM_NAME Generic)
set(CMAKE_SYSTEM_PROCESSOR avr)
set(DAHL_PORT avr)
set(DAHL_CORE "avr" CACHE STRING "avr")
list(APPEND CMAKE_TRY_COMPILE_PLATFORM_VARIABLES DAHL_CORE)
set(CMAKE_TRY_COMPILE_TARGET_TYPE STATIC_LIBRARY)
if(NOT DAHL_CORE STREQUAL "avr")
    message(FATAL_ERROR "DAHL_CORE is '${DAHL_CORE}'; it must be avr")
endif()

find_program(CMAKE_C_COMPILER avr-gcc REQUIRED)
set(CMAKE_C_FLAGS_INIT "-mmcu=atmega2560")
set(CMAKE_ASM_FLAGS_INIT "-mmcu=atmega2560")

# An image cannot end QEMU on this board: run.py ends it.
set(CMAKE_CROSSCOMPILING_EMULATOR python3 ${CMAKE_CURRENT_LIST_DIR}/run.py)

set(CMAKE_FIND_ROOT_PATH_MODE_LIBRARY NEVER)
set(CMAKE_FIND_ROOT_PATH_MODE_INCLUDE NEVER)
set(CMAKE_FIND_ROOT_PATH_MODE_PACKAGE NEVER)
