/* SPDX-License-Identifier: MIT */
/* Closed loops with the compensator: the limits that make it safe to switch on, and naive builds that must miss them. The energy
 * of adversarial paths is in test_compensation_energy.c. */
#include "axis.h"

static const double rates[] = {1000, 8000};

/* --- a free axis, and a hand ------------------------------------------------------------------------------------------ */

/* Largest speed in the last of `seconds` after a kick. */
static double speed_after_kick(axis_t *axis, double seconds)
{
    double largest = 0;
    axis_start(axis);
    axis->speed = 3;
    const int ticks = (int)lround(seconds / axis->period), last = (int)lround(1 / axis->period);
    for (int t = 0; t < ticks; t++) {
        axis_tick(axis, 0);
        largest = t >= ticks - last ? fmax(largest, fabs(axis->speed)) : 0;
    }
    return largest;
}

/* Largest speed of light and heavy axes with 1 to 3 ticks of delay. */
static double largest_speed_after_kick(axis_t axis)
{
    double largest = 0;
    for (axis.delay = 1; axis.delay <= 3; axis.delay++) {
        for (int kind = 0; kind < 2; kind++) {
            axis_t kicked = axis;
            kicked.inertia = kind == 0 ? 0.002 : 0.02;
            largest = fmax(largest, speed_after_kick(&kicked, 4));
        }
    }
    return largest;
}

/* A free axis whose play is 2 noise + more_play. */
static axis_t noisy_axis(int bits, double rate, int noise, int more_play)
{
    axis_t axis = axis_of(DAHL_COMPENSATOR_MEASURED, bits, rate);
    axis_noise(&axis, noise);
    axis.params.play += (uint32_t)more_play;
    return axis;
}

static void test_a_free_axis_comes_to_rest(void)
{
    for (int bits = 12; bits <= 20; bits += 2) {
        for (int kind = 0; kind < 8; kind++) {
            axis_t axis = noisy_axis(bits, rates[kind % 2], 1 + kind / 2 % 2, 2);
            axis.is_noise_after_rounding = kind / 4;
            at_most(0.02, largest_speed_after_kick(axis));
        }
    }
}

/* Outside the guarantee. The limits are those of docs/compensation.md. */
static void test_a_play_of_twice_the_noise_lets_a_free_axis_move(void)
{
    static const double limits[][2] = {{0.15, 0.42}, {0.08, 0.15}, {0.04, 0.05}};
    double largest[2] = {0, 0};
    for (int kind = 0; kind < 8; kind++) {
        for (int bits = 12; bits <= 20; bits += 2) {
            const int is_after = kind / 4;
            axis_t axis = noisy_axis(bits, rates[kind % 2], 1 + kind / 2 % 2, 0);
            axis.is_noise_after_rounding = is_after;
            const double speed = largest_speed_after_kick(axis);
            at_most(limits[bits < 14 ? 0 : bits < 16 ? 1 : 2][is_after], speed);
            largest[is_after] = fmax(largest[is_after], speed);
        }
    }
    at_least(0.02, largest[0]);
    at_least(0.2, largest[1]);
}

static axis_t breakaway_axis(int bits, double breakaway, double stribeck_speed)
{
    axis_t axis = noisy_axis(bits, 8000, 1, 2);
    axis.friction.breakaway = breakaway * TRUE_FC;
    axis.friction.stribeck_speed = stribeck_speed;
    return axis;
}

/* The presliding length of such a friction is the breakaway torque over sigma0. */
static void test_a_breakaway_torque_lengthens_the_presliding(void)
{
    static const double breakaway[] = {1.3, 1.3, 2}, stribeck_speed[] = {0.1, 0.5, 0.05};
    for (int kind = 0; kind < 3; kind++) {
        for (int bits = 12; bits <= 20; bits += 4) {
            axis_t axis = breakaway_axis(bits, breakaway[kind], stribeck_speed[kind]);
            axis_claim(&axis, TRUE_FC, TRUE_SIGMA0 / breakaway[kind]);
            at_most(0.02, largest_speed_after_kick(axis));
        }
    }
    at_least(0.1, largest_speed_after_kick(breakaway_axis(20, 1.3, 0.5))); /* claims Fc/sigma0 */
}

