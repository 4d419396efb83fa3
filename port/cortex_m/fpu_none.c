/* SPDX-License-Identifier: MIT */
/* A core without FPU needs no preparation. */
#include "cortex_m.h"

void core_init(void)
{
}
