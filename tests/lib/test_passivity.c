/* SPDX-License-Identifier: MIT */
/*
 * Passivity: no motion makes energy. Units are Fc^2/sigma0, with w = F/Fc. The work of a step is s w' u, with the torque w'
 * after the step; the bristle stores (w'^2 - w^2)/2 of it. With the move m = s (w' - w) the loss is
 *     loss = s w' (u - m) + m^2/2
 * If each step has a loss of at least 0, no closed cycle from rest yields work, and no other cycle yields more than was stored.
 *
 * In words of n bits (the library: 32; w in Q(2n-2), z in Q(n-2), g in Q(2n)) a step rounds w to q = w - d, |d| <= D =
 * 2^-(n-1), and moves by m = z g - t with z = 1 - s q and 0 <= t < T = 2^-(2n-2). With u = -ln(1 - g), and W the state before
 * the cut,
 *     loss = g ((1 - z)^2 + s d (1 - z)) + g^2 z (1 - z/2) + (u - g) s W - t (u - s W) - t^2/2
 * The first term is at least -g D^2/4. The second is never negative, nor is the third while the torque opposes the motion. If
 * the torque helps, -(u - g) s W < (u - g) (z - 1), which the first two terms outweigh. The cut adds at most T. So
 *     loss >= -(T + g D^2/4)
 *
 * In the library g has the error r, which adds to d: the last term becomes g (D + r)^2/4. By counts u >= 2^-30 and r = 2^-32.
 * The first two terms then outweigh all negative ones: they are at least g^2/2 >= 2^-61 (1 - g) if w is near 0, else g w^2. So
 * no tick by counts makes energy. By angle r = 2^-29 and u may be near 0: 2^-62 + 1.6 2^-60 < 2^-59.
 */
#include <stdio.h>

#include "motions.h"
#include "plans.h"

#ifndef TEST_TICKS
#define TEST_TICKS 1000000
#endif

#define LEAST_LOSS_BY_COUNTS 0.0L
#define LEAST_LOSS_BY_ANGLE (-0x1p-59L)

typedef struct {
    dahl_plan_t plan;
    float angle_of_count; /* a power of two, so that a move of n counts is an exact float */
    long double travel_of_count;
} bristle_t;

static motion_t m = MOTION_START;

/* Travel of a count from 2^-30 to 8, of an angle from 2^-63. */
static bristle_t any_bristle(int by_angle)
{
    const float theta = 0x1p-20f, mantissa = 1.0f + (float)(motion_random(&m) >> 9) * 0x1p-23f;
    const dahl_params_t p = {ldexpf(mantissa, (int)(motion_random(&m) % 33u) - 10), 1.0f, theta};
    bristle_t bristle = {plan_for(&p), by_angle ? ldexpf(theta, -(int)(motion_random(&m) % 34u)) : theta, 0};
    bristle.travel_of_count = (long double)p.sigma0 * bristle.angle_of_count;
    return bristle;
}

/* Relaxed, saturated, or random. */
static int64_t any_state(void)
{
    const int64_t one = (int64_t)1 << 62, any = (int64_t)((uint64_t)motion_random(&m) << 32 | motion_random(&m)) >> 2;
    const uint32_t kind = motion_random(&m) % 4u;
    return kind == 0 ? any : kind == 1 ? (any < 0 ? -one : one) : 0;
}

/* 1 count, a few, or up to 2^20, with equal probability. */
static int32_t any_move(void)
{
    const uint32_t bits = motion_random(&m) % 3u * (motion_random(&m) % 11u);
    const int32_t n = 1 + (int32_t)(motion_random(&m) % (1u << bits));
    return motion_random(&m) & 64u ? n : -n;
}

/* The loss of a step; *loss_before uses the torque before the step, which does make energy, so the test can fail. */
static long double loss_of(const bristle_t *bristle, dahl_state_t *state, int32_t n, int by_angle, long double *loss_before)
{
    const int64_t before = state->w;
    const int s = n < 0 ? -1 : 1;
    if (by_angle) {
        (void)dahl_step(&bristle->plan, state, (float)n * bristle->angle_of_count);
    } else {
        (void)dahl_step_counts_q30(&bristle->plan, state, n);
    }
    const long double u = s * (long double)n * bristle->travel_of_count, move = s * (long double)(state->w - before) * 0x1p-62L;
    const long double loss = s * (long double)state->w * 0x1p-62L * (u - move) + move * move / 2;
    *loss_before = loss - move * u;
    return loss;
}

static void check_losses(int by_angle, long double bound)
{
    long double least = HUGE_VALL, least_before = 0, before;
    for (int t = 0; t < TEST_TICKS; t += 300) {
        const bristle_t bristle = any_bristle(by_angle);
        for (int k = 0; k < 30; k++) {
            dahl_state_t state = {any_state()};
            for (int i = 0; i < 10; i++) {
                least = fminl(least, loss_of(&bristle, &state, any_move(), by_angle, &before));
                least_before = fminl(least_before, before);
            }
        }
    }
    printf("least loss of a tick %.5Le, with the torque before it %.5Le\n", least, least_before);
    TEST_ASSERT_TRUE(least >= bound);
    TEST_ASSERT_TRUE(least_before < -0.01L);
}

static void test_no_tick_by_counts_makes_energy(void) { check_losses(0, LEAST_LOSS_BY_COUNTS); }
static void test_a_tick_by_angle_makes_less_energy_than_its_rounding(void) { check_losses(1, LEAST_LOSS_BY_ANGLE); }
