/* SPDX-License-Identifier: MIT */
/* A search for a free axis that the measured law keeps moving, although each condition of dahl_compensator.h holds: rigid, loaded
 * and elastic, with the friction of Dahl, LuGre and Maxwell, bad readings, and parameters that change. It must find none. If one
 * condition is broken, the same search finds an axis that swings, so the search is strong and the condition is needed. */
#include "axis.h"
#include "search.h"

#ifndef TEST_AXES
#define TEST_AXES 1500
#endif
#define KICK_S 0.01
#define EDGE 1.000001 /* a bound in float is on its safe side */
#define LONGEST_S 200.0
#define MOST_TICKS 4e5

typedef enum { RIGID, LOADED, ELASTIC, KINDS } kind_t;

/* Conditions of the header. */
typedef enum { NONE, INERTIA, GAIN, LENGTH, FC_LOW, SLEW, FADE_SPEED } condition_t;

typedef struct {
    kind_t kind;
    condition_t broken;
} problem_t;

/* rad/s of the axis, rad/s of the motor alone, N m for KICK_S, and its opposite some s later. */
typedef struct {
    double kick, motor_kick, tap, half;
} push_t;

typedef struct {
    axis_t axis;
    dahl_compensator_params_t params, later; /* later: from the tap on */
    push_t push;
    double bad_share; /* of the readings */
} case_t;

/* --- points to axes --------------------------------------------------------------------------------------------------- */

/* Friction whose Fc is 1, with its breakaway torque and the length of its steepest slope. */
static friction_t friction_of(point_t *point, double length, double frequency)
{
    static const double halves[] = {0, 0.5, 1};
    const int kind = choose(point, 4), springs = 1 + choose(point, SPRINGS);
    const double rise = between(point, 1, 1.6), stribeck = log_between(point, 0.01, 3), damping = halves[choose(point, 3)];
    friction_t f = {.Fc = 1, .sigma0 = 1 / length, .breakaway = 1};
    if (kind == 1) {
        f.breakaway = rise;
        f.stribeck_speed = stribeck * length * frequency;
        f.sigma1 = 2 * damping / (length * frequency);
    }
    f.springs = kind == 2 ? springs : 0;
    return f;
}

static friction_t scaled(friction_t f, double part)
{
    f.Fc *= part;
    f.sigma0 *= part;
    f.breakaway *= part;
    f.sigma1 *= part;
    return f;
}

/* A shaft before a part of the inertia and of the friction. */
static void split(axis_t *axis, point_t *point)
{
    const double share = maybe(point, 0, 0, 1), rotor = between(point, 0.05, 0.95);
    const double w = TWO_PI * log_between(point, 20, 300), ratio = log_between(point, 0.01, 0.05);
    const double reduced = axis->inertia[MOTOR] * (1 - rotor);
    const friction_t f = axis->friction[MOTOR];
    axis->inertia[LOAD] = axis->inertia[MOTOR] * (1 - rotor) / rotor;
    axis->shaft = w * w * reduced;
    axis->damping = 2 * ratio * w * reduced;
    axis->friction[MOTOR] = scaled(f, share);
    axis->friction[LOAD] = scaled(f, 1 - share);
}

/* u is sqrt(sigma0_high/(3 inertia)) (delay + period/2): the rule of the inertia is u <= 1. */
static axis_t make_axis(point_t *point, const problem_t *problem, double *length)
{
    static const double periods[] = {1e-4, 2.5e-4, 5e-4, 1e-3, 1e-3};
    const int is_slew = problem->broken == SLEW; /* only a light rotor with a long delay and a fine encoder needs it */
    axis_t axis = {.period = periods[choose(point, 5)]};
    const int delay = choose(point, 5);
    const double Fc = log_between(point, 0.01, 10), near = between(point, 0, is_slew ? 0.2 : 1);
    const double u = problem->broken == INERTIA ? 1.6 + 0.6 * near : pow(0.03, near * near) / EDGE;
    axis.delay = is_slew ? 3 : delay;
    *length = log_between(point, 0.5e-3, 30e-3);
    axis.lag = maybe(point, 0, 0, 1.5) * axis.period;
    axis.count = TWO_PI / (1 << (is_slew ? 20 : 12 + choose(point, 9)));
    axis.noise = choose(point, 3);
    axis.is_noise_after_rounding = choose(point, 2);
    const double late = (axis.delay + 0.5) * axis.period + axis.lag, frequency = u * sqrt(3) / late;
    axis.inertia[MOTOR] = Fc / *length / (frequency * frequency);
    axis.friction[MOTOR] = scaled(friction_of(point, *length, frequency), Fc);
    const axis_t rigid = axis;
    split(&axis, point);
    return problem->kind == ELASTIC ? axis : rigid;
}

