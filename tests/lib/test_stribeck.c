/* SPDX-License-Identifier: MIT */
/* Stribeck friction: the exact torque of each tick, energy, the return to a limit that fell, and stick-slip. The models of models.h
 * have a torque that depends on travel alone, so this one is tested here. */
#include <math.h>
#include <stdio.h>
#include <string.h>
#include <unity.h>

#include "../random.h"
#include "dahl_parts.h"
#include "motions.h"
#include "reference.h"

#ifndef TEST_TICKS
#define TEST_TICKS 200000
#endif
#define ONE_Q20 (1 << 20)

static uint64_t seed = 1;

/* In 0 .. 1. */
static float fraction(void)
{
    return (float)(random_u32(&seed) >> 8) * 0x1p-24f;
}

static dahl_stribeck_plan_t plan_of(const dahl_stribeck_params_t *p)
{
    dahl_stribeck_plan_t plan;
    TEST_ASSERT_EQUAL_INT(DAHL_OK, dahl_stribeck_prepare(&plan, p));
    return plan;
}

static float larger_of(const dahl_stribeck_params_t *p)
{
    return p->Fs > p->Fc ? p->Fs : p->Fc;
}

/* Fc(v) over the larger limit. */
static long double limit_of(const dahl_stribeck_params_t *p, long double speed)
{
    return (p->Fc - (p->Fc - (long double)p->Fs) * expl(-speed * speed)) / larger_of(p);
}

static long double speed_of_counts(const dahl_stribeck_params_t *p, int32_t dcounts)
{
    return p->speed_travel > 0 ? dcounts * ((long double)p->theta_per_count / p->speed_travel) : 0;
}

/* dF/dtheta = sigma0 (1 - s F/f), integrated for a constant f. Return F over the larger limit. */
static long double exact_move(const dahl_stribeck_params_t *p, long double w, int32_t dcounts, long double speed)
{
    const long double f = limit_of(p, speed), travel = fabsl((long double)dcounts) * p->theta_per_count;
    const long double end = dcounts < 0 ? -f : f;
    return w - (end - w) * expm1l(-travel * p->sigma0 / larger_of(p) / f);
}

/* Slow, near and beyond the Stribeck speed, in jumps, and any. */
static int32_t next_speed(uint32_t kind, int32_t tick)
{
    const uint32_t r = random_u32(&seed);
    switch (kind) {
    case 0: return (int32_t)(r % 100000);
    case 1: return (int32_t)(r % (4 * ONE_Q20));
    case 2: return tick / 50 % 2 ? 8 * ONE_Q20 : -1;
    default: return (int32_t)(r >> (r & 31));
    }
}

typedef struct {
    long double ulps, q30;
} worst_t;

static worst_t errors_of(const dahl_stribeck_params_t *p, size_t motion, uint32_t kind, int32_t ticks)
{
    const dahl_stribeck_plan_t plan = plan_of(p);
    const long double larger = larger_of(p);
    const int is_at_speed = kind < 4;
    dahl_state_t state = {0}, other = {0};
    motion_t m = MOTION_START;
    long double w = 0;
    worst_t worst = {0, 0};
    for (int32_t t = 0; t < ticks; t++) {
        const long double u = (long double)p->sigma0 * p->theta_per_count / larger;
        const int32_t dcounts = t == 0 && u < 1e-4L ? (int32_t)(1 / u) : motions[motion].next(&m);
        const int32_t speed_q20 = next_speed(kind, t);
        const float F = is_at_speed ? dahl_stribeck_step_at_speed(&plan, &state, dcounts, speed_q20)
                                    : dahl_stribeck_step_counts(&plan, &state, dcounts);
        const int32_t q30 = is_at_speed ? dahl_stribeck_step_at_speed_q30(&plan, &other, dcounts, speed_q20)
                                        : dahl_stribeck_step_counts_q30(&plan, &other, dcounts);
        w = exact_move(p, w, dcounts, is_at_speed ? speed_q20 * 0x1p-20L : speed_of_counts(p, dcounts));
        worst.ulps = fmaxl(worst.ulps, fabsl(F - w * larger) / ulp_of((float)larger));
        worst.q30 = fmaxl(worst.q30, fabsl(q30 * 0x1p-30L - w));
        TEST_ASSERT_TRUE(state.w == other.w && fabsf(F) <= (float)larger);
    }
    return worst;
}

