/* SPDX-License-Identifier: MIT */
/* The error bounds of dahl.h and dahl_parts.h: each model on each hard motion with each travel per count, against long double. */
#include <stdio.h>

#include "models.h"
#include "plans.h"

#ifndef TEST_TICKS
#define TEST_TICKS 200000
#endif
#ifndef TEST_PARTS_TICKS /* of each model in dahl_parts.h */
#define TEST_PARTS_TICKS (TEST_TICKS < 20000 ? TEST_TICKS : TEST_TICKS / 4)
#endif

static const double travels[] = {1e-9, 1e-8, 1e-6, 1e-4, 1e-2, 0.3, 1.1, 3.0, 20.0};
#define TRAVELS (sizeof travels / sizeof travels[0])

typedef struct {
    const model_t *model;
    set_t set;
    double travel;
    size_t motion, load;
} run_t;

typedef struct {
    long double ulps, q30;
} worst_t;

/* Loads per tick in Q30. WOBBLE grows by the least step, TOP is at the end of the range and beyond it. */
enum { STEADY, WOBBLE, NOISE, ANY, TOP, WAVE, LOADS };

static uint32_t next_load(size_t kind, motion_t *m)
{
    const uint32_t r = motion_random(m);
    switch (kind) {
    case STEADY: return ONE_Q30;
    case WOBBLE: return ONE_Q30 - (r & 1u);
    case NOISE: return ONE_Q30 - (r >> 4);
    case ANY: return r >> 1 >> (motion_random(m) & 31u);
    case TOP: return r % 4 == 0 ? 0x80000000u | r : LOAD_MOST - (r & 1u);
    default: return (uint32_t)((1 << 30) + 0x3fff0000 * sin(1e-3 * m->tick++));
    }
}

/* Parameters of the kind k: small and large Fc, and the ends and the middle of `more`. */
static run_t run_of(const model_t *model, size_t motion, size_t i, size_t k)
{
    static const float elements[] = {1, 8, 2, 4}, breakaways[] = {0.5f, 0.9f, 1e-6f, 0.25f, 0.999f};
    static const float ratios[] = {1.31f / 1.99f, 24.0f, 0.91f, 0.00125f};
    run_t run = {model, {params_for(travels[i], k % 2 ? 3.99f : 0.0371f), elements[k % 4]}, travels[i], motion, k % LOADS};
    if (model->more == MORE_IS_RATIO) { /* travels[i] is relative to the larger Fc */
        run.set.more = ratios[k % 4];
        run.set.p.sigma0 *= fmaxf(run.set.more, 1.0f);
    } else if (model->more == MORE_IS_BREAKAWAY) {
        run.set.more = breakaways[k % 5];
    }
    return run;
}

/* The worst errors of a motion after a first push. */
static worst_t errors_of(const run_t *run, int ticks)
{
    const model_t *model = run->model;
    motion_t motion = MOTION_START, loading = MOTION_START;
    any_plan_t plan;
    any_state_t state, other;
    exact_t exact;
    worst_t worst = {0, 0};
    TEST_ASSERT_EQUAL_INT_MESSAGE(DAHL_OK, model->prepare(&plan, &run->set), model->name);
    memset(&state, 0, sizeof state);
    memset(&other, 0, sizeof other);
    exact_begin(&exact, model, &run->set);
    for (int t = 0; t < ticks; t++) {
        const int32_t push = run->travel < 1e-4 ? (int32_t)(1.0 / run->travel) : 1000;
        const move_t move = {t == 0 ? push : motions[run->motion].next(&motion), next_load(run->load, &loading)};
        const long double ratio = model->exact(&exact, move), F = ratio * whole_of(model, &run->set);
        long double error = fabsl(model->step(&plan, &state, &run->set, move) - F) / ulp_now(model, &run->set, move);
        worst.ulps = fmaxl(worst.ulps, error);
        if (model->step_q30 != NULL) {
            worst.q30 = fmaxl(worst.q30, fabsl(model->step_q30(&plan, &other, move) * (long double)DAHL_Q30 - ratio));
        }
    }
    TEST_ASSERT_TRUE_MESSAGE(model->step_q30 == NULL || memcmp(&state, &other, sizeof state) == 0, model->name);
    return worst;
}