/* What the encoder sees, with the twist of the shaft; three times that of slip elements. */
static double seen_length(const axis_t *axis, double length)
{
    const friction_t *motor = &axis->friction[MOTOR], *load = &axis->friction[LOAD];
    const double rise = (motor->breakaway + load->breakaway) / Fc_of(axis);
    const double twist = is_elastic(axis) ? load->breakaway / axis->shaft : 0;
    return (motor->springs > 0 ? 3 : 1) * (length * rise + twist);
}

static double least_slew(const axis_t *axis, double Fc)
{
    return Fc * fmax(20, bristle_frequency(axis) / 25);
}

static double least_fade_speed(const axis_t *axis)
{
    return Fc_of(axis) / sqrt(sigma0_of(axis) * axis->inertia[MOTOR]) / 2;
}

static void set_element(case_t *c, point_t *point, const problem_t *problem, double length)
{
    dahl_compensator_params_t *p = &c->params;
    const double lower = maybe(point, 1, 0.5, 1), longer = maybe(point, 1, 1, 2), beyond = maybe(point, 1, 1, 1.5);
    const double Fc_low = Fc_of(&c->axis) / EDGE * (problem->broken == FC_LOW ? 1.05 + 0.5 * lower : lower);
    const double length_long = EDGE * longer * seen_length(&c->axis, length), Fc = Fc_low * maybe(point, 1, 0.5, 2);
    const int lengths = problem->kind == ELASTIC && problem->broken != LENGTH ? 4 : 1;
    p->Fc_low = (float)Fc_low;
    p->length_long = (float)length_long;
    p->elastic = problem->kind == ELASTIC;
    p->friction.Fc = (float)Fc;
    p->friction.sigma0 = (float)(Fc / (EDGE * lengths * length_long * beyond));
    p->friction.theta_per_count = (float)c->axis.count;
}

static void set_gain(case_t *c, point_t *point, const problem_t *problem)
{
    dahl_compensator_params_t *p = &c->params;
    const double share = between(point, -0.9, 0.9), part = between(point, 0, 1);
    const double load = problem->kind == LOADED || fabs(share) < 0.3 ? share * (double)p->Fc_low : 0;
    const double most = ((double)p->Fc_low - fabs(load)) / (double)p->friction.Fc / EDGE;
    c->axis.load = problem->kind == RIGID ? 0 : load;
    p->load = (float)fabs(c->axis.load);
    p->gain = (float)fmin(1, (problem->broken == GAIN ? 1.05 + 0.25 * part : 0.95 * sqrt(part)) * most);
}

static void set_rest(case_t *c, point_t *point, const problem_t *problem)
{
    const axis_t *axis = &c->axis;
    dahl_compensator_params_t *p = &c->params;
    const double Fc = (double)p->friction.Fc, slew = log_between(point, 1, 1000), fade = maybe(point, 0, 1, 100);
    p->sigma0_high = (float)(sigma0_of(axis) * EDGE);
    p->inertia = (float)(axis->inertia[MOTOR] / EDGE);
    p->delay = (float)(axis->delay * axis->period + axis->lag + 1e-9);
    p->limit = (float)(Fc * maybe(point, 1.2, 0.05, 1.2));
    p->slew = (float)(problem->broken == SLEW ? 20 * Fc : EDGE * slew * least_slew(axis, Fc));
    p->period = (float)axis->period;
    p->rise = (float)maybe(point, 0, 0, 0.5);
    p->fall = 0.02f;
    p->noise = (uint32_t)axis->noise;
    p->play = (p->noise > 0 ? 2 * p->noise + 2 : 1) + (uint32_t)maybe(point, 0, 0, 8);
    p->fade_speed = (float)(fade * least_fade_speed(axis) * (problem->broken == FADE_SPEED ? 0.1 : EDGE));
    p->jump = 1u << 30;
    if (fade > 0) {
        p->jump = (uint32_t)fmax(1, fmin(1e9, 900 * (double)p->fade_speed * axis->period / axis->count));
    }
}

