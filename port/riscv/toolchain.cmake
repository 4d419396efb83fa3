# SPDX-License-Identifier: MIT
# Bare-metal RISC-V gcc with picolibc, RV32IMAC without FPU: cmake --toolchain port/riscv/toolchain.cmake -DDAHL_CORE=rv32
set(CMAKE_SYSTEM_NAME Generic)
set(CMAKE_SYSTEM_PROCESSOR riscv)
set(DAHL_PORT riscv)
set(DAHL_CORE "rv32" CACHE STRING "rv32")
list(APPEND CMAKE_TRY_COMPILE_PLATFORM_VARIABLES DAHL_CORE)
set(CMAKE_TRY_COMPILE_TARGET_TYPE STATIC_LIBRARY)
if(NOT DAHL_CORE STREQUAL "rv32")
    message(FATAL_ERROR "DAHL_CORE is '${DAHL_CORE}'; it must be rv32")
endif()

find_program(CMAKE_C_COMPILER riscv64-unknown-elf-gcc REQUIRED)
set(CMAKE_C_FLAGS_INIT "-march=rv32imac -mabi=ilp32 --specs=picolibc.specs")
set(CMAKE_ASM_FLAGS_INIT "-march=rv32imac -mabi=ilp32")

find_program(DAHL_QEMU qemu-system-riscv32)
set(CMAKE_CROSSCOMPILING_EMULATOR ${DAHL_QEMU} -M virt -bios none -nographic -monitor none -serial none
    -semihosting-config enable=on,target=native -kernel)

set(CMAKE_FIND_ROOT_PATH_MODE_LIBRARY NEVER)
set(CMAKE_FIND_ROOT_PATH_MODE_INCLUDE NEVER)
set(CMAKE_FIND_ROOT_PATH_MODE_PACKAGE NEVER)
