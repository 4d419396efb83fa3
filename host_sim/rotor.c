/* SPDX-License-Identifier: MIT */
#include "rotor.h"

#include <math.h>

enum { STEPS = PERIOD_US / ROTOR_STEP_US };

static const double RAD_PER_TURN = 6.283185307179586;

dahl_err_t dahl_rotor_open(rotor_t *rotor, double inertia, double viscous, double sigma0, double Fc)
{
    dahl_params_t params = {.sigma0 = (float)sigma0, .Fc = (float)Fc};
    *rotor = (rotor_t){.inertia = inertia, .viscous = viscous, .load_q30 = 1u << 30, .has_friction = !(fabs(Fc) <= 0)};
    return rotor->has_friction ? dahl_prepare(&rotor->plan, &params) : DAHL_OK;
}

double dahl_rotor_least_inertia(double viscous, double sigma0, const hand_t *hand)
{
    double b = viscous + hand->damping, half_slope = sigma0 + hand->stiffness / 2;
    return fmax(b * ROTOR_STEP_S / 2, half_slope * ROTOR_STEP_S * ROTOR_STEP_S);
}

double dahl_rotor_hand_torque(const rotor_t *rotor)
{
    const hand_t *hand = rotor->hand;
    if (hand == NULL) {
        return 0;
    }
    double time = (double)rotor->steps * ROTOR_STEP_S - hand->start;
    if (time < 0) {
        return 0;
    }
    double rate = RAD_PER_TURN * hand->frequency;
    double angle = hand->amplitude * sin(rate * time), speed = hand->amplitude * rate * cos(rate * time);
    return hand->stiffness * (angle - rotor->theta) + hand->damping * (speed - rotor->omega);
}

static void accelerate(rotor_t *rotor, double torque, double seconds)
{
    double sum = torque + dahl_rotor_hand_torque(rotor) - rotor->viscous * rotor->omega - rotor->friction;
    rotor->omega += seconds * sum / rotor->inertia;
}

static void step(rotor_t *rotor, double torque)
{
    accelerate(rotor, torque, ROTOR_STEP_S / 2);
    float moved = (float)(rotor->omega * ROTOR_STEP_S); /* angle and friction must advance by the same rounded step */
    rotor->theta += (double)moved;
    if (rotor->has_friction) {
        rotor->friction = (double)dahl_clamped_step(&rotor->plan, &rotor->bristle, moved, rotor->load_q30);
    }
    rotor->steps++;
    accelerate(rotor, torque, ROTOR_STEP_S / 2);
}

void dahl_rotor_advance(rotor_t *rotor, double torque)
{
    for (int i = 0; i < STEPS; i++) {
        step(rotor, torque);
    }
}
