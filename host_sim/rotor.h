/* SPDX-License-Identifier: MIT */
/*
 * rotor: inertia, viscous drag and Dahl friction under a motor torque T that is constant during each call:
 *   J domega/dt = T + H - b omega - F,    dF/dtheta = sigma0 (1 - F/(c Fc) sgn(omega)),    |F| <= c Fc, c: load
 *   H = stiffness (h - theta) + damping (dh/dt - omega),    h = amplitude sin(2 pi frequency (t - start)): a hand
 * Integration: half steps in speed around an exact step of the friction. It is of second order in ROTOR_STEP_S, and stable if
 * the inertia is at least dahl_rotor_least_inertia().
 *
 * Python calls these functions too (compensation.py and park_steer.py in tools/dahl/sim), so they are in libdahl.so and have
 * its prefix.
 */
#ifndef ROTOR_H
#define ROTOR_H

#include <stdbool.h>
#include <stdint.h>

#include "dahl_parts.h"
#include "timing.h"

#define ROTOR_STEP_US 20u
#define ROTOR_STEP_S ((double)ROTOR_STEP_US / US_PER_S)

typedef struct {
    double stiffness; /* N m/rad */
    double damping;   /* N m s/rad */
    double amplitude; /* rad */
    double frequency; /* Hz */
    double start;     /* s, may be negative; the hand is off the shaft before */
} hand_t;

typedef struct {
    double inertia; /* kg m^2 */
    double viscous; /* N m s/rad */
    double theta;   /* rad */
    double omega;   /* rad/s */
    double friction; /* N m, with the sign of the motion */
    bool has_friction;
    uint32_t load_q30; /* of the bearing, 2^30: 1; below 2 */
    const hand_t *hand; /* NULL: none */
    uint64_t steps;
    dahl_plan_t plan;
    dahl_state_t bristle;
} rotor_t;

/* Start at rest, relaxed, under a load of 1, without a hand. Fc = 0: without friction. Returns the error of dahl_prepare. */
dahl_err_t dahl_rotor_open(rotor_t *rotor, double inertia, double viscous, double sigma0, double Fc);

/* kg m^2. With c = b h/2J and p = sigma0 h^2/J (the slope after a reversal is 2 sigma0), the linearised step is stable if
 * p < 2(1 + (1 - c)^2)/(2 - c) and c < 2. The inertia returned ensures c <= 1 and p <= 1, which is within that. The hand adds its
 * damping to b and its stiffness to the slope. */
double dahl_rotor_least_inertia(double viscous, double sigma0, const hand_t *hand);

/* Present torque of the hand, N m. */
double dahl_rotor_hand_torque(const rotor_t *rotor);

/* Advance one period under `torque` N m. */
void dahl_rotor_advance(rotor_t *rotor, double torque);

#endif
