// SPDX-License-Identifier: MIT
// A motor of the mock with a FrictionCompensator or an AxisCommission, for ctypes.
#include "AxisCommission.h"
#include "FrictionCompensator.h"

unsigned long clock_us;

static Sensor sensor;
static FOCMotor motor;
static FrictionCompensator *compensator;

extern "C" int motor_init(int direction, float other_ampere, unsigned counts_per_turn)
{
    compensator = new FrictionCompensator(motor, 0.05f, counts_per_turn);
    clock_us = 4294967000; // micros() wraps soon
    motor.sensor = &sensor;
    motor.sensor_direction = static_cast<Direction>(direction);
    motor.feed_forward_current.q = other_ampere;
    dahl_compensator_params_t params = {};
    params.friction = {0.045f / 0.0055f, 0.045f, 0.0f};
    params.Fc_low = 0.045f;
    params.length_long = 0.0055f;
    params.sigma0_high = 9.0f;
    params.inertia = 1e-4f;
    params.delay = 2e-3f;
    params.gain = 0.9f;
    params.limit = 0.03f;
    params.slew = 5.0f;
    params.period = 1e-3f;
    params.fall = 0.02f;
    params.play = 1;
    params.jump = 200;
    return compensator->init(params);
}

// Returns the whole feed-forward current in A after `us` microseconds at an angle in rad within the turn.
extern "C" float motor_loop(float angle, unsigned long us, int is_enabled, int is_good)
{
    clock_us += us;
    sensor.angle = angle;
    motor.enabled = static_cast<int8_t>(is_enabled);
    compensator->loop(is_good != 0);
    return motor.feed_forward_current.q;
}

extern "C" unsigned motor_rejected() { return compensator->telemetry().rejected; }

extern "C" int motor_moved() { return compensator->telemetry().move; }

static AxisCommission *commission;

extern "C" int commission_init(int direction, unsigned counts_per_turn, float inertia, float torque_limit)
{
    commission = new AxisCommission(motor, 0.05f, counts_per_turn);
    motor.sensor = &sensor;
    motor.sensor_direction = static_cast<Direction>(direction);
    dahl_commission_config_t config = {};
    config.period = 1e-3f;
    config.inertia = inertia;
    config.travel = 0.35f;
    config.angle_limit = 0.7f;
    config.speed_limit = 10;
    config.torque_limit = torque_limit;
    return commission->init(config, 35);
}

// Returns the target in A after a millisecond at an angle in rad within the turn.
extern "C" float commission_loop(float angle, float torque)
{
    clock_us += 1000;
    sensor.angle = angle;
    commission->loop(torque);
    return motor.controller == MotionControlType::torque ? motor.target : 1e9f;
}

extern "C" int commission_is_compensating() { return commission->state().is_compensating; }

extern "C" int commission_refusal() { return commission->state().command.refusal; }

extern "C" float commission_Fc(int end)
{
    const dahl_commission_range_t &Fc = commission->state().commission.result.Fc;
    return end < 0 ? Fc.least : end > 0 ? Fc.most : Fc.best;
}
