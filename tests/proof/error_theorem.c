/* SPDX-License-Identifier: MIT */
/*
 * A motion whose error nearly reaches the bound: error_theorem K N, dither of one count for 2^N ticks at u = 2^-K, K <= 29. It
 * starts at q = -2^(29-K), with almost half a unit more in w. Each count moves to the same distance beyond 0 and back, so the
 * rounding of the gap is the same at each tick: the state stays, and the exact solution leaves it. Then follows the leap of up
 * to 2^16 counts after which the Q30 result has the largest error. Print the errors in units of 2^-31.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "dahl.h"

#define UNIT 0x1p31L /* 1 in units of 2^-31 */

static long double w_of(const dahl_state_t *state)
{
    return (long double)state->w * 0x1p-62L;
}

/* Exact: dither leads to -+tanh(u/2); the rest of the start shrinks by exp(-2 u) per cycle. */
static long double after_dither(long double start, long double u, long double ticks)
{
    long double rest = -tanhl(u / 2);
    return rest + (start - rest) * expl(-u * ticks);
}

static long double worst_leap(const dahl_plan_t *plan, dahl_state_t from, long double x, long double u)
{
    long double worst = 0;
    for (int32_t n = 1; n <= 65536; n++) {
        dahl_state_t state = from;
        long double got = dahl_step_counts_q30(plan, &state, n) * (long double)DAHL_Q30;
        worst = fmaxl(worst, fabsl(got - (x - (1 - x) * expm1l(-u * n))));
    }
    return worst;
}

int main(int argc, char **argv)
{
    int k = argc == 3 ? atoi(argv[1]) : 0, n = argc == 3 ? atoi(argv[2]) : 0;
    dahl_plan_t plan;
    dahl_params_t p = {1.0f, 1.0f, ldexpf(1, -k)};
    if (k < 2 || k > 29 || n < 1 || n > 40 || dahl_prepare(&plan, &p) != DAHL_OK) {
        (void)fprintf(stderr, "error: use: error_theorem K N, 2 <= K <= 29, 1 <= N <= 40\n");
        return 2;
    }
    dahl_state_t state = {-((int64_t)1 << (61 - k)) + ((int64_t)1 << 31) - 65536};
    long double start = w_of(&state), u = ldexpl(1, -k);
    for (int64_t tick = (int64_t)1 << (n - 1); tick > 0; tick--) {
        (void)dahl_step_counts_q30(&plan, &state, 1);
        (void)dahl_step_counts_q30(&plan, &state, -1);
    }
    long double x = after_dither(start, u, ldexpl(1, n));
    printf("dither %.5Lf\n", (w_of(&state) - x) * UNIT);
    printf("leap %.5Lf\n", worst_leap(&plan, state, x, u) * UNIT);
    return 0;
}
