/* SPDX-License-Identifier: MIT */
/*
 * The one place from which counted calls are made. bench_call passes its arguments on to bench_function, untouched in
 * their registers, and what that returns comes back; callers declare it under the type of that function. The plugin counts
 * between bench_site and bench_back. bench_sp is the stack pointer at the call.
 */
#ifndef CALL_H
#define CALL_H

#include <stdint.h>

typedef void (*bench_function_t)(void);

extern bench_function_t bench_function;
extern uint32_t bench_sp;

void bench_mark(void);
void bench_paint(uint32_t bytes, uint32_t word); /* fills the stack below the caller */

#endif
