/* SPDX-License-Identifier: MIT */
/*
 * dahl_step_counts_q30() for ARMv6-M and ARMv8-M Baseline: the tick of lib/model/step_counts_q30.c, same bits. 59
 * instructions forward and 61 backward, one more at a reversal from the end. A compiler needs more, since it runs
 * out of the eight low registers.
 *
 * Forward, a move of n = 0 .. 8 counts, g = plan->g[n] = g_high 2^-32 + g_low 2^-64:
 *     z = 2^30 - q,  q = w in Q30, a half rounded up          the gap to +Fc, in Q30
 *     w += z g_high + floor(z g_low 2^-32)
 * Backward, n = -1 .. -8, is its mirror image: z = 2^30 + q is the gap to -Fc, and the product is subtracted. Any
 * other move goes to dahl_step_large() with unchanged arguments.
 *
 * If the state is in range, z is 0 .. 2^31 (dahl_is_gap). One branch on the top bit of z therefore finds both z =
 * 2^31, a reversal from the end, and every state out of range.
 *
 * The core multiplies to 32 bits, so z = z1:z0 and each word of g are split into halves of 16 bits. Since z <=
 * 2^31, z1 <= 2^15, and the marked sums do not carry.
 */
#include "../arith/core.h"
#if DAHL_V6M
    .syntax unified
    .thumb

#define TABLE 16 /* [byte] offset of the table of g in the plan; an entry is g_high, g_low */

/* In: r0 the plan plus eight bytes for each count, r1 the state, r4 z. `add` is adds or subs, `add_carry` adcs or
 * sbcs. Returns from the tick with w in Q30. */
    .macro update add, add_carry
    lsrs    r5, r4, #16 /* z1 */
    uxth    r4, r4      /* z0 */
3:  ldr     r6, [r0, #TABLE + 4]
    lsrs    r7, r6, #16 /* g_low = r7:r6 */
    uxth    r6, r6
    movs    r2, r4
    muls    r2, r6, r2
    lsrs    r2, r2, #16
    muls    r6, r5, r6
    adds    r6, r6, r2  /* z g_low from bit 16 on, without z0 times its upper half: no carry */
    movs    r2, r4
    muls    r2, r7, r2
    muls    r7, r5, r7
    uxth    r3, r6
    adds    r2, r2, r3  /* no carry */
    lsrs    r2, r2, #16
    lsrs    r6, r6, #16
    adds    r7, r7, r2
    adds    r7, r7, r6  /* floor(z g_low 2^-32): no carry */
    ldr     r6, [r0, #TABLE]
    lsrs    r0, r6, #16 /* g_high = r0:r6 */
    uxth    r6, r6
    ldmia   r1!, {r2, r3} /* w */
    \add    r2, r2, r7
    movs    r7, #0      /* keeps the carry, and so do the products */
    \add_carry r3, r3, r7
    movs    r7, r4
    muls    r7, r6, r7
    muls    r6, r5, r6
    muls    r4, r0, r4
    muls    r0, r5, r0
    \add    r2, r2, r7
    \add_carry r3, r3, r0
    lsls    r7, r6, #16
    lsrs    r6, r6, #16
    \add    r2, r2, r7
    \add_carry r3, r3, r6
    lsls    r7, r4, #16
    lsrs    r4, r4, #16
    \add    r2, r2, r7
    \add_carry r3, r3, r4
    subs    r1, r1, #8
    stmia   r1!, {r2, r3}
    lsrs    r0, r2, #31
    adds    r0, r0, r3
    pop     {r4-r7, pc}
    .endm

/* Target of the branch on the top bit of z. If z = 2^31, continue in `update`. Otherwise clamp the state to +-2^62
 * on its side and continue at `gap`. */
    .macro reverse_or_clamp gap
    lsrs    r5, r4, #16
    lsls    r4, r4, #1 /* z0 = 0 if z is 2^31 */
    beq     3b
    ldr     r3, [r1, #4]
    lsrs    r3, r3, #31
    lsls    r3, r3, #31
    movs    r2, #1
    lsls    r2, r2, #30
    orrs    r3, r3, r2
    movs    r2, #0
    stmia   r1!, {r2, r3}
    subs    r1, r1, #8
    b       \gap
    .endm

    .section .text.dahl_step_counts_q30, "ax", %progbits
    .global dahl_step_counts_q30
    .type dahl_step_counts_q30, %function
    .thumb_func
    .balign 4
dahl_step_counts_q30:
    cmp     r2, #8 /* unsigned: a negative n is above 8 */
    bhi     backward
    push    {r4-r7, lr}
    lsls    r2, r2, #3
    adds    r0, r0, r2
1:  ldr     r2, [r1, #0]
    ldr     r3, [r1, #4]
    lsrs    r2, r2, #31
    adds    r3, r3, r2
    movs    r4, #1
    lsls    r4, r4, #30
    subs    r4, r4, r3
    bmi     2f
    update adds, adcs
2:  reverse_or_clamp 1b

backward:
    negs    r2, r2
    cmp     r2, #8
    bhi     large
    push    {r4-r7, lr}
    lsls    r2, r2, #3
    adds    r0, r0, r2
1:  ldr     r2, [r1, #0]
    ldr     r3, [r1, #4]
    movs    r4, #1
    lsls    r4, r4, #30
    lsls    r2, r2, #1 /* the carry rounds w up */
    adcs    r4, r4, r3
    bmi     2f
    update subs, sbcs
2:  reverse_or_clamp 1b

large:
    negs    r2, r2
    ldr     r3, =dahl_step_large
    bx      r3
    .pool
    .size dahl_step_counts_q30, . - dahl_step_counts_q30
#endif
#include "stack_note.inc"
