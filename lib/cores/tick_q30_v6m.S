/* SPDX-License-Identifier: MIT */
/* dahl_step_counts_q30() for ARMv6-M and ARMv8-M Baseline: the tick of lib/model/step_counts_q30.c, same bits. 59
 * instructions forward and 61 backward, one more at a reversal from the end. A compiler needs more, since it runs
 * out of the eight low registers. */
#include "../arith/core.h"
#if DAHL_V6M
#include "update_v6m.inc"

    .macro return_q30
    lsrs    r0, r2, #31
    adds    r0, r0, r3
    pop     {r4-r7, pc}
    .endm

    .section .text.dahl_step_counts_q30, "ax", %progbits
    .global dahl_step_counts_q30
    .type dahl_step_counts_q30, %function
    .thumb_func
    .balign 4
dahl_step_counts_q30:
    move_up_to_8_counts return_q30
    ldr     r3, =dahl_step_large /* any other move */
    bx      r3
    .pool
    .size dahl_step_counts_q30, . - dahl_step_counts_q30
#endif
#include "stack_note.inc"