/* Some cases have a tighter bound than their model. */
static long double q30_bound(const run_t *run)
{
    if (run->model->step == dahl_model_step) { /* docs/accuracy.md, as a function of the travel of a count */
        return fminl(0x1p-30L + 5 * 0x1p-64L / (long double)run->travel + 0x1p-38L, DAHL_ERROR_Q30);
    }
    if (run->model->step == loaded_step && run->load <= NOISE) {
        return 1.85e-9L;
    }
    return run->model->step == slip_step && run->set.more == 1.0f ? 1.52e-9L : (long double)run->model->q30_error;
}

static long double ulp_bound(const run_t *run)
{
    return run->model->step == slip_step && run->set.more == 1.0f ? 0.522L : (long double)run->model->ulps;
}

static void check_model(const model_t *model, size_t motion, int ticks)
{
    long double over_all = 0;
    for (size_t i = 0; i < TRAVELS; i++) {
        const run_t run = run_of(model, motion, i, i + i / LOADS + motion);
        const worst_t worst = errors_of(&run, ticks);
        printf("%s, %s, travel %.0e, Fc %g, %g, load %zu: %.4Lf ulp, Q30 %.2Le\n", model->name, motions[motion].name, travels[i],
               (double)run.set.p.Fc, (double)run.set.more, run.load, worst.ulps, worst.q30);
        TEST_ASSERT_TRUE_MESSAGE(worst.ulps <= ulp_bound(&run), model->name);
        TEST_ASSERT_TRUE_MESSAGE(worst.q30 <= q30_bound(&run), model->name);
        over_all = fmaxl(over_all, worst.ulps);
    }
    TEST_ASSERT_TRUE_MESSAGE(over_all > 0.4L, model->name); /* the rounding to float alone is 0.5 ulp */
}

static void check_motion(size_t motion)
{
    for (size_t i = 0; i < MODELS; i++) {
        int is_dahl = models[i].step == dahl_model_step || models[i].step == angle_step;
        check_model(&models[i], motion, is_dahl ? TEST_TICKS : TEST_PARTS_TICKS);
    }
}

static void test_sweep(void) { check_motion(0); }
static void test_dither(void) { check_motion(1); }
static void test_two_forward_one_back(void) { check_motion(2); }
static void test_random_walk(void) { check_motion(3); }
static void test_leaps(void) { check_motion(4); }

/* A double would need soft-double code on an FPU of single precision. */
static void test_the_unit_of_q30_is_a_float(void)
{
    TEST_ASSERT_EQUAL_size_t(sizeof(float), sizeof(1.0f * DAHL_Q30));
}

/* The tests above read the bounds from the headers, so a wider bound would only make them lenient. */
static void test_bounds_are_no_wider_than_documented(void)
{
    TEST_ASSERT_TRUE(DAHL_ULP_COUNTS <= 0.52 && DAHL_ULP_ANGLE <= 0.6 && DAHL_ULP_PARTS <= 0.55);
    TEST_ASSERT_TRUE(DAHL_ERROR_Q30 <= 1.21e-9 && DAHL_Q30 == 0x1p-30f && DAHL_SLIP_ERROR_Q30 <= 3.15e-9);
    TEST_ASSERT_TRUE(DAHL_ASYMMETRIC_ERROR_Q30 <= 1.41e-9 && DAHL_LOADED_ERROR_Q30 <= 4.7e-9);
    TEST_ASSERT_TRUE(model_with(MORE_IS_BREAKAWAY)->q30_error <= 3.1e-9 && DAHL_PARALLEL_ERROR_Q30(2) <= 4.1e-9);
    TEST_ASSERT_TRUE(DAHL_INVERSE_ERROR <= 1.5e-9);
}
