/* SPDX-License-Identifier: MIT */
/* See call.h. */
    .text
    .global bench_call, bench_site, bench_back
    .type bench_call, @function
bench_call:
    addi sp, sp, -16
    sw ra, 12(sp)
    la t0, bench_sp
    sw sp, 0(t0)
    la t0, bench_function
    lw t0, 0(t0)
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

    .global bench_paint
    .type bench_paint, @function
bench_paint:
    sub a0, sp, a0
    mv a2, sp
1:  addi a2, a2, -4
    sw a1, 0(a2)
    bgtu a2, a0, 1b
    ret
