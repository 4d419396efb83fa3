/* SPDX-License-Identifier: MIT */
/* See call.h. */
    .text
    .global bench_call, bench_site, bench_back
    .type bench_call, @function
bench_call:
    addi sp, sp, -16
    sw ra, 12(sp)
    la t0, bench_function
    lw t0, 0(t0)
    sw t0, 0(sp) # shows the plugin the stack pointer
bench_site:
    jalr t0
bench_back:
    lw ra, 12(sp)
    addi sp, sp, 16
    ret

    .global bench_mark
    .type bench_mark, @function
bench_mark:
    ret
