/* SPDX-License-Identifier: MIT */
/* The laws of every model bit for bit, and facts of Dahl's model in closed form: sampling, symmetry, energy, loops, decay. */
#include "plans.h"
#define HOLDS(condition, words) TEST_ASSERT_TRUE_MESSAGE(condition, words)
#include "laws.h"
#include "loads.h"

#ifndef TEST_TICKS
#define TEST_TICKS 200000
#endif

enum { WALK = TEST_TICKS < 20000 ? 400 : 4000, TRAVELS = 5 };

static const double travels[TRAVELS] = {1e-7, 1e-4, 0.02, 0.7, 5.0};
static move_t walk[WALK];
static subject_t subject; /* small cores have a small stack */

static set_t set_for(const model_t *model, double travel, float Fc)
{
    return (set_t){params_for(travel, Fc), more_for(model, 4, 0.4f, 0.3f)};
}

static void make_walk(motion_fn next, load_fn load)
{
    motion_t motion = MOTION_START, loading = MOTION_START;
    for (int t = 0; t < WALK; t++) {
        const move_t move = {next(&motion), load(&loading)};
        walk[t] = move;
    }
}

static void test_each_model_keeps_its_contract(void)
{
    for (size_t i = 0; i < (size_t)MODELS * MOTIONS * TRAVELS; i++) {
        const model_t *model = &models[i % MODELS];
        const set_t set = set_for(model, travels[i / MODELS % TRAVELS], 2.5f);
        make_walk(motions[i / MODELS / TRAVELS].next, loads[i % LOADS].next);
        TEST_ASSERT_TRUE_MESSAGE(subject_begin(&subject, model, &set), model->name);
        check_walk(&subject, walk, WALK);
        check_ends(&subject);
    }
}

/* A plan of zeros gives no torque and moves no state in range; a word that no call leaves as a state is no undefined behaviour (seen
 * under the sanitizers), and no endless loop. */
static void test_plans_of_zeros_and_any_word_as_a_state(void)
{
    static const int32_t counts[] = {0, 1, -1, 8, -9, 1000, INT32_MAX, INT32_MIN};
    static const uint8_t words[] = {0x80, 0x7f, 0xff, 0xbf, 0x40, 0x55, 0x01};
    static const any_plan_t zeros;
    for (size_t i = 0; i < (size_t)MODELS * sizeof words; i++) {
        const model_t *model = &models[i % MODELS];
        const set_t set = set_for(model, i % 2 ? 1e-3 : 2.0, 1.0f);
        any_state_t state, before;
        TEST_ASSERT_TRUE(subject_begin(&subject, model, &set));
        for (size_t k = 0; k < sizeof counts / sizeof counts[0]; k++) {
            const move_t move = {counts[k], ONE_Q30 / (uint32_t)(k + 1)};
            memset(&state, words[i / MODELS], sizeof state);
            TEST_ASSERT_TRUE_MESSAGE(isfinite(model->step(&subject.plan, &state, &set, move)), model->name);
            memset(&state, words[i / MODELS], sizeof state);
            state.loaded.load_q30 = LOAD_MOST; /* it falls, which any plan takes */
            (void)model->step(&zeros, &state, &set, move); /* clamps it */
            state.loaded.load_q30 = LOAD_MOST;
            before = state;
            TEST_ASSERT_TRUE_MESSAGE(model->step(&zeros, &state, &set, move) == 0.0f, model->name);
            state.loaded.load_q30 = LOAD_MOST;
            TEST_ASSERT_EQUAL_MEMORY_MESSAGE(&before, &state, sizeof state, model->name);
            memset(&state, 0, sizeof state);
            TEST_ASSERT_TRUE_MESSAGE(model->step_q30 == NULL || model->step_q30(&zeros, &state, move) == 0, model->name);
        }
    }
}

/* F^2/(2 sigma0), of a stiffness that the load may scale: what a bristle gives back at most. */
static long double stored(const model_t *model, const set_t *set, long double F, uint32_t load)
{
    return F * F / (2 * (long double)set->p.sigma0 * (model->has_load == 1 ? load * 0x1p-30L : 1));
}

/* No count and no change of load stores more than the shaft gives. The mean of the torques before and after takes no more than the
 * curve between them: less than it by u^3/12 of the energy Fc^2/sigma0 at most, where a count travels u. */
static void check_energy(const model_t *model, const set_t *set)
{
    motion_t motion = MOTION_START;
    const long double u = (long double)set->p.sigma0 / set->p.Fc * set->p.theta_per_count;
    const long double slack = u * u * u / 4 * set->p.Fc * set->p.Fc / set->p.sigma0;
    long double F = 0, energy = 0;
    for (int t = 0; t < TEST_TICKS / 2; t++) {
        const uint32_t load = load_any(&motion) | 1u;
        const int s = motion_random(&motion) & 64u ? 1 : -1;
        const long double still = subject_step(&subject, &subject.state, 0, load), kept = stored(model, set, still, load);
        TEST_ASSERT_TRUE_MESSAGE(kept <= energy * (1 + 1e-6L) + 1e-12L, model->name);
        F = subject_step(&subject, &subject.state, s, load);
        energy = stored(model, set, F, load);
        TEST_ASSERT_TRUE_MESSAGE(s * (still + F) / 2 * set->p.theta_per_count >= energy - kept - slack, model->name);
    }
}

