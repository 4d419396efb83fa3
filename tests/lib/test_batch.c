/* SPDX-License-Identifier: MIT */
/* Batches: exact forms against single steps, bit for bit; throughput forms against long double. */
#include <string.h>

#include "dahl_batch.h"
#include "motions.h"
#include "plans.h"

#ifndef TEST_TICKS
#define TEST_TICKS 100000
#endif
#define MANY 37 /* channels: two whole chunks of 16, and 5 more */
#define ROWS 3000

static const double travels[] = {1e-8, 1e-6, 1e-4, 1e-2, 0.3, 1.0, 20.0};
#define TRAVELS (sizeof travels / sizeof travels[0])

static int32_t moves[TEST_TICKS];
static float angles[TEST_TICKS], F[TEST_TICKS], G[TEST_TICKS];

static void fill(motion_fn next, float theta_per_count)
{
    motion_t motion = MOTION_START;
    for (int t = 0; t < TEST_TICKS; t++) {
        moves[t] = next(&motion);
        angles[t] = (float)moves[t] * theta_per_count;
    }
}

static dahl_throughput_params_t in_double(const dahl_params_t *p)
{
    dahl_throughput_params_t q = {(double)p->sigma0, (double)p->Fc, (double)p->theta_per_count};
    return q;
}

static void assert_same(const float *got, const float *wanted, size_t n)
{
    TEST_ASSERT_EQUAL_MEMORY(wanted, got, n * sizeof(float));
}

static void on_all_motions_and_travels(void (*check)(const dahl_params_t *), float Fc)
{
    for (size_t i = 0; i < MOTIONS * TRAVELS; i++) {
        dahl_params_t p = params_for(travels[i % TRAVELS], Fc);
        fill(motions[i / TRAVELS].next, p.theta_per_count);
        check(&p);
    }
}

static void check_exact_counts(const dahl_params_t *p)
{
    dahl_plan_t plan = plan_for(p);
    dahl_state_t one = {0}, batch = {0};
    for (int t = 0; t < TEST_TICKS; t++) {
        F[t] = dahl_step_counts(&plan, &one, moves[t]);
    }
    dahl_batch_counts(&plan, &batch, moves, G, TEST_TICKS);
    assert_same(G, F, TEST_TICKS);
    TEST_ASSERT_TRUE(one.w == batch.w);
}

static void check_exact_angles(const dahl_params_t *p)
{
    dahl_plan_t plan = plan_for(p);
    dahl_state_t one = {0}, batch = {0};
    for (int t = 0; t < TEST_TICKS; t++) {
        F[t] = dahl_step(&plan, &one, angles[t]);
    }
    dahl_batch(&plan, &batch, angles, G, TEST_TICKS);
    assert_same(G, F, TEST_TICKS);
    TEST_ASSERT_TRUE(one.w == batch.w);
}

static void check_throughput_counts(const dahl_params_t *p)
{
    dahl_throughput_params_t q = in_double(p);
    dahl_state_t state = {0};
    reference_t exact = reference_by_counts(p);
    TEST_ASSERT_EQUAL_INT(DAHL_OK, dahl_throughput_counts(&q, &state, moves, F, TEST_TICKS));
    for (int t = 0; t < TEST_TICKS; t++) {
        assert_torque(reference_move(&exact, moves[t]), p, F[t], DAHL_ULP_COUNTS);
    }
}

static void check_throughput_angles(const dahl_params_t *p)
{
    dahl_throughput_params_t q = in_double(p);
    dahl_state_t state = {0};
    reference_t exact = reference_by_angle(p);
    TEST_ASSERT_EQUAL_INT(DAHL_OK, dahl_throughput(&q, &state, angles, F, TEST_TICKS));
    for (int t = 0; t < TEST_TICKS; t++) {
        assert_torque(reference_move(&exact, (long double)angles[t]), p, F[t], DAHL_ULP_COUNTS);
    }
}

static void test_exact_forms_have_the_bits_of_single_steps(void)
{
    on_all_motions_and_travels(check_exact_counts, 2.739f);
    on_all_motions_and_travels(check_exact_angles, 2.739f);
}

