/* SPDX-License-Identifier: MIT */
/* Friction of a bearing that moves 100 counts forward and 100 back. In a product, dahl_encoder.h gives the counts. */
#include <stdio.h>

#include "dahl.h"

void app_main(void);

void app_main(void)
{
    const dahl_params_t params = {100.0f, 0.5f, 6.2831853f / 16384}; /* sigma0 N m/rad, Fc N m, rad/count */
    static dahl_plan_t plan;
    static dahl_state_t bearing;
    if (dahl_prepare(&plan, &params) != DAHL_OK) {
        puts("bad parameters");
        return;
    }
    for (int tick = 1; tick <= 100; tick++) {
        float F = dahl_step_counts(&plan, &bearing, tick <= 50 ? 2 : -2);
        if (tick % 10 == 0) {
            printf("tick %d %.7f N m\n", tick, (double)F);
        }
    }
}
