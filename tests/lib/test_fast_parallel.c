/* SPDX-License-Identifier: MIT */
/* dahl_throughput_parallel_counts against references in long double, and in pieces of any length. */
#include "dahl_batch.h"
#include "models.h"
#include "plans.h"

#ifndef TEST_TICKS
#define TEST_TICKS 1000000
#endif

#define TICKS (TEST_TICKS / 20)
#define ULP_SLIP 0.5001L /* dahl_batch.h */

static int32_t moves[TICKS];
static float F[TICKS], G[TICKS + 1];

static void make_moves(motion_fn next)
{
    motion_t motion = MOTION_START;
    for (int t = 0; t < TICKS; t++) {
        moves[t] = next(&motion);
    }
}

/* `dahls` Dahl elements, then the slip elements of the set, `times` times. */
static size_t make_elements(dahl_throughput_element_t *elements, const set_t *set, size_t dahls, size_t times)
{
    const dahl_slip_params_t slips = slip_params(set);
    const size_t count = dahls + times * slips.elements;
    for (size_t k = 0; k < count; k++) {
        const size_t j = k < dahls ? 0 : (k - dahls) % slips.elements;
        const float sigma0 = k < dahls ? set->p.sigma0 : slips.sigma0[j], Fc = k < dahls ? set->p.Fc : slips.Fc[j];
        const dahl_throughput_element_t made = {{(double)sigma0, (double)Fc, (double)THETA}, k >= dahls, {0}, 0.0};
        elements[k] = made;
    }
    return count;
}

/* The bound is in ulp of the sum of all Fc. */
static void check_sum(const set_t *set, size_t dahls, size_t times, long double bound)
{
    dahl_throughput_element_t elements[16];
    const dahl_slip_params_t params = slip_params(set);
    const size_t count = make_elements(elements, set, dahls, times);
    slip_reference_t slip = slip_reference(&params);
    reference_t dahl = reference_by_counts(&set->p);
    bound *= ulp_of_sum((long double)times * slip_reference_Fc(&params) + (long double)dahls * set->p.Fc);
    TEST_ASSERT_EQUAL_INT(DAHL_OK, dahl_throughput_parallel_counts(elements, count, moves, F, TICKS));
    for (int t = 0; t < TICKS; t++) {
        long double sum = (long double)times * slip_reference_move(&slip, moves[t]);
        sum += (long double)dahls * set->p.Fc * reference_move(&dahl, moves[t]);
        TEST_ASSERT_TRUE(fabsl(F[t] - sum) <= bound);
    }
}

/* Slip elements alone, and 10 of them with 3 Dahl elements, which is more than one block. */
static void test_the_sum_keeps_the_bound_on_hard_motions(void)
{
    static const double travels[] = {2e-9, 1e-5, 3e-3, 0.08, 500.0};
    for (size_t m = 0; m < MOTIONS; m++) {
        make_moves(motions[m].next);
        for (size_t i = 0; i < sizeof travels / sizeof travels[0]; i++) {
            const set_t set = {params_for(travels[i], 0.7f), i % 2 ? DAHL_SLIP_MAX : 1};
            check_sum(&set, 0, 1, ULP_SLIP);
        }
        const set_t mixed = {params_for(0.01, 1.3f), 5};
        check_sum(&mixed, 3, 2, DAHL_ULP_COUNTS);
    }
}

static void test_a_log_in_pieces_has_the_same_bits(void)
{
    dahl_throughput_element_t whole[3], pieces[3];
    const set_t set = {params_for(0.02, 0.7f), 3};
    motion_t lengths = MOTION_START;
    make_moves(motion_walk);
    (void)make_elements(whole, &set, 0, 1);
    (void)make_elements(pieces, &set, 0, 1);
    TEST_ASSERT_EQUAL_INT(DAHL_OK, dahl_throughput_parallel_counts(whole, 3, moves, F, TICKS));
    for (size_t done = 0; done < TICKS;) {
        size_t left = TICKS - done, n = motion_random(&lengths) % 1100u;
        n = n < left ? n : left;
        G[done + n] = 42.0f; /* must stay */
        TEST_ASSERT_EQUAL_INT(DAHL_OK, dahl_throughput_parallel_counts(pieces, 3, moves + done, G + done, n));
        done += n;
        TEST_ASSERT_TRUE(G[done] == 42.0f);
    }
    TEST_ASSERT_EQUAL_MEMORY(F, G, sizeof F);
    TEST_ASSERT_TRUE(whole[0].x == pieces[0].x && whole[1].x == pieces[1].x && whole[2].x == pieces[2].x);
}

/* The torque continues as that of elements that always had half of Fc. */
static void test_a_deflection_beyond_a_smaller_Fc_is_clamped(void)
{
    dahl_throughput_element_t halved[3], weak[3];
    const set_t set = {params_for(0.02, 0.7f), 3};
    make_moves(motion_walk);
    for (int32_t side = -1; side <= 1; side += 2) {
        const int32_t push = side * 1000000;
        (void)make_elements(halved, &set, 0, 1);
        (void)make_elements(weak, &set, 0, 1);
        for (int k = 0; k < 3; k++) {
            weak[k].params.Fc /= 2;
        }
        TEST_ASSERT_EQUAL_INT(DAHL_OK, dahl_throughput_parallel_counts(halved, 3, &push, F, 1));
        TEST_ASSERT_EQUAL_INT(DAHL_OK, dahl_throughput_parallel_counts(weak, 3, &push, G, 1));
        for (int k = 0; k < 3; k++) {
            halved[k].params.Fc /= 2;
        }
        moves[0] = -side; /* leaves the limit */
        TEST_ASSERT_EQUAL_INT(DAHL_OK, dahl_throughput_parallel_counts(halved, 3, moves, F, TICKS));
        TEST_ASSERT_EQUAL_INT(DAHL_OK, dahl_throughput_parallel_counts(weak, 3, moves, G, TICKS));
        TEST_ASSERT_EQUAL_MEMORY(G, F, sizeof F);
    }
}

static void test_no_elements_give_no_torque(void)
{
    float zeros[3] = {1, 1, 1};
    TEST_ASSERT_EQUAL_INT(DAHL_OK, dahl_throughput_parallel_counts(NULL, 0, moves, zeros, 3));
    TEST_ASSERT_TRUE(zeros[0] == 0.0f && zeros[2] == 0.0f);
    TEST_ASSERT_EQUAL_INT(DAHL_OK, dahl_throughput_parallel_counts(NULL, 0, NULL, NULL, 0));
}