static void test_each_tick_is_exact_for_its_limit(void)
{
    static const double travels[] = {1e-9, 1e-6, 1e-4, 1e-2, 0.3, 3.0, 20.0};
    static const float ratios[] = {0.7f, 1.0f, 0.5f, 1 / 15.99f, 0.9f, 1.6f, 15.99f}, counts[] = {4, 8, 1e9f, 100};
    worst_t worst = {0, 0};
    for (size_t motion = 0; motion < MOTIONS; motion++) {
        for (size_t k = 0; k < 7 * 7 * 9; k++) {
            const float Fs = k % 2 ? 3.99f : 0.0371f, ratio = ratios[k / 7 % 7], larger = ratio > 1 ? Fs * ratio : Fs;
            const float theta = 1e-3f, sigma0 = (float)(travels[k % 7] * (double)larger * 1e3);
            const uint32_t kind = (uint32_t)k / 49;
            const dahl_stribeck_params_t p = {sigma0, Fs, Fs * ratio, theta, kind == 4 ? 0 : theta * counts[kind % 4]};
            const worst_t one = errors_of(&p, motion, kind, TEST_TICKS / 20);
            worst.ulps = fmaxl(worst.ulps, one.ulps);
            worst.q30 = fmaxl(worst.q30, one.q30);
        }
    }
    printf("%.4Lf ulp, Q30 %.2Le\n", worst.ulps, worst.q30);
    TEST_ASSERT_TRUE(worst.ulps <= DAHL_ULP_STRIBECK && worst.q30 <= DAHL_STRIBECK_ERROR_Q30);
    TEST_ASSERT_TRUE(DAHL_ULP_STRIBECK <= 0.62 && DAHL_STRIBECK_ERROR_Q30 <= 6.6e-9 && DAHL_ENERGY_ERROR_STRIBECK <= 5e-9);
}

/* Work and stored energy in units of the larger limit squared over sigma0. At a constant limit f, s F dtheta = f (dtheta - s dF). */
static void test_no_motion_at_any_speeds_makes_energy(void)
{
    long double least = 0;
    for (int run = 0; run < TEST_TICKS / 200; run++) {
        const float Fs = 1.0f + fraction(), ratio = powf(2, 7.9f * (fraction() - 0.5f)), u = powf(2, -25 * fraction());
        const dahl_stribeck_params_t p = {u * fmaxf(Fs, Fs * ratio) * 1024, Fs, Fs * ratio, 1.0f / 1024, 0};
        const dahl_stribeck_plan_t plan = plan_of(&p);
        const int32_t amplitude = 1 << random_u32(&seed) % 12;
        const uint32_t kind = random_u32(&seed) % 4;
        dahl_state_t state = {0};
        long double loss = 0, way = 0;
        for (int32_t t = 0; t < 500; t++) {
            const int32_t n = t % 2 && run % 2 ? -amplitude : (int32_t)(random_u32(&seed) % (2 * (uint32_t)amplitude + 1)) - amplitude;
            const int32_t speed_q20 = next_speed(kind, t);
            const long double travel = (long double)p.sigma0 / larger_of(&p) * p.theta_per_count * fabsl((long double)n);
            const long double before = state.w * 0x1p-62L;
            (void)dahl_stribeck_step_at_speed_q30(&plan, &state, n, speed_q20);
            const long double after = state.w * 0x1p-62L, rise = n < 0 ? before - after : after - before;
            const long double work = limit_of(&p, speed_q20 * 0x1p-20L) * (travel - rise);
            loss += work - (after - before) * (after + before) / 2;
            way += travel;
            least = fminl(least, way > 0 ? loss / way : 0);
        }
    }
    printf("least loss %.2Le of the larger limit times the way\n", least);
    TEST_ASSERT_TRUE(least >= -(long double)DAHL_ENERGY_ERROR_STRIBECK);
}

/* A change of speed changes no torque. Travel brings F back to the limit that fell, without a step beyond it. */
static void test_a_torque_above_the_limit_returns_to_it_by_travel(void)
{
    const dahl_stribeck_params_t p = {100.0f, 0.75f, 0.5f, 1e-5f, 0};
    const dahl_stribeck_plan_t plan = plan_of(&p);
    for (int32_t s = -1; s <= 1; s += 2) {
        dahl_state_t state = {0};
        const float slow = dahl_stribeck_step_at_speed(&plan, &state, s * 1000000, 0);
        const dahl_state_t at_rest = state;
        TEST_ASSERT_EQUAL_FLOAT((float)s * 0.75f, slow);
        TEST_ASSERT_EQUAL_FLOAT(slow, dahl_stribeck_step_at_speed(&plan, &state, 0, 100 * ONE_Q20));
        TEST_ASSERT_TRUE(state.w == at_rest.w);
        float before = fabsf(slow);
        for (int32_t tick = 0; tick < 400; tick++) {
            const float F = fabsf(dahl_stribeck_step_at_speed(&plan, &state, s * 10, 100 * ONE_Q20));
            TEST_ASSERT_TRUE(F <= before && F >= 0.5f - 0x1p-24f);
            before = F;
        }
        TEST_ASSERT_FLOAT_WITHIN(0x1p-23f, 0.5f + 0.25f * expf(-8), before); /* 400 ticks of 0.02 Fc/sigma0 */
    }
}

