/* SPDX-License-Identifier: MIT */
/* Searches for the worst call at start-up or at a change of parameters: parameters, states and torques of all magnitudes. */
#include "bench.h"
#include "dahl_encoder.h"
#include "dahl_parts.h"
#include "inputs.h"

dahl_err_t call_prepare(void *, const void *) __asm__("bench_call");
dahl_plausible_t call_plausible(const dahl_params_t *) __asm__("bench_call");
dahl_err_t call_prepare_own(void *, const void *, float) __asm__("bench_call");
float call_torque(const dahl_plan_t *, const dahl_state_t *) __asm__("bench_call");
void call_set_torque(const dahl_plan_t *, dahl_state_t *, float) __asm__("bench_call");
void call_change_plan(const dahl_plan_t *, const dahl_plan_t *, dahl_state_t *) __asm__("bench_call");
dahl_err_t call_counts_to_torque(const dahl_plan_t *, const dahl_state_t *, float, int32_t *) __asm__("bench_call");
float call_tip_torque(const dahl_plan_t *, uint32_t) __asm__("bench_call");
float call_work(const dahl_params_t *, const dahl_work_t *) __asm__("bench_call");
void call_shares(int32_t *, const dahl_part_t *, uint32_t) __asm__("bench_call");
int32_t call_between(uint32_t, uint32_t, uint32_t) __asm__("bench_call");
dahl_err_t call_encoder_init(dahl_encoder_t *, uint32_t, int, uint32_t) __asm__("bench_call");

enum { ROUNDS = 500, PARTS = 4 };

static dahl_plan_t plans[PARTS];
static dahl_params_t params;

/* 2^least to 2^most */
static float magnitude(int least, int most)
{
    const uint32_t exponent = (uint32_t)(127 + least) + next_random() % (uint32_t)(most - least);
    return float_of(exponent << 23 | next_random() >> 9);
}

/* One count travels 2^-29 to 2^19 presliding lengths. */
static dahl_params_t random_params(float theta_per_count)
{
    const float Fc = magnitude(-20, 20);
    const dahl_params_t found = {magnitude(-29, 19) * Fc / theta_per_count, Fc, theta_per_count};
    return found;
}

static void prepare_plans(void)
{
    bench_function = (bench_function_t)dahl_prepare;
    for (int k = 0; k < PARTS; k++) {
        params = random_params(magnitude(-30, 1));
        call_prepare(&plans[k], &params);
    }
    bench_function = (bench_function_t)dahl_params_plausible;
    (void)call_plausible(&params);
}

/* A model with one Fc and, if the table has one, a number of its own. */
#define PREPARE_1(name, low, high) \
    { \
        static dahl_##name##_plan_t plan; \
        bench_function = (bench_function_t)dahl_##name##_prepare; \
        (void)!call_prepare_own(&plan, &one, (float)(high) * magnitude(-8, 0)); \
    }
/* A model with two Fc. Its parameters are floats: sigma0, both Fc, theta_per_count, and perhaps a number of its own. */
#define PREPARE_2(name, low, high) \
    { \
        static dahl_##name##_plan_t plan; \
        const float values[] = {one.sigma0, one.Fc, less_Fc, one.theta_per_count, 1000.0f * one.theta_per_count}; \
        bench_function = (bench_function_t)dahl_##name##_prepare; \
        call_prepare(&plan, values); \
    }
#define PREPARE(name, NAME, Class, number, sigma0s, Fcs, plan, key, meaning, low, high) PREPARE_##Fcs(name, low, high)

static void prepare_parts(void)
{
    static dahl_slip_plan_t slip;
    static dahl_velocity_plan_t velocity;
    const dahl_params_t one = random_params(magnitude(-30, 1));
    const float less_Fc = one.Fc * magnitude(-1, 0);
    dahl_slip_params_t elements = {DAHL_SLIP_MAX, one.theta_per_count, {0}, {0}};
    dahl_velocity_params_t table = {next_random() % 25u, {0}};
    for (int k = 0; k < DAHL_SLIP_MAX; k++) {
        const dahl_params_t element = random_params(one.theta_per_count);
        elements.sigma0[k] = element.sigma0;
        elements.Fc[k] = element.Fc;
    }
    for (int k = 0; k < DAHL_VELOCITY_SEGMENTS; k++) {
        table.torque[k] = magnitude(-20, 20) * (next_random() & 1u ? 1.0f : -1.0f);
    }
    bench_function = (bench_function_t)dahl_slip_prepare;
    call_prepare(&slip, &elements);
    DAHL_BRISTLE_MODELS(PREPARE)
    bench_function = (bench_function_t)dahl_velocity_prepare;
    call_prepare(&velocity, &table);
}

static void convert_states(void)
{
    static dahl_state_t states[PARTS];
    const dahl_part_t parts[PARTS] = {DAHL_PART(&plans[0], &states[0]), DAHL_PART(&plans[1], &states[1]),
                                      DAHL_PART(&plans[2], &states[2]), DAHL_PART(&plans[3], &states[3])};
    int32_t shares[PARTS];
    dahl_state_t state = {random_state()};
    bench_function = (bench_function_t)dahl_torque;
    call_torque(&plans[0], &state);
    bench_function = (bench_function_t)dahl_change_plan;
    call_change_plan(&plans[0], &plans[1], &state);
    bench_function = (bench_function_t)dahl_set_torque;
    call_set_torque(&plans[0], &state, float_of(next_random()));
    call_set_torque(&plans[PARTS - 1], &state, params.Fc * magnitude(-40, 1));
    bench_function = (bench_function_t)dahl_parallel_shares;
    call_shares(shares, parts, PARTS);
}

static void invert(void)
{
    int32_t dcounts;
    const dahl_plan_t *plan = &plans[PARTS - 1];
    const dahl_state_t state = {random_state()};
    dahl_work_t work = {{next_random(), next_random(), 0}, {next_random(), next_random(), next_random(), 0}};
    bench_function = (bench_function_t)dahl_counts_to_torque;
    (void)!call_counts_to_torque(plan, &state, params.Fc * magnitude(-24, 0) * (next_random() & 1u ? 1.0f : -1.0f), &dcounts);
    bench_function = (bench_function_t)dahl_tip_torque;
    call_tip_torque(plan, next_random() >> next_random() % 32u);
    bench_function = (bench_function_t)dahl_work;
    call_work(&params, &work);
}

static void read_counter(void)
{
    const uint32_t modulus = next_random() >> next_random() % 32u;
    dahl_encoder_t encoder;
    bench_function = (bench_function_t)dahl_counts_between;
    call_between(next_random(), next_random(), modulus);
    bench_function = (bench_function_t)dahl_encoder_init;
    (void)!call_encoder_init(&encoder, modulus, -1, next_random() >> next_random() % 32u);
}

void bench_seldom(void)
{
    bench_case("seldom");
    for (int k = 0; k < ROUNDS; k++) {
        prepare_plans();
        prepare_parts();
        convert_states();
        invert();
        read_counter();
    }
}
