/* SPDX-License-Identifier: MIT */
/* See call.h. Thumb-1 only, so that all Cortex-M can run it. */
    .syntax unified
    .thumb
    .text

    .global bench_call, bench_site, bench_back
    .type bench_call, %function
    .thumb_func
bench_call:
    push {r3, r4, r5, lr}
    ldr r4, =bench_sp
    mov r5, sp
    str r5, [r4]
    ldr r4, =bench_function
    ldr r4, [r4]
bench_site:
    blx r4
bench_back:
    pop {r3, r4, r5, pc}

    .global bench_mark
    .type bench_mark, %function
    .thumb_func
bench_mark:
    bx lr

    .global bench_paint
    .type bench_paint, %function
    .thumb_func
bench_paint:
    mov r2, sp
    subs r0, r2, r0
1:  subs r2, r2, #4
    str r1, [r2]
    cmp r2, r0
    bhi 1b
    bx lr
    .ltorg
