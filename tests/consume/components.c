/* SPDX-License-Identifier: MIT */
/* A user of the node and of the float form: each call links; print the torque of the literal form. */
#include <component_calls.h>
#include <stdio.h>

int main(void)
{
    const dahl_params_t params = {.sigma0 = 100.0f, .Fc = 0.5f, .theta_per_count = 6.2831853f / 16384};
    dahl_float_plan_t plan;
    dahl_float_state_t state = {0};
    if (dahl_float_prepare(&plan, &params) != DAHL_OK) {
        return 1;
    }
    printf("%.9g\n", (double)dahl_float_step_counts(&plan, &state, 100));
    return component_calls[0] == 0;
}