/* Such an axis swings by itself, because its presliding loses no energy. The limits are those of docs/compensation.md. */
static void test_three_times_the_length_damps_slip_friction(void)
{
    static const double limits[] = {0.45, 0.2, 0.12, 0.06};
    for (int bits = 12; bits < 16; bits++) {
        axis_t axis = noisy_axis(bits, 1000, 1, 2);
        axis.friction.is_slip = 1;
        axis_t free = axis;
        free.params.gain = 0;
        axis_claim(&axis, TRUE_FC, TRUE_SIGMA0 / 3);
        at_least(1, largest_speed_after_kick(free));
        at_most(limits[bits - 12], largest_speed_after_kick(axis));
    }
}

/* Largest mean speed of an axis that a torque of 10 to 160 Hz shakes after a kick, when the start of the shakes has faded. */
static double shaken_speed(double gain, int more_play, int is_faded)
{
    double largest = 0;
    for (double hertz = 10; hertz <= 160; hertz *= 2) {
        for (double amplitude = 0.2 * TRUE_FC; amplitude < TRUE_FC; amplitude *= 2) {
            axis_t axis = noisy_axis(14, 8000, 1, more_play);
            double start = 0;
            axis.params.gain = (float)gain;
            axis_start(&axis);
            axis.speed = 3;
            for (int t = 0; t < 4 * 8000; t++) {
                start = t == 2 * 8000 ? axis.theta : start;
                axis.encoder_is_good = t < 4000 || !is_faded;
                axis_tick(&axis, t < 4000 ? 0 : amplitude * sin(TWO_PI * hertz * t / 8000));
            }
            largest = fmax(largest, fabs(axis.theta - start) / 2);
        }
    }
    return largest;
}

/* The vibration hides in the play and loosens the friction, but the torque stays. */
static void test_a_shaken_axis_creeps_unless_the_torque_fades(void)
{
    const double at_full_gain = shaken_speed(0.9, 2, 0);
    at_least(0.5, at_full_gain);
    at_most(1.3, at_full_gain);
    at_most(0.7, shaken_speed(0.9, 0, 0));
    at_most(0.1, shaken_speed(0.5, 2, 0));
    at_most(0.01, shaken_speed(0.9, 2, 1));
}

/* RMS of the hand's torque over that without compensation: a sine of 0.5 Hz and a fifth of its amplitude at 1.7 Hz. */
static double hand_ratio(axis_t *axis, double amplitude)
{
    double with = 0, without = 0;
    axis_start(axis);
    for (int t = 0; t * axis->period < 6; t++) {
        double s = TWO_PI * 0.5 * t * axis->period;
        double F = axis_lead(axis, amplitude * (sin(s) + 0.2 * sin(3.4 * s)));
        with += F * F;
        without += axis->friction.F * axis->friction.F;
    }
    return sqrt(with / without);
}

static void test_a_hand_feels_little_friction(void)
{
    for (int bits = 12; bits <= 20; bits += 2) {
        for (int kind = 0; kind < 6; kind++) {
            axis_t axis = noisy_axis(bits, rates[kind % 2], kind / 2, 0);
            at_most(bits < 14 ? 0.20 : 0.17, hand_ratio(&axis, 0.5));
        }
    }
}

/* The limits are those of docs/compensation.md, for a play of 2 noise and of 2 noise + 2. */
static void test_a_hand_feels_a_wider_play_in_small_motions(void)
{
    static const double large[] = {0.13, 0.155}, small[] = {0.205, 0.435};
    for (int kind = 0; kind < 8; kind++) {
        const int is_wide = kind / 4;
        axis_t axis = noisy_axis(14, rates[kind % 2], 1 + kind / 2 % 2, 2 * is_wide), again = axis;
        at_most(large[is_wide], hand_ratio(&axis, 0.5));
        at_most(small[is_wide], hand_ratio(&again, 0.0025));
    }
}

static void test_tanh_resists_a_hand_that_moves_by_5_mrad(void)
{
    axis_t axis = noisy_axis(14, 1000, 2, 0);
    at_most(1, hand_ratio(&axis, 0.0025));
    axis.source = BY_TANH;
    axis.params.gain = 1;
    axis.tanh_speed = 0.02;
    at_least(2.5, hand_ratio(&axis, 0.0025));
}