/* Just below a power of two an ulp is smallest relative to Fc. */
static void test_throughput_forms_keep_the_bound(void)
{
    on_all_motions_and_travels(check_throughput_counts, 0x1.fffffep+0f);
    on_all_motions_and_travels(check_throughput_angles, 0x1.fffffep+0f);
}

/* States half way between two values in Q30, and next to it. */
static void test_counts_from_a_tie_have_the_bits_of_single_steps(void)
{
    static const uint32_t low[] = {0x7fffffffu, 0x80000000u, 0x80000001u};
    static const int32_t by[] = {1, -1, 8, -8, 9, -9, 1000, -1000, INT32_MAX, INT32_MIN};
    dahl_params_t p = params_for(0.3, 0.5f);
    dahl_plan_t plan = plan_for(&p);
    for (int64_t high = -(1 << 30) + 1; high < 1 << 30; high += 99999989) {
        for (size_t i = 0; i < sizeof low / sizeof low[0] * (sizeof by / sizeof by[0]); i++) {
            int64_t w = high * ((int64_t)1 << 32) + low[i % 3];
            dahl_state_t one = {w}, batch = {w};
            F[0] = dahl_step_counts(&plan, &one, by[i / 3]);
            dahl_batch_counts(&plan, &batch, &by[i / 3], G, 1);
            assert_same(G, F, 1);
            TEST_ASSERT_TRUE(one.w == batch.w);
        }
    }
}

typedef struct {
    dahl_params_t params[MANY];
    dahl_throughput_params_t in_double[MANY];
    dahl_plan_t plans[MANY];
    dahl_state_t one[MANY], batch[MANY];
} channels_t;

static channels_t channels;

static void set_channels(void)
{
    memset(&channels, 0, sizeof channels);
    for (size_t c = 0; c < MANY; c++) {
        channels.params[c] = params_for(travels[c % TRAVELS] * (1.0 + 0.01 * (double)c), 0.5f + 0.37f * (float)c);
        channels.in_double[c] = in_double(&channels.params[c]);
        channels.plans[c] = plan_for(&channels.params[c]);
    }
}

static void test_channels_have_the_bits_of_single_steps(void)
{
    for (size_t count = 1; count <= MANY; count++) {
        size_t rows = (size_t)ROWS / count;
        set_channels();
        fill(motions[count % MOTIONS].next, THETA);
        for (size_t i = 0; i < rows * count; i++) {
            F[i] = dahl_step_counts(&channels.plans[i % count], &channels.one[i % count], moves[i]);
        }
        dahl_batch_counts_channels(channels.plans, channels.batch, count, moves, G, rows);
        assert_same(G, F, rows * count);
        TEST_ASSERT_EQUAL_MEMORY(channels.one, channels.batch, sizeof channels.one);
        for (size_t i = 0; i < rows * count; i++) {
            F[i] = dahl_step(&channels.plans[i % count], &channels.one[i % count], angles[i]);
        }
        dahl_batch_channels(channels.plans, channels.batch, count, angles, G, rows);
        assert_same(G, F, rows * count);
    }
}

/* The inverse of an odd number modulo 2^64, by Newton. */
static uint64_t inverse_of(uint64_t odd)
{
    uint64_t x = odd;
    for (int i = 0; i < 5; i++) {
        x *= 2u - odd * x;
    }
    return x;
}

/* Torque without motion, by one trajectory and by channels, of which the first has another plan. */
static void check_still(const dahl_plan_t *plan, int64_t w)
{
    enum { COUNT = 3 };
    const dahl_params_t other = {1.0f, 0.3f, 0.0f};
    const dahl_plan_t plans[COUNT] = {plan_for(&other), *plan, *plan};
    const int32_t still[COUNT] = {0, 0, 0};
    dahl_state_t states[COUNT] = {{w / 3}, {-w}, {w}};
    for (size_t c = 0; c < COUNT; c++) {
        dahl_batch_counts(&plans[c], &states[c], still, G, 1);
        F[c] = dahl_torque(&plans[c], &states[c]);
        assert_same(G, &F[c], 1);
    }
    F[COUNT] = G[COUNT] = 42.0f; /* must stay */
    dahl_batch_counts_channels(plans, states, COUNT, still, G, 1);
    assert_same(G, F, COUNT + 1);
    TEST_ASSERT_TRUE(states[0].w == w / 3 && states[1].w == -w && states[2].w == w);
}

