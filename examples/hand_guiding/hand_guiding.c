/* SPDX-License-Identifier: MIT */
/*
 * Guide a robot joint by hand in torque mode. The motor carries the weight of the arm and cancels most of the friction. The
 * hand moves the joint lightly, and the arm stays where the hand leaves it.
 *
 * It stays because friction holds it. The law cancels gain Fc of the friction. The remaining friction must hold the load: the
 * torque by which the known weight is wrong in the worst pose. The condition is gain Fc <= 0.95 (FC_LOW - load), so a larger
 * load means a lower gain and a heavier feel. With load >= FC_LOW friction does not hold the arm: init returns an error.
 */
#include "hand_guiding.h"

#include <dahl_compensator.h>
#include <math.h>

#define FC_LOW 0.9f         /* N m, from dahl identify, warm, with the lightest tool */
#define LENGTH_LONG 0.006f  /* rad, from dahl identify */
#define SIGMA0_HIGH 220.0f  /* N m/rad, from dahl identify */
#define INERTIA 0.04f       /* kg m2: all that turns with the encoder, without a tool */
#define RAD_PER_COUNT (6.2831853f / 65536)

static dahl_compensator_params_t params = {
    .friction = {FC_LOW / LENGTH_LONG, FC_LOW, RAD_PER_COUNT}, .law = DAHL_COMPENSATOR_MEASURED,
    .Fc_low = FC_LOW, .length_long = LENGTH_LONG, .sigma0_high = SIGMA0_HIGH,
    .inertia = INERTIA, .delay = 2e-3f, .elastic = 0,            /* kg m2, s */
    .limit = FC_LOW, .slew = 100 * FC_LOW, .period = 1e-3f,      /* N m, N m/s, s */
    .rise = 0.5f, .fall = 0.02f, .fade_speed = 0.0f,             /* s, s; friction does not fall with speed */
    .noise = 1, .play = 4, .jump = 300};                         /* counts */
static dahl_plan_t friction;
static dahl_state_t bristle;
static dahl_compensator_plan_t plan;
static dahl_compensator_t compensator;
static float weight;       /* N m */
static int32_t last_count; /* the last good one */

int hand_guiding_init(const hand_guiding_payload_t *payload, int32_t count)
{
    if (payload->load >= FC_LOW) {
        return DAHL_COMPENSATOR_GAIN; /* friction does not hold the arm */
    }
    params.load = payload->load;
    params.gain = 0.9f * (FC_LOW - payload->load) / FC_LOW; /* the limit is 0.95; the margin allows a tap */
    weight = payload->weight;
    last_count = count;
    bristle = (dahl_state_t){0};
    compensator = (dahl_compensator_t){0}; /* faded out */
    int code = dahl_prepare(&friction, &params.friction);
    return code != DAHL_OK ? code : dahl_compensator_prepare(&plan, &params);
}

/* While the encoder is bad, carry the weight at the last good angle. Only the compensation fades out. */
float hand_guiding_tick(int32_t count, int is_good)
{
    int32_t dcounts = is_good ? count - last_count : 0;
    last_count += dcounts;
    int32_t move = dahl_compensator_move(&plan, &compensator, dcounts, is_good);
    int32_t w = dahl_step_counts_q30(&friction, &bristle, move);
    float compensation = (float)dahl_compensator_torque(&plan, &compensator, w) * (DAHL_Q30 * FC_LOW);
    return weight * cosf((float)last_count * RAD_PER_COUNT) + compensation;
}