/* Half the presliding length, that is sigma0 times 2, passes a check of the gain alone. */
static void test_a_short_length_keeps_a_free_axis_moving(void)
{
    axis_t axis = axis_of(DAHL_COMPENSATOR_MEASURED, 14, 1000);
    axis.params.gain = 1;
    axis.params.friction.sigma0 *= 2;
    dahl_compensator_plan_t plan;
    TEST_ASSERT_EQUAL_INT(DAHL_COMPENSATOR_SLOPE, dahl_compensator_prepare(&plan, &axis.params));
    axis.params.length_long /= 2;
    at_least(1, speed_after_kick(&axis, 6));
}

static void test_the_fade_over_speed_stops_a_runaway(void)
{
    axis_t axis = axis_of(DAHL_COMPENSATOR_MEASURED, 14, 1000);
    axis_claim(&axis, 1.3 * TRUE_FC, 1.3 * TRUE_SIGMA0);
    axis.params.gain = 1;
    axis.params.jump = 2000;
    axis_t naive = axis;
    axis.params.fade_speed = 1;
    at_most(2, speed_after_kick(&axis, 10));
    at_least(100, speed_after_kick(&naive, 10));
}

static void test_bounds_hold_for_nine_corners(void)
{
    static const double Fc[] = {0.7, 1, 1.3}, sigma0[] = {0.5, 1, 2};
    for (int corner = 0; corner < 9; corner++) {
        axis_t axis = axis_of(DAHL_COMPENSATOR_MEASURED, 14, 1000);
        axis_noise(&axis, 1);
        axis_claim(&axis, 0.7 * TRUE_FC, 0.7 * TRUE_SIGMA0 * 0.5 / 1.3);
        axis.friction.Fc = TRUE_FC * Fc[corner % 3];
        axis.friction.sigma0 = TRUE_SIGMA0 * sigma0[corner / 3];
        axis_t free = axis;
        at_most(0.05, speed_after_kick(&free, 4));
        at_most(0.70, hand_ratio(&axis, 0.5));
    }
}

/* --- a position loop -------------------------------------------------------------------------------------------------- */

static void refer_sine(axis_t *axis, double t)
{
    const double w = TWO_PI * 0.5;
    axis_refer(axis, 0.3 * sin(w * t), 0.3 * w * cos(w * t), -0.3 * w * w * sin(w * t));
}

/* A sum of sines with no common period. */
static void refer_random(axis_t *axis, double t)
{
    static const double hertz[] = {0.17, 0.31, 0.73, 1.37}, phase[] = {0, 1, 2.5, 4};
    double theta = 0, speed = 0, acceleration = 0;
    for (int k = 0; k < 4; k++) {
        const double w = TWO_PI * hertz[k], s = w * t + phase[k], amplitude = 0.05 / hertz[k];
        theta += amplitude * sin(s);
        speed += amplitude * w * cos(s);
        acceleration -= amplitude * w * w * sin(s);
    }
    axis_refer(axis, theta, speed, acceleration);
}

typedef void (*refer_t)(axis_t *axis, double t);

/* RMS tracking error, after the first second. */
static double tracking_error(axis_t axis, refer_t refer)
{
    double sum = 0;
    refer(&axis, 0);
    axis.theta = axis.reference;
    axis.last_counts = axis.last_reference_counts = (int32_t)floor(axis.theta / axis.theta_per_count);
    axis_start(&axis);
    for (int t = 0; t * axis.period < 6; t++) {
        refer(&axis, t * axis.period);
        const double error = axis.reference - axis.theta;
        axis_tick(&axis, 0);
        sum += t * axis.period < 1 ? 0 : error * error;
    }
    return sqrt(sum);
}

static double tracking_ratio(const axis_t *axis, refer_t refer)
{
    axis_t without = *axis;
    without.source = BY_NOTHING;
    return tracking_error(*axis, refer) / tracking_error(without, refer);
}

static axis_t loop_of(dahl_compensator_law_t law, loop_t loop, int bits, double rate)
{
    axis_t axis = axis_of(law, bits, rate);
    axis.loop = loop;
    return axis;
}

/* Each loop with both rates and inertias. */
enum { LOOP_KINDS = 4 * (LOOPS - PD) };

static axis_t loop_kind(int kind, int bits)
{
    axis_t axis = loop_of(DAHL_COMPENSATOR_REFERENCE, (loop_t)(PD + kind / 4), bits, rates[kind % 2]);
    axis.inertia = kind / 2 % 2 == 0 ? 0.002 : 0.02;
    return axis;
}

