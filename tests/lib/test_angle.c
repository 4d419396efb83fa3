/* SPDX-License-Identifier: MIT */
/* The angle path: the bound of dahl.h on the hard motions, and the kernel's own bound on a dense sample of floats. */
#include <stdio.h>

#include "../../lib/model/kernel.h"
#include "kernel_check.h"
#include "motions.h"
#include "plans.h"

#ifndef TEST_TICKS
#define TEST_TICKS 1000000
#endif

#ifndef TEST_KERNEL_STRIDE
#define TEST_KERNEL_STRIDE 173u
#endif

static long double worst_by_angle(const dahl_params_t *p, motion_fn next, int ticks)
{
    dahl_plan_t plan = plan_for(p);
    dahl_state_t state;
    reference_t exact = reference_by_angle(p);
    motion_t motion = MOTION_START;
    long double worst = 0;
    dahl_set_torque(&plan, &state, 0.9f * p->Fc);
    exact.w_reversal = (long double)(0.9f * p->Fc) / p->Fc;
    for (int t = 0; t < ticks; t++) {
        float dtheta = (float)next(&motion) * THETA;
        long double w = reference_move(&exact, dtheta);
        long double error = fabsl(dahl_step(&plan, &state, dtheta) - w * p->Fc) / ulp_of(p->Fc);
        worst = error > worst ? error : worst;
    }
    return worst;
}

static const double travels[] = {1e-12, 1e-8, 1e-4, 0.3, 20.0};
#define TRAVELS (sizeof travels / sizeof travels[0])

static void test_motions(void)
{
    for (size_t i = 0; i < MOTIONS * TRAVELS; i++) {
        dahl_params_t p = params_for(travels[i % TRAVELS], i % 2 ? 2.739f : 0.0371f);
        p.theta_per_count = 0.0f; /* no counts: their travel may be too small for a plan */
        long double worst = worst_by_angle(&p, motions[i / TRAVELS].next, TEST_TICKS);
        printf("%-8s travel/tick %.0e  worst %.4Lf ulp of Fc\n", motions[i / TRAVELS].name, travels[i % TRAVELS], worst);
        TEST_ASSERT_TRUE_MESSAGE(worst <= DAHL_ULP_ANGLE, motions[i / TRAVELS].name);
    }
}

static void test_kernel_bound(void)
{
    kernel_worst_t worst = {0, 0, 0, 0};
    kernel_check(&worst, 0, 0x7f800000u, TEST_KERNEL_STRIDE);
    printf("kernel: worst relative error 2^%.2f at %a\n", log2(worst.error), (double)worst.u);
    TEST_ASSERT_TRUE(worst.error <= DAHL_KERNEL_ERROR);
    TEST_ASSERT_TRUE(worst.error > 0x1p-33); /* something was measured */
    TEST_ASSERT_EQUAL_INT(0, worst.falls); /* monotone */
}
