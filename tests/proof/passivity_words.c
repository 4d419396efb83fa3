/* SPDX-License-Identifier: MIT */
/*
 * The step of gap.h in words of n bits, and its energy for every state, every g and both directions:
 *     passivity_words N      enumerates words of N bits, prints the least loss of energy and its bound
 *     passivity_words 32     compares the step with that of the library, a million times
 * Exit code 0 where no step makes more energy than its rounding.
 */
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>

#include "gap.h"
#include "passivity.h"

/* gap.h by its words: q = w in Q(n-2), a half rounded up; z = 1 - s q; w += s z g, the low product cut. */
static int64_t words_step(int n, int64_t w, int s, uint64_t g)
{
    const uint64_t mask = ((uint64_t)1 << n) - 1;
    int64_t half = (int64_t)1 << (n - 1);
    int64_t q = (w + half) >> n;
    uint64_t z = (uint64_t)(((int64_t)1 << (n - 2)) - s * q);
    int64_t move = (int64_t)(z * (g >> n) + ((z * (g & mask)) >> n));
    return w + s * move;
}

typedef struct {
    long double least; /* loss + rounding, least of all */
    int64_t w, range;
    uint64_t g, failures, steps;
} words_t;

static void words_check(words_t *all, int n, int64_t w, int s, uint64_t g, long double u)
{
    const double unit = ldexp(1, 2 - 2 * n);
    int64_t after = words_step(n, w, s, g);
    long double loss = PASSIVITY_LOSS(s * after * (long double)unit, s * (after - w) * (long double)unit, u);
    long double margin = loss + PASSIVITY_BOUND(n, ldexp((double)g, -2 * n));
    all->failures += margin < 0 || after > all->range || after < -all->range;
    all->steps++;
    if (loss < all->least) {
        all->least = loss;
        all->w = w;
        all->g = g;
    }
}

static words_t words_all(int n)
{
    words_t all = {1, 0, ((int64_t)1 << (2 * n - 2)) + ((int64_t)1 << (n - 1)) - 1, 0, 0, 0};
    for (uint64_t g = 0; g < (uint64_t)1 << (2 * n); g++) {
        long double u = -log1pl(-ldexpl(g, -2 * n));
        for (int64_t w = -all.range; w <= all.range; w++) {
            words_check(&all, n, w, 1, g, u);
            words_check(&all, n, w, -1, g, u);
        }
    }
    return all;
}

static uint64_t random64(void)
{
    static uint64_t x = 88172645463325252u;
    x ^= x << 13;
    x ^= x >> 7;
    return x ^= x << 17;
}

/* Full size: the template is the library's step. */
static int same_as_library(int times)
{
    const int64_t range = ((int64_t)1 << 62) + ((int64_t)1 << 31);
    int wrong = 0;
    for (int i = 0; i < times; i++) {
        int64_t w = (int64_t)random64() >> (1 + random64() % 62);
        uint64_t g = random64() >> random64() % 64;
        if (w >= range || w <= -range) {
            continue;
        }
        dahl_q64_t words = {(uint32_t)(g >> 32), (uint32_t)g};
        wrong += (int64_t)dahl_forward((uint64_t)w, words) != words_step(32, w, 1, g);
        wrong += (int64_t)dahl_backward((uint64_t)w, words) != words_step(32, w, -1, g);
    }
    printf("library: %d other results\n", wrong);
    return wrong != 0;
}

int main(int argc, char **argv)
{
    int n = argc == 2 ? atoi(argv[1]) : 0;
    if (n == 32) {
        return same_as_library(1000000);
    }
    if (n < 3 || n > 8) {
        (void)fprintf(stderr, "error: use: passivity_words N, 3 <= N <= 8, or 32\n");
        return 2;
    }
    words_t all = words_all(n);
    printf("words of %d bits: %llu steps, least loss %.6Le = %.4Lf T at w = %lld, g = %llu; beyond the bound %llu\n", n,
           (unsigned long long)all.steps, all.least, all.least / PASSIVITY_T(n), (long long)all.w, (unsigned long long)all.g,
           (unsigned long long)all.failures);
    return all.failures != 0;
}
