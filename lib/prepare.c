/* SPDX-License-Identifier: MIT */
/*
 * From human units to a plan. The travel of one count is u = sigma0/Fc theta_per_count. g of a small part v = u 2^-j of
 * it comes from two terms of its series, v - v^2/2; everything else from joining travels in one direction,
 *     g(x + y) = g(x) + g(y) - g(x) g(y),
 * which needs no exponential and lets no relative error grow. Relative error of every entry: below 2^-32 (the series
 * 2^-42, the quotient 2^-37, and half a unit of Q64 at the start, 2^-35 for the smallest travel, and at each join).
 * The range of a = sigma0/Fc, 2^-63 .. 2^63 per unit of angle, lets dahl_step take subnormal angles for zero.
 */
#include "gap.h"

#define DAHL_TABLE 37
#define START_BITS 20 /* v < 2^-20, so that v^3/6 < 2^-42 v */

typedef struct {
    uint64_t quotient; /* sigma0/Fc = quotient 2^exponent, quotient in (2^37, 2^39) */
    int32_t exponent;
} ratio_t;

typedef struct {
    uint64_t mantissa; /* u = mantissa 2^exponent, top bit set; 0: no counts */
    int32_t exponent;
} travel_t;

/* Zero, negative, infinite or NaN; -0 counts as zero. */
static int is_positive(float x)
{
    uint32_t bits = dahl_bits_of(x);
    return bits != 0 && bits < DAHL_BITS_INF;
}

static int is_in_range(float x)
{
    uint32_t bits = dahl_bits_of(x);
    return bits >= dahl_bits_of(DAHL_TORQUE_MIN) && bits < dahl_bits_of(DAHL_TORQUE_MAX);
}

static int is_zero(float x)
{
    return (dahl_bits_of(x) & DAHL_BITS_MAGNITUDE) == 0;
}

static int is_subnormal(float x)
{
    return !is_zero(x) && (dahl_bits_of(x) & DAHL_BITS_MAGNITUDE) < DAHL_BITS_NORMAL;
}

static dahl_err_t check(const dahl_params_t *p)
{
    if (!is_positive(p->sigma0) || !is_positive(p->Fc) || !(is_zero(p->theta_per_count) || is_positive(p->theta_per_count))) {
        return DAHL_ERR_PARAM;
    }
    return is_in_range(p->sigma0) && is_in_range(p->Fc) && !is_subnormal(p->theta_per_count) ? DAHL_OK : DAHL_ERR_RANGE;
}

static ratio_t ratio_of(float sigma0, float Fc)
{
    dahl_real_t n = dahl_real_of(dahl_bits_of(sigma0)), d = dahl_real_of(dahl_bits_of(Fc));
    ratio_t r;
    r.quotient = dahl_quotient_q38(n.mantissa, d.mantissa);
    r.exponent = n.exponent - d.exponent - 38;
    return r;
}

/* a theta for a normal theta; 0 for 0. */
static travel_t travel_of(ratio_t a, float theta)
{
    dahl_real_t t = dahl_real_of(dahl_bits_of(theta));
    travel_t u = {0, 0};
    if (is_zero(theta)) {
        return u;
    }
    u.mantissa = a.quotient * (t.mantissa >> 8);
    u.exponent = a.exponent + t.exponent + 8;
    while (!(u.mantissa >> 63)) {
        u.mantissa <<= 1;
        u.exponent--;
    }
    return u;
}

/* x + y, at most 2^64 - 1, which stands for 1. */
static uint64_t add_saturated(uint64_t x, uint64_t y)
{
    return x + y < x ? UINT64_MAX : x + y;
}

/* g of the travel x and then y. */
static uint64_t join(uint64_t x, uint64_t y)
{
    return add_saturated(x, y - dahl_mulhi64(x, y, DAHL_TOP_BIT));
}

