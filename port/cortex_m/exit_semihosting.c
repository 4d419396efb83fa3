/* SPDX-License-Identifier: MIT */
/* The end of main ends the emulator, with main's status; a fault ends it with another. */
#include "cortex_m.h"
#include "semihosting.h"

void cortex_exit(int status)
{
    semihosting_exit(status);
}

void cortex_fault(void)
{
    static const char text[] = "error: fault on the target\n";
    semihosting_write(text, sizeof text - 1);
    semihosting_exit(70);
}
