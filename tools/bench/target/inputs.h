/* SPDX-License-Identifier: MIT */
/* Random inputs of the searches for the worst call: the same on each core. */
#ifndef INPUTS_H
#define INPUTS_H

#include <stdint.h>

uint32_t next_random(void);

/* Of all magnitudes and both signs: a state within +-2^62, a move in counts. */
int64_t random_state(void);
int32_t random_counts(void);

float float_of(uint32_t bits);
uint32_t bits_of(float x);

#endif
