/* SPDX-License-Identifier: MIT */
/*
 * The interrupt owns the states of encoder, loop and axis. The main program prepares plans in the settings that no tick uses and
 * publishes them by one store (../change_parameters); an order is published the same way. A report goes back behind a sequence
 * number. The interrupt preempts the main program, never the other way round.
 */
#include "drive.h"

#include <stdatomic.h>
#include <stddef.h>
#include <string.h>

#include "axis.h"
#include "encoder.h"
#include "position_loop.h"

#define LOOP_HZ 35.0f
#define LOOP_RATE (6.2831853f * LOOP_HZ) /* 1/s */
#define OBSERVER_HZ 15.0f
#define TORQUE_LIMIT 5.0f     /* N m, of the drive */
#define FALL_PER_TICK 0.25f   /* N m: a fault takes the torque away within 20 ms */
#define SPEED_LIMIT 2.0f      /* rad/s, of a move */
#define ACCELERATION_LIMIT 40.0f /* rad/s2 */
#define APPROACH 8.0f         /* 1/s: SPEED_LIMIT APPROACH is below ACCELERATION_LIMIT, so a move does not overshoot */
#define FOLLOWING_LIMIT 2000  /* counts: 0.19 rad */
enum { BAD_READINGS = 3, GOOD_READINGS = 100, BUS_TICKS = 200, MAIN_TICKS = 50 };

/* What the main program writes and a tick reads. */
typedef struct {
    position_loop_params_t params;
    position_loop_t loop; /* its plans */
    uint32_t crc;         /* of both */
} settings_t;

static settings_t settings[2];
static atomic_uchar published, used; /* index of settings: written by main, by the tick */
static atomic_uchar order;           /* drive_order_t: written by main, then set to DRIVE_NONE by the tick */
static atomic_uchar is_main_sound;   /* set by main, cleared by the tick */
static int32_t order_target;         /* published with the order */
static drive_report_t reports;
static atomic_uint report_number;

/* Of the tick. */
static encoder_t encoder;
static position_loop_t loop;
static axis_t axis; /* started by main while the drive is off */
static drive_state_t state;
static drive_fault_t fault;
static float torque;                                                /* N m, of the last tick */
static struct { int32_t count, target; float part, speed; } reference; /* counts, counts, counts, rad/s */
static uint32_t silent_ticks, main_ticks, ticks;
static bool has_result; /* a commissioning has ended, and main has not read it */

/* --- the main program --------------------------------------------------------------------------- */

static position_loop_params_t params_of(const store_params_t *p)
{
    return (position_loop_params_t){
        .compensator = {.friction = {p->sigma0, p->Fc, DRIVE_THETA_PER_COUNT}, .law = DAHL_COMPENSATOR_REFERENCE,
                        .gain = p->gain, .limit = 1.2f * p->Fc, .slew = 100 * p->Fc, .period = DRIVE_PERIOD_S,
                        .rise = 0.5f, .fall = 0.02f, .noise = p->noise, .play = 2 * p->noise + 2, .jump = ENCODER_MAX_STEP},
        .observer = {.inertia = p->inertia_low, .corner = OBSERVER_HZ, .limit = p->Fc / 2,
                     .speed_gain = p->inertia * LOOP_RATE, .delay = p->delay},
        .position_gain = LOOP_RATE / 5, .integral_time = 6 / LOOP_RATE, .drive_limit = TORQUE_LIMIT};
}

static uint32_t crc_of(const settings_t *one)
{
    return store_crc(one, offsetof(settings_t, crc));
}

bool drive_set(const store_params_t *params)
{
    unsigned next = 1u - atomic_load_explicit(&published, memory_order_relaxed);
    settings_t *to = &settings[next];
    to->params = params_of(params);
    bool is_in_range = params->Fc >= DRIVE_FC_LEAST && params->Fc <= DRIVE_FC_MOST;
    if (!is_in_range || position_loop_init(&to->loop, &to->params) != 0) {
        return false;
    }
    to->crc = crc_of(to);
    atomic_store_explicit(&published, (unsigned char)next, memory_order_release);
    return true;
}

bool drive_start(const store_params_t *params, board_reset_t cause)
{
    state = cause == BOARD_WATCHDOG ? DRIVE_FAULT : DRIVE_OFF;
    fault = cause == BOARD_WATCHDOG ? DRIVE_RESET : DRIVE_NO_FAULT;
    return drive_set(params);
}