/* Find the upper bits t of w whose product with the mantissa of Fc is half way between two floats, or up to `near` from it: a
 * double may round it to the wrong side. */
static uint32_t check_ties(const dahl_plan_t *plan, uint64_t half, int64_t near)
{
    const uint64_t mask = 2 * half - 1, inverse = inverse_of(plan->Fc_mantissa | 1u);
    uint32_t found = 0;
    for (int64_t beside = -near; beside <= near; beside++) {
        uint64_t t = ((half + (uint64_t)beside) * inverse) & mask;
        if (t >> 31 == 1) {
            for (int more = 0; more <= 30; more++) { /* lower bits of w: all 0, and all 1 */
                check_still(plan, (int64_t)(t << more));
                check_still(plan, (int64_t)(((t + 1) << more) - 1));
            }
            found++;
        }
    }
    return found;
}

static void test_torques_next_to_a_tie_have_the_bits_of_single_steps(void)
{
    static const float Fc[] = {1.0f, 0x1.000002p+0f, 1.5f, 2.739f, 1e-9f, 1.8e+19f};
    for (size_t i = 0; i < sizeof Fc / sizeof Fc[0]; i++) {
        dahl_params_t p = {1.0f, Fc[i], 0.0f};
        dahl_plan_t plan = plan_for(&p);
        uint32_t found = check_ties(&plan, (uint64_t)1 << 38, 10000); /* for products below 2^63 */
        found += check_ties(&plan, (uint64_t)1 << 39, 20000);
        TEST_ASSERT_TRUE(found > 10);
        check_still(&plan, 1);
    }
}

static void check_throughput_channels(size_t count, size_t rows, int by_angle)
{
    reference_t exact[MANY];
    dahl_err_t err;
    set_channels();
    fill(motions[count % MOTIONS].next, THETA);
    for (size_t c = 0; c < count; c++) {
        exact[c] = by_angle ? reference_by_angle(&channels.params[c]) : reference_by_counts(&channels.params[c]);
    }
    err = by_angle ? dahl_throughput_channels(channels.in_double, channels.batch, count, angles, F, rows)
                   : dahl_throughput_counts_channels(channels.in_double, channels.batch, count, moves, F, rows);
    TEST_ASSERT_EQUAL_INT(DAHL_OK, err);
    for (size_t i = 0; i < rows * count; i++) {
        long double move = by_angle ? (long double)angles[i] : (long double)moves[i];
        assert_torque(reference_move(&exact[i % count], move), &channels.params[i % count], F[i], DAHL_ULP_COUNTS);
    }
}

static void test_throughput_channels_keep_the_bound(void)
{
    for (size_t count = 1; count <= MANY; count += 4) {
        check_throughput_channels(count, (size_t)TEST_TICKS / MANY, 0);
    }
    check_throughput_channels(16, 7, 0); /* too few rows for a table to pay */
    check_throughput_channels(18, 700, 1);
    check_throughput_channels(19, 700, 1);
}

/* Each move of -most .. most counts; few counts use a table. */
static void fill_up_to(int32_t most)
{
    for (int32_t t = 0; t < TEST_TICKS; t++) {
        moves[t] = t * 7 % (2 * most + 1) - most;
    }
}