static void test_opposite_motion_is_opposite(void)
{
    const dahl_stribeck_params_t p = {10.0f, 0.75f, 0.5f, 1e-3f, 0.02f};
    const dahl_stribeck_plan_t plan = plan_of(&p);
    dahl_state_t one = {0}, mirrored = {0};
    motion_t m = MOTION_START;
    for (int32_t t = 0; t < 10000; t++) {
        const int32_t dcounts = motion_walk(&m) * 4, speed = next_speed(3, t);
        TEST_ASSERT_TRUE(dahl_stribeck_step_counts(&plan, &one, dcounts) == -dahl_stribeck_step_counts(&plan, &mirrored, -dcounts));
        (void)dahl_stribeck_step_at_speed(&plan, &one, dcounts, speed);
        (void)dahl_stribeck_step_at_speed(&plan, &mirrored, -dcounts, -speed);
        TEST_ASSERT_TRUE(one.w == -mirrored.w);
    }
}

static void test_any_bits_of_a_state_and_a_plan_of_zeros_are_safe(void)
{
    static const dahl_stribeck_plan_t zeros;
    const dahl_stribeck_params_t p = {10.0f, 0.75f, 0.5f, 1e-3f, 0.02f};
    const dahl_stribeck_plan_t plan = plan_of(&p);
    for (int32_t k = 0; k < 10000; k++) {
        const int64_t bits = (int64_t)((uint64_t)random_u32(&seed) << 32 | random_u32(&seed));
        const int32_t n = (int32_t)random_u32(&seed), speed = k % 2 ? INT32_MIN : (int32_t)random_u32(&seed);
        dahl_state_t state = {bits}, still = {bits}, kept = {bits};
        TEST_ASSERT_TRUE(fabsf(dahl_stribeck_step_at_speed(&plan, &state, n >> k % 32, speed)) <= p.Fs);
        TEST_ASSERT_TRUE(fabsf(dahl_stribeck_step_counts(&plan, &still, 0)) <= p.Fs);
        TEST_ASSERT_TRUE(dahl_stribeck_step_counts(&zeros, &kept, n) == 0 && dahl_stribeck_step_at_speed(&zeros, &kept, n, speed) == 0);
    }
}

static void test_bad_parameters_are_refused_and_leave_the_plan(void)
{
    static const struct {
        dahl_stribeck_params_t p;
        dahl_err_t err;
    } cases[] = {
        {{0, 0.7f, 0.5f, 1e-3f, 1}, DAHL_ERR_PARAM},        {{10, NAN, 0.5f, 1e-3f, 1}, DAHL_ERR_PARAM},
        {{10, 0.7f, -0.5f, 1e-3f, 1}, DAHL_ERR_PARAM},      {{10, 0.7f, 0.5f, 0, 1}, DAHL_ERR_PARAM},
        {{10, 0.7f, 0.5f, 1e-3f, -1}, DAHL_ERR_PARAM},      {{10, 0.7f, 0.5f, 1e-3f, INFINITY}, DAHL_ERR_PARAM},
        {{10, 0.7f, 0.5f, 1e-3f, NAN}, DAHL_ERR_PARAM},     {{10, 0.7f, 0.7f / 16.1f, 1e-3f, 1}, DAHL_ERR_RANGE},
        {{10, 0.7f, 0.7f * 16.1f, 1e-3f, 1}, DAHL_ERR_RANGE}, {{10, 0.7f, 0.5f, 1e-3f, 3.99e-3f}, DAHL_ERR_RANGE},
        {{10, 0.7f, 0.5f, 1e-3f, 0x1p-65f}, DAHL_ERR_RANGE}, {{10, 0.7f, 0.5f, 1e-3f, 0x1p64f}, DAHL_ERR_RANGE},
        {{1e12f, 0.7f, 0.5f, 1e3f, 1e9f}, DAHL_ERR_RANGE},  {{10, 0.7f, 0.5f, 1e-3f, 4e-3f}, DAHL_OK},
        {{10, 0.7f, 0.7f, 1e-3f, 0}, DAHL_OK},
    };
    for (size_t k = 0; k < sizeof cases / sizeof cases[0]; k++) {
        dahl_stribeck_plan_t plan, before;
        memset(&plan, 0x5a, sizeof plan);
        before = plan;
        TEST_ASSERT_EQUAL_INT(cases[k].err, dahl_stribeck_prepare(&plan, &cases[k].p));
        TEST_ASSERT_TRUE(cases[k].err == DAHL_OK || memcmp(&plan, &before, sizeof plan) == 0);
    }
}

