/* SPDX-License-Identifier: MIT */
/* Cases of dahl_node.h: frames of an encoder in and out of sequence, of a client, and all start-up calls. */
#include "bench.h"
#include "dahl_node.h"
#include "inputs.h"

bool call_receive(dahl_node_t *, const dahl_can_frame_t *, uint32_t, dahl_can_frame_t *) __asm__("bench_call");
bool call_node_tick(dahl_node_t *, uint32_t, dahl_can_frame_t *) __asm__("bench_call");
void call_bus_off(dahl_node_t *, uint32_t) __asm__("bench_call");
dahl_err_t call_node_init(dahl_node_t *, const dahl_params_t *, uint8_t) __asm__("bench_call");
dahl_err_t call_use(dahl_node_t *, dahl_node_model_t *, const dahl_model_q30_t *,
                    const dahl_model_params_t *) __asm__("bench_call");

enum { NUMBER = 3, FRAMES = 10000, WRITES = 2000 };

static const dahl_params_t params = {100.0f, 0.5f, 3.8349519e-4f}; /* 14-bit encoder, travel .077 a count */

#define STORAGE(name, ...) dahl_node_##name##_t name;
static union {
    DAHL_OTHER_MODELS(STORAGE)
} storage;
static dahl_node_t node;
static dahl_can_frame_t out;
static uint32_t now_us;

static bool receive(const dahl_can_frame_t *frame)
{
    bench_function = (bench_function_t)dahl_node_receive;
    now_us += 1000;
    return call_receive(&node, frame, now_us, &out);
}

static void receive_encoder(uint32_t counter, int32_t count, bool valid)
{
    const dahl_encoder_state_t encoder = {.count = count, .counter = counter & 0x0F, .valid = valid};
    dahl_can_frame_t frame;
    dahl_frames_pack_encoder(&frame, NUMBER, &encoder);
    (void)receive(&frame);
}

static void restart(void)
{
    if (dahl_node_init(&node, &params, NUMBER) != DAHL_OK) {
        return; /* the cases then miss their budgets */
    }
    now_us = 0;
}

static dahl_err_t use(dahl_node_model_t *model, const dahl_model_q30_t *calls, uint32_t slips)
{
    dahl_model_params_t given = {{DAHL_SLIP_MAX, params.theta_per_count, {0}, {0}}, slips, 0.5f};
    for (uint32_t k = 0; k < DAHL_SLIP_MAX; k++) {
        given.each.sigma0[k] = 200.0f / (float)(k + 1);
        given.each.Fc[k] = 0.5f;
    }
    bench_function = (bench_function_t)dahl_node_use;
    return call_use(&node, model, calls, &given);
}

static dahl_err_t use_parallel(uint32_t slips)
{
    return use(&storage.parallel.model, &dahl_model_parallel_q30, slips);
}

/* In sequence, up to 8 counts either way, with the settings of dahl_node_init(). */
static void receive_short_moves(void)
{
    int32_t count = 0;
    for (int32_t k = 0; k <= 34; k++) {
        count += k / 2 - 8;
        receive_encoder((uint32_t)k, count, true);
    }
}

/* Frames that are missing, repeated, late, invalid, damaged or too far away; any count, pause, gain, ramp and MaxStep. The
 * worst moves are powers of two less 1. */
static void receive_any(void)
{
    uint32_t counter = 0, count = 0;
    for (int k = 0; k < FRAMES; k++) {
        const uint32_t choice = next_random();
        node.gain = choice & 1u ? DAHL_NODE_ONE : next_random();
        node.limit = choice & 2u ? DAHL_NODE_ONE : next_random();
        node.ramp_us = choice & 4u ? 0 : next_random() >> choice % 32u;
        node.max_step = choice & 8u ? 0 : next_random() >> choice % 32u;
        counter += choice & 48u ? 1u : next_random();
        now_us += choice & 192u ? 0 : next_random() >> 8;
        const uint32_t power = UINT32_MAX >> (1 + next_random() % 31u);
        count += choice >> 31 != 0 ? (uint32_t)random_counts() : choice >> 30 != 0 ? power : 0u - power;
        const dahl_encoder_state_t encoder = {(int32_t)count, (uint8_t)(counter & 0x0F), (choice >> 8) % 8u != 0};
        dahl_can_frame_t frame;
        dahl_frames_pack_encoder(&frame, NUMBER, &encoder);
        frame.data[7] ^= (choice >> 11) % 16u == 0 ? 1u : 0u;
        (void)receive(&frame);
    }
}

