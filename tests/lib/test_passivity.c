/* SPDX-License-Identifier: MIT */
/*
 * No motion makes energy. In units of Fc^2/sigma0, w = F/Fc, the work of a step is s w' u, done with the torque w' after it, less what
 * the bristle stores more than before, (w'^2 - w^2)/2. With the move m = s (w' - w) that is
 *     loss = s w' (u - m) + m^2/2,
 * where nothing cancels. A closed cycle adds up its losses and gives back what it stored: so no cycle from rest yields work,
 * and none from elsewhere more than was stored, if no step has a loss below 0 but for its rounding.
 *
 * In words of n bits (the library: 32; w in Q(2n-2), z in Q(n-2), g in Q(2n)) a step takes w as q = w - d, |d| <= D = 2^-(n-1),
 * and moves by m = z g - t with z = 1 - s q and 0 <= t < T = 2^-(2n-2). With u = -ln(1 - g), and W the state before the cut,
 *     loss = g ((1 - z)^2 + s d (1 - z)) + g^2 z (1 - z/2) + (u - g) s W - t (u - s W) - t^2/2
 * The first term is at least -g D^2/4, the second is never negative, nor the third while the torque opposes the motion; where
 * it helps, -(u - g) s W < (u - g) (z - 1), which the first two outweigh. The cut makes T at most. In all
 *     loss >= -(T + g D^2/4)
 *
 * In the library u is what the motion says and g errs by r: that adds as d does, and makes g (D + r)^2/4 of the last term.
 * By counts, where u >= 2^-30 and r = 2^-32, the first two terms are more than all that is negative: at least g^2/2 >= 2^-61
 * (1 - g) where w is next to nothing, g w^2 elsewhere. So no tick by counts makes energy. By angle, r = 2^-29 and u may be
 * next to nothing: 2^-62 + 1.6 2^-60 < 2^-59.
 */
#include <stdio.h>

#include "motions.h"
#include "plans.h"

#ifndef TEST_TICKS
#define TEST_TICKS 1000000
#endif

#define BY_COUNTS 0.0L
#define BY_ANGLE 0x1p-59L

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

/* Relaxed, saturated, or any. */
static int64_t any_state(void)
{
    const int64_t one = (int64_t)1 << 62, any = (int64_t)((uint64_t)motion_random(&m) << 32 | motion_random(&m)) >> 2;
    const uint32_t kind = motion_random(&m) % 4u;
    return kind == 0 ? any : kind == 1 ? (any < 0 ? -one : one) : 0;
}

/* One count, a few, or up to 2^20, as often. */
static int32_t any_move(void)
{
    const uint32_t bits = motion_random(&m) % 3u * (motion_random(&m) % 11u);
    const int32_t n = 1 + (int32_t)(motion_random(&m) % (1u << bits));
    return motion_random(&m) & 64u ? n : -n;
}

/* The loss of a step, and what it would be with the torque before it, which does make energy: the measure can fail. */
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

static void check_losses(int by_angle, long double least_allowed)
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
    TEST_ASSERT_TRUE(least >= -least_allowed);
    TEST_ASSERT_TRUE(least_before < -0.01L);
}

static void test_no_tick_by_counts_makes_energy(void) { check_losses(0, BY_COUNTS); }
static void test_a_tick_by_angle_makes_less_energy_than_its_rounding(void) { check_losses(1, BY_ANGLE); }