/* Channels of one plan, but channel 7 has sigma0 divided by `softer`. */
static void check_few_counts_in_channels(const dahl_params_t *p, size_t count, float softer)
{
    enum { STEPS = 300 };
    dahl_params_t each[MANY];
    dahl_throughput_params_t q[MANY];
    dahl_plan_t plans[MANY];
    dahl_state_t one = {0}, exact[MANY] = {{0}}, fast[MANY] = {{0}};
    for (size_t c = 0; c < count; c++) {
        each[c] = *p;
        each[c].sigma0 /= c == 7 ? softer : 1.0f;
        q[c] = in_double(&each[c]);
        plans[c] = plan_for(&each[c]);
    }
    dahl_batch_counts_channels(plans, exact, count, moves, G, STEPS);
    TEST_ASSERT_EQUAL_INT(DAHL_OK, dahl_throughput_counts_channels(q, fast, count, moves, F, STEPS));
    for (size_t c = 0; c < count; c++, one.w = 0) {
        reference_t wanted = reference_by_counts(&each[c]);
        for (size_t i = c; i < STEPS * count; i += count) {
            assert_torque(reference_move(&wanted, moves[i]), p, F[i], DAHL_ULP_COUNTS);
            TEST_ASSERT_TRUE(G[i] == dahl_step_counts(&plans[c], &one, moves[i]));
        }
        TEST_ASSERT_TRUE(one.w == exact[c].w);
    }
}

static void test_moves_of_few_counts(void)
{
    static const int32_t most[] = {0, 1, 7, 8, 9, 15, 16, 17};
    for (size_t k = 0; k < sizeof most / sizeof most[0]; k++) {
        fill_up_to(most[k]);
        for (size_t i = 0; i < TRAVELS; i++) {
            dahl_params_t p = params_for(travels[i], 1.7f);
            check_exact_counts(&p);
            check_throughput_counts(&p);
            check_few_counts_in_channels(&p, 16, 1.0f);
            check_few_counts_in_channels(&p, 16, 1.25f);
            check_few_counts_in_channels(&p, MANY, 1.0f);
        }
    }
}

/* A block uses the kernel for its largest move and its stiffest channel. */
static void test_one_long_move_at_any_place_of_a_block(void)
{
    enum { COUNT = 17, STEPS = 300, ALL = COUNT * STEPS };
    static const size_t places[] = {0, 1, 16, 17, 33, 511, 512, 1023, ALL - COUNT, ALL - 2, ALL - 1};
    dahl_params_t p = params_for(1e-7, 1.0f), stiff = params_for(0.1, 1.0f);
    dahl_throughput_params_t q[COUNT];
    for (size_t c = 0; c < COUNT; c++) {
        q[c] = in_double(c == 0 ? &stiff : &p);
    }
    for (size_t k = 0; k < sizeof places / sizeof places[0]; k++) {
        dahl_state_t states[COUNT] = {{0}}, state = {0};
        reference_t exact[COUNT] = {reference_by_counts(&stiff)}, one = reference_by_counts(&p);
        for (size_t i = 0; i < ALL; i++) {
            moves[i] = i == places[k] ? 20000000 : 1;
            exact[i % COUNT] = 0 < i && i < COUNT ? one : exact[i % COUNT];
        }
        TEST_ASSERT_EQUAL_INT(DAHL_OK, dahl_throughput_counts_channels(q, states, COUNT, moves, F, STEPS));
        TEST_ASSERT_EQUAL_INT(DAHL_OK, dahl_throughput_counts(&q[1], &state, moves, G, ALL));
        for (size_t i = 0; i < ALL; i++) {
            assert_torque(reference_move(&exact[i % COUNT], moves[i]), &p, F[i], DAHL_ULP_COUNTS);
            assert_torque(reference_move(&one, moves[i]), &p, G[i], DAHL_ULP_COUNTS);
        }
    }
}

static void test_a_batch_may_be_cut_anywhere_and_forms_may_alternate(void)
{
    dahl_params_t p = params_for(1e-2, 1.7f);
    dahl_throughput_params_t q = in_double(&p);
    reference_t exact = reference_by_counts(&p);
    dahl_plan_t plan = plan_for(&p);
    dahl_state_t state = {0};
    size_t t = 0;
    fill(motion_walk, THETA);
    for (size_t n = 0; t + n < TEST_TICKS && n < 700; t += n, n++) {
        F[t + n] = 42.0f; /* must stay */
        if (n % 3 == 0) {
            dahl_batch_counts(&plan, &state, moves + t, F + t, n);
        } else {
            TEST_ASSERT_EQUAL_INT(DAHL_OK, dahl_throughput_counts(&q, &state, moves + t, F + t, n));
        }
        TEST_ASSERT_TRUE(F[t + n] == 42.0f);
    }
    TEST_ASSERT_TRUE(t > TEST_TICKS / 2);
    for (size_t i = 0; i < t; i++) {
        assert_torque(reference_move(&exact, moves[i]), &p, F[i], DAHL_ULP_COUNTS);
    }
}

