/* SPDX-License-Identifier: MIT */
/* dahl_step_counts_q30() for ARMv7-M, ARMv7E-M and ARMv8-M Mainline: the tick of lib/model/step_counts_q30.c, same
 * bits. 16 instructions forward and 19 backward; 15 forward if the core has UMAAL. Moves of more than 8 counts go
 * to dahl_step_large() with unchanged arguments. */
#include "../arith/core.h"
#if DAHL_THUMB2
#define g_high r12
#define g_low r0 /* once the plan is no longer needed */
#include "update_thumb2.inc"

    .macro return_q30
    strd    w_low, w_high, [state]
    add     r0, w_high, w_low, lsr #31
    pop     {r4, pc}
    .endm

    function dahl_step_counts_q30
    move_up_to_8_counts return_q30

large:
    b       dahl_step_large
    .size dahl_step_counts_q30, . - dahl_step_counts_q30
#endif
#include "stack_note.inc"
