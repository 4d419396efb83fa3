/* SPDX-License-Identifier: MIT */
/*
 * dahl_parallel_step_counts_q30() for ARMv7-M, ARMv7E-M and ARMv8-M Mainline: the sum of lib/parts/parallel_q30.c,
 * same bits. A Dahl element is moved inline, with 19 instructions forward and 21 backward. Any other part is
 * called. If the move is more than 8 counts, all parts are called.
 *
 * A part is a Dahl element if its function is dahl_part_move. The reference to it is weak: if no part is a Dahl
 * element, it is 0 and links nothing.
 */
#include "../arith/core.h"
#if DAHL_THUMB2
#define g_high r12
#define g_low r0 /* once the plan is no longer needed */
#include "update_thumb2.inc"

#define parts r5
#define shares r6 /* [Q31] negative */
#define count r7
#define counts r8      /* the move of all parts */
#define dahl_element r9 /* dahl_part_move, or 0 if all parts must be called */
#define sum_low r10
#define sum_high r11
#define move r12 /* until the table is read */
#define w_q30 r4 /* in the register of z */

    .weak   dahl_part_move

/* Add w_q30 of this part times its share, and continue with the next part. */
    .macro add_share next
    ldr     r12, [shares], #4
    smlal   sum_low, sum_high, w_q30, r12
    subs    count, count, #1
    bne     \next
    .endm

/* Move all parts by `gap` and `update`. `add_or_sub` applies the counts to the address of the table entry. */
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
    push    {r3-r11, lr} /* ten registers keep the stack aligned for the called parts */
    mov     parts, r0
    mov     shares, r1
    mov     counts, r3
    mvn     sum_low, #0x40000000 /* -2^30 - 1: ~(sum - 2^30 - 1) = 2^30 - sum, a half rounded up */
    mvn     sum_high, #0
    movs    count, r2
    beq     finish
    movw    dahl_element, #:lower16:dahl_part_move /* no literal, since code may be execute-only */
    movt    dahl_element, #:upper16:dahl_part_move
    cmp     counts, #8 /* unsigned: negative counts are above 8 */
    bhi     not_forward
forward:
    move_parts add, gap_forward, update_forward

not_forward:
    cmn     counts, #8 /* the carry is set for -8 .. -1 only */
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
