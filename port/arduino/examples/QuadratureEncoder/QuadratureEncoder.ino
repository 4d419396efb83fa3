// SPDX-License-Identifier: MIT
// Friction of a shaft with a quadrature encoder of 500 lines on pins 2 and 3, the interrupt pins of an Uno and a Mega. Each
// edge counts, so a turn has 2000 counts. Once a millisecond the torque follows from the counts since the last tick.
#include <dahl.hpp>

const uint8_t PIN_A = 2, PIN_B = 3;
const float COUNTS_PER_TURN = 2000;
const uint32_t TICK_US = 1000, PRINT_US = 100000;

static dahl::Plan plan;
static dahl::Bearing bearing(plan);
static dahl::Encoder encoder;
static volatile uint16_t counter; // wraps at 65536, as a timer in encoder mode
static uint32_t last_tick, last_print;

void edge_of_a()
{
    if (digitalRead(PIN_A) == digitalRead(PIN_B)) {
        counter--;
    } else {
        counter++;
    }
}

void edge_of_b()
{
    if (digitalRead(PIN_A) == digitalRead(PIN_B)) {
        counter++;
    } else {
        counter--;
    }
}

uint16_t reading()
{
    noInterrupts(); // read both bytes of the same count
    uint16_t now = counter;
    interrupts();
    return now;
}

void setup()
{
    Serial.begin(115200);
    pinMode(PIN_A, INPUT_PULLUP);
    pinMode(PIN_B, INPUT_PULLUP);
    attachInterrupt(digitalPinToInterrupt(PIN_A), edge_of_a, CHANGE);
    attachInterrupt(digitalPinToInterrupt(PIN_B), edge_of_b, CHANGE);
    if (plan.prepare(2.0f, 0.05f, 6.2831853f / COUNTS_PER_TURN) != DAHL_OK || encoder.init(65536) != DAHL_OK) {
        Serial.println("a parameter is out of range");
    }
}

void loop()
{
    uint32_t now = micros();
    if (now - last_tick < TICK_US) {
        return;
    }
    last_tick = now;
    float torque = bearing.step_counts(encoder.move(reading())); // N m, with the sign of the motion
    if (now - last_print > PRINT_US) {
        last_print = now;
        Serial.println(torque, 6);
    }
}
