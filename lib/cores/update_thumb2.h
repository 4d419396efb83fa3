/* SPDX-License-Identifier: MIT */
/*
 * One update of the bristle in the instructions of ARMv7-M, ARMv7E-M and ARMv8-M Mainline, for the ticks beside this file:
 * dahl_forward and dahl_backward of lib/model/bristle_update.h, same bits. With g = g_high 2^-32 + g_low 2^-64:
 *     forward   z = 2^30 - q,  q = w in Q30, a half rounded up     the gap to +Fc, in Q30
 *               w += z g_high + floor(z g_low 2^-32)
 *     backward  z = 2^30 + q is the gap to -Fc, and the product is subtracted
 * UMAAL, where the core has it (the DSP extension), adds both words of the sum at once.
 */
#define TABLE 16 /* bytes from the plan to its table of g, eight bytes an entry: g_high, g_low */

#define plan r0
#define state r1
#define n r2
#define w_low r2 /* once n is no longer needed */
#define w_high r3
#define z r4
#define g_low r12 /* and then floor(z g_low 2^-32) */
#define spare lr

    .syntax unified
    .thumb

    .macro update_forward g_high
    rsb     z, w_high, #0x40000000
    sub     z, z, w_low, lsr #31
    umull   spare, g_low, z, g_low
#ifdef __ARM_FEATURE_DSP
    umaal   w_low, g_low, z, \g_high /* upper word of the sum in g_low */
    add     w_high, w_high, g_low
#else
    adds    w_low, w_low, g_low
    adc     w_high, w_high, #0
    umlal   w_low, w_high, z, \g_high
#endif
    .endm

    .macro update_backward g_high
    add     z, w_high, #0x40000000
    add     z, z, w_low, lsr #31
    umull   spare, g_low, z, g_low
    mov     spare, #0
    umlal   g_low, spare, z, \g_high
    subs    w_low, w_low, g_low
    sbc     w_high, w_high, spare
    .endm

    .macro function name
    .section .text.\name, "ax", %progbits
    .global \name
    .type \name, %function
    .thumb_func
    .balign 4
\name:
    .endm
