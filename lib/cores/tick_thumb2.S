/* SPDX-License-Identifier: MIT */
/*
 * dahl_step_counts for ARMv7-M, ARMv7E-M and ARMv8-M Mainline: the tick of lib/model/step_counts.c, same bits. Integers to the
 * end: with an FPU the float's bits go to s0 where the ABI wants them there. What is rare goes to the C: moves of more than
 * 8 counts to dahl_step_large, a torque below 2^-30 Fc and a plan of all zeros to dahl_torque.
 */
#include "update_thumb2.inc"

#define g_high r5
#define sign r4 /* once z is no longer needed */
#define zeros r5 /* leading zeros of |w|, once g_high is no longer needed */
#define Fc_mantissa r12
#define Fc_exponent lr
#define mantissa r3

    function dahl_step_counts
    cmp     n, #8 /* unsigned, so that a negative n is above it */
    bhi     backward
    push    {r4, r5, lr}
    add     r12, plan, n, lsl #3
    ldrd    w_low, w_high, [state]
    ldrd    g_high, g_low, [r12, #TABLE]
    update_forward g_high
    b       torque

backward:
    cmn     n, #8 /* carries for -8 .. -1 alone */
    bcc     large
    push    {r4, r5, lr}
    sub     r12, plan, n, lsl #3
    ldrd    w_low, w_high, [state]
    ldrd    g_high, g_low, [r12, #TABLE]
    update_backward g_high

torque: /* dahl_torque_of in lib/model/torque.h */
    strd    w_low, w_high, [state]
    ands    sign, w_high, #0x80000000
    beq     positive
    rsbs    w_low, w_low, #0
    sbc     w_high, w_high, w_high, lsl #1
positive:
    cbz     w_high, rare
    ldrd    Fc_mantissa, Fc_exponent, [plan, #8]
    cmp     Fc_mantissa, #0
    beq     rare
    clz     zeros, w_high
    lsl     w_high, w_high, zeros
    rsb     r0, zeros, #32 /* a shift by 32 leaves 0 */
    lsr     w_low, w_low, r0
    orr     w_high, w_high, w_low
    orr     Fc_mantissa, Fc_mantissa, #1
    umull   r0, mantissa, w_high, Fc_mantissa
    sub     Fc_exponent, Fc_exponent, zeros
    adds    Fc_exponent, Fc_exponent, #159 /* 2 + 157, which dahl_round_to_float adds */
    cmp     mantissa, #0 /* its top bit, or the next one, is set */
    itt     ge
    lslge   mantissa, mantissa, #1
    subge   Fc_exponent, Fc_exponent, #1
    lsrs    mantissa, mantissa, #8 /* the last bit shifted out, in the carry, rounds to nearest */
    adc     mantissa, mantissa, Fc_exponent, lsl #23
    orr     r0, mantissa, sign
#ifdef __ARM_PCS_VFP
    vmov    s0, r0
#endif
    pop     {r4, r5, pc}

rare:
    pop     {r4, r5, lr}
    b       dahl_torque

large:
    push    {r0, r1, r4, lr}
    bl      dahl_step_large
    pop     {r0, r1, r4, lr}
    b       dahl_torque
    .size dahl_step_counts, . - dahl_step_counts
