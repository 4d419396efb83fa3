/* SPDX-License-Identifier: MIT */
/*
 * Floats through the kernel against MPFR, both signs through dahl_step: build/host/tests/lib/kernel_all [FIRST LAST STRIDE]
 * (bit patterns; by default all 2^31 non-negative floats, a minute or two).
 *
 * The reference: 1 - exp(-u) and exp(-u) by MPFR to the nearest double at the first float u0 of each 2^12, and from there
 *     1 - exp(-u) = (1 - exp(-u0)) + exp(-u0) (1 - exp(-x)),    x = u - u0, exact in double, x < 2^-11 u
 * by four terms of the series in x. What is left out is below exp(-u0) x^5/120, which is below 2^-56 of the sum for every
 * float; both terms are positive, and each of the dozen operations rounds by 2^-53. So the reference errs by less than
 * REFERENCE_ERROR, which is taken off the bound that is checked. The worst float found is computed again by MPFR alone.
 */
#include <math.h>
#include <stdint.h>
#define MPFR_USE_INTMAX_T
#include <mpfr.h>
#include <stdio.h>
#include <stdlib.h>

#include "../../lib/model/kernel.h"

#define BLOCK_BITS 12
#define REFERENCE_ERROR 0x1p-49
#define MPFR_BITS 200
#define UNITS 0x2p-64 /* what gap.h wants on top: up to two units, never less */

typedef struct {
    uint32_t first; /* float's bits */
    double u, g, rest; /* rest = 1 - g */
} anchor_t;

typedef struct {
    double error; /* relative, with its sign */
    uint32_t bits;
} worst_t;

typedef struct {
    uint64_t floats, wrong, falls, steps, overflows;
    uint32_t first_one; /* first float whose g is all ones */
    uint64_t before;    /* g of the float before */
    worst_t low, high;
} tally_t;

static dahl_plan_t plan;
static mpfr_t x, y;

static double exact(double u)
{
    (void)mpfr_set_d(x, -u, MPFR_RNDN);
    (void)mpfr_expm1(y, x, MPFR_RNDN);
    return -mpfr_get_d(y, MPFR_RNDN);
}

static anchor_t anchor_at(uint32_t bits)
{
    anchor_t a = {bits, (double)dahl_float_of(bits), 0, 0};
    a.g = exact(a.u);
    (void)mpfr_exp(y, x, MPFR_RNDN);
    a.rest = mpfr_get_d(y, MPFR_RNDN);
    return a;
}

static double reference(const anchor_t *a, double u)
{
    double d = u - a->u;
    return a->g + a->rest * d * (1 - d / 2 * (1 - d / 3 * (1 - d / 4)));
}

static uint64_t kernel(uint32_t bits)
{
    dahl_q64_t g = dahl_kernel(dahl_travel(&plan, bits));
    return (uint64_t)g.hi << 32 | g.lo;
}

/* The step itself: from rest the gap is 1, so the state is g, cut to Q62. */
static int step_agrees(uint32_t bits, uint64_t g)
{
    dahl_state_t there = {0}, back = {0};
    (void)dahl_step(&plan, &there, dahl_float_of(bits));
    (void)dahl_step(&plan, &back, dahl_float_of(bits | DAHL_BITS_SIGN));
    return there.w == (int64_t)(g >> 2) && back.w == -(int64_t)(g >> 2);
}

static void compare(tally_t *t, uint32_t bits, double value, double want)
{
    const double limit = DAHL_KERNEL_ERROR - REFERENCE_ERROR;
    double over = value - want, error = (over > UNITS ? over - UNITS : over < 0 ? over : 0) / want;
    if (value == 0) { /* travel that counts as none */
        t->wrong += want >= 0x1p-64;
        return;
    }
    t->wrong += !(error <= limit && error >= -limit);
    if (error > t->high.error) {
        t->high = (worst_t){error, bits};
    }
    if (error < t->low.error) {
        t->low = (worst_t){error, bits};
    }
}

/* Ones for all travel from some float on, and none where the exact value is not above 1 - 2^-32, but for the rounding of v. */
static void count_ones(tally_t *t, uint32_t bits, uint64_t g, double want)
{
    if (g == UINT64_MAX && t->first_one == 0) {
        t->first_one = bits;
    }
    t->overflows += (g == UINT64_MAX) != (t->first_one != 0) || (g == UINT64_MAX && want <= 1 - 0x1.00001p-32);
}

