/* SPDX-License-Identifier: MIT */
/*
 * dahl_parallel_step_counts_q30 for ARMv7-M, ARMv7E-M and ARMv8-M Mainline: the sum of lib/parts/parallel_q30.c, same bits. A
 * part that is a Dahl element is moved in place, by 19 instructions forward and 21 backward. Any other part is called, and so are
 * all of them for a move of more than 8 counts.
 *
 * A Dahl element is told by its function. The reference to it is weak: where no part is one, it is 0, and nothing is linked for it.
 */
#include "../arith/core.h"
#if DAHL_THUMB2
#define g_high r12
#define g_low r0 /* once the plan is no longer needed */
#include "update_thumb2.inc"

#define parts r5
#define shares r6 /* of Q31, negative */
#define count r7
#define counts r8      /* that all parts move by */
#define dahl_element r9 /* dahl_part_move, or 0 where all parts are to be called */
#define sum_low r10
#define sum_high r11
#define move r12 /* until the table is read */
#define w_q30 r4 /* where z was */

    .weak   dahl_part_move

/* Adds w_q30 of this part, at its share, and goes on with the next. */
    .macro add_share next
    ldr     r12, [shares], #4
    smlal   sum_low, sum_high, w_q30, r12
    subs    count, count, #1
    bne     \next
    .endm

/* Move all parts in turn by `gap` and `update`; `add_or_sub` of the counts finds the entry of the table. */
    .macro move_parts add_or_sub, gap, update
1:  ldr     move, [parts], #16
    ldrd    plan, state, [parts, #-12]
    cmp     move, dahl_element
    bne     2f
    \add_or_sub plan, plan, counts, lsl #3
    ldrd    w_low, w_high, [state]
    ldrd    g_high, g_low, [plan, #TABLE]
3:  \gap
    bmi     5f
4:  \update
    strd    w_low, w_high, [state]
    add     w_q30, w_high, w_low, lsr #31
    add_share 1b
    b       finish
2:  mov     n, counts
    blx     move
    add     w_q30, r1, r0, lsr #31
    add_share 1b
    b       finish
5:  clamp_unless_reversal 3b, 4b
    .endm

    function dahl_parallel_step_counts_q30
    push    {r3-r11, lr} /* ten, so that the stack stays aligned for the parts that are called */
    mov     parts, r0
    mov     shares, r1
    mov     counts, r3
    mvn     sum_low, #0x40000000 /* -2^30 - 1: ~(sum - 2^30 - 1) = 2^30 - sum, a half up */
    mvn     sum_high, #0
    movs    count, r2
    beq     finish
    movw    dahl_element, #:lower16:dahl_part_move /* no literal: code may be execute-only */
    movt    dahl_element, #:upper16:dahl_part_move
    cmp     counts, #8 /* unsigned, so that negative ones are above it */
    bhi     not_forward
forward:
    move_parts add, gap_forward, update_forward

not_forward:
    cmn     counts, #8 /* carries for -8 .. -1 alone */
    itt     cc
    movcc   dahl_element, #0
    bcc     forward
    move_parts sub, gap_backward, update_backward

finish:
    adds    sum_low, sum_low, sum_low
    adc     r0, sum_high, sum_high
    mvn     r0, r0
    pop     {r3-r11, pc}
    .size dahl_parallel_step_counts_q30, . - dahl_parallel_step_counts_q30
#endif
#include "stack_note.inc"
