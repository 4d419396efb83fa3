/* SPDX-License-Identifier: MIT */
/* What a user writes: 100 counts on a 14-bit encoder, printed in N m. */
#include <dahl.h>
#include <stdio.h>

int main(void)
{
    dahl_params_t p = {.sigma0 = 100.0f, .Fc = 0.5f, .theta_per_count = 6.2831853f / 16384};
    dahl_plan_t plan;
    dahl_state_t bearing = {0};
    if (dahl_prepare(&plan, &p) != DAHL_OK) {
        return 1;
    }
    printf("%.9g\n", (double)dahl_step_counts(&plan, &bearing, 100));
    return 0;
}
