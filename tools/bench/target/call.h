/* SPDX-License-Identifier: MIT */
/* 
 * The only place of counted calls. bench_call passes its arguments in their registers to bench_function and returns its result.
 * Callers declare it under the type of that function. The plugin counts between bench_site and bench_back. bench_sp is the stack
 * pointer at the call.
 */
#ifndef CALL_H
#define CALL_H

#include <stdint.h>

typedef void (*bench_function_t)(void);

extern bench_function_t bench_function;
extern uint32_t bench_sp;

void bench_mark(void);
void bench_paint(uint32_t bytes, uint32_t word); /* fill the stack below the caller */

#endif
