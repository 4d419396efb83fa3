/* SPDX-License-Identifier: MIT */
/*
 * Random closed cycles: passivity counts|angle CYCLES. Each has a plan (travel of a count from 2^-30 to 8, of an angle from
 * 2^-63), a start (relaxed, saturated or any), 2 to 16 moves of any size and direction and one that leads back to where it
 * began, exactly. Exit code 0 where no tick and no cycle makes more energy than passivity.h says.
 */
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "dahl.h"
#include "passivity.h"

#define PLAN_CYCLES 32 /* with one plan */
#define THETA 0x1p-20f

static uint64_t seed = 88172645463325252u;

static uint64_t random64(void)
{
    seed ^= seed << 13;
    seed ^= seed >> 7;
    return seed ^= seed << 17;
}

typedef struct {
    long double work, loss, travel;
    int64_t counts;
    int ticks;
} cycle_t;

typedef struct {
    uint64_t cycles, ticks, bad_ticks, bad_cycles;
    long double least_tick, least_from_rest, least_with_stored;
} total_t;

static dahl_plan_t plan;
static float angle_of_count; /* a power of two, so that a move of n counts is an exact float */
static long double travel_of_count;
static int by_angle;

static int new_plan(void)
{
    float mantissa = 1 + (float)(random64() & 0x7fffff) * 0x1p-23f;
    dahl_params_t p = {ldexpf(mantissa, (int)(random64() % 33) - 10), 1.0f, THETA};
    angle_of_count = by_angle ? ldexpf(THETA, -(int)(random64() % 34)) : THETA;
    travel_of_count = (long double)p.sigma0 * angle_of_count;
    return dahl_prepare(&plan, &p) == DAHL_OK;
}

static int64_t new_start(void)
{
    int64_t one = (int64_t)1 << 62, any = (int64_t)random64() >> 2;
    switch (random64() % 4) {
    case 0: return any;
    case 1: return any < 0 ? -one : one;
    default: return 0;
    }
}

/* One count, a few, or up to 2^20, as often. */
static int32_t new_move(void)
{
    uint64_t r = random64();
    int32_t n = 1 + (int32_t)((uint32_t)r % (1u << (r >> 32) % 3 * ((r >> 40) % 11)));
    return r >> 63 ? n : -n;
}

static void move(dahl_state_t *state, int32_t n)
{
    if (by_angle) {
        (void)dahl_step(&plan, state, (float)n * angle_of_count);
    } else {
        (void)dahl_step_counts_q30(&plan, state, n);
    }
}

static void tick(total_t *total, cycle_t *c, dahl_state_t *state, int32_t n)
{
    const long double unit = 0x1p-62L;
    int s = n < 0 ? -1 : 1;
    int64_t before = state->w;
    move(state, n);
    long double u = s * (long double)n * travel_of_count, after = s * (long double)state->w * unit;
    long double loss = PASSIVITY_LOSS(after, s * (long double)(state->w - before) * unit, u);
    total->bad_ticks += loss < -(by_angle ? PASSIVITY_ANGLE : PASSIVITY_COUNTS);
    total->least_tick = fminl(total->least_tick, loss);
    total->ticks++;
    c->work += after * u;
    c->loss += loss;
    c->travel += u;
    c->counts += n;
    c->ticks++;
}

static void cycle(total_t *total)
{
    cycle_t c = {0, 0, 0, 0, 0};
    dahl_state_t state = {new_start()};
    long double stored = (long double)state.w * 0x1p-62L;
    stored *= stored / 2;
    for (uint64_t i = 2 + random64() % 15; i > 0; i--) {
        tick(total, &c, &state, new_move());
    }
    if (c.counts != 0) {
        tick(total, &c, &state, (int32_t)-c.counts);
    }
    long double made = c.ticks * (by_angle ? PASSIVITY_ANGLE : PASSIVITY_COUNTS);
    long double here = stored == 0 ? 0 : 0x1p-62L * (1 + c.travel); /* rounding of these sums */
    total->bad_cycles += c.loss < -made || c.work + stored < -made - here;
    total->least_with_stored = fminl(total->least_with_stored, c.work + stored);
    if (stored == 0) {
        total->least_from_rest = fminl(total->least_from_rest, c.work);
    }
    total->cycles++;
}

int main(int argc, char **argv)
{
    uint64_t cycles = argc == 3 ? strtoull(argv[2], NULL, 10) : 0;
    total_t total = {0, 0, 0, 0, HUGE_VALL, HUGE_VALL, HUGE_VALL};
    by_angle = argc == 3 && strcmp(argv[1], "angle") == 0;
    if (cycles == 0 || !(by_angle || strcmp(argv[1], "counts") == 0)) {
        (void)fprintf(stderr, "error: use: passivity counts|angle CYCLES\n");
        return 2;
    }
    while (total.cycles < cycles) {
        if (total.cycles % PLAN_CYCLES == 0 && !new_plan()) {
            return 2;
        }
        cycle(&total);
    }
    printf("cycles %llu, ticks %llu\n", (unsigned long long)total.cycles, (unsigned long long)total.ticks);
    printf("least loss of a tick %.5Le\n", total.least_tick);
    printf("least work from rest %.5Le, with what was stored %.5Le\n", total.least_from_rest, total.least_with_stored);
    printf("ticks that make energy %llu, cycles %llu\n", (unsigned long long)total.bad_ticks,
           (unsigned long long)total.bad_cycles);
    return total.bad_ticks + total.bad_cycles != 0;
}