static uint64_t g_of_travel(travel_t u)
{
    int32_t doublings = u.exponent + 64 + START_BITS;
    int32_t shift = START_BITS;
    if (doublings < 0) {
        shift -= doublings;
        doublings = 0;
    }
    uint64_t v = (u.mantissa >> shift) + ((u.mantissa >> (shift - 1)) & 1u); /* rounded; the sum before could carry out */
    uint64_t g = v - ((v >> 13) * (v >> 13) >> 39); /* v <= 2^44 */
    while (doublings-- > 0) {
        g = join(g, g);
    }
    return g;
}

static uint64_t read_entry(const dahl_q64_t *entry)
{
    return (uint64_t)entry->hi << 32 | entry->lo;
}

static void write_entry(dahl_q64_t *entry, uint64_t g)
{
    entry->hi = (uint32_t)(g >> 32);
    entry->lo = (uint32_t)g;
}

/* 0, 1 .. 8 counts, then twice the one before. */
static void fill_table(dahl_q64_t *table, uint64_t one)
{
    write_entry(&table[0], 0);
    write_entry(&table[1], one);
    for (int n = 2; n < DAHL_TABLE; n++) {
        int x = n <= DAHL_DENSE ? n / 2 : n - 1, y = n <= DAHL_DENSE ? n - n / 2 : n - 1;
        write_entry(&table[n], join(read_entry(&table[x]), read_entry(&table[y])));
    }
}

/* The 2 units of 2^-64 that gap.h wants; 0 stays 0: no motion, no change. */
static void add_rounding(dahl_q64_t *table)
{
    for (int n = 0; n < DAHL_TABLE; n++) {
        uint64_t g = read_entry(&table[n]);
        write_entry(&table[n], g == 0 ? 0 : add_saturated(g, 2));
    }
}

/* The top 32 bits, rounded; a carry out would only round up to 2^32 what 2^32 - 1 stands for as well. */
static uint32_t top_of(uint64_t mantissa)
{
    return (uint32_t)(add_saturated(mantissa, DAHL_TOP_BIT) >> 32);
}

/* 2^first <= u < 2^last; no counts are in any range. */
static int is_travel_in_range(travel_t u, int32_t first, int32_t last)
{
    return u.mantissa == 0 || (u.exponent >= first - 63 && u.exponent < last - 63);
}

/* The bits of a float near 22/a, truncated, less those of the smallest one; a in 2^-63 .. 2^63 keeps it normal. */
static uint32_t near_of(uint32_t a_mantissa, int32_t a_exponent)
{
    uint64_t quotient = dahl_quotient_q38(0xb0000000u, a_mantissa); /* 22 = 0xb0000000 2^-27 */
    int32_t exponent = -27 - 38 - a_exponent, shift = 14 + (int32_t)(quotient >> 38);
    return ((uint32_t)(exponent + shift + 149) << 23) + (uint32_t)(quotient >> shift) - DAHL_BITS_NORMAL;
}

dahl_err_t dahl_prepare(dahl_plan_t *plan, const dahl_params_t *params)
{
    dahl_err_t err = check(params);
    if (err != DAHL_OK) {
        return err;
    }
    ratio_t a = ratio_of(params->sigma0, params->Fc);
    travel_t radian = travel_of(a, 1.0f), count = travel_of(a, params->theta_per_count);
    if (!is_travel_in_range(radian, -63, 63) || !is_travel_in_range(count, -30, 20)) {
        return DAHL_ERR_RANGE;
    }
    fill_table(plan->g, count.mantissa == 0 ? 0 : g_of_travel(count));
    add_rounding(plan->g);
    dahl_real_t Fc = dahl_real_of(dahl_bits_of(params->Fc));
    plan->a_mantissa = top_of(radian.mantissa);
    plan->a_shift = DAHL_A_BIAS - (radian.exponent + 32);
    plan->near = near_of(plan->a_mantissa, radian.exponent + 32);
    plan->Fc_mantissa = Fc.mantissa;
    plan->Fc_scale = dahl_scale_of(Fc.exponent);
    return DAHL_OK;
}
