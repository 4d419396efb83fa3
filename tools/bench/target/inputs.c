/* SPDX-License-Identifier: MIT */
/* See inputs.h. */
#include "inputs.h"

#include <string.h>

static uint32_t random_word = 2463534242u;

uint32_t next_random(void)
{
    random_word ^= random_word << 13;
    random_word ^= random_word >> 17;
    random_word ^= random_word << 5;
    return random_word;
}

int64_t random_state(void)
{
    int64_t w = (int64_t)(((uint64_t)next_random() << 32 | next_random()) >> 2);
    w >>= next_random() % 62u;
    return next_random() & 1u ? w : -w;
}

int32_t random_counts(void)
{
    uint32_t n = next_random();
    return (int32_t)(n >> (next_random() % 32u)) * (next_random() & 1u ? 1 : -1);
}

float float_of(uint32_t bits)
{
    float x;
    memcpy(&x, &bits, sizeof x);
    return x;
}

uint32_t bits_of(float x)
{
    uint32_t bits;
    memcpy(&bits, &x, sizeof bits);
    return bits;
}
