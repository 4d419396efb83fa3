/* SPDX-License-Identifier: MIT */
/* Cases of dahl_compensator.h: both calls of a tick without that of the element, new parameters, the residual
 * observer, and presliding damping. */
#include "bench.h"
#include "dahl_compensator.h"
#include "dahl_parts.h"
#include "inputs.h"

#include <stdbool.h>

int32_t call_tick(const dahl_compensator_plan_t *, dahl_compensator_t *, int32_t, int32_t) __asm__("bench_call");
int32_t call_move(const dahl_compensator_plan_t *, dahl_compensator_t *, int32_t, int) __asm__("bench_call");
int32_t call_torque(const dahl_compensator_plan_t *, dahl_compensator_t *, int32_t) __asm__("bench_call");
void call_change(const dahl_compensator_plan_t *, const dahl_compensator_plan_t *, dahl_compensator_t *) __asm__("bench_call");
dahl_compensator_plausible_t call_plausible(const dahl_compensator_params_t *) __asm__("bench_call");
dahl_compensator_err_t call_residual_prepare(dahl_residual_plan_t *, const dahl_compensator_params_t *,
                                             const dahl_residual_params_t *) __asm__("bench_call");
int32_t call_residual(const dahl_residual_plan_t *, dahl_residual_t *, const dahl_compensator_t *,
                      int32_t) __asm__("bench_call");
void call_note(dahl_residual_t *, int32_t) __asm__("bench_call");
int32_t call_q24(const dahl_residual_plan_t *, float) __asm__("bench_call");
void call_residual_change(const dahl_residual_plan_t *, const dahl_residual_plan_t *, dahl_residual_t *) __asm__("bench_call");
dahl_err_t call_damping_prepare(dahl_damping_plan_t *, const dahl_params_t *, float, float) __asm__("bench_call");
int32_t call_damping(const dahl_damping_plan_t *, dahl_damping_t *, int32_t) __asm__("bench_call");
dahl_compensator_err_t call_compensator_prepare(dahl_compensator_plan_t *,
                                                const dahl_compensator_params_t *) __asm__("bench_call");

#define ONE_Q30 ((int32_t)1 << 30)
#define BAD 1000 /* counts: a jump */

enum { WORST_TICKS = 20000 };

static const dahl_compensator_params_t params = {
    .friction = {100.0f, 0.5f, 3.8349519e-4f},
    .law = DAHL_COMPENSATOR_REFERENCE,
    .Fc_low = 0.5f,
    .length_long = 0.005f,
    .sigma0_high = 120.0f, /* this and the next three: of the measured law */
    .load = 0.02f,
    .inertia = 0.002f,
    .delay = 2e-3f,
    .gain = 0.9f,
    .limit = 0.4f,
    .slew = 50.0f,
    .period = 1e-3f,
    .rise = 0.1f,
    .fall = 0.02f,
    .fade_speed = 5.0f,
    .noise = 1,
    .play = 2,
    .jump = 200,
};

/* Both calls; the caller steps its element in between. */
static int32_t tick(const dahl_compensator_plan_t *plan, dahl_compensator_t *compensator, int32_t dcounts, int32_t ratio)
{
    (void)dahl_compensator_move(plan, compensator, dcounts, 1);
    return dahl_compensator_torque(plan, compensator, ratio);
}

/* Noise, both directions, speeds beyond the fade, jumps, and torques that reach the limit and the slew. */
static void bench_ticks(const char *name, const dahl_compensator_plan_t *plan, bool is_split)
{
    static const int32_t moves[] = {0, 1, -1, 3, -3, 20, -20, 200, -200, BAD, -BAD, BAD, BAD, BAD};
    static const int32_t ratios[] = {0, ONE_Q30, -ONE_Q30, ONE_Q30 / 5, -ONE_Q30 / 5};
    dahl_compensator_t compensator = {0};
    bench_case(name);
    for (unsigned k = 0; k < 30 * sizeof moves / sizeof moves[0]; k++) {
        if (is_split) {
            bench_function = (bench_function_t)dahl_compensator_move;
            call_move(plan, &compensator, moves[k / 30], 1);
            bench_function = (bench_function_t)dahl_compensator_torque;
            call_torque(plan, &compensator, ratios[k % 5]);
        } else {
            bench_function = (bench_function_t)tick;
            call_tick(plan, &compensator, moves[k / 30], ratios[k % 5]);
        }
        compensator.torque_q30 = k % 7 == 0 ? INT32_MAX : k % 7 == 1 ? -INT32_MAX : compensator.torque_q30;
    }
}

/* Typical moves and any, ratios and last torques of all magnitudes, in random order. The input shows the last torque. */
static void search_worst_tick(const dahl_compensator_plan_t *plan)
{
    static const int32_t moves[] = {0, 0, 0, 1, -1, 3, -3, 20, -20, 200, -200, BAD};
    dahl_compensator_t compensator = {0};
    bench_case("worst:compensator_tick");
    bench_function = (bench_function_t)tick;
    for (int k = 0; k < WORST_TICKS; k++) {
        const uint32_t choice = next_random() % (sizeof moves / sizeof moves[0] + 1);
        const int32_t dcounts = choice < sizeof moves / sizeof moves[0] ? moves[choice] : random_counts();
        const int32_t ratio = (int32_t)(random_state() >> 32);
        if (k % 3 == 0) {
            compensator.torque_q30 = (int32_t)(random_state() >> 32);
        }
        bench_input((uint32_t)compensator.torque_q30, (uint64_t)(int64_t)ratio, (uint32_t)dcounts);
        call_tick(plan, &compensator, dcounts, ratio);
    }
}

