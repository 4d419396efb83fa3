/* SPDX-License-Identifier: MIT */
/* Output and exit by RISC-V semihosting. A debugger recognises a call by the instructions before and after ebreak. */
#include "semihosting.h"

enum { SYS_OPEN = 0x01, SYS_WRITE = 0x05, SYS_EXIT = 0x18, SYS_EXIT_EXTENDED = 0x20, EXITED = 0x20026 };

static int32_t call(uint32_t operation, const void *argument)
{
    register uint32_t a0 __asm("a0") = operation;
    register const void *a1 __asm("a1") = argument;
    __asm volatile(".option push\n .option norvc\n .balign 16\n"
                   "slli zero, zero, 0x1f\n ebreak\n srai zero, zero, 7\n"
                   ".option pop"
                   : "+r"(a0)
                   : "r"(a1)
                   : "memory");
    return (int32_t)a0;
}

static uintptr_t console(void)
{
    static int32_t handle;
    static const char name[] = ":tt";
    const uintptr_t open[] = {(uintptr_t)name, 4 /* "w" */, sizeof name - 1};
    if (handle == 0) {
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
