/* SPDX-License-Identifier: MIT */
#include "rivals.h"

#include <math.h>

#include "../timing.h"

static const double TWO_PI = 6.283185307179586;
static const double SPEED_FILTER_HZ = 40; /* low-pass of the measured speed, which the laws of the speed need */
static const double GAIN_HAND = 0.9;      /* as the library: with 1, a free axis coasts */
static const double LARGEST = 1.0;        /* N m; the disturbance observer knows no Fc that could limit it */

static double sign(double x)
{
    return (x > 0) - (x < 0);
}

/* Share of a gap that a low-pass closes in a tick. */
static double share_of(double corner_hz)
{
    return 1 - exp(-TWO_PI * corner_hz * PERIOD_S);
}

/* The speed of the reference is free of noise. An axis without a reference has the measured one. */
static double speed_of(const law_params_t *law, const rival_t *rival, const reading_t *now)
{
    return law->is_hand ? rival->speed : now->target_speed;
}

/* Fc tanh(v/knob). Knob: rad/s. */
static double soft_sign(const law_params_t *law, const rival_t *rival, const reading_t *now)
{
    return law->Fc * tanh(speed_of(law, rival, now) / law->knob);
}

/* Fc sgn(v) of the measured speed, 0 within a dead band: the usual answer to chatter. Knob: half the band in rad/s. */
static double dead_band(const law_params_t *law, const rival_t *rival)
{
    return fabs(rival->speed) > law->knob ? law->Fc * sign(rival->speed) : 0;
}

/* Rule of machine tools: after each reversal of the reference, the torque goes to the other side with a time constant. Knob: s. */
static double reversal(const law_params_t *law, rival_t *rival, const reading_t *now)
{
    double end = law->Fc * sign(now->target_speed);
    rival->torque += (end - rival->torque) * (1 - exp(-PERIOD_S / law->knob));
    return rival->torque;
}

/* LuGre observer (Canudas de Wit 1995): the bristle moves with the measured speed, integrated exactly over a tick of constant speed.
 * Knob: corner in Hz of the low-pass of the speed. */
static double lugre_observer(const law_params_t *law, rival_t *rival, const reading_t *now)
{
    double measured = now->dcounts * law->theta_per_count / PERIOD_S;
    rival->bristle_speed += (measured - rival->bristle_speed) * share_of(law->knob);
    double speed = rival->bristle_speed, ratio = speed / law->stribeck;
    double sliding = law->Fc + (law->breakaway - law->Fc) * exp(-ratio * ratio);
    double end = sliding / law->sigma0 * sign(speed);
    rival->deflection = end + (rival->deflection - end) * exp(-law->sigma0 / sliding * fabs(speed) * PERIOD_S);
    return (law->is_hand ? GAIN_HAND : 1) * law->sigma0 * rival->deflection;
}

/* Disturbance observer (Ohnishi): a low-pass of all torque that the inertia does not explain. It knows no friction. Knob: corner in
 * Hz. If it is negative, a second pole an octave above takes some noise, as in the residual observer of the library. */
static double disturbance_observer(const law_params_t *law, rival_t *rival, const reading_t *now)
{
    double corner = fabs(law->knob), rate = TWO_PI * corner, per_count = law->theta_per_count / PERIOD_S;
    double dv = (now->dcounts - rival->dcounts) * per_count;
    rival->dcounts = now->dcounts;
    rival->raw += rate * PERIOD_S * (now->acted - rival->raw) - rate * law->inertia * dv;
    rival->filtered += (rival->raw - rival->filtered) * (law->knob < 0 ? share_of(2 * corner) : 1);
    return fmax(-LARGEST, fmin(LARGEST, rival->filtered));
}

double dahl_rival_torque(const law_params_t *law, rival_t *rival, const reading_t *now)
{
    double measured = now->dcounts * law->theta_per_count / PERIOD_S;
    rival->speed += (measured - rival->speed) * share_of(SPEED_FILTER_HZ);
    switch (law->law) {
    case DAHL_LAW_SIGN:
        return law->Fc * sign(speed_of(law, rival, now));
    case DAHL_LAW_TANH:
        return soft_sign(law, rival, now);
    case DAHL_LAW_DEAD_BAND:
        return dead_band(law, rival);
    case DAHL_LAW_REVERSAL:
        return reversal(law, rival, now);
    case DAHL_LAW_LUGRE:
        return lugre_observer(law, rival, now);
    case DAHL_LAW_DISTURBANCE:
        return disturbance_observer(law, rival, now);
    case DAHL_LAW_LEARNED:
        return now->learned;
    case DAHL_LAW_NONE:
    case DAHL_LAW_DAHL:
    case DAHL_LAW_DAHL_OBSERVER:
    default:
        return 0;
    }
}
