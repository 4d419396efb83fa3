/* SPDX-License-Identifier: MIT */
/* rotor: see rotor.h. */
#include "rotor.h"

#include <math.h>

enum { STEPS = PERIOD_US / ROTOR_STEP_US };

dahl_err_t rotor_open(rotor_t *rotor, double inertia, double viscous, double sigma0, double Fc)
{
    dahl_params_t params = {.sigma0 = (float)sigma0, .Fc = (float)Fc};
    *rotor = (rotor_t){.inertia = inertia, .viscous = viscous, .load_q30 = 1u << 30};
    return dahl_prepare(&rotor->plan, &params);
}

double rotor_least_inertia(double viscous, double sigma0)
{
    return fmax(viscous * ROTOR_STEP_S / 2, sigma0 * ROTOR_STEP_S * ROTOR_STEP_S);
}

static void accelerate(rotor_t *rotor, double torque, double seconds)
{
    rotor->omega += seconds * (torque - rotor->viscous * rotor->omega - rotor->friction) / rotor->inertia;
}

static void step(rotor_t *rotor, double torque)
{
    accelerate(rotor, torque, ROTOR_STEP_S / 2);
    float moved = (float)(rotor->omega * ROTOR_STEP_S); /* angle and friction must advance by the same rounded step */
    rotor->theta += (double)moved;
    rotor->friction = (double)dahl_clamped_step(&rotor->plan, &rotor->bristle, moved, rotor->load_q30);
    accelerate(rotor, torque, ROTOR_STEP_S / 2);
}

void rotor_advance(rotor_t *rotor, double torque)
{
    for (int i = 0; i < STEPS; i++) {
        step(rotor, torque);
    }
}
