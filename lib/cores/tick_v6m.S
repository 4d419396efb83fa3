/* SPDX-License-Identifier: MIT */
/* dahl_step_counts() for ARMv6-M and ARMv8-M Baseline: the tick of lib/model/step_counts.c, same bits. */
#include "../arith/core.h"
#if DAHL_V6M
#include "torque_v6m.inc"
#include "update_v6m.inc"

    .macro return_F
    mov     r0, r12
    return_torque
    .endm

    .section .text.dahl_step_counts, "ax", %progbits
    .global dahl_step_counts
    .type dahl_step_counts, %function
    .thumb_func
    .balign 4
dahl_step_counts:
    mov     r12, r0 /* the plan */
    move_up_to_8_counts return_F
    push    {r0, r1, r4, lr} /* any other move */
    bl      dahl_step_large
    pop     {r0, r1}
    bl      dahl_torque
    pop     {r4, pc}
    .size dahl_step_counts, . - dahl_step_counts
#endif
#include "stack_note.inc"
