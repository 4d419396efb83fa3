/* SPDX-License-Identifier: MIT */
/* Reactions of a commissioning that random axes seldom show: refusals, second tries and lower gains. */
#include <stdio.h>
#include <unity.h>

#include "scripted_axis.h"

#define PI 3.141592653589793

static int is_in(const scripted_t *axis, dahl_commission_stage_t stage, dahl_commission_mode_t mode)
{
    return axis->command.stage == stage && axis->command.mode == mode;
}

static int is_torque(const scripted_t *axis, dahl_commission_stage_t stage)
{
    return is_in(axis, stage, DAHL_COMMISSION_TORQUE);
}

/* --- scripts: what the axis does; the table below has what the commissioning must do ------------------------------------- */

static void flicker(scripted_t *axis)
{
    axis->noise = axis->command.stage == DAHL_COMMISSION_REST && axis->ticks & 1 ? 2 : 0;
}

static void ring_at_rest(scripted_t *axis)
{
    if (axis->command.stage == DAHL_COMMISSION_REST) {
        axis->theta += 10 * axis->count * sin(2 * PI * 20 * axis->ticks * axis->period);
    }
}

static void toggle(scripted_t *axis)
{
    axis->noise = axis->command.mode == DAHL_COMMISSION_TRACK ? 0 : axis->ticks & 1;
}

static void hit_stop(scripted_t *axis)
{
    if (fabs(axis->theta) > 0.29) {
        axis->theta = copysign(0.29, axis->theta);
        axis->torque = axis->load + copysign(axis->Fc, axis->theta);
    }
}

static void assist(scripted_t *axis) /* the torque helps the motion, as of a wrong sign that the load hides */
{
    if (is_in(axis, DAHL_COMMISSION_SWEEPS, DAHL_COMMISSION_TRACK)) {
        axis->torque -= 1.2 * axis->Fc * axis->direction;
    }
}

static void wobble(scripted_t *axis)
{
    axis->theta += 0.03 * sin(2 * PI * 20 * axis->ticks * axis->period);
}

static void shake_in_sweeps(scripted_t *axis)
{
    if (is_in(axis, DAHL_COMMISSION_SWEEPS, DAHL_COMMISSION_TRACK)) {
        wobble(axis);
    }
}

static void shake_once_when_fast(scripted_t *axis)
{
    if (fabs((double)axis->command.speed) > 1 && axis->ticks < 6500) {
        wobble(axis);
    }
}

static void lead_when_fast(scripted_t *axis) /* and shake at the slowest sweep: the axis reaches one speed only */
{
    const double speed = (double)axis->command.speed, part = fmax(0, fmin(1, (fabs(speed) - 1.2) / 0.6));
    if (is_in(axis, DAHL_COMMISSION_SWEEPS, DAHL_COMMISSION_TRACK)) {
        axis->theta += copysign(0.091 * part, speed);
        if (fabs(speed) < 0.7) {
            wobble(axis);
        }
    }
}

static void follow_softly(scripted_t *axis) /* then stick for 40 ms, which a soft loop may */
{
    if (is_torque(axis, DAHL_COMMISSION_SWEEPS)) {
        axis->memory = fmax(axis->memory, 1);
    } else if (is_in(axis, DAHL_COMMISSION_SWEEPS, DAHL_COMMISSION_TRACK)) {
        axis->memory += axis->memory > 0;
        axis->theta *= axis->memory > 0 ? 1 : 0.3;
    }
    if (axis->memory > 100 && axis->memory < 140) {
        axis->theta = axis->counts * axis->count;
        axis->torque += 0.5;
    }
}

static void soften_hole(scripted_t *axis) /* little friction at one angle */
{
    if (is_in(axis, DAHL_COMMISSION_SWEEPS, DAHL_COMMISSION_TRACK) && axis->theta > 0.05 && axis->theta < 0.1) {
        axis->torque -= 0.95 * axis->Fc * axis->direction;
    }
}

static void slip_in_cycle(scripted_t *axis)
{
    axis->breakaway = axis->command.stage == DAHL_COMMISSION_CYCLE ? 0.5 : 1;
    axis->slide = axis->command.stage == DAHL_COMMISSION_CYCLE ? 3 : 1;
}

static void push_once_in_cycle(scripted_t *axis)
{
    if (is_torque(axis, DAHL_COMMISSION_CYCLE) && axis->ticks > 500 && axis->memory < 0.2) {
        axis->memory += 0.001;
        axis->anchor += 0.001;
    }
}

