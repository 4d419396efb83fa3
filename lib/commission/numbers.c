/* SPDX-License-Identifier: MIT */
/** Numbers without libm. */
#include "../arith/fixed.h"
#include "commission.h"

/** Return a first value of the root of x > 0, at most 4 % off. The shift halves the exponent. */
static float guess_root(float x)
{
    return dahl_float_of((dahl_bits_of(x) >> 1) + 0x1FBD1DF6u);
}

float dahl_root(float x)
{
    if (!(x > 0)) {
        return 0;
    }
    float root = guess_root(x);
    for (int step = 0; step < 2; step++) {
        root = 0.5f * (root + x / root);
    }
    return root;
}

/* The constants are products, because a division takes 500 instructions on a Cortex-M0. */
void dahl_small_turn(float angle, float turn[2])
{
    const float square = angle * angle;
    turn[0] = 1 - square * (1.0f / 2 - square * (1.0f / 24 - square * (1.0f / 720)));
    turn[1] = angle * (1 - square * (1.0f / 6 - square * (1.0f / 120 - square * (1.0f / 5040))));
}

void dahl_rotate(float rotor[2], const float turn[2])
{
    float x = rotor[0] * turn[0] - rotor[1] * turn[1], y = rotor[1] * turn[0] + rotor[0] * turn[1];
    float correction = 1.5f - 0.5f * (x * x + y * y);
    rotor[0] = x * correction;
    rotor[1] = y * correction;
}

float dahl_low_pass_share(float hertz, float period)
{
    float ratio = AXIS_TWO_PI * hertz * period;
    return ratio / (1 + ratio);
}