static void test_no_model_makes_energy(void)
{
    for (size_t i = 0; i < MODELS; i++) {
        const set_t set = set_for(&models[i], 0.05, 1.0f);
        if (models[i].step != slip_step && models[i].step != mix_step) { /* theirs is stored in several springs */
            TEST_ASSERT_TRUE(subject_begin(&subject, &models[i], &set));
            check_energy(&models[i], &set);
        }
    }
}

/* Angles of any size, down to those that count as none: the mirrored one mirrors the state. */
static void test_angles_are_odd(void)
{
    dahl_params_t p = params_for(0.01, 2.5f);
    dahl_plan_t plan = plan_for(&p);
    dahl_state_t x = {0}, y = {0};
    motion_t m = MOTION_START;
    for (int t = 0; t < TEST_TICKS / 2; t++) {
        float d = ldexpf((float)(int32_t)motion_random(&m), -31 - (int)(motion_random(&m) % 40u));
        float F = dahl_step(&plan, &x, d);
        TEST_ASSERT_TRUE(dahl_step(&plan, &y, -d) == -F && y.w == -x.w);
        TEST_ASSERT_TRUE(dahl_step(&plan, &x, -0.0f) == F && x.w == -y.w);
    }
}

/* The steady loop of amplitude A: tip Fc tanh(aA), work of a round 4 Fc A - 4 Fc^2/sigma0 tanh(aA); of an update the work is
 * Fc |dtheta| - s Fc/sigma0 (F after - F before). */
static void test_steady_loop(void)
{
    dahl_params_t p = params_for(0.01, 0.8f);
    dahl_plan_t plan = plan_for(&p);
    const long double length = p.Fc / (long double)p.sigma0;
    for (int32_t half = 1; half < 400; half = half * 3 + 1) {
        dahl_state_t state = {0};
        const long double A = half * (long double)p.theta_per_count, tip = p.Fc * tanhl(A / length);
        long double work = 0, F = 0;
        for (int t = 0; t < 4 * half * 5000; t++) {
            int32_t d = (t / (2 * half)) % 2 ? -1 : 1;
            long double next = dahl_step_counts(&plan, &state, d);
            work += t >= 4 * half * 4999 ? p.Fc * (long double)p.theta_per_count - d * length * (next - F) : 0;
            F = next;
        }
        assert_torque(-tip / p.Fc, &p, (float)F, 0.55);
        TEST_ASSERT_TRUE(fabsl(work - 4 * (p.Fc * A - length * tip)) < 4 * ulp_of(p.Fc) * (A + length));
    }
}

/* Dither of +-d lets a bias fall by exp(-2ad) a cycle, to -tanh(ad/2) after its backward half; no bias is lost faster. */
static void test_dither_decay(void)
{
    for (size_t i = 0; i < TRAVELS; i++) {
        dahl_params_t p = params_for(travels[i], 1.0f);
        dahl_plan_t plan = plan_for(&p);
        dahl_state_t state = {0};
        long double u = reference_by_counts(&p).a, rest = -tanhl(u / 2);
        dahl_set_torque(&plan, &state, 0.9f);
        for (int cycle = 1; cycle <= TEST_TICKS; cycle++) {
            (void)dahl_step_counts_q30(&plan, &state, 1);
            float F = dahl_step_counts(&plan, &state, -1);
            if (cycle % 997 == 1) {
                assert_torque(rest + (0.9f - rest) * expl(-2 * u * cycle), &p, F, DAHL_ULP_COUNTS);
            }
        }
    }
}

/* The travel that leads from F to F1 is Fc/sigma0 ln((s Fc - F)/(s Fc - F1)). */
static void test_travel_between_torques(void)
{
    dahl_params_t p = {40.0f, 0.5f, 0.0f};
    dahl_plan_t plan = plan_for(&p);
    for (int i = -8; i <= 8; i++) {
        for (int s = -1; s <= 1; s += 2) {
            dahl_state_t state = {0};
            float F = (float)i * 0.055f, F1 = s > 0 ? 0.46f : -0.46f;
            dahl_set_torque(&plan, &state, F);
            long double travel = p.Fc / (long double)p.sigma0 * logl((s * (long double)p.Fc - F) / (s * (long double)p.Fc - F1));
            TEST_ASSERT_TRUE(fabsl((long double)dahl_step(&plan, &state, (float)(s * travel)) - F1) < 2 * ulp_of(p.Fc));
        }
    }
}
