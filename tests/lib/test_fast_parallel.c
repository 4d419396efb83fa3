/* SPDX-License-Identifier: MIT */
/* dahl_throughput_parallel_counts: against references in long double on every hard motion, in pieces of any length, bad input. */
#include <string.h>

#include "dahl_batch.h"
#include "motions.h"
#include "plans.h"
#include "slip_reference.h"

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

static dahl_throughput_element_t element(double sigma0, double Fc, double theta, int slips)
{
    dahl_throughput_element_t made = {{sigma0, Fc, theta}, slips, {0}, 0.0};
    return made;
}

/* Slip elements whose ways to slipping are spread over three decades below 1/u counts. */
static dahl_slip_params_t spread(uint32_t elements, double u)
{
    dahl_slip_params_t params = {elements, THETA, {0}, {0}};
    for (uint32_t k = 0; k < elements; k++) {
        params.Fc[k] = 0.7f / (float)(k % 3 + 1);
        params.sigma0[k] = (float)(u * pow(10.0, 3.0 * k / elements) * (double)params.Fc[k] / (double)THETA);
    }
    return params;
}

static void elements_of(dahl_throughput_element_t *elements, const dahl_slip_params_t *params)
{
    for (uint32_t k = 0; k < params->elements; k++) {
        elements[k] = element((double)params->sigma0[k], (double)params->Fc[k], (double)params->theta_per_count, 1);
    }
}

static void check_slip(uint32_t count, double u)
{
    dahl_throughput_element_t elements[DAHL_SLIP_MAX];
    const dahl_slip_params_t params = spread(count, u);
    slip_reference_t exact = slip_reference(&params);
    long double bound = ULP_SLIP * ulp_of_sum(slip_reference_Fc(&params));
    elements_of(elements, &params);
    TEST_ASSERT_EQUAL_INT(DAHL_OK, dahl_throughput_parallel_counts(elements, count, moves, F, TICKS));
    for (int t = 0; t < TICKS; t++) {
        TEST_ASSERT_TRUE(fabsl(F[t] - slip_reference_move(&exact, moves[t])) <= bound);
    }
}

static void test_slip_elements_are_exact(void)
{
    static const double travels[] = {2e-9, 1e-5, 3e-3, 0.08, 500.0};
    for (size_t m = 0; m < MOTIONS; m++) {
        make_moves(motions[m].next);
        for (size_t i = 0; i < sizeof travels / sizeof travels[0]; i++) {
            check_slip(i % 2 == 0 ? 1 : DAHL_SLIP_MAX, travels[i]);
        }
    }
}

/* Ten slip elements and three of Dahl's between them: more than are done at once. */
static void test_a_mix_is_the_sum(void)
{
    dahl_throughput_element_t elements[13];
    dahl_slip_params_t slips = spread(5, 2e-3);
    dahl_params_t bearing = params_for(0.01, 1.3f);
    for (size_t m = 0; m < MOTIONS; m++) {
        slip_reference_t slip = slip_reference(&slips);
        reference_t dahl = reference_by_counts(&bearing);
        long double bound = (long double)DAHL_ULP_COUNTS * ulp_of_sum(2 * slip_reference_Fc(&slips) + 3 * 1.3L);
        make_moves(motions[m].next);
        for (int k = 0; k < 13; k++) {
            elements[k] = element((double)bearing.sigma0, (double)bearing.Fc, (double)THETA, 0);
        }
        elements_of(elements, &slips);
        elements_of(elements + 7, &slips);
        TEST_ASSERT_EQUAL_INT(DAHL_OK, dahl_throughput_parallel_counts(elements, 13, moves, F, TICKS));
        for (int t = 0; t < TICKS; t++) {
            long double sum = 2 * slip_reference_move(&slip, moves[t]);
            sum += 3 * (long double)bearing.Fc * reference_move(&dahl, moves[t]);
            TEST_ASSERT_TRUE(fabsl(F[t] - sum) <= bound);
        }
    }
}

/* The deflections of slip elements have no error that depends on where a call ends. */
static void test_a_log_in_pieces_has_the_same_bits(void)
{
    dahl_throughput_element_t whole[3], pieces[3];
    dahl_slip_params_t params = spread(3, 0.02);
    motion_t lengths = MOTION_START;
    make_moves(motion_walk);
    elements_of(whole, &params);
    elements_of(pieces, &params);
    TEST_ASSERT_EQUAL_INT(DAHL_OK, dahl_throughput_parallel_counts(whole, 3, moves, F, TICKS));
    for (size_t done = 0; done < TICKS;) {
        size_t left = TICKS - done, n = motion_random(&lengths) % 1100u;
        n = n < left ? n : left;
        G[done + n] = 42.0f; /* of somebody else */
        TEST_ASSERT_EQUAL_INT(DAHL_OK, dahl_throughput_parallel_counts(pieces, 3, moves + done, G + done, n));
        done += n;
        TEST_ASSERT_TRUE(G[done] == 42.0f);
    }
    TEST_ASSERT_EQUAL_MEMORY(F, G, sizeof F);
    for (int k = 0; k < 3; k++) {
        TEST_ASSERT_TRUE(whole[k].x == pieces[k].x);
    }
}

static void test_nothing_in_parallel_is_no_torque(void)
{
    float zeros[3] = {1, 1, 1};
    TEST_ASSERT_EQUAL_INT(DAHL_OK, dahl_throughput_parallel_counts(NULL, 0, moves, zeros, 3));
    TEST_ASSERT_TRUE(zeros[0] == 0.0f && zeros[2] == 0.0f);
    TEST_ASSERT_EQUAL_INT(DAHL_OK, dahl_throughput_parallel_counts(NULL, 0, NULL, NULL, 0));
}

/* Whether the bad element is the first or the last. */
static void check_refused(double sigma0, double Fc, double theta, dahl_err_t code)
{
    for (int bad = 0; bad < 2; bad++) {
        dahl_throughput_element_t elements[2] = {{{100, 0.5, 1e-4}, 1, {0}, 3.0}, {{100, 0.5, 1e-4}, 1, {7}, 2.0}}, before[2];
        elements[bad].params = (dahl_throughput_params_t){sigma0, Fc, theta};
        (void)memcpy(before, elements, sizeof before);
        F[0] = 42.0f;
        moves[0] = 5;
        TEST_ASSERT_EQUAL_INT(code, dahl_throughput_parallel_counts(elements, 2, moves, F, 1));
        TEST_ASSERT_EQUAL_MEMORY(before, elements, sizeof before);
        TEST_ASSERT_TRUE(F[0] == 42.0f);
    }
}

static void test_bad_parameters_touch_nothing(void)
{
    const double bad[] = {(double)NAN, (double)INFINITY, 0.0, -1.0};
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
        check_refused(bad[i], 1, 1, DAHL_ERR_PARAM);
        check_refused(1, bad[i], 1, DAHL_ERR_PARAM);
        check_refused(1, 1, bad[i], DAHL_ERR_PARAM);
    }
    check_refused(0x1p64, 1, 1, DAHL_ERR_RANGE);
    check_refused(1, 0x1p-65, 1, DAHL_ERR_RANGE);
    check_refused(1, 1, 0x1p20, DAHL_ERR_RANGE);
    check_refused(1, 0x1p31, 1, DAHL_ERR_RANGE);
}
