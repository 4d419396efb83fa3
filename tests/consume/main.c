/* SPDX-License-Identifier: MIT */
/* A user's program, compiled as C and as C++: print the torque in N m after 100 counts of a 14-bit encoder. */
#include <dahl.h>
#include <dahl_encoder.h>
#include <all_calls.h>
#include <own_headers.h>
#include <stdio.h>

int main(void)
{
    dahl_params_t p = {.sigma0 = 100.0f, .Fc = 0.5f, .theta_per_count = 6.2831853f / 16384};
    dahl_plan_t plan;
    dahl_state_t bearing = {0};
    dahl_encoder_t encoder;
    if (dahl_prepare(&plan, &p) != DAHL_OK || dahl_encoder_init(&encoder, 16384, +1, 0) != DAHL_OK) {
        return 1;
    }
    dahl_encoder_home(&encoder, 16300);
    printf("%.9g\n", (double)dahl_step_counts(&plan, &bearing, dahl_encoder_move(&encoder, 16)));
    return all_calls[0] == 0;
}
