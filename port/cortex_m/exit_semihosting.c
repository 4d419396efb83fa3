/* SPDX-License-Identifier: MIT */
/* End the emulator with main's status; after a fault, with FAULT_STATUS. */
#include "cortex_m.h"
#include "semihosting.h"

enum { FAULT_STATUS = 70 };

void cortex_exit(int status)
{
    semihosting_exit(status);
}

void cortex_fault(void)
{
    static const char text[] = "error: fault on the target\n";
    semihosting_write(text, sizeof text - 1);
    semihosting_exit(FAULT_STATUS);
}
