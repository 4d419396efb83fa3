/* SPDX-License-Identifier: MIT */
/* Cases of the library: named moves, each from a spread of states, and searches for the worst. */
#include <stdbool.h>
#include <stddef.h>

#include "axis.h"
#include "bench.h"
#include "dahl.h"
#include "dahl_encoder.h"
#include "inputs.h"

/* bench_call with the type of each function that it calls. */
float call_float(const dahl_plan_t *, dahl_state_t *, int32_t) __asm__("bench_call");
int32_t call_q30(const dahl_plan_t *, dahl_state_t *, int32_t) __asm__("bench_call");
float call_angle(const dahl_plan_t *, dahl_state_t *, float) __asm__("bench_call");
dahl_err_t call_prepare(dahl_plan_t *, const dahl_params_t *) __asm__("bench_call");
float call_torque(const dahl_plan_t *, const dahl_state_t *) __asm__("bench_call");
void call_set_torque(const dahl_plan_t *, dahl_state_t *, float) __asm__("bench_call");
void call_change_plan(const dahl_plan_t *, const dahl_plan_t *, dahl_state_t *) __asm__("bench_call");
int32_t call_between(uint32_t, uint32_t, uint32_t) __asm__("bench_call");
int call_state_ok(const dahl_state_t *) __asm__("bench_call");
void call_encoder_home(dahl_encoder_t *, uint32_t) __asm__("bench_call");
int32_t call_encoder(dahl_encoder_t *, uint32_t) __asm__("bench_call");
int32_t call_units(int32_t, uint32_t) __asm__("bench_call");

/* The C of lib/model under other names (CMakeLists.txt), as the library has a tick in assembly on some cores. */
float c_step_counts(const dahl_plan_t *, dahl_state_t *, int32_t);
int32_t c_step_counts_q30(const dahl_plan_t *, dahl_state_t *, int32_t);
float c_step(const dahl_plan_t *, dahl_state_t *, float);

enum { RANDOM_CALLS = 20000, MANTISSAS = 8 };

#define ONE_Q62 ((int64_t)1 << 62)

static const dahl_params_t params = {100.0f, 0.5f, 3.8349519e-4f}; /* 14-bit encoder, travel .077 a count */
static const dahl_params_t softer = {30.0f, 0.8f, 3.8349519e-4f};
static dahl_plan_t plan, softer_plan;

/* Relaxed, deflected, saturated, and so small that a float torque needs its slow path. */
static const int64_t starts[] = {
    0, ONE_Q62 / 10 * 3, -ONE_Q62 / 10 * 7, ONE_Q62, -ONE_Q62, 1, -1, (int64_t)1 << 31, -((int64_t)1 << 33) + 12345,
};
#define STARTS (sizeof starts / sizeof starts[0])

static void by_q30(int64_t w, int32_t dcounts)
{
    dahl_state_t state = {w};
    bench_function = (bench_function_t)dahl_step_counts_q30;
    call_q30(&plan, &state, dcounts);
}

static void by_float(int64_t w, int32_t dcounts)
{
    dahl_state_t state = {w};
    bench_function = (bench_function_t)dahl_step_counts;
    call_float(&plan, &state, dcounts);
}

static void by_angle(int64_t w, float dtheta)
{
    dahl_state_t state = {w};
    bench_function = (bench_function_t)dahl_step;
    call_angle(&plan, &state, dtheta);
}

static void c_by_angle(int64_t w, float dtheta)
{
    dahl_state_t state = {w};
    bench_function = (bench_function_t)c_step;
    call_angle(&plan, &state, dtheta);
}

typedef void (*by_angle_t)(int64_t w, float dtheta);

typedef void (*by_counts_t)(int64_t w, int32_t dcounts);

static void from_all_starts(by_counts_t step, int32_t dcounts)
{
    for (unsigned i = 0; i < STARTS; i++) {
        step(starts[i], dcounts);
    }
}

static void search_counts(by_counts_t step)
{
    from_all_starts(step, INT32_MAX);
    from_all_starts(step, -INT32_MAX);
    for (int i = 0; i < RANDOM_CALLS; i++) {
        step(random_state(), random_counts());
    }
}

typedef struct {
    const char *name_q30;
    const char *name_float;
    int32_t dcounts;
} move_t;

static const move_t moves[] = {
    {"zero_q30", "zero_float", 0},
    {"one_count_forward_q30", "one_count_forward_float", 1},
    {"one_count_backward_q30", "one_count_backward_float", -1},
    {"eight_counts_forward_q30", "eight_counts_forward_float", 8},
    {"eight_counts_backward_q30", "eight_counts_backward_float", -8},
    {"1000_counts_forward_q30", "1000_counts_forward_float", 1000},
    {"1000_counts_backward_q30", "1000_counts_backward_float", -1000},
    {"int32_min_q30", "int32_min_float", INT32_MIN},
};

