/* SPDX-License-Identifier: MIT */
/* Batches: exact forms against single steps, bit for bit; throughput forms against long double. */
#include <fenv.h>
#include <string.h>

#include "dahl_batch.h"
#include "motions.h"
#include "plans.h"

#ifndef TEST_TICKS
#define TEST_TICKS 100000
#endif
#define MANY 37 /* channels: two whole chunks of 16, and 5 more */
#define BATCHES (TEST_TICKS / 50)

static const double travels[] = {1e-8, 1e-6, 1e-4, 1e-2, 0.3, 1.0, 20.0};
#define TRAVELS (sizeof travels / sizeof travels[0])

static int32_t moves[TEST_TICKS];
static float angles[TEST_TICKS], F[TEST_TICKS + 1], G[TEST_TICKS + 1];

static struct {
    dahl_params_t params[MANY];
    dahl_throughput_params_t wide[MANY];
    dahl_plan_t plans[MANY];
    dahl_state_t start[MANY], one[MANY], batch[MANY];
} channels;

static void fill(motion_fn next)
{
    motion_t motion = MOTION_START;
    for (int t = 0; t < TEST_TICKS; t++) {
        moves[t] = next(&motion);
        angles[t] = (float)moves[t] * THETA;
    }
}

static dahl_throughput_params_t in_double(const dahl_params_t *p)
{
    dahl_throughput_params_t q = {(double)p->sigma0, (double)p->Fc, (double)p->theta_per_count};
    return q;
}

static void set_channel(size_t c, const dahl_params_t *p)
{
    channels.params[c] = *p;
    channels.wide[c] = in_double(p);
    channels.plans[c] = plan_for(p);
    channels.start[c].w = 0;
}

static void assert_same(const float *got, const float *wanted, size_t n)
{
    TEST_ASSERT_EQUAL_MEMORY(wanted, got, n * sizeof(float));
}

/* --- the eight forms ------------------------------------------------------------------------------------------------ */

enum { ANGLE = 1, FAST = 2, ONE = 4 }; /* a form is a sum; ONE has one trajectory, that of channel 0 */

static void run(unsigned form, size_t count, size_t rows, float *out)
{
    dahl_err_t err = DAHL_OK;
    switch (form) {
    case 0: dahl_batch_counts_channels(channels.plans, channels.batch, count, moves, out, rows); break;
    case ANGLE: dahl_batch_channels(channels.plans, channels.batch, count, angles, out, rows); break;
    case FAST: err = dahl_throughput_counts_channels(channels.wide, channels.batch, count, moves, out, rows); break;
    case FAST + ANGLE: err = dahl_throughput_channels(channels.wide, channels.batch, count, angles, out, rows); break;
    case ONE: dahl_batch_counts(channels.plans, channels.batch, moves, out, rows); break;
    case ONE + ANGLE: dahl_batch(channels.plans, channels.batch, angles, out, rows); break;
    case ONE + FAST: err = dahl_throughput_counts(channels.wide, channels.batch, moves, out, rows); break;
    default: err = dahl_throughput(channels.wide, channels.batch, angles, out, rows);
    }
    TEST_ASSERT_EQUAL_INT(DAHL_OK, err);
}

static void run_single_steps(unsigned form, size_t count, size_t rows)
{
    memcpy(channels.one, channels.start, sizeof channels.one);
    for (size_t i = 0; i < count * rows; i++) {
        const size_t c = i % count;
        F[i] = form & ANGLE ? dahl_step(&channels.plans[c], &channels.one[c], angles[i])
                            : dahl_step_counts(&channels.plans[c], &channels.one[c], moves[i]);
    }
}

static long double ratio_in_range(int64_t w)
{
    const int64_t one = (int64_t)1 << 62, past = (int64_t)1 << 31;
    return w >= one + past ? 1 : w < -one - past ? -1 : (long double)w * 0x1p-62L;
}

static void check_bound(unsigned form, size_t count, size_t rows)
{
    reference_t exact[MANY];
    for (size_t c = 0; c < count; c++) {
        exact[c] = form & ANGLE ? reference_by_angle(&channels.params[c]) : reference_by_counts(&channels.params[c]);
        exact[c].w = ratio_in_range(channels.start[c].w);
    }
    for (size_t i = 0; i < count * rows; i++) {
        const long double move = form & ANGLE ? (long double)angles[i] : (long double)moves[i];
        assert_torque(reference_move(&exact[i % count], move), &channels.params[i % count], G[i], DAHL_ULP_COUNTS);
    }
}

/* Run a form from the start states, in G. Exact forms must have the bits and the states of single steps. */
static void check(unsigned form, size_t count, size_t rows)
{
    const size_t n = count * rows;
    memcpy(channels.batch, channels.start, sizeof channels.batch);
    G[n] = 42.0f; /* must stay */
    run(form, count, rows, G);
    TEST_ASSERT_TRUE(G[n] == 42.0f);
    if (form & FAST) {
        check_bound(form, count, rows);
        return;
    }
    run_single_steps(form, count, rows);
    assert_same(G, F, n);
    TEST_ASSERT_EQUAL_MEMORY(channels.one, channels.batch, count * sizeof channels.one[0]);
}

