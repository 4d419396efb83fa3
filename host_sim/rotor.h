/* SPDX-License-Identifier: MIT */
/*
 * rotor: inertia, viscous drag and Dahl friction under a motor torque T that is held over each call:
 *   J domega/dt = T - b omega - F,    dF/dtheta = sigma0 (1 - F/(c Fc) sgn(omega)),    |F| <= c Fc, c: load
 * Half steps in speed around an exact step of the friction, which is second order in ROTOR_STEP_S, and stable from
 * rotor_least_inertia() on.
 */
#ifndef ROTOR_H
#define ROTOR_H

#include "dahl_parts.h"

#define ROTOR_STEP_S 20e-6

typedef struct {
    double inertia; /* kg m^2 */
    double viscous; /* N m s/rad */
    double theta;   /* rad */
    double omega;   /* rad/s */
    double friction; /* N m, with the sign of the motion */
    uint32_t load_q30; /* of the bearing, 2^30: 1 */
    dahl_plan_t plan;
    dahl_state_t bristle;
} rotor_t;

/* At rest, relaxed, under a load of 1. Fails as dahl_prepare does. */
dahl_err_t rotor_open(rotor_t *rotor, double inertia, double viscous, double sigma0, double Fc);

/* kg m^2. With c = b h/2J and p = sigma0 h^2/J (after a reversal the slope of the friction is 2 sigma0) the linearised
 * step is stable for p < 2(1 + (1 - c)^2)/(2 - c), c < 2; c <= 1 and p <= 1 are within that. */
double rotor_least_inertia(double viscous, double sigma0);

/* One millisecond under `torque` N m. */
void rotor_advance(rotor_t *rotor, double torque);

#endif