static void push_always_in_cycle(scripted_t *axis)
{
    if (is_torque(axis, DAHL_COMMISSION_CYCLE)) {
        axis->anchor += 0.001;
    }
}

static void push_back_in_ramp(scripted_t *axis)
{
    if (is_torque(axis, DAHL_COMMISSION_BREAKAWAY)) {
        axis->anchor -= copysign(0.0002, (double)axis->command.torque - axis->load);
    }
}

static void swing_against(scripted_t *axis)
{
    if (is_in(axis, DAHL_COMMISSION_INERTIA, DAHL_COMMISSION_TRACK)) {
        axis->torque -= 2 * axis->inertia * axis->acceleration;
    }
}

static void lose_sines(scripted_t *axis) /* in the second half of the strokes */
{
    if (is_in(axis, DAHL_COMMISSION_INERTIA, DAHL_COMMISSION_TRACK) && axis->strokes > 2) {
        axis->memory += copysign(2 * axis->period, (double)axis->command.speed);
        axis->theta = axis->memory;
    } else {
        axis->memory = axis->theta;
    }
}

static void run_loud(scripted_t *axis) /* a resonance */
{
    if (is_in(axis, DAHL_COMMISSION_INERTIA, DAHL_COMMISSION_TRACK)) {
        axis->theta += 0.06 * sin(2 * PI * 20 * axis->ticks * axis->period);
    }
}

static int is_after_push(const scripted_t *axis)
{
    return is_torque(axis, DAHL_COMMISSION_KICK) && axis->kick_ticks > 200;
}

static void run_away(scripted_t *axis)
{
    if (is_after_push(axis)) {
        axis->anchor += copysign(2 * axis->period, axis->theta);
    }
}

static void run_away_at_second_gain(scripted_t *axis)
{
    if (axis->kicks > 2) {
        run_away(axis);
    }
}

static void creep(scripted_t *axis)
{
    if (is_after_push(axis)) {
        axis->anchor += 0.03 * axis->period;
    }
}

static void run_away_once(scripted_t *axis)
{
    if (axis->kicks == 1) {
        run_away(axis);
    }
}

static void run_away_then_creep(scripted_t *axis) /* each time at the second gain */
{
    run_away_once(axis);
    if (axis->kicks == 4 || axis->kicks == 6) {
        creep(axis);
    }
}

static void ring_long(scripted_t *axis)
{
    if (is_after_push(axis)) {
        const double time = axis->kick_ticks * axis->period;
        axis->theta += 0.05 * exp(-0.5 * time) * sin(2 * PI * 10 * time);
    }
}

static void ring_after_push(scripted_t *axis)
{
    if (is_after_push(axis)) {
        axis->theta += 0.05 * sin(2 * PI * 10 * axis->kick_ticks * axis->period);
    }
}

static void run_loud_once(scripted_t *axis)
{
    if (axis->ticks < 50) {
        run_loud(axis);
    }
}

static void run_loud_twice(scripted_t *axis)
{
    if (axis->ticks < 75) {
        run_loud(axis);
    }
}

static void run_loud_three_times(scripted_t *axis)
{
    if (axis->ticks < 90) {
        run_loud(axis);
    }
}

static void stiffen_above_15_hz(scripted_t *axis) /* the inertia grows and levels off, as that of no shaft */
{
    if (is_in(axis, DAHL_COMMISSION_INERTIA, DAHL_COMMISSION_TRACK)) {
        axis->memory += 2 * PI * 15 * axis->period * (axis->acceleration - axis->memory);
        axis->torque += axis->inertia * (axis->acceleration - axis->memory);
    }
}

typedef struct {
    const char *name;
    dahl_commission_refusal_t refusal;
    float gain; /* of an axis that is not refused */
    scripted_t change; /* members that are not 0 replace those of the default */
} scenario_t;

