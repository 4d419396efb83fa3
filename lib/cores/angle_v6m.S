/* SPDX-License-Identifier: MIT */
/*
 * dahl_step() for ARMv6-M and ARMv8-M Baseline: the tick of lib/model/step_angle.c, same bits.
 * lib/model/kernel.h explains v = hi 2^(-32 - shift), Q and g.
 *
 * The core multiplies to 32 bits, so products are built from halves of 16 bits: x = x1:x0. The arguments are kept on
 * the stack. A float is passed in r0 to r3 on every such core, since none has an FPU.
 */
#include "../arith/core.h"
#if DAHL_V6M
#include "torque_v6m.inc"

#define STATE [sp, #4]
#define BITS [sp, #8]  /* of the angle */
#define FAR 0x600000   /* DAHL_FAR */

/* b1:low = a b. All five registers are lost. */
    .macro multiply a, b, a1, b1, low
    lsrs    \a1, \a, #16
    uxth    \a, \a
    lsrs    \b1, \b, #16
    uxth    \b, \b
    movs    \low, \a
    muls    \low, \b, \low
    muls    \b, \a1, \b
    muls    \a, \b1, \a
    muls    \b1, \a1, \b1
    lsls    \a1, \b, #16
    lsrs    \b, \b, #16
    adds    \low, \low, \a1
    adcs    \b1, \b1, \b
    lsls    \a1, \a, #16
    lsrs    \a, \a, #16
    adds    \low, \low, \a1
    adcs    \b1, \b1, \a
    .endm

/* Q(f) in r3, for f in r6; r0 to r7 are lost. The coefficients are c3 < 0 with 11 zero bits, c2 > 0, c1 < 0 and c0.
 * y = y1:y0 = r7:r6 is below 2^28 and c2 is too, so that sums of two inner products do not carry. */
    .macro cubic
    ldr     r7, =dahl_kernel_cubics
    lsrs    r3, r6, #28
    lsls    r3, r3, #4
    adds    r7, r7, r3
    ldmia   r7!, {r0, r1, r2, r3} /* c3, c2, c1, c0 */
    lsls    r7, r6, #4
    lsrs    r7, r7, #20
    uxth    r6, r6
    asrs    r0, r0, #11 /* y c3 2^-32 = y (c3 2^-11) 2^-21 */
    movs    r4, r0
    muls    r4, r6, r4
    muls    r0, r7, r0
    asrs    r4, r4, #16
    adds    r0, r0, r4
    asrs    r0, r0, #5
    adds    r1, r1, r0 /* c2 + y c3 */
    lsrs    r4, r1, #16
    uxth    r1, r1
    movs    r5, r1
    muls    r5, r6, r5
    lsrs    r5, r5, #16
    muls    r1, r7, r1
    adds    r5, r5, r1
    movs    r1, r4
    muls    r1, r6, r1
    adds    r5, r5, r1
    lsrs    r5, r5, #16
    muls    r4, r7, r4
    adds    r2, r2, r4
    adds    r2, r2, r5 /* c1 + y (c2 + ..) */
    asrs    r4, r2, #16
    uxth    r2, r2
    movs    r5, r2
    muls    r5, r6, r5
    lsrs    r5, r5, #16
    muls    r2, r7, r2
    adds    r5, r5, r2
    muls    r6, r4, r6
    adds    r5, r5, r6
    asrs    r5, r5, #16
    muls    r4, r7, r4
    adds    r3, r3, r4
    adds    r3, r3, r5 /* c0 + y (c1 + ..) */
    .endm

/* z, the gap in Q30, in r6 for w in r3:r2. Both leave the top bit of z in the flags. */
    .macro gap_forward
    movs    r6, #1
    lsls    r6, r6, #30
    subs    r6, r6, r3
    lsrs    r7, r2, #31
    subs    r6, r6, r7
    .endm

    .macro gap_backward
    movs    r6, #1
    lsls    r6, r6, #30
    lsls    r7, r2, #1 /* the carry rounds w up */
    adcs    r6, r6, r3
    .endm

/* Target of the branch on the top bit of z. If z = 2^31, a reversal from the end, continue at `back`. Otherwise w is
 * out of range: clamp it to +-2^62 on its side and continue at `gap`. */
    .macro reverse_or_clamp gap, back
    lsls    r7, r6, #1
    beq     \back
    lsrs    r3, r3, #31
    lsls    r3, r3, #31
    movs    r2, #1
    lsls    r2, r2, #30
    orrs    r3, r3, r2
    movs    r2, #0
    b       \gap
    .endm

/* w in r3:r2, the bits of the angle in r1, its sign in the flags. */
    .macro load_w
    ldr     r0, STATE
    ldr     r1, BITS
    ldmia   r0!, {r2, r3}
    cmp     r1, #0
    .endm

/* w += or -= z m >> lr for lr <= 32, with z in r6 and m in r4. `add` is adds or subs, `add_carry` adcs or sbcs. */
    .macro update_small add, add_carry
    multiply r6, r4, r7, r5, r1
    mov     r6, lr
    lsrs    r1, r1, r6
    movs    r4, r5
    rors    r4, r4, r6
    lsrs    r5, r5, r6
    eors    r4, r4, r5 /* the bits that leave r5 */
    orrs    r1, r1, r4
    \add    r2, r2, r1
    \add_carry r3, r3, r5
    .endm

