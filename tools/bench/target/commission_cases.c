/* SPDX-License-Identifier: MIT */
/* Each tick of a whole commissioning, of the axis of tests/lib/plain_axis.h, and the calls before and after it. */
#include "bench.h"
#include "dahl_commission.h"
#include "plain_axis.h"

dahl_commission_refusal_t call_start(dahl_commission_t *, const dahl_commission_config_t *) __asm__("bench_call");
dahl_commission_stage_t call_commission(dahl_commission_t *, int32_t, float,
                                        dahl_commission_command_t *) __asm__("bench_call");
float call_load(const dahl_commission_t *, float) __asm__("bench_call");
dahl_compensator_err_t call_params(const dahl_commission_t *, dahl_compensator_params_t *, int) __asm__("bench_call");
void call_abort(dahl_commission_t *) __asm__("bench_call");

static void bench_ticks(dahl_commission_t *state)
{
    plain_axis_t axis = {0};
    dahl_commission_command_t command = {0};
    int32_t moved = 0;
    bench_case("commission_tick");
    bench_function = (bench_function_t)dahl_commission_tick;
    while (state->command.stage < DAHL_COMMISSION_DONE) {
        call_commission(state, moved, axis.command, &command);
        moved = plain_axis_tick(&axis, &command);
    }
}

void bench_commission(void)
{
    static dahl_commission_t state;
    dahl_compensator_params_t params;
    bench_case("commission_start");
    bench_function = (bench_function_t)dahl_commission_start;
    (void)call_start(&state, &plain_config);
    bench_ticks(&state);
    bench_case("commission_params");
    bench_function = (bench_function_t)dahl_commission_params;
    (void)call_params(&state, &params, 1);
    bench_case("commission_load");
    bench_function = (bench_function_t)dahl_commission_load;
    for (int k = -5; k <= 5; k++) {
        (void)call_load(&state, 0.1f * (float)k);
    }
    bench_case("commission_abort");
    (void)dahl_commission_start(&state, &plain_config);
    bench_function = (bench_function_t)dahl_commission_abort;
    call_abort(&state);
    BENCH_BYTES(dahl_commission_t);
}
