/* SPDX-License-Identifier: MIT */
/* dahl_encoder.h: counts per tick of a counter that wraps, jumps, is homed, or counts backward. */
#include "dahl_encoder.h"
#include "motions.h"
#include "plans.h"

#include <stdlib.h>
#include <string.h>

#ifndef TEST_TICKS
#define TEST_TICKS 1000000
#endif

static const uint32_t moduli[] = {3, 4, 17, 4096, 10000, 65535, 65536, 0x80000001u, UINT32_MAX, 0};
#define MODULI (sizeof moduli / sizeof moduli[0])

static dahl_encoder_t encoder_for(uint32_t modulus, int sign, uint32_t largest_step)
{
    dahl_encoder_t encoder;
    memset(&encoder, 0x5a, sizeof encoder);
    TEST_ASSERT_EQUAL_INT(DAHL_OK, dahl_encoder_init(&encoder, modulus, sign, largest_step));
    return encoder;
}

static int64_t wheel(uint32_t modulus)
{
    return modulus == 0 ? (int64_t)1 << 32 : (int64_t)modulus;
}

static void test_an_encoder_of_zeros_never_moves(void)
{
    dahl_encoder_t encoder = {0};
    motion_t m = MOTION_START;
    dahl_encoder_home(&encoder, 12);
    for (int t = 0; t < 1000; t++) {
        TEST_ASSERT_EQUAL_INT32(0, dahl_encoder_move(&encoder, motion_random(&m)));
    }
    TEST_ASSERT_EQUAL_UINT32(0, encoder.jumps);
}

static dahl_err_t expected_code(uint32_t modulus, int sign, int64_t largest_step)
{
    if (sign != 1 && sign != -1) {
        return DAHL_ERR_PARAM;
    }
    return modulus == 1 || modulus == 2 || 2 * largest_step >= wheel(modulus) ? DAHL_ERR_RANGE : DAHL_OK;
}

/* The largest step must be below half of the modulus. */
static void test_bad_descriptions_are_refused_and_change_nothing(void)
{
    static const int signs[] = {1, -1, 0, 2, -2, 255}; /* 255 is -1 cut to 8 bits */
    enum { SIGNS = sizeof signs / sizeof signs[0] };
    for (size_t k = 0; k < (MODULI + 2) * SIGNS; k++) {
        const uint32_t modulus = k / SIGNS < MODULI ? moduli[k / SIGNS] : (uint32_t)(k / SIGNS - MODULI + 1);
        const int64_t half = wheel(modulus) / 2;
        for (int64_t step = half > 3 ? half - 3 : 0; step <= half + 3; step++) {
            const dahl_err_t wanted = expected_code(modulus, signs[k % SIGNS], step);
            dahl_encoder_t encoder = encoder_for(4096, -1, 55), before = encoder;
            TEST_ASSERT_EQUAL_INT(wanted, dahl_encoder_init(&encoder, modulus, signs[k % SIGNS], (uint32_t)step));
            TEST_ASSERT_TRUE(wanted == DAHL_OK || memcmp(&before, &encoder, sizeof before) == 0);
        }
    }
}

/* The move as the header defines it, in 64 bits. */
typedef struct {
    uint32_t modulus, largest_step, last, jumps;
    int sign, primed;
} counter_t;

static int32_t expected_move(counter_t *counter, uint32_t reading)
{
    int64_t n = wheel(counter->modulus), from = counter->last, to = reading;
    int64_t way = ((counter->sign * (to - from)) % n + n) % n;
    int was_primed = counter->primed;
    way = way < n - way ? way : way - n;
    counter->last = reading;
    counter->primed = 1;
    if (!was_primed) {
        return 0;
    }
    if (counter->largest_step != 0 && llabs(way) > (int64_t)counter->largest_step) {
        counter->jumps += counter->jumps != UINT32_MAX; /* does not wrap */
        counter->primed = 0;
        return 0;
    }
    return (int32_t)way;
}

static uint32_t any_reading(motion_t *m, const counter_t *counter)
{
    uint32_t near_limit = counter->largest_step + motion_random(m) % 5u - 2u, kind = motion_random(m) % 8u;
    uint32_t step = kind < 3 ? near_limit : motion_random(m) >> (motion_random(m) & 31u);
    return kind == 7 ? motion_random(m) : motion_random(m) & 64u ? counter->last + step : counter->last - step;
}

static void check_counter(motion_t *m, uint32_t modulus, uint32_t largest_step, int sign)
{
    dahl_encoder_t encoder = encoder_for(modulus, sign, largest_step);
    counter_t counter = {modulus, largest_step, 0, sign < 0 ? UINT32_MAX - 3 : 0, sign, 0};
    encoder.jumps = counter.jumps;
    for (int t = 0; t < TEST_TICKS / 1000; t++) {
        uint32_t reading = any_reading(m, &counter);
        if (motion_random(m) % 64u == 0) {
            dahl_encoder_home(&encoder, reading);
            counter.last = reading;
            counter.primed = 1;
        } else {
            TEST_ASSERT_EQUAL_INT32(expected_move(&counter, reading), dahl_encoder_move(&encoder, reading));
        }
    }
    TEST_ASSERT_EQUAL_UINT32(counter.jumps, encoder.jumps);
}

static void test_moves_and_jumps_of_any_counter(void)
{
    motion_t m = MOTION_START;
    for (size_t k = 0; k < 2 * MODULI; k++) {
        uint32_t modulus = moduli[k / 2], most = (uint32_t)((wheel(modulus) - 1) / 2);
        const uint32_t largest[] = {0, 1, most / 3, most};
        for (size_t i = 0; i < sizeof largest / sizeof largest[0]; i++) {
            if (largest[i] <= most) {
                check_counter(&m, modulus, largest[i], k % 2 != 0 ? -1 : +1);
            }
        }
    }
}

/* A wrong reading is within largest_step of a later right one, but not of the one before. */
static void test_no_move_returns_from_a_wrong_reading(void)
{
    for (int sign = -1; sign <= 1; sign += 2) {
        for (size_t k = 3; k < MODULI; k++) { /* a power of two, or not */
            dahl_encoder_t encoder = encoder_for(moduli[k], sign, 100);
            const uint32_t steps = (uint32_t)(sign * 20), wrong = (uint32_t)(sign * 90);
            uint32_t reading = 500;
            for (int t = 0; t < 10; t++, reading += steps) {
                const int32_t move = dahl_encoder_move(&encoder, reading + (t == 5 ? wrong : 0));
                TEST_ASSERT_EQUAL_INT32(t == 0 || t == 5 || t == 6 ? 0 : 20, move);
            }
            TEST_ASSERT_EQUAL_UINT32(1, encoder.jumps);
        }
    }
}
