/* SPDX-License-Identifier: MIT */
/* Report cases and sizes to the host (tools/bench/target.py). */
#ifndef BENCH_H
#define BENCH_H

#include <stdint.h>

#include "call.h"

/* `case NAME`: the calls until the next case belong to it. */
void bench_case(const char *name);

/* `input SETTING STATE MOVE` in hexadecimal, before each call of a case whose worst input the table names. */
void bench_input(uint32_t setting, uint64_t state, uint32_t move);

/* `bytes TYPE VALUE`, of a type of the library */
void bench_bytes(const char *type, uint32_t bytes);
#define BENCH_BYTES(type) bench_bytes(#type, sizeof(type))

void bench_library(void);
void bench_parts(void);
void bench_rivals(void);
void bench_motions(void);
void bench_variants(void);
void bench_energy(void);
void bench_compensator(void);
void bench_commission(void);
void bench_any(void);
void bench_node(void);
void bench_seldom(void);
void bench_worst(void);
void bench_known_code(void);

#endif
