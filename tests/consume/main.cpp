// SPDX-License-Identifier: MIT
// The header from C++: every public function is named, so that each one links.
#include <dahl.h>

#include <cstdio>

int main()
{
    dahl_params_t p = {100.0f, 0.5f, 6.2831853f / 16384};
    dahl_plan_t plan;
    dahl_state_t bearing = {};
    if (dahl_prepare(&plan, &p) != DAHL_OK) {
        return 1;
    }
    dahl_step_counts_q30(&plan, &bearing, dahl_counts_between(0, 60, 16384));
    dahl_step(&plan, &bearing, 0.0f);
    dahl_change_plan(&plan, &plan, &bearing);
    dahl_set_torque(&plan, &bearing, dahl_torque(&plan, &bearing));
    std::printf("%.9g\n", static_cast<double>(dahl_step_counts(&plan, &bearing, 40)));
    return 0;
}
