/* SPDX-License-Identifier: MIT */
/* plant: see plant.h. */
#include "plant.h"

#include <errno.h>
#include <math.h>

#include "load.h"
#include "messages.h"

enum { FRESH_TICKS = 3 };

static const double TICK_S = 0.001;
static const double RATE_FILTER = 0.2; /* about 35 Hz: a step of one count is no jerk */
static const double TURN = 6.283185307179586;
static const double COUNTS_MOST = 9007199254740992; /* 2^53: beyond, a double leaves counts out */

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
    return (double)(float)p->scene->friction.theta_per_count;
}

static double counts_of(const plant_t *p)
{
    return p->rotor.theta / theta_per_count(p);
}

static int64_t measured(const plant_t *p)
{
    return llround(counts_of(p));
}

/* False: one error line was printed. */
static bool is_measured(const plant_t *p)
{
    if (fabs(counts_of(p)) <= COUNTS_MOST) {
        return true;
    }
    log_error("[rotor] after %.3f s: the shaft is at %.9g rad, %.9g counts: outside +-2^53", (double)p->ticks * TICK_S,
             p->rotor.theta, counts_of(p));
    return false;
}

/* The torque that the node last answered, N m. */
static double answered(const plant_t *p)
{
    const encoder_t *e = p->encoder;
    bool fresh = e->torque_of > 0 && e->sent - e->torque_of < FRESH_TICKS;
    return fresh ? ldexp(e->torque_q30, -30) * (double)(float)p->scene->friction.Fc : 0;
}

static double control(plant_t *p)
{
    const scene_control_t *c = &p->scene->control;
    double error = (double)(p->place - measured(p));
    p->rate += RATE_FILTER * (error - p->last_error - p->rate);
    p->last_error = error;
    p->compensation = answered(p);
    double feedback = theta_per_count(p) * (c->kp * error + c->kd * p->rate / TICK_S);
    return clamp(feedback + p->compensation, c->torque_limit);
}

static double drive(const plant_t *p)
{
    const scene_motor_t *m = &p->scene->motor;
    return m->bias + m->amplitude * sin(TURN * m->frequency * TICK_S * (double)p->ticks);
}

static void look_at_reference(plant_t *p, int64_t place)
{
    int direction = (place > p->place) - (place < p->place);
    if (direction != 0) {
        p->reversals += direction == -p->direction ? 1u : 0u;
        p->direction = direction;
    }
    p->place = place;
}

static void look_at_error(plant_t *p)
{
    double error = (double)p->place * theta_per_count(p) - p->rotor.theta;
    p->sum_square += error * error;
    p->max_error = fmax(p->max_error, fabs(error));
}

static void write_row(plant_t *p, double angle, double omega)
{
    if (p->trace != NULL &&
        fprintf(p->trace, "%.3f,%.17g,%.17g,%.17g,%.17g,%.17g,%.17g\n", (double)p->ticks * TICK_S,
                (double)p->place * theta_per_count(p), angle, omega, p->torque, p->rotor.friction, p->compensation) < 0) {
        p->trace_errno = errno;
    }
}

/* The bearing carries what the motor's torque puts on it, where the scene says so. */
static void carry(plant_t *p, double torque)
{
    p->motion.load = torque;
    if (p->scene->has_load) {
        p->rotor.load_q30 = load_of(&p->scene->load, torque) << 14;
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
    write_row(p, p->rotor.theta, p->rotor.omega);
    carry(p, torque);
    rotor_advance(&p->rotor, torque);
    p->ticks++;
}

static int next_controlled(motion_t *self, int64_t *place)
{
    plant_t *p = (plant_t *)(void *)self;
    if (!is_measured(p)) {
        return -1;
    }
    int result = p->reference->next(p->reference, place);
    if (result == 1) {
        look_at_reference(p, *place);
        look_at_error(p);
        advance(p, control(p));
    }
    return result;
}

static int next_driven(motion_t *self, int64_t *place)
{
    plant_t *p = (plant_t *)(void *)self;
    if (!is_measured(p)) {
        return -1;
    }
    if (p->ticks >= (uint64_t)llround(p->scene->motor.seconds / TICK_S)) {
        return 0;
    }
    *place = measured(p);
    p->place = *place;
    advance(p, drive(p));
    return 1;
}

bool plant_open(plant_t *plant, const scene_t *scene, motion_t *reference, const encoder_t *encoder)
{
    const scene_rotor_t *r = &scene->rotor;
    *plant = (plant_t){.scene = scene, .reference = reference, .encoder = encoder};
    plant->motion = (motion_t){.next = reference != NULL ? next_controlled : next_driven, .scene = &scene->motion};
    if (rotor_open(&plant->rotor, r->inertia, r->viscous, r->sigma0, r->Fc) != DAHL_OK) {
        log_error("[rotor] sigma0 = %.9g, Fc = %.9g: dahl_prepare refuses", r->sigma0, r->Fc);
        return false;
    }
    return true;
}

bool plant_trace(plant_t *plant, const char *path)
{
    plant->trace = fopen(path, "w");
    if (plant->trace == NULL) {
        return false;
    }
    fputs("time_s,reference_rad,angle_rad,velocity_rad_s,motor_Nm,friction_Nm,compensation_Nm\n", plant->trace);
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