static void check_normal(tally_t *t, uint32_t first, uint32_t last, uint32_t stride)
{
    anchor_t a = {0, 0, 0, 0};
    t->before = first > DAHL_BITS_NORMAL ? kernel(first - 1) : 0;
    for (uint64_t bits = first; bits < last; bits += stride) {
        uint32_t b = (uint32_t)bits;
        if (a.first != b >> BLOCK_BITS << BLOCK_BITS) {
            a = anchor_at(b >> BLOCK_BITS << BLOCK_BITS);
        }
        uint64_t g = kernel(b);
        double want = reference(&a, (double)dahl_float_of(b));
        compare(t, b, ldexp((double)g, -64), want);
        count_ones(t, b, g, want);
        t->falls += g < t->before;
        t->before = g;
        t->steps += !step_agrees(b, g);
        t->floats++;
    }
}

/* Zero, subnormal, infinite, NaN, of both signs: no motion but for infinity. */
static void check_far(tally_t *t, uint32_t first, uint32_t last, uint32_t stride)
{
    const int64_t start = 0x123456789abcdef;
    for (uint64_t bits = first; bits < last; bits += stride) {
        uint32_t b = (uint32_t)bits;
        int64_t size = b == DAHL_BITS_INF ? (int64_t)DAHL_ONE_Q62 : start;
        dahl_state_t there = {start}, back = {-start};
        (void)dahl_step(&plan, &there, dahl_float_of(b));
        (void)dahl_step(&plan, &back, dahl_float_of(b | DAHL_BITS_SIGN));
        t->steps += there.w != size || back.w != -size;
        t->floats++;
    }
}

static uint32_t clamped(uint32_t value, uint32_t low, uint32_t high)
{
    return value < low ? low : value > high ? high : value;
}

static void check_all(tally_t *t, uint32_t first, uint32_t last, uint32_t stride)
{
    uint32_t normal = clamped(DAHL_BITS_NORMAL, first, last), far = clamped(DAHL_BITS_INF, first, last);
    check_far(t, first, normal, stride);
    check_normal(t, normal, far, stride);
    check_far(t, far, last, stride);
    if (far != last && stride != 1) {
        check_far(t, DAHL_BITS_INF, DAHL_BITS_INF + 1, 1);
    }
}

/* By MPFR alone, in its own precision. */
static double again(uint32_t bits)
{
    (void)mpfr_set_d(x, -(double)dahl_float_of(bits), MPFR_RNDN);
    (void)mpfr_expm1(x, x, MPFR_RNDN);
    (void)mpfr_neg(x, x, MPFR_RNDN);
    (void)mpfr_set_uj_2exp(y, kernel(bits), -64, MPFR_RNDN);
    (void)mpfr_sub(y, y, x, MPFR_RNDN);
    (void)mpfr_div(y, y, x, MPFR_RNDN);
    return mpfr_get_d(y, MPFR_RNDN);
}

static int report(const tally_t *t)
{
    printf("floats %llu\n", (unsigned long long)t->floats);
    printf("lowest %.6e at %a, by MPFR alone %.6e\n", t->low.error, (double)dahl_float_of(t->low.bits), again(t->low.bits));
    printf("highest %.6e at %a, by MPFR alone %.6e\n", t->high.error, (double)dahl_float_of(t->high.bits), again(t->high.bits));
    printf("bound %.17e\n", DAHL_KERNEL_ERROR);
    printf("ones from %a\n", (double)dahl_float_of(t->first_one));
    printf("beyond the bound %llu, falls %llu, one too early or late %llu, steps of another g %llu\n", (unsigned long long)t->wrong,
           (unsigned long long)t->falls, (unsigned long long)t->overflows, (unsigned long long)t->steps);
    return t->wrong + t->falls + t->overflows + t->steps != 0;
}

int main(int argc, char **argv)
{
    const uint32_t all = DAHL_BITS_SIGN;
    uint32_t first = argc == 4 ? (uint32_t)strtoul(argv[1], NULL, 0) : 0;
    uint32_t last = argc == 4 ? (uint32_t)strtoul(argv[2], NULL, 0) : all;
    uint32_t stride = argc == 4 ? (uint32_t)strtoul(argv[3], NULL, 0) : 1;
    const dahl_params_t one = {1.0f, 1.0f, 0.0f}; /* a = 1: an angle is its own travel */
    tally_t t = {0, 0, 0, 0, 0, 0, 0, {0, 0}, {0, 0}};
    if (stride == 0 || last > all || first >= last || dahl_prepare(&plan, &one) != DAHL_OK) {
        (void)fprintf(stderr, "error: use: kernel_all [FIRST LAST STRIDE], FIRST < LAST <= 0x80000000, STRIDE > 0\n");
        return 2;
    }
    mpfr_inits2(MPFR_BITS, x, y, (mpfr_ptr)0);
    check_all(&t, first, last, stride);
    int failed = report(&t);
    mpfr_clears(x, y, (mpfr_ptr)0);
    return failed;
}
