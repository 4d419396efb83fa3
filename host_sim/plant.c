/* SPDX-License-Identifier: MIT */
#include "plant.h"

#include <errno.h>
#include <math.h>

#include "stderr_messages.h"
#include "timing.h"

enum { FRESH_TICKS = 3 }; /* an answer is used for this many ticks */

static const double RATE_FILTER = 0.2; /* of each new difference; about 35 Hz, so that a count causes no jerk */
static const double TWO_PI = 6.283185307179586;
static const double COUNTS_MAX = 0x1p53; /* a double holds each count up to here */

static double clamp(double value, double limit)
{
    return fmax(-limit, fmin(limit, value));
}

static int sign_of(double value)
{
    return (value > 0) - (value < 0);
}

static double theta_per_count(const plant_t *p)
{
    return (double)(float)p->run->friction.theta_per_count;
}

static double exact_count(const plant_t *p)
{
    return p->rotor.theta / theta_per_count(p);
}

static int64_t measured_count(const plant_t *p)
{
    return llround(exact_count(p));
}

/* False: one error line was printed. */
static bool is_in_range(const plant_t *p)
{
    if (fabs(exact_count(p)) <= COUNTS_MAX) {
        return true;
    }
    log_error("[rotor] after %.3f s: the shaft is at %.9g rad, %.9g counts: outside +-2^53", (double)p->ticks * PERIOD_S,
             p->rotor.theta, exact_count(p));
    return false;
}

/* Torque of the last answer, N m; 0 if the answer is too old. */
static double answered_torque(const plant_t *p)
{
    const encoder_t *e = p->encoder;
    bool is_fresh = e->torque_of > 0 && e->sent - e->torque_of < FRESH_TICKS;
    return is_fresh ? ldexp(e->torque_q30, -30) * p->Fc : 0;
}

static double control_torque(plant_t *p)
{
    double error = (double)(p->reference_count - measured_count(p));
    p->rate += RATE_FILTER * (error - p->last_error - p->rate);
    p->last_error = error;
    p->compensation = answered_torque(p);
    double feedback = theta_per_count(p) * dahl_controller_torque(&p->controller, error, p->rate);
    return clamp(feedback + p->compensation, p->run->control.torque_limit);
}

static double motor_torque(const plant_t *p)
{
    const run_motor_t *m = &p->run->motor;
    return m->bias + m->amplitude * sin(TWO_PI * m->frequency * PERIOD_S * (double)p->ticks);
}

static void record_reference(plant_t *p, int64_t count)
{
    int direction = (count > p->reference_count) - (count < p->reference_count);
    if (direction != 0) {
        p->reversals += direction == -p->direction ? 1u : 0u;
        p->direction = direction;
    }
    p->reference_count = count;
}

static void record_error(plant_t *p)
{
    double error = (double)p->reference_count * theta_per_count(p) - p->rotor.theta;
    p->sum_square += error * error;
    p->max_error = fmax(p->max_error, fabs(error));
}

static void write_row(plant_t *p)
{
    const rotor_t *r = &p->rotor;
    int result = fprintf(p->trace, "%.3f,%.17g,%.17g,%.17g,%.17g,%.17g,%.17g", (double)p->ticks * PERIOD_S,
                         (double)p->reference_count * theta_per_count(p), r->theta, r->omega, p->torque, r->friction,
                         p->compensation);
    if (result >= 0 && p->run->has_hand) {
        result = fprintf(p->trace, ",%.17g", dahl_rotor_hand_torque(r));
    }
    if (result < 0 || fputc('\n', p->trace) == EOF) {
        p->trace_errno = errno;
    }
}

/* With a load, the bearing is loaded by the motor's torque. dahl_clamped_step() lowers a load of 2 to 2 - 2^-30. */
static void set_load(plant_t *p, double torque)
{
    const run_load_t *load = &p->run->load;
    p->motion.load = torque;
    if (p->run->has_load) {
        p->rotor.load_q30 = encoder_load_of(load, torque, load->rotor_limit) << 14;
    }
}

static void advance(plant_t *p, double torque)
{
    int sign = sign_of(torque);
    if (sign != 0) {
        p->alternations += sign == -p->side ? 1u : 0u;
        p->side = sign;
    }
    p->torque = torque;
    if (p->trace != NULL) {
        write_row(p);
    }
    set_load(p, torque);
    dahl_rotor_advance(&p->rotor, torque);
    p->ticks++;
}

static int next_controlled(motion_t *self, int64_t *count)
{
    plant_t *p = (plant_t *)(void *)self;
    if (!is_in_range(p)) {
        return -1;
    }
    int result = p->reference->next(p->reference, count);
    if (result == 1) {
        record_reference(p, *count);
        record_error(p);
        advance(p, control_torque(p));
    }
    return result;
}

static int next_driven(motion_t *self, int64_t *count)
{
    plant_t *p = (plant_t *)(void *)self;
    if (!is_in_range(p)) {
        return -1;
    }
    if (p->ticks >= (uint64_t)llround(p->run->motor.seconds / PERIOD_S)) {
        return 0;
    }
    *count = measured_count(p);
    p->reference_count = *count;
    advance(p, motor_torque(p));
    return 1;
}

bool plant_open(plant_t *plant, const run_t *run, motion_t *reference, const encoder_t *encoder, float Fc)
{
    const run_rotor_t *r = &run->rotor;
    *plant = (plant_t){.run = run, .reference = reference, .encoder = encoder, .Fc = (double)Fc};
    plant->controller = (controller_t){.kp = run->control.kp, .kd = run->control.kd};
    plant->motion = (motion_t){.next = reference != NULL ? next_controlled : next_driven, .run = &run->motion};
    if (dahl_rotor_open(&plant->rotor, r->inertia, r->viscous, r->sigma0, r->Fc) != DAHL_OK) {
        log_error("[rotor] sigma0 = %.9g, Fc = %.9g: dahl_prepare refuses", r->sigma0, r->Fc);
        return false;
    }
    plant->rotor.hand = run->has_hand ? &run->hand : NULL;
    return true;
}

bool plant_trace(plant_t *plant, const char *path)
{
    plant->trace = fopen(path, "w");
    if (plant->trace == NULL) {
        return false;
    }
    fputs("time_s,reference_rad,angle_rad,velocity_rad_s,motor_Nm,friction_Nm,compensation_Nm", plant->trace);
    fputs(plant->run->has_hand ? ",hand_Nm\n" : "\n", plant->trace);
    return true;
}

bool plant_close(plant_t *plant)
{
    if (fclose(plant->trace) != 0) {
        plant->trace_errno = errno;
    }
    errno = plant->trace_errno;
    return errno == 0;
}
