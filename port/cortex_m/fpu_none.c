/* SPDX-License-Identifier: MIT */
/* A core without FPU is ready at once. */
#include "cortex_m.h"

void core_init(void)
{
}
