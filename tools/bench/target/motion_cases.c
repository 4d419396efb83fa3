/* SPDX-License-Identifier: MIT */
/* What a tick costs on average on each hard motion (../scenarios.h): the library's ways, then the rivals'. */
#include <string.h>

#include "bench.h"
#include "dahl.h"
#include "rivals.h"
#include "scenarios.h"

float call_rival(const rival_plan_t *, rival_state_t *, int32_t) __asm__("bench_call");

int32_t call_q30(const dahl_plan_t *, dahl_state_t *, int32_t) __asm__("bench_call");
float call_angle(const dahl_plan_t *, dahl_state_t *, float) __asm__("bench_call");

enum { TICKS = 320 };

static dahl_plan_t plan;
static rival_plan_t rival_plan;

static const struct {
    const char *name;
    rival_step_t step;
    int32_t substeps;
} rivals[] = {
    {"expm1f", rival_expm1f, 1},
    {"expf", rival_expf, 1},
    {"exp_double", rival_exp_double, 1},
    {"expm1_double", rival_expm1_double, 1},
    {"anchored", rival_anchored, 1},
    {"direct", rival_direct, 1},
    {"euler", rival_euler, 1},
    {"rk4", rival_rk4, 1},
    {"table", rival_table, 1},
    {"table_counts", rival_table_counts, 1},
    {"backward", rival_backward_parts, 1},
    {"trapezoid", rival_trapezoid_parts, 1},
    {"euler_parts_9", rival_euler_parts, 9},
    {"euler_parts_17", rival_euler_parts, 17},
    {"rk4_parts_9", rival_rk4_parts, 9},
    {"rk4_parts_17", rival_rk4_parts, 17},
    {"backward_parts_9", rival_backward_parts, 9},
    {"backward_parts_17", rival_backward_parts, 17},
    {"trapezoid_parts_9", rival_trapezoid_parts, 9},
    {"trapezoid_parts_17", rival_trapezoid_parts, 17},
    {"floor", rival_floor, 1},
};

/* `case motion:SCENARIO:WAY` */
static void begin(const scenario_t *scenario, const char *way)
{
    char name[64] = "motion:";
    strcat(name, scenario->name);
    strcat(name, ":");
    bench_case(strcat(name, way));
}

static void run_library(const scenario_t *scenario)
{
    static const char *const names[] = {"counts_q30", "counts", "angle"};
    static const bench_function_t steps[] = {(bench_function_t)dahl_step_counts_q30, (bench_function_t)dahl_step_counts,
                                             (bench_function_t)dahl_step};
    for (int way = 0; way < 3; way++) {
        dahl_state_t state = {0};
        motion_t motion = MOTION_START;
        begin(scenario, names[way]);
        bench_function = steps[way];
        for (int t = 0; t < TICKS; t++) {
            int32_t d = scenario->next(&motion);
            if (way == 2) {
                call_angle(&plan, &state, (float)d * scenario_theta(scenario));
            } else {
                call_q30(&plan, &state, d);
            }
        }
    }
}

static void run_rival(const scenario_t *scenario, unsigned k)
{
    rival_state_t state = {0};
    motion_t motion = MOTION_START;
    begin(scenario, rivals[k].name);
    bench_function = (bench_function_t)rivals[k].step;
    rival_plan.substeps = rivals[k].substeps;
    for (int t = 0; t < TICKS; t++) {
        call_rival(&rival_plan, &state, scenario->next(&motion));
    }
}

void bench_motions(void)
{
    for (unsigned i = 0; i < SCENARIOS; i++) {
        dahl_params_t params = {SCENARIO_SIGMA0, SCENARIO_FC, scenario_theta(&scenarios[i])};
        if (dahl_prepare(&plan, &params) != DAHL_OK) {
            return; /* the reader misses the cases */
        }
        rival_prepare(&rival_plan, params.sigma0, params.Fc, params.theta_per_count);
        run_library(&scenarios[i]);
        for (unsigned k = 0; k < sizeof rivals / sizeof rivals[0]; k++) {
            run_rival(&scenarios[i], k);
        }
    }
}