static void write_param(uint8_t param, uint8_t write, uint32_t value)
{
    const dahl_param_write_t request = {.value = value, .counter = 1, .param = param, .write = write};
    dahl_can_frame_t frame;
    dahl_frames_pack_param_write(&frame, NUMBER, &request);
    (void)receive(&frame);
}

/* Values from the least to the largest that the frame holds. */
static void write_model(void)
{
    for (int k = 0; k < WRITES; k++) {
        node.bearing.w = random_state();
        write_param((uint8_t)(k % 3), DAHL_FRAMES_PARAM_WRITE, next_random() >> next_random() % 32u);
    }
}

static void write_others(void)
{
    for (uint8_t param = 0; param <= DAHL_FRAMES_PARAM_LOAD + 1; param++) {
        for (uint32_t bit = 0; bit < 32; bit++) {
            write_param(param, DAHL_FRAMES_PARAM_READ, 0);
            write_param(param, param <= DAHL_FRAMES_PARAM_THETA ? DAHL_FRAMES_PARAM_HOLD : DAHL_FRAMES_PARAM_WRITE,
                        UINT32_MAX >> bit);
        }
    }
}

static void receive_others(void)
{
    dahl_can_frame_t frame = {.id = 0x7FF, .length = 8};
    (void)receive(&frame);
    frame.flags = DAHL_CAN_FRAME_ERROR;
    (void)receive(&frame);
    for (uint8_t what = 0; what < 4; what++) {
        const dahl_node_reset_t request = {.what = what};
        dahl_frames_pack_reset(&frame, NUMBER, &request);
        (void)receive(&frame);
    }
}

/* After power-on, within the period, at its end, after a timeout, and with a timeout that a division rounds. */
static void tick(void)
{
    static const uint32_t pauses_us[] = {0, 1000, 100000, 200000, 0x80000000u};
    bench_function = (bench_function_t)dahl_node_tick;
    for (unsigned k = 0; k < 2 * sizeof pauses_us / sizeof pauses_us[0]; k++) {
        now_us += pauses_us[k / 2];
        node.primed = k % 2 == 0;
        node.timeout_us = k % 2 == 0 ? DAHL_NODE_TIMEOUT_US : UINT32_MAX;
        (void)call_node_tick(&node, now_us, &out);
    }
}

static void bench_receive(void)
{
    bench_case("node_encoder");
    restart();
    receive_short_moves();
    bench_case("node_encoder_any");
    receive_any();
    bench_case("node_param_model");
    restart();
    write_model();
    bench_case("node_param_other");
    write_others();
    bench_case("node_others");
    receive_others();
    bench_case("node_tick");
    tick();
    bench_case("node_bus_off");
    bench_function = (bench_function_t)dahl_node_bus_off;
    call_bus_off(&node, now_us);
    bench_case("node_encoder_parallel_8_any");
    restart();
    if (use_parallel(0) == DAHL_OK) {
        receive_short_moves();
        receive_any();
    }
}

#define USE(name, ...) (void)!use(&storage.name.model, &dahl_model_##name##_q30, 0);

static void bench_start_up(void)
{
    bench_case("node_init");
    bench_function = (bench_function_t)dahl_node_init;
    (void)!call_node_init(&node, &params, NUMBER);
    bench_case("node_use");
    DAHL_OTHER_MODELS(USE)
    (void)!use_parallel(0x55u);
    (void)!use_parallel(0xFFu);
}

#define REPORT_BYTES(name, ...) \
    BENCH_BYTES(dahl_##name##_plan_t); \
    BENCH_BYTES(dahl_##name##_state_t); \
    BENCH_BYTES(dahl_node_##name##_t);

void bench_node(void)
{
    bench_receive();
    bench_start_up();
    BENCH_BYTES(dahl_node_t);
    DAHL_OTHER_MODELS(REPORT_BYTES)
}
