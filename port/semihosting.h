/* SPDX-License-Identifier: MIT */
/* Semihosting, the debugger's channel, which QEMU implements. For tests and benchmarks only. Each kind of core has a file. */
#ifndef SEMIHOSTING_H
#define SEMIHOSTING_H

#include <stdint.h>

void semihosting_write(const char *text, uint32_t length); /* to the emulator's standard output */
void semihosting_exit(int status) __attribute__((noreturn));

#endif