/* --- stick-slip: a mass on a friction, pulled by a spring of constant speed (Canudas de Wit 1995, Fig. 5 and Table 1) -------------- */

#define MASS 1.0
#define SPRING 2.0
#define PULL 0.1
#define SIGMA0 1e5
#define SIGMA2 0.4
#define STATIC 1.5
#define COULOMB 1.0
#define STRIBECK 1e-3
#define TICK 1e-5
#define SECONDS 28.0
#define STUCK 1e-3 /* m/s, of the mean over .1 s */

typedef struct {
    double x, v, z;
} axis_t;

/* LuGre without sigma1, in continuous time. */
static axis_t slope_of(axis_t a, double t)
{
    const double g = COULOMB + (STATIC - COULOMB) * exp(-a.v / STRIBECK * a.v / STRIBECK);
    const axis_t d = {a.v, (SPRING * (PULL * t - a.x) - SIGMA0 * a.z - SIGMA2 * a.v) / MASS, a.v - SIGMA0 * fabs(a.v) / g * a.z};
    return d;
}

static axis_t moved(axis_t a, axis_t d, double h)
{
    const axis_t sum = {a.x + h * d.x, a.v + h * d.v, a.z + h * d.z};
    return sum;
}

static void runge_kutta(axis_t *a, double t)
{
    const axis_t k1 = slope_of(*a, t), k2 = slope_of(moved(*a, k1, TICK / 2), t + TICK / 2);
    const axis_t k3 = slope_of(moved(*a, k2, TICK / 2), t + TICK / 2), k4 = slope_of(moved(*a, k3, TICK), t + TICK);
    *a = moved(moved(moved(moved(*a, k1, TICK / 6), k2, TICK / 3), k3, TICK / 3), k4, TICK / 6);
}

/* The same axis with the friction of the library, from counts. z is F. */
static void run_library(axis_t *a, double t, const dahl_stribeck_plan_t *plan, dahl_state_t *state, double count)
{
    const double before = floor(a->x / count);
    a->v += (SPRING * (PULL * t - a->x) - a->z - SIGMA2 * a->v) / MASS * TICK;
    a->x += a->v * TICK;
    a->z = (double)dahl_stribeck_step_counts(plan, state, (int32_t)(floor(a->x / count) - before));
}

/* Times at which the mass begins to slip. */
typedef struct {
    double mean, start[8];
    int slips, is_slipping;
} slips_t;

static void note_slip(slips_t *slips, double t, double v)
{
    slips->mean += (v - slips->mean) * TICK / 0.1;
    const int is_slipping = slips->mean > (slips->is_slipping ? STUCK : 10 * STUCK);
    if (is_slipping && !slips->is_slipping && slips->slips < 8) {
        slips->start[slips->slips++] = t;
    }
    slips->is_slipping = is_slipping;
}

static slips_t slips_of(const dahl_stribeck_plan_t *plan, double count)
{
    axis_t axis = {0, 0, 0};
    dahl_state_t state = {0};
    slips_t slips = {0};
    for (int k = 0; k < (int)(SECONDS / TICK); k++) {
        if (plan == NULL) {
            runge_kutta(&axis, k * TICK);
        } else {
            run_library(&axis, k * TICK, plan, &state, count);
        }
        note_slip(&slips, k * TICK, axis.v);
    }
    return slips;
}

static void test_a_pulled_mass_sticks_and_slips_as_in_continuous_time(void)
{
    const float count = 1e-10f;
    const dahl_stribeck_params_t p = {(float)SIGMA0, (float)STATIC, (float)COULOMB, count, (float)(STRIBECK * TICK)};
    const dahl_stribeck_params_t equal = {(float)SIGMA0, (float)COULOMB, (float)COULOMB, count, 0};
    const dahl_stribeck_plan_t plan = plan_of(&p), without = plan_of(&equal);
    const slips_t exact = slips_of(NULL, 0), library = slips_of(&plan, (double)count), steady = slips_of(&without, (double)count);
    for (int k = 0; k < exact.slips; k++) {
        printf("slip at %.4f s, in continuous time at %.4f s\n", library.start[k], exact.start[k]);
        TEST_ASSERT_DOUBLE_WITHIN(0.02, exact.start[k], library.start[k]);
    }
    TEST_ASSERT_EQUAL_INT(exact.slips, library.slips);
    TEST_ASSERT_TRUE(exact.slips >= 3);
    TEST_ASSERT_EQUAL_INT(1, steady.slips); /* without the fall from Fs to Fc the mass follows after its first slip */
}