static void bench_moves(void)
{
    for (unsigned i = 0; i < sizeof moves / sizeof moves[0]; i++) {
        bench_case(moves[i].name_q30);
        from_all_starts(by_q30, moves[i].dcounts);
        bench_case(moves[i].name_float);
        from_all_starts(by_float, moves[i].dcounts);
    }
}

static void c_by_q30(int64_t w, int32_t dcounts)
{
    dahl_state_t state = {w};
    bench_function = (bench_function_t)c_step_counts_q30;
    call_q30(&plan, &state, dcounts);
}

static void c_by_float(int64_t w, int32_t dcounts)
{
    dahl_state_t state = {w};
    bench_function = (bench_function_t)c_step_counts;
    call_float(&plan, &state, dcounts);
}

static void bench_ticks_in_c(void)
{
    bench_case("one_count_c_forward_q30");
    from_all_starts(c_by_q30, 1);
    bench_case("one_count_c_backward_q30");
    from_all_starts(c_by_q30, -1);
    bench_case("one_count_c_forward_float");
    from_all_starts(c_by_float, 1);
    bench_case("one_count_c_backward_float");
    from_all_starts(c_by_float, -1);
}

static void bench_dense(void)
{
    bench_case("dense_q30");
    for (int32_t n = 1; n <= 8; n++) {
        from_all_starts(by_q30, n);
        from_all_starts(by_q30, -n);
    }
}

/* A move against the torque of the moves before. */
static void bench_reversal(void)
{
    bench_case("reversal_q30");
    by_q30(ONE_Q62, -1);
    by_q30(-ONE_Q62, 1);
    bench_case("reversal_float");
    by_float(ONE_Q62, -1);
    by_float(-ONE_Q62, 1);
}

static void bench_counts_worst(void)
{
    bench_case("counts_worst_q30");
    search_counts(by_q30);
    bench_case("counts_worst_float");
    search_counts(by_float);
}

/* Every exponent with a few mantissas and both signs, from every start; then floats at random. */
static void search_angle(by_angle_t step)
{
    for (uint32_t exponent = 0; exponent < 256; exponent++) {
        for (uint32_t mantissa = 0; mantissa < MANTISSAS; mantissa++) {
            uint32_t bits = exponent << 23 | mantissa * (0x7fffffu / (MANTISSAS - 1));
            for (unsigned i = 0; i < STARTS; i += 2) {
                step(starts[i], float_of(bits));
                step(starts[i], float_of(bits | 0x80000000u));
            }
        }
    }
    for (int i = 0; i < RANDOM_CALLS; i++) {
        step(random_state(), float_of(next_random()));
    }
}

static const struct {
    const char *name;
    float u;
} travels[] = {
    {"angle_u_1e-9", 1e-9f}, {"angle_u_1e-6", 1e-6f}, {"angle_u_1e-3", 1e-3f}, {"angle_u_0.1", 0.1f},
    {"angle_u_0.5", 0.5f},   {"angle_u_1", 1.0f},     {"angle_u_3", 3.0f},     {"angle_u_10", 10.0f},
    {"angle_u_100", 100.0f}, {"angle_zero", 0.0f},
};

static void bench_angle(void)
{
    for (unsigned k = 0; k < sizeof travels / sizeof travels[0]; k++) {
        bench_case(travels[k].name);
        for (unsigned i = 0; i < STARTS; i++) {
            by_angle(starts[i], travels[k].u / 200.0f);
            by_angle(starts[i], -travels[k].u / 200.0f);
        }
    }
    bench_case("angle_worst");
    search_angle(by_angle);
    bench_case("angle_c_worst");
    search_angle(c_by_angle);
}

static const dahl_params_t many_params[] = {
    {100.0f, 0.5f, 3.8349519e-4f}, {100.0f, 0.5f, 0.0f},          {0x1.08p-20f, 0x1.2fd8aep-5f, 0x1.8e757ap-12f},
    {1e-3f, 1e-3f, 9.4e-10f},      {0x1.fffffep+10f, 1.0f, 500.0f}, {0x1.d4c000p+16f, 0x1.5e978ep+1f, 0x1.d8e75ap-12f},
    {-1.0f, 1.0f, 1.0f},
};

static void bench_prepare(void)
{
    bench_case("prepare");
    bench_function = (bench_function_t)dahl_prepare;
    for (unsigned i = 0; i < sizeof many_params / sizeof many_params[0]; i++) {
        static dahl_plan_t made;
        call_prepare(&made, &many_params[i]);
    }
}

