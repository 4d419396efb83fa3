/* SPDX-License-Identifier: MIT */
/* The interrupt owns encoder, loop and axis. The main program hands over new plans and orders, each with a flag that the next
 * tick clears. The interrupt preempts the main program, never the other way round. */
#include "drive.h"

#include <stdatomic.h>

#include "axis.h"
#include "encoder.h"
#include "position_loop.h"

#define PERIOD_S 1e-3f
#define LOOP_HZ 35.0f
#define LOOP_RATE (6.2831853f * LOOP_HZ) /* 1/s */
#define OBSERVER_HZ 15.0f
#define TORQUE_LIMIT 5.0f        /* N m, of the drive */
#define FALL_PER_TICK 0.25f      /* N m: after a fault, the torque falls to 0 within 20 ms */
#define SPEED_LIMIT 2.0f         /* rad/s, of a move */
#define ACCELERATION_LIMIT 40.0f /* rad/s2 */
#define APPROACH 8.0f            /* 1/s: SPEED_LIMIT APPROACH < ACCELERATION_LIMIT, so a move does not overshoot */
#define FC_LEAST 0.05f           /* N m */
#define FC_MOST 2.0f
enum { FOLLOWING_COUNTS = 300, BAD_READINGS = 3, GOOD_READINGS = 100, BUS_TICKS = 200, MAIN_TICKS = 50 };

static position_loop_params_t params, new_params;
static position_loop_t loop, new_loop; /* new_loop: plans only */
static uint32_t plans_crc;             /* of the last set */
static atomic_bool has_new_loop;       /* set by main, cleared by the tick; so are the next two */
static atomic_uchar order = ORDER_NONE;
static atomic_bool is_main_sound;
static atomic_bool has_result; /* set by the tick, cleared by main and by the next commissioning */
static int32_t order_target;
static drive_report_t reports;
static atomic_uchar report_number; /* changes with each report */

static encoder_t encoder;
static axis_t axis;
static drive_state_t state;
static drive_fault_t fault;
static float torque; /* N m, of the last tick */
static struct { int32_t count, target; float part, speed; } reference; /* counts, rad/s */
static uint32_t silent_ticks, main_ticks; /* since the last ORDER_MOVE, and the last report of the main program */
static bool has_failed;

/* --- the main program --------------------------------------------------------------------------- */

static position_loop_params_t params_of(const store_params_t *p)
{
    return (position_loop_params_t){
        .compensator = {.friction = {p->sigma0, p->Fc, DRIVE_THETA_PER_COUNT}, .law = DAHL_COMPENSATOR_REFERENCE,
                        .gain = p->gain, .limit = p->Fc, .slew = 100 * p->Fc, .period = PERIOD_S,
                        .rise = 0.5f, .fall = 0.02f, .noise = p->noise, .play = 2 * p->noise + 2, .jump = ENCODER_MAX_STEP},
        .observer = {.inertia = p->inertia_low, .corner = OBSERVER_HZ, .limit = p->Fc / 2,
                     .speed_gain = p->inertia * LOOP_RATE, .delay = p->delay},
        .position_gain = LOOP_RATE / 5, .integral_time = 6 / LOOP_RATE, .drive_limit = TORQUE_LIMIT};
}

static uint32_t crc_of(const position_loop_t *one)
{
    return store_crc(one->params, sizeof *one->params) ^ store_crc(&one->friction, sizeof one->friction)
           ^ store_crc(&one->plan, sizeof one->plan) ^ store_crc(&one->residual_plan, sizeof one->residual_plan);
}

bool drive_set(const store_params_t *from)
{
    bool is_in_range = from->Fc >= FC_LEAST && from->Fc <= FC_MOST;
    new_params = params_of(from);
    if (!is_in_range || position_loop_init(&new_loop, &new_params) != 0) {
        return false;
    }
    plans_crc = crc_of(&new_loop);
    has_new_loop = true;
    return true;
}

void drive_start(board_reset_t cause)
{
    state = cause == BOARD_WATCHDOG ? DRIVE_FAULT : DRIVE_OFF;
    fault = cause == BOARD_WATCHDOG ? DRIVE_RESET : DRIVE_NO_FAULT;
}

bool drive_is_ready(void)
{
    return order == ORDER_NONE && !has_new_loop;
}

void drive_order(order_t what, int32_t target)
{
    order_target = target;
    order = (unsigned char)what;
}

void drive_check(void)
{
    if (!has_new_loop && crc_of(&loop) == plans_crc) {
        is_main_sound = true;
    }
}

void drive_read(drive_report_t *report)
{
    unsigned char before;
    do { /* again, if a tick came in between */
        before = report_number;
        *report = reports;
        atomic_signal_fence(memory_order_seq_cst);
    } while (before != report_number);
}

bool drive_take_result(store_params_t *to)
{
    const dahl_commission_result_t *result = &axis.commission.result;
    if (!has_result) {
        return false;
    }
    *to = (store_params_t){result->Fc.best, result->sigma0.best, to->gain, result->inertia.best, result->inertia.least,
                           (uint32_t)(result->delay.best / PERIOD_S + 0.5f), result->noise};
    has_result = false;
    return true;
}

/* --- the tick ----------------------------------------------------------------------------------- */

