/* SPDX-License-Identifier: MIT */
/*
 * dahl_torque_from() of lib/model/torque.h for ARMv6-M and ARMv8-M Baseline, same bits. Integers only.
 *     |w| = s 2^length + ...,  2^31 <= s < 2^32        product = s Fc_mantissa 2^-32, rounded to the 24 bits of a float
 * length is the number of bits of the upper word of |w|. The first bit of the product is at the top or next to it,
 * except for a plan of all zeros, whose torque is 0.
 *
 * The core cannot count leading zeros. A table has the length by the upper word's bits from 25 on. A |w| below Fc/32
 * needs 7 to 29 instructions more.
 */
#include "../arith/core.h"
#if DAHL_V6M
#include "torque_v6m.inc"

#define EXPONENT 126 /* 2 - 32 + 156: the exponent of dahl_torque_bits() with zeros = 32 - length */
#define TOP 25       /* lowest bit of the upper word that the table reads */

    .section .text.dahl_torque_from, "ax", %progbits
    .global dahl_torque_from
    .type dahl_torque_from, %function
    .thumb_func
    .balign 4
dahl_torque_from:
    push    {r4-r7, lr}

    /* In: mantissa and exponent of Fc in r0 and r1, w in r3:r2. Target of `return_torque`. */
    .global dahl_return_torque
    .type dahl_return_torque, %function
    .thumb_func
dahl_return_torque:
    cmp     r3, #0
    bpl     1f
    adds    r1, r1, #255 /* 256, the sign of the float, above its exponent */
    adds    r1, r1, #1
    movs    r4, #0
    rsbs    r2, r2, #0
    sbcs    r4, r4, r3
    movs    r3, r4
1:  adds    r1, r1, #EXPONENT
look_up:
    lsrs    r4, r3, #TOP
    beq     small
    adr     r5, lengths
    ldrb    r4, [r5, r4]
scale:
    rors    r3, r3, r4 /* a shift to the left by 32 - length, since the upper bits are 0 */
    lsrs    r2, r2, r4
    orrs    r3, r3, r2 /* s */
    adds    r1, r1, r4
    mulhi r3, r0, r4, r5, r6
    bmi     2f
    lsls    r4, r4, #1
    bpl     zero /* a plan of all zeros */
    lsls    r1, r1, #23
    lsrs    r0, r4, #8 /* the carry, the last bit shifted out, rounds to nearest */
    adcs    r0, r0, r1 /* the first bit adds 1 to the exponent */
    pop     {r4-r7, pc}
2:  adds    r1, r1, #1
    lsls    r1, r1, #23
    lsrs    r0, r4, #8
    adcs    r0, r0, r1
    pop     {r4-r7, pc}

    /* The torque is below Fc/32: look up the upper word's bits from TOP - r5 on, of which at most 5 are not 0 */
small:
    movs    r5, #10
    lsrs    r4, r3, #TOP - 10
    bne     3f
    cmp     r3, #0
    beq     tiny
    movs    r5, #20
    lsrs    r4, r3, #TOP - 20
    bne     3f
    movs    r5, #TOP
    movs    r4, r3
3:  lsrs    r6, r4, #5
    beq     4f
    movs    r4, r6
    subs    r5, r5, #5
4:  adr     r6, lengths
    ldrb    r4, [r6, r4]
    subs    r4, r4, r5
    b       scale

    /* The torque is below 2^-30 Fc: shift |w| by 30 bits */
tiny:
    lsrs    r3, r2, #2
    lsls    r2, r2, #30
    subs    r1, r1, #30
    movs    r4, r3
    orrs    r4, r4, r2
    bne     look_up
zero:
    movs    r0, #0
    pop     {r4-r7, pc}

    /* Length of a word by its bits from TOP on. Only dahl_clamped_step(), with a load above 1, needs the last 32. */
    .balign 4
lengths:
    .byte 0, 26, 27, 27, 28, 28, 28, 28, 29, 29, 29, 29, 29, 29, 29, 29
    .fill 16, 1, 30
    .fill 32, 1, 31
    .byte 32
    .size dahl_torque_from, . - dahl_torque_from
#endif
#include "stack_note.inc"
