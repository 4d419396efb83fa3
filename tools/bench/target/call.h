/* SPDX-License-Identifier: MIT */
/*
 * The only place of counted calls. bench_call passes its arguments in their registers to bench_function, and returns its
 * result. Callers declare bench_call with the type of that function. The plugin counts between bench_site and bench_back.
 */
#ifndef CALL_H
#define CALL_H

typedef void (*bench_function_t)(void);

extern bench_function_t bench_function;

void bench_mark(void);

#endif
