/* SPDX-License-Identifier: MIT */
/* Cases of the parts: dense moves, each from a spread of states. */
#include "bench.h"
#include "dahl_parts.h"

/* bench_call with the type of each function that it calls. */
float call_slip(const dahl_slip_plan_t *, dahl_slip_state_t *, int32_t) __asm__("bench_call");
dahl_err_t call_slip_prepare(dahl_slip_plan_t *, const dahl_slip_params_t *) __asm__("bench_call");
float call_parallel(const dahl_part_t *, uint32_t, int32_t) __asm__("bench_call");
void call_shares(int32_t *, const dahl_part_t *, uint32_t) __asm__("bench_call");
int32_t call_parallel_q30(const dahl_part_t *, const int32_t *, uint32_t, int32_t) __asm__("bench_call");

#define PARTS_MOST 4

/* Elements of 14-bit counts that slip after about 6, 25, 100 .. counts. */
static dahl_slip_params_t slip_params(uint32_t elements)
{
    dahl_slip_params_t params = {elements, 3.8349519e-4f, {0}, {0}};
    float sigma0 = 200.0f;
    for (uint32_t k = 0; k < elements; k++) {
        params.Fc[k] = 0.5f;
        params.sigma0[k] = sigma0;
        sigma0 *= 0.25f;
    }
    return params;
}

/* Back and forth over all limits: some elements slip, others do not. */
static const int32_t moves[] = {1, 8, 1, -1, -3, -8, 2, 5, 300, -1, -1, 1, -8, -300, 2, 8, 0, 100000, -7, 4, -100000, 1};
#define MOVES (sizeof moves / sizeof moves[0])

static void bench_slip(const char *name, const char *name_q30, uint32_t elements)
{
    const dahl_slip_params_t params = slip_params(elements);
    dahl_slip_plan_t plan;
    dahl_slip_state_t state = {{0}}, q30 = {{0}};
    if (dahl_slip_prepare(&plan, &params) != DAHL_OK) {
        return; /* the host then lacks these cases */
    }
    bench_case(name);
    bench_function = (bench_function_t)dahl_slip_step_counts;
    for (unsigned i = 0; i < MOVES; i++) {
        call_slip(&plan, &state, moves[i]);
    }
    bench_case(name_q30);
    bench_function = (bench_function_t)dahl_slip_step_counts_q30;
    for (unsigned i = 0; i < MOVES; i++) {
        call_slip(&plan, &q30, moves[i]);
    }
}

static void bench_slip_prepare(const char *name, uint32_t elements)
{
    const dahl_slip_params_t params = slip_params(elements);
    dahl_slip_plan_t plan;
    bench_case(name);
    bench_function = (bench_function_t)dahl_slip_prepare;
    call_slip_prepare(&plan, &params);
}

typedef struct {
    dahl_plan_t plan[PARTS_MOST];
    dahl_state_t state[PARTS_MOST];
    dahl_slip_plan_t slip_plan;
    dahl_slip_state_t slip_state;
    dahl_part_t parts[PARTS_MOST];
    int32_t shares[PARTS_MOST];
} mix_t;

static const mix_t relaxed;

/* Dahl elements with different Fc. */
static void add_dahl(mix_t *mix, uint32_t count)
{
    dahl_params_t params = {100.0f, 0.5f, 3.8349519e-4f};
    for (uint32_t k = 0; k < count; k++) {
        const dahl_part_t part = DAHL_PART(&mix->plan[k], &mix->state[k]);
        mix->parts[k] = part;
        if (dahl_prepare(&mix->plan[k], &params) != DAHL_OK) {
            return; /* a plan of zeros, with which the budgets are missed */
        }
        params.Fc *= 0.3f;
    }
}

static void add_one_slip(mix_t *mix, uint32_t at)
{
    const dahl_slip_params_t params = slip_params(1);
    const dahl_part_t part = DAHL_SLIP_PART(&mix->slip_plan, &mix->slip_state);
    mix->parts[at] = part;
    if (dahl_slip_prepare(&mix->slip_plan, &params) != DAHL_OK) {
        mix->parts[at] = mix->parts[0];
    }
}

/* Moves that are one table entry of each Dahl element. */
static void bench_moves_q30(const char *name, const mix_t *mix, uint32_t count)
{
    bench_case(name);
    bench_function = (bench_function_t)dahl_parallel_step_counts_q30;
    for (unsigned i = 0; i < MOVES; i++) {
        if (-8 <= moves[i] && moves[i] <= 8) {
            call_parallel_q30(mix->parts, mix->shares, count, moves[i]);
        }
    }
}

static void bench_parallel(const char *name, const char *name_q30, const char *name_shares, uint32_t count)
{
    mix_t mix = relaxed;
    add_dahl(&mix, count);
    bench_case(name);
    bench_function = (bench_function_t)dahl_parallel_step_counts;
    for (unsigned i = 0; i < MOVES; i++) {
        if (-8 <= moves[i] && moves[i] <= 8) {
            call_parallel(mix.parts, count, moves[i]);
        }
    }
    bench_case(name_shares);
    bench_function = (bench_function_t)dahl_parallel_shares;
    call_shares(mix.shares, mix.parts, count);
    bench_moves_q30(name_q30, &mix, count);
}

/* One slip element after the Dahl elements: the most expensive mix. */
static void bench_mixed(const char *name_q30, uint32_t count)
{
    mix_t mix = relaxed;
    add_dahl(&mix, count - 1);
    add_one_slip(&mix, count - 1);
    dahl_parallel_shares(mix.shares, mix.parts, count);
    bench_moves_q30(name_q30, &mix, count);
}

void bench_parts(void)
{
    bench_slip("slip_1", "slip_1_q30", 1);
    bench_slip("slip_2", "slip_2_q30", 2);
    bench_slip("slip_4", "slip_4_q30", 4);
    bench_slip("slip_8", "slip_8_q30", 8);
    bench_slip_prepare("slip_prepare_1", 1);
    bench_slip_prepare("slip_prepare_8", 8);
    bench_parallel("parallel_1", "parallel_1_q30", "parallel_1_shares", 1);
    bench_parallel("parallel_2", "parallel_2_q30", "parallel_2_shares", 2);
    bench_parallel("parallel_4", "parallel_4_q30", "parallel_4_shares", 4);
    bench_mixed("mixed_2_q30", 2);
    bench_mixed("mixed_4_q30", 4);
    BENCH_BYTES(dahl_part_t);
}