static void set_push(case_t *c, point_t *point)
{
    const axis_t *axis = &c->axis;
    const double inertia = axis->inertia[MOTOR] + axis->inertia[LOAD], V = Fc_of(axis) / sqrt(sigma0_of(axis) * inertia);
    c->push.motor_kick = maybe(point, 0, 0, 20) * V * is_elastic(axis);
    const double kick = log_between(point, 0.3, 30) * V;
    c->push.kick = choose(point, 2) ? kick : -kick;
    c->push.tap = maybe(point, 0, -2, 2) * Fc_of(axis);
    c->push.half = between(point, 0, 100) * axis->period;
    c->bad_share = maybe(point, 0, 0, 0.02);
}

/* Parameters that also hold the conditions. */
static void set_later(case_t *c, point_t *point)
{
    dahl_compensator_params_t *p = &c->later;
    const float part = (float)maybe(point, 1, 0.3, 1);
    const int more = choose(point, 3);
    *p = c->params;
    p->play += part < 1 ? (uint32_t)more : 0;
    p->gain *= part;
    p->friction.Fc *= part;
    p->friction.sigma0 *= part;
}

static case_t make_case(point_t point, const problem_t *problem)
{
    double length;
    case_t c = {.params = {.law = DAHL_COMPENSATOR_MEASURED}};
    point.next = 0;
    c.axis = make_axis(&point, problem, &length);
    set_element(&c, &point, problem, length);
    set_gain(&c, &point, problem);
    set_rest(&c, &point, problem);
    set_push(&c, &point);
    set_later(&c, &point);
    return c;
}

static dahl_compensator_err_t code_of(const dahl_compensator_params_t *params)
{
    dahl_compensator_plan_t plan;
    return dahl_compensator_prepare(&plan, params);
}

/* Prepare refuses to break a rule. Give it a false bound. */
static void falsify(case_t *c, condition_t broken)
{
    static const dahl_compensator_err_t codes[] = {[INERTIA] = DAHL_COMPENSATOR_INERTIA, [GAIN] = DAHL_COMPENSATOR_GAIN,
                                                   [LENGTH] = DAHL_COMPENSATOR_SLOPE};
    if (INERTIA <= broken && broken <= LENGTH && code_of(&c->params) != DAHL_COMPENSATOR_RANGE) {
        TEST_ASSERT_EQUAL_INT(codes[broken], code_of(&c->params));
        c->params.inertia *= broken == INERTIA ? 5 : 1;
        c->params.load *= broken != GAIN;
        c->params.elastic = broken != LENGTH && c->params.elastic;
        c->later = c->params;
    }
}

/* A play, or a noise, of the presliding length hides all of it. */
static int is_case(const case_t *c)
{
    const axis_t *axis = &c->axis;
    const double stiffness = is_elastic(axis) ? 100 * axis->shaft : INFINITY, frequency = bristle_frequency(axis);
    return c->params.play * axis->count < 2 * (double)c->params.length_long && sigma0_of(axis) < stiffness && frequency < 20000
        && code_of(&c->params) == DAHL_COMPENSATOR_OK && code_of(&c->later) == DAHL_COMPENSATOR_OK;
}

/* --- rest ------------------------------------------------------------------------------------------------------------- */

static double promised_excess(const axis_t *axis)
{
    return fmax(0.02, 2 * axis->count * bristle_frequency(axis));
}

/* Time to rest after a momentum under the least net friction, and some swings. */
static double seconds_of(const case_t *c)
{
    const axis_t *axis = &c->axis;
    const push_t *push = &c->push;
    const double inertia = axis->inertia[MOTOR] + axis->inertia[LOAD], Fc = Fc_of(axis);
    const double momentum =
        fabs(push->kick) * inertia + fabs(push->motor_kick) * axis->inertia[MOTOR] + fabs(push->tap) * KICK_S;
    const double net = fmax(0.02 * Fc, Fc - fabs(axis->load) - (double)c->params.gain * (double)c->params.friction.Fc);
    const double shaft = is_elastic(axis) ? axis->damping * (1 / axis->inertia[MOTOR] + 1 / axis->inertia[LOAD]) / 2 : 0;
    return fmax(0.3, 300 / bristle_frequency(axis)) + 1.4 * momentum / net + (shaft > 0 ? fmin(10, 9 / shaft) : 0);
}

