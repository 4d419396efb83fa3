/* SPDX-License-Identifier: MIT */
/*
 * dahl_step_counts_q30 for ARMv7-M, ARMv7E-M and ARMv8-M Mainline: the tick of lib/model/step_counts_q30.c, same bits.
 * 15 instructions forward and 18 backward; 14 forward where the core has UMAAL (the DSP extension).
 *
 * Forward, a move of n = 0 .. 8 counts, g = plan->g[n] = g_high 2^-32 + g_low 2^-64:
 *     z = 2^30 - q,  q = w in Q30, a half rounded up          the gap to +Fc, in Q30
 *     w += z g_high + floor(z g_low 2^-32)
 * Backward, n = -1 .. -8, is its mirror image: z = 2^30 + q is the gap to -Fc, and the product is subtracted.
 * Any other move goes to dahl_step_large (lib/model/step_large.c), all arguments untouched.
 */
    .syntax unified
    .thumb

#define TABLE 16 /* bytes from the plan to its table of g, eight bytes an entry: g_high, g_low */

#define plan r0
#define state r1
#define n r2
/* From when the table's entry is loaded: */
#define g_high r0
#define w_low r2
#define w_high r3
#define z r4
#define g_low r12 /* and then floor(z g_low 2^-32) */
#define spare lr

    .section .text.dahl_step_counts_q30, "ax", %progbits
    .global dahl_step_counts_q30
    .type dahl_step_counts_q30, %function
    .thumb_func
    .balign 4
dahl_step_counts_q30:
    cmp     n, #8 /* unsigned, so that a negative n is above it */
    bhi     backward
    add     plan, plan, n, lsl #3
    push    {r4, lr}
    ldrd    w_low, w_high, [state]
    ldrd    g_high, g_low, [plan, #TABLE]
    rsb     z, w_high, #0x40000000
    sub     z, z, w_low, lsr #31
    umull   spare, g_low, z, g_low
#ifdef __ARM_FEATURE_DSP
    umaal   w_low, g_low, z, g_high /* upper word of the sum in g_low */
    add     w_high, w_high, g_low
#else
    adds    w_low, w_low, g_low
    adc     w_high, w_high, #0
    umlal   w_low, w_high, z, g_high
#endif
    strd    w_low, w_high, [state]
    add     r0, w_high, w_low, lsr #31
    pop     {r4, pc}

backward:
    cmn     n, #8 /* carries for -8 .. -1 alone */
    bcc     large
    sub     plan, plan, n, lsl #3
    push    {r4, lr}
    ldrd    w_low, w_high, [state]
    ldrd    g_high, g_low, [plan, #TABLE]
    add     z, w_high, #0x40000000
    add     z, z, w_low, lsr #31
    umull   spare, g_low, z, g_low
    mov     spare, #0
    umlal   g_low, spare, z, g_high
    subs    w_low, w_low, g_low
    sbc     w_high, w_high, spare
    strd    w_low, w_high, [state]
    add     r0, w_high, w_low, lsr #31
    pop     {r4, pc}

large:
    b       dahl_step_large
    .size dahl_step_counts_q30, . - dahl_step_counts_q30
