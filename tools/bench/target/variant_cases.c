/* SPDX-License-Identifier: MIT */
/* Cases of the parts whose parameters or load change the curve (dahl_parts.h): short moves, each from a spread of states. */
#include <string.h>

#include "bench.h"
#include "dahl_parts.h"

float call_clamped(const dahl_plan_t *, dahl_state_t *, float, uint32_t) __asm__("bench_call");
int32_t call_loaded(const dahl_plan_t *, dahl_loaded_state_t *, int32_t, uint32_t) __asm__("bench_call");

#define ONE_Q62 ((int64_t)1 << 62)
#define LOAD_ONE ((uint32_t)1 << 30)

static const dahl_params_t params = {100.0f, 0.5f, 3.8349519e-4f}; /* 14-bit encoder, travel .077 a count */

int32_t call_step(const void *, void *, int32_t) __asm__("bench_call");

static const dahl_model_params_t directed = {{2, 3.8349519e-4f, {100.0f}, {0.5f, 0.4f}}, 0, 0.5f};

static void bench_steps(const char *name, bench_function_t step, const void *plan)
{
    static const int64_t starts[] = {0, ONE_Q62 / 10 * 3, -ONE_Q62 / 10 * 7, ONE_Q62};
    bench_case(name);
    bench_function = step;
    for (unsigned i = 0; i < sizeof starts / sizeof starts[0]; i++) {
        for (int32_t n = -8; n <= 8; n++) {
            dahl_state_t state = {starts[i]};
            call_step(plan, &state, n);
        }
    }
}

/* Cases NAME_q30 and NAME_float of a model with the state of one bristle. */
#define BENCH_BRISTLE(name, ...) \
    { \
        dahl_##name##_plan_t plan; \
        if (dahl_model_##name.q30->prepare(&plan, &directed) == DAHL_OK) { \
            bench_steps(#name "_q30", (bench_function_t)dahl_##name##_step_counts_q30, &plan); \
            bench_steps(#name "_float", (bench_function_t)dahl_##name##_step_counts, &plan); \
        } \
    }

/* Load: the same or falling, and growing. */
static void bench_loaded(const char *name, bench_function_t step, uint32_t load)
{
    static const int64_t starts[] = {0, ONE_Q62 / 10 * 3, -ONE_Q62 / 10 * 7, ONE_Q62};
    dahl_plan_t plan;
    if (dahl_prepare(&plan, &params) != DAHL_OK) {
        return;
    }
    bench_case(name);
    bench_function = step;
    for (unsigned i = 0; i < sizeof starts / sizeof starts[0]; i++) {
        for (int32_t n = -8; n <= 8; n++) {
            dahl_loaded_state_t state = {{starts[i]}, LOAD_ONE};
            call_loaded(&plan, &state, n, load);
        }
    }
}

static void bench_clamped(void)
{
    static const float angles[] = {1e-9f, -1e-6f, 1e-4f, -1e-3f, 0.01f, -0.1f, 1.0f};
    dahl_plan_t plan;
    if (dahl_prepare(&plan, &params) != DAHL_OK) {
        return;
    }
    bench_case("clamped_float");
    bench_function = (bench_function_t)dahl_clamped_step;
    for (unsigned i = 0; i < sizeof angles / sizeof angles[0]; i++) {
        for (uint32_t load = LOAD_ONE / 7; load < 2 * LOAD_ONE; load += LOAD_ONE / 7) {
            dahl_state_t state = {ONE_Q62 / 10 * 3};
            call_clamped(&plan, &state, angles[i], load);
        }
    }
}

/* From w = start, in hundredths, by `least` to `most` counts. */
static void bench_from(const char *name, bench_function_t step, const void *plan, int start, int32_t least, int32_t most)
{
    bench_case(name);
    bench_function = step;
    for (int32_t n = least; n <= most; n++) {
        dahl_state_t state = {ONE_Q62 / 100 * start}, mirrored = {-state.w};
        call_step(plan, &state, n);
        call_step(plan, &mirrored, -n);
    }
}

/* The model with a breakaway, here at 0.5: elastic, plastic, and across it. */
#define BENCH_BREAKAWAY(name, NAME, Class, number, sigma0s, Fcs, has_plan, key, ...) \
    if (strcmp(key, "breakaway") == 0) { \
        const bench_function_t q30 = (bench_function_t)dahl_##name##_step_counts_q30; \
        const bench_function_t in_float = (bench_function_t)dahl_##name##_step_counts; \
        dahl_##name##_plan_t plan; \
        if (dahl_model_##name.q30->prepare(&plan, &directed) != DAHL_OK) { \
            return; \
        } \
        bench_from("elastic_q30", q30, &plan, 0, -6, 6); \
        bench_from("elastic_float", in_float, &plan, 0, -6, 6); \
        bench_from("plastic_q30", q30, &plan, 60, 1, 8); \
        bench_from("plastic_float", in_float, &plan, 60, 1, 8); \
        bench_from("crossing_q30", q30, &plan, 49, 1, 8); \
        bench_from("crossing_float", in_float, &plan, 49, 1, 8); \
    }

void bench_variants(void)
{
    DAHL_BRISTLE_MODELS(BENCH_BRISTLE)
    bench_loaded("loaded_q30", (bench_function_t)dahl_loaded_step_counts_q30, LOAD_ONE - 1);
    bench_loaded("loaded_float", (bench_function_t)dahl_loaded_step_counts, LOAD_ONE - 1);
    bench_loaded("loaded_more_q30", (bench_function_t)dahl_loaded_step_counts_q30, LOAD_ONE + 12345);
    bench_loaded("loaded_more_float", (bench_function_t)dahl_loaded_step_counts, LOAD_ONE + 12345);
    bench_clamped();
    DAHL_BRISTLE_MODELS(BENCH_BREAKAWAY)
}
