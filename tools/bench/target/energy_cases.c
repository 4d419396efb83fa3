/* SPDX-License-Identifier: MIT */
/* Cases of work, of the inverse, and of the table over speed (dahl_parts.h). */
#include "bench.h"
#include "dahl_parts.h"

float call_work_step(const dahl_plan_t *, dahl_state_t *, dahl_work_t *, int32_t) __asm__("bench_call");
int32_t call_work_step_q30(const dahl_plan_t *, dahl_state_t *, dahl_work_t *, int32_t) __asm__("bench_call");
float call_work(const dahl_params_t *, const dahl_work_t *) __asm__("bench_call");
dahl_err_t call_counts_to_torque(const dahl_plan_t *, const dahl_state_t *, float, int32_t *) __asm__("bench_call");
float call_tip_torque(const dahl_plan_t *, uint32_t) __asm__("bench_call");
dahl_err_t call_velocity_prepare(dahl_velocity_plan_t *, const dahl_velocity_params_t *) __asm__("bench_call");
float call_velocity(const dahl_velocity_plan_t *, int32_t) __asm__("bench_call");

int32_t call_velocity_q30(const dahl_velocity_plan_t *, int32_t) __asm__("bench_call");

static const dahl_params_t params = {100.0f, 0.5f, 3.8349519e-4f}; /* 14-bit encoder, travel .077 a count */
static const dahl_params_t fine_params = {100.0f, 0.5f, 5e-9f};      /* travel 1e-6 a count */

static void bench_work(const dahl_plan_t *plan)
{
    dahl_state_t state = {0};
    dahl_work_t work = {{0}, {0}};
    bench_case("work_step");
    bench_function = (bench_function_t)dahl_work_step_counts;
    for (int32_t n = -8; n <= 8; n++) {
        call_work_step(plan, &state, &work, n);
        call_work_step(plan, &state, &work, -n);
    }
    bench_case("work_step_q30");
    bench_function = (bench_function_t)dahl_work_step_counts_q30;
    for (int32_t n = -8; n <= 8; n++) {
        call_work_step_q30(plan, &state, &work, n);
        call_work_step_q30(plan, &state, &work, -n);
    }
    bench_case("work_read");
    bench_function = (bench_function_t)dahl_work;
    call_work(&params, &work);
    work.way[3] = 1; /* more way than any motion has: the longest sums, and a negative one */
    call_work(&params, &work);
}

/* From rest to parts of Fc either way, and from there back. */
static void bench_counts_to_torque(const char *name, const dahl_plan_t *plan)
{
    int32_t found;
    bench_case(name);
    bench_function = (bench_function_t)dahl_counts_to_torque;
    for (int32_t start = -1; start <= 1; start++) {
        const dahl_state_t state = {((int64_t)1 << 61) * start};
        for (int32_t tenth = -9; tenth <= 9; tenth++) {
            (void)!call_counts_to_torque(plan, &state, 0.05f * (float)tenth, &found);
        }
    }
}

static void bench_tip_torque(const char *name, const dahl_plan_t *plan)
{
    bench_case(name);
    bench_function = (bench_function_t)dahl_tip_torque;
    for (uint32_t stroke = 1; stroke < 1u << 31; stroke = 3 * stroke + 1) {
        call_tip_torque(plan, stroke);
        call_tip_torque(plan, UINT32_MAX / stroke);
    }
}

/* A Stribeck curve: it falls, then rises. */
static void bench_velocity(void)
{
    dahl_velocity_params_t table = {4, {0}};
    dahl_velocity_plan_t plan;
    for (int k = 0; k < DAHL_VELOCITY_SEGMENTS; k++) {
        table.torque[k] = 0.01f * (float)((k - 5) * (k - 5)) - 0.02f;
    }
    bench_case("velocity_prepare");
    bench_function = (bench_function_t)dahl_velocity_prepare;
    if (call_velocity_prepare(&plan, &table) != DAHL_OK) {
        return; /* the host then lacks this case */
    }
    bench_case("velocity_torque");
    bench_function = (bench_function_t)dahl_velocity_torque;
    for (int32_t n = -300; n <= 300; n += 7) {
        call_velocity(&plan, n);
    }
    bench_case("velocity_torque_q30");
    bench_function = (bench_function_t)dahl_velocity_torque_q30;
    for (int32_t n = -300; n <= 300; n += 7) {
        call_velocity_q30(&plan, n);
    }
}

void bench_energy(void)
{
    dahl_plan_t plan, fine;
    if (dahl_prepare(&plan, &params) != DAHL_OK || dahl_prepare(&fine, &fine_params) != DAHL_OK) {
        return;
    }
    bench_work(&plan);
    bench_counts_to_torque("counts_to_torque", &plan);
    bench_counts_to_torque("counts_to_torque_fine", &fine);
    bench_case("tip_torque_1000");
    bench_function = (bench_function_t)dahl_tip_torque;
    call_tip_torque(&plan, 1000);
    bench_tip_torque("tip_torque", &plan);
    bench_tip_torque("tip_torque_fine", &fine);
    bench_velocity();
    BENCH_BYTES(dahl_work_t);
    BENCH_BYTES(dahl_velocity_plan_t);
}
