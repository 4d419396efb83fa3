/* SPDX-License-Identifier: MIT */
/* dahl_work_step_counts() and dahl_work_step_counts_q30() for ARMv7-M, ARMv7E-M and ARMv8-M Mainline: the ticks of
 * lib/parts/work_step.c, same bits. The product that the update adds or subtracts is the path of w in the direction
 * of travel, so no difference is needed. Moves of more than 8 counts go to dahl_work_step_large(). */
#include "../arith/core.h"
#if DAHL_THUMB2
#define g_high r5
#define g_low r12
#include "torque_thumb2.inc"

#define work r2
#define counts r3
#define sums r6 /* work, since w needs its register */
#define low r4 /* two words of a sum, before z and g_high are needed */
#define high r5

#define COUNTS 0 /* [byte] offsets of the lowest words of both sums */
#define WAY 12

/* From the entry to the update of w, whose sign is left in the flags. `add_or_sub` of the signed counts makes the
 * sum larger. */
    .macro sum_up_and_update add_or_sub, gap, update
    push    {r4-r6, lr}
    \add_or_sub r12, plan, counts, lsl #3
    mov     sums, work
    ldr     low, [sums, #COUNTS]
    \add_or_sub\()s low, low, counts
    str     low, [sums, #COUNTS]
    bcs     13f /* for subtracted negative counts too: no borrow means that the sum carries */
11: ldrd    w_low, w_high, [state]
    ldrd    g_high, g_low, [r12, #TABLE]
15: \gap
    bmi     17f
16: product
    ldrd    low, high, [sums, #WAY]
    adds    low, low, g_low
    adcs    high, high, spare
    strd    low, high, [sums, #WAY]
    bcs     14f
12: \update
    .endm

/* Add one to the upper words of a sum; rare. */
    .macro carry words, back
    ldrd    low, high, [sums, #\words]
    adds    low, low, #1
    adc     high, high, #0
    strd    low, high, [sums, #\words]
    b       \back
    .endm

/* Rare targets of sum_up_and_update. */
    .macro rare
13: carry   COUNTS + 4, 11b
14: carry   WAY + 8, 12b
17: clamp_unless_reversal 15b, 16b
    .endm

    .macro return_q30
    strd    w_low, w_high, [state]
    add     r0, w_high, w_low, lsr #31
    pop     {r4-r6, pc}
    .endm

    function dahl_work_step_counts_q30
    cmp     counts, #8 /* unsigned: negative counts are above 8 */
    bhi     backward_q30
    sum_up_and_update add, gap_forward, add_product
    return_q30
    rare
backward_q30:
    cmn     counts, #8 /* the carry is set for -8 .. -1 only */
    bcc     large_q30
    sum_up_and_update sub, gap_backward, subtract_product
    return_q30
    rare
large_q30:
    b       dahl_work_step_large
    .size dahl_work_step_counts_q30, . - dahl_work_step_counts_q30

#if DAHL_THUMB2_FLOAT
    function dahl_work_step_counts
    cmp     counts, #8
    bhi     backward
    sum_up_and_update add, gap_forward, add_product
    b       torque
    rare
backward:
    cmn     counts, #8
    bcc     large
    sum_up_and_update sub, gap_backward, subtract_product
torque:
    return_torque r4-r6
    rare
large:
    return_torque_after dahl_work_step_large
    .size dahl_work_step_counts, . - dahl_work_step_counts
#endif
#endif
#include "stack_note.inc"
