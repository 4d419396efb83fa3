// SPDX-License-Identifier: MIT
// The headers from C++: each public function links.
#include <dahl.h>
#include <dahl_encoder.h>
#include <all_calls.h>
#include <own_headers.h>

#include <cstdio>

int main()
{
    dahl_params_t p = {100.0f, 0.5f, 6.2831853f / 16384};
    dahl_plan_t plan;
    dahl_state_t bearing = {};
    dahl_encoder_t encoder;
    if (dahl_prepare(&plan, &p) != DAHL_OK || dahl_encoder_init(&encoder, 16384, -1, 100) != DAHL_OK) {
        return 1;
    }
    dahl_encoder_home(&encoder, 10);
    dahl_step_counts_q30(&plan, &bearing, dahl_counts_between(0, 50, 16384));
    dahl_step_counts_q30(&plan, &bearing, dahl_encoder_move(&encoder, 0));
    dahl_step(&plan, &bearing, 0.0f);
    dahl_change_plan(&plan, &plan, &bearing);
    dahl_set_torque(&plan, &bearing, dahl_torque(&plan, &bearing));
    std::printf("%.9g\n", static_cast<double>(dahl_step_counts(&plan, &bearing, 40)));
    return all_calls[0] == 0;
}