bool drive_is_ready(void)
{
    return atomic_load_explicit(&order, memory_order_acquire) == DRIVE_NONE
           && atomic_load_explicit(&used, memory_order_acquire) == atomic_load_explicit(&published, memory_order_relaxed);
}

void drive_order(drive_order_t what, int32_t target)
{
    order_target = target;
    atomic_store_explicit(&order, (unsigned char)what, memory_order_release);
}

/* The ticks use copies of the plans. */
static bool has_same_plans(const position_loop_t *one, const position_loop_t *other)
{
    return memcmp(&one->friction, &other->friction, sizeof one->friction) == 0
           && memcmp(&one->plan, &other->plan, sizeof one->plan) == 0
           && memcmp(&one->residual_plan, &other->residual_plan, sizeof one->residual_plan) == 0;
}

void drive_check(void)
{
    const settings_t *now = &settings[atomic_load_explicit(&published, memory_order_relaxed)];
    if (drive_is_ready() && now->crc == crc_of(now) && has_same_plans(&loop, &now->loop)) {
        atomic_store_explicit(&is_main_sound, 1, memory_order_relaxed);
    }
}

void drive_read(drive_report_t *report)
{
    unsigned before;
    do {
        before = atomic_load_explicit(&report_number, memory_order_acquire);
        *report = reports;
        atomic_signal_fence(memory_order_acquire);
    } while (before != atomic_load_explicit(&report_number, memory_order_relaxed));
}

bool drive_commissioned(store_params_t *params)
{
    const dahl_commission_result_t *result = &axis.commission.result;
    bool is_new = has_result;
    if (is_new) {
        params->Fc = result->Fc.best;
        params->sigma0 = result->sigma0.best;
        params->inertia = result->inertia.best;
        params->inertia_low = result->inertia.least;
        params->delay = (uint32_t)(result->delay.best / DRIVE_PERIOD_S + 0.5f);
        params->noise = result->noise;
        has_result = false;
    }
    return is_new;
}

/* --- the tick ----------------------------------------------------------------------------------- */

/* Change to new plans, if there are some. The torque keeps its slew across the change. */
static void take_settings(void)
{
    unsigned next = atomic_load_explicit(&published, memory_order_acquire);
    const position_loop_t *to = &settings[next].loop;
    if (next == atomic_load_explicit(&used, memory_order_relaxed)) {
        return;
    }
    dahl_change_plan(&loop.friction, &to->friction, &loop.bristle);
    dahl_compensator_change(&loop.plan, &to->plan, &loop.compensator);
    dahl_residual_change(&loop.residual_plan, &to->residual_plan, &loop.residual);
    loop.params = &settings[next].params;
    loop.friction = to->friction;
    loop.plan = to->plan;
    loop.residual_plan = to->residual_plan;
    atomic_store_explicit(&used, (unsigned char)next, memory_order_release);
}

static void enter_fault(drive_fault_t why)
{
    state = DRIVE_FAULT;
    fault = why;
}

/* Start at rest at the present count, with the compensation faded out. */
static void start_loop(void)
{
    memset(&loop.bristle, 0, sizeof loop.bristle);
    memset(&loop.compensator, 0, sizeof loop.compensator);
    memset(&loop.residual, 0, sizeof loop.residual);
    loop.error = 0;
    loop.ticks = 0;
    loop.speed = loop.integral = 0;
    reference.count = encoder.count;
    reference.part = reference.speed = 0;
    state = DRIVE_RUN;
}

static void start_commissioning(void)
{
    const dahl_commission_config_t config = {.period = DRIVE_PERIOD_S, .theta_per_count = DRIVE_THETA_PER_COUNT,
                                             .inertia = loop.params->observer.speed_gain / LOOP_RATE, .travel = 0.35f,
                                             .angle_limit = 0.7f, .speed_limit = 10, .torque_limit = TORQUE_LIMIT};
    state = DRIVE_COMMISSION;
    if (axis_start(&axis, &config, LOOP_HZ) != DAHL_COMMISSION_OK) {
        enter_fault(DRIVE_REFUSED);
    }
}

