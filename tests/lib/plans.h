/* SPDX-License-Identifier: MIT */
/* Parameters and plans from a travel per count. */
#ifndef PLANS_H
#define PLANS_H

#include <unity.h>

#include "reference.h"

#define THETA 3.8e-4f

/* The travel of a count is near u; the exact travel follows from the floats. */
static inline dahl_params_t params_for(double u, float Fc)
{
    dahl_params_t p = {(float)(u * (double)Fc / (double)THETA), Fc, THETA};
    return p;
}

static inline dahl_plan_t plan_for(const dahl_params_t *p)
{
    dahl_plan_t plan;
    TEST_ASSERT_EQUAL_INT(DAHL_OK, dahl_prepare(&plan, p));
    return plan;
}

static inline void assert_torque(long double w, const dahl_params_t *p, float F, double ulps)
{
    TEST_ASSERT_TRUE(fabsl(F - w * p->Fc) <= (long double)ulps * ulp_of(p->Fc));
}

#endif
