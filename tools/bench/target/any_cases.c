/* SPDX-License-Identifier: MIT */
/* Any move of each part: all powers of two less 1, both ways, each followed by short moves, so that most begin within the loop.
 * They show the worst instructions and stack of calls whose other cases move by up to 8 counts. */
#include "bench.h"
#include "dahl_parts.h"
#include "inputs.h"

float call_step(const void *, void *, int32_t, uint32_t) __asm__("bench_call");
float call_angle_at(const dahl_plan_t *, dahl_state_t *, float, uint32_t) __asm__("bench_call");
int32_t call_at_speed(const dahl_stribeck_plan_t *, dahl_state_t *, int32_t, int32_t) __asm__("bench_call");
float call_work_step(const dahl_plan_t *, dahl_state_t *, dahl_work_t *, int32_t) __asm__("bench_call");
float call_parallel(const dahl_part_t *, uint32_t, int32_t) __asm__("bench_call");
int32_t call_parallel_q30(const dahl_part_t *, const int32_t *, uint32_t, int32_t) __asm__("bench_call");

enum { PARTS = 4, MOVES = 4 * 31 };

#define LOAD_ONE ((uint32_t)1 << 30)

static const dahl_params_t params = {100.0f, 0.5f, 3.8349519e-4f}; /* 14-bit encoder, travel .077 a count */
static dahl_plan_t dahl_plan;
static dahl_loaded_state_t state; /* of any model with one sigma0 */
static dahl_work_t work;
static dahl_state_t states[PARTS];

static int32_t move_at(int32_t k)
{
    const int32_t size = k % 2 == 0 ? (int32_t)(UINT32_MAX >> (1 + k / 4)) : k % 8;
    return k / 2 % 2 == 0 ? size : -size;
}

/* The load alternately grows and falls; only the loaded element reads it. */
static void step_any(bench_function_t step, const void *plan)
{
    bench_function = step;
    for (int32_t k = 0; k < MOVES; k++) {
        call_step(plan, &state, move_at(k), LOAD_ONE - (uint32_t)(k % 3) * 12345u);
    }
}

static void step_parts(void)
{
    const dahl_part_t parts[PARTS] = {DAHL_PART(&dahl_plan, &states[0]), DAHL_PART(&dahl_plan, &states[1]),
                                      DAHL_PART(&dahl_plan, &states[2]), DAHL_PART(&dahl_plan, &states[3])};
    int32_t shares[PARTS];
    dahl_parallel_shares(shares, parts, PARTS);
    for (int32_t k = 0; k < MOVES; k++) {
        bench_function = (bench_function_t)dahl_parallel_step_counts;
        call_parallel(parts, PARTS, move_at(k));
        bench_function = (bench_function_t)dahl_parallel_step_counts_q30;
        call_parallel_q30(parts, shares, PARTS, move_at(k));
    }
}

static void step_with_work(bench_function_t step)
{
    bench_function = step;
    for (int32_t k = 0; k < MOVES; k++) {
        call_work_step(&dahl_plan, &states[0], &work, move_at(k));
    }
}

static void step_clamped(void)
{
    bench_function = (bench_function_t)dahl_clamped_step;
    for (uint32_t k = 0; k < 512; k++) { /* each exponent, both signs */
        call_angle_at(&dahl_plan, &states[0], float_of(k << 23 | 0x2aaaaau), LOAD_ONE - k % 3u * 12345u);
    }
}

/* At speeds of 2^-20 to 2^11 of the Stribeck speed. */
static void step_at_speed(void)
{
    static const dahl_stribeck_params_t speed_params = {100.0f, 0.5f, 0.4f, 3.8349519e-4f, 0.0f};
    static dahl_stribeck_plan_t plan;
    if (dahl_stribeck_prepare(&plan, &speed_params) != DAHL_OK) {
        return;
    }
    for (int32_t k = 0; k < 8 * MOVES; k++) {
        const int32_t speed_q20 = (int32_t)(0x6aaaaaaau >> k % 31);
        bench_function = (bench_function_t)dahl_stribeck_step_at_speed;
        call_at_speed(&plan, &states[0], move_at(k % MOVES), speed_q20);
        bench_function = (bench_function_t)dahl_stribeck_step_at_speed_q30;
        call_at_speed(&plan, &states[0], move_at(k % MOVES), speed_q20);
    }
}

#define STEP(name, ...) \
    { \
        static dahl_##name##_plan_t plan; \
        if (dahl_model_##name.q30->prepare(&plan, &any) == DAHL_OK) { \
            step_any((bench_function_t)dahl_##name##_step_counts, &plan); \
            step_any((bench_function_t)dahl_##name##_step_counts_q30, &plan); \
        } \
    }

void bench_any(void)
{
    static const dahl_model_params_t any = {{2, 3.8349519e-4f, {100.0f}, {0.5f, 0.4f}}, 0, 0.5f};
    if (dahl_prepare(&dahl_plan, &params) != DAHL_OK) {
        return; /* the host then lacks this case */
    }
    bench_case("any");
    DAHL_BRISTLE_MODELS(STEP)
    step_any((bench_function_t)dahl_loaded_step_counts, &dahl_plan);
    step_any((bench_function_t)dahl_loaded_step_counts_q30, &dahl_plan);
    step_parts();
    step_with_work((bench_function_t)dahl_work_step_counts);
    step_with_work((bench_function_t)dahl_work_step_counts_q30);
    step_clamped();
    step_at_speed();
}