static const scenario_t scenarios[] = {
    {"good axis", DAHL_COMMISSION_OK, 0.95f, {.script = NULL}},
    {"counts flicker in each tick at rest", DAHL_COMMISSION_OK, 0.95f, {.script = flicker}},
    {"end stop within the travel", DAHL_COMMISSION_NO_DATA, 0, {.script = hit_stop}},
    {"torque along the motion", DAHL_COMMISSION_VARIES, 0, {.script = assist}},
    {"rings slowly at rest", DAHL_COMMISSION_OK, 0.95f, {.script = ring_at_rest}},
    {"shakes at all sweeps", DAHL_COMMISSION_VARIES, 0, {.script = shake_in_sweeps}},
    {"shakes once at a faster sweep", DAHL_COMMISSION_VARIES, 0, {.script = shake_once_when_fast}},
    {"reaches one speed only", DAHL_COMMISSION_OK, 0.95f, {.travel = 0.23, .script = lead_when_fast}},
    {"soft loop that sticks", DAHL_COMMISSION_OK, 0.95f, {.script = follow_softly}},
    {"almost no friction at one angle", DAHL_COMMISSION_VARIES, 0, {.script = soften_hole}},
    {"breaks away at half of Fc in the cycle", DAHL_COMMISSION_OK, 0.95f, {.script = slip_in_cycle}},
    {"pushed once in the cycle", DAHL_COMMISSION_OK, 0.95f, {.script = push_once_in_cycle}},
    {"pushed always in the cycle", DAHL_COMMISSION_COARSE, 0, {.script = push_always_in_cycle}},
    {"pushed back in the ramp", DAHL_COMMISSION_DISTURBED, 0, {.script = push_back_in_ramp}},
    {"breaks away at 2.5 Fc", DAHL_COMMISSION_COARSE, 0, {.breakaway = 2.5}},
    {"presliding below the counts", DAHL_COMMISSION_COARSE, 0, {.count = 0.008, .sigma0 = 250, .script = toggle}},
    {"load swings against the rotor", DAHL_COMMISSION_BAD_INERTIA, 0, {.script = swing_against}},
    {"half of the strokes without sines", DAHL_COMMISSION_BAD_INERTIA, 0, {.script = lose_sines}},
    {"resonance in the strokes", DAHL_COMMISSION_BAD_INERTIA, 0, {.script = run_loud}},
    {"resonance at first: a soft shaft", DAHL_COMMISSION_OK, 0.5f, {.script = run_loud_twice}},
    {"resonance at 76 Hz, and a tick too long for 88 Hz",
     DAHL_COMMISSION_BAD_INERTIA,
     0,
     {.period = 1.0 / 880, .script = run_loud_three_times}},
    {"inertia of no shaft", DAHL_COMMISSION_BAD_INERTIA, 0, {.script = stiffen_above_15_hz}},
    {"inertia 6 times that of the configuration", DAHL_COMMISSION_BAD_INERTIA, 0, {.inertia = 0.012}},
    {"inertia a sixth of that of the configuration", DAHL_COMMISSION_BAD_INERTIA, 0, {.loop_inertia = 0.012}},
    {"the same at a tick of 2 ms", DAHL_COMMISSION_BAD_INERTIA, 0, {.loop_inertia = 0.012, .period = 2e-3}},
    {"light rotor", DAHL_COMMISSION_LIGHT, 0, {.inertia = 2e-5, .loop_inertia = 2e-5}},
    {"light rotor at a tick of 2 ms",
     DAHL_COMMISSION_LIGHT,
     0,
     {.inertia = 4e-5, .loop_inertia = 4e-5, .period = 2e-3}},
    {"light rotor with a resonance",
     DAHL_COMMISSION_LIGHT,
     0,
     {.inertia = 2e-5, .loop_inertia = 2e-5, .script = run_loud_once}},
    {"almost no friction", DAHL_COMMISSION_COARSE, 0, {.Fc = 1e-30, .sigma0 = 1e-28, .load = 1e-31}},
    {"slow in the pushes", DAHL_COMMISSION_OK, 0.95f, {.slide = 0.6}},
    {"fast in the pushes", DAHL_COMMISSION_OK, 0.95f, {.slide = 2.3}},
    {"runs away after each push", DAHL_COMMISSION_SWINGS, 0, {.script = run_away}},
    {"runs away at the second gain", DAHL_COMMISSION_OK, 0.5f, {.script = run_away_at_second_gain}},
    {"creeps after each push", DAHL_COMMISSION_SWINGS, 0, {.script = creep}},
    {"runs away once", DAHL_COMMISSION_OK, 0.9f, {.script = run_away_once}},
    {"runs away once, then creeps twice", DAHL_COMMISSION_OK, 0.5f, {.script = run_away_then_creep}},
    {"rings for long", DAHL_COMMISSION_SWINGS, 0, {.script = ring_long}},
    {"rings after each push", DAHL_COMMISSION_SWINGS, 0, {.script = ring_after_push}},
    {"coarse noisy encoder at 20 kHz",
     DAHL_COMMISSION_COARSE,
     0,
     {.count = 0.01, .period = 5e-5, .sigma0 = 20, .script = toggle}},
};

static void replace(double *value, double change)
{
    *value = change > 0 ? change : *value;
}

