/* SPDX-License-Identifier: MIT */
/* dahl_step_counts() for ARMv7-M, ARMv7E-M and ARMv8-M Mainline: the tick of lib/model/step_counts.c, same bits.
 * Moves of more than 8 counts go to dahl_step_large(). */
#include "../arith/core.h"
#if DAHL_THUMB2_FLOAT
#define g_high r5
#define g_low r12
#include "torque_thumb2.inc"

    function dahl_step_counts
    cmp     n, #8 /* unsigned: a negative n is above 8 */
    bhi     backward
    push    {r4, r5, lr}
    add     r12, plan, n, lsl #3
    ldrd    w_low, w_high, [state]
    ldrd    g_high, g_low, [r12, #TABLE]
11: gap_forward
    bmi     13f
12: update_forward
#ifndef __ARM_FEATURE_DSP
    cmp     w_high, #0 /* UMLAL sets no flags */
#endif
    b       torque

backward:
    cmn     n, #8 /* the carry is set for -8 .. -1 only */
    bcc     large
    push    {r4, r5, lr}
    sub     r12, plan, n, lsl #3
    ldrd    w_low, w_high, [state]
    ldrd    g_high, g_low, [r12, #TABLE]
14: gap_backward
    bmi     16f
15: update_backward

torque:
    return_torque r4, r5

13: clamp_unless_reversal 11b, 12b
16: clamp_unless_reversal 14b, 15b

large:
    return_torque_after dahl_step_large
    .size dahl_step_counts, . - dahl_step_counts
#endif
#include "stack_note.inc"
