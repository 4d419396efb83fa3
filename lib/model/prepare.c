/* SPDX-License-Identifier: MIT */
/*
 * From human units to a plan. The travel of one count is u = sigma0/Fc theta_per_count. g of a small part v = u 2^-j of
 * it comes from two terms of its series, v - v^2/2; everything else from joining travels in one direction,
 *     1 - g(x + y) = (1 - g(x)) (1 - g(y)),
 * which needs no exponential and lets no relative error grow. Relative error of every entry: below 2^-32 (the series
 * 2^-42, the quotient 2^-37, one unit of Q64 at the start, which is 2^-34 of the smallest travel, and one at each join).
 */
#include "bristle_update.h"

#define TABLE 37
#define START_BITS 20 /* v < 2^-20, so that v^3/6 < 2^-42 v */
#define LOG2_E_Q31 3098164010u /* rounded up, which centres the truncation of a/ln 2 to 32 bits */

/* A code that ors with those of other parameters to the gravest. The limits are powers of two: exponent fields will do. */
static DAHL_OUT_OF_LINE DAHL_SMALL int32_t check(uint32_t bits)
{
    const uint32_t least = dahl_bits_of(DAHL_TORQUE_MIN) >> 23, most = dahl_bits_of(DAHL_TORQUE_MAX) >> 23;
    uint32_t field = bits >> 23; /* and the sign */
    if (field - least < most - least) {
        return DAHL_OK;
    }
    return DAHL_ERR_PARAM - (bits != 0 && field < DAHL_BITS_INF >> 23);
}

/* The mantissa of a b, its top bit set; a in (2^62, 2^64), b with its top bit set. Values are mantissa 2^-shift; *shift
 * comes as the sum of both shifts and goes as that of the product. */
static inline uint64_t product(uint64_t a, uint32_t b, int32_t *shift)
{
    uint32_t high = (uint32_t)(a >> 32), low = (uint32_t)a;
    DAHL_KEEP(high);
    DAHL_KEEP(low);
    uint64_t mantissa = dahl_mul(high, b) + dahl_mulhi(low, b);
    *shift -= 32;
    DAHL_KEEP(*shift);
    while (!(mantissa >> 63)) {
        mantissa <<= 1;
        ++*shift;
        DAHL_KEEP(*shift);
    }
    return mantissa;
}

/* What travels x and then y leave of c = ~g. The product goes up to the next integer: so c stays above 0, and where there is
 * no travel, c = 2^64 - 1, it stays as it is. */
static inline uint64_t join(uint64_t c_x, uint64_t c_y)
{
    return dahl_mulhi64(c_x, c_y) + 1;
}

static inline dahl_real_t real_of(float x)
{
    return dahl_real_of(dahl_bits_of(x));
}

static inline void write_entry(dahl_q64_t *entry, uint64_t g)
{
    entry->hi = (uint32_t)(g >> 32);
    entry->lo = (uint32_t)g;
}

/* Everything but the table; the travel of one count goes to entry 1 (mantissa) and 0 (shift). Parameters are read where they
 * are needed, not kept: that saves stack. */
static DAHL_APART DAHL_SMALL dahl_err_t set_scales(dahl_plan_t *plan, const dahl_params_t *params)
{
    int32_t err = check(dahl_bits_of(params->sigma0)) | check(dahl_bits_of(params->Fc));
    int has_counts = dahl_bits_of(params->theta_per_count) << 1 != 0;
    if (has_counts) {
        err |= check(dahl_bits_of(params->theta_per_count));
    }
    if (err != DAHL_OK) {
        return (dahl_err_t)err;
    }
    uint64_t a = dahl_quotient_q63(real_of(params->sigma0).mantissa, real_of(params->Fc).mantissa);
    int32_t a_shift = real_of(params->Fc).exponent - real_of(params->sigma0).exponent + 63;
    int32_t u_shift = a_shift - real_of(params->theta_per_count).exponent;
    uint64_t u = product(a, real_of(params->theta_per_count).mantissa, &u_shift);
    if (!has_counts) {
        u_shift = 255; /* none, whatever a is */
    } else if ((uint32_t)(63 + 30 - u_shift) >= 50) { /* not 2^-30 <= u < 2^20 */
        return DAHL_ERR_RANGE;
    }
    write_entry(&plan->g[1], u);
    plan->g[0].lo = (uint32_t)u_shift;
    a_shift += 31;
    plan->a_mantissa = (uint32_t)(product(a, LOG2_E_Q31, &a_shift) >> 32);
    plan->a_shift = a_shift + DAHL_A_BIAS - 32;
    plan->Fc_mantissa = real_of(params->Fc).mantissa | 1u;
    plan->Fc_scale = dahl_scale_of(real_of(params->Fc).exponent);
    return DAHL_OK;
}

/* Entries 1, 2 .. 8 counts, then twice the one before. From v it takes 1 - n doublings to entry n = 1. Travel next to none (no
 * counts) makes v and so the table zero. */
static DAHL_OUT_OF_LINE DAHL_SMALL void fill_table(dahl_q64_t *table)
{
    int32_t n = 1 - (64 + START_BITS - (int32_t)table[0].lo);
    uint64_t mantissa = (uint64_t)table[1].hi << 32 | table[1].lo;
    for (; n > 1; n--) {
        mantissa >>= 1;
        DAHL_KEEP(n);
    }
    uint32_t part = (uint32_t)(mantissa >> 33);
    DAHL_KEEP(part);
    uint64_t c = dahl_two_words(~(mantissa >> START_BITS)) + (dahl_mulhi(part, part) >> 7), other = c;
    for (write_entry(&table[0], 0); n < TABLE; n++) {
        dahl_q64_t *entry = &table[n < 1 ? 1 : n];
        DAHL_KEEP(entry);
        write_entry(entry, ~c);
        if ((uint32_t)(n - 2) >= DAHL_DENSE - 2) {
            other = c;
        }
        c = join(c, other);
    }
}

DAHL_SMALL dahl_err_t dahl_prepare(dahl_plan_t *plan, const dahl_params_t *params)
{
    dahl_err_t err = set_scales(plan, params);
    if (err == DAHL_OK) {
        fill_table(plan->g);
    }
    return err;
}