static scripted_t axis_of(const scenario_t *scenario)
{
    scripted_t axis = scripted_default;
    const scripted_t *change = &scenario->change;
    replace(&axis.Fc, change->Fc);
    replace(&axis.sigma0, change->sigma0);
    replace(&axis.breakaway, change->breakaway);
    replace(&axis.load, change->load);
    replace(&axis.slide, change->slide);
    replace(&axis.inertia, change->inertia);
    replace(&axis.loop_inertia, change->loop_inertia);
    replace(&axis.count, change->count);
    replace(&axis.period, change->period);
    replace(&axis.travel, change->travel);
    axis.script = change->script;
    return axis;
}

static void check_bounds(const scripted_t *axis, const dahl_commission_result_t *result)
{
    const double length = axis->Fc / axis->sigma0;
    TEST_ASSERT_TRUE((double)result->Fc.least <= axis->Fc && axis->Fc <= (double)result->Fc.most);
    TEST_ASSERT_TRUE((double)result->length.least <= length && length <= (double)result->length.most);
    TEST_ASSERT_TRUE((double)result->inertia.least <= axis->inertia && axis->inertia <= (double)result->inertia.most);
    TEST_ASSERT_TRUE(result->viscous.least <= 0 && 0 <= result->viscous.most && isfinite(result->viscous.most));
    for (int bin = 0; bin < DAHL_COMMISSION_BINS; bin++) {
        TEST_ASSERT_TRUE(fabs((double)result->load[bin] - axis->load) <= (double)result->load_error);
    }
}

static void test_each_scenario_is_refused_with_its_code_or_has_true_bounds(void)
{
    for (size_t k = 0; k < sizeof scenarios / sizeof scenarios[0]; k++) {
        scripted_t axis = axis_of(&scenarios[k]);
        const dahl_commission_t state = commission_scripted(&axis);
        printf("  %s: code %d, gain %.2f\n", scenarios[k].name, state.command.refusal, (double)state.result.gain);
        TEST_ASSERT_EQUAL_MESSAGE(scenarios[k].refusal, state.command.refusal, scenarios[k].name);
        TEST_ASSERT_EQUAL(DAHL_COMMISSION_OFF, state.command.mode);
        TEST_ASSERT_EQUAL_FLOAT(0, state.command.torque);
        if (axis.script == NULL) {
            TEST_ASSERT_TRUE(axis.most_push_s < 0.052 && axis.most_push_s * axis.slide < 0.106);
        }
        if (scenarios[k].refusal == DAHL_COMMISSION_OK) {
            TEST_ASSERT_EQUAL(DAHL_COMMISSION_DONE, state.command.stage);
            TEST_ASSERT_FLOAT_WITHIN_MESSAGE(1e-5f, scenarios[k].gain, state.result.gain, scenarios[k].name);
            check_bounds(&axis, &state.result);
        }
    }
}

/* An encoder that alternates between two counts, 2 apart, has the noise 1. A slow ring is no noise. */
static void test_the_noise_is_half_of_a_flicker(void)
{
    scripted_t flickers = scripted_default, rings = scripted_default;
    flickers.script = flicker;
    rings.script = ring_at_rest;
    TEST_ASSERT_EQUAL(1, commission_scripted(&flickers).result.noise);
    TEST_ASSERT_EQUAL(0, commission_scripted(&rings).result.noise);
}

/* A ring that decays gets more time, 20 windows of 0.2 s instead of 10 for each of 6 kicks. */
static void test_a_steady_ring_is_found_early(void)
{
    scripted_t steady = scripted_default, decaying = scripted_default;
    steady.script = ring_after_push;
    decaying.script = ring_long;
    TEST_ASSERT_TRUE(commission_scripted(&steady).ticks + 5000 < commission_scripted(&decaying).ticks);
}

static void test_the_gain_is_lower_if_the_load_is_not_fed_forward(void)
{
    scripted_t axis = scripted_default;
    const dahl_commission_t state = commission_scripted(&axis);
    const dahl_commission_result_t *result = &state.result;
    dahl_compensator_params_t with, without;
    TEST_ASSERT_EQUAL(DAHL_COMPENSATOR_OK, dahl_commission_params(&state, &with, 0));
    TEST_ASSERT_EQUAL(DAHL_COMPENSATOR_OK, dahl_commission_params(&state, &without, 1));
    TEST_ASSERT_TRUE(with.load == 0 && without.load >= (float)scripted_default.load);
    TEST_ASSERT_TRUE(without.gain * result->Fc.least <= 0.95f * (result->Fc.least - without.load));
    TEST_ASSERT_TRUE(without.gain < with.gain);
}