static void test_empty_batches_change_no_state(void)
{
    dahl_params_t p = params_for(1e-2, 1.0f);
    dahl_throughput_params_t q = in_double(&p);
    dahl_plan_t plan = plan_for(&p);
    dahl_state_t state = {12345};
    dahl_batch_counts(&plan, &state, NULL, NULL, 0);
    dahl_batch(&plan, &state, NULL, NULL, 0);
    dahl_batch_counts_channels(&plan, &state, SIZE_MAX, NULL, NULL, 0);
    dahl_batch_counts_channels(NULL, NULL, 0, NULL, NULL, SIZE_MAX);
    dahl_batch_channels(NULL, NULL, 0, NULL, NULL, SIZE_MAX);
    TEST_ASSERT_EQUAL_INT(DAHL_OK, dahl_throughput_counts(&q, &state, NULL, NULL, 0));
    TEST_ASSERT_EQUAL_INT(DAHL_OK, dahl_throughput(&q, &state, NULL, NULL, 0));
    TEST_ASSERT_EQUAL_INT(DAHL_OK, dahl_throughput_counts_channels(NULL, NULL, 0, NULL, NULL, SIZE_MAX));
    TEST_ASSERT_EQUAL_INT(DAHL_OK, dahl_throughput_channels(&q, &state, 1, NULL, NULL, 0));
    set_channels(); /* several chunks must not offset a null pointer */
    TEST_ASSERT_EQUAL_INT(DAHL_OK, dahl_throughput_channels(channels.in_double, channels.batch, MANY, NULL, NULL, 0));
    TEST_ASSERT_TRUE(state.w == 12345);
}

/* w at both ends of its range and of its type. */
static const int64_t foreign[] = {((int64_t)1 << 62) + ((int64_t)1 << 31) - 1, ((int64_t)1 << 62) + ((int64_t)1 << 31),
                                  -((int64_t)1 << 62) - ((int64_t)1 << 31),    -((int64_t)1 << 62) - ((int64_t)1 << 31) - 1,
                                  3 * ((int64_t)1 << 61),                      -3 * ((int64_t)1 << 61),
                                  INT64_MAX,                                   INT64_MIN};
#define FOREIGN (sizeof foreign / sizeof foreign[0])

static void set_foreign(dahl_state_t *states)
{
    for (size_t c = 0; c < MANY; c++) {
        states[c].w = foreign[c % FOREIGN];
    }
}

/* Compare with the torques of single steps in F. */
static void check_foreign_throughput(dahl_err_t err, const float *got, size_t n)
{
    TEST_ASSERT_EQUAL_INT(DAHL_OK, err);
    for (size_t i = 0; i < n; i++) {
        TEST_ASSERT_TRUE(fabsl((long double)got[i] - F[i]) <= 2 * DAHL_ULP_ANGLE * ulp_of(channels.params[i % MANY].Fc));
    }
}

static void test_states_out_of_range_are_clamped_as_by_single_steps(void)
{
    enum { N = 40 * MANY };
    set_channels();
    fill(motion_walk, THETA);
    set_foreign(channels.one);
    set_foreign(channels.batch);
    for (size_t i = 0; i < N; i++) {
        F[i] = dahl_step_counts(&channels.plans[i % MANY], &channels.one[i % MANY], moves[i]);
    }
    dahl_batch_counts_channels(channels.plans, channels.batch, MANY, moves, G, N / MANY);
    assert_same(G, F, N);
    TEST_ASSERT_EQUAL_MEMORY(channels.one, channels.batch, sizeof channels.one);
    set_foreign(channels.batch);
    check_foreign_throughput(dahl_throughput_counts_channels(channels.in_double, channels.batch, MANY, moves, G, N / MANY), G, N);
    set_foreign(channels.batch);
    check_foreign_throughput(dahl_throughput_channels(channels.in_double, channels.batch, MANY, angles, G, N / MANY), G, N);
}

