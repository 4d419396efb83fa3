// SPDX-License-Identifier: MIT
// Friction of a shaft with a 14-bit encoder: 2 counts a tick forward, then back. Prints each tenth tick. Needs no wiring.
#include <dahl.hpp>

const long TICKS = 100;

static dahl::Plan plan;
static dahl::Bearing bearing(plan);

void setup()
{
    Serial.begin(115200);
    if (plan.prepare(100.0f, 0.5f, 6.2831853f / 16384) != DAHL_OK) { // sigma0 N m/rad, Fc N m, rad/count
        Serial.println("a parameter is out of range");
        return;
    }
    for (long tick = 1; tick <= TICKS; tick++) {
        float torque = bearing.step_counts(tick <= TICKS / 2 ? 2 : -2);
        if (tick % 10 == 0) {
            Serial.print(tick);
            Serial.print(' ');
            Serial.println(torque, 7); // N m
        }
    }
    Serial.println("done");
}

void loop()
{
}
