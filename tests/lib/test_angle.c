/* SPDX-License-Identifier: MIT */
/* The kernel g(u) = 1 - exp(-u). From rest with sigma0 = Fc, dahl_step leaves g in the state, cut to Q62. The relative error is
 * at most 2^-29, plus one unit of 2^-64 (lib/model/kernel.h) and the cut. The test samples the floats; --full tries all 2^31. */
#include <stdio.h>
#include <string.h>

#include "plans.h"

#ifndef TEST_KERNEL_STRIDE
#define TEST_KERNEL_STRIDE 173u
#endif

#define FIRST_NORMAL 0x00800000u /* subnormal angles count as 0 */
#define INFINITE 0x7f800000u

static void test_the_kernel_keeps_its_bound_and_is_monotone(void)
{
    const dahl_params_t p = {1.0f, 1.0f, 0.0f};
    const dahl_plan_t plan = plan_for(&p);
    long double worst = 0;
    int64_t before = 0;
    for (uint64_t bits = FIRST_NORMAL; bits < INFINITE; bits += TEST_KERNEL_STRIDE) {
        const uint32_t word = (uint32_t)bits;
        dahl_state_t state = {0};
        float u;
        memcpy(&u, &word, sizeof u);
        (void)dahl_step(&plan, &state, u);
        TEST_ASSERT_TRUE(state.w >= before);
        before = state.w;
        long double exact = -expm1l(-(long double)u), error = fabsl(ldexpl(state.w, -62) - exact) - 0x5p-64L;
        worst = fmaxl(worst, error / exact);
    }
    printf("kernel: worst relative error 2^%.2f\n", log2((double)worst));
    TEST_ASSERT_TRUE(worst <= 0x1p-29L && worst > 0x1p-33L);
}