static void test_one_trajectory_from_a_state_out_of_range_is_clamped(void)
{
    enum { N = 300 };
    const dahl_params_t p = params_for(1e-4, 2.5f);
    const dahl_throughput_params_t q = in_double(&p);
    const dahl_plan_t plan = plan_for(&p);
    fill(motion_walk, p.theta_per_count);
    for (size_t k = 0; k < FOREIGN; k++) {
        dahl_state_t one = {foreign[k]}, batch = one, by_angle = one, fast = one, fast_by_angle = one;
        dahl_throughput_element_t element = {q, 0, one, 0.0};
        for (int t = 0; t < N; t++) {
            F[t] = dahl_step_counts(&plan, &one, moves[t]);
        }
        dahl_batch_counts(&plan, &batch, moves, G, N);
        assert_same(G, F, N);
        dahl_batch(&plan, &by_angle, angles, G, N);
        TEST_ASSERT_EQUAL_INT(DAHL_OK, dahl_throughput_counts(&q, &fast, moves, G + N, N));
        TEST_ASSERT_EQUAL_INT(DAHL_OK, dahl_throughput(&q, &fast_by_angle, angles, G + 2 * N, N));
        TEST_ASSERT_EQUAL_INT(DAHL_OK, dahl_throughput_parallel_counts(&element, 1, moves, G + 3 * N, N));
        for (int t = 0; t < 4 * N; t++) {
            TEST_ASSERT_TRUE(fabsl((long double)G[t] - F[t % N]) <= 2 * DAHL_ULP_ANGLE * ulp_of(p.Fc));
        }
    }
}

static void test_a_slip_element_with_any_deflection_stays_within_Fc(void)
{
    static const double any[] = {(double)NAN, (double)INFINITY, -(double)INFINITY, 1e300, -1e9};
    const dahl_params_t p = params_for(1e-2, 2.5f);
    fill(motion_walk, p.theta_per_count);
    for (size_t k = 0; k < sizeof any / sizeof any[0]; k++) {
        dahl_throughput_element_t element = {in_double(&p), 1, {0}, any[k]};
        TEST_ASSERT_EQUAL_INT(DAHL_OK, dahl_throughput_parallel_counts(&element, 1, moves, G, 300));
        for (int t = 0; t < 300; t++) {
            TEST_ASSERT_TRUE(fabsf(G[t]) <= p.Fc);
        }
    }
}

static void test_bad_angles_in_a_batch_are_as_in_single_steps(void)
{
    static const float bad[] = {1e-3f, NAN, -NAN, -0.0f, 1e-40f, -1e-3f, NAN, INFINITY, 1e-3f, -INFINITY, NAN, 3e38f, 2e-3f};
    enum { N = sizeof bad / sizeof bad[0] };
    dahl_params_t p = params_for(1e-2, 2.5f);
    dahl_throughput_params_t q = in_double(&p);
    dahl_plan_t plan = plan_for(&p);
    dahl_state_t one = {0}, batch = {0}, throughput = {0}, channel = {0};
    for (int t = 0; t < N; t++) {
        F[t] = dahl_step(&plan, &one, bad[t]);
    }
    dahl_batch(&plan, &batch, bad, G, N);
    assert_same(G, F, N);
    TEST_ASSERT_EQUAL_INT(DAHL_OK, dahl_throughput(&q, &throughput, bad, G, N));
    TEST_ASSERT_EQUAL_INT(DAHL_OK, dahl_throughput_channels(&q, &channel, 1, bad, G + N, N));
    for (int t = 0; t < 2 * N; t++) {
        TEST_ASSERT_TRUE(fabsl((long double)G[t] - F[t % N]) <= 1.1L * ulp_of(p.Fc));
    }
}

