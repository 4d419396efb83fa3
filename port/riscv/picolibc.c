/* SPDX-License-Identifier: MIT */
/* Standard output and exit of picolibc, for the tests. */
#include <stdio.h>
#include <stdlib.h>

#include "semihosting.h"

static int put(char c, FILE *file)
{
    (void)file;
    semihosting_write(&c, 1);
    return (unsigned char)c;
}

static FILE output = FDEV_SETUP_STREAM(put, NULL, NULL, _FDEV_SETUP_WRITE);

FILE *const stdout = &output;
FILE *const stderr = &output;

void _exit(int status) __attribute__((noreturn));

void _exit(int status)
{
    semihosting_exit(status);
}