static const refer_t refers[] = {refer_sine, refer_random};

static void test_the_reference_law_tracks_in_each_loop(void)
{
    for (int k = 0; k < 2 * LOOP_KINDS; k++) {
        axis_t axis = loop_kind(k / 2, 17), coarse = loop_kind(k / 2, 14);
        at_most(0.22, tracking_ratio(&axis, refers[k % 2]));
        axis.params.gain = 1;
        at_most(0.10, tracking_ratio(&axis, refers[k % 2]));
        axis_noise(&coarse, 2);
        coarse.params.pull = 0.3f;
        at_most(axis.loop == PD ? 0.12 : 0.24, tracking_ratio(&coarse, refers[k % 2]));
    }
}

static void test_wrong_parameters_are_no_worse_than_none(void)
{
    static const double wrong[][2] = {{0.7, 1}, {1.3, 1}, {1, 1 / 3.0}, {1, 3}};
    for (int k = 0; k < 4 * LOOP_KINDS; k++) {
        axis_t axis = loop_kind(k / 4, 17);
        axis_claim(&axis, wrong[k % 4][0] * TRUE_FC, wrong[k % 4][1] * TRUE_SIGMA0);
        axis.params.gain = 1;
        at_most(1.10, tracking_ratio(&axis, refer_sine));
        at_most(1.10, tracking_ratio(&axis, refer_random));
    }
}

/* Sign changes of the torque in a second of hold, after a stop from a motion and a second to settle. */
static double sign_changes(axis_t *axis)
{
    const double seconds = 10;
    int changes = 0, sign = 0;
    axis_start(axis);
    for (int t = 0; t * axis->period < seconds + 3; t++) {
        const double time = t * axis->period;
        refer_sine(axis, fmin(time, 2));
        if (time >= 2) {
            axis_refer(axis, axis->reference, 0, 0);
        }
        axis_tick(axis, 0);
        const int now = (axis->torque > 0) - (axis->torque < 0);
        changes += time > 3 && now * sign < 0;
        sign = now != 0 ? now : sign;
    }
    return changes / seconds;
}

static void test_a_hold_does_not_chatter(void)
{
    for (int kind = 0; kind < 5 * (LOOPS - PD); kind++) {
        const loop_t loop = (loop_t)(PD + kind / 5);
        axis_t reference = loop_of(DAHL_COMPENSATOR_REFERENCE, loop, 12 + 2 * (kind % 5), 1000);
        axis_t measured = loop_of(DAHL_COMPENSATOR_MEASURED, loop, 12 + 2 * (kind % 5), 1000);
        axis_noise(&reference, 1);
        axis_noise(&measured, 1);
        at_most(0, sign_changes(&reference));
        at_most(5, sign_changes(&measured));
    }
}

static void test_noise_without_play_chatters(void)
{
    axis_t axis = loop_of(DAHL_COMPENSATOR_MEASURED, PD, 14, 1000);
    axis.noise = 1; /* the parameters claim a perfect encoder */
    at_least(30, sign_changes(&axis));
}

/* --- faults ----------------------------------------------------------------------------------------------------------- */

/* Largest change of the torque in a tick, in Fc, of a shaft that turns by `counts` per tick, under a fault at tick 500. */
typedef enum { STALE, GLITCH, JUMP, RESET } fault_t;

static double largest_step(axis_t axis, fault_t fault, int counts)
{
    double largest = 0;
    axis_start(&axis);
    for (int t = 0; t < 1000; t++) {
        const double before = axis.torque;
        const int is_now = t == 500;
        int32_t dcounts = t / 250 % 2 == 0 ? counts : -counts;
        axis.encoder_is_good = fault != STALE || t < 500 || t > 600;
        dcounts = axis.encoder_is_good ? dcounts : 0;
        dcounts += fault == GLITCH ? (is_now ? 2048 : t == 501 ? -2048 : 0) : fault == JUMP && is_now ? -100000 : 0;
        if (fault == RESET && is_now) {
            axis.compensator = (dahl_compensator_t){.torque_q30 = axis.compensator.torque_q30};
            axis.bristle.w = 0;
        }
        axis.torque = axis_compensate(&axis, dcounts);
        largest = fmax(largest, fabs(axis.torque - before));
    }
    return largest / TRUE_FC;
}

