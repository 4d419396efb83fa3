/* SPDX-License-Identifier: MIT */
/* The debugger's channel, which QEMU answers: for tests and counting, not for a product. One file per kind of core. */
#ifndef SEMIHOSTING_H
#define SEMIHOSTING_H

#include <stdint.h>

void semihosting_write(const char *text, uint32_t length); /* to the emulator's standard output */
void semihosting_exit(int status) __attribute__((noreturn));

#endif