static void take_order(void)
{
    bool is_sound = encoder.good_ticks >= GOOD_READINGS;
    drive_order_t what = (drive_order_t)atomic_load_explicit(&order, memory_order_acquire);
    silent_ticks = what == DRIVE_NONE ? silent_ticks + 1 : 0;
    if (what == DRIVE_STOP && state != DRIVE_FAULT) {
        state = DRIVE_OFF;
    } else if (what == DRIVE_MOVE && (state == DRIVE_RUN || (state == DRIVE_OFF && is_sound))) {
        if (state == DRIVE_OFF) {
            start_loop();
        }
        reference.target = order_target;
    } else if (what == DRIVE_START_COMMISSION && state == DRIVE_OFF && is_sound) {
        start_commissioning();
    } else if (what == DRIVE_CLEAR && state == DRIVE_FAULT && is_sound) {
        state = DRIVE_OFF;
        fault = DRIVE_NO_FAULT;
    }
    atomic_store_explicit(&order, DRIVE_NONE, memory_order_release);
}

static float clamp(float x, float limit)
{
    return x > limit ? limit : x < -limit ? -limit : x;
}

/* Move the reference towards the target. */
static position_loop_reference_t next_reference(void)
{
    float gap = (float)(reference.target - reference.count) * DRIVE_THETA_PER_COUNT;
    float wanted = clamp(APPROACH * gap, SPEED_LIMIT);
    float change = clamp(wanted - reference.speed, ACCELERATION_LIMIT * DRIVE_PERIOD_S);
    reference.speed += change;
    float moved = reference.speed * DRIVE_PERIOD_S / DRIVE_THETA_PER_COUNT + reference.part;
    int32_t dcounts = (int32_t)moved;
    reference.part = moved - (float)dcounts;
    reference.count += dcounts;
    return (position_loop_reference_t){dcounts, reference.speed, change / DRIVE_PERIOD_S, 0};
}

static float run(int32_t dcounts, bool is_good)
{
    position_loop_reference_t next = next_reference();
    float result = position_loop_tick(&loop, &next, dcounts, is_good);
    if (loop.error > FOLLOWING_LIMIT || loop.error < -FOLLOWING_LIMIT) {
        enter_fault(DRIVE_FOLLOWING);
    } else if (silent_ticks > BUS_TICKS) {
        enter_fault(DRIVE_BUS);
    }
    return result;
}

static float commission(int32_t dcounts, bool is_good)
{
    float result = axis_tick(&axis, dcounts, is_good);
    if (axis.command.stage == DAHL_COMMISSION_REFUSED) {
        enter_fault(DRIVE_REFUSED);
    } else if (axis.command.stage == DAHL_COMMISSION_DONE) {
        state = DRIVE_OFF;
        has_result = true;
    }
    return result;
}

/* Return true if the states are in range, the torque is one, and the main program is sound. */
static bool is_sound(void)
{
    main_ticks++;
    if (atomic_load_explicit(&is_main_sound, memory_order_relaxed) != 0) {
        atomic_store_explicit(&is_main_sound, 0, memory_order_relaxed);
        main_ticks = 0;
    }
    return main_ticks <= MAIN_TICKS && dahl_state_ok(&loop.bristle) && torque >= -TORQUE_LIMIT && torque <= TORQUE_LIMIT;
}

static void report(void)
{
    reports = (drive_report_t){
        ++ticks, encoder.count, state == DRIVE_RUN ? loop.compensator.torque_q30 : 0, torque, encoder.corrupt, encoder.jumps,
        encoder.invalid, (uint8_t)state, (uint8_t)fault, axis.command.stage, axis.command.refusal, encoder.bad_ticks == 0,
        encoder.is_primed};
    atomic_store_explicit(&report_number, ticks, memory_order_release);
}

void drive_tick(void)
{
    uint8_t frame[BOARD_SPI_BYTES];
    board_encoder(frame);
    int32_t dcounts = encoder_take(&encoder, frame);
    bool is_good = encoder.bad_ticks == 0;
    take_settings();
    take_order();
    if (encoder.bad_ticks >= BAD_READINGS && state != DRIVE_FAULT) {
        enter_fault(DRIVE_ENCODER);
    }
    torque = state == DRIVE_RUN          ? run(dcounts, is_good)
             : state == DRIVE_COMMISSION ? commission(dcounts, is_good)
                                         : torque - clamp(torque, FALL_PER_TICK);
    bool may_act = is_sound();
    board_torque(may_act ? torque : 0);
    if (may_act) {
        board_watchdog_feed();
    }
    report();
}
