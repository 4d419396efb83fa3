/* SPDX-License-Identifier: MIT */
/** Convert parameters to a plan. Each word of the plan is written once. If equal parameters are prepared again
 * while a tick reads the plan, no word changes at any moment. */
#include "check_params.h"
#include "kernel.h"
#include "prepare_table.h"

static DAHL_COLD void write_dahl_plan(dahl_plan_t *plan, const dahl_params_t *params)
{
    const int entries = (int)(sizeof plan->g / sizeof plan->g[0]);
    const dahl_real_t sigma0 = dahl_real_of_float(params->sigma0), Fc = dahl_real_of_float(params->Fc);
    const dahl_real_t log2_e = {DAHL_LOG2_E_Q31, -31};
    uint64_t a = dahl_quotient_q63(sigma0.mantissa, Fc.mantissa);
    int32_t exponent = sigma0.exponent - Fc.exponent - 63;
    dahl_wide_t a_per_ln2 = dahl_product(a, exponent, log2_e);
    plan->a_mantissa = (uint32_t)(a_per_ln2.mantissa >> 32);
    plan->a_exponent = a_per_ln2.exponent + 32 - (dahl_is_far(a_per_ln2.exponent + 32) ? DAHL_FAR : 0);
    plan->Fc_mantissa = Fc.mantissa;
    plan->Fc_exponent = Fc.exponent;
    dahl_write_table(plan->g, entries,
                     dahl_has_counts(params)
                         ? dahl_remaining_after(dahl_product(a, exponent, dahl_real_of_float(params->theta_per_count)))
                         : UINT64_MAX);
}

DAHL_COLD dahl_err_t dahl_prepare(dahl_plan_t *plan, const dahl_params_t *params)
{
    dahl_err_t err = dahl_check_params(params);
    if (err == DAHL_OK) {
        write_dahl_plan(plan, params);
    }
    return err;
}