/* Fc is just below a power of two, because there an ulp is smallest relative to Fc. test_any_batch has the exact forms. */
static void test_a_fast_trajectory_on_each_motion_and_travel(void)
{
    for (size_t i = 0; i < MOTIONS * TRAVELS; i++) {
        const dahl_params_t p = params_for(travels[i % TRAVELS], 0x1.fffffep+0f);
        fill(motions[i / TRAVELS].next);
        set_channel(0, &p);
        check(ONE + FAST, 1, TEST_TICKS);
        check(ONE + FAST + ANGLE, 1, TEST_TICKS);
    }
}

/* w at both ends of its range and of its type. */
static const int64_t foreign[] = {((int64_t)1 << 62) + ((int64_t)1 << 31) - 1, ((int64_t)1 << 62) + ((int64_t)1 << 31),
                                  -((int64_t)1 << 62) - ((int64_t)1 << 31),    -((int64_t)1 << 62) - ((int64_t)1 << 31) - 1,
                                  INT64_MAX,                                   INT64_MIN};

/* Channels of one plan, of one plan but for one that is softer or has twice the torque, or each with another travel and Fc; some
 * with a foreign state. */
static void make_channels(motion_t *m, size_t count)
{
    const uint32_t kind = motion_random(m) % 4u, other = motion_random(m) % MANY, travel = motion_random(m) % TRAVELS;
    const size_t kinds = sizeof foreign / sizeof foreign[0], first = motion_random(m) % kinds;
    const int is_foreign = motion_random(m) % 4u == 0;
    for (size_t c = 0; c < count; c++) {
        const double u = kind == 2 ? travels[c % TRAVELS] * (1.0 + 0.01 * (double)c) : travels[travel];
        dahl_params_t p = params_for(u, kind == 2 ? 0.5f + 0.37f * (float)c : 1.7f);
        if (c == other) {
            p.sigma0 *= kind == 1 ? 0.8f : kind == 3 ? 2.0f : 1.0f;
            p.Fc *= kind == 3 ? 2.0f : 1.0f;
        }
        set_channel(c, &p);
        channels.start[c].w = is_foreign ? foreign[(first + c) % kinds] : 0;
    }
}

/* Moves of -most .. most counts; some have one long move, because a block uses the kernel for its largest move. */
static void make_moves(motion_t *m, size_t n)
{
    static const uint32_t most[] = {0, 1, 7, 8, 9, 15, 16, 17, 400};
    const uint32_t size = most[motion_random(m) % (sizeof most / sizeof most[0])];
    for (size_t i = 0; i < n; i++) {
        moves[i] = (int32_t)(motion_random(m) % (2 * size + 1)) - (int32_t)size;
    }
    if (motion_random(m) % 4u == 0) {
        moves[motion_random(m) % n] = 20000000;
    }
    for (size_t i = 0; i < n; i++) {
        angles[i] = (float)moves[i] * THETA;
    }
}

static void test_any_batch(void)
{
    motion_t m = MOTION_START;
    for (int i = 0; i < BATCHES; i++) {
        const unsigned form = motion_random(&m) % (2 * ONE);
        const size_t count = form & ONE ? 1 : motion_random(&m) % 2u ? 1 + motion_random(&m) % MANY : 16;
        const size_t rows = 1 + motion_random(&m) % (form & ONE ? TEST_TICKS / 10 : 300);
        make_channels(&m, count);
        make_moves(&m, count * rows);
        check(form, count, rows);
    }
}

/* Some processors take a hundred cycles for a subnormal number: no product may become one, whatever the moves. */
static void test_no_fast_form_underflows(void)
{
    static const uint32_t most[] = {15, 400, 16000, INT32_MAX};
    motion_t m = MOTION_START;
    for (int i = 0; i < 400; i++) {
        const uint32_t size = most[motion_random(&m) % 4u], reversal = motion_random(&m) % 3u;
        make_channels(&m, 16);
        for (int t = 0; t < 16 * 512; t++) { /* random signs, or few or no reversals */
            const uint32_t r = motion_random(&m);
            const int back = reversal == 0 ? (r & 1u) != 0 : reversal == 1 && t % 997 == 0;
            moves[t] = (int32_t)((r >> 1) % size) * (back ? -1 : 1);
            angles[t] = (float)moves[t] * THETA;
        }
        memcpy(channels.batch, channels.start, sizeof channels.batch);
        const unsigned form = FAST + motion_random(&m) % 2u + (motion_random(&m) % 2u) * ONE;
        feclearexcept(FE_ALL_EXCEPT);
        run(form, 16, 512, G);
        TEST_ASSERT_FALSE(fetestexcept(FE_UNDERFLOW));
    }
}

