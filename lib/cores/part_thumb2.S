/* SPDX-License-Identifier: MIT */
/* dahl_part_move() for ARMv7-M, ARMv7E-M and ARMv8-M Mainline: the move of lib/parts/part_move.c, same bits. The
 * returned state is still in registers when it is stored. Moves of more than 8 counts go to dahl_step_large(). */
#include "../arith/core.h"
#if DAHL_THUMB2
#define g_high r12
#define g_low r0 /* once the plan is no longer needed */
#include "update_thumb2.inc"

    .macro return_w
    strd    w_low, w_high, [state]
    mov     r0, w_low
    mov     r1, w_high
    pop     {r4, pc}
    .endm

    function dahl_part_move
    move_up_to_8_counts return_w

large:
    push    {r4, lr}
    mov     r4, state
    bl      dahl_step_large
    ldrd    r0, r1, [r4]
    pop     {r4, pc}
    .size dahl_part_move, . - dahl_part_move
#endif
#include "stack_note.inc"