/* Bad readings are single ones. The caller does not store them, so the next move has the counts of two ticks. */
static int32_t read_encoder(const case_t *c, motion_t *m, int *is_bad)
{
    *is_bad = !*is_bad && random_part(&m->random) < c->bad_share;
    return *is_bad ? 12345 : read_move(&c->axis, m);
}

/* Largest speed in the last fifth of `seconds` after a push. */
static double end_speed(const case_t *c, double seconds, int is_compensated)
{
    const axis_t *axis = &c->axis;
    const int ticks = (int)(seconds / axis->period), tapped = ticks / 4, back = tapped + (int)(c->push.half / axis->period);
    const int width = (int)(KICK_S / axis->period) + 1;
    firmware_t firmware = {.torque = 0};
    motion_t m = {.random = 1, .speed = {c->push.kick + c->push.motor_kick, c->push.kick}};
    double largest = 0;
    int is_bad = 0;
    prepare_firmware(&firmware, &c->params);
    for (int t = 0; t < ticks; t++) {
        const int32_t move = read_encoder(c, &m, &is_bad);
        if (t == tapped) {
            change_firmware(&firmware, &c->later);
        }
        const double torque = is_compensated ? compensate(&firmware, move, !is_bad, 0) : 0;
        const int taps = (tapped <= t && t < tapped + width) - (back <= t && t < back + width);
        send_command(&m, torque);
        advance(axis, &m, taps * c->push.tap);
        largest = t >= ticks - ticks / 5 ? fmax(largest, fastest(axis, &m)) : 0;
        if (fabs(m.speed[MOTOR]) > 1e5 || fabs(m.theta[MOTOR]) > 1e9 * axis->count) {
            return 1e5; /* runs away */
        }
    }
    return largest;
}

/* End speed over that without the law, in units of the promise. A slow decay is no swing: longer runs must show it too. */
static double excess(const point_t *point, const void *of)
{
    const problem_t *problem = of;
    case_t c = make_case(*point, problem);
    falsify(&c, problem->broken);
    const double seconds = seconds_of(&c), promise = promised_excess(&c.axis);
    const int is_heavy = problem->broken == SLEW && bristle_frequency(&c.axis) < 2000;
    if (!is_case(&c) || is_heavy || seconds > fmin(LONGEST_S, MOST_TICKS * c.axis.period)) {
        return -1;
    }
    double speed = INFINITY;
    for (int longer = 1; longer <= 16 && speed > promise; longer *= 4) {
        speed = end_speed(&c, longer * seconds, 1);
        speed -= speed > promise / 5 ? fmax(lossless_speed(&c.axis), end_speed(&c, longer * seconds, 0)) : 0;
    }
    return fmax(0, speed / promise);
}

static void check_rest(kind_t kind)
{
    const problem_t problem = {kind, NONE};
    uint64_t random = 1 + (uint64_t)kind;
    point_t worst;
    const double most = search(excess, &problem, TEST_AXES, 1, &random, &worst);
    TEST_ASSERT_TRUE(most <= 1);
}

static void test_a_rigid_axis_rests(void)
{
    check_rest(RIGID);
}

static void test_an_axis_with_a_load_rests(void)
{
    check_rest(LOADED);
}

static void test_an_elastic_axis_rests(void)
{
    check_rest(ELASTIC);
}

static void test_an_axis_can_swing_outside_each_condition(void)
{
    static const problem_t problems[] = {{RIGID, INERTIA}, {LOADED, GAIN}, {ELASTIC, LENGTH},
                                         {RIGID, FC_LOW},  {RIGID, SLEW},  {RIGID, FADE_SPEED}};
    for (size_t k = 0; k < sizeof problems / sizeof problems[0]; k++) {
        uint64_t random = 1;
        point_t worst;
        TEST_ASSERT_TRUE(search(excess, &problems[k], 6000, 1, &random, &worst) > 1);
    }
}
