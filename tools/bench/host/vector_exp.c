/* SPDX-License-Identifier: MIT */
/* Rivals with an exponential in vectors: each tick is the map w -> e w + c. A block computes e and c in vectors, then w in a serial
 * loop of one multiply-add a tick. CMakeLists.txt compiles this file alone with -O3 -march=native -ffast-math, so that gcc calls
 * the vector exp of glibc (libmvec). */
#include "ways.h"

#include <math.h>
#include <string.h>
#ifdef HAS_SLEEF
#include <sleef.h>
#endif

static void move_block(run_t *r, const double *g, const int32_t *dcounts, double *w, size_t n)
{
    double e[VECTOR_BLOCK], c[VECTOR_BLOCK], now = r->w;
    for (size_t i = 0; i < n; i++) {
        e[i] = 1.0 - g[i];
        c[i] = dcounts[i] < 0 ? -g[i] : g[i];
    }
    for (size_t i = 0; i < n; i++) {
        now = e[i] * now + c[i];
        w[i] = now;
    }
    r->w = now;
}

void vector_exp_block(run_t *r, const int32_t *dcounts, double *w, size_t n)
{
    double g[VECTOR_BLOCK];
    for (size_t i = 0; i < n; i++) {
        g[i] = 1.0 - exp(-r->a * fabs((double)dcounts[i]));
    }
    move_block(r, g, dcounts, w, n);
}

#ifdef HAS_SLEEF
#ifdef __AVX512F__
typedef __m512d vector_t;
#define VECTOR_EXPM1 Sleef_expm1d8_u10avx512f
#else
typedef __m256d vector_t;
#define VECTOR_EXPM1 Sleef_expm1d4_u10avx2
#endif
enum { LANES = sizeof(vector_t) / sizeof(double) };

void sleef_block(run_t *r, const int32_t *dcounts, double *w, size_t n)
{
    double g[VECTOR_BLOCK] = {0};
    for (size_t i = 0; i < n; i++) {
        g[i] = -r->a * fabs((double)dcounts[i]);
    }
    for (size_t i = 0; i < n; i += LANES) {
        vector_t x;
        memcpy(&x, g + i, sizeof x);
        x = -VECTOR_EXPM1(x);
        memcpy(g + i, &x, sizeof x);
    }
    move_block(r, g, dcounts, w, n);
}
#endif