static void test_faults_step_the_torque_by_at_most_the_slew(void)
{
    for (int fault = STALE; fault <= RESET; fault++) {
        axis_t axis = axis_of(DAHL_COMPENSATOR_MEASURED, 14, 8000);
        axis.params.jump = fault == RESET ? 1000 : 100;
        axis.params.slew = 100;
        const double slew = 100 * axis.period / TRUE_FC;
        at_most(slew * 1.0001, largest_step(axis, (fault_t)fault, 3));
        axis.params.jump = 1u << 30; /* no rejection: the slew alone */
        at_most(slew * 1.0001, largest_step(axis, (fault_t)fault, 3));
        axis.params.slew = 1e6f;
        at_least(fault == GLITCH ? 1.7 : 0, largest_step(axis, (fault_t)fault, 3));
    }
}

/* --- adaptation ------------------------------------------------------------------------------------------------------- */

static void adapt(axis_t *axis, const dahl_adaptation_plan_t *plan)
{
    const double motor = axis->commands[axis->delay] / axis->params.friction.Fc;
    dahl_adaptation_step(plan, &axis->adaptation, &axis->compensator, (int32_t)lround(motor * 0x1p24));
}

static dahl_adaptation_plan_t adaptation_of(const axis_t *axis)
{
    dahl_adaptation_plan_t plan;
    dahl_compensator_params_t params = axis->params;
    params.law = DAHL_COMPENSATOR_REFERENCE; /* a naive build would not refuse the measured law */
    TEST_ASSERT_EQUAL_INT(DAHL_COMPENSATOR_OK, dahl_adaptation_prepare(&plan, &params, (float)axis->inertia));
    return plan;
}

/* Run for `seconds` while the true Fc drifts to Fc_end. Returns the estimate over the true Fc at the end. */
static double adapted(axis_t axis, double seconds, double Fc_end)
{
    const dahl_adaptation_plan_t plan = adaptation_of(&axis);
    axis_start(&axis);
    for (int t = 0; t * axis.period < seconds; t++) {
        const double time = t * axis.period;
        axis.friction.Fc = TRUE_FC + (Fc_end - TRUE_FC) * time / seconds;
        refer_sine(&axis, time);
        axis_tick(&axis, 0);
        adapt(&axis, &plan);
    }
    return (1 + axis.adaptation.Fc_change_q16 * 0x1p-16) * axis.params.friction.Fc / axis.friction.Fc;
}

static void test_adaptation_follows_a_drift(void)
{
    for (int kind = 0; kind < 4 * (LOOPS - PD); kind++) {
        axis_t axis = loop_of(DAHL_COMPENSATOR_REFERENCE, (loop_t)(PD + kind / 4), kind % 2 == 0 ? 14 : 17, 1000);
        axis_noise(&axis, 1);
        axis.inertia = kind % 2 == 0 ? 0.02 : 0.002;
        const double end = kind / 2 % 2 == 0 ? 1.2 : 0.8;
        at_most(0.04, fabs(adapted(axis, 120, end * TRUE_FC) - 1));
    }
}

static void test_adaptation_ignores_a_constant_load(void)
{
    for (int kind = 0; kind < 2 * (LOOPS - PD); kind++) {
        axis_t axis = loop_of(DAHL_COMPENSATOR_REFERENCE, (loop_t)(PD + kind / 2), 14, 1000);
        axis.load = (kind % 2 == 0 ? 0.75 : -0.75) * TRUE_FC;
        at_most(0.03, fabs(adapted(axis, 60, TRUE_FC) - 1));
    }
}

/* It sees its own output instead of the friction. */
static void test_adaptation_under_a_hand_ends_at_the_clamp(void)
{
    axis_t axis = axis_of(DAHL_COMPENSATOR_MEASURED, 17, 1000);
    const dahl_adaptation_plan_t plan = adaptation_of(&axis);
    axis_start(&axis);
    for (int t = 0; t < 120000; t++) {
        (void)axis_lead(&axis, 0.3 * sin(TWO_PI * 0.5e-3 * t));
        adapt(&axis, &plan);
    }
    TEST_ASSERT_DOUBLE_WITHIN(0.01, -0.5, axis.adaptation.Fc_change_q16 * 0x1p-16);
}