/* Alone, and with a good channel before or after. If the parameters are good, the batch is empty. */
static void test_bad_parameters_change_no_state(void)
{
    enum { OK = DAHL_OK, PARAM = DAHL_ERR_PARAM, RANGE = DAHL_ERR_RANGE };
    const double nan = (double)NAN, inf = (double)INFINITY;
    const struct {
        dahl_throughput_params_t params;
        int by_counts, by_angle;
    } cases[] = {{{nan, 1, 1}, PARAM, PARAM},          {{1, nan, 1}, PARAM, PARAM},          {{1, 1, nan}, PARAM, OK},
                 {{0, 1, 1}, PARAM, PARAM},            {{1, -1, 1}, PARAM, PARAM},           {{1, inf, 1}, PARAM, PARAM},
                 {{1, 1, 0}, PARAM, OK},               {{1, 1, -1}, PARAM, OK},              {{1e30, 1, 1}, RANGE, RANGE},
                 {{1, 1e-30, 1}, RANGE, RANGE},        {{1, 1, 1e-10}, RANGE, OK},           {{1, 1, 1048576}, RANGE, OK},
                 {{1, 1, 1048575}, OK, OK},            {{3, 1, 349525}, OK, OK},             {{3, 1, 349526}, RANGE, OK}, /* 2^20/3 */
                 {{1, 3, 0x1.800001p-29}, OK, OK},     {{1, 3, 0x1.7fffffp-29}, RANGE, OK},  {{0x1p-64, 0x1p-64, 0x1p-30}, OK, OK},
                 {{1, 0x1p64, 0x1p63}, RANGE, RANGE},  {{1e19, 1e-19, 1e-33}, RANGE, OK}};
    for (size_t i = 0; i < 2 * sizeof cases / sizeof cases[0]; i++) {
        const size_t bad = i % 2;
        const int by_counts = cases[i / 2].by_counts, by_angle = cases[i / 2].by_angle;
        dahl_throughput_params_t params[2] = {{1.0, 1.0, 0.1}, {1.0, 1.0, 0.1}};
        dahl_state_t states[2] = {{77}, {78}};
        const int32_t counts[2] = {5, 6};
        const float dtheta[2] = {0.5f, 0.6f};
        float out[2] = {-3.0f, -3.0f};
        params[bad] = cases[i / 2].params;
        TEST_ASSERT_EQUAL_INT(by_counts, dahl_throughput_counts(&params[bad], states, counts, out, by_counts == OK ? 0 : 2));
        TEST_ASSERT_EQUAL_INT(by_angle, dahl_throughput(&params[bad], states, dtheta, out, by_angle == OK ? 0 : 2));
        TEST_ASSERT_EQUAL_INT(by_counts, dahl_throughput_counts_channels(params, states, 2, counts, out, by_counts == OK ? 0 : 1));
        TEST_ASSERT_EQUAL_INT(by_angle, dahl_throughput_channels(params, states, 2, dtheta, out, by_angle == OK ? 0 : 1));
        TEST_ASSERT_TRUE(states[0].w == 77 && states[1].w == 78 && out[0] < -2.0f && out[1] < -2.0f);
    }
}

static void test_a_plan_of_zeros_gives_no_torque(void)
{
    const dahl_plan_t zero = {0};
    const int32_t dcounts[] = {1, -9, 0, INT32_MIN};
    const float none = 0.0f; /* not -0.0f */
    const float dtheta[] = {1.0f, -1e-9f, 0.0f, INFINITY};
    enum { N = sizeof dcounts / sizeof dcounts[0] };
    for (int64_t w = -((int64_t)1 << 62); w <= (int64_t)1 << 62; w += (int64_t)1 << 61) {
        dahl_state_t states[4] = {{w}, {w}, {w}, {w}};
        memset(F, 0xA5, 4 * N * sizeof F[0]);
        dahl_batch_counts(&zero, &states[0], dcounts, F, N);
        dahl_batch(&zero, &states[1], dtheta, F + N, N);
        dahl_batch_counts_channels(&zero, &states[2], 1, dcounts, F + 2 * N, N);
        dahl_batch_channels(&zero, &states[3], 1, dtheta, F + 3 * N, N);
        for (size_t i = 0; i < 4 * N; i++) {
            assert_same(&F[i], &none, 1);
        }
    }
}