static void bench_others(void)
{
    dahl_state_t state;
    bench_case("torque");
    bench_function = (bench_function_t)dahl_torque;
    for (unsigned i = 0; i < STARTS; i++) {
        state.w = starts[i];
        call_torque(&plan, &state);
    }
    bench_case("set_torque");
    bench_function = (bench_function_t)dahl_set_torque;
    for (int i = -6; i <= 6; i++) {
        call_set_torque(&plan, &state, (float)i * 0.1f);
    }
    bench_case("state_ok");
    bench_function = (bench_function_t)dahl_state_ok;
    for (unsigned i = 0; i < STARTS; i++) {
        state.w = starts[i];
        call_state_ok(&state);
    }
    bench_case("change_plan");
    bench_function = (bench_function_t)dahl_change_plan;
    for (unsigned i = 0; i < STARTS; i++) {
        state.w = starts[i];
        call_change_plan(&plan, &softer_plan, &state);
        state.w = starts[i];
        call_change_plan(&softer_plan, &plan, &state);
    }
    bench_case("counts_between");
    bench_function = (bench_function_t)dahl_counts_between;
    call_between(4095, 3, 4096);
    call_between(3, 4095, 4096);
    call_between(65535, 3, 10000); /* readings at and above the modulus */
    call_between(UINT32_MAX, 0, 1);
    bench_case("counts_between_below");
    call_between(4095, 3, 4096);
    call_between(3, 4095, 4096);
    call_between(3, 4095, 0);
}

static bool prepare_encoder(dahl_encoder_t *encoder, uint32_t modulus, int sign)
{
    dahl_err_t err = dahl_encoder_init(encoder, modulus, sign, 1000);
    dahl_encoder_home(encoder, modulus - 1);
    return err == DAHL_OK; /* if false, the host lacks the calls */
}

/* Over the wrap and back, with either mounting. */
static void bench_moves_of_encoder(const char *name, const uint32_t *moduli, size_t count)
{
    bench_case(name);
    bench_function = (bench_function_t)dahl_encoder_move;
    for (size_t i = 0; i < count; i++) {
        for (int sign = -1; sign <= 1; sign += 2) {
            dahl_encoder_t encoder;
            if (prepare_encoder(&encoder, moduli[i], sign)) {
                call_encoder(&encoder, 0);
                call_encoder(&encoder, moduli[i] - 1);
                call_encoder(&encoder, moduli[i] - 400);
            }
        }
    }
}

/* Timers of 16 and 32 bits, an absolute encoder of 14; an encoder of 10000 counts a turn; and a jump of the latter. */
static void bench_encoder(void)
{
    static const uint32_t powers[] = {65536, 0, 16384}, others[] = {10000};
    dahl_encoder_t encoder;
    bench_moves_of_encoder("encoder_move", powers, sizeof powers / sizeof powers[0]);
    bench_moves_of_encoder("encoder_move_other", others, sizeof others / sizeof others[0]);
    if (prepare_encoder(&encoder, 10000, -1)) {
        bench_case("encoder_move_jump");
        call_encoder(&encoder, 4000);
    }
}

static void bench_encoder_home(void)
{
    dahl_encoder_t encoder;
    bench_case("encoder_home");
    bench_function = (bench_function_t)dahl_encoder_home;
    if (prepare_encoder(&encoder, 10000, 1)) {
        call_encoder_home(&encoder, 4095);
    }
}

static void bench_units(void)
{
    bench_case("to_units");
    bench_function = (bench_function_t)dahl_to_units;
    call_units(INT32_MIN, 500000);
    call_units(INT32_MAX, UINT32_MAX);
    call_units(-12345, 37);
}

/* No motion and 1 to 8 counts either way, over the wrap of the timer too. */
static void bench_axis(const char *name, bench_function_t tick)
{
    bench_case(name);
    bench_function = tick;
    for (uint32_t i = 0; i < STARTS; i++) {
        for (uint32_t move = 0; move <= 16; move++) {
            axis_t axis = {.bearing = {starts[i]}, .asked = 0.3f, .asked_units = 300000, .Fc_units = 500000};
            if (dahl_encoder_init(&axis.encoder, 65536, 1, 1000) != DAHL_OK) {
                return; /* the host then lacks these calls */
            }
            dahl_encoder_home(&axis.encoder, 4 + 8 * (i & 1));
            call_axis(&plan, &axis, (4 + 8 * (i & 1) + move - 8) & 65535u);
        }
    }
}

void bench_library(void)
{
    if (dahl_prepare(&plan, &params) != DAHL_OK || dahl_prepare(&softer_plan, &softer) != DAHL_OK) {
        return; /* the host then lacks these cases */
    }
    bench_moves();
    bench_ticks_in_c();
    bench_dense();
    bench_reversal();
    bench_counts_worst();
    bench_angle();
    bench_prepare();
    bench_others();
    bench_encoder();
    bench_encoder_home();
    bench_units();
    bench_axis("control_tick", (bench_function_t)axis_tick);
    bench_axis("control_tick_units", (bench_function_t)axis_tick_units);
    BENCH_BYTES(dahl_plan_t);
    BENCH_BYTES(dahl_state_t);
    BENCH_BYTES(dahl_encoder_t);
}
