/* SPDX-License-Identifier: MIT */
/* Output of cases, stack depths and sizes for tools/bench/target.py. */
#ifndef BENCH_H
#define BENCH_H

#include <stdint.h>

#include "call.h"

/* Print `case NAME`: the following calls belong to it. */
void bench_case(const char *name);

/* Print `number NAME VALUE`. */
void bench_number(const char *name, uint32_t value);

/* Call bench_paint(BENCH_PAINT) before a call; afterwards this returns the bytes of stack that it used. */
#define BENCH_STACK_BYTES 960u
#define BENCH_STACK_WORD 0xA5C35A3Cu
#define BENCH_PAINT BENCH_STACK_BYTES + 64u, BENCH_STACK_WORD
uint32_t bench_depth(void);

void bench_library(void);
void bench_parts(void);
void bench_rivals(void);
void bench_motions(void);
void bench_variants(void);
void bench_energy(void);

#endif
