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
    ldr r4, =bench_function
    ldr r4, [r4]
    str r4, [sp] /* shows the plugin the stack pointer */
bench_site:
    blx r4
bench_back:
    pop {r3, r4, r5, pc}

    .global bench_mark
    .type bench_mark, %function
    .thumb_func
bench_mark:
    bx lr
    .ltorg