/* From each of two plans to the other, with states and torques of all sizes. */
static void bench_change(const dahl_compensator_plan_t *plan)
{
    dahl_compensator_params_t other = params;
    dahl_compensator_plan_t other_plan;
    other.friction.Fc = 0.37f;
    other.friction.sigma0 = 70.0f;
    other.fade_speed = 3.3f;
    other.play = 5;
    if (dahl_compensator_prepare(&other_plan, &other) != DAHL_COMPENSATOR_OK) {
        return;
    }
    bench_case("compensator_change");
    bench_function = (bench_function_t)dahl_compensator_change;
    for (int k = 0; k < 200; k++) {
        dahl_compensator_t compensator = {.play_position = k % 7};
        compensator.ratio_q30 = (int32_t)(random_state() >> 32);
        compensator.wanted_q30 = (int32_t)(random_state() >> 32);
        compensator.torque_q30 = (int32_t)(random_state() >> 32);
        compensator.speed_q20 = (int32_t)(random_state() >> 32);
        call_change(k % 2 == 0 ? plan : &other_plan, k % 2 == 0 ? &other_plan : plan, &compensator);
    }
}

/* Starts, faults, saturations and both ends of the limit, with torques of all sizes. */
static void bench_residual(void)
{
    const dahl_residual_params_t observer = {.inertia = 0.002f, .corner = 15.0f, .limit = 0.25f, .speed_gain = 0.4f, .delay = 2};
    dahl_residual_plan_t plan;
    dahl_residual_t residual = {0};
    dahl_compensator_t compensator = {0};
    bench_case("residual_prepare");
    bench_function = (bench_function_t)dahl_residual_prepare;
    if (call_residual_prepare(&plan, &params, &observer) != DAHL_COMPENSATOR_OK) {
        return;
    }
    bench_case("residual_torque");
    bench_function = (bench_function_t)dahl_residual_torque;
    for (int k = 0; k < 500; k++) {
        const int32_t dcounts = k % 9 == 0 ? random_counts() : (int32_t)(next_random() % 7) - 3;
        compensator.bad_ticks = k % 50 == 0;
        compensator.fade_q30 = next_random();
        dahl_residual_note(&residual, (int32_t)next_random() >> k % 12);
        call_residual(&plan, &residual, &compensator, dcounts);
    }
    bench_case("residual_note");
    bench_function = (bench_function_t)dahl_residual_note;
    for (int k = 0; k < 100; k++) {
        call_note(&residual, (int32_t)next_random());
    }
    bench_case("residual_q24");
    bench_function = (bench_function_t)dahl_residual_q24;
    for (int k = 0; k < 200; k++) {
        call_q24(&plan, (float)(int32_t)next_random() * (k % 2 == 0 ? 0x1p-30f : 0x1p-24f));
    }
    dahl_compensator_params_t other = params;
    dahl_residual_plan_t other_plan;
    other.friction.Fc = 0.51f;
    if (dahl_residual_prepare(&other_plan, &other, &observer) != DAHL_COMPENSATOR_OK) {
        return;
    }
    bench_case("residual_change");
    bench_function = (bench_function_t)dahl_residual_change;
    for (int k = 0; k < 200; k++) {
        residual = (dahl_residual_t){.raw_q56 = (int64_t)random_state(), .filtered_q56 = (int64_t)random_state()};
        dahl_residual_note(&residual, (int32_t)next_random());
        call_residual_change(k % 2 == 0 ? &plan : &other_plan, k % 2 == 0 ? &other_plan : &plan, &residual);
    }
}

static void bench_damping(void)
{
    dahl_damping_plan_t plan;
    dahl_damping_t damping = {0};
    bench_case("damping_prepare");
    bench_function = (bench_function_t)dahl_damping_prepare;
    if (call_damping_prepare(&plan, &params.friction, 0.3f, params.period) != DAHL_OK) {
        return;
    }
    bench_case("damping_apply");
    bench_function = (bench_function_t)dahl_damping_apply;
    for (int k = 0; k < 200; k++) {
        call_damping(&plan, &damping, (int32_t)next_random() >> k % 8);
    }
}

void bench_compensator(void)
{
    dahl_compensator_params_t measured = params;
    dahl_compensator_plan_t plan;
    measured.law = DAHL_COMPENSATOR_MEASURED;
    bench_case("compensator_prepare");
    bench_function = (bench_function_t)dahl_compensator_prepare;
    if (call_compensator_prepare(&plan, &measured) != DAHL_COMPENSATOR_OK
        || call_compensator_prepare(&plan, &params) != DAHL_COMPENSATOR_OK) {
        return; /* the host then lacks the other cases */
    }
    bench_case("compensator_params_plausible");
    bench_function = (bench_function_t)dahl_compensator_params_plausible;
    (void)call_plausible(&measured);
    bench_ticks("compensator_tick", &plan, false);
    bench_ticks("compensator_calls", &plan, true);
    search_worst_tick(&plan);
    bench_change(&plan);
    bench_residual();
    bench_damping();
    BENCH_BYTES(dahl_compensator_plan_t);
    BENCH_BYTES(dahl_compensator_t);
    BENCH_BYTES(dahl_residual_plan_t);
    BENCH_BYTES(dahl_residual_t);
    BENCH_BYTES(dahl_damping_plan_t);
    BENCH_BYTES(dahl_damping_t);
}
