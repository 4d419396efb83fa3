/* SPDX-License-Identifier: MIT */
/*
 * dahl_step() for ARMv7-M, ARMv7E-M and ARMv8-M Mainline: the tick of lib/model/step_angle.c, same bits.
 * lib/model/kernel.h explains v = hi 2^(-32 - shift), Q and g.
 *
 * From the test of the shift to the update, the carry is the sign of the angle: forward, or backward if set. No
 * instruction between them changes it; TST does not, for masks of this form (two equal halves of 16 bits).
 */
#include "../arith/core.h"
#if DAHL_THUMB2_FLOAT
#define g_high r5
#define g_low r12
#include "torque_thumb2.inc"

#define bits r2 /* of the angle, until w is loaded */
#define v_shift r3 /* the same; large travel keeps k here until then */
#define hi r4 /* until g is known */
#define f lr
#define Q r8
#define UNUSUAL_SMALL 0x00e000e0 /* no bit is set for shifts of 0 .. 31, one is for all others and for far plans */
#define UNUSUAL_LARGE 0x00f800f8 /* the same for 0 .. 7, the shift + 8 of large travel */
#define FAR 0x600000     /* DAHL_FAR */
#define FAR_SHIFT 0x1000 /* above all shifts but those of far plans */

#ifdef __ARM_PCS_VFP
#define TAKE_ANGLE vmov bits, s0
#else
#define TAKE_ANGLE
#endif

/* Q(f), with y in a register of choice. Uses r5 - r8 and r12. LDM does not load its base: it can be repeated after an
 * interrupt on every core. */
    .macro cubic y
    ldr     r12, =dahl_kernel_cubics
    lsr     r5, f, #28
    add     r12, r12, r5, lsl #4
    ldm     r12, {r5-r8} /* of y^3, y^2, y, 1 */
    bic     \y, f, #0xf0000000
#ifdef __ARM_FEATURE_DSP
    smmla   r6, \y, r5, r6
    smmla   r7, \y, r6, r7
    smmla   Q, \y, r7, Q
#else
    smull   r12, r5, \y, r5
    add     r6, r6, r5
    smull   r12, r6, \y, r6
    add     r7, r7, r6
    smull   r12, r7, \y, r7
    add     Q, Q, r7
#endif
    .endm

/* Branch if z is above 2^31: the state is out of range. */
    .macro check_gap out_of_range
    cmp     z, #0x80000000
    bhi     \out_of_range
    .endm

    .macro set_sign_of_w
#ifndef __ARM_FEATURE_DSP
    cmp     w_high, #0
#endif
    .endm

    function dahl_step
    TAKE_ANGLE
    push    {r4-r8, lr}
    ldrd    hi, v_shift, [plan] /* a_mantissa, a_exponent */
    lsl     r5, bits, #8
    orr     r5, r5, #0x80000000
    umull   r12, hi, hi, r5
    lsls    r5, bits, #1 /* the carry is the sign */
    add     v_shift, v_shift, r5, lsr #24
    rsb     v_shift, v_shift, #94
by_shift:
    tst     v_shift, #UNUSUAL_SMALL
    bne     not_small

    /* v < 1: g = v Q(v). After the product with Q, hi 2^-shift is g in Q32. */
    clz     r5, hi
    lsl     hi, hi, r5
    add     v_shift, v_shift, r5
    lsr     f, hi, v_shift
    cubic   f
    umull   r12, hi, hi, Q
    rsb     r12, v_shift, #32
    lsl     g_low, hi, r12
    lsr     g_high, hi, v_shift
update:
    ldrd    w_low, w_high, [state]
    bcs     12f
11: gap_forward
    check_gap 13f
    update_forward
    set_sign_of_w
    b       torque
12: gap_backward
    check_gap 14f
    update_backward

torque:
    return_torque r4-r8

13: clamp   11b
14: clamp   12b

    /* 1/2 <= v < 256: g = 1 - 2^-k (1 - f Q(f)). f is a rotation of hi, with k in its low bits. */
not_small:
    add     r5, v_shift, #8
    tst     r5, #UNUSUAL_LARGE
    bne     not_usual
    ror     f, hi, v_shift
    add     r5, v_shift, #32
    lsr     v_shift, hi, r5 /* k */
    cubic   hi
    umull   r12, g_high, f, Q
    mvn     g_high, g_high
    lsr     g_high, g_high, v_shift
    mvn     g_high, g_high
update_high:
    ldrd    w_low, w_high, [state]
    bcs     12f
11: gap_forward
    check_gap 13f
    umlal   w_low, w_high, z, g_high
    cmp     w_high, #0
    b       torque
12: gap_backward
    check_gap 14f
    umull   g_low, spare, z, g_high
    subtract_product
    b       torque

13: clamp   11b
14: clamp   12b

not_usual:
    cmp     v_shift, #64
    bhs     1f

    /* v < 2^-32: g = v Q(0) */
    clz     r5, hi
    lsl     hi, hi, r5
    add     v_shift, v_shift, r5
    ldr     r12, =dahl_kernel_cubics
    ldr     r12, [r12, #12]
    umull   r12, hi, hi, r12
    sub     v_shift, v_shift, #32
    lsr     g_low, hi, v_shift
    mov     g_high, #0
    lsls    r6, bits, #1
    b       update

1:  lsls    r6, bits, #1
    cmp     v_shift, #0
    blt     2f
    cmp     v_shift, #FAR_SHIFT
    blo     no_motion

    /* A far plan: as any other, but with a check of the angle */
    cmp     r6, #0x01000000
    blo     no_motion
    sub     v_shift, v_shift, #FAR
    cmp     v_shift, #64
    bge     no_motion
    cmn     v_shift, #8
    blt     2f
    cmp     r6, #0xff000000
    bhs     3f
    lsls    r6, bits, #1
    b       by_shift

    /* v >= 256, or an infinite angle, or NaN */
2:  cmp     hi, #0
    beq     no_motion /* a plan of all zeros */
    cmp     r6, #0xff000000
    bhs     3f
    mvn     g_high, #0
    lsls    r6, bits, #1
    b       update_high
3:  bhi     no_motion
    mov     w_high, #0x40000000
    cmp     bits, #0
    it      mi
    rsbmi   w_high, w_high, #0
    mov     w_low, #0
    cmp     w_high, #0
    b       torque

no_motion:
    ldrd    w_low, w_high, [state]
1:  gap_backward
    check_gap 2f
    cmp     w_high, #0
    b       torque
2:  clamp   1b
    .pool
    .size dahl_step, . - dahl_step
#endif
#include "stack_note.inc"
