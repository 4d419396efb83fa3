/* SPDX-License-Identifier: MIT */
/*
 * From human units to a plan. The travel of one count is u = sigma0/Fc theta_per_count. What a small part v = u 2^-n of it
 * leaves of the gap comes from two terms of the series of exp(-v), 1 - v + v^2/2; everything else from joining travels in
 * one direction,
 *     exp(-(x + y)) = exp(-x) exp(-y),
 * which needs no exponential and lets no relative error grow. Relative error of every entry: below 2^-32 (the series
 * 2^-42, the quotient 2^-37, one unit of Q64 at the start, which is 2^-34 of the smallest travel, and one at each join).
 * All is computed in locals, and each word of the plan is written once: who prepares equal parameters again, under a tick
 * that reads the plan, changes nothing at any moment.
 */
#include "bristle_update.h"

#define PART_BITS 20 /* v < 2^-20, so that v^3/6 < 2^-42 v */
#define LOG2_E_Q31 3098164010u /* rounded up, which centres the truncation of a/ln 2 to 32 bits */

/* Error code of one parameter; OR of several codes is the most severe one. */
static DAHL_OUT_OF_LINE DAHL_COLD int32_t check(uint32_t bits)
{
    const uint32_t least = dahl_bits_of(DAHL_TORQUE_MIN), most = dahl_bits_of(DAHL_TORQUE_MAX);
    if (bits == 0 || bits >= DAHL_BITS_INF) { /* zero, infinite, NaN, or with a sign */
        return DAHL_ERR_PARAM;
    }
    return least <= bits && bits < most ? DAHL_OK : DAHL_ERR_RANGE;
}

static dahl_real_t real_of(float x)
{
    return dahl_real_of(dahl_bits_of(x));
}

/* 2^-30 <= sigma0 theta/Fc < 2^20, decided exactly: the product's upper half is at least Fc's mantissa, or half of it, or
 * less, and that gives the quotient's exponent. (The lowest bits of a float's mantissa are 0.) */
static int is_travel_in_range(dahl_real_t sigma0, dahl_real_t theta, dahl_real_t Fc)
{
    uint32_t high = dahl_mulhi(sigma0.mantissa, theta.mantissa);
    int32_t exponent = sigma0.exponent + theta.exponent - Fc.exponent + 30;
    exponent += (high >= Fc.mantissa >> 1) + (high >= Fc.mantissa);
    return -30 <= exponent && exponent < 20;
}

/* a 2^exponent times b, a in (2^62, 2^64). */
static DAHL_COLD dahl_wide_t product(uint64_t a, int32_t exponent, dahl_real_t b)
{
    uint64_t high = dahl_mul((uint32_t)(a >> 32), b.mantissa) + dahl_mulhi((uint32_t)a, b.mantissa);
    return dahl_normalise(high, exponent + b.exponent + 32);
}

/* What travels x and then y leave of the gap, in Q64. The product goes up to the next integer: so it stays above 0, and where
 * there is no travel, 2^64 - 1, it stays as it is. */
static uint64_t join(uint64_t left_by_x, uint64_t left_by_y)
{
    return dahl_mulhi64(left_by_x, left_by_y) + 1;
}

/* What travel u leaves of the gap, in Q64, for 2^-31 < u < 2^20. */
static DAHL_COLD uint64_t left_by(dahl_wide_t u)
{
    for (; u.exponent < -64 - PART_BITS; u.exponent++) {
        u.mantissa >>= 1;
    }
    uint32_t v_q51 = (uint32_t)(u.mantissa >> (PART_BITS + 13));
    uint64_t left = ~(u.mantissa >> PART_BITS) + (dahl_mulhi(v_q51, v_q51) >> 7);
    for (; u.exponent > -64 - PART_BITS; u.exponent--) {
        left = join(left, left);
    }
    return left;
}

static void write_entry(dahl_q64_t *entry, uint64_t g)
{
    entry->hi = (uint32_t)(g >> 32);
    entry->lo = (uint32_t)g;
}

/* 0, 1 .. 8 counts, then twice the one before. */
static DAHL_COLD void write_table(dahl_plan_t *plan, uint64_t left_by_one)
{
    const int entries = (int)(sizeof plan->g / sizeof plan->g[0]);
    uint64_t left = left_by_one;
    write_entry(&plan->g[0], 0);
    write_entry(&plan->g[1], ~left);
    for (int n = 2; n < entries; n++) {
        left = join(left, n <= DAHL_DIRECT_COUNTS_MAX ? left_by_one : left);
        write_entry(&plan->g[n], ~left);
    }
}

static DAHL_COLD void write_plan(dahl_plan_t *plan, const dahl_params_t *params, int has_counts)
{
    const dahl_real_t sigma0 = real_of(params->sigma0), Fc = real_of(params->Fc), log2_e = {LOG2_E_Q31, -31};
    uint64_t a = dahl_quotient_q63(sigma0.mantissa, Fc.mantissa);
    int32_t exponent = sigma0.exponent - Fc.exponent - 63;
    dahl_wide_t a_per_ln2 = product(a, exponent, log2_e);
    plan->a_mantissa = (uint32_t)(a_per_ln2.mantissa >> 32);
    plan->a_exponent = a_per_ln2.exponent + 32;
    plan->Fc_mantissa = Fc.mantissa;
    plan->Fc_exponent = Fc.exponent;
    write_table(plan, has_counts ? left_by(product(a, exponent, real_of(params->theta_per_count))) : UINT64_MAX);
}

DAHL_COLD dahl_err_t dahl_prepare(dahl_plan_t *plan, const dahl_params_t *params)
{
    uint32_t sigma0 = dahl_bits_of(params->sigma0), Fc = dahl_bits_of(params->Fc);
    uint32_t theta = dahl_bits_of(params->theta_per_count);
    int has_counts = theta << 1 != 0;
    int32_t err = check(sigma0) | check(Fc) | (has_counts ? check(theta) : DAHL_OK);
    if (err == DAHL_OK && has_counts && !is_travel_in_range(dahl_real_of(sigma0), dahl_real_of(theta), dahl_real_of(Fc))) {
        err = DAHL_ERR_RANGE;
    }
    if (err == DAHL_OK) {
        write_plan(plan, params, has_counts);
    }
    return (dahl_err_t)err;
}