/* w += or -= z g, with z in r6 and g in r4. */
    .macro update_large add, add_carry
    multiply r6, r4, r7, r5, r1
    \add    r2, r2, r1
    \add_carry r3, r3, r5
    .endm

/* w += or -= z g 2^-32, with z in r6 and g in r0. */
    .macro update_tiny add, add_carry
    mulhi   r6, r0, r1, r7, r5
    movs    r6, #0
    \add    r2, r2, r1
    \add_carry r3, r3, r6
    .endm

    .section .text.dahl_step, "ax", %progbits
    .global dahl_step
    .type dahl_step, %function
    .thumb_func
    .balign 4
dahl_step:
    push    {r0-r2, r4-r7, lr}
    ldmia   r0!, {r3, r4} /* a_mantissa, a_exponent */
    lsls    r5, r2, #1
    lsrs    r5, r5, #24
    adds    r4, r4, r5
    movs    r5, #94
    subs    r4, r5, r4 /* shift */
    lsls    r2, r2, #8
    movs    r5, #1
    lsls    r5, r5, #31
    orrs    r2, r2, r5
    mulhi   r2, r3, r5, r6, r7 /* hi in r5 */
by_shift:
    cmp     r4, #32 /* unsigned */
    blo     below_1
    b       not_below_1

    /* v < 1: g = v Q(v) = m 2^(-32 - lr) */
below_1:
    cmp     r5, #0
    bmi     1f
    adds    r5, r5, r5
    adds    r4, r4, #1
1:  movs    r6, r5
    lsrs    r6, r6, r4 /* f */
    mov     r12, r5
    mov     lr, r4
    cubic
    mov     r2, r12
    mulhi   r2, r3, r4, r5, r6
    load_w
    bmi     small_backward
11: gap_forward
    bmi     21f
12: update_small adds, adcs
    b       torque
21: reverse_or_clamp 11b, 12b
22: reverse_or_clamp 13f, 14f
small_backward:
13: gap_backward
    bmi     22b
14: update_small subs, sbcs

    /* Store w and return its torque */
torque:
    pop     {r0, r1, r4} /* plan, state, bits of the angle */
    stmia   r1!, {r2, r3}
    return_torque

    .pool

    /* 1/2 <= v < 256: g = 1 - 2^-k (1 - f Q(f)). f is a rotation of hi, with k in its low bits. */
not_below_1:
    movs    r6, r4
    adds    r6, r6, #8
    cmp     r6, #7 /* unsigned */
    bls     1f
    b       not_usual
1:  movs    r6, r5
    rors    r6, r6, r4 /* f */
    movs    r3, #32
    adds    r3, r3, r4
    lsrs    r5, r5, r3 /* k */
    mov     r12, r6
    mov     lr, r5
    cubic
    mov     r2, r12
    mulhi   r2, r3, r4, r5, r6
    mvns    r4, r4
    mov     r5, lr
    lsrs    r4, r4, r5
    mvns    r4, r4
update_by_g:
    load_w
    bmi     large_backward
11: gap_forward
    bmi     21f
12: update_large adds, adcs
    b       torque
21: reverse_or_clamp 11b, 12b
22: reverse_or_clamp 13f, 14f
large_backward:
13: gap_backward
    bmi     22b
14: update_large subs, sbcs
    b       torque

not_usual:
    cmp     r4, #64 /* unsigned */
    bhs     not_tiny

    /* v < 2^-32: g = v Q(0), in Q64 */
    cmp     r5, #0
    bmi     1f
    adds    r5, r5, r5
    adds    r4, r4, #1
1:  subs    r4, r4, #32
    ldr     r3, =dahl_kernel_cubics
    ldr     r3, [r3, #12]
    mulhi   r5, r3, r0, r6, r7
    lsrs    r0, r0, r4
    mov     r4, r0
    load_w
    mov     r0, r4
    bmi     tiny_backward
11: gap_forward
    bmi     21f
12: update_tiny adds, adcs
    b       torque
tiny_backward:
13: gap_backward
    bmi     22f
14: update_tiny subs, sbcs
    b       torque
21: reverse_or_clamp 11b, 12b
22: reverse_or_clamp 13b, 14b

not_tiny:
    ldr     r1, BITS
    lsls    r2, r1, #1
    lsrs    r2, r2, #24 /* exponent of the angle */
    cmp     r4, #0
    blt     1f
    lsrs    r3, r4, #12
    beq     no_motion

    /* A far plan: as any other, but with a check of the angle */
    cmp     r2, #0
    beq     no_motion
    movs    r3, #FAR >> 21
    lsls    r3, r3, #21
    subs    r4, r4, r3
    cmp     r4, #64
    bge     no_motion
    cmp     r2, #255
    beq     1f
    b       by_shift

    /* v >= 256, or an infinite angle, or NaN */
1:  cmp     r5, #0
    beq     no_motion /* a plan of all zeros */
    movs    r4, #0
    mvns    r4, r4
    cmp     r2, #255
    beq     2f
    b       update_by_g
2:  lsls    r2, r1, #9
    bne     no_motion /* NaN */
    movs    r2, #0
    movs    r3, #1
    lsls    r3, r3, #30
    cmp     r1, #0
    bpl     3f
    rsbs    r3, r3, #0
3:  b       torque

no_motion:
    load_w
11: gap_backward
    bmi     21f
12: b       torque
21: reverse_or_clamp 11b, 12b
    .pool
    .size dahl_step, . - dahl_step
#endif
#include "stack_note.inc"
