/* SPDX-License-Identifier: MIT */
/* Start-up of the first hart. A trap ends the emulator with status 70. */
    .section .reset, "ax"
    .global reset_handler, built_for_rv32
#if __riscv_xlen == 32 && !defined(__riscv_flen)
    .equ built_for_rv32, 1
#else
#error "port/riscv is for RV32 without FPU"
#endif
reset_handler:
    .option push
    .option norelax
    la gp, global_pointer
    .option pop
    la sp, stack_top
    la tp, bss_start
    la t0, trap
    .option arch, +zicsr
    csrw mtvec, t0
    la t0, bss_start
    la t1, bss_end
1:  bgeu t0, t1, 2f
    sw zero, 0(t0)
    addi t0, t0, 4
    j 1b
2:  call main
    j semihosting_exit
    .balign 4
trap:
    li a0, 70
    j semihosting_exit