/* The torque keeps its slew across a change of the plans. */
static void take_settings(void)
{
    if (has_new_loop) {
        dahl_change_plan(&loop.friction, &new_loop.friction, &loop.bristle);
        dahl_compensator_change(&loop.plan, &new_loop.plan, &loop.compensator);
        dahl_residual_change(&loop.residual_plan, &new_loop.residual_plan, &loop.residual);
        params = new_params;
        loop.params = &params;
        loop.friction = new_loop.friction;
        loop.plan = new_loop.plan;
        loop.residual_plan = new_loop.residual_plan;
        has_new_loop = false;
    }
}

static void enter_fault(drive_fault_t why)
{
    state = DRIVE_FAULT;
    fault = why;
}

/* Start at rest at the present count, with the compensation faded out. */
static void start_loop(void)
{
    loop = (position_loop_t){
        .params = &params, .friction = loop.friction, .plan = loop.plan, .residual_plan = loop.residual_plan};
    reference.count = encoder.count;
    reference.part = reference.speed = 0;
    state = DRIVE_RUN;
}

static void start_commissioning(void)
{
    const dahl_commission_config_t config = {.period = PERIOD_S, .theta_per_count = DRIVE_THETA_PER_COUNT,
                                             .inertia = params.observer.speed_gain / LOOP_RATE, .travel = 0.35f,
                                             .angle_limit = 0.7f, .speed_limit = 10, .torque_limit = TORQUE_LIMIT};
    state = DRIVE_COMMISSION;
    has_result = false;
    (void)axis_start(&axis, &config, LOOP_HZ); /* if it is refused, so is its first tick */
}

static void take_order(void)
{
    bool is_steady = encoder.good_ticks >= GOOD_READINGS;
    silent_ticks = order == ORDER_MOVE ? 0 : silent_ticks + 1;
    if (order == ORDER_STOP && state != DRIVE_FAULT) {
        state = DRIVE_OFF;
    } else if (order == ORDER_COMMISSION && state == DRIVE_OFF && is_steady) {
        start_commissioning();
    } else if (order == ORDER_MOVE) {
        if (state == DRIVE_OFF && is_steady) {
            start_loop();
        }
        reference.target = order_target;
    } else if (order == ORDER_CLEAR) {
        encoder.corrupt = encoder.invalid = encoder.jumps = 0;
        state = state == DRIVE_FAULT && is_steady ? DRIVE_OFF : state;
        fault = state == DRIVE_FAULT ? fault : DRIVE_NO_FAULT;
    }
    order = ORDER_NONE;
}

static float clamp(float x, float limit)
{
    return x > limit ? limit : x < -limit ? -limit : x;
}

/* Move the reference towards the target. */
static position_loop_reference_t next_reference(void)
{
    float gap = (float)(reference.target - reference.count) * DRIVE_THETA_PER_COUNT;
    float change = clamp(clamp(APPROACH * gap, SPEED_LIMIT) - reference.speed, ACCELERATION_LIMIT * PERIOD_S);
    reference.speed += change;
    float moved = reference.speed * PERIOD_S / DRIVE_THETA_PER_COUNT + reference.part;
    int32_t dcounts = (int32_t)moved;
    reference.part = moved - (float)dcounts;
    reference.count += dcounts;
    return (position_loop_reference_t){dcounts, reference.speed, change / PERIOD_S, 0};
}

static float run(int32_t dcounts, bool is_good)
{
    position_loop_reference_t next = next_reference();
    if (loop.error > FOLLOWING_COUNTS || loop.error < -FOLLOWING_COUNTS) {
        enter_fault(DRIVE_FOLLOWING);
    } else if (silent_ticks > BUS_TICKS) {
        enter_fault(DRIVE_BUS);
    }
    return position_loop_tick(&loop, &next, dcounts, is_good);
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

/* A failed check stays: only the watchdog ends it. */
static void check(bool is_passed)
{
    has_failed = has_failed || !is_passed;
}

void drive_tick(void)
{
    uint8_t frame[BOARD_SPI_BYTES];
    board_encoder(frame);
    int32_t dcounts = encoder_take(&encoder, frame);
    bool is_good = encoder.bad_ticks == 0;
    main_ticks = is_main_sound ? 0 : main_ticks + 1;
    is_main_sound = false;
    check(main_ticks <= MAIN_TICKS);
    check(dahl_state_ok(&loop.bristle));
    take_settings();
    take_order();
    if (encoder.bad_ticks >= BAD_READINGS && state != DRIVE_FAULT) {
        enter_fault(DRIVE_ENCODER);
    }
    torque = state == DRIVE_RUN          ? run(dcounts, is_good)
             : state == DRIVE_COMMISSION ? commission(dcounts, is_good)
                                         : torque - clamp(torque, FALL_PER_TICK);
    check(torque >= -TORQUE_LIMIT && torque <= TORQUE_LIMIT); /* fails for NaN, too */
    torque = has_failed ? 0 : torque;
    board_torque(torque);
    if (!has_failed) {
        board_watchdog_feed();
    }
    reports = (drive_report_t){encoder, reports.ticks + 1, state == DRIVE_RUN ? loop.compensator.torque_q30 : 0, torque,
                               (uint8_t)state, (uint8_t)fault, axis.command.stage, axis.command.refusal};
    report_number = (unsigned char)reports.ticks;
}
