/* SPDX-License-Identifier: MIT */
/* Report cases, stack depths and sizes to the host (tools/bench/target.py). */
#ifndef BENCH_H
#define BENCH_H

#include <stdint.h>

#include "call.h"

/* `case NAME`: the calls until the next case belong to it. */
void bench_case(const char *name);

/* `input SETTING STATE MOVE` in hexadecimal, before each call of a case whose worst input the table names. */
void bench_input(uint32_t setting, uint64_t state, uint32_t move);

/* `number NAME VALUE` */
void bench_number(const char *name, uint32_t value);

/* Bytes of stack that a call used. Before the call, bench_paint(BENCH_PAINT). */
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
void bench_compensator(void);
void bench_worst(void);

#endif
