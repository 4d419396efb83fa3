/* SPDX-License-Identifier: MIT */
/*
 * Searches for the worst input of each call of the control tick. Each call is preceded by its input, so that the table can name
 * the worst. Moves: every number of ones from the lowest digit and every power of two, both ways, because dahl_step_large()
 * works digit by digit; then moves at random. Angles: every exponent, then floats at random.
 */
#include "axis.h"
#include "bench.h"
#include "inputs.h"

int32_t call_q30(const dahl_plan_t *, dahl_state_t *, int32_t) __asm__("bench_call");
float call_angle(const dahl_plan_t *, dahl_state_t *, float) __asm__("bench_call");
int32_t call_encoder(dahl_encoder_t *, uint32_t) __asm__("bench_call");
int32_t call_units(int32_t, uint32_t) __asm__("bench_call");

enum { RANDOM_CALLS = 2000, RANDOM_ANGLES = 10000, MANTISSAS = 8, LARGEST_STEP = 1000, MAX_TIMER_STEP = 32767 };

#define ONE_Q62 ((int64_t)1 << 62)
#define TIMER_MODULUS 65536u

static const int64_t starts[] = {0, ONE_Q62 / 10 * 3, -ONE_Q62 / 10 * 7, ONE_Q62, -ONE_Q62, 1, -1, (int64_t)1 << 31};
#define STARTS (sizeof starts / sizeof starts[0])

/* Travel of a count: .077 presliding lengths (14 bits), 3e-4 (22 bits), 9.4e-10, and 1e6. */
static const dahl_params_t many_params[] = {
    {100.0f, 0.5f, 3.8349519e-4f},
    {100.0f, 0.5f, 1.4980281e-6f},
    {1e-3f, 1e-3f, 9.4e-10f},
    {2000.0f, 1.0f, 500.0f},
};
#define PLANS (sizeof many_params / sizeof many_params[0])

static dahl_plan_t plan;
static uint32_t setting; /* bits of the travel of a count */

typedef void (*call_t)(int64_t w, uint32_t move);

static void step(int64_t w, uint32_t dcounts)
{
    dahl_state_t state = {w};
    bench_input(setting, (uint64_t)w, dcounts);
    call_q30(&plan, &state, (int32_t)dcounts);
}

static void step_angle(int64_t w, uint32_t bits)
{
    dahl_state_t state = {w};
    bench_input(setting, (uint64_t)w, bits);
    call_angle(&plan, &state, float_of(bits));
}

static void axis(int64_t w, uint32_t dcounts)
{
    axis_t drive = {.bearing = {w}, .asked = 0.3f, .asked_units = 300000, .Fc_units = 500000};
    if (dahl_encoder_init(&drive.encoder, TIMER_MODULUS, 1, MAX_TIMER_STEP) == DAHL_OK) {
        dahl_encoder_home(&drive.encoder, 0);
        bench_input(setting, (uint64_t)w, (uint32_t)(int16_t)dcounts);
        call_axis(&plan, &drive, (uint16_t)dcounts);
    }
}

static void search_moves(call_t call)
{
    for (unsigned i = 0; i < STARTS; i++) {
        for (int digit = 0; digit < 32; digit++) {
            const uint32_t power = (uint32_t)1 << digit;
            call(starts[i], power);
            call(starts[i], power - 1u);
            call(starts[i], 0u - power);
            call(starts[i], 1u - power);
        }
    }
    for (int k = 0; k < RANDOM_CALLS; k++) {
        call(random_state(), (uint32_t)random_counts());
    }
}

static void search_angles(call_t call)
{
    for (uint32_t exponent = 0; exponent < 256; exponent++) {
        for (uint32_t mantissa = 0; mantissa < MANTISSAS; mantissa++) {
            const uint32_t bits = exponent << 23 | mantissa * (0x7fffffu / (MANTISSAS - 1));
            for (unsigned i = 0; i < STARTS; i += 3) {
                call(starts[i], bits);
                call(starts[i], bits | 0x80000000u);
            }
        }
    }
    for (int k = 0; k < RANDOM_ANGLES; k++) {
        call(random_state(), next_random());
    }
}

/* Run a search with each plan. */
static void search(const char *name, bench_function_t function, void (*over)(call_t), call_t call)
{
    bench_case(name);
    for (unsigned k = 0; k < PLANS; k++) {
        const dahl_params_t *params = &many_params[k];
        if (dahl_prepare(&plan, params) == DAHL_OK) {
            setting = bits_of(params->sigma0 * params->theta_per_count / params->Fc);
            bench_function = function;
            over(call);
        }
    }
}

static void search_encoder(void)
{
    static const uint32_t moduli[] = {TIMER_MODULUS, 0, 16384, 10000};
    bench_case("worst:encoder_move");
    bench_function = (bench_function_t)dahl_encoder_move;
    for (unsigned m = 0; m < sizeof moduli / sizeof moduli[0]; m++) {
        for (int k = 0; k < RANDOM_CALLS; k++) {
            const uint32_t modulus = moduli[m], any = next_random(), reading = (uint32_t)random_counts();
            const uint32_t last = modulus == 0 ? any : any % modulus;
            dahl_encoder_t encoder;
            if (dahl_encoder_init(&encoder, modulus, k & 1 ? 1 : -1, LARGEST_STEP) == DAHL_OK) {
                dahl_encoder_home(&encoder, last);
                bench_input(modulus, last, reading);
                call_encoder(&encoder, reading);
            }
        }
    }
}

static void search_units(void)
{
    bench_case("worst:to_units");
    bench_function = (bench_function_t)dahl_to_units;
    for (int k = 0; k < RANDOM_CALLS; k++) {
        const uint32_t ratio = (uint32_t)random_counts(), Fc_units = (uint32_t)random_counts();
        bench_input(Fc_units, 0, ratio);
        call_units((int32_t)ratio, Fc_units);
    }
}

void bench_worst(void)
{
    search_encoder();
    search("worst:step_counts_q30", (bench_function_t)dahl_step_counts_q30, search_moves, step);
    search("worst:step_counts", (bench_function_t)dahl_step_counts, search_moves, step);
    search("worst:step", (bench_function_t)dahl_step, search_angles, step_angle);
    search_units();
    search("worst:control_tick_units", (bench_function_t)axis_tick_units, search_moves, axis);
    search("worst:control_tick", (bench_function_t)axis_tick, search_moves, axis);
}
