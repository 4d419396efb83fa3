/* SPDX-License-Identifier: MIT */
/* Start with the stored parameters, or with the defaults below. Then serve the bus and check the plans. The ticks do the rest. */
#include "can.h"
#include "drive.h"

enum { CHECK_TICKS = 10 };

/* For a first commissioning: only the inertia must be right, within a factor of 1.5. */
static const store_params_t defaults = {
    .Fc = 0.3f, .sigma0 = 60, .gain = 0.9f, .inertia = 0.0024f, .inertia_low = 0.0016f, .delay = 1, .noise = 1};

int main(void)
{
    store_params_t params = defaults;
    board_start();
    store_result_t stored = store_load(&params);
    if (!drive_start(&params, board_reset_cause())) { /* a good CRC, but numbers that no drive_set() accepted */
        params = defaults;
        stored = STORE_CORRUPT;
        (void)drive_start(&params, board_reset_cause());
    }
    can_start(&params, stored);
    for (uint32_t passes = 0;; passes++) {
        board_wait();
        can_serve();
        if (passes % CHECK_TICKS == 0) {
            drive_check();
        }
    }
}