/* --- cuts, and bad input -------------------------------------------------------------------------------------------- */

static void test_a_batch_may_be_cut_anywhere_and_forms_may_alternate(void)
{
    dahl_params_t p = params_for(1e-2, 1.7f);
    dahl_throughput_params_t q = in_double(&p);
    reference_t exact = reference_by_counts(&p);
    dahl_plan_t plan = plan_for(&p);
    dahl_state_t state = {0};
    size_t t = 0;
    fill(motion_walk);
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

/* Several chunks must not offset a null pointer. */
static void test_empty_batches_change_no_state(void)
{
    dahl_state_t before[MANY];
    motion_t m = MOTION_START;
    make_channels(&m, MANY);
    memset(channels.batch, 0x11, sizeof channels.batch);
    memcpy(before, channels.batch, sizeof before);
    for (unsigned form = 0; form < 2 * ONE; form++) {
        run(form, MANY, 0, NULL);
        if (form < ONE) {
            run(form, 0, SIZE_MAX, NULL);
        }
    }
    TEST_ASSERT_EQUAL_MEMORY(before, channels.batch, sizeof before);
}

static void test_bad_angles_in_a_batch_are_as_in_single_steps(void)
{
    static const float bad[] = {1e-3f, NAN, -NAN, -0.0f, 1e-40f, -1e-3f, NAN, INFINITY, 1e-3f, -INFINITY, NAN, 3e38f, 2e-3f};
    enum { N = sizeof bad / sizeof bad[0] };
    const dahl_params_t p = params_for(1e-2, 2.5f);
    set_channel(0, &p);
    memcpy(angles, bad, sizeof bad);
    check(ANGLE, 1, N);
    check(ONE + ANGLE, 1, N);
    for (unsigned form = FAST; form <= ONE + FAST; form += ONE) {
        channels.batch[0].w = 0;
        run(form + ANGLE, 1, N, G);
        for (int t = 0; t < N; t++) {
            TEST_ASSERT_TRUE(fabsl((long double)G[t] - F[t]) <= 1.1L * ulp_of(p.Fc));
        }
    }
}

/* A NaN among short angles must not select a form for long ones, whose g errs by 2^-54 each tick. */
static void test_a_nan_does_not_spoil_short_angles(void)
{
    const dahl_throughput_params_t p = {1.0 + 0x1p-24, 1.0, 1.0};
    dahl_state_t state = {0};
    for (int t = 0; t < 512; t++) {
        angles[t] = t == 300 ? NAN : 0x1p-30f;
    }
    TEST_ASSERT_EQUAL_INT(DAHL_OK, dahl_throughput(&p, &state, angles, G, 512));
    const long double w = -expm1l(-511 * 0x1p-30L * p.sigma0);
    TEST_ASSERT_TRUE(fabsl((long double)state.w * 0x1p-62L - w) < 1e-9L * w);
}

/* The least travel must not go through maps of the torque, which round e by 2^-54, even if another channel jumps. */
static void test_the_least_travel_from_saturation_is_accurate(void)
{
    static const int32_t last[] = {1, INT32_MAX};
    const dahl_throughput_params_t p = {1.0 + 0x1p-24, 1.0, 0x1p-30};
    const int64_t one = (int64_t)1 << 62;
    for (unsigned i = 0; i < 4; i++) {
        const unsigned form = i % 2 ? FAST : FAST + ONE;
        for (int t = 0; t < 16 * 512; t++) {
            channels.wide[t % 16] = p;
            channels.batch[t % 16].w = -one;
            moves[t] = form == FAST && t % 16 == 15 ? last[i / 2] : 1;
        }
        run(form, 16, 512, G);
        const long double moved = -2 * expm1l(-512 * 0x1p-30L * p.sigma0);
        TEST_ASSERT_TRUE(fabsl((long double)(channels.batch[0].w + one) * 0x1p-62L - moved) < 1e-9L * moved);
    }
}

static void test_a_plan_of_zeros_gives_no_torque(void)
{
    static const unsigned exact[] = {0, ANGLE, ONE, ONE + ANGLE};
    static const int32_t counts[] = {1, -9, 0, INT32_MIN};
    static const float dtheta[] = {1.0f, -1e-9f, 0.0f, INFINITY}, zeros[4]; /* not -0.0f */
    const dahl_plan_t zero = {0};
    channels.plans[0] = zero;
    memcpy(moves, counts, sizeof counts);
    memcpy(angles, dtheta, sizeof dtheta);
    for (int64_t w = -((int64_t)1 << 62); w <= (int64_t)1 << 62; w += (int64_t)1 << 61) {
        channels.start[0].w = w;
        for (unsigned k = 0; k < 4; k++) {
            check(exact[k], 1, 4);
            assert_same(G, zeros, 4);
        }
    }
}
