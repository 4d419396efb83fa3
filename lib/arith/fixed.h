/* SPDX-License-Identifier: MIT */
/*
 * Fixed-point arithmetic of the library, private. Two representations:
 *   Q62, Q64, Q30   plain fixed point: the integer i means i 2^-62, ...
 *   real            mantissa 2^exponent with the mantissa's top bit set, for values of unknown size
 */
#ifndef DAHL_FIXED_H
#define DAHL_FIXED_H

#include "compiler.h"
#include "dahl.h"
#include "multiply.h"

#define DAHL_TOP_BIT 0x80000000u
#define DAHL_ONE_Q62 ((uint64_t)1 << 62)

typedef struct {
    uint32_t mantissa;
    int32_t exponent;
} dahl_real_t;

/* A normal positive float as mantissa 2^exponent. */
static inline dahl_real_t dahl_real_of(uint32_t bits)
{
    dahl_real_t r;
    r.mantissa = DAHL_TOP_BIT | (bits << 8);
    r.exponent = (int32_t)((bits >> 23) & 0xffu) - 127 - 31;
    return r;
}

/* A plan holds the exponent of Fc as dahl_pack (torque.h) wants it: biased, times 2^24, and 1 for a rounding. */
#define DAHL_FC_BIAS 159

static inline uint32_t dahl_scale_of(int32_t exponent)
{
    return (uint32_t)(exponent + DAHL_FC_BIAS) << 24 | 1u;
}

static inline uint32_t dahl_mantissa_of_Fc(const dahl_plan_t *plan)
{
    return plan->Fc_mantissa - 1u;
}

static inline int32_t dahl_exponent_of_Fc(const dahl_plan_t *plan)
{
    return (int32_t)(plan->Fc_scale >> 24) - DAHL_FC_BIAS;
}

/* And that of a so that a_shift less the exponent field of dtheta is the shift of the travel (kernel.h). */
#define DAHL_A_BIAS 94

static inline int32_t dahl_exponent_of_a(const dahl_plan_t *plan)
{
    return DAHL_A_BIAS - plan->a_shift;
}

#define DAHL_BITS_INF 0x7f800000u
#define DAHL_BITS_MAGNITUDE 0x7fffffffu
#define DAHL_BITS_SIGN 0x80000000u
#define DAHL_BITS_NORMAL 0x00800000u /* smallest normal float */

/* Out of line (mul_div64.c): for what is prepared, not for a tick. */

/* Upper half of a 64 x 64 bit product, truncated. */
uint64_t dahl_mulhi64(uint64_t a, uint64_t b);

/* numerator/denominator in Q63, truncated, for mantissas with the top bit set: in (2^62, 2^64). */
uint64_t dahl_quotient_q63(uint32_t numerator, uint32_t denominator);

#endif
