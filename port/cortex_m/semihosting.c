/* SPDX-License-Identifier: MIT */
/* Output and exit by Arm semihosting. */
#include "semihosting.h"

enum { SYS_OPEN = 0x01, SYS_WRITE = 0x05, SYS_EXIT_EXTENDED = 0x20, EXITED = 0x20026 };

static int32_t call(uint32_t operation, const void *argument)
{
    register uint32_t r0 __asm("r0") = operation;
    register const void *r1 __asm("r1") = argument;
    __asm volatile("bkpt 0xAB" : "+r"(r0) : "r"(r1) : "memory");
    return (int32_t)r0;
}

static uintptr_t console(void)
{
    static int32_t handle = -1;
    static const char name[] = ":tt";
    const uintptr_t open[] = {(uintptr_t)name, 4 /* "w" */, sizeof name - 1};
    if (handle < 0) {
        handle = call(SYS_OPEN, open);
    }
    return (uintptr_t)handle;
}

void semihosting_write(const char *text, uint32_t length)
{
    const uintptr_t write[] = {console(), (uintptr_t)text, length};
    call(SYS_WRITE, write);
}

void semihosting_exit(int status)
{
    const uintptr_t end[] = {EXITED, (uintptr_t)status};
    for (;;) {
        call(SYS_EXIT_EXTENDED, end);
    }
}
